// @ts-check
/**
 * Even times for the pings of one sonar. They are stamped when they arrive, and a busy computer hands some over late and
 * then several at once: drawn by those stamps, every hiccup would look like lost pings. A late ping is therefore placed
 * where it was due; only when the following ones stay late as well was something lost. Pure.
 */

const ARRIVALS = 24;
/** Intervals are averaged over this many pings before their median is taken: bursts average out. */
const LAG = 4;
const FIRST_GUESS_S = 0.1;
/** Shares of the period. */
const ON_TIME = 0.5;
const FOLLOW = 0.2;
const SHORTEST = 0.2;
/** Pings in a row that must be late, each by more than this share of a period, before a loss is believed. */
const CONFIRM = 6;
const LATE_BY = 0.6;
/** Nothing is held back for longer than this: such a pause is a pause. */
const LONGEST_HICCUP_S = 3;

export class PingClock {
  constructor() {
    this.arrivals = new Float64Array(ARRIVALS);
    this.scratch = new Float64Array(ARRIVALS);
    this.count = 0;
    this.periodS = FIRST_GUESS_S;
    this.placedS = NaN;
    this.latePings = 0;
    this.leastLateS = Infinity;
  }

  reset() {
    this.count = 0;
    this.periodS = FIRST_GUESS_S;
    this.placedS = NaN;
    this.latePings = 0;
    this.leastLateS = Infinity;
  }

  /**
   * Goes on after a ping that was placed before.
   * @param {number} arrivalS
   * @param {number} placedS
   * @param {number} periodS
   */
  resume(arrivalS, placedS, periodS) {
    this.reset();
    this.arrivals[0] = arrivalS;
    this.count = 1;
    this.placedS = placedS;
    this.periodS = periodS;
  }

  /**
   * @param {number} arrivalS
   * @returns {number} the ping's place in time
   */
  place(arrivalS) {
    const dueS = this.placedS + this.observe(arrivalS);
    const lateS = arrivalS - dueS;
    if (!(lateS < LONGEST_HICCUP_S)) {
      // The first ping, or the first after a pause.
      this.latePings = 0;
      this.placedS = arrivalS;
    } else if (lateS > ON_TIME * this.periodS) {
      this.latePings += 1;
      this.leastLateS = Math.min(this.leastLateS, lateS);
      this.placedS = dueS;
    } else {
      this.latePings = 0;
      const early = lateS < -ON_TIME * this.periodS;
      const placed = early ? arrivalS : dueS + FOLLOW * lateS;
      this.placedS = Math.max(placed, this.placedS + SHORTEST * this.periodS);
    }
    if (this.latePings === 0) this.leastLateS = Infinity;
    return this.placedS;
  }

  /**
   * After `place`: a loss that is certain now.
   * @returns {{pings: number, shiftS: number} | null} the last `pings` pings lie later by `shiftS`
   */
  loss() {
    if (this.latePings < CONFIRM || this.leastLateS < LATE_BY * this.periodS) return null;
    const shiftS = Math.max(1, Math.round(this.leastLateS / this.periodS)) * this.periodS;
    const pings = this.latePings;
    this.placedS += shiftS;
    this.latePings = 0;
    this.leastLateS = Infinity;
    return { pings, shiftS };
  }

  /** @param {number} arrivalS @returns {number} the period as it now seems */
  observe(arrivalS) {
    this.arrivals[this.count % ARRIVALS] = arrivalS;
    this.count += 1;
    const known = Math.min(this.count, ARRIVALS);
    if (known > 2 * LAG) this.periodS = this.medianPeriod(known);
    else if (known > 1) {
      const meanS = (arrivalS - this.arrivals[0]) / (known - 1);
      if (meanS < LONGEST_HICCUP_S) this.periodS = meanS;
    }
    return this.periodS;
  }

  /** @param {number} known arrivals */
  medianPeriod(known) {
    const intervals = this.scratch.subarray(0, known - LAG);
    for (let k = 0; k < known - LAG; k++) {
      const later = this.arrivals[(this.count - 1 - k) % ARRIVALS];
      intervals[k] = (later - this.arrivals[(this.count - 1 - k - LAG) % ARRIVALS]) / LAG;
    }
    intervals.sort();
    return Math.max(intervals[intervals.length >> 1], 1e-3);
  }
}
