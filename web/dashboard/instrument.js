// @ts-check
// A canvas that stays sharp at any pixel ratio, follows the theme and draws only when something changed.

import { colors, onThemeChange } from '../shared/theme.js';
import { Follower } from './motion.js';
import { wake } from './ticker.js';

/** @type {MediaQueryList | null} */
let reducedMotion = null;

export class Instrument {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {string[]} colorNames  custom properties to have at hand while drawing
   */
  constructor(canvas, colorNames) {
    this.canvas = canvas;
    const context = canvas.getContext('2d');
    if (!context) throw new Error('this browser has no 2D canvas');
    this.context = context;
    this.colorNames = colorNames;
    this.colors = colors(...colorNames);
    this.width = 0;
    this.height = 0;
    this.fontPx = 12;
    /** By how much lines grow on a big screen. */
    this.scale = 1;
    /** @type {Follower[]} */
    this.followers = [];
    new ResizeObserver(() => this.resize()).observe(canvas);
    onThemeChange(() => {
      this.colors = colors(...this.colorNames);
      wake(this);
    });
  }

  get atOnce() {
    reducedMotion ??= matchMedia('(prefers-reduced-motion: reduce)');
    return reducedMotion.matches;
  }

  resize() {
    const ratio = window.devicePixelRatio || 1;
    this.width = this.canvas.clientWidth;
    this.height = this.canvas.clientHeight;
    this.fontPx = parseFloat(getComputedStyle(this.canvas).fontSize) || 12;
    this.scale = this.fontPx / 12;
    this.canvas.width = Math.round(this.width * ratio);
    this.canvas.height = Math.round(this.height * ratio);
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
    wake(this);
  }

  /**
   * A pointer of this instrument.
   * @param {boolean} isAngle
   * @param {number} tolerance  near enough to rest
   */
  follow(isAngle, tolerance) {
    const follower = new Follower(isAngle, tolerance);
    this.followers.push(follower);
    return follower;
  }

  /**
   * @param {number} elapsedS
   * @returns {boolean} whether anything still moves
   */
  frame(elapsedS) {
    let moving = false;
    for (const follower of this.followers) moving = follower.step(elapsedS, this.atOnce) || moving;
    if (this.width > 0 && this.height > 0) {
      this.context.clearRect(0, 0, this.width, this.height);
      this.draw();
    }
    return moving;
  }

  draw() {}
}
