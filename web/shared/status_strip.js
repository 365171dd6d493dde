// @ts-check
// The row of named chips on top of both pages. A chip opens with its cause and its cure.

import { inShownUnits } from './display.js';
import { age, isKnown } from './format.js';
import { make, setAttribute, setText } from './dom.js';
import { STATE_WORDS, asState, showState, stateIcon } from './status_icons.js';

/**
 * @typedef {import('./status_icons.js').State} State
 * @typedef {{id: string, label: string, state: string, text?: string | null, cause?: string | null,
 *   cure?: string | null, age_s?: number | null, parts?: Array<[string, string]>}} ChipData  parts: what else is
 *   known, or what a chip stands for
 * @typedef {{item: HTMLLIElement, button: HTMLButtonElement, icon: HTMLElement, label: HTMLElement,
 *   text: HTMLElement, data: ChipData}} ChipView
 */

/** For a phone, where a name of ten letters has no room. @type {Record<string, string>} */
const SHORT = { navigation: 'Nav', acoustics: 'Sound' };

/**
 * What is shown before, or without, any word from the services.
 * @param {Array<[string, string]>} names  id and label
 * @returns {ChipData[]}
 */
export function unknownChips(names) {
  return names.map(([id, label]) => ({ id, label, state: 'unknown', text: '-' }));
}

/**
 * Lines of the opened chip: never empty, whatever the service left out.
 * @param {ChipData} chip
 * @returns {Array<[string, string]>}
 */
export function detailLines(chip) {
  /** @type {Array<[string, string]>} */
  const lines = [['State', inShownUnits(chip.text || STATE_WORDS[asState(chip.state)])]];
  if (chip.cause) lines.push(['Cause', chip.cause]);
  if (chip.cure) lines.push(['Cure', chip.cure]);
  if (isKnown(chip.age_s)) lines.push(['Last data', `${age(chip.age_s)} ago`]);
  return lines.concat((chip.parts ?? []).map(([term, value]) => [term, inShownUnits(value)]));
}

/**
 * What shows while the pointer rests on a chip: its whole text, which may be cut off, and what is behind it. No ages: a
 * hint that changes is shown anew each time.
 * @param {ChipData} chip
 */
export function hintOf(chip) {
  const lines = detailLines({ ...chip, age_s: null });
  return [
    `${chip.label}: ${lines[0][1]}`,
    ...lines.slice(1).map(([term, value]) => `${term}: ${value}`),
  ].join('\n');
}

export class StatusStrip {
  /**
   * @param {HTMLElement} root
   * @param {ChipData[]} chips  the chips to reserve places for
   */
  constructor(root, chips) {
    this.root = root;
    root.classList.add('status-strip');
    this.list = make('ul', { 'aria-label': 'Status' });
    this.detail = make('div', {
      class: 'chip-detail',
      role: 'dialog',
      id: `${root.id || 'strip'}-detail`,
      tabindex: '-1',
    });
    this.detail.hidden = true;
    root.append(this.list, this.detail);
    /** @type {Map<string, ChipView>} */
    this.views = new Map();
    /** @type {string | null} */
    this.openId = null;
    this.update(chips);
    root.addEventListener('keydown', (event) => event.key === 'Escape' && this.close(true));
    document.addEventListener('pointerdown', (event) => {
      if (event.target instanceof Node && !root.contains(event.target)) this.close(false);
    });
  }

  /** @param {ChipData[]} chips */
  update(chips) {
    for (const chip of chips) {
      const view = this.views.get(chip.id) ?? this.addView(chip.id);
      view.data = chip;
      const state = asState(chip.state);
      const text = inShownUnits(chip.text || STATE_WORDS[state]);
      setAttribute(view.button, 'data-state', state);
      showState(view.icon, state);
      setText(view.label, chip.label);
      setText(view.text, text);
      setAttribute(view.button, 'title', hintOf(chip));
      setAttribute(view.button, 'aria-label', `${chip.label}: ${STATE_WORDS[state]}. ${text}`);
    }
    if (this.openId) this.fillDetail();
  }

  /**
   * Greys the strip out: what it says is no longer known to hold.
   * @param {boolean} stale
   */
  setStale(stale) {
    this.root.classList.toggle('stale', stale);
  }

  /** @param {string} id */
  addView(id) {
    const button = make('button', {
      class: 'chip',
      type: 'button',
      dataset: { chip: id },
      'aria-expanded': 'false',
      'aria-controls': this.detail.id,
      on: { click: () => (this.openId === id ? this.close(false) : this.open(id)) },
    });
    const icon = stateIcon();
    const label = make('span', { class: 'chip-label', dataset: SHORT[id] ? { short: SHORT[id] } : {} });
    const text = make('span', { class: 'chip-text' });
    button.append(icon, label, text);
    const item = make('li', { dataset: { part: id } }, button);
    this.list.append(item);
    const data = { id, label: id, state: 'unknown' };
    const view = { item, button, icon, label, text, data };
    this.views.set(id, view);
    return view;
  }

  /** @param {string} id */
  open(id) {
    const view = this.views.get(id);
    if (!view) return;
    this.close(false);
    this.openId = id;
    setAttribute(view.button, 'aria-expanded', 'true');
    this.fillDetail();
    this.detail.hidden = false;
    const room = this.root.clientWidth - this.detail.offsetWidth;
    this.detail.style.left = `${Math.max(0, Math.min(view.item.offsetLeft, room))}px`;
    this.detail.style.top = `${view.item.offsetTop + view.item.offsetHeight + 4}px`;
  }

  /** @param {boolean} returnFocus */
  close(returnFocus) {
    if (!this.openId) return;
    const view = this.views.get(this.openId);
    this.openId = null;
    this.detail.hidden = true;
    if (!view) return;
    setAttribute(view.button, 'aria-expanded', 'false');
    if (returnFocus) view.button.focus();
  }

  fillDetail() {
    const view = this.openId ? this.views.get(this.openId) : undefined;
    if (!view) return;
    const key = JSON.stringify([view.data.label, view.data.state, ...detailLines(view.data)]);
    if (this.detail.dataset.key === key) return;
    this.detail.dataset.key = key;
    const icon = stateIcon();
    showState(icon, asState(view.data.state));
    const close = make('button', {
      class: 'icon-button close',
      type: 'button',
      'aria-label': 'Close',
      text: '\u2715',
      on: { click: () => this.close(true) },
    });
    const list = make('dl');
    for (const [term, value] of detailLines(view.data))
      list.append(make('dt', { text: term }), make('dd', { text: value }));
    const hadFocus = this.detail.contains(document.activeElement);
    this.detail.replaceChildren(make('h3', {}, icon, view.data.label), list, close);
    this.detail.setAttribute('aria-label', `${view.data.label}: cause and cure`);
    if (hadFocus) close.focus();
  }
}
