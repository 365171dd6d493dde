// @ts-check
/**
 * From raw amplitude to the place in the palette, and the histogram of it. Pure.
 *
 *   x = amplitude / 255 * tvg(range)          what the histogram shows
 *   y = (x - black) / (white - black) * gain  what the palette shows, after y ** gamma
 *
 * The fragment shader in gl_picture.js computes the same two lines.
 */

/** @typedef {import('./decoding.js').Channel} Channel */

/**
 * @typedef {object} GainSettings
 * @property {number} gainDb -24..24, brightness after the levels
 * @property {number} gamma 0.3..3; below 1 lifts the weak echoes
 * @property {number} black 0..1
 * @property {number} white 0..1, above black
 * @property {'off' | 'curve' | 'flatten'} tvg
 * @property {number} spreadingDb curve: dB per decade of range, 0..40
 * @property {number} absorptionDbPerM curve: dB per metre of range, two-way, 0..0.5
 */

/** Bins of the time-varied gain table over 0..its maximum range. */
export const TVG_BINS = 512;
export const HISTOGRAM_BINS = 128;
/** A bin's gain stays within +-this: more would only amplify the quantisation of 8 bits. */
const TVG_LIMIT_DB = 30;
/** The measured gain rises less, or it would paint the noise of the water column. */
const FLATTEN_LIMIT_DB = 12;
/** Where the flattened mean is put: leaves room for echoes four times the mean. */
const FLATTEN_TARGET = 0.25;
/** Bins around the smoothed one, each side: wide enough to keep targets, narrow enough to remove the beam pattern. */
const FLATTEN_SMOOTHING_BINS = 6;

/** @param {number} db */
export const ratioFromDb = (db) => 10 ** (db / 20);

/**
 * @param {number} amplitude 0..255
 * @param {number} tvgGain
 * @param {GainSettings} settings
 * @returns {number} 0..1
 */
export function displayLevel(amplitude, tvgGain, settings) {
  const x = (amplitude / 255) * tvgGain;
  const span = Math.max(settings.white - settings.black, 1e-3);
  const y = ((x - settings.black) / span) * ratioFromDb(settings.gainDb);
  return Math.min(1, Math.max(0, y)) ** settings.gamma;
}

/**
 * Gain against range by spreading and absorption, 0 dB at half the maximum range so that the mean brightness stays.
 * @param {Float32Array} table filled, one gain ratio per bin
 * @param {number} maximumRangeM
 * @param {GainSettings} settings
 */
export function fillCurve(table, maximumRangeM, settings) {
  const reference = maximumRangeM / 2;
  for (let k = 0; k < table.length; k++) {
    const range = ((k + 0.5) / table.length) * maximumRangeM;
    const db =
      settings.spreadingDb * Math.log10(range / reference) + settings.absorptionDbPerM * (range - reference);
    table[k] = ratioFromDb(limitDb(db));
  }
}

/** @param {number} db */
function limitDb(db) {
  return Math.min(TVG_LIMIT_DB, Math.max(-TVG_LIMIT_DB, db));
}

/**
 * The mean amplitude against range over many pings, and the gain that makes it even.
 * `blend` slowly, so that a passing target does not brighten its surroundings.
 */
export class RangeProfile {
  constructor() {
    this.sum = new Float64Array(TVG_BINS);
    this.count = new Float64Array(TVG_BINS);
  }

  reset() {
    this.sum.fill(0);
    this.count.fill(0);
  }

  /**
   * @param {Uint8Array} samples
   * @param {number} start index of the first sample in `samples`
   * @param {number} count
   * @param {number} firstSample
   * @param {number} resolutionM
   * @param {number} maximumRangeM range of the last bin's end
   * @param {number} step every step-th sample is enough
   */
  add(samples, start, count, firstSample, resolutionM, maximumRangeM, step) {
    const binsPerSample = (resolutionM / maximumRangeM) * TVG_BINS;
    for (let i = 0; i < count; i += step) {
      const bin = Math.floor((firstSample + i) * binsPerSample);
      if (bin >= TVG_BINS) break;
      this.sum[bin] += samples[start + i];
      this.count[bin] += 1;
    }
  }

  /**
   * @param {Float32Array} table filled with one gain ratio per bin; bins without data keep their neighbour's
   */
  fillGains(table) {
    let last = 1;
    for (let k = 0; k < TVG_BINS; k++) {
      let sum = 0;
      let count = 0;
      const to = Math.min(TVG_BINS - 1, k + FLATTEN_SMOOTHING_BINS);
      for (let j = Math.max(0, k - FLATTEN_SMOOTHING_BINS); j <= to; j++) {
        sum += this.sum[j];
        count += this.count[j];
      }
      if (count > 0) {
        const mean = Math.max(sum / count / 255, 1e-3);
        last = ratioFromDb(Math.min(FLATTEN_LIMIT_DB, limitDb(20 * Math.log10(FLATTEN_TARGET / mean))));
      }
      table[k] = last;
    }
  }
}

/**
 * Adds one ping to a histogram of x.
 * @param {Float64Array} histogram
 * @param {Uint8Array} samples
 * @param {number} start
 * @param {number} count
 * @param {number} firstTvgBin of the first sample, as a real number
 * @param {number} tvgBinsPerSample
 * @param {Float32Array} tvg
 * @param {number} step
 */
export function addToHistogram(histogram, samples, start, count, firstTvgBin, tvgBinsPerSample, tvg, step) {
  const bins = histogram.length;
  const lastTvg = tvg.length - 1;
  for (let i = 0; i < count; i += step) {
    const tvgBin = Math.min(lastTvg, Math.floor(firstTvgBin + i * tvgBinsPerSample));
    const x = (samples[start + i] / 255) * tvg[tvgBin];
    histogram[Math.min(bins - 1, Math.floor(x * bins))] += 1;
  }
}

/** Shares of the samples that auto-level lets go fully dark and fully bright. */
const DARK_SHARE = 0.02;
const BRIGHT_SHARE = 0.01;
/** The levels never come closer than this, or an empty picture would show nothing but amplified noise. */
const NARROWEST_SPAN = 0.08;

/**
 * @param {Float64Array} histogram of x
 * @returns {{black: number, white: number} | null} null for an empty histogram
 */
export function autoLevels(histogram) {
  let total = 0;
  for (const count of histogram) total += count;
  if (total === 0) return null;
  const black = quantile(histogram, total * DARK_SHARE);
  const white = quantile(histogram, total * (1 - BRIGHT_SHARE));
  return {
    black: Math.min(black, 1 - NARROWEST_SPAN),
    white: Math.min(1, Math.max(white, black + NARROWEST_SPAN)),
  };
}

/**
 * @param {Float64Array} histogram
 * @param {number} wanted how many samples lie below
 */
function quantile(histogram, wanted) {
  let sum = 0;
  for (let k = 0; k < histogram.length; k++) {
    const next = sum + histogram[k];
    if (next >= wanted && histogram[k] > 0) return (k + (wanted - sum) / histogram[k]) / histogram.length;
    sum = next;
  }
  return 1;
}

/** Below this the eye does not see the step; keeps a settled picture from being redrawn and from breathing. */
const SETTLED = 0.004;

/**
 * Moves the levels a share of the way, so that the picture follows without jumping.
 * @param {GainSettings} settings changed in place
 * @param {{black: number, white: number}} target
 * @param {number} share 1 = at once
 * @returns {boolean} whether anything moved
 */
export function approachLevels(settings, target, share) {
  const black = (target.black - settings.black) * share;
  const white = (target.white - settings.white) * share;
  if (Math.abs(black) < SETTLED * share && Math.abs(white) < SETTLED * share) return false;
  settings.black += black;
  settings.white += white;
  return true;
}
