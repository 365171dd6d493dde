// @ts-check
// The plot library, found beside the page. Without it the page works on and says what is missing.

import { fixed } from '../shared/format.js';
import { colors } from '../shared/theme.js';

/** @typedef {import('uplot')} UPlot */
/** @typedef {typeof import('uplot')} UPlotClass */

const ADDRESS = new URL('../vendor/uplot/dist/uPlot.esm.js', import.meta.url).href;

/** @returns {Promise<UPlotClass | null>} */
export async function loadUPlot() {
  try {
    return (await import(ADDRESS)).default;
  } catch {
    return null;
  }
}

export const MISSING =
  'The plot library is missing from this installation: reinstall the extension (or run make setup).';

/** Steps finer than this are noise. */
const MOST_DECIMALS = 6;

/** Size of one rem, by which plots grow on big screens. */
export function remPx() {
  return parseFloat(getComputedStyle(document.documentElement).fontSize) || 16;
}

/** @param {number} rem */
export function plotFont(rem = 0.75) {
  return `${Math.round(rem * remPx())}px system-ui, sans-serif`;
}

/**
 * A scale that keeps its place without data, and then shows no numbers: none is better than invented ones.
 * @param {(low: number | null, high: number | null) => [number | null, number | null]} rangeOf
 */
export function honestScale(rangeOf) {
  let known = false;
  return {
    range: (/** @type {unknown} */ _plot, /** @type {any} */ low, /** @type {any} */ high) => {
      const [from, to] = rangeOf(low, high);
      known = from !== null && to !== null;
      return /** @type {[number, number]} */ (known ? [from, to] : [0, 1]);
    },
    values: (
      /** @type {unknown} */ plot,
      /** @type {number[]} */ splits,
      /** @type {number} */ axis,
      /** @type {number} */ space,
      /** @type {number} */ step,
    ) => (known ? plainMarks(plot, splits, axis, space, step) : splits.map(() => '')),
  };
}

/** Looked up at each drawing, so that a change of theme shows at once. */
export const axisColors = {
  stroke: () => colors('--dim')[0],
  grid: { stroke: () => colors('--line')[0], width: 1 },
  ticks: { stroke: () => colors('--line')[0], width: 1, size: 4 },
};

/**
 * Marks of an axis with as many decimals as their step needs, without thousands separators.
 * @param {unknown} _plot
 * @param {number[]} splits
 * @param {number} _axis
 * @param {number} _space
 * @param {number} step
 */
function plainMarks(_plot, splits, _axis, _space, step) {
  let decimals = 0;
  while (decimals < MOST_DECIMALS && Math.abs(step - Number(step.toFixed(decimals))) > step * 1e-6)
    decimals += 1;
  return splits.map((split) => fixed(split, decimals));
}
