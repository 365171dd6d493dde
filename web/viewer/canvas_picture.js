// @ts-check
/**
 * The same picture by Canvas 2D for machines without WebGL2: when only time has moved, the old picture is shifted and
 * only the new rows are painted.
 */

/** @typedef {import('./ping_ring.js').PingRing} PingRing */
/** @typedef {import('./ranging.js').Pane} Pane */
/** @typedef {import('./picture_state.js').PictureState} PictureState */

import { TVG_BINS, displayLevel } from './gain.js';
import { LOST, NOTHING } from './row_table.js';

export class CanvasPicture {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {PingRing[]} rings by layer
   */
  constructor(canvas, rings) {
    this.kind = 'Canvas 2D';
    this.canvas = canvas;
    this.context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext('2d', { alpha: false }));
    this.rings = rings;
    this.capacity = rings[0].capacity;
    this.palette = new Uint32Array(256);
    this.tvg = [new Float32Array(TVG_BINS).fill(1), new Float32Array(TVG_BINS).fill(1)];
    /** Amplitude and gain bin to colour are too many to tabulate; amplitude x 64 steps of gain is not. */
    this.line = new ImageData(1, 1);
    this.pixels = new Uint32Array(this.line.data.buffer);
    /** @type {Int16Array[]} */
    this.shown = [new Int16Array(0), new Int16Array(0)];
    this.changed = true;
    this.key = '';
  }

  /** @param {Uint8Array} table 256 x RGBA */
  setPalette(table) {
    this.palette.set(new Uint32Array(table.slice().buffer));
    this.changed = true;
  }

  /** @param {number} channel @param {Float32Array} table */
  setTvg(channel, table) {
    this.tvg[channel].set(table);
    this.changed = true;
  }

  /**
   * @param {Pane[]} panes
   * @param {Int16Array[]} rowTables by channel
   * @param {PictureState} state
   */
  draw(panes, rowTables, state) {
    const key = JSON.stringify([panes, state, this.canvas.width, this.canvas.height]);
    const everything = this.changed || key !== this.key;
    this.changed = false;
    this.key = key;
    for (const pane of panes) {
      const channel = pane.channel === 'A' ? 0 : 1;
      const table = rowTables[channel];
      const moved = everything ? 0 : shiftBetween(this.shown[channel], table, pane.height);
      if (moved > 0) this.shift(pane, moved);
      this.paintRows(pane, table, this.shown[channel], everything, moved, state);
      if (this.shown[channel].length !== table.length) this.shown[channel] = new Int16Array(table.length);
      this.shown[channel].set(table);
    }
  }

  /** @param {Pane} pane @param {number} rows */
  shift(pane, rows) {
    const { x, y, width, height } = pane;
    this.context.drawImage(this.canvas, x, y, width, height - rows, x, y + rows, width, height - rows);
  }

  /**
   * @param {Pane} pane
   * @param {Int16Array} table
   * @param {Int16Array} shown
   * @param {boolean} everything
   * @param {number} moved
   * @param {PictureState} state
   */
  paintRows(pane, table, shown, everything, moved, state) {
    if (this.line.width !== pane.width) {
      this.line = new ImageData(pane.width, 1);
      this.pixels = new Uint32Array(this.line.data.buffer);
    }
    for (let row = 0; row < pane.height; row++) {
      const before = row - moved;
      const same =
        !everything && before >= 0 && shown[2 * before] === table[2 * row] && table[2 * row] !== LOST;
      if (same && shown[2 * before + 1] === table[2 * row + 1]) continue;
      this.paintRow(pane, table[2 * row], row, state);
      this.context.putImageData(this.line, pane.x, pane.y + row);
    }
  }

  /**
   * @param {Pane} pane
   * @param {number} code
   * @param {number} row
   * @param {PictureState} state
   */
  paintRow(pane, code, row, state) {
    const nothing = packed(state.nothingRgb);
    const hatch = packed(state.hatchRgb);
    const hatched = (/** @type {number} */ x) =>
      (x + this.canvas.height - row) % (7 * state.dpr) < 1.6 * state.dpr ? hatch : nothing;
    if (code < 0) {
      for (let x = 0; x < pane.width; x++) this.pixels[x] = code === NOTHING ? nothing : hatched(pane.x + x);
      return;
    }
    const ring = this.rings[Math.floor(code / this.capacity)];
    const slot = code % this.capacity;
    const tvg = this.tvg[pane.channel === 'A' ? 0 : 1];
    const perPixel = (state.toM - state.fromM) / pane.width;
    for (let x = 0; x < pane.width; x++) {
      const across = pane.mirrored ? pane.width - x - 0.5 : x + 0.5;
      const rangeM = state.fromM + across * perPixel;
      const amplitude = ring.amplitudeAt(slot, rangeM);
      if (amplitude === null) this.pixels[x] = nothing;
      else if (amplitude === 'gap') this.pixels[x] = hatched(pane.x + x);
      else {
        const bin = Math.min(TVG_BINS - 1, Math.floor((rangeM / state.tvgMaximumM) * TVG_BINS));
        this.pixels[x] = this.palette[Math.round(255 * displayLevel(amplitude, tvg[bin], state.gain))];
      }
    }
  }
}

/** @param {Float32Array} rgb 0..1 @returns {number} as ImageData stores it on a little-endian machine */
function packed(rgb) {
  return (
    ((255 << 24) |
      (Math.round(rgb[2] * 255) << 16) |
      (Math.round(rgb[1] * 255) << 8) |
      Math.round(rgb[0] * 255)) >>>
    0
  );
}

/**
 * By how many rows the picture moved down between two tables; 0 when it did not, or not simply.
 * @param {Int16Array} before
 * @param {Int16Array} after
 * @param {number} rows
 */
export function shiftBetween(before, after, rows) {
  if (before.length !== after.length) return 0;
  for (let moved = 1; moved < Math.min(rows / 2, 64); moved++) {
    let equal = true;
    for (let row = 0; equal && row + moved < rows; row += 7) {
      equal = before[2 * row] === after[2 * (row + moved)];
    }
    if (equal && before[0] !== after[0]) return moved;
  }
  return 0;
}
