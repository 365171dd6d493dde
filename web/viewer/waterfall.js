// @ts-check
/**
 * The waterfall: rings, view, levels and a renderer, drawn at most once per animation frame and only after a change.
 * Newest on top. Coordinates named x, y are device pixels of the picture canvas.
 */

import { CanvasPicture } from './canvas_picture.js';
import { GlPicture } from './gl_picture.js';
import { Levels } from './levels.js';
import { paletteTable } from './palettes.js';
import { PingRing } from './ping_ring.js';
import { panesOf, rangeAtX, xAtRange } from './ranging.js';
import { NOTHING, evenScale, fillRowTable } from './row_table.js';

/** @typedef {import('./decoding.js').Channel} Channel */
/** @typedef {import('./ranging.js').Pane} Pane */
/** @typedef {import('./ranging.js').Layout} Layout */

/**
 * @typedef {object} View
 * @property {Layout} layout
 * @property {boolean} live the newest ping stays on top
 * @property {number} topS monotonic time at the upper edge while not live
 * @property {number} secondsPerPixel wished, per CSS pixel
 * @property {number} fromM
 * @property {number | null} toM null follows the sonar's range
 * @property {boolean} swapped port on the right
 */

/** @typedef {{slot: number, ring: PingRing, channel: Channel, rangeM: number, timeS: number}} Place */

/** Rows per ring; small memories get fewer. 4096 rows are 7 minutes at 10 Hz. */
const ROWS = 4096;
const ROWS_ON_SMALL_MACHINES = 2048;
const SMALL_MACHINE_GB = 2;
const LEVELS_EVERY_MS = 400;
export const SHORTEST_SPAN_M = 1;
const SECONDS_PER_PIXEL_LIMITS = [0.002, 2];
const UNKNOWN_RANGE_M = 30;
/** Scrolled back to the end, the oldest ping lies this far below the upper edge. */
const OLDEST_SHARE = 0.2;
/** A ping period that differs by more than this share is another one. */
const PERIOD_CHANGE = 0.08;

export class Waterfall {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {{view: Partial<View>, gain: object, palette: string, inverted: boolean}} stored
   */
  constructor(canvas, stored) {
    this.canvas = canvas;
    const memoryGb = /** @type {any} */ (navigator).deviceMemory ?? 8;
    const capacity = memoryGb <= SMALL_MACHINE_GB ? ROWS_ON_SMALL_MACHINES : ROWS;
    /** Layers: live A, live B, scroll-back A, scroll-back B. */
    this.rings = [0, 1, 2, 3].map(() => new PingRing(capacity));
    /** @type {View} */
    this.view = {
      layout: 'side',
      live: true,
      topS: NaN,
      secondsPerPixel: 0.06,
      fromM: 0,
      toM: null,
      swapped: false,
      ...stored.view,
    };
    this.levels = new Levels(stored.gain);
    this.palette = stored.palette;
    this.inverted = stored.inverted;
    this.table = paletteTable(this.palette, this.inverted);
    /** @type {Pane[]} */
    this.panes = [];
    this.rowTables = [new Int16Array(2), new Int16Array(2)];
    this.secondsPerRow = 0.06;
    this.evenWish = NaN;
    this.evenPeriodS = NaN;
    this.topRow = 0;
    this.farthestM = NaN;
    /** @type {import('./picture_state.js').PictureState} */
    this.state = {
      gain: this.levels.gain,
      fromM: 0,
      toM: UNKNOWN_RANGE_M,
      tvgMaximumM: UNKNOWN_RANGE_M,
      nothingRgb: new Float32Array(3),
      hatchRgb: new Float32Array(3),
      dpr: 1,
    };
    /** Draws the axes after each picture. @type {() => void} */
    this.onDrawn = () => {};
    /** Called when the levels or the histogram were measured. @type {() => void} */
    this.onLevels = () => {};
    this.frameWanted = false;
    this.step = () => this.frame();
    this.levelsAtMs = -Infinity;
    this.levelsTimer = 0;
    this.frames = 0;
    this.picture =
      GlPicture.create(canvas, this.rings, () => this.refreshTables()) ??
      new CanvasPicture(canvas, this.rings);
    this.refreshTables();
  }

  /** @param {Channel} channel @returns {PingRing[]} live, scroll-back */
  ringsOf(channel) {
    return channel === 'A' ? [this.rings[0], this.rings[2]] : [this.rings[1], this.rings[3]];
  }

  /** @param {Channel} channel */
  live(channel) {
    return this.rings[channel === 'A' ? 0 : 1];
  }

  /** @param {Channel} channel */
  back(channel) {
    return this.rings[channel === 'A' ? 2 : 3];
  }

  /** Time of the newest ping, NaN without one. */
  get newestS() {
    const a = this.rings[0].newestS;
    const b = this.rings[1].newestS;
    return a >= b || Number.isNaN(b) ? a : b;
  }

  get hasData() {
    return this.rings[0].length > 0 || this.rings[1].length > 0;
  }

  get topS() {
    return this.topRow * this.secondsPerRow;
  }

  /** Seconds that one pane shows. */
  get windowS() {
    return (this.panes.length ? this.panes[0].height : 1) * this.secondsPerRow;
  }

  /** Ask for a frame; more calls before it cost nothing. */
  invalidate() {
    if (this.frameWanted) return;
    this.frameWanted = true;
    requestAnimationFrame(this.step);
  }

  /** @param {number} width @param {number} height @param {number} dpr */
  resize(width, height, dpr) {
    this.canvas.width = Math.max(2, width);
    this.canvas.height = Math.max(2, height);
    this.state.dpr = dpr;
    this.rowTables = [0, 1].map(() => new Int16Array(2 * this.canvas.height));
    this.layOut();
    // At once: a canvas that was resized is blank until it is drawn.
    this.draw();
  }

  layOut() {
    this.panes = panesOf(this.view.layout, this.canvas.width, this.canvas.height, this.view.swapped);
    this.invalidate();
  }

  /** @param {string} palette @param {boolean} inverted */
  setPalette(palette, inverted) {
    this.palette = palette;
    this.inverted = inverted;
    this.table = paletteTable(palette, inverted);
    this.picture.setPalette(this.table);
    this.invalidate();
  }

  /** @param {Float32Array} nothing @param {Float32Array} hatch 0..1 */
  setColors(nothing, hatch) {
    this.state.nothingRgb = nothing;
    this.state.hatchRgb = hatch;
    this.invalidate();
  }

  refreshTables() {
    this.picture.setPalette(this.table);
    for (const channel of [0, 1]) this.picture.setTvg(channel, this.levels.tvg[channel]);
    this.invalidate();
  }

  frame() {
    this.frameWanted = false;
    this.draw();
  }

  draw() {
    if (!this.panes.length) return;
    this.frames += 1;
    this.updateScale();
    for (let channel = 0; channel < 2; channel++) this.updateRows(channel);
    this.picture.draw(this.panes, this.rowTables, this.topRow, this.state);
    this.onDrawn();
    this.wantLevels();
  }

  updateScale() {
    const { view, state } = this;
    this.evenOut(view.secondsPerPixel / state.dpr);
    const newest = this.newestS;
    if (Number.isFinite(newest)) {
      const top = view.live ? newest : view.topS;
      this.topRow = Math.ceil(top / this.secondsPerRow - 1e-6);
    }
    this.updateRange();
  }

  /**
   * A whole number of rows for every ping. A period that merely jitters must not rescale the picture, and a paused
   * picture is not rescaled by what comes meanwhile.
   * @param {number} wished seconds per row
   */
  evenOut(wished) {
    const period = Math.min(this.rings[0].currentPeriodS, this.rings[1].currentPeriodS);
    const changed = Math.abs(period / this.evenPeriodS - 1) > PERIOD_CHANGE;
    if (wished === this.evenWish && !(changed && this.view.live)) return;
    this.evenWish = this.hasData ? wished : NaN;
    this.evenPeriodS = period;
    this.secondsPerRow = evenScale(wished, period);
  }

  updateRange() {
    const a = this.rings[0].recentRangeM;
    const b = this.rings[1].recentRangeM;
    const farthest = a >= b || Number.isNaN(b) ? a : b;
    if (Number.isFinite(farthest)) this.farthestM = farthest;
    const maximum = Number.isFinite(this.farthestM) ? this.farthestM : UNKNOWN_RANGE_M;
    this.levels.tvgMaximumM = maximum;
    this.state.tvgMaximumM = maximum;
    this.state.fromM = this.view.fromM;
    this.state.toM = Math.max(this.view.toM ?? maximum, this.view.fromM + SHORTEST_SPAN_M);
  }

  /** @param {number} channel */
  updateRows(channel) {
    const table = this.rowTables[channel];
    const rows = Math.min(table.length / 2, this.panes[0].height + 1);
    fillRowTable(table, rows, this.rings[channel], channel, this.topRow, this.secondsPerRow, false);
    const back = this.rings[channel + 2];
    if (back.length) fillRowTable(table, rows, back, channel + 2, this.topRow, this.secondsPerRow, true);
  }

  wantLevels() {
    if (this.levelsTimer) return;
    const wait = Math.max(0, this.levelsAtMs + LEVELS_EVERY_MS - performance.now());
    this.levelsTimer = window.setTimeout(() => this.measureLevels(), wait);
  }

  measureLevels() {
    this.levelsTimer = 0;
    this.levelsAtMs = performance.now();
    const shown = this.panes.map((pane) => ({
      channel: pane.channel === 'A' ? 0 : 1,
      rings: this.ringsOf(pane.channel),
    }));
    const changed = this.levels.measure(shown, this.topS - this.windowS, this.topS);
    if (changed) this.refreshTables();
    this.onLevels();
  }

  /** Gain settings changed by hand. @param {boolean} remeasure the time-varied gain changed */
  gainChanged(remeasure) {
    if (remeasure) {
      this.levels.restart();
      window.clearTimeout(this.levelsTimer);
      this.measureLevels();
      this.refreshTables();
    }
    this.onLevels();
    this.invalidate();
  }

  /* Moving through time and range */

  pause() {
    if (!this.view.live || !this.hasData) return;
    this.view.topS = this.topS;
    this.view.live = false;
    this.invalidate();
  }

  goLive() {
    this.view.live = true;
    this.invalidate();
  }

  /**
   * @param {number} seconds positive to older pings
   * @param {number} oldestS nothing is older than this
   */
  scroll(seconds, oldestS) {
    if (!this.hasData || (this.view.live && seconds <= 0)) return;
    this.showTop((this.view.live ? this.topS : this.view.topS) - seconds, oldestS);
  }

  /** @param {number} topS @param {number} oldestS */
  showTop(topS, oldestS) {
    if (!this.hasData) return;
    // Asked for what is newer than the newest: live. Scrolled to the end of a short dive is not that.
    this.view.live = topS >= this.newestS;
    this.view.topS = Math.max(topS, Math.min(oldestS + this.windowS * OLDEST_SHARE, this.newestS));
    this.invalidate();
  }

  /**
   * @param {number} factor above 1 shows more seconds
   * @param {number} y stays where it is while not live
   */
  zoomTime(factor, y) {
    const [least, most] = SECONDS_PER_PIXEL_LIMITS;
    const longest =
      (this.rings[0].capacity * 0.9 * this.live('A').currentPeriodS * this.state.dpr) / this.canvas.height;
    const before = this.secondsPerRow;
    const wished = this.view.secondsPerPixel * factor;
    this.view.secondsPerPixel = Math.min(Math.max(wished, least), Math.min(most, Math.max(longest, 0.02)));
    this.updateScale();
    if (!this.view.live) this.view.topS += (y - this.panes[0].y) * (this.secondsPerRow - before);
    this.invalidate();
  }

  /**
   * @param {number} factor above 1 shows more metres
   * @param {number} aboutM stays where it is
   */
  zoomRange(factor, aboutM) {
    const { fromM, toM } = this.state;
    const maximum = Number.isFinite(this.farthestM) ? this.farthestM : UNKNOWN_RANGE_M;
    const span = Math.min(Math.max((toM - fromM) * factor, SHORTEST_SPAN_M), maximum);
    this.showRange(aboutM - ((aboutM - fromM) / (toM - fromM)) * span, span);
  }

  /** @param {number} fromM @param {number} spanM */
  showRange(fromM, spanM) {
    const maximum = Number.isFinite(this.farthestM) ? this.farthestM : UNKNOWN_RANGE_M;
    const from = Math.min(Math.max(0, fromM), Math.max(0, maximum - spanM));
    this.view.fromM = from;
    this.view.toM = from === 0 && spanM >= maximum * 0.999 ? null : from + spanM;
    this.invalidate();
  }

  /* Between pixels and the water */

  /** @param {Pane} pane @param {number} y */
  timeAtY(pane, y) {
    return this.topS - (y - pane.y) * this.secondsPerRow;
  }

  /** @param {Pane} pane @param {number} timeS */
  yAtTime(pane, timeS) {
    return pane.y + (this.topS - timeS) / this.secondsPerRow;
  }

  /** @param {Pane} pane @param {number} x */
  rangeAt(pane, x) {
    return rangeAtX(pane, x, this.state.fromM, this.state.toM);
  }

  /** @param {Pane} pane @param {number} rangeM */
  xAt(pane, rangeM) {
    return xAtRange(pane, rangeM, this.state.fromM, this.state.toM);
  }

  /**
   * The ping shown at a place, or why there is none.
   * @param {Pane} pane
   * @param {number} y
   * @returns {{ring: PingRing, slot: number} | number} NOTHING or LOST
   */
  pingAt(pane, y) {
    const table = this.rowTables[pane.channel === 'A' ? 0 : 1];
    const row = Math.floor(y - pane.y);
    const code = row >= 0 && row < pane.height ? table[2 * row] : NOTHING;
    if (code < 0) return code;
    const ring = this.rings[Math.floor(code / this.rings[0].capacity)];
    const slot = ((code % ring.capacity) + table[2 * row + 1] - 1) % ring.capacity;
    return { ring, slot };
  }
}
