// @ts-check
/** The sonar settings as a form: fields, limits, what was asked against what was read back. Pure. */

import { fixed } from '../shared/format.js';

/** @typedef {'A' | 'B'} Channel */

/**
 * @typedef {object} Field
 * @property {string} key
 * @property {string} label
 * @property {string} unit
 * @property {number} least used until the service tells its own
 * @property {number} most
 * @property {number} step
 * @property {number} decimals
 */

/** @type {Field[]} */
export const FIELDS = [
  { key: 'range_m', label: 'Range', unit: 'm', least: 0.1, most: 200, step: 0.1, decimals: 2 },
  { key: 'resolution_mm', label: 'Resolution', unit: 'mm', least: 10, most: 1000, step: 1, decimals: 0 },
  { key: 'period_ms', label: 'Period', unit: 'ms', least: 10, most: 60000, step: 1, decimals: 0 },
  { key: 'frequency_khz', label: 'Frequency', unit: 'kHz', least: 40, most: 6000, step: 1, decimals: 0 },
  { key: 'pulses', label: 'Pulses', unit: '', least: 1, most: 255, step: 1, decimals: 0 },
  { key: 'smoothing', label: 'Smoothing', unit: '', least: 0, most: 4, step: 1, decimals: 0 },
  {
    key: 'sound_speed_mps',
    label: 'Sound speed',
    unit: 'm/s',
    least: 1350,
    most: 1750,
    step: 0.1,
    decimals: 1,
  },
];

/**
 * A typed number, or why it cannot be used.
 * @param {Field} field
 * @param {string} text
 * @param {[number, number] | undefined} limits of the service
 * @returns {{value: number} | {problem: string}}
 */
export function parseField(field, text, limits) {
  const [least, most] = limits ?? [field.least, field.most];
  const value = Number(text.trim().replace(',', '.'));
  const room = `${least} to ${most}${field.unit ? ` ${field.unit}` : ''}`;
  if (text.trim() === '' || !Number.isFinite(value)) return { problem: `${field.label}: a number, ${room}` };
  if (value < least || value > most) return { problem: `${field.label} ${value}: must be ${room}` };
  return { value };
}

/**
 * What one setting reads, and whether that is what was asked.
 * @param {string} key
 * @param {number} decimals
 * @param {any} sonar data of the sonar topic
 * @param {Channel[]} channels
 * @returns {{text: string, differs: boolean}}
 */
export function readBack(key, decimals, sonar, channels) {
  let differs = false;
  const parts = channels.map((channel) => {
    const read = sonar?.[channel]?.read?.[key];
    const asked = sonar?.[channel]?.asked?.[key];
    const name = channels.length > 1 ? `${channel} ` : '';
    if (asked !== undefined && asked !== null && !isSame(asked, read)) {
      differs = true;
      return `${name}${shown(read, decimals)} (asked ${shown(asked, decimals)})`;
    }
    return `${name}${shown(read, decimals)}`;
  });
  const unknown = channels.every((channel) => (sonar?.[channel]?.read?.[key] ?? null) === null);
  return { text: unknown && !differs ? 'Not read yet' : `Reads ${parts.join(', ')}`, differs };
}

/** @param {unknown} asked @param {unknown} read */
function isSame(asked, read) {
  if (typeof asked === 'number' && typeof read === 'number')
    return Math.abs(asked - read) <= 1e-3 * Math.abs(asked) + 0.02;
  return asked === read;
}

/** @param {unknown} value @param {number} decimals */
function shown(value, decimals) {
  if (typeof value === 'boolean') return value ? 'on' : 'off';
  return fixed(value, decimals);
}

/**
 * What the service answered, in one line for people.
 * @param {any} answer
 * @returns {{ok: boolean, text: string}}
 */
export function outcomeText(answer) {
  if (!answer || typeof answer !== 'object') return { ok: true, text: 'Done.' };
  const lines = [];
  let ok = true;
  for (const channel of ['A', 'B']) {
    const outcome = answer[channel];
    if (!outcome) continue;
    ok = ok && outcome.ok !== false;
    lines.push(`${channel}: ${outcome.message ?? (outcome.ok ? 'done' : 'refused')}`);
  }
  return { ok, text: lines.length ? lines.join('. ') : String(answer.message ?? 'Done.') };
}

/**
 * Samples per ping that a range and a resolution need.
 * @param {unknown} rangeM
 * @param {unknown} resolutionMm
 */
export function samplesFor(rangeM, resolutionMm) {
  if (typeof rangeM !== 'number' || typeof resolutionMm !== 'number' || !(resolutionMm > 0)) return NaN;
  return Math.round((rangeM * 1000) / resolutionMm);
}
