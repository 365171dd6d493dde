// @ts-check
// Numbers as people read them. Unknown is always "-", never 0; minus is a true minus, as wide as a digit.

export const UNKNOWN = '-';
const MINUS = '\u2212';
const NARROW_SPACE = '\u202f';

/**
 * @param {unknown} value
 * @returns {value is number}
 */
export function isKnown(value) {
  return typeof value === 'number' && Number.isFinite(value);
}

/**
 * A fixed number of decimals; a value too long for its place turns to powers of ten instead of breaking the layout.
 * @param {unknown} value
 * @param {number} [decimals]
 * @param {number} [longest]  characters that the place holds
 */
export function fixed(value, decimals = 0, longest = 9) {
  if (!isKnown(value)) return UNKNOWN;
  let text = value.toFixed(decimals);
  if (text.length > longest || text.includes('e')) text = value.toExponential(2).replace('e+', 'e');
  if (Number(text) === 0) text = text.replace('-', '');
  return text.replaceAll('-', MINUS);
}

/**
 * As `fixed`, with a plus in front of what is not negative.
 * @param {unknown} value
 * @param {number} [decimals]
 */
export function signed(value, decimals = 0) {
  const text = fixed(value, decimals);
  return text === UNKNOWN || text.startsWith(MINUS) ? text : `+${text}`;
}

/**
 * Whole numbers with thin spaces between thousands.
 * @param {unknown} value
 */
export function count(value) {
  if (!isKnown(value)) return UNKNOWN;
  if (Math.abs(value) >= 1e12) return fixed(value, 0, 0);
  return Math.trunc(value)
    .toString()
    .replace('-', MINUS)
    .replace(/\B(?=(\d{3})+$)/g, NARROW_SPACE);
}

const BYTE_UNITS = ['B', 'kB', 'MB', 'GB', 'TB', 'PB'];

/**
 * Bytes with three significant digits, by powers of 1000.
 * @param {unknown} value
 */
export function bytes(value) {
  if (!isKnown(value)) return UNKNOWN;
  let scaled = value;
  let unit = 0;
  while (Math.abs(scaled) >= 999.5 && unit < BYTE_UNITS.length - 1) {
    scaled /= 1000;
    unit += 1;
  }
  const decimals = unit === 0 ? 0 : Math.abs(scaled) < 9.995 ? 2 : Math.abs(scaled) < 99.95 ? 1 : 0;
  return `${fixed(scaled, decimals)} ${BYTE_UNITS[unit]}`;
}

/**
 * How long ago, short enough for a small place: "0.4 s", "12 s", "3 min", "2 h", "5 d".
 * @param {unknown} seconds
 */
export function age(seconds) {
  if (!isKnown(seconds)) return UNKNOWN;
  const s = Math.max(0, seconds);
  if (s < 9.95) return `${s.toFixed(1)} s`;
  if (s < 99.5) return `${s.toFixed(0)} s`;
  if (s < 5400) return `${Math.round(s / 60)} min`;
  if (s < 172800) return `${Math.round(s / 3600)} h`;
  return `${Math.round(s / 86400)} d`;
}

/**
 * Hours, minutes, seconds: "1:02:03", "2:03".
 * @param {unknown} seconds
 */
export function duration(seconds) {
  if (!isKnown(seconds)) return UNKNOWN;
  const s = Math.max(0, Math.floor(seconds));
  const two = (/** @type {number} */ n) => String(n).padStart(2, '0');
  const hours = Math.floor(s / 3600);
  const minutes = Math.floor(s / 60) % 60;
  return hours > 0 ? `${hours}:${two(minutes)}:${two(s % 60)}` : `${minutes}:${two(s % 60)}`;
}

/**
 * Compass heading from any angle in degrees: "000" to "359".
 * @param {unknown} degrees
 */
export function heading(degrees) {
  if (!isKnown(degrees)) return UNKNOWN;
  return String(Math.round(wrap360(degrees)) % 360).padStart(3, '0');
}

/** @param {number} degrees */
export function wrap360(degrees) {
  return ((degrees % 360) + 360) % 360;
}

const POINTS = ['N', 'NE', 'E', 'SE', 'S', 'SW', 'W', 'NW'];

/** @param {unknown} degrees */
export function compassPoint(degrees) {
  return isKnown(degrees) ? POINTS[Math.round(wrap360(degrees) / 45) % 8] : UNKNOWN;
}

/**
 * A geodetic angle with its hemisphere: "47.612300° N".
 * @param {unknown} degrees
 * @param {'latitude' | 'longitude'} kind
 * @param {number} [decimals]
 */
export function geodetic(degrees, kind, decimals = 6) {
  if (!isKnown(degrees)) return UNKNOWN;
  const hemisphere = kind === 'latitude' ? (degrees < 0 ? 'S' : 'N') : degrees < 0 ? 'W' : 'E';
  return `${Math.abs(degrees).toFixed(decimals)}\u00b0 ${hemisphere}`;
}

/**
 * Date and time of the viewer's own zone: "2026-11-22 08:46:31".
 * @param {unknown} unixSeconds
 */
export function dateTime(unixSeconds) {
  if (!isKnown(unixSeconds) || Math.abs(unixSeconds) > 8e12) return UNKNOWN;
  const d = new Date(unixSeconds * 1000);
  const two = (/** @type {number} */ n) => String(n).padStart(2, '0');
  return `${d.getFullYear()}-${two(d.getMonth() + 1)}-${two(d.getDate())} ${clockTime(unixSeconds)}`;
}

/**
 * Time of day of the viewer's own zone: "08:46:31".
 * @param {unknown} unixSeconds
 */
export function clockTime(unixSeconds) {
  if (!isKnown(unixSeconds) || Math.abs(unixSeconds) > 8e12) return UNKNOWN;
  const d = new Date(unixSeconds * 1000);
  const two = (/** @type {number} */ n) => String(n).padStart(2, '0');
  return `${two(d.getHours())}:${two(d.getMinutes())}:${two(d.getSeconds())}`;
}
