// @ts-check
/** The whole dive beside the picture, newest on top: a thumb for what is seen, marks for contacts. */

import { setAttribute } from '../shared/dom.js';

/**
 * @typedef {object} TimelineView
 * @property {number} oldestS
 * @property {number} newestS
 * @property {number} topS
 * @property {number} windowS
 * @property {string} label of the time on top
 * @property {number[]} marks times of contacts
 */

export class Timeline {
  /**
   * @param {HTMLElement} root
   * @param {HTMLElement} thumb
   * @param {{onTop: (topS: number) => void, onKey: (windows: number) => void}} handlers
   */
  constructor(root, thumb, handlers) {
    this.root = root;
    this.thumb = thumb;
    this.handlers = handlers;
    /** @type {TimelineView | null} */
    this.view = null;
    this.marks = '';
    root.addEventListener('pointerdown', (event) => {
      root.setPointerCapture(event.pointerId);
      this.seek(event);
    });
    root.addEventListener('pointermove', (event) => {
      if (root.hasPointerCapture(event.pointerId)) this.seek(event);
    });
    root.addEventListener('keydown', (event) => this.key(event));
  }

  /** @param {PointerEvent} event */
  seek(event) {
    if (!this.view) return;
    const { oldestS, newestS, windowS } = this.view;
    const box = this.root.getBoundingClientRect();
    const share = (event.clientY - box.top) / box.height;
    // The middle of what is seen comes under the pointer.
    this.handlers.onTop(newestS - share * (newestS - oldestS) + windowS / 2);
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    const steps = {
      ArrowUp: -0.1,
      ArrowDown: 0.1,
      ArrowLeft: 0.1,
      ArrowRight: -0.1,
      PageUp: -0.9,
      PageDown: 0.9,
    };
    const windows = /** @type {Record<string, number>} */ (steps)[event.key];
    if (windows !== undefined) this.handlers.onKey(windows);
    else if (event.key === 'Home') this.handlers.onTop(-Infinity);
    else if (event.key === 'End') this.handlers.onTop(Infinity);
    else return;
    event.preventDefault();
  }

  /** @param {TimelineView} view */
  show(view) {
    this.view = view;
    const span = Math.max(view.newestS - view.oldestS, view.windowS);
    const top = Math.max(0, (view.newestS - view.topS) / span);
    const height = Math.min(1, view.windowS / span);
    this.thumb.style.top = `${(100 * Math.min(top, 1 - height * 0.5)).toFixed(2)}%`;
    this.thumb.style.height = `${(100 * height).toFixed(2)}%`;
    setAttribute(this.root, 'aria-valuemax', String(Math.round(span)));
    setAttribute(this.root, 'aria-valuenow', String(Math.round(view.topS - view.oldestS)));
    setAttribute(this.root, 'aria-valuetext', view.label);
    this.showMarks(view, span);
  }

  /** @param {TimelineView} view @param {number} span */
  showMarks(view, span) {
    const places = view.marks
      .map((timeS) => (100 * (view.newestS - timeS)) / span)
      .filter((p) => p >= 0 && p <= 100);
    const key = places.map((place) => place.toFixed(1)).join();
    if (key === this.marks) return;
    this.marks = key;
    const nodes = places.map((place) => {
      const node = document.createElement('i');
      node.style.top = `${place.toFixed(2)}%`;
      return node;
    });
    this.root.replaceChildren(this.thumb, ...nodes);
  }
}
