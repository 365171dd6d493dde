// @ts-check
/** Help, confirmation and the short message at the bottom. */

import { byId, make, setText } from '../shared/dom.js';
import { KEYS } from './keyboard.js';

/** @param {HTMLDialogElement} dialog */
function closeButton(dialog) {
  return make('button', {
    class: 'icon-button',
    type: 'button',
    'aria-label': 'Close',
    text: '\u2715',
    on: { click: () => dialog.close() },
  });
}

const POINTER_HELP = [
  ['Click', 'Name a contact'],
  ['Drag', 'Measure'],
  ['Shift-drag', 'Move through time and range'],
  ['Wheel', 'Older and newer pings'],
  ['Ctrl-wheel', 'Closer and wider in range'],
  ['Shift-wheel', 'Fewer and more seconds'],
  ['One finger', 'Move; with Measure chosen: measure'],
  ['Two fingers', 'Zoom range and time'],
  ['Tap', 'Cursor; Contact then names it'],
];

export function showHelp() {
  const dialog = byId('help', HTMLDialogElement);
  if (!dialog.firstChild) {
    const row = (/** @type {string} */ shown, /** @type {string} */ does) =>
      make(
        'div',
        {},
        make(
          'dt',
          {},
          ...shown.split('  ').flatMap((key, k) => [k ? ' ' : null, make('kbd', { text: key })]),
        ),
        make('dd', { text: does }),
      );
    dialog.append(
      closeButton(dialog),
      make('h2', { id: 'help-title', text: 'Keys and gestures' }),
      make('dl', { class: 'keys' }, ...KEYS.map((key) => row(key.shown, key.does))),
      make('h2', { text: 'Mouse and touch' }),
      make('dl', { class: 'keys' }, ...POINTER_HELP.map(([shown, does]) => row(shown, does))),
      make('p', {
        class: 'hint',
        text: 'Hatched: pings or parts of pings that were lost. Ranges are slant ranges from the sonar.',
      }),
    );
  }
  dialog.showModal();
}

/**
 * @param {string} title
 * @param {string} text
 * @param {string} action label of the button that does it
 * @returns {Promise<boolean>}
 */
export function confirmed(title, text, action) {
  const dialog = byId('confirm', HTMLDialogElement);
  return new Promise((resolve) => {
    let answer = false;
    const yes = make('button', {
      class: 'button danger',
      type: 'button',
      text: action,
      on: {
        click: () => {
          answer = true;
          dialog.close();
        },
      },
    });
    const no = make('button', {
      class: 'button',
      type: 'button',
      text: 'Cancel',
      on: { click: () => dialog.close() },
    });
    dialog.replaceChildren(
      make('h2', { id: 'confirm-title', text: title }),
      make('p', { text }),
      make('div', { class: 'buttons' }, no, yes),
    );
    dialog.addEventListener('close', () => resolve(answer), { once: true });
    dialog.showModal();
    no.focus();
  });
}

let toastTimer = 0;

/** @param {string} text @param {'ok' | 'fault'} [state] */
export function toast(text, state = 'ok') {
  const node = byId('toast', HTMLElement);
  setText(node, text);
  node.dataset.state = state;
  node.hidden = false;
  clearTimeout(toastTimer);
  toastTimer = window.setTimeout(() => (node.hidden = true), state === 'fault' ? 9000 : 3500);
}
