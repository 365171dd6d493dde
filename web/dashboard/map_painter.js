// @ts-check
// Draws what moves on the map: vehicle, its ellipse, the current, a measured line.

import { currentTheme } from '../shared/theme.js';
import { xOf, yOf } from './map_place.js';

const DEG = Math.PI / 180;
const ARROW_PX_PER_MPS = 90;
const SOLID = /** @type {number[]} */ ([]);
const BROKEN = [5, 4];

/**
 * @typedef {import('./map_place.js').Place} Place
 * @typedef {import('./map_place.js').Scene} Scene
 */

export class MapPainter {
  constructor() {
    /** @type {string[]} text, accent, vehicle, surface, stale */
    this.colors = [];
    this.fontPx = 11;
  }

  /**
   * @param {CanvasRenderingContext2D} c  scaled to CSS pixels, empty
   * @param {Place} place
   * @param {Scene} scene
   */
  draw(c, place, scene) {
    this.drawVehicle(c, place, scene);
    this.drawMeasure(c, place, scene.measure);
  }

  /**
   * The 95 % ellipse true to scale, the current as an arrow, the vehicle on top.
   * @param {CanvasRenderingContext2D} c
   * @param {Place} place
   * @param {Scene} scene
   */
  drawVehicle(c, place, { state, stale }) {
    const position = state?.position;
    if (!Number.isFinite(position?.north_m) || !Number.isFinite(position?.east_m)) return;
    const [text, accent, vehicle, surface, old] = this.colors;
    const size = this.fontPx / 11;
    const x = xOf(place, position.east_m);
    const y = yOf(place, position.north_m);
    c.save();
    c.translate(x, y);
    if (stale) c.globalAlpha = 0.6;
    const ellipse = state?.ellipse;
    if (Number.isFinite(ellipse?.major_m) && Number.isFinite(ellipse?.minor_m)) {
      c.beginPath();
      c.ellipse(
        0,
        0,
        Math.max(ellipse.major_m / place.metresPerPx, 1),
        Math.max(ellipse.minor_m / place.metresPerPx, 1),
        ((ellipse.bearing_deg ?? 0) - 90) * DEG,
        0,
        2 * Math.PI,
      );
      c.fillStyle = stale ? old : accent;
      const opacity = c.globalAlpha;
      c.globalAlpha = 0.14 * opacity;
      c.fill();
      c.globalAlpha = opacity;
      c.strokeStyle = stale ? old : accent;
      c.lineWidth = 1.5;
      c.setLineDash(state?.mode === 'aided' ? SOLID : BROKEN);
      c.stroke();
      c.setLineDash(SOLID);
    }
    c.scale(size, size);
    this.drawCurrent(c, state?.current, text);
    const heading = state?.attitude?.heading_deg;
    c.fillStyle = stale ? old : vehicle;
    // Yellow on white needs a dark edge, on black it has one.
    c.strokeStyle = currentTheme() === 'light' ? text : surface;
    c.lineWidth = 2;
    c.beginPath();
    if (Number.isFinite(heading)) {
      c.rotate(heading * DEG);
      c.moveTo(0, -13);
      c.lineTo(8, 9);
      c.lineTo(0, 5);
      c.lineTo(-8, 9);
      c.closePath();
    } else c.arc(0, 0, 6, 0, 2 * Math.PI);
    c.stroke();
    c.fill();
    c.restore();
  }

  /**
   * Only a current that stands out of its own uncertainty has a direction to show.
   * @param {CanvasRenderingContext2D} c
   * @param {any} current
   * @param {string} color
   */
  drawCurrent(c, current, color) {
    const north = current?.north_mps;
    const east = current?.east_mps;
    if (!Number.isFinite(north) || !Number.isFinite(east)) return;
    const speed = Math.hypot(north, east);
    if (speed < 0.03 || speed < 2 * (current?.std_mps ?? Infinity)) return;
    const length = Math.min(90, Math.max(22, speed * ARROW_PX_PER_MPS));
    c.save();
    c.rotate(Math.atan2(east, north));
    c.strokeStyle = color;
    c.lineWidth = 1.5;
    c.beginPath();
    c.moveTo(0, 0);
    c.lineTo(0, -length);
    c.moveTo(-5, -length + 8);
    c.lineTo(0, -length);
    c.lineTo(5, -length + 8);
    c.stroke();
    c.restore();
  }

  /**
   * @param {CanvasRenderingContext2D} c
   * @param {Place} place
   * @param {[number, number][]} points
   */
  drawMeasure(c, place, points) {
    if (points.length === 0) return;
    const [text, , , surface] = this.colors;
    for (const [color, width] of /** @type {[string, number][]} */ ([
      [surface, 4],
      [text, 1.75],
    ])) {
      c.strokeStyle = color;
      c.lineWidth = width;
      c.beginPath();
      points.forEach(([e, n], i) => {
        const x = xOf(place, e);
        const y = yOf(place, n);
        if (i === 0) c.moveTo(x, y);
        else c.lineTo(x, y);
        c.moveTo(x + 4, y);
        c.arc(x, y, 4, 0, 2 * Math.PI);
        c.moveTo(x, y);
      });
      c.stroke();
    }
  }
}
