// @ts-check
/**
 * The same picture by Canvas 2D for machines without WebGL2: the old picture is shifted and only changed rows are
 * painted. A row that holds several pings shows the newest of them.
 */

import { TVG_BINS, displayLevel } from './gain.js';
import { HATCH_PX, PictureChanges } from './picture_changes.js';
import { LOST } from './row_table.js';

/** @typedef {import('./ping_ring.js').PingRing} PingRing */
/** @typedef {import('./ranging.js').Pane} Pane */
/** @typedef {import('./picture_state.js').PictureState} PictureState */

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
    this.line = new ImageData(1, 1);
    this.pixels = new Uint32Array(this.line.data.buffer);
    this.changes = new PictureChanges();
    this.shownSize = '';
  }

  /** @param {Uint8Array} table 256 x RGBA */
  setPalette(table) {
    this.palette.set(new Uint32Array(table.slice().buffer));
    this.changes.everything();
  }

  /** @param {number} channel @param {Float32Array} table */
  setTvg(channel, table) {
    this.tvg[channel].set(table);
    this.changes.everything();
  }

  /**
   * @param {Pane[]} panes
   * @param {Int16Array[]} rowTables by channel
   * @param {number} topRow on the time grid
   * @param {PictureState} state
   */
  draw(panes, rowTables, topRow, state) {
    const size = `${this.canvas.width}x${this.canvas.height}`;
    if (size !== this.shownSize) this.changes.everything();
    this.shownSize = size;
    this.changes.begin(panes, state, this.rings);
    this.nothing = packed(state.nothingRgb);
    this.hatch = packed(state.hatchRgb);
    this.hatchPeriod = Math.max(4, Math.round(HATCH_PX * state.dpr));
    const moved = topRow - this.changes.topRow;
    for (const pane of panes) {
      const channel = pane.channel === 'A' ? 0 : 1;
      if (!this.changes.whole && moved !== 0 && Math.abs(moved) < pane.height) this.shift(pane, moved);
      this.fitLine(pane.width);
      this.changes.each(channel, rowTables[channel], topRow, pane.height, (from, to) => {
        for (let row = from; row < to; row++) {
          this.paintRow(pane, rowTables[channel], row, topRow, state);
          this.context.putImageData(this.line, pane.x, pane.y + row);
        }
      });
    }
    this.changes.end(rowTables, topRow);
  }

  /** @param {Pane} pane @param {number} rows positive: down */
  shift(pane, rows) {
    const { x, y, width } = pane;
    const kept = pane.height - Math.abs(rows);
    const from = y + Math.max(0, -rows);
    this.context.drawImage(this.canvas, x, from, width, kept, x, y + Math.max(0, rows), width, kept);
  }

  /** @param {number} width */
  fitLine(width) {
    if (this.line.width === width) return;
    this.line = new ImageData(width, 1);
    this.pixels = new Uint32Array(this.line.data.buffer);
  }

  /** @param {number} x @param {number} row @param {number} topRow */
  hatched(x, row, topRow) {
    const period = this.hatchPeriod ?? 1;
    const phase = (((x + row - topRow) % period) + period) % period;
    return (phase < Math.max(period >> 2, 1) ? this.hatch : this.nothing) ?? 0;
  }

  /**
   * @param {Pane} pane
   * @param {Int16Array} table
   * @param {number} row
   * @param {number} topRow
   * @param {PictureState} state
   */
  paintRow(pane, table, row, topRow, state) {
    const code = table[2 * row];
    const { pixels } = this;
    if (code === LOST) {
      for (let x = 0; x < pane.width; x++) pixels[x] = this.hatched(pane.x + x, row, topRow);
      return;
    }
    if (code < 0) {
      pixels.fill(this.nothing ?? 0);
      return;
    }
    const ring = this.rings[Math.floor(code / this.capacity)];
    const slot = ((code % this.capacity) + table[2 * row + 1] - 1) % this.capacity;
    const tvg = this.tvg[pane.channel === 'A' ? 0 : 1];
    const perPixel = (state.toM - state.fromM) / pane.width;
    for (let x = 0; x < pane.width; x++) {
      const across = pane.mirrored ? pane.width - x - 0.5 : x + 0.5;
      const rangeM = state.fromM + across * perPixel;
      const amplitude = ring.amplitudeAt(slot, rangeM);
      if (amplitude === null) pixels[x] = this.nothing ?? 0;
      else if (amplitude === 'gap') pixels[x] = this.hatched(pane.x + x, row, topRow);
      else {
        const bin = Math.min(TVG_BINS - 1, Math.floor((rangeM / state.tvgMaximumM) * TVG_BINS));
        pixels[x] = this.palette[Math.round(255 * displayLevel(amplitude, tvg[bin], state.gain))];
      }
    }
  }
}

/** @param {Float32Array} rgb 0..1 @returns {number} as ImageData stores it on a little-endian machine */
function packed(rgb) {
  const [red, green, blue] = [0, 1, 2].map((k) => Math.round(rgb[k] * 255));
  return ((255 << 24) | (blue << 16) | (green << 8) | red) >>> 0;
}
