// @ts-check
// Draws the map's contents on a canvas: metric grid, track, fixes, ellipse, vehicle, measured line.

import { shownValue } from '../shared/display.js';
import { fixed } from '../shared/format.js';
import { colorOf } from './map_colors.js';
import { niceStep } from './local_frame.js';
import { AIDED } from './track.js';

const DEG = Math.PI / 180;
/** Grid lines no closer than this, pixels. */
const GRID_PX = 72;
/** Track points closer than this on the screen are one. */
const MERGE_PX = 1.25;
const ARROW_PX_PER_MPS = 90;

/**
 * @typedef {object} Scene
 * @property {import('./track.js').Track} track
 * @property {import('./map_colors.js').Coloring} coloring
 * @property {Record<string, any> | null} state  the newest message's data, null before the first
 * @property {boolean} stale
 * @property {[number, number][]} measure  east, north
 * @typedef {object} Place
 * @property {number} width  CSS pixels
 * @property {number} height
 * @property {number} centerE  metres in the middle of the picture
 * @property {number} centerN
 * @property {number} metresPerPx
 */

export class MapPainter {
  constructor() {
    /** @type {string[]} line, dim, text, accent, vehicle, surface, warn, fault */
    this.colors = [];
    this.fontPx = 12;
  }

  /**
   * @param {CanvasRenderingContext2D} c  scaled to CSS pixels, empty
   * @param {Place} place
   * @param {Scene} scene
   */
  draw(c, place, scene) {
    this.drawGrid(c, place);
    this.drawTrack(c, place, scene);
    this.drawFixes(c, place, scene.track);
    this.drawOrigin(c, place);
    this.drawVehicle(c, place, scene);
    this.drawMeasure(c, place, scene.measure);
  }

  /**
   * @param {CanvasRenderingContext2D} c
   * @param {Place} place
   */
  drawGrid(c, place) {
    const [line, dim] = this.colors;
    // In the units that the page shows: a grid of 5 m that reads 16.4 ft would help nobody.
    const metres = 1 / (shownValue(1, 'm') ?? 1);
    const step = niceStep((GRID_PX * place.metresPerPx) / metres) * metres;
    const halfE = (place.width / 2) * place.metresPerPx;
    const halfN = (place.height / 2) * place.metresPerPx;
    c.lineWidth = 1;
    c.strokeStyle = line;
    c.beginPath();
    for (let e = Math.ceil((place.centerE - halfE) / step) * step; e <= place.centerE + halfE; e += step) {
      const x = Math.round(xOf(place, e)) + 0.5;
      c.moveTo(x, 0);
      c.lineTo(x, place.height);
    }
    for (let n = Math.ceil((place.centerN - halfN) / step) * step; n <= place.centerN + halfN; n += step) {
      const y = Math.round(yOf(place, n)) + 0.5;
      c.moveTo(0, y);
      c.lineTo(place.width, y);
    }
    c.stroke();
    this.labelGrid(c, place, step, metres, dim);
  }

  /**
   * @param {CanvasRenderingContext2D} c
   * @param {Place} place
   * @param {number} step
   * @param {number} metres  of one shown unit
   * @param {string} dim
   */
  labelGrid(c, place, step, metres, dim) {
    const decimals = step / metres < 1 ? 1 : 0;
    const halfE = (place.width / 2) * place.metresPerPx;
    const halfN = (place.height / 2) * place.metresPerPx;
    c.font = `${this.fontPx}px system-ui, sans-serif`;
    c.fillStyle = dim;
    c.textBaseline = 'bottom';
    c.textAlign = 'center';
    const east = place.centerE - halfE + this.fontPx * 4 * place.metresPerPx;
    for (let e = Math.ceil(east / step) * step; e <= place.centerE + halfE; e += step)
      c.fillText(`E ${fixed(e / metres, decimals)}`, xOf(place, e), place.height - 2);
    c.textAlign = 'left';
    const north = place.centerN - halfN + this.fontPx * 3 * place.metresPerPx;
    for (let n = Math.ceil(north / step) * step; n <= place.centerN + halfN; n += step)
      c.fillText(`N ${fixed(n / metres, decimals)}`, 4, yOf(place, n) - 1);
  }

  /**
   * Held by fixes: a solid line. Dead reckoning: a thinner, broken one. Colours are changed as seldom as can be.
   * @param {CanvasRenderingContext2D} c
   * @param {Place} place
   * @param {Scene} scene
   */
  drawTrack(c, place, { track, coloring }) {
    if (track.length < 2) return;
    c.lineJoin = 'round';
    let style = NaN;
    let lastX = 0;
    let lastY = 0;
    let open = false;
    for (let i = 0; i < track.length; i += 1) {
      const x = xOf(place, track.eastM[i]);
      const y = yOf(place, track.northM[i]);
      const step = coloring.step(track, i);
      const now = step * 2 + track.mode[i];
      const isLast = i === track.length - 1;
      if (now === style && !isLast && Math.abs(x - lastX) + Math.abs(y - lastY) < MERGE_PX) continue;
      if (open) c.lineTo(x, y);
      if (now !== style) {
        if (open) c.stroke();
        c.strokeStyle = colorOf(coloring, step);
        c.lineWidth = track.mode[i] === AIDED ? 3.5 : 2;
        c.setLineDash(track.mode[i] === AIDED ? [] : [6, 4]);
        c.beginPath();
        c.moveTo(x, y);
        open = true;
        style = now;
      }
      lastX = x;
      lastY = y;
    }
    if (open) c.stroke();
    c.setLineDash([]);
  }

  /**
   * Used: a ring. Refused: a cross. Only listened to so far: a small dot.
   * @param {CanvasRenderingContext2D} c
   * @param {Place} place
   * @param {import('./track.js').Track} track
   */
  drawFixes(c, place, track) {
    const [, dim, , accent, , , , fault] = this.colors;
    let lastX = NaN;
    let lastY = NaN;
    c.lineWidth = 1.5;
    for (const fix of track.fixes) {
      const x = xOf(place, fix.eastM);
      const y = yOf(place, fix.northM);
      if (x < -9 || y < -9 || x > place.width + 9 || y > place.height + 9) continue;
      if (fix.accepted === true && Math.hypot(x - lastX, y - lastY) < 3) continue;
      c.beginPath();
      if (fix.accepted === false) {
        c.strokeStyle = fault;
        c.moveTo(x - 4, y - 4);
        c.lineTo(x + 4, y + 4);
        c.moveTo(x - 4, y + 4);
        c.lineTo(x + 4, y - 4);
        c.stroke();
      } else if (fix.accepted === true) {
        c.strokeStyle = accent;
        c.arc(x, y, fix.source === 'gps' ? 3.5 : 2.5, 0, 2 * Math.PI);
        c.stroke();
        lastX = x;
        lastY = y;
      } else {
        c.fillStyle = dim;
        c.arc(x, y, 1.5, 0, 2 * Math.PI);
        c.fill();
      }
    }
  }

  /**
   * @param {CanvasRenderingContext2D} c
   * @param {Place} place
   */
  drawOrigin(c, place) {
    const [, , text] = this.colors;
    const x = xOf(place, 0);
    const y = yOf(place, 0);
    c.strokeStyle = text;
    c.lineWidth = 1.5;
    c.beginPath();
    c.moveTo(x - 7, y);
    c.lineTo(x + 7, y);
    c.moveTo(x, y - 7);
    c.lineTo(x, y + 7);
    c.stroke();
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
    const [line, , text, accent, vehicle, surface] = this.colors;
    const x = xOf(place, position.east_m);
    const y = yOf(place, position.north_m);
    c.save();
    c.translate(x, y);
    if (stale) c.globalAlpha = 0.45;
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
      c.fillStyle = accent;
      const opacity = c.globalAlpha;
      c.globalAlpha = 0.14 * opacity;
      c.fill();
      c.globalAlpha = opacity;
      c.strokeStyle = accent;
      c.lineWidth = 1.5;
      c.setLineDash(state?.mode === 'aided' ? [] : [5, 4]);
      c.stroke();
      c.setLineDash([]);
    }
    this.drawCurrent(c, state?.current, text);
    const heading = state?.attitude?.heading_deg;
    c.fillStyle = stale ? line : vehicle;
    c.strokeStyle = surface;
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
    const [, , text, , , surface] = this.colors;
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

/**
 * @param {Place} place
 * @param {number} eastM
 */
function xOf(place, eastM) {
  return place.width / 2 + (eastM - place.centerE) / place.metresPerPx;
}

/**
 * @param {Place} place
 * @param {number} northM
 */
function yOf(place, northM) {
  return place.height / 2 - (northM - place.centerN) / place.metresPerPx;
}
