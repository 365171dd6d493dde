// @ts-check
// How the track is coloured: by time, uncertainty or speed, in a few steps, with a legend that says which is which.

import { shownUnit, shownValue } from '../shared/display.js';
import { duration, fixed } from '../shared/format.js';

/** @typedef {import('./track.js').Track} Track */

/**
 * @typedef {Record<import('../shared/theme.js').Theme, string[]>} Palette  each step reads on its ground (3 : 1 at least)
 */

/** From blue to yellow in even steps of lightness. @type {Palette} */
const EVEN = {
  dark: ['#5a78c8', '#7089bd', '#8598b0', '#9aa8a1', '#b1b88e', '#c9c977', '#e3db5d', '#fff04a'],
  light: ['#0d2f6e', '#24406f', '#3b4f70', '#4f5b66', '#62664f', '#74703a', '#83771f', '#8f7a00'],
};
/** From sure to unsure: the colours of health. @type {Palette} */
const TRUST = {
  dark: ['#25b07c', '#55bb64', '#8cc24f', '#c4c445', '#ecbb42', '#f39a48', '#f27a55', '#ff6a6a'],
  light: ['#0b6b45', '#2f7526', '#577410', '#736f00', '#8a6300', '#9c5200', '#ab3a10', '#b3201a'],
};
const UNKNOWN_COLOR = { dark: '#8697a3', light: '#5c6b75' };
const STEPS = 8;
const FAST_MPS = 1.6;
/** Radius of the 95 % ellipse at the upper end of each step but the last. */
const RADII_M = [0.5, 1, 2, 5, 10, 20, 50];

/**
 * @typedef {object} Coloring
 * @property {string} key
 * @property {string} label
 * @property {Palette} palette
 * @property {(track: Track, i: number) => number} step  index into the palette, -1 unknown
 * @property {(track: Track) => [string, string]} ends  texts of the legend
 */

/** @type {Coloring[]} */
export const COLORINGS = [
  {
    key: 'uncertainty',
    label: 'Uncertainty',
    palette: TRUST,
    step: (track, i) => {
      const radius = track.majorM[i];
      if (Number.isNaN(radius)) return -1;
      let step = 0;
      while (step < RADII_M.length && radius > RADII_M[step]) step += 1;
      return step;
    },
    ends: () => [`\u2264 ${lengthText(RADII_M[0], 1)}`, `> ${lengthText(RADII_M[RADII_M.length - 1], 0)}`],
  },
  {
    key: 'speed',
    label: 'Speed',
    palette: EVEN,
    step: (track, i) => {
      const speed = track.speedMps[i];
      return Number.isNaN(speed) ? -1 : Math.min(STEPS - 1, Math.floor((speed / FAST_MPS) * STEPS));
    },
    ends: () => ['0', `\u2265 ${fixed(shownValue(FAST_MPS, 'm/s'), 1)} ${shownUnit('m/s')}`],
  },
  {
    key: 'time',
    label: 'Time',
    palette: EVEN,
    step: (track, i) => {
      const first = track.timeS[0];
      const span = track.timeS[track.length - 1] - first;
      return span > 0 ? Math.min(STEPS - 1, Math.floor(((track.timeS[i] - first) / span) * STEPS)) : 0;
    },
    ends: (track) => [
      track.length > 1 ? `${duration(track.timeS[track.length - 1] - track.timeS[0])} ago` : '-',
      'now',
    ],
  },
];

/**
 * @param {Coloring} coloring
 * @param {number} step
 * @param {import('../shared/theme.js').Theme} theme
 */
export function colorOf(coloring, step, theme) {
  return step < 0 ? UNKNOWN_COLOR[theme] : coloring.palette[theme][step];
}

/**
 * @param {number} metres
 * @param {number} decimals
 */
export function lengthText(metres, decimals) {
  return `${fixed(shownValue(metres, 'm'), decimals)} ${shownUnit('m')}`;
}
