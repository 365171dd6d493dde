// @ts-check
// Compass card: turns under a fixed lubber line; the number stands in its middle as text.

import { isKnown } from '../shared/format.js';
import { Instrument } from './instrument.js';
import { wake } from './ticker.js';

const DEG = Math.PI / 180;
const NAMES = ['N', '30', '60', 'E', '120', '150', 'S', '210', '240', 'W', '300', '330'];

export class Compass extends Instrument {
  /** @param {HTMLCanvasElement} canvas */
  constructor(canvas) {
    super(canvas, ['--line', '--dim', '--text', '--accent', '--fault', '--sunken']);
    this.heading = this.follow(true, 0.05);
    /** @type {number | null} the navigator's true heading, with two standard deviations to each side */
    this.estimateDeg = null;
    this.spreadDeg = 0;
  }

  /**
   * @param {number | null} headingDeg
   * @param {number | null} stdDeg
   */
  showEstimate(headingDeg, stdDeg) {
    const known = isKnown(headingDeg) && isKnown(stdDeg);
    const estimate = known ? headingDeg : null;
    const spread = known ? Math.min(180, 2 * stdDeg) : 0;
    if (estimate === this.estimateDeg && spread === this.spreadDeg) return;
    this.estimateDeg = estimate;
    this.spreadDeg = spread;
    wake(this);
  }

  /** @param {number | null} headingDeg */
  show(headingDeg) {
    if (headingDeg === this.heading.target) return;
    this.heading.aim(headingDeg);
    wake(this);
  }

  draw() {
    const { context: c, width: w, height: h } = this;
    const [line, dim, text, accent, fault, sunken] = this.colors;
    const known = this.heading.target !== null;
    const radius = Math.min(w, h) / 2 - 2;
    c.save();
    c.translate(w / 2, h / 2);
    c.fillStyle = sunken;
    c.strokeStyle = line;
    c.lineWidth = 1.5 * this.scale;
    c.beginPath();
    c.arc(0, 0, radius, 0, 2 * Math.PI);
    c.fill();
    c.stroke();
    if (known && this.estimateDeg !== null) this.drawSector(radius, accent);
    if (known) this.drawCard(radius, dim, text, fault);
    c.fillStyle = known ? accent : line;
    c.beginPath();
    c.moveTo(0, -radius + 12 * this.scale);
    c.lineTo(-7 * this.scale, -radius - 1);
    c.lineTo(7 * this.scale, -radius - 1);
    c.closePath();
    c.fill();
    c.restore();
  }

  /**
   * Where the true heading lies with 95 % probability, on the card.
   * @param {number} radius
   * @param {string} color
   */
  drawSector(radius, color) {
    const c = this.context;
    const middle = ((this.estimateDeg ?? 0) - this.heading.shown - 90) * DEG;
    const half = Math.max(this.spreadDeg, 0.75) * DEG;
    c.save();
    c.globalAlpha = 0.45;
    c.fillStyle = color;
    c.beginPath();
    c.arc(0, 0, radius, middle - half, middle + half);
    c.arc(0, 0, radius * 0.62, middle + half, middle - half, true);
    c.closePath();
    c.fill();
    c.restore();
  }

  /**
   * @param {number} radius
   * @param {string} dim
   * @param {string} text
   * @param {string} north
   */
  drawCard(radius, dim, text, north) {
    const c = this.context;
    c.textAlign = 'center';
    c.textBaseline = 'middle';
    for (let mark = 0; mark < 360; mark += 10) {
      c.save();
      c.rotate((mark - this.heading.shown) * DEG);
      const named = mark % 30 === 0;
      c.strokeStyle = named ? text : dim;
      c.lineWidth = (named ? 1.75 : 1) * this.scale;
      c.beginPath();
      c.moveTo(0, -radius + 2);
      c.lineTo(0, -radius + (named ? 10 : 7) * this.scale);
      c.stroke();
      if (named) {
        const cardinal = mark % 90 === 0;
        c.font = `${cardinal ? '700 ' : ''}${this.fontPx * (cardinal ? 1.2 : 0.9)}px system-ui, sans-serif`;
        c.fillStyle = mark === 0 ? north : cardinal ? text : dim;
        c.fillText(NAMES[mark / 30], 0, -radius + 12 * this.scale + this.fontPx * 0.75);
      }
      c.restore();
    }
  }
}
