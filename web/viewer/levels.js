// @ts-check
/** Auto-level, time-varied gain tables and the histogram, measured on the pings in view. */

import {
  HISTOGRAM_BINS,
  RangeProfile,
  TVG_BINS,
  addToHistogram,
  approachLevels,
  autoLevels,
  fillCurve,
} from './gain.js';

/** @typedef {import('./ping_ring.js').PingRing} PingRing */
/** @typedef {import('./gain.js').GainSettings} GainSettings */

/** Enough pings and samples for a steady percentile, few enough to cost under a millisecond. */
const PINGS_MEASURED = 160;
const SAMPLE_STEP = 3;
const FOLLOW_SHARE = 0.35;

/** @type {GainSettings} */
export const DEFAULT_GAIN = {
  gainDb: 0,
  gamma: 0.8,
  black: 0,
  white: 1,
  tvg: 'off',
  spreadingDb: 20,
  absorptionDbPerM: 0.05,
};

export class Levels {
  /** @param {Partial<GainSettings>} stored */
  constructor(stored) {
    /** @type {GainSettings} */
    this.gain = { ...DEFAULT_GAIN, ...stored };
    /** Auto-level follows the picture; locked it stays. */
    this.automatic = true;
    this.settled = false;
    this.histogram = new Float64Array(HISTOGRAM_BINS);
    this.tvg = [new Float32Array(TVG_BINS).fill(1), new Float32Array(TVG_BINS).fill(1)];
    this.tvgMaximumM = 30;
    this.profile = new RangeProfile();
  }

  /** The next measurement sets the levels at once instead of following slowly. */
  restart() {
    this.settled = false;
  }

  /**
   * Time-varied gain of one channel over the stretch of time in view.
   * @param {number} channel
   * @param {PingRing[]} rings that may hold it
   * @param {number} fromS
   * @param {number} toS
   */
  fillTvg(channel, rings, fromS, toS) {
    const table = this.tvg[channel];
    if (this.gain.tvg === 'off') table.fill(1);
    else if (this.gain.tvg === 'curve') fillCurve(table, this.tvgMaximumM, this.gain);
    else if (this.automatic || !this.settled) this.fillFlat(table, rings, fromS, toS);
  }

  /**
   * @param {Float32Array} table
   * @param {PingRing[]} rings
   * @param {number} fromS
   * @param {number} toS
   */
  fillFlat(table, rings, fromS, toS) {
    this.profile.reset();
    eachPing(rings, fromS, toS, (ring, slot) =>
      this.profile.add(
        ring.samples,
        slot * ring.width,
        ring.count[slot],
        ring.firstSample[slot],
        ring.resolutionM[slot],
        this.tvgMaximumM,
        1,
      ),
    );
    this.profile.fillGains(table);
  }

  /**
   * @param {{channel: number, rings: PingRing[]}[]} shown
   * @param {number} fromS
   * @param {number} toS
   * @returns {boolean} whether the picture must be drawn again
   */
  measure(shown, fromS, toS) {
    this.histogram.fill(0);
    for (const { channel, rings } of shown) {
      this.fillTvg(channel, rings, fromS, toS);
      const tvg = this.tvg[channel];
      eachPing(rings, fromS, toS, (ring, slot) => {
        const binsPerSample = (ring.resolutionM[slot] / this.tvgMaximumM) * TVG_BINS;
        addToHistogram(
          this.histogram,
          ring.samples,
          slot * ring.width,
          ring.count[slot],
          ring.firstSample[slot] * binsPerSample,
          binsPerSample,
          tvg,
          SAMPLE_STEP,
        );
      });
    }
    const flattened = this.gain.tvg === 'flatten' && this.automatic;
    if (!this.automatic) return false;
    const target = autoLevels(this.histogram);
    if (!target) return false;
    const share = this.settled ? FOLLOW_SHARE : 1;
    this.settled = true;
    return approachLevels(this.gain, target, share) || flattened;
  }
}

/**
 * @param {PingRing[]} rings
 * @param {number} fromS
 * @param {number} toS
 * @param {(ring: PingRing, slot: number) => void} visit some of them, evenly spread
 */
function eachPing(rings, fromS, toS, visit) {
  for (const ring of rings) {
    const first = ring.lastAtOrBefore(fromS) + 1;
    const last = ring.lastAtOrBefore(toS);
    const step = Math.max(1, Math.ceil((last - first + 1) / PINGS_MEASURED));
    for (let index = first; index <= last; index += step) visit(ring, ring.slot(index));
  }
}
