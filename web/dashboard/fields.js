// @ts-check
// Each measured value the page shows: where it stands in the message, its unit, its decimals.

import { isKnown } from '../shared/format.js';

/**
 * @typedef {Record<string, any>} Data
 * @typedef {object} Field
 * @property {string} key
 * @property {string} label
 * @property {string} unit
 * @property {number} decimals
 * @property {number} [width]  usual characters: the place kept, so that the unit stands still
 * @property {(data: Data, extra: Data) => unknown} read
 * @property {string} [hint]
 */

/**
 * A sensor that says of itself that it is silent or failed has no value, whatever stands in its place.
 * @param {Data | null | undefined} part
 * @param {string} name
 */
function trusted(part, name) {
  return part && part.alive !== false && part.ok !== false ? part[name] : null;
}

/**
 * No attitude lies beyond a full turn: such a number is a fault of the sensor, not a heading.
 * @param {unknown} degrees
 */
function angle(degrees) {
  return isKnown(degrees) && Math.abs(degrees) <= 360 ? degrees : null;
}

/**
 * A position exists with a fix only. Legacy firmware does not say which fix it has: for it, 0 N 0 E is "none".
 * @param {Data} data
 * @param {Data} extra
 */
export function hasFix(data, extra) {
  const gps = data.gps;
  if (!gps || gps.alive === false || !isKnown(gps.lat) || !isKnown(gps.lon)) return false;
  if (extra.gps_fix === '2d' || extra.gps_fix === '3d') return true;
  return (extra.gps_fix === null || extra.gps_fix === undefined) && (gps.lat !== 0 || gps.lon !== 0);
}

/**
 * The fix as a word.
 * @param {Data | null} data
 * @param {Data} extra
 */
export function fixWord(data, extra) {
  const gps = data?.gps;
  if (!gps) return 'Unknown';
  if (gps.alive === false) return 'Silent';
  if (!hasFix(data, extra)) return extra.gps_fix === null && gps.alive !== true ? 'Unknown' : 'No fix';
  return extra.gps_fix === '2d' ? '2D fix' : extra.gps_fix === '3d' ? '3D fix' : 'Fix';
}

/** @type {Field[]} */
export const FIELDS = [
  {
    key: 'roll',
    label: 'Roll',
    unit: '',
    decimals: 1,
    read: (d) => angle(trusted(d.imu, 'r')),
  },
  {
    key: 'pitch',
    label: 'Pitch',
    unit: '',
    decimals: 1,
    read: (d) => angle(trusted(d.imu, 'p')),
  },
  {
    key: 'heading',
    label: 'Heading',
    unit: '',
    decimals: 0,
    read: (d) => angle(trusted(d.imu, 'y')),
  },
  {
    key: 'depth',
    label: 'Depth',
    unit: 'm',
    decimals: 2,
    read: (d, x) => (d.depth?.ok === false ? null : (x.depth_m ?? d.ctd?.d)),
  },
  {
    key: 'temperature',
    label: 'Temperature',
    unit: '\u00b0C',
    decimals: 2,
    width: 4.45,
    hint: 'TSYS01',
    read: (d) => trusted(d.celsius, 'temp'),
  },
  {
    key: 'salinity',
    label: 'Salinity',
    unit: 'PSU',
    decimals: 2,
    width: 4.45,
    hint: 'PSS-78 from conductivity, temperature and pressure',
    read: (d, x) => x.salinity_psu ?? d.ctd?.s,
  },
  {
    key: 'soundSpeed',
    label: 'Sound speed',
    unit: 'm/s',
    decimals: 1,
    width: 5.45,
    read: (d, x) => x.sound_speed_mps ?? d.ctd?.sv,
  },
  {
    key: 'conductivity',
    label: 'Conductivity',
    unit: '\u00b5S/cm',
    decimals: 0,
    width: 5.35,
    hint: 'EZO EC',
    read: (d, x) => (d.ec?.alive === false ? null : (x.conductivity_us ?? d.ec?.conductivity)),
  },
  {
    key: 'pressure',
    label: 'Pressure',
    unit: 'mbar',
    decimals: 1,
    width: 5.45,
    hint: 'absolute, MS5837',
    read: (d) => trusted(d.depth, 'press'),
  },
  {
    key: 'sensorSalinity',
    label: 'EZO salinity',
    unit: 'PSU',
    decimals: 2,
    width: 4.45,
    hint: "the sensor's own figure, not used in computations",
    read: (d) => trusted(d.ec, 'salinity'),
  },
  { key: 'satellites', label: 'Satellites', unit: '', decimals: 0, read: (d) => trusted(d.gps, 'sat') },
  {
    key: 'hdop',
    label: 'HDOP',
    unit: '',
    decimals: 1,
    read: (d, x) => (d.gps?.alive === false ? null : x.hdop),
  },
  {
    key: 'latitude',
    label: 'Latitude',
    unit: '',
    decimals: 6,
    read: (d, x) => (hasFix(d, x) ? d.gps.lat : null),
  },
  {
    key: 'longitude',
    label: 'Longitude',
    unit: '',
    decimals: 6,
    read: (d, x) => (hasFix(d, x) ? d.gps.lon : null),
  },
  {
    key: 'altitude',
    label: 'Altitude',
    unit: 'm',
    decimals: 1,
    width: 4.45,
    read: (d, x) => (hasFix(d, x) ? d.gps.alt : null),
  },
];

/** @type {Map<string, Field>} */
export const FIELD_BY_KEY = new Map(FIELDS.map((field) => [field.key, field]));

/**
 * @param {Map<string, {value: number | null, atMs: number}>} readings  changed in place
 * @param {Data} data
 * @param {Data} extra
 * @param {number} nowMs
 */
export function readFields(readings, data, extra, nowMs) {
  for (const field of FIELDS) {
    const reading = readings.get(field.key);
    if (!reading) continue;
    const value = field.read(data, extra);
    reading.value = isKnown(value) ? value : null;
    if (reading.value !== null) reading.atMs = nowMs;
  }
}
