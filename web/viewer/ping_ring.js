// @ts-check
/**
 * Pings of one channel in the order of their time, in one block of memory: the same rows that the picture holds as
 * texture rows. Both ends grow; a full ring forgets at the other end. Pure.
 */

import { PingClock } from './ping_clock.js';

/** @typedef {import('./decoding.js').Ping} Ping */

/** Longer pings are reduced to this many samples, the strongest of each group. */
const WIDEST = 4096;
const FIRST_WIDTH = 1024;
const NO_GAPS = new Uint16Array(0);
const FIRST_GUESS_OF_PERIOD_S = 0.1;
const RECENT_PINGS = 16;

export class PingRing {
  /** @param {number} capacity rows */
  constructor(capacity) {
    this.capacity = capacity;
    this.width = FIRST_WIDTH;
    this.samples = new Uint8Array(capacity * this.width);
    /** Where the ping is drawn. */
    this.timeS = new Float64Array(capacity);
    /** As the service stamped it. */
    this.arrivalS = new Float64Array(capacity);
    this.unixS = new Float64Array(capacity);
    this.number = new Uint32Array(capacity);
    /** In stored samples, a real number after reduction. */
    this.firstSample = new Float32Array(capacity);
    /** Of a stored sample; NaN when unknown. */
    this.resolutionM = new Float32Array(capacity);
    this.count = new Uint16Array(capacity);
    this.decimation = new Uint8Array(capacity);
    this.periodS = new Float32Array(capacity);
    /** @type {Uint16Array[]} */
    this.gaps = new Array(capacity).fill(NO_GAPS);
    this.head = 0;
    this.length = 0;
    /** Counts events after which a slot may hold another ping than the picture showed. */
    this.generation = 0;
    this.clock = new PingClock();
    /** Called with the slot that was written; -1 when everything moved. @type {(slot: number) => void} */
    this.onWrite = () => {};
  }

  /** @param {number} index 0 = oldest */
  slot(index) {
    const slot = this.head + index;
    return slot >= this.capacity ? slot - this.capacity : slot;
  }

  /** NaN when empty. */
  get oldestS() {
    return this.length ? this.timeS[this.head] : NaN;
  }

  get newestS() {
    return this.length ? this.timeS[this.slot(this.length - 1)] : NaN;
  }

  /** The stamp of the newest, NaN when empty. */
  get newestArrivalS() {
    return this.length ? this.arrivalS[this.slot(this.length - 1)] : NaN;
  }

  get oldestNumber() {
    return this.number[this.head];
  }

  get newestNumber() {
    return this.number[this.slot(this.length - 1)];
  }

  /** The present ping period as seen, s. */
  get currentPeriodS() {
    return this.length ? this.periodS[this.slot(this.length - 1)] : FIRST_GUESS_OF_PERIOD_S;
  }

  clear() {
    this.generation += 1;
    this.head = 0;
    this.length = 0;
    this.clock.reset();
  }

  /**
   * @param {Ping} ping newer than all others
   * @returns {boolean} false when it is not newer, so not stored
   */
  append(ping) {
    if (this.length && ping.monotonicS <= this.newestArrivalS) return false;
    const timeS = this.clock.place(ping.monotonicS);
    if (this.length === this.capacity) this.head = this.slot(1);
    else this.length += 1;
    this.write(this.slot(this.length - 1), ping, timeS, this.clock.periodS);
    const loss = this.clock.loss();
    if (loss) this.shiftNewest(loss.pings, loss.shiftS);
    return true;
  }

  /**
   * @param {Ping[]} pings oldest first; those that are not older than all stored ones are left out
   * @returns {number} how many were stored
   */
  prependAll(pings) {
    if (!this.length) return pings.filter((ping) => this.append(ping)).length;
    const older = pings.filter((ping) => ping.monotonicS < this.arrivalS[this.head]);
    if (!older.length) return 0;
    const { times, periods } = placedTimes(older);
    // Placed by themselves they may reach into what follows.
    const last = older.length - 1;
    const overlapS = Math.max(0, times[last] + 0.5 * periods[last] - this.oldestS);
    for (let k = last; k >= 0; k--) {
      this.head = this.head === 0 ? this.capacity - 1 : this.head - 1;
      if (this.length < this.capacity) this.length += 1;
      this.write(this.head, older[k], times[k] - overlapS, periods[k]);
    }
    return older.length;
  }

  /** @param {number} pings @param {number} shiftS */
  shiftNewest(pings, shiftS) {
    for (let k = Math.max(0, this.length - pings); k < this.length; k++) this.timeS[this.slot(k)] += shiftS;
  }

  /**
   * @param {number} timeS
   * @returns {number} index of the newest ping that is not later, -1 when there is none
   */
  lastAtOrBefore(timeS) {
    let low = 0;
    let high = this.length;
    while (low < high) {
      const middle = (low + high) >>> 1;
      if (this.timeS[this.slot(middle)] <= timeS) low = middle + 1;
      else high = middle;
    }
    return low - 1;
  }

  /**
   * @param {number} number
   * @returns {number} index of the newest ping with this number, -1 when there is none
   */
  indexOfNumber(number) {
    for (let index = this.length - 1; index >= 0; index--)
      if (this.number[this.slot(index)] === number) return index;
    return -1;
  }

  /**
   * The rows after `index` as pings of their own memory, taken out of the ring: room for what was missing between.
   * @param {number} index
   * @param {'A' | 'B'} channel
   * @returns {Ping[]}
   */
  takeAfter(index, channel) {
    const taken = [];
    for (let k = index + 1; k < this.length; k++) taken.push(this.read(this.slot(k), channel));
    this.length = index + 1;
    this.generation += 1;
    const slot = this.slot(index);
    this.clock.resume(this.arrivalS[slot], this.timeS[slot], this.periodS[slot]);
    return taken;
  }

  /**
   * @param {number} slot
   * @param {'A' | 'B'} channel
   * @returns {Ping}
   */
  read(slot, channel) {
    const start = slot * this.width;
    return {
      channel,
      subChannel: 0,
      simulated: false,
      number: this.number[slot],
      timeUnixS: this.unixS[slot],
      monotonicS: this.arrivalS[slot],
      firstSample: this.firstSample[slot],
      resolutionM: this.resolutionM[slot],
      decimation: this.decimation[slot],
      route: 0,
      gaps: this.gaps[slot],
      samples: this.samples.slice(start, start + this.count[slot]),
    };
  }

  /**
   * Raw amplitude of a row at a range: a number, 'gap' where a chunk is missing, null outside the ping.
   * @param {number} slot
   * @param {number} rangeM
   * @returns {number | 'gap' | null}
   */
  amplitudeAt(slot, rangeM) {
    const index = Math.round(rangeM / this.resolutionM[slot] - this.firstSample[slot]);
    if (!(index >= 0 && index < this.count[slot])) return null;
    const gaps = this.gaps[slot];
    for (let k = 0; k < gaps.length; k += 2) if (index >= gaps[k] && index < gaps[k + 1]) return 'gap';
    return this.samples[slot * this.width + index];
  }

  /** @param {number} slot end of the ping, m */
  farthestM(slot) {
    return (this.firstSample[slot] + this.count[slot]) * this.resolutionM[slot];
  }

  /** Range of the latest pings, NaN when empty: one that was cut short does not count. */
  get recentRangeM() {
    let farthest = NaN;
    for (let index = Math.max(0, this.length - RECENT_PINGS); index < this.length; index++) {
      const m = this.farthestM(this.slot(index));
      if (m > farthest || Number.isNaN(farthest)) farthest = m;
    }
    return farthest;
  }

  /**
   * @param {number} slot
   * @param {Ping} ping
   * @param {number} timeS
   * @param {number} periodS
   */
  write(slot, ping, timeS, periodS) {
    if (ping.samples.length > this.width && this.width < WIDEST) this.widen(ping.samples.length);
    const step = Math.ceil(ping.samples.length / this.width) || 1;
    const start = slot * this.width;
    if (step === 1) this.samples.set(ping.samples, start);
    else reduceByMaximum(ping.samples, step, this.samples, start);
    this.count[slot] = Math.ceil(ping.samples.length / step);
    this.firstSample[slot] = (ping.firstSample + (step - 1) / 2) / step;
    this.resolutionM[slot] = ping.resolutionM * step;
    this.gaps[slot] = step === 1 || !ping.gaps.length ? ping.gaps : reducedGaps(ping.gaps, step);
    this.timeS[slot] = timeS;
    this.arrivalS[slot] = ping.monotonicS;
    this.unixS[slot] = ping.timeUnixS;
    this.number[slot] = ping.number;
    this.decimation[slot] = ping.decimation;
    this.periodS[slot] = periodS;
    this.onWrite(slot);
  }

  /** @param {number} samples */
  widen(samples) {
    let width = this.width;
    while (width < samples && width < WIDEST) width *= 2;
    const wider = new Uint8Array(this.capacity * width);
    for (let slot = 0; slot < this.capacity; slot++) {
      const from = slot * this.width;
      wider.set(this.samples.subarray(from, from + this.count[slot]), slot * width);
    }
    this.samples = wider;
    this.width = width;
    this.generation += 1;
    this.onWrite(-1);
  }
}

/**
 * Places of a page of pings in time, and their periods.
 * @param {Ping[]} pings
 */
function placedTimes(pings) {
  const clock = new PingClock();
  const times = new Float64Array(pings.length);
  const periods = new Float32Array(pings.length);
  pings.forEach((ping, k) => {
    times[k] = clock.place(ping.monotonicS);
    periods[k] = clock.periodS;
    const loss = clock.loss();
    for (let j = k + 1 - (loss?.pings ?? 0); j <= k; j++) times[j] += loss?.shiftS ?? 0;
  });
  return { times, periods };
}

/**
 * @param {Uint8Array} samples
 * @param {number} step
 * @param {Uint8Array} into
 * @param {number} start
 */
function reduceByMaximum(samples, step, into, start) {
  for (let from = 0, at = start; from < samples.length; from += step, at++) {
    let strongest = 0;
    const to = Math.min(from + step, samples.length);
    for (let i = from; i < to; i++) if (samples[i] > strongest) strongest = samples[i];
    into[at] = strongest;
  }
}

/** @param {Uint16Array} gaps @param {number} step */
function reducedGaps(gaps, step) {
  const reduced = new Uint16Array(gaps.length);
  for (let k = 0; k < gaps.length; k += 2) {
    reduced[k] = Math.floor(gaps[k] / step);
    reduced[k + 1] = Math.ceil(gaps[k + 1] / step);
  }
  return reduced;
}
