// @ts-check
// Guided calibrations: what to do now, how far it is, how good the result is.

import { ask } from '../shared/dialog.js';
import { make, setText } from '../shared/dom.js';
import { dateTime, fixed, isKnown } from '../shared/format.js';
import { button, panel } from './panel.js';

/**
 * @typedef {object} KindView
 * @property {HTMLElement} root
 * @property {HTMLElement} title
 * @property {HTMLElement} result
 * @property {HTMLElement} instruction
 * @property {HTMLProgressElement} progress
 * @property {HTMLButtonElement} start
 * @property {HTMLButtonElement} finish
 * @property {HTMLButtonElement} cancel
 * @property {HTMLButtonElement} clear
 */

export class CalibrationPanel {
  /** @param {import('./assistant.js').Act} act */
  constructor(act) {
    this.act = act;
    /** @type {Map<string, KindView>} */
    this.views = new Map();
    this.list = make('div', { class: 'calibrations' });
    this.waiting = make('p', { class: 'hint', text: 'Waiting for the navigator' });
    this.root = panel(
      'calibration',
      'Calibration',
      'Kept on the vehicle. Repeat it after moving the IMU, batteries or anything of steel.',
      this.waiting,
      this.list,
    );
  }

  /** @param {unknown} kinds */
  show(kinds) {
    const known = Array.isArray(kinds) ? kinds : [];
    this.waiting.hidden = known.length > 0;
    const isBusy = known.some((kind) => kind?.state === 'running' || kind?.state === 'ready');
    for (const kind of known) this.showKind(kind, isBusy);
  }

  /**
   * @param {any} kind
   * @param {boolean} isBusy  one of them is under way: the others wait
   */
  showKind(kind, isBusy) {
    const view = this.views.get(kind.kind) ?? this.addKind(kind.kind);
    const running = kind.state === 'running' || kind.state === 'ready';
    view.root.dataset.state = String(kind.state);
    setText(view.title, String(kind.label ?? kind.kind));
    setText(view.result, resultText(kind));
    setText(view.instruction, String(kind.instruction ?? ''));
    view.progress.hidden = !running;
    view.progress.value = isKnown(kind.progress) ? kind.progress : 0;
    view.start.hidden = running;
    view.start.disabled = isBusy;
    setText(view.start, kind.state === 'done' ? 'Repeat' : 'Start');
    view.finish.hidden = !running;
    view.finish.disabled = kind.state !== 'ready';
    view.cancel.hidden = !running;
    view.clear.hidden = running || kind.state !== 'done';
  }

  /** @param {string} kind */
  addKind(kind) {
    const act = (/** @type {string} */ verb, /** @type {string} */ busy) =>
      void this.act({ action: `${verb}_calibration`, kind }, busy);
    const title = make('h3');
    const result = make('p', { class: 'hint' });
    const instruction = make('p', { class: 'instruction', role: 'status' });
    const progress = make('progress', { max: 1, 'aria-label': 'Progress' });
    const start = button('Start', () => act('start', 'Starting'));
    const finish = button('Take it', () => act('finish', 'Fitting'), 'primary');
    const cancel = button('Cancel', () => act('cancel', 'Cancelling'));
    const clear = button('Clear', () => void this.clear(kind, title.textContent ?? kind), 'danger');
    const root = make(
      'section',
      { class: 'calibration', 'data-kind': kind },
      make('div', { class: 'calibration-text' }, title, result, instruction, progress),
      make('div', { class: 'tools' }, start, finish, cancel, clear),
    );
    this.list.append(root);
    const view = { root, title, result, instruction, progress, start, finish, cancel, clear };
    this.views.set(kind, view);
    return view;
  }

  /**
   * @param {string} kind
   * @param {string} label
   */
  async clear(kind, label) {
    const sure = await ask({
      title: `Clear the calibration "${label}"?`,
      lines: ['The navigator goes on without it, with a larger uncertainty, until it is made again.'],
      action: 'Clear',
      danger: true,
    });
    if (sure) await this.act({ action: 'clear_calibration', kind }, 'Clearing');
  }
}

/**
 * @param {any} kind
 * @returns {string}
 */
export function resultText(kind) {
  if (!isKnown(kind.residual)) return kind.state === 'done' ? 'Made, residual unknown' : 'Not made yet';
  const made = isKnown(kind.made_unix_s) ? `, ${dateTime(kind.made_unix_s)}` : '';
  return `Residual ${fixed(kind.residual, decimalsFor(kind.residual))} ${kind.unit ?? ''}${made}`;
}

/** @param {number} value */
function decimalsFor(value) {
  const size = Math.abs(value);
  return size >= 10 ? 1 : size >= 1 ? 2 : size >= 0.01 ? 3 : 5;
}
