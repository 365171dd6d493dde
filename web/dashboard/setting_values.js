// @ts-check
// Settings as text: names, limits, and what somebody typed turned back into a value. Pure.

/**
 * @typedef {object} Setting
 * @property {string} key
 * @property {any} value
 * @property {any} default
 * @property {string | null} [unit]
 * @property {number | null} [minimum]
 * @property {number | null} [maximum]
 * @property {any[] | null} [choices]
 * @property {string} [reason]
 * @property {string} [group]
 * @property {boolean} [restart]
 * @property {boolean} [pending]  saved, waiting for a restart
 * @property {string | null} [fixed_by]  what overrides the page, if anything does
 *
 * @typedef {'switch' | 'choice' | 'number' | 'text' | 'secret' | 'list' | 'json'} Kind
 */

/** @type {Record<string, string>} */
const SPELLINGS = {
  mb: 'MB',
  http: 'HTTP',
  udp: 'UDP',
  ws: 'WebSocket',
  gps: 'GPS',
  id: 'ID',
  a: 'A',
  b: 'B',
  mavlink: 'MAVLink',
  mavlink2rest: 'mavlink2rest',
  url: 'address',
  min: 'least',
  max: 'largest',
  kogger: 'Kogger',
  app: 'App',
  imu: 'IMU',
  esp32: 'ESP32',
  crc: 'CRC',
  ppm: 'ppm',
  utc: 'UTC',
  i2c: 'I2C',
  ec: 'EC',
  tx: 'sent',
};
const UNIT_WORDS = new Set([
  'm',
  's',
  'hz',
  'mm',
  'deg',
  'rad',
  'pa',
  'mps',
  'bytes',
  'percent',
  'ppm',
  'frd',
]);

/**
 * "sonar.a_depression_deg" as people say it: "A depression". The unit stands beside the value.
 * @param {string} key
 */
export function wordsOf(key) {
  const words = (key.split('.').pop() ?? key).split('_');
  while (words.length > 1 && UNIT_WORDS.has(words[words.length - 1])) words.pop();
  const text = words.map((word) => SPELLINGS[word] ?? word).join(' ');
  return text.charAt(0).toUpperCase() + text.slice(1);
}

/**
 * @param {Setting} setting
 * @returns {Kind}
 */
export function kindOf(setting) {
  const sample = setting.default ?? setting.value;
  if (typeof sample === 'boolean') return 'switch';
  if (Array.isArray(setting.choices) && setting.choices.length > 0) return 'choice';
  if (typeof sample === 'number') return 'number';
  if (Array.isArray(sample)) return isPlainList(setting) ? 'list' : 'json';
  if (typeof sample === 'object' && sample !== null) return 'json';
  if (typeof setting.minimum === 'number' || typeof setting.maximum === 'number') return 'number';
  return /token|password|secret/.test(setting.key) ? 'secret' : 'text';
}

/**
 * A value as it stands in its input.
 * @param {any} value
 */
export function inputText(value) {
  if (value === null || value === undefined) return '';
  if (Array.isArray(value) && value.every((item) => typeof item !== 'object')) return value.join(', ');
  return typeof value === 'object' ? JSON.stringify(value) : String(value);
}

/**
 * What somebody typed, as a value. Whole checking is the server's; this catches what cannot even be sent.
 * @param {Setting} setting
 * @param {string} text
 * @returns {{value: any, error: string}}
 */
export function parseInput(setting, text) {
  const kind = kindOf(setting);
  const nullable = setting.default === null || setting.value === null;
  if (text.trim() === '' && nullable) return { value: null, error: '' };
  if (kind === 'switch') return { value: text === 'true', error: '' };
  if (kind === 'choice')
    return { value: setting.choices?.find((choice) => String(choice) === text) ?? text, error: '' };
  if (kind === 'number') return parseNumber(setting, text);
  if (kind === 'list') return parseList(setting, text);
  if (kind !== 'json') return { value: text, error: '' };
  try {
    return { value: JSON.parse(text), error: '' };
  } catch {
    return { value: text, error: `Write it like ${inputText(setting.default)}` };
  }
}

/** @param {Setting} setting */
function isPlainList(setting) {
  return [setting.value, setting.default].flat().every((item) => typeof item !== 'object');
}

/**
 * Items with commas between them, numbers where the default holds numbers.
 * @param {Setting} setting
 * @param {string} text
 */
function parseList(setting, text) {
  const items = text
    .split(',')
    .map((item) => item.trim())
    .filter((item) => item !== '');
  if (![setting.default, setting.value].flat().some((item) => typeof item === 'number'))
    return { value: items, error: '' };
  const numbers = items.map(Number);
  return numbers.every(Number.isFinite)
    ? { value: numbers, error: '' }
    : { value: items, error: 'Write numbers with commas between them' };
}

/**
 * @param {Setting} setting
 * @param {string} text
 */
function parseNumber(setting, text) {
  const value = Number(text.trim().replace(',', '.'));
  if (text.trim() === '' || !Number.isFinite(value)) return { value: text, error: 'Write a number' };
  const low = setting.minimum ?? -Infinity;
  const high = setting.maximum ?? Infinity;
  if (value < low || value > high) return { value, error: `Allowed: ${limitsText(setting)}` };
  return { value, error: '' };
}

/** @param {Setting} setting */
export function limitsText(setting) {
  const { minimum: low, maximum: high } = setting;
  const unit = setting.unit ? ` ${setting.unit}` : '';
  if (typeof low === 'number' && typeof high === 'number') return `${low} to ${high}${unit}`;
  if (typeof low === 'number') return `at least ${low}${unit}`;
  if (typeof high === 'number') return `at most ${high}${unit}`;
  return '';
}

/** @param {Setting} setting */
export function defaultText(setting) {
  if (kindOf(setting) === 'switch') return setting.default ? 'on' : 'off';
  const text = inputText(setting.default);
  if (Array.isArray(setting.default) && text === '') return 'none';
  return text === '' ? 'empty' : `${text}${setting.unit ? ` ${setting.unit}` : ''}`;
}

/**
 * @param {any} a
 * @param {any} b
 */
export function sameValue(a, b) {
  return JSON.stringify(a ?? null) === JSON.stringify(b ?? null);
}
