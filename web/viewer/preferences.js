// @ts-check
/** What the page remembers in this browser. A blocked or damaged store means defaults. */

const STORED_AS = 'bluerov-slam.viewer';

/**
 * @typedef {object} Preferences
 * @property {string} palette
 * @property {boolean} inverted
 * @property {import('./ranging.js').Layout} layout
 * @property {boolean} mirrored
 * @property {boolean} grid
 * @property {boolean} automatic
 * @property {number} secondsPerPixel
 * @property {Partial<import('./gain.js').GainSettings>} gain
 */

/** @type {Preferences} */
const DEFAULTS = {
  palette: 'copper',
  inverted: false,
  layout: 'side',
  mirrored: false,
  grid: true,
  automatic: true,
  secondsPerPixel: 0.06,
  gain: {},
};

/**
 * @param {string | null} text as stored
 * @returns {Preferences} only keys and types that we know
 */
export function parsePreferences(text) {
  /** @type {any} */
  let stored;
  try {
    stored = JSON.parse(text ?? 'null');
  } catch {
    stored = null;
  }
  /** @type {any} */
  const merged = { ...DEFAULTS };
  if (stored === null || typeof stored !== 'object') return merged;
  for (const [key, value] of Object.entries(DEFAULTS)) {
    if (typeof stored[key] === typeof value && stored[key] !== null) merged[key] = stored[key];
  }
  if (!['side', 'stacked', 'A', 'B'].includes(merged.layout)) merged.layout = DEFAULTS.layout;
  if (!(merged.secondsPerPixel > 0)) merged.secondsPerPixel = DEFAULTS.secondsPerPixel;
  merged.gain = parseGain(merged.gain);
  return merged;
}

/** @param {any} stored */
function parseGain(stored) {
  /** @type {any} */
  const gain = {};
  for (const key of ['gainDb', 'gamma', 'black', 'white', 'spreadingDb', 'absorptionDbPerM']) {
    if (Number.isFinite(stored[key])) gain[key] = stored[key];
  }
  if (['off', 'curve', 'flatten'].includes(stored.tvg)) gain.tvg = stored.tvg;
  return gain;
}

export function loadPreferences() {
  try {
    return parsePreferences(localStorage.getItem(STORED_AS));
  } catch {
    return parsePreferences(null);
  }
}

let timer = 0;

/** @param {Preferences} preferences */
export function savePreferences(preferences) {
  clearTimeout(timer);
  timer = window.setTimeout(() => {
    try {
      localStorage.setItem(STORED_AS, JSON.stringify(preferences));
    } catch {
      // No storage in a sandboxed iframe: they hold for this visit.
    }
  }, 300);
}
