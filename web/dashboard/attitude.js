// @ts-check
// Artificial horizon: the world moves, the vehicle stays.

import { Instrument } from './instrument.js';
import { wake } from './ticker.js';

const DEG = Math.PI / 180;
/** Shares of the width: the ladder and its numbers stay between the wings. */
const LADDER = 0.1;
const WING_FROM = 0.3;
const WING_TO = 0.44;
const ROLL_MARKS = [-60, -45, -30, -20, -10, 0, 10, 20, 30, 45, 60];

export class Attitude extends Instrument {
  /** @param {HTMLCanvasElement} canvas */
  constructor(canvas) {
    super(canvas, ['--sky', '--ground', '--horizon', '--vehicle', '--line', '--sunken', '--dim']);
    this.roll = this.follow(true, 0.02);
    this.pitch = this.follow(false, 0.02);
  }

  /**
   * @param {number | null} rollDeg
   * @param {number | null} pitchDeg
   */
  show(rollDeg, pitchDeg) {
    if (rollDeg === this.roll.target && pitchDeg === this.pitch.target) return;
    this.roll.aim(rollDeg);
    this.pitch.aim(pitchDeg);
    wake(this);
  }

  draw() {
    const { context: c, width: w, height: h } = this;
    const [sky, ground, horizon, vehicle, line, sunken] = this.colors;
    c.save();
    c.beginPath();
    c.roundRect(0, 0, w, h, 8);
    c.clip();
    c.fillStyle = sunken;
    c.fillRect(0, 0, w, h);
    c.translate(w / 2, h / 2);
    const known = this.roll.target !== null && this.pitch.target !== null;
    const pixelsPerDeg = h / 60;
    if (known) this.drawWorld(sky, ground, horizon, pixelsPerDeg);
    this.drawRollScale(known ? horizon : line);
    this.drawVehicle(known ? vehicle : line);
    c.restore();
  }

  /**
   * @param {string} sky
   * @param {string} ground
   * @param {string} horizon
   * @param {number} pixelsPerDeg
   */
  drawWorld(sky, ground, horizon, pixelsPerDeg) {
    const { context: c, width: w, height: h } = this;
    const far = 2 * (w + h);
    const pitchDeg = Math.max(-90, Math.min(90, this.pitch.shown));
    c.save();
    c.rotate(-this.roll.shown * DEG);
    c.translate(0, pitchDeg * pixelsPerDeg);
    c.fillStyle = sky;
    c.fillRect(-far, -far, 2 * far, far);
    c.fillStyle = ground;
    c.fillRect(-far, 0, 2 * far, far);
    c.strokeStyle = c.fillStyle = horizon;
    c.lineWidth = 2 * this.scale;
    c.beginPath();
    c.moveTo(-far, 0);
    c.lineTo(far, 0);
    c.stroke();
    c.lineWidth = 1.25 * this.scale;
    c.font = `${this.fontPx}px system-ui, sans-serif`;
    c.textBaseline = 'middle';
    for (let mark = -80; mark <= 80; mark += 5) {
      if (mark === 0 || Math.abs(mark - pitchDeg) > 11.5) continue;
      const half = (mark % 10 === 0 ? LADDER : LADDER / 2) * w;
      const y = -mark * pixelsPerDeg;
      c.beginPath();
      c.moveTo(-half, y);
      c.lineTo(half, y);
      c.stroke();
      if (mark % 10 !== 0) continue;
      c.textAlign = 'left';
      c.fillText(String(Math.abs(mark)), half + 5, y);
      c.textAlign = 'right';
      c.fillText(String(Math.abs(mark)), -half - 5, y);
    }
    c.restore();
  }

  /** @param {string} color */
  drawRollScale(color) {
    const { context: c, height: h } = this;
    const radius = h * 0.43;
    c.strokeStyle = c.fillStyle = color;
    c.lineWidth = 1.25 * this.scale;
    for (const mark of ROLL_MARKS) {
      const angle = (mark - 90) * DEG;
      const long = (mark % 30 === 0 ? 8 : 5) * this.scale;
      c.beginPath();
      c.moveTo(radius * Math.cos(angle), radius * Math.sin(angle));
      c.lineTo((radius + long) * Math.cos(angle), (radius + long) * Math.sin(angle));
      c.stroke();
    }
    if (this.roll.target === null) return;
    c.save();
    c.rotate(-this.roll.shown * DEG);
    c.beginPath();
    c.moveTo(0, -radius + 1);
    c.lineTo(-5 * this.scale, -radius + 1 + 8 * this.scale);
    c.lineTo(5 * this.scale, -radius + 1 + 8 * this.scale);
    c.fill();
    c.restore();
  }

  /** @param {string} color */
  drawVehicle(color) {
    const { context: c, width: w } = this;
    c.lineCap = c.lineJoin = 'round';
    for (const [stroke, width] of /** @type {[string, number][]} */ ([
      ['#000a', 6],
      [color, 3],
    ])) {
      c.strokeStyle = stroke;
      c.lineWidth = width * this.scale;
      c.beginPath();
      for (const side of [-1, 1]) {
        c.moveTo(side * WING_TO * w, 0);
        c.lineTo(side * WING_FROM * w, 0);
        c.lineTo(side * WING_FROM * w, 0.04 * w);
      }
      c.moveTo(-1, 0);
      c.lineTo(1, 0);
      c.stroke();
    }
  }
}
