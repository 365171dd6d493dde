// @ts-check
// Any counter the services report, as a label and a text. What a later version adds shows without a change here.

import { UNKNOWN, age, bytes, count, duration, fixed, isKnown, signed } from '../shared/format.js';
import { wordsOf } from './setting_values.js';

/** @type {Record<string, string>} */
const FRAME_TYPES = {
  1: 'SENSORS',
  2: 'KOGGER_RAW_A',
  3: 'KOGGER_RAW_B',
  4: 'KOGGER_COMPRESSED',
  5: 'IMU_BURST',
  6: 'STATUS',
  7: 'COMMAND_ACK',
  8: 'ACOUSTIC_TDOA',
  9: 'ACOUSTIC_RECORD',
  10: 'ACOUSTIC_MESSAGE',
  11: 'GPS',
};

/** esp_reset_reason() of ESP-IDF. */
const RESET_REASONS = [
  'unknown',
  'power on',
  'reset pin',
  'software',
  'crash',
  'interrupt watchdog',
  'task watchdog',
  'watchdog',
  'deep sleep',
  'brown-out',
  'SDIO',
];

/**
 * @param {string} key
 * @param {unknown} value
 * @returns {string}
 */
export function counterText(key, value) {
  if (value === null || value === undefined || value === '') return UNKNOWN;
  if (typeof value === 'boolean') return value ? 'yes' : 'no';
  if (typeof value === 'string') return key === 'file' ? value.split('/').slice(-2).join('/') : value;
  if (Array.isArray(value))
    return value.length === 0 ? 'none' : value.map((item) => counterText('', item)).join(', ');
  if (!isKnown(value)) return typeof value === 'object' ? JSON.stringify(value) : UNKNOWN;
  if (key === 'reset_reason') return RESET_REASONS[value] ?? `code ${value}`;
  if (key.endsWith('bytes_per_s')) return `${bytes(value)}/s`;
  if (key.endsWith('bytes') || key === 'bytes_skipped') return bytes(value);
  if (key === 'uptime_s') return duration(value);
  if (key.endsWith('seconds_left') || key === 'last_heard_s') return age(value);
  if (key.endsWith('_offset_s')) return `${signed(value, 3)} s`;
  if (key.endsWith('_per_s')) return `${fixed(value, 1)} /s`;
  if (key.endsWith('percent')) return `${fixed(value, Number.isInteger(value) ? 0 : 1)} %`;
  if (key.endsWith('_ppm')) return `${signed(value, 1)} ppm`;
  if (key.endsWith('_mm')) return `${fixed(value)} mm`;
  if (key.endsWith('_m')) return `${fixed(value, 1)} m`;
  if (key.endsWith('_s')) return `${fixed(value, 1)} s`;
  return Number.isInteger(value) ? count(value) : fixed(value, 2);
}

/** What the service's names do not say to a diver. @type {Record<string, string>} */
const WORDS = {
  seconds_left: 'Room for',
  gaps_samples: 'Samples missing',
  gap_samples: 'Samples missing',
  coding: 'Decimation by',
  wall_trusted: 'Clock of the vehicle trusted',
  device_offset_s: "Offset of the ESP32's clock",
  steps: 'Steps of the clock',
  by_id: 'Stable name',
};

/** @param {string} key  "pings_per_s" is the "Ping rate" */
function labelOf(key) {
  if (WORDS[key]) return WORDS[key];
  return key.endsWith('_per_s') ? wordsOf(`${key.replace(/s?_per_s$/, '')}_rate`) : wordsOf(key);
}

/** @param {string} type  "0x04" or "4" */
function frameLabel(type) {
  return `${type} ${FRAME_TYPES[Number(type)] ?? 'unknown type'}`;
}

/**
 * The counters of one part as rows; objects inside are spread out.
 * @param {Record<string, any> | null | undefined} part
 * @param {string} [prefix]
 * @returns {Array<[string, string]>}
 */
export function counterRows(part, prefix = '') {
  /** @type {Array<[string, string]>} */
  const rows = [];
  for (const [key, value] of Object.entries(part ?? {})) {
    if (key === 'frames_by_type') {
      for (const [type, frames] of Object.entries(value ?? {}))
        rows.push([frameLabel(type), counterText('', frames)]);
    } else if (typeof value === 'object' && value !== null && !Array.isArray(value)) {
      rows.push(...counterRows(value, key === 'by_message' ? '' : `${prefix}${wordsOf(key)}: `));
    } else {
      // A message's name is written as MAVLink writes it.
      rows.push([`${prefix}${key === key.toUpperCase() ? key : labelOf(key)}`, counterText(key, value)]);
    }
  }
  return rows;
}

/**
 * The parts of the status that are counters, each with a title.
 * @param {Record<string, any>} status
 * @returns {Array<[string, Array<[string, string]>]>}
 */
export function counterParts(status) {
  /** @type {Array<[string, Record<string, any> | null | undefined]>} */
  const parts = [
    ['Link', status.link],
    ['Sonar A, starboard', status.sonars?.A],
    ['Sonar B, port', status.sonars?.B],
    ['Firmware', status.firmware],
    ['Recorder', status.recorder],
    ['MAVLink', status.mavlink],
    ['Clock', status.clock],
    ...forwardingParts(status.forwarding),
    [
      'Versions',
      { ...status.versions, clients: status.clients, source: status.source, simulated: status.simulated },
    ],
  ];
  return parts.map(([title, part]) => [title, part ? counterRows(part) : [['Has not reported', UNKNOWN]]]);
}

/**
 * @param {unknown} forwarding
 * @returns {Array<[string, Record<string, any>]>}
 */
function forwardingParts(forwarding) {
  if (!Array.isArray(forwarding)) return [];
  return forwarding.map(({ target, channel, ...rest }) => [`UDP ${channel} to ${target}`, rest]);
}
