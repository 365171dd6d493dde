// @ts-check
// A column of water: surface on top, the vehicle in it, the deepest point of the dive marked.

import { shownValue } from '../shared/display.js';
import { Instrument } from './instrument.js';
import { wake } from './ticker.js';

const SCALES = [5, 10, 20, 30, 50, 100, 200, 300, 500, 1000, 5000, 10000, 40000];

/**
 * The smallest full scale that leaves some water below the deepest point.
 * @param {number} deepest  in the unit shown
 */
export function fullScale(deepest) {
  return SCALES.find((scale) => deepest <= scale * 0.92) ?? SCALES[SCALES.length - 1];
}

export class DepthGauge extends Instrument {
  /** @param {HTMLCanvasElement} canvas */
  constructor(canvas) {
    super(canvas, ['--sunken', '--line', '--dim', '--plot-depth', '--text', '--sky']);
    this.depth = this.follow(false, 0.002);
    /** @type {number | null} */
    this.deepestM = null;
  }

  /** @param {number | null} depthM */
  show(depthM) {
    if (depthM === this.depth.target) return;
    this.depth.aim(depthM);
    this.remember(depthM);
    wake(this);
  }

  /**
   * A depth of this dive, now or earlier.
   * @param {number | null} depthM
   */
  remember(depthM) {
    if (depthM !== null) this.deepestM = Math.max(this.deepestM ?? depthM, depthM);
  }

  draw() {
    const { context: c, width: w, height: h } = this;
    const [sunken, line, dim, accent, text, water] = this.colors;
    const scale = fullScale(shownValue(this.deepestM, 'm') ?? 0);
    const top = this.fontPx * 0.7;
    const bottom = h - this.fontPx * 0.7;
    const labels = this.fontPx * 3.3;
    const place = (/** @type {number} */ shown) =>
      top + (Math.max(0, Math.min(scale, shown)) / scale) * (bottom - top);
    const y = (/** @type {number} */ depthM) => place(shownValue(depthM, 'm'));
    c.fillStyle = sunken;
    c.fillRect(labels, top, w - labels, bottom - top);
    if (this.depth.target !== null) {
      c.globalAlpha = 0.35;
      c.fillStyle = water;
      c.fillRect(labels, top, w - labels, y(this.depth.shown) - top);
      c.globalAlpha = 1;
    }
    c.font = `${this.fontPx}px system-ui, sans-serif`;
    c.textAlign = 'right';
    c.textBaseline = 'middle';
    for (let i = 0; i <= 10; i += 1) {
      const markY = place((scale * i) / 10);
      c.strokeStyle = line;
      c.lineWidth = 1;
      c.beginPath();
      c.moveTo(labels, markY);
      c.lineTo(labels + (i % 5 === 0 ? w - labels : 6), markY);
      c.stroke();
      c.fillStyle = dim;
      if (i % 5 === 0) c.fillText(String((scale * i) / 10), labels - 6, markY);
    }
    if (this.depth.target !== null)
      this.drawVehicle(y(this.depth.shown), y(this.deepestM ?? 0), labels, accent, text);
  }

  /**
   * @param {number} atY
   * @param {number} deepestY
   * @param {number} left
   * @param {string} accent
   * @param {string} text
   */
  drawVehicle(atY, deepestY, left, accent, text) {
    const { context: c, width: w } = this;
    c.strokeStyle = text;
    c.lineWidth = 1;
    c.setLineDash([3, 3]);
    c.beginPath();
    c.moveTo(left, deepestY);
    c.lineTo(w, deepestY);
    c.stroke();
    c.setLineDash([]);
    c.strokeStyle = c.fillStyle = accent;
    c.lineWidth = 3;
    c.beginPath();
    c.moveTo(left, atY);
    c.lineTo(w, atY);
    c.stroke();
    c.beginPath();
    c.moveTo(left + 1, atY);
    c.lineTo(left - 6, atY - 5);
    c.lineTo(left - 6, atY + 5);
    c.fill();
  }
}
