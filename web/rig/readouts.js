// @ts-check
// What is said beside the picture: the truth with its uncertainty, margins, servos.

import { make } from '../shared/dom.js';
import { signed } from '../shared/format.js';

/** @type {Record<string, string>} */
const ROOM_TO = {
  axis: 'a limit of an axis',
  reach: "the end of a rod's reach",
  servo: "the end of a servo's range",
  joint: 'the largest tilt of a ball joint',
  legs: 'rods that touch',
  arms: 'a rod that touches an arm',
};
const AXES = ['x', 'y', 'z', 'roll', 'pitch', 'yaw'];

/**
 * @typedef {object} PlatformFacts
 * @property {(number | null)[]} servos_deg
 * @property {{limit: string, words: string, share: number | null}[]} margins  least first
 * @property {string | null} broken  the limit it breaks, in words
 */

/**
 * @param {HTMLTableElement} table
 * @param {number[]} tool  x, y, z in mm, roll, pitch, yaw in degrees
 * @param {(number | null)[] | null} std  of the same; null while it is not computed
 */
export function showTruth(table, tool, std) {
  table.replaceChildren(
    ...AXES.map((axis, k) => {
      const decimals = k < 3 ? 1 : 2;
      const spread = std?.[k];
      return make(
        'tr',
        {},
        make('th', { scope: 'row', text: axis }),
        make('td', { text: signed(tool[k], decimals) }),
        make('td', { text: typeof spread === 'number' ? `±${spread.toFixed(decimals)}` : '-' }),
        make('td', { text: k < 3 ? 'mm' : '°' }),
      );
    }),
  );
}

/**
 * @param {HTMLElement} box
 * @param {PlatformFacts[]} platforms  base to top
 */
export function showMargins(box, platforms) {
  box.replaceChildren(
    ...platforms
      .map((platform, place) => {
        const least = platform.margins[0];
        const share = platform.broken || least.share === null ? 0 : Math.max(0, Math.min(1, least.share));
        const state = platform.broken ? 'fault' : share < 0.15 ? 'warn' : 'ok';
        const fill = make('div', {});
        fill.style.width = `${Math.round(100 * share)}%`;
        const servos = platform.servos_deg
          .map((angle) => (angle === null ? '-' : signed(angle, 1)))
          .join(' ');
        return make(
          'div',
          { class: 'platform' },
          make('h3', {
            text: `Platform ${place + 1}${place === 0 ? ', base' : place === platforms.length - 1 ? ', top' : ''}`,
          }),
          make('div', { class: 'bar', dataset: { state } }, fill),
          make('p', {
            text:
              platform.broken ??
              `${Math.round(100 * share)} % of the room at home is left to ${ROOM_TO[least.limit] ?? least.words}`,
          }),
          make('p', { class: 'servos', text: `${servos} °` }),
        );
      })
      .reverse(),
  );
}
