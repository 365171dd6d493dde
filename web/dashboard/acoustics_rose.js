// @ts-check
// Where the transmitter is, seen from the vehicle: a rose from above, bow up, and a half circle from the side.

import { isKnown } from '../shared/format.js';
import { Instrument } from './instrument.js';
import { wake } from './ticker.js';

const DEG = Math.PI / 180;
/** The least half width of a sector that can still be seen. */
const FINEST_DEG = 1.2;

export class AcousticsRose extends Instrument {
  /** @param {HTMLCanvasElement} canvas */
  constructor(canvas) {
    super(canvas, ['--line', '--dim', '--text', '--plot-sound', '--sunken', '--vehicle', '--stale']);
    this.azimuth = this.follow(true, 0.1);
    this.elevation = this.follow(false, 0.1);
    this.spreadDeg = 0;
    this.trusted = true;
  }

  /**
   * @param {number | null} azimuthDeg  right positive
   * @param {number | null} elevationDeg  down positive
   * @param {number | null} stdDeg
   * @param {boolean} trusted
   */
  show(azimuthDeg, elevationDeg, stdDeg, trusted) {
    const known = isKnown(azimuthDeg) && isKnown(elevationDeg);
    this.azimuth.aim(known ? azimuthDeg : null);
    this.elevation.aim(known ? elevationDeg : null);
    this.spreadDeg = isKnown(stdDeg) ? Math.min(180, 2 * stdDeg) : 0;
    this.trusted = trusted;
    wake(this);
  }

  draw() {
    const { context: c, width: w, height: h } = this;
    const side = Math.min(h, w * 0.6);
    const radius = side / 2 - this.fontPx * 1.35;
    c.save();
    c.translate(side / 2, h / 2);
    this.drawRose(radius);
    c.restore();
    const depth = Math.min(radius, (w - side) * 0.78);
    c.save();
    c.translate(side + (w - side) * 0.16, h / 2);
    this.drawSide(depth);
    c.restore();
  }

  /** @param {number} radius */
  drawRose(radius) {
    const c = this.context;
    const [line, dim, text, sound, sunken, vehicle, old] = this.colors;
    this.disc(radius, 0, 360, sunken, line);
    const known = this.azimuth.target !== null;
    c.textAlign = 'center';
    c.textBaseline = 'middle';
    for (let mark = 0; mark < 360; mark += 15) {
      const named = mark % 90 === 0;
      c.strokeStyle = named ? text : dim;
      c.lineWidth = (named ? 1.75 : 1) * this.scale;
      const [sin, cos] = [Math.sin(mark * DEG), Math.cos(mark * DEG)];
      const inner = radius - (mark % 45 === 0 ? 7 : 4) * this.scale;
      c.beginPath();
      c.moveTo(radius * sin, -radius * cos);
      c.lineTo(inner * sin, -inner * cos);
      c.stroke();
    }
    c.fillStyle = dim;
    c.font = `${this.fontPx * 0.9}px system-ui, sans-serif`;
    const outside = radius + this.fontPx * 0.75;
    c.fillText('ahead', 0, -outside);
    c.fillText('astern', 0, outside);
    if (known) this.drawSector(radius, this.azimuth.shown - 90, this.trusted ? sound : old);
    const size = radius / 60;
    c.fillStyle = vehicle;
    c.strokeStyle = text;
    c.lineWidth = 1.25 * this.scale;
    c.beginPath();
    c.moveTo(0, -13 * size);
    c.lineTo(8 * size, 9 * size);
    c.lineTo(0, 5 * size);
    c.lineTo(-8 * size, 9 * size);
    c.closePath();
    c.fill();
    c.stroke();
  }

  /** @param {number} radius */
  drawSide(radius) {
    const c = this.context;
    const [line, dim, text, sound, sunken, vehicle, old] = this.colors;
    this.disc(radius, -90, 90, sunken, line);
    c.font = `${this.fontPx * 0.9}px system-ui, sans-serif`;
    c.textAlign = 'left';
    c.textBaseline = 'middle';
    for (let mark = -90; mark <= 90; mark += 30) {
      const [sin, cos] = [Math.sin(mark * DEG), Math.cos(mark * DEG)];
      const inner = radius - (mark % 90 === 0 ? 7 : 4) * this.scale;
      c.strokeStyle = mark === 0 ? text : dim;
      c.lineWidth = 1.25 * this.scale;
      c.beginPath();
      c.moveTo(radius * cos, radius * sin);
      c.lineTo(inner * cos, inner * sin);
      c.stroke();
    }
    c.fillStyle = dim;
    c.textAlign = 'center';
    c.fillText('up', 0, -radius - this.fontPx * 0.75);
    c.fillText('down', 0, radius + this.fontPx * 0.75);
    if (this.elevation.target !== null)
      this.drawSector(radius, this.elevation.shown, this.trusted ? sound : old);
    const size = radius / 60;
    c.fillStyle = vehicle;
    c.strokeStyle = text;
    c.lineWidth = 1.25 * this.scale;
    c.beginPath();
    c.rect(-9 * size, -4 * size, 18 * size, 8 * size);
    c.fill();
    c.stroke();
  }

  /**
   * @param {number} radius
   * @param {number} fromDeg
   * @param {number} toDeg
   * @param {string} fill
   * @param {string} edge
   */
  disc(radius, fromDeg, toDeg, fill, edge) {
    const c = this.context;
    c.fillStyle = fill;
    c.strokeStyle = edge;
    c.lineWidth = 1.5 * this.scale;
    c.beginPath();
    c.arc(0, 0, radius, fromDeg * DEG, toDeg * DEG);
    c.closePath();
    c.fill();
    c.stroke();
  }

  /**
   * Where the direction lies with 95 % probability, and a ray along its middle.
   * @param {number} radius
   * @param {number} middleDeg  of the canvas: 0 right, 90 down
   * @param {string} color
   */
  drawSector(radius, middleDeg, color) {
    const c = this.context;
    const half = Math.max(this.spreadDeg, FINEST_DEG) * DEG;
    const middle = middleDeg * DEG;
    c.save();
    c.fillStyle = color;
    c.globalAlpha = 0.35;
    c.beginPath();
    c.moveTo(0, 0);
    c.arc(0, 0, radius, middle - half, middle + half);
    c.closePath();
    c.fill();
    c.globalAlpha = 1;
    c.strokeStyle = color;
    c.lineWidth = 2 * this.scale;
    if (!this.trusted) c.setLineDash([4, 3]);
    c.beginPath();
    c.moveTo(0, 0);
    c.lineTo(radius * Math.cos(middle), radius * Math.sin(middle));
    c.stroke();
    c.setLineDash([]);
    c.beginPath();
    c.arc(radius * Math.cos(middle), radius * Math.sin(middle), 4 * this.scale, 0, 2 * Math.PI);
    c.fill();
    c.restore();
  }
}
