// @ts-check
/**
 * Which rows of the picture must be painted again. Rows keep their place on the time grid, so a picture that only moved
 * on in time differs in a few rows. Pure.
 */

/**
 * Calls `paint` for each stretch of rows whose ping changed since the last picture.
 * @param {Int16Array} before pairs (code, pings) of the last picture
 * @param {number} beforeTop its top row on the time grid
 * @param {Int16Array} after
 * @param {number} afterTop
 * @param {number} rows
 * @param {(from: number, to: number) => void} paint rows from (inclusive) to (exclusive), 0 on top
 */
export function eachChange(before, beforeTop, after, afterTop, rows, paint) {
  const moved = afterTop - beforeTop;
  let start = -1;
  for (let row = 0; row < rows; row++) {
    const old = row - moved;
    const same =
      old >= 0 &&
      old < rows &&
      before[2 * old] === after[2 * row] &&
      before[2 * old + 1] === after[2 * row + 1];
    if (!same && start < 0) start = row;
    if (same && start >= 0) {
      paint(start, row);
      start = -1;
    }
  }
  if (start >= 0) paint(start, rows);
}

/** Distance of the strokes that hatch what is missing, CSS pixels. */
export const HATCH_PX = 7;

/** What was painted last, and so what must be painted now. */
export class PictureChanges {
  constructor() {
    this.whole = true;
    this.settings = new Float64Array(32);
    this.now = new Float64Array(32);
    this.topRow = 0;
    /** By channel. */
    this.tables = [new Int16Array(0), new Int16Array(0)];
  }

  /** Nothing that was painted holds any longer. */
  everything() {
    this.whole = true;
  }

  /**
   * @param {import('./ranging.js').Pane[]} panes
   * @param {import('./picture_state.js').PictureState} state
   * @param {import('./ping_ring.js').PingRing[]} rings
   */
  begin(panes, state, rings) {
    const { now } = this;
    let at = 0;
    now.fill(0);
    const { gain } = state;
    for (const value of [state.fromM, state.toM, state.tvgMaximumM, state.dpr]) now[at++] = value;
    for (const value of [gain.gainDb, gain.gamma, gain.black, gain.white]) now[at++] = value;
    for (let k = 0; k < 3; k++) now[at++] = state.nothingRgb[k] + 2 * state.hatchRgb[k];
    for (let k = 0; k < rings.length; k++) now[at++] = rings[k].generation;
    for (const pane of panes) {
      now[at++] = pane.x + 1e5 * pane.y;
      now[at++] = pane.width + 1e5 * pane.height;
      now[at++] = (pane.channel === 'A' ? 0 : 1) + (pane.mirrored ? 2 : 0);
    }
    for (let k = 0; k < now.length; k++) if (now[k] !== this.settings[k]) this.whole = true;
    this.settings.set(now);
  }

  /**
   * @param {number} channel
   * @param {Int16Array} table
   * @param {number} topRow
   * @param {number} rows
   * @param {(from: number, to: number) => void} paint
   */
  each(channel, table, topRow, rows, paint) {
    const before = this.tables[channel];
    if (this.whole || before.length !== table.length) paint(0, rows);
    else eachChange(before, this.topRow, table, topRow, rows, paint);
  }

  /** @param {Int16Array[]} tables @param {number} topRow */
  end(tables, topRow) {
    this.whole = false;
    this.topRow = topRow;
    for (let channel = 0; channel < tables.length; channel++) {
      if (this.tables[channel].length !== tables[channel].length) {
        this.tables[channel] = new Int16Array(tables[channel].length);
      }
      this.tables[channel].set(tables[channel]);
    }
  }
}
