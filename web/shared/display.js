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

/** A number of the service's sentences with one of the units that are shown otherwise. */
const QUANTITY = /(?<![\w.])(-?\d+(?:\.\d+)?)([ \u00a0])(m\/s|km|m|\u00b0C)(?![\w/])/g;
const MILES_PER_KM = 1 / 1.609344;

/**
 * A sentence of the service, which speaks in metres, with its quantities in the unit that the page shows.
 * @param {string} text
 */
export function inShownUnits(text) {
  if (!imperial) return text;
  return text.replace(QUANTITY, (_whole, number, space, unit) => {
    const decimals = number.split('.')[1]?.length ?? 0;
    if (unit === 'km') return `${(Number(number) * MILES_PER_KM).toFixed(Math.max(decimals, 1))}${space}mi`;
    return `${(shownValue(Number(number), unit) ?? NaN).toFixed(decimals)}${space}${shownUnit(unit)}`;
  });
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
