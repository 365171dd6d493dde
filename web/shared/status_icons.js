// @ts-check
// A shape for each state, so that no state is told by colour alone.

import { make } from './dom.js';

/** @typedef {'ok' | 'warn' | 'fault' | 'off' | 'unknown'} State */

/** @type {Record<State, string>} */
export const STATE_WORDS = { ok: 'OK', warn: 'Check', fault: 'Fault', off: 'Off', unknown: 'Unknown' };

/** @type {Record<State, string>} */
const SHAPES = {
  ok: '<circle cx="8" cy="8" r="6.5"/><path d="M5 8.3l2.1 2.1L11 6.2"/>',
  warn: '<path d="M8 1.8L15 14H1z"/><path d="M8 6.4v3.4M8 11.9v.1"/>',
  fault:
    '<path d="M5.2 1.3h5.6l3.9 3.9v5.6l-3.9 3.9H5.2l-3.9-3.9V5.2z"/><path d="M5.8 5.8l4.4 4.4M10.2 5.8l-4.4 4.4"/>',
  off: '<circle cx="8" cy="8" r="6.5"/><path d="M4.8 8h6.4"/>',
  unknown:
    '<circle cx="8" cy="8" r="6.5" stroke-dasharray="3 2.6"/><path d="M6.3 6.4a1.8 1.8 0 1 1 2.4 1.7c-.5.2-.7.5-.7 1M8 11.4v.1"/>',
};

/**
 * Anything a server may send, as one of the five states.
 * @param {unknown} value
 * @returns {State}
 */
export function asState(value) {
  return typeof value === 'string' && Object.hasOwn(SHAPES, value) ? /** @type {State} */ (value) : 'unknown';
}

/** An empty icon; `showState` fills it. */
export function stateIcon() {
  const icon = make('span', { class: 'state-icon', 'aria-hidden': 'true' });
  showState(icon, 'unknown');
  return icon;
}

/**
 * @param {HTMLElement} icon
 * @param {State} state
 */
export function showState(icon, state) {
  if (icon.dataset.state === state) return;
  icon.dataset.state = state;
  icon.innerHTML = `<svg viewBox="0 0 16 16">${SHAPES[state]}</svg>`;
}
