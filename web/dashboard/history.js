// @ts-check
// An hour of a few values in typed arrays, by the page's steady clock. A gap in the data stays a gap.

export const LONGEST_S = 3600;
/** Two samples closer than this are kept as one: plots need no more than four a second. */
const CLOSEST_S = 0.24;
/** A pause longer than this breaks the line. */
export const GAP_S = 5;
const CAPACITY = Math.ceil(LONGEST_S / CLOSEST_S) + 1;

export class History {
  /** @param {string[]} keys */
  constructor(keys) {
    this.keys = keys;
    // Twice the capacity: the newest part is moved to the front only when the end is reached.
    this.timeS = new Float64Array(2 * CAPACITY);
    this.columns = keys.map(() => new Float64Array(2 * CAPACITY));
    this.start = 0;
    this.end = 0;
  }

  get length() {
    return this.end - this.start;
  }

  /** Time of the newest sample, NaN for none. */
  get newestS() {
    return this.end > this.start ? this.timeS[this.end - 1] : NaN;
  }

  /**
   * @param {number} timeS  must not go backwards; what does is ignored
   * @param {(number | null)[]} values  in the order of the keys; null is unknown
   */
  append(timeS, values) {
    const sinceLast = timeS - this.newestS;
    if (sinceLast < CLOSEST_S) return;
    if (sinceLast > GAP_S) this.push(this.newestS + CLOSEST_S, []);
    this.push(timeS, values);
  }

  /**
   * Puts earlier samples before what is here.
   * @param {Array<[number, (number | null)[]]>} rows  oldest first
   */
  prepend(rows) {
    const firstS = this.length > 0 ? this.timeS[this.start] : Infinity;
    const later = new History(this.keys);
    for (const [timeS, values] of rows) if (timeS < firstS - CLOSEST_S) later.append(timeS, values);
    const values = new Array(this.keys.length);
    for (let i = this.start; i < this.end; i += 1) {
      this.columns.forEach((column, k) => (values[k] = column[i]));
      later.append(this.timeS[i], values);
    }
    Object.assign(this, { timeS: later.timeS, columns: later.columns, start: later.start, end: later.end });
  }

  /**
   * @param {number} timeS
   * @param {(number | null)[]} values
   */
  push(timeS, values) {
    if (this.end === this.timeS.length) this.compact();
    this.timeS[this.end] = timeS;
    for (let k = 0; k < this.columns.length; k += 1) this.columns[k][this.end] = values[k] ?? NaN;
    this.end += 1;
    if (this.length > CAPACITY) this.start += 1;
  }

  compact() {
    this.timeS.copyWithin(0, this.start, this.end);
    for (const column of this.columns) column.copyWithin(0, this.start, this.end);
    this.end -= this.start;
    this.start = 0;
  }

  /**
   * Index of the first sample at or after this time.
   * @param {number} timeS
   */
  indexAt(timeS) {
    let low = this.start;
    let high = this.end;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.timeS[middle] < timeS) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  /**
   * Copies a span into arrays that the caller keeps, unknown as null (which a plot draws as a gap). One sample beyond
   * each end is included, so that lines reach the edges.
   * @param {number} fromS
   * @param {number} toS
   * @param {number[]} times
   * @param {(number | null)[][]} columns
   */
  copySpan(fromS, toS, times, columns) {
    const first = Math.max(this.start, this.indexAt(fromS) - 1);
    const last = Math.min(this.end, this.indexAt(toS) + 1);
    times.length = Math.max(0, last - first);
    for (let i = first; i < last; i += 1) times[i - first] = this.timeS[i];
    this.columns.forEach((column, k) => {
      const out = columns[k];
      out.length = times.length;
      for (let i = first; i < last; i += 1) out[i - first] = Number.isNaN(column[i]) ? null : column[i];
    });
  }
}
