// @ts-check
// Depth, temperature, salinity and sound speed over time: shared cursor, three windows, pause, CSV and PNG.

import { make, saveBlob, setText } from '../shared/dom.js';
import { shownUnit, shownValue } from '../shared/display.js';
import { clockTime, dateTime, fixed } from '../shared/format.js';
import { colors, onThemeChange } from '../shared/theme.js';
import { csvOfSpan, fileStamp, pngOfPlots } from './plot_export.js';
import { timeSplits } from './time_axis.js';
import { MISSING, axisColors, honestScale, loadUPlot, plotFont, remPx } from './uplot.js';

/** @typedef {import('./uplot.js').UPlot} UPlot */

/**
 * @typedef {{key: string, label: string, unit: string, decimals: number, color: string, down: boolean, least: number,
 *   showsTime?: boolean}} Quantity  showsTime: has marks of time of its own; without a word, the last one has
 */

/** What the sensors measure. @type {Quantity[]} */
export const QUANTITIES = [
  { key: 'depth', label: 'Depth', unit: 'm', decimals: 2, color: '--plot-depth', down: true, least: 1 },
  {
    key: 'temperature',
    label: 'Temperature',
    unit: '\u00b0C',
    decimals: 2,
    color: '--plot-temperature',
    down: false,
    least: 0.2,
  },
  {
    key: 'salinity',
    label: 'Salinity',
    unit: 'PSU',
    decimals: 2,
    color: '--plot-salinity',
    down: false,
    least: 0.2,
  },
  {
    key: 'soundSpeed',
    label: 'Sound speed',
    unit: 'm/s',
    decimals: 1,
    color: '--plot-sound',
    down: false,
    least: 1,
  },
];

/** What the navigator estimates of the motion. @type {Quantity[]} */
export const MOTION = [
  {
    key: 'speed',
    label: 'Speed over ground, est.',
    unit: 'm/s',
    decimals: 2,
    color: '--plot-sound',
    down: false,
    showsTime: true,
    least: 0.2,
  },
  {
    key: 'radius',
    label: 'Position within (95 %)',
    unit: 'm',
    decimals: 1,
    color: '--plot-temperature',
    down: false,
    showsTime: true,
    least: 1,
  },
];

const WINDOWS_MIN = [1, 10, 60];

export class TimePlots {
  /**
   * @param {import('./card.js').Card} card
   * @param {import('./history.js').History} history
   * @param {import('./model.js').Model} model
   * @param {Quantity[]} quantities  in the order of the history's keys
   */
  constructor(card, history, model, quantities) {
    this.quantities = quantities;
    this.history = history;
    this.model = model;
    this.windowS = 60;
    /** @type {number | null} right edge while paused */
    this.pausedAtS = null;
    this.rightS = performance.now() / 1000;
    /** @type {number[]} */
    this.times = [];
    /** @type {(number | null)[][]} */
    this.columns = this.quantities.map(() => []);
    /** @type {UPlot[]} */
    this.plots = [];
    this.drawnKey = '';
    this.buildTools(card);
    this.area = make('div', { class: 'plots' });
    this.area.style.gridTemplateRows = `repeat(${quantities.length}, minmax(0, 1fr))`;
    this.rows = this.quantities.map((quantity) => this.buildRow(quantity));
    card.add(this.area);
    void this.load();
  }

  /** @param {import('./card.js').Card} card */
  buildTools(card) {
    this.windowButtons = WINDOWS_MIN.map((minutes) =>
      make('button', {
        class: 'button',
        type: 'button',
        'aria-pressed': String(minutes * 60 === this.windowS),
        text: `${minutes} min`,
        on: { click: () => this.chooseWindow(minutes) },
      }),
    );
    this.pause = make('button', {
      class: 'button',
      type: 'button',
      'aria-pressed': 'false',
      text: 'Pause',
      on: { click: () => this.setPaused(this.pausedAtS === null) },
    });
    this.when = make('span', { class: 'cursor-time' });
    const save = (/** @type {string} */ text, /** @type {() => void} */ click) =>
      make('button', {
        class: 'button',
        type: 'button',
        text,
        title: `Save what is seen as ${text}`,
        on: { click },
      });
    card.head.append(
      make('div', { class: 'tools', role: 'group', 'aria-label': 'Time window' }, ...this.windowButtons),
      make(
        'div',
        { class: 'tools' },
        this.pause,
        save('CSV', () => this.saveCsv()),
        save('PNG', () => void this.savePng()),
      ),
    );
  }

  /** @param {Quantity} quantity */
  buildRow(quantity) {
    const number = make('span', { class: 'number', text: '-' });
    const time = make('span', { class: 'at' });
    const unit = make('span', { class: 'unit', text: quantity.unit });
    const holder = make('div', { class: 'plot' });
    this.area.append(
      make(
        'figure',
        { dataset: { plot: quantity.key } },
        make(
          'figcaption',
          {},
          make('span', { class: 'swatch', dataset: { plot: quantity.key } }),
          make('span', { class: 'name', text: quantity.label }),
          number,
          unit,
          time,
        ),
        holder,
      ),
    );
    return { holder, number, unit, time };
  }

  async load() {
    const UPlot = await loadUPlot();
    if (!UPlot) {
      this.area.append(make('p', { class: 'notice', text: MISSING }));
      return;
    }
    this.quantities.forEach((quantity, i) => {
      const showsTime = quantity.showsTime ?? i === this.quantities.length - 1;
      this.plots.push(new UPlot(this.options(quantity, i, showsTime), this.dataOf(i), this.rows[i].holder));
    });
    new ResizeObserver(() => this.fit()).observe(this.area);
    onThemeChange(() => this.plots.forEach((plot) => plot.redraw(false)));
    this.fit();
  }

  /**
   * @param {Quantity} quantity
   * @param {number} index
   * @param {boolean} showsTime
   * @returns {import('uplot').Options}
   */
  options(quantity, index, showsTime) {
    const rem = remPx();
    const { range, values } = honestScale((low, high) => roomyRange(low, high, quantity.least));
    return {
      width: 300,
      height: 100,
      legend: { show: false },
      // Half a line of air on top, or the uppermost mark is cut.
      padding: [rem * 0.5, rem * 1.75, showsTime ? 0 : 4, 0],
      cursor: {
        sync: { key: 'live', scales: ['x', null] },
        drag: { x: false, y: false },
        points: { size: 7 },
      },
      scales: {
        x: { time: false, range: () => [this.rightS - this.windowS, this.rightS] },
        y: { dir: quantity.down ? -1 : 1, range },
      },
      series: [
        {},
        {
          stroke: () => colors(quantity.color)[0],
          width: (1.75 * rem) / 16,
          points: { show: false },
          spanGaps: false,
        },
      ],
      axes: [
        {
          ...axisColors,
          font: plotFont(),
          size: showsTime ? rem * 1.6 : 0,
          splits: (plot, _, from, to) => timeSplits(from, to, this.model.unixAt(0), plot.width / (rem * 5.5)),
          values: (_, splits) =>
            showsTime ? splits.map((s) => clockTime(this.model.unixAt(s * 1000))) : splits.map(() => ''),
        },
        {
          ...axisColors,
          font: plotFont(),
          size: rem * 3.6,
          space: rem * 1.5,
          incrs: NICE_STEPS,
          values,
        },
      ],
      hooks: { setCursor: [(plot) => this.showAtCursor(plot, index)] },
    };
  }

  /**
   * @param {number} i
   * @returns {import('uplot').AlignedData}
   */
  dataOf(i) {
    return [this.times, this.columns[i]];
  }

  fit() {
    for (let i = 0; i < this.plots.length; i += 1) {
      const { clientWidth, clientHeight } = this.rows[i].holder;
      const plot = this.plots[i];
      if (clientWidth > 0 && (plot.width !== clientWidth || plot.height !== clientHeight)) {
        plot.setSize({ width: clientWidth, height: clientHeight });
      }
    }
  }

  /** @param {number} nowS */
  draw(nowS) {
    this.rightS = this.pausedAtS ?? nowS;
    // In the longer windows a pixel is half a second or more: once a second is as smooth as it gets.
    const step = this.windowS <= 60 ? 0.25 : 1;
    const key = `${Math.floor(this.rightS / step)} ${this.windowS} ${this.history.newestS} ${this.plots.length}`;
    if (key === this.drawnKey || this.area.clientWidth === 0) return;
    this.drawnKey = key;
    this.copySpan();
    this.plots.forEach((plot, i) => {
      plot.setData(this.dataOf(i));
      if (plot.cursor.idx === null || plot.cursor.idx === undefined) this.showNewest(i);
      else this.showAtCursor(plot, i);
    });
  }

  /** What is seen, in the units wanted. */
  copySpan() {
    this.history.copySpan(this.rightS - this.windowS, this.rightS, this.times, this.columns);
    this.quantities.forEach(({ unit }, i) => {
      setText(this.rows[i].unit, shownUnit(unit));
      if (shownUnit(unit) === unit) return;
      const column = this.columns[i];
      for (let k = 0; k < column.length; k += 1) column[k] = shownValue(column[k], unit);
    });
  }

  /**
   * Greys out the newest values once they are old; a value under the cursor is dated anyway.
   * @param {boolean} stale
   */
  setStale(stale) {
    this.area.classList.toggle('old', stale);
  }

  /** @param {number} i */
  showNewest(i) {
    const column = this.columns[i];
    const value = column.length > 0 ? column[column.length - 1] : null;
    setText(this.rows[i].number, fixed(value, this.quantities[i].decimals));
    setText(this.rows[i].time, '');
  }

  /**
   * @param {UPlot} plot
   * @param {number} i
   */
  showAtCursor(plot, i) {
    const at = plot.cursor.idx;
    if (at === null || at === undefined) {
      this.showNewest(i);
      return;
    }
    setText(this.rows[i].number, fixed(this.columns[i][at], this.quantities[i].decimals));
    setText(this.rows[i].time, `at ${clockTime(this.model.unixAt(this.times[at] * 1000))}`);
  }

  /** @param {number} minutes */
  chooseWindow(minutes) {
    this.windowS = minutes * 60;
    WINDOWS_MIN.forEach((m, i) =>
      this.windowButtons?.[i].setAttribute('aria-pressed', String(m === minutes)),
    );
    this.draw(performance.now() / 1000);
  }

  /** @param {boolean} paused */
  setPaused(paused) {
    this.pausedAtS = paused ? this.rightS : null;
    this.pause?.setAttribute('aria-pressed', String(paused));
    if (this.pause) setText(this.pause, paused ? 'Paused' : 'Pause');
    this.draw(performance.now() / 1000);
  }

  saveCsv() {
    const shown = this.quantities.map((quantity) => ({ ...quantity, unit: shownUnit(quantity.unit) }));
    const text = csvOfSpan(shown, this.times, this.columns, (s) => this.model.unixAt(s * 1000));
    saveBlob(
      new Blob([text], { type: 'text/csv' }),
      `bluerov-slam-${fileStamp(this.model.unixAt(this.rightS * 1000))}.csv`,
    );
  }

  async savePng() {
    const right = this.model.unixAt(this.rightS * 1000);
    const titles = this.quantities.map((quantity) => `${quantity.label} (${shownUnit(quantity.unit)})`);
    const title = `BlueROV SLAM, ${dateTime(right - this.windowS)} to ${clockTime(right)}`;
    const blob = await pngOfPlots(this.plots, titles, title);
    if (blob) saveBlob(blob, `bluerov-slam-${fileStamp(right)}.png`);
  }
}

const NICE_STEPS = [-3, -2, -1, 0, 1, 2, 3, 4].flatMap((power) =>
  [1, 2, 5].map((digit) => digit * 10 ** power),
);

/**
 * A range with air around the data, and never so narrow that noise looks like an event.
 * @param {number | null} low
 * @param {number | null} high
 * @param {number} least
 * @returns {[number | null, number | null]}  nulls without data: no scale is better than an invented one
 */
export function roomyRange(low, high, least) {
  if (low === null || high === null || !Number.isFinite(low) || !Number.isFinite(high)) return [null, null];
  const air = Math.max((high - low) * 0.08, (least - (high - low)) / 2, Math.abs(high) * 1e-9);
  return [low - air, high + air];
}
