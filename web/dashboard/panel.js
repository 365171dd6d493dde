// @ts-check
// A titled card of the navigation page.

import { make } from '../shared/dom.js';

/**
 * @param {string} id
 * @param {string} title
 * @param {string} hint  what it is for, in one sentence
 * @param {...Node} nodes
 */
export function panel(id, title, hint, ...nodes) {
  return make(
    'section',
    { class: `card panel-${id}`, 'aria-labelledby': `panel-${id}-title` },
    make('header', { class: 'card-head' }, make('h2', { text: title, id: `panel-${id}-title` })),
    make('p', { class: 'hint', text: hint }),
    ...nodes,
  );
}

/**
 * @param {string} text
 * @param {() => void} click
 * @param {string} [kind]  further class
 */
export function button(text, click, kind = '') {
  return make('button', { class: `button ${kind}`.trim(), type: 'button', text, on: { click } });
}
