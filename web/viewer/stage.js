// @ts-check
/** The picture and its axes in one element: sizes, device pixels, colours. Shared by the page and the widget. */

import { colors, onThemeChange } from '../shared/theme.js';
import { Overlay } from './overlay.js';
import { paneAt } from './ranging.js';
import { Waterfall } from './waterfall.js';

/** @typedef {import('./overlay.js').Spot} Spot */
/** @typedef {import('./ranging.js').Pane} Pane */

export class Stage {
  /**
   * @param {HTMLElement} element
   * @param {HTMLCanvasElement} picture
   * @param {HTMLCanvasElement} axes
   * @param {ConstructorParameters<typeof Waterfall>[1]} stored
   */
  constructor(element, picture, axes, stored) {
    this.element = element;
    this.picture = picture;
    this.axes = axes;
    this.waterfall = new Waterfall(picture, stored);
    this.overlay = new Overlay(axes, this.waterfall);
    this.dpr = 1;
    /** Called before the axes of a frame are drawn. @type {() => void} */
    this.beforeAxes = () => {};
    /** Called after each drawn frame. @type {() => void} */
    this.onDrawn = () => {};
    this.waterfall.onDrawn = () => {
      this.beforeAxes();
      this.overlay.draw();
      this.onDrawn();
    };
    this.readColors();
    onThemeChange(() => this.readColors());
    new ResizeObserver(() => this.resize()).observe(element);
    this.followPixelRatio();
    this.resize();
  }

  readColors() {
    const [nothing, hatch] = colors('--sunken', '--off');
    this.waterfall.setColors(rgbOf(nothing), rgbOf(hatch));
    this.overlay.readColors();
  }

  /** A window moved to another screen, or the page zoomed: same CSS size, other pixels. */
  followPixelRatio() {
    const query = matchMedia(`(resolution: ${window.devicePixelRatio}dppx)`);
    query.addEventListener(
      'change',
      () => {
        this.resize();
        this.followPixelRatio();
      },
      { once: true },
    );
  }

  resize() {
    const dpr = window.devicePixelRatio || 1;
    const { width, height } = this.element.getBoundingClientRect();
    if (width < 2 || height < 2) return;
    this.dpr = dpr;
    const deviceWidth = Math.round(width * dpr);
    this.overlay.resize(deviceWidth, Math.round(height * dpr), dpr);
    const ruler = this.overlay.rulerPx;
    const deviceHeight = Math.round((height - ruler) * dpr);
    this.axes.style.width = `${deviceWidth / dpr}px`;
    this.axes.style.height = `${Math.round(height * dpr) / dpr}px`;
    this.picture.style.top = `${ruler}px`;
    this.picture.style.width = `${deviceWidth / dpr}px`;
    this.picture.style.height = `${deviceHeight / dpr}px`;
    this.waterfall.resize(deviceWidth, deviceHeight, dpr);
  }

  /**
   * @param {number} clientX
   * @param {number} clientY
   * @returns {{x: number, y: number, pane: Pane | null}} device pixels of the picture
   */
  toPicture(clientX, clientY) {
    const box = this.element.getBoundingClientRect();
    const x = (clientX - box.left) * this.dpr;
    const y = (clientY - box.top - this.overlay.rulerPx) * this.dpr;
    return { x, y, pane: paneAt(this.waterfall.panes, x, y) };
  }

  /**
   * @param {number} clientX
   * @param {number} clientY
   * @returns {Spot | null}
   */
  spotAt(clientX, clientY) {
    const { x, y, pane } = this.toPicture(clientX, clientY);
    if (!pane) return null;
    return {
      channel: pane.channel,
      rangeM: this.waterfall.rangeAt(pane, x),
      timeS: this.waterfall.timeAtY(pane, y),
    };
  }
}

/** @param {string} color as #rrggbb @returns {Float32Array} 0..1 */
export function rgbOf(color) {
  const value = parseInt(color.slice(1, 7), 16) || 0;
  return new Float32Array([(value >> 16) / 255, ((value >> 8) & 255) / 255, (value & 255) / 255]);
}
