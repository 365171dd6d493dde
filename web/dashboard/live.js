// @ts-check
// The live page: instruments, values, plots.

import { make, setAttribute, setNumber, setText } from '../shared/dom.js';
import { shownUnit, shownValue } from '../shared/display.js';
import { fixed, isKnown, signed } from '../shared/format.js';
import { AcousticsCard, pulseAge } from './acoustics_card.js';
import { Attitude } from './attitude.js';
import { Compass } from './compass.js';
import { DepthGauge } from './depth_gauge.js';
import { DepthProfile } from './depth_profile.js';
import { DepthRate } from './depth_rate.js';
import { fixWord } from './fields.js';
import { History } from './history.js';
import {
  GPS_CELLS,
  LINK_ITEMS,
  SCIENCE_CELLS,
  SONAR_ROWS,
  cards,
  cellList,
  degrees,
  headingTexts,
  hero,
  instrumentCanvas,
  sonarTable,
  statusCells,
} from './live_layout.js';
import { MapCard } from './map_card.js';
import { STALE_S, ageS } from './model.js';
import { NavigationCard } from './navigation_card.js';
import { ProfilePlot } from './profile_plot.js';
import { MOTION, QUANTITIES, TimePlots } from './time_plots.js';
import { ValueCell } from './value_cell.js';

/** @typedef {import('./model.js').Model} Model */

export class LivePage {
  /**
   * @param {HTMLElement} root
   * @param {Model} model
   */
  constructor(root, model) {
    this.model = model;
    this.cards = cards();
    this.history = new History(QUANTITIES.map((quantity) => quantity.key));
    this.profile = new DepthProfile();
    this.rate = new DepthRate();
    this.row = new Array(QUANTITIES.length);
    /** @type {(() => void) | null} what waits for the first sample */
    this.beforeFirst = null;
    this.cells = [new ValueCell('roll', (v) => degrees(v)), new ValueCell('pitch', (v) => degrees(v))];
    this.buildInstruments();
    this.buildPanels();
    this.plots = new TimePlots(this.cards.plots, this.history, model, QUANTITIES);
    this.motionHistory = new History(MOTION.map((quantity) => quantity.key));
    this.motion = new TimePlots(this.cards.motion, this.motionHistory, model, MOTION);
    this.map = new MapCard(this.cards.map, model, (track) => this.fillMotion(track));
    this.navigation = new NavigationCard(this.cards.navigation);
    this.acoustics = new AcousticsCard(this.cards.acoustics);
    this.profilePlot = new ProfilePlot(this.cards.profile, this.profile);
    const { attitude, heading, depth, map, motion, navigation, acoustics, plots, profile } = this.cards;
    const { ctd, gps, sonars, link } = this.cards;
    root.append(
      make('div', { class: 'live-left' }, depth.root, attitude.root, heading.root),
      make('div', { class: 'live-centre' }, map.root, motion.root, plots.root, profile.root),
      make(
        'div',
        { class: 'live-right' },
        navigation.root,
        acoustics.root,
        ctd.root,
        gps.root,
        sonars.root,
        link.root,
      ),
    );
  }

  buildInstruments() {
    const horizon = instrumentCanvas('Artificial horizon');
    this.attitude = new Attitude(horizon);
    this.cards.attitude.add(horizon, cellList(...this.cells));
    const card = instrumentCanvas('Compass');
    this.compass = new Compass(card);
    this.heading = hero('\u00b0', 3);
    this.point = make('span', { class: 'point' });
    this.cards.heading.head.insertBefore(
      make('span', { class: 'hint', text: 'magnetic' }),
      this.cards.heading.ageText,
    );
    this.cards.heading.add(
      make(
        'div',
        { class: 'dial' },
        card,
        make('div', { class: 'dial-middle' }, this.heading.root, this.point),
      ),
    );
    const column = instrumentCanvas('Depth gauge');
    this.gauge = new DepthGauge(column);
    this.depth = hero('m', 3.45);
    this.rateNumber = make('span', { class: 'number none', text: '-' });
    this.rateWord = make('span', { class: 'rate-word' });
    this.deepest = make('span', { class: 'number none', text: '-' });
    this.rateNumber.style.minWidth = '4.75ch';
    this.deepest.style.minWidth = '3.45ch';
    const small = (/** @type {string} */ label, /** @type {Node[]} */ ...nodes) =>
      make('div', { class: 'cell' }, make('dt', { text: label }), make('dd', {}, ...nodes));
    this.rateUnit = make('span', { class: 'unit', text: 'm/s' });
    this.deepestUnit = make('span', { class: 'unit', text: 'm' });
    this.cards.depth.add(
      make(
        'div',
        { class: 'depth' },
        column,
        make(
          'div',
          { class: 'depth-texts' },
          this.depth.root,
          make(
            'dl',
            {},
            small('Rate, est.', this.rateNumber, this.rateUnit, this.rateWord),
            small('Deepest', this.deepest, this.deepestUnit),
          ),
        ),
      ),
    );
  }

  buildPanels() {
    const science = SCIENCE_CELLS();
    const gps = GPS_CELLS();
    this.cells.push(...science, ...gps);
    this.cards.ctd.add(cellList(...science));
    this.fix = make('span', { class: 'fix', dataset: { fix: 'unknown' }, text: 'Unknown' });
    this.cards.gps.head.insertBefore(this.fix, this.cards.gps.ageText);
    this.cards.gps.add(cellList(...gps));
    const { table, cells, units } = sonarTable();
    this.sonarUnits = units;
    this.sonarCells = cells;
    this.cards.sonars.add(table);
    this.linkCells = statusCells();
    this.loadNumber = make('span', { class: 'number', text: '-' });
    this.load = make('meter', { min: 0, max: 100, high: 90, 'aria-label': 'Load of the serial link' });
    this.port = make('p', { class: 'hint port' });
    this.cards.link.add(
      make(
        'p',
        { class: 'load' },
        make('span', { text: 'Load' }),
        this.load,
        this.loadNumber,
        make('span', { text: '%' }),
      ),
      this.linkCells.root,
      this.port,
    );
  }

  /** @param {number} nowMs */
  onSensors(nowMs) {
    const { model } = this;
    this.beforeFirst?.();
    this.beforeFirst = null;
    const value = (/** @type {string} */ key) => model.reading(key).value;
    this.rate.add(model.sensors?.ts, value('depth'));
    this.profile.add(value('depth'), value('temperature'), value('soundSpeed'));
    QUANTITIES.forEach((quantity, i) => (this.row[i] = value(quantity.key)));
    this.history.append(nowMs / 1000, this.row);
    this.attitude?.show(value('roll'), value('pitch'));
    this.compass?.show(value('heading'));
    this.gauge?.show(value('depth'));
    this.showTexts();
    this.refresh(nowMs);
  }

  /** @param {number} nowMs */
  onNavigation(nowMs) {
    const state = this.model.navigation;
    if (!state) return;
    const { speed_mps: speed } = state.velocity ?? {};
    const radius = state.ellipse?.major_m;
    this.motionHistory.append(nowMs / 1000, [isKnown(speed) ? speed : null, isKnown(radius) ? radius : null]);
    this.map.onNavigation(nowMs);
    this.navigation.show(state);
    this.compass?.showEstimate(state.attitude?.heading_deg ?? null, state.std?.heading_deg ?? null);
  }

  /** @param {number} nowMs */
  onAcoustics(nowMs) {
    const data = this.model.acoustics;
    if (!data) return;
    this.acoustics.show(data);
    this.map.onAcoustics(data);
    this.refreshAcoustics(nowMs);
  }

  /** @param {number} nowMs */
  refreshAcoustics(nowMs) {
    const { model, cards: all } = this;
    const data = model.acoustics;
    const oldS = ageS(model.acousticsAtMs, nowMs);
    if (data && oldS !== null && oldS > STALE_S) this.acoustics.show(data, oldS);
    // Pulses come once a second: two of them may be missed before a value is old.
    const seconds = data?.enabled === true ? pulseAge(data, oldS) : null;
    all.acoustics.update(model.status, seconds === null ? null : Math.max(0, seconds - 1.5));
  }

  /**
   * Speed and uncertainty of before this page was opened.
   * @param {import('./track.js').Track} track
   */
  fillMotion(track) {
    /** @type {Array<[number, (number | null)[]]>} */
    const rows = [];
    const offsetS = this.model.unixAt(0);
    const known = (/** @type {number} */ value) => (Number.isNaN(value) ? null : value);
    for (let i = 0; i < track.length; i += 1)
      rows.push([track.timeS[i] - offsetS, [known(track.speedMps[i]), known(track.majorM[i])]]);
    this.motionHistory.prepend(rows);
  }

  showTexts() {
    const { model, heading, point, depth, rateNumber, rateWord, deepest, fix } = this;
    if (!heading || !point || !depth || !rateNumber || !rateWord || !deepest || !fix) return;
    const texts = headingTexts(model.reading('heading').value);
    setNumber(heading.number, texts.degrees);
    setText(point, texts.point);
    setNumber(depth.number, fixed(shownValue(model.reading('depth').value, 'm'), 2));
    const rate = this.rate.mps();
    this.showUnits();
    setNumber(rateNumber, signed(shownValue(rate, 'm/s'), 2));
    setText(
      rateWord,
      rate === null || Math.abs(rate) < 0.03 ? '' : rate > 0 ? '\u25bc sinking' : '\u25b2 rising',
    );
    setNumber(deepest, fixed(shownValue(this.gauge?.deepestM, 'm'), 2));
    // It may be deeper by now, unseen.
    deepest.classList.toggle('old', model.reading('depth').value === null);
    const word = fixWord(model.sensors, model.extra);
    setText(fix, word);
    setAttribute(fix, 'data-fix', word === 'No fix' ? 'none' : word.endsWith('ix') ? 'yes' : 'unknown');
  }

  showUnits() {
    if (this.depth) setText(this.depth.unit, shownUnit('m'));
    if (this.rateUnit) setText(this.rateUnit, shownUnit('m/s'));
    if (this.deepestUnit) setText(this.deepestUnit, shownUnit('m'));
  }

  onStatus() {
    const status = this.model.status ?? {};
    LINK_ITEMS.forEach((item, i) => this.linkCells && setText(this.linkCells.numbers[i], item.text(status)));
    SONAR_ROWS.forEach(([, unit, text], row) => {
      if (this.sonarUnits) setText(this.sonarUnits[row], shownUnit(unit));
      const cells = this.sonarCells?.[row];
      if (!cells) return;
      setText(cells[0], text(status.sonars?.A ?? {}));
      setText(cells[1], text(status.sonars?.B ?? {}));
    });
    const load = status.link?.load_percent;
    if (this.loadNumber) setText(this.loadNumber, fixed(load, 0));
    if (this.load) this.load.value = isKnown(load) ? load : 0;
    const port = status.link?.by_id || status.link?.port;
    if (this.port)
      setText(
        this.port,
        port ? `${port}${isKnown(status.link?.baud) ? `, ${status.link.baud} baud` : ''}` : '-',
      );
  }

  /**
   * Ages, health, and plots that move on: a few times a second.
   * @param {number} nowMs
   */
  refresh(nowMs) {
    const { model, cards: all } = this;
    for (const cell of this.cells) cell.update(model, nowMs);
    const sensors = ageS(model.sensorsAtMs, nowMs);
    const status = ageS(model.statusAtMs, nowMs);
    const since = (/** @type {string} */ key) => ageS(model.reading(key).atMs, nowMs);
    all.attitude.update(model.status, since('roll'));
    all.heading.update(model.status, since('heading'));
    all.depth.update(model.status, since('depth'));
    all.ctd.update(model.status, since('temperature') ?? since('conductivity'));
    all.gps.update(model.status, since('satellites'));
    const estimate = ageS(model.navigationAtMs, nowMs);
    for (const card of [all.map, all.motion, all.navigation]) card.update(model.status, estimate);
    this.motion.setStale(estimate !== null && estimate > STALE_S);
    if (estimate !== null && estimate > STALE_S) this.compass?.showEstimate(null, null);
    this.map.refresh(nowMs);
    all.plots.update(model.status, sensors);
    this.plots.setStale(sensors !== null && sensors > STALE_S);
    all.profile.update(model.status, sensors);
    this.refreshAcoustics(nowMs);
    all.sonars.update(model.status, status);
    all.link.update(model.status, status);
  }

  /**
   * The waterfall has its own port; the path of this page may be a proxy's.
   * @param {unknown} port
   */
  linkViewer(port) {
    if (!Number.isInteger(port)) return;
    const { head, ageText } = this.cards.sonars;
    const link = make('a', {
      class: 'button waterfall-link',
      href: `http://${location.hostname}:${port}/`,
      target: '_blank',
      rel: 'noopener',
      text: 'Waterfall \u2197',
      title: 'The sonar viewer, in another tab',
    });
    head.insertBefore(link, ageText);
  }

  /** The tab was chosen: what was hidden has a size now. */
  show() {
    this.map.show();
    this.plots.fit();
    this.motion.fit();
    this.profilePlot.fit();
    this.draw(performance.now());
  }

  /** @param {number} nowMs */
  draw(nowMs) {
    this.plots.draw(nowMs / 1000);
    this.motion.draw(nowMs / 1000);
    this.profilePlot.draw();
  }
}
