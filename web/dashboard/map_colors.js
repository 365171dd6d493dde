// @ts-check
// How the track is coloured: by time, uncertainty or speed, in a few steps, with a legend that says which is which.

import { shownUnit, shownValue } from '../shared/display.js';
import { duration, fixed } from '../shared/format.js';

/** @typedef {import('./track.js').Track} Track */

/** Steps of a perceptually even scale that reads on dark and light ground (cividis, its middle part). */
const EVEN = ['#31446b', '#4d5570', '#666970', '#7d7c78', '#958f78', '#b0a473', '#cbba69', '#e8d358'];
/** From sure to unsure: the colours of health, in even steps. */
const TRUST = ['#1f9e6e', '#4fae5c', '#87b94a', '#bcbb3f', '#e3b23c', '#ec8f3d', '#e5673f', '#d43d3d'];
const UNKNOWN_COLOR = '#8697a3';
const FAST_MPS = 1.6;
/** Radius of the 95 % ellipse at the upper end of each step but the last. */
const RADII_M = [0.5, 1, 2, 5, 10, 20, 50];

/**
 * @typedef {object} Coloring
 * @property {string} key
 * @property {string} label
 * @property {string[]} palette
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
      const at = RADII_M.findIndex((limit) => radius <= limit);
      return at < 0 ? RADII_M.length : at;
    },
    ends: () => [`\u2264 ${lengthText(RADII_M[0], 1)}`, `> ${lengthText(RADII_M[RADII_M.length - 1], 0)}`],
  },
  {
    key: 'speed',
    label: 'Speed',
    palette: EVEN,
    step: (track, i) => {
      const speed = track.speedMps[i];
      return Number.isNaN(speed)
        ? -1
        : Math.min(EVEN.length - 1, Math.floor((speed / FAST_MPS) * EVEN.length));
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
      return span > 0
        ? Math.min(EVEN.length - 1, Math.floor(((track.timeS[i] - first) / span) * EVEN.length))
        : 0;
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
 */
export function colorOf(coloring, step) {
  return step < 0 ? UNKNOWN_COLOR : coloring.palette[step];
}

/**
 * @param {number} metres
 * @param {number} decimals
 */
export function lengthText(metres, decimals) {
  return `${fixed(shownValue(metres, 'm'), decimals)} ${shownUnit('m')}`;
}
