// @ts-check
// The part of the map that seldom changes: metric grid, track, fixes, origin. It is drawn whole when the view moves;
// a new point or fix is only added, so that a track of a whole day costs no more per message than a short one.

import { shownValue } from '../shared/display.js';
import { fixed } from '../shared/format.js';
import { currentTheme } from '../shared/theme.js';
import { niceStep } from './local_frame.js';
import { colorOf } from './map_colors.js';
import { xOf, yOf } from './map_place.js';
import { AIDED } from './track.js';

/** Grid lines no closer than this, at the usual size of text. */
const GRID_PX = 72;
/** Track points closer than this on the screen are one. */
const MERGE_PX = 1.25;
/** Nothing was known for longer than this: the line has a gap there, too. */
const GAP_S = 60;
/** The legend's times may lag by this much before the colours are shared out anew. */
const SPAN_GROWTH = 1.02;
const DASH = [6, 4];
const SOLID = /** @type {number[]} */ ([]);

/**
 * @typedef {import('./map_place.js').Place} Place
 * @typedef {import('./map_place.js').Scene} Scene
 */

export class MapBase {
  constructor() {
    /** @type {string[]} line, dim, text, accent, fault */
    this.colors = [];
    this.fontPx = 11;
    /** What the picture shows now; NaN before the first. */
    this.drawn = {
      width: NaN,
      height: NaN,
      ratio: NaN,
      centerE: NaN,
      centerN: NaN,
      metresPerPx: NaN,
      unit: NaN,
      epoch: NaN,
      spanS: NaN,
      coloring: '',
      hasTiles: false,
    };
    this.points = 0;
    this.fixes = 0;
    /** Pieces of line in the picture: what drawing it whole costs. */
    this.pieces = 0;
    this.lastX = 0;
    this.lastY = 0;
    this.lastS = NaN;
    this.style = NaN;
    this.dashPx = 0;
  }

  /** Colours or sizes have changed: nothing drawn is right any more. */
  forget() {
    this.drawn.width = NaN;
  }

  /**
   * @param {CanvasRenderingContext2D} c  scaled to CSS pixels
   * @param {Place} place
   * @param {Scene} scene
   */
  draw(c, place, scene) {
    if (!this.isDrawn(place, scene)) {
      c.clearRect(0, 0, place.width, place.height);
      this.points = this.fixes = this.pieces = 0;
      this.lastS = this.style = NaN;
      this.dashPx = 0;
      this.drawGrid(c, place, scene.hasTiles);
      this.drawOrigin(c, place);
    }
    this.addTrack(c, place, scene);
    this.addFixes(c, place, scene.track);
  }

  /**
   * How far the picture, as it was drawn, lies from where it belongs; null where moving it would not do.
   * @param {Place} place
   * @returns {[number, number] | null} pixels to the right and down
   */
  shiftTo(place) {
    const { drawn } = this;
    if (
      drawn.width !== place.width ||
      drawn.height !== place.height ||
      drawn.ratio !== place.ratio ||
      drawn.metresPerPx !== place.metresPerPx
    )
      return null;
    return [
      (drawn.centerE - place.centerE) / place.metresPerPx,
      (place.centerN - drawn.centerN) / place.metresPerPx,
    ];
  }

  /**
   * Whether only what is new is missing; if not, notes what will be drawn.
   * @param {Place} place
   * @param {Scene} scene
   */
  isDrawn(place, { track, coloring, hasTiles }) {
    const { drawn } = this;
    const unit = shownValue(1, 'm') ?? 1;
    const spanS = track.length > 1 ? track.timeS[track.length - 1] - track.timeS[0] : 0;
    const same =
      drawn.width === place.width &&
      drawn.height === place.height &&
      drawn.ratio === place.ratio &&
      drawn.centerE === place.centerE &&
      drawn.centerN === place.centerN &&
      drawn.metresPerPx === place.metresPerPx &&
      drawn.unit === unit &&
      drawn.epoch === track.epoch &&
      drawn.coloring === coloring.key &&
      drawn.hasTiles === hasTiles &&
      (coloring.key !== 'time' || spanS <= drawn.spanS * SPAN_GROWTH);
    if (same) return true;
    drawn.width = place.width;
    drawn.height = place.height;
    drawn.ratio = place.ratio;
    drawn.centerE = place.centerE;
    drawn.centerN = place.centerN;
    drawn.metresPerPx = place.metresPerPx;
    drawn.unit = unit;
    drawn.epoch = track.epoch;
    drawn.coloring = coloring.key;
    drawn.hasTiles = hasTiles;
    drawn.spanS = spanS;
    return false;
  }

  /**
   * @param {CanvasRenderingContext2D} c
   * @param {Place} place
   * @param {boolean} hasTiles  lines over a picture must not hide it
   */
  drawGrid(c, place, hasTiles) {
    const [line, dim] = this.colors;
    // In the units that the page shows: a grid of 5 m that reads 16.4 ft would help nobody.
    const metres = 1 / (shownValue(1, 'm') ?? 1);
    const gridPx = (GRID_PX * this.fontPx) / 11;
    const step = niceStep((gridPx * place.metresPerPx) / metres) * metres;
    const halfE = (place.width / 2) * place.metresPerPx;
    const halfN = (place.height / 2) * place.metresPerPx;
    c.lineWidth = 1;
    c.strokeStyle = hasTiles ? dim : line;
    c.globalAlpha = hasTiles ? 0.5 : 1;
    c.beginPath();
    for (let e = Math.ceil((place.centerE - halfE) / step) * step; e <= place.centerE + halfE; e += step) {
      const x = Math.round(xOf(place, e)) + 0.5;
      c.moveTo(x, 0);
      c.lineTo(x, place.height);
    }
    for (let n = Math.ceil((place.centerN - halfN) / step) * step; n <= place.centerN + halfN; n += step) {
      const y = Math.round(yOf(place, n)) + 0.5;
      c.moveTo(0, y);
      c.lineTo(place.width, y);
    }
    c.stroke();
    c.globalAlpha = 1;
    this.labelGrid(c, place, step, metres);
  }

  /**
   * @param {CanvasRenderingContext2D} c
   * @param {Place} place
   * @param {number} step
   * @param {number} metres  of one shown unit
   */
  labelGrid(c, place, step, metres) {
    const [, dim, , , , surface] = this.colors;
    const { fontPx } = this;
    const decimals = step / metres < 1 ? 1 : 0;
    c.font = `${fontPx}px system-ui, sans-serif`;
    c.lineJoin = 'round';
    c.lineWidth = 3;
    c.strokeStyle = surface;
    c.fillStyle = dim;
    c.textBaseline = 'bottom';
    const write = (/** @type {string} */ text, /** @type {number} */ x, /** @type {number} */ y) => {
      c.strokeText(text, x, y);
      c.fillText(text, x, y);
    };
    // Whole words only: not over the edge, and not under the arrow of north.
    c.textAlign = 'center';
    const toE = (/** @type {number} */ px) => place.centerE + (px - place.width / 2) * place.metresPerPx;
    const eastmost = toE(place.width - fontPx * 2.5);
    for (let e = Math.ceil(toE(fontPx * 6) / step) * step; e <= eastmost; e += step)
      write(`E ${fixed(e / metres, decimals)}`, xOf(place, e), place.height - 2);
    c.textAlign = 'left';
    const toN = (/** @type {number} */ px) => place.centerN - (px - place.height / 2) * place.metresPerPx;
    const northmost = toN(fontPx * 6.5);
    for (let n = Math.ceil(toN(place.height - fontPx * 2.5) / step) * step; n <= northmost; n += step)
      write(`N ${fixed(n / metres, decimals)}`, 4, yOf(place, n) - 1);
  }

  /**
   * Held by fixes: a solid line. Dead reckoning: a thinner, broken one. Colours are changed as seldom as can be.
   * @param {CanvasRenderingContext2D} c
   * @param {Place} place
   * @param {Scene} scene
   */
  addTrack(c, place, { track, coloring }) {
    const theme = currentTheme();
    const thick = this.fontPx / 11;
    c.lineJoin = 'round';
    let open = false;
    for (let i = this.points; i < track.length; i += 1) {
      const x = xOf(place, track.eastM[i]);
      const y = yOf(place, track.northM[i]);
      const t = track.timeS[i];
      const style = coloring.step(track, i) * 2 + track.mode[i];
      const way = Math.abs(x - this.lastX) + Math.abs(y - this.lastY);
      const isNew = !(t - this.lastS <= GAP_S);
      if (!isNew && way < MERGE_PX && style === this.style) {
        this.lastS = t;
        continue;
      }
      if (!isNew && isInSight(this.lastX, this.lastY, x, y, place)) {
        if (!open) {
          c.strokeStyle = colorOf(coloring, Math.floor(this.style / 2), theme);
          const aided = (this.style & 1) === AIDED;
          c.lineWidth = (aided ? 3.5 : 2) * thick;
          c.setLineDash(aided ? SOLID : DASH);
          c.lineDashOffset = this.dashPx % (DASH[0] + DASH[1]);
          c.beginPath();
          c.moveTo(this.lastX, this.lastY);
          open = true;
        }
        c.lineTo(x, y);
        this.pieces += 1;
        this.dashPx += Math.hypot(x - this.lastX, y - this.lastY);
        if (style !== this.style) {
          c.stroke();
          open = false;
        }
      } else if (open) {
        c.stroke();
        open = false;
      }
      if (style !== this.style) this.dashPx = 0;
      this.style = style;
      this.lastX = x;
      this.lastY = y;
      this.lastS = t;
    }
    if (open) c.stroke();
    c.setLineDash(SOLID);
    this.points = track.length;
  }

  /**
   * Used: a ring. Refused: a cross. Only listened to so far: a small dot.
   * @param {CanvasRenderingContext2D} c
   * @param {Place} place
   * @param {import('./track.js').Track} track
   */
  addFixes(c, place, track) {
    const [, dim, , accent, fault] = this.colors;
    const size = this.fontPx / 11;
    let lastX = NaN;
    let lastY = NaN;
    c.lineWidth = 1.5 * size;
    for (; this.fixes < track.fixes.length; this.fixes += 1) {
      const fix = track.fixes[this.fixes];
      const x = xOf(place, fix.eastM);
      const y = yOf(place, fix.northM);
      if (x < -9 || y < -9 || x > place.width + 9 || y > place.height + 9) continue;
      if (fix.accepted === true && Math.hypot(x - lastX, y - lastY) < 3) continue;
      c.beginPath();
      if (fix.accepted === false) {
        c.strokeStyle = fault;
        c.moveTo(x - 4 * size, y - 4 * size);
        c.lineTo(x + 4 * size, y + 4 * size);
        c.moveTo(x - 4 * size, y + 4 * size);
        c.lineTo(x + 4 * size, y - 4 * size);
        c.stroke();
      } else if (fix.accepted === true) {
        c.strokeStyle = accent;
        c.arc(x, y, (fix.source === 'gps' ? 3.5 : 2.5) * size, 0, 2 * Math.PI);
        c.stroke();
        lastX = x;
        lastY = y;
      } else {
        c.fillStyle = dim;
        c.arc(x, y, 1.5 * size, 0, 2 * Math.PI);
        c.fill();
      }
    }
  }

  /**
   * @param {CanvasRenderingContext2D} c
   * @param {Place} place
   */
  drawOrigin(c, place) {
    const [, , text] = this.colors;
    const arm = (7 * this.fontPx) / 11;
    const x = xOf(place, 0);
    const y = yOf(place, 0);
    c.strokeStyle = text;
    c.lineWidth = 1.5;
    c.beginPath();
    c.moveTo(x - arm, y);
    c.lineTo(x + arm, y);
    c.moveTo(x, y - arm);
    c.lineTo(x, y + arm);
    c.stroke();
  }
}

/**
 * Whether a piece of line may touch the picture: not if both ends lie beyond one of its sides.
 * @param {number} x0
 * @param {number} y0
 * @param {number} x1
 * @param {number} y1
 * @param {Place} place
 */
function isInSight(x0, y0, x1, y1, { width, height }) {
  return !(
    (x0 < -4 && x1 < -4) ||
    (y0 < -4 && y1 < -4) ||
    (x0 > width + 4 && x1 > width + 4) ||
    (y0 > height + 4 && y1 > height + 4)
  );
}
