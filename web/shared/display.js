// @ts-check
// Units and theme as the settings want them on every page. Inside, all stays SI; only what is shown is converted.

import { call } from './api.js';
import { setDefaultTheme } from './theme.js';

/** @type {Record<string, {unit: string, factor: number, offset: number}>} */
const IMPERIAL = {
  m: { unit: 'ft', factor: 1 / 0.3048, offset: 0 },
  'm/s': { unit: 'ft/s', factor: 1 / 0.3048, offset: 0 },
  '\u00b0C': { unit: '\u00b0F', factor: 1.8, offset: 32 },
};

let imperial = false;

/** @param {unknown} units  'metric' or 'imperial' */
export function setUnits(units) {
  imperial = units === 'imperial';
}

/** @param {string} unit */
export function shownUnit(unit) {
  return imperial ? (IMPERIAL[unit]?.unit ?? unit) : unit;
}

/**
 * @template {number | null | undefined} T
 * @param {T} value
 * @param {string} unit  of the value as it is
 * @returns {T | number}
 */
export function shownValue(value, unit) {
  const rule = imperial ? IMPERIAL[unit] : undefined;
  return rule && typeof value === 'number' ? value * rule.factor + rule.offset : value;
}

/**
 * Takes units and theme from the answer of GET api/settings.
 * @param {any} answer
 */
export function useDisplaySettings(answer) {
  const settings = Array.isArray(answer?.settings) ? answer.settings : [];
  const value = (/** @type {string} */ key) => settings.find((/** @type {any} */ s) => s?.key === key)?.value;
  setUnits(value('display.units'));
  setDefaultTheme(value('display.theme'));
}

/**
 * Asks for them once, at the start of a page; without an answer the defaults hold.
 * @returns {Promise<any>} the answer, null without one
 */
export async function loadDisplaySettings() {
  try {
    const answer = await call('api/settings');
    useDisplaySettings(answer);
    return answer;
  } catch {
    // The page says by its own means that the extension is silent.
    return null;
  }
}
