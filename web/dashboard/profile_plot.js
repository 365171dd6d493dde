// @ts-check
// Temperature and sound speed against depth, depth pointing down, from the dive so far.

import { make, setText } from '../shared/dom.js';
import { shownUnit, shownValue } from '../shared/display.js';
import { isKnown } from '../shared/format.js';
import { colors, onThemeChange } from '../shared/theme.js';
import { MISSING, axisColors, honestScale, loadUPlot, plotFont, remPx } from './uplot.js';
import { roomyRange } from './time_plots.js';

const SHORTEST_MS = 1000;

/**
 * From the surface to just below the deepest layer; no scale without data.
 * @param {number | null} deepestM
 * @returns {[number | null, number | null]}
 */
function depthRange(deepestM) {
  return deepestM === null ? [null, null] : [0, Math.max(1, deepestM * 1.05)];
}

/**
 * Layers without a neighbour.
 * @param {import('uplot')} plot
 * @param {number} series
 */
export function aloneInWater(plot, series) {
  const values = plot.data[series];
  const alone = [];
  for (let i = 0; i < values.length; i += 1) {
    if (isKnown(values[i]) && !isKnown(values[i - 1]) && !isKnown(values[i + 1])) alone.push(i);
  }
  return alone;
}

export class ProfilePlot {
  /**
   * @param {import('./card.js').Card} card
   * @param {import('./depth_profile.js').DepthProfile} profile
   */
  constructor(card, profile) {
    this.profile = profile;
    this.holder = make('div', { class: 'plot' });
    this.temperatureUnit = make('span');
    this.soundUnit = make('span');
    this.depthHint = make('p', { class: 'hint' });
    const key = (/** @type {string} */ plot, /** @type {string} */ text, /** @type {Node} */ unit) =>
      make('span', {}, make('span', { class: 'swatch', dataset: { plot } }), ` ${text} `, unit);
    card.add(
      make(
        'p',
        { class: 'profile-key' },
        key('temperature', 'Temperature', this.temperatureUnit),
        key('soundSpeed', 'Sound speed', this.soundUnit),
      ),
      this.holder,
      this.depthHint,
    );
    this.drawnVersion = -1;
    this.drawnAtMs = -Infinity;
    /** @type {import('uplot') | null} */
    this.plot = null;
    void this.load();
  }

  async load() {
    const UPlot = await loadUPlot();
    if (!UPlot) {
      this.holder.append(make('p', { class: 'notice', text: MISSING }));
      return;
    }
    this.plot = new UPlot(this.options(), this.rows(), this.holder);
    new ResizeObserver(() => this.fit()).observe(this.holder);
    onThemeChange(() => this.plot?.redraw(false));
    this.fit();
  }

  /** @returns {import('uplot').Options} */
  options() {
    const rem = remPx();
    const line = (/** @type {string} */ scale, /** @type {string} */ color, /** @type {number} */ point) => ({
      scale,
      stroke: () => colors(color)[0],
      width: (2 * rem) / 16,
      // A layer alone between unmeasured water is no line: it is seen as a point.
      points: { show: true, size: rem * point, fill: () => colors(color)[0], filter: aloneInWater },
      spanGaps: false,
    });
    const depth = honestScale((_, deepest) => depthRange(deepest));
    const temperature = honestScale((low, high) => roomyRange(low, high, 0.5));
    const sound = honestScale((low, high) => roomyRange(low, high, 2));
    return {
      width: 200,
      height: 300,
      legend: { show: false },
      padding: [4, rem * 0.75, 4, 0],
      cursor: { drag: { x: false, y: false } },
      scales: {
        x: { time: false, ori: 1, dir: -1, range: depth.range },
        t: { ori: 0, dir: 1, range: temperature.range },
        c: { ori: 0, dir: 1, range: sound.range },
      },
      // Where both lie on one spot, the larger point below is seen around the smaller one.
      series: [{}, line('t', '--plot-temperature', 0.45), line('c', '--plot-sound', 0.25)],
      axes: [
        {
          ...axisColors,
          values: depth.values,
          scale: 'x',
          side: 3,
          font: plotFont(),
          size: rem * 2.6,
          space: rem * 2.75,
        },
        {
          ...axisColors,
          values: temperature.values,
          scale: 't',
          side: 2,
          font: plotFont(),
          size: rem * 1.7,
          space: rem * 2.9,
          stroke: () => colors('--plot-temperature')[0],
        },
        {
          ...axisColors,
          values: sound.values,
          scale: 'c',
          side: 0,
          font: plotFont(),
          size: rem * 1.7,
          space: rem * 3.5,
          grid: { show: false },
          stroke: () => colors('--plot-sound')[0],
        },
      ],
    };
  }

  /** @returns {import('uplot').AlignedData} */
  rows() {
    const [depth, temperature, soundSpeed] = this.profile.rows();
    const as = (/** @type {string} */ unit) => (/** @type {number | null} */ value) =>
      shownValue(value, unit);
    setText(this.depthHint, `Depth in ${shownUnit('m')}; means by layers of 0.25 m`);
    setText(this.temperatureUnit, shownUnit('\u00b0C'));
    setText(this.soundUnit, shownUnit('m/s'));
    return [
      depth.map((value) => shownValue(value, 'm')),
      temperature.map(as('\u00b0C')),
      soundSpeed.map(as('m/s')),
    ];
  }

  fit() {
    const { clientWidth, clientHeight } = this.holder;
    if (this.plot && clientWidth > 0) this.plot.setSize({ width: clientWidth, height: clientHeight });
  }

  draw() {
    const nowMs = performance.now();
    if (!this.plot || this.profile.version === this.drawnVersion || nowMs - this.drawnAtMs < SHORTEST_MS)
      return;
    if (this.holder.clientWidth === 0) return;
    this.drawnVersion = this.profile.version;
    this.drawnAtMs = nowMs;
    this.plot.setData(this.rows());
  }
}
