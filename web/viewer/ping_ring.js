// @ts-check
/**
 * Pings of one channel in the order of their time, in one block of memory: the same rows that the picture holds as
 * texture rows. Both ends grow; a full ring forgets at the other end. Pure.
 */

/** @typedef {import('./decoding.js').Ping} Ping */

/** Longer pings are reduced to this many samples, the strongest of each group. */
const WIDEST = 4096;
const FIRST_WIDTH = 1024;
const NO_GAPS = new Uint16Array(0);

/** Intervals whose median is the ping period: rides over single losses, follows a new period within a second. */
const PERIOD_WINDOW = 9;
const FIRST_GUESS_OF_PERIOD_S = 0.1;

export class PingRing {
  /** @param {number} capacity rows */
  constructor(capacity) {
    this.capacity = capacity;
    this.width = FIRST_WIDTH;
    this.samples = new Uint8Array(capacity * this.width);
    this.timeS = new Float64Array(capacity);
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
    this.recentIntervals = new Float64Array(PERIOD_WINDOW);
    this.intervalCount = 0;
    this.sortScratch = new Float64Array(PERIOD_WINDOW);
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
    this.intervalCount = 0;
  }

  /**
   * @param {Ping} ping newer than all others
   * @returns {boolean} false when it is not newer, so not stored
   */
  append(ping) {
    if (this.length && ping.monotonicS <= this.newestS) return false;
    const period = this.observeInterval(this.length ? ping.monotonicS - this.newestS : NaN);
    if (this.length === this.capacity) this.head = this.slot(1);
    else this.length += 1;
    this.write(this.slot(this.length - 1), ping, period);
    return true;
  }

  /**
   * @param {Ping[]} pings oldest first; those that are not older than all stored ones are left out
   * @returns {number} how many were stored
   */
  prependAll(pings) {
    let stored = 0;
    for (let k = pings.length - 1; k >= 0; k--) {
      const ping = pings[k];
      if (this.length && ping.monotonicS >= this.oldestS) continue;
      const period = periodAround(pings, k);
      this.head = this.head === 0 ? this.capacity - 1 : this.head - 1;
      if (this.length < this.capacity) this.length += 1;
      this.write(this.head, ping, period);
      stored += 1;
    }
    return stored;
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
      monotonicS: this.timeS[slot],
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

  /** @param {number} slot */
  farthestM(slot) {
    return (this.firstSample[slot] + this.count[slot]) * this.resolutionM[slot];
  }

  /**
   * @param {number} slot
   * @param {Ping} ping
   * @param {number} periodS
   */
  write(slot, ping, periodS) {
    if (ping.samples.length > this.width && this.width < WIDEST) this.widen(ping.samples.length);
    const step = Math.ceil(ping.samples.length / this.width) || 1;
    const start = slot * this.width;
    if (step === 1) this.samples.set(ping.samples, start);
    else reduceByMaximum(ping.samples, step, this.samples, start);
    this.count[slot] = Math.ceil(ping.samples.length / step);
    this.firstSample[slot] = (ping.firstSample + (step - 1) / 2) / step;
    this.resolutionM[slot] = ping.resolutionM * step;
    this.gaps[slot] = step === 1 || !ping.gaps.length ? ping.gaps : reducedGaps(ping.gaps, step);
    this.timeS[slot] = ping.monotonicS;
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

  /** @param {number} intervalS */
  observeInterval(intervalS) {
    if (!Number.isFinite(intervalS)) return FIRST_GUESS_OF_PERIOD_S;
    this.recentIntervals[this.intervalCount % PERIOD_WINDOW] = intervalS;
    this.intervalCount += 1;
    const used = Math.min(this.intervalCount, PERIOD_WINDOW);
    const known = this.sortScratch.subarray(0, used);
    known.set(this.recentIntervals.subarray(0, used));
    known.sort();
    return known[used >> 1];
  }
}

/**
 * Median interval of the pings around one, s.
 * @param {Ping[]} pings
 * @param {number} at
 */
function periodAround(pings, at) {
  const from = Math.max(1, Math.min(at - (PERIOD_WINDOW >> 1), pings.length - PERIOD_WINDOW));
  const to = Math.min(pings.length, from + PERIOD_WINDOW);
  const intervals = [];
  for (let k = from; k < to; k++) intervals.push(pings[k].monotonicS - pings[k - 1].monotonicS);
  if (!intervals.length) return FIRST_GUESS_OF_PERIOD_S;
  intervals.sort((a, b) => a - b);
  return intervals[intervals.length >> 1];
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
