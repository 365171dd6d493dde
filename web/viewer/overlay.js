// @ts-check
/** Axes, grid, contacts, cursor and measurement over the picture, in CSS pixels. */

import { clockTime, duration } from '../shared/format.js';
import { colors } from '../shared/theme.js';
import { decimalsFor, niceStep, niceTimeStep } from './ranging.js';

/** @typedef {import('./waterfall.js').Waterfall} Waterfall */
/** @typedef {import('./ranging.js').Pane} Pane */
/** @typedef {import('./decoding.js').Channel} Channel */
/** @typedef {{channel: Channel, rangeM: number, timeS: number}} Spot */
/** @typedef {{spot: Spot, name: string, selected: boolean}} Marker */

/** The strip above the picture that carries the range scale, in rem. */
export const RULER_REM = 1.75;
const LABEL_EVERY_PX = 90;
const TIME_LABEL_EVERY_PX = 80;
const ON_PICTURE = '#ffffff';
const PLATE = 'rgb(0 0 0 / 0.62)';
const GRID = 'rgb(255 255 255 / 0.20)';
const GRID_SHADE = 'rgb(0 0 0 / 0.28)';
const MARK = '#ffd166';
const MEASURE = '#7df0ff';

export class Overlay {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {Waterfall} waterfall
   */
  constructor(canvas, waterfall) {
    this.canvas = canvas;
    this.context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext('2d'));
    this.waterfall = waterfall;
    this.grid = true;
    /** Distance unit on the axis; bins when the range is not known. */
    this.unit = 'm';
    /** @type {Marker[]} */
    this.markers = [];
    /** @type {Spot | null} */
    this.cursor = null;
    /** @type {{from: Spot, to: Spot, label: string} | null} */
    this.measurement = null;
    /** Wall clock minus monotonic clock, NaN while unknown. */
    this.unixOffsetS = NaN;
    /** By channel: how long nothing came, in words; empty while pings come. @type {Record<Channel, string>} */
    this.silence = { A: '', B: '' };
    this.rem = 16;
    this.rulerPx = 28;
    this.readColors();
  }

  readColors() {
    const [surface, text, dim, line, port, starboard] = colors(
      '--surface',
      '--text',
      '--dim',
      '--line-strong',
      '--port',
      '--starboard',
    );
    this.colors = { surface, text, dim, line, port, starboard };
    this.font = getComputedStyle(document.body).fontFamily;
  }

  /** @param {number} width @param {number} height device pixels @param {number} dpr */
  resize(width, height, dpr) {
    this.canvas.width = width;
    this.canvas.height = height;
    this.dpr = dpr;
    this.rem = parseFloat(getComputedStyle(document.documentElement).fontSize);
    this.rulerPx = Math.round(RULER_REM * this.rem);
  }

  draw() {
    const { context, waterfall } = this;
    const dpr = this.dpr ?? 1;
    context.setTransform(dpr, 0, 0, dpr, 0, 0);
    context.clearRect(0, 0, this.canvas.width / dpr, this.canvas.height / dpr);
    context.lineWidth = 1;
    context.textBaseline = 'middle';
    this.drawRulerStrip();
    // Without a ping the range is not known: no scale.
    if (!waterfall.hasData) return;
    for (const pane of waterfall.panes) {
      if (pane.y > 0) {
        context.fillStyle = this.colors?.line ?? '';
        context.fillRect(0, Math.round(this.rulerPx + pane.y / dpr) - 1, this.canvas.width / dpr, 2);
      }
      if (this.grid) this.drawGrid(pane, dpr);
      this.drawTimes(pane, dpr);
    }
    this.drawRangeLabels(dpr);
    this.drawSides(dpr);
    for (const marker of this.markers) this.drawMarker(marker);
    if (this.measurement) this.drawMeasurement(this.measurement);
    if (this.cursor) this.drawCursor(this.cursor);
  }

  /** @param {number} rem @param {boolean} [bold] */
  setFont(rem, bold = false) {
    this.context.font = `${bold ? '650 ' : ''}${Math.round(rem * this.rem)}px ${this.font}`;
  }

  drawRulerStrip() {
    const { context } = this;
    const width = this.canvas.width / (this.dpr ?? 1);
    context.fillStyle = this.colors?.surface ?? '';
    context.fillRect(0, 0, width, this.rulerPx);
    context.fillStyle = this.colors?.line ?? '';
    context.fillRect(0, this.rulerPx - 1, width, 1);
  }

  /** @param {Pane} pane @param {number} dpr */
  rangeStep(pane, dpr) {
    const { fromM, toM } = this.waterfall.state;
    return niceStep(toM - fromM, Math.max(2, pane.width / dpr / LABEL_EVERY_PX));
  }

  /** @param {Pane} pane @param {number} dpr */
  drawGrid(pane, dpr) {
    const { context, waterfall } = this;
    const step = this.rangeStep(pane, dpr);
    const { fromM, toM } = waterfall.state;
    const top = this.rulerPx + pane.y / dpr;
    const height = pane.height / dpr;
    for (let k = Math.ceil(fromM / step); k * step <= toM; k++) {
      const x = Math.round(waterfall.xAt(pane, k * step) / dpr);
      context.fillStyle = GRID_SHADE;
      context.fillRect(x + 1, top, 1, height);
      context.fillStyle = GRID;
      context.fillRect(x, top, 1, height);
    }
  }

  /** @param {number} dpr */
  drawRangeLabels(dpr) {
    const { context, waterfall, colors: palette } = this;
    this.setFont(0.75);
    const drawn = new Set();
    for (const pane of waterfall.panes) {
      if (drawn.has(pane.x)) continue;
      drawn.add(pane.x);
      const step = this.rangeStep(pane, dpr);
      const decimals = decimalsFor(step);
      const { fromM, toM } = waterfall.state;
      for (let k = Math.ceil(fromM / step); k * step <= toM * (1 + 1e-9); k++) {
        const x = waterfall.xAt(pane, k * step) / dpr;
        context.fillStyle = palette?.line ?? '';
        context.fillRect(Math.round(x), this.rulerPx - 6, 1, 6);
        this.rangeLabel(
          pane,
          x,
          dpr,
          `${(k * step).toFixed(decimals)}${k === 0 || k * step + step > toM ? ` ${this.unit}` : ''}`,
        );
      }
    }
  }

  /** @param {Pane} pane @param {number} x @param {number} dpr @param {string} text */
  rangeLabel(pane, x, dpr, text) {
    const { context } = this;
    const half = context.measureText(text).width / 2 + 3;
    const left = pane.x / dpr;
    const right = (pane.x + pane.width) / dpr;
    // The nadir belongs to both sides: its label stands in the middle, once.
    const shared = this.waterfall.panes.length === 2 && this.waterfall.view.layout === 'side';
    const atNadir = shared && Math.abs(x - (pane.mirrored ? right : left)) < 1;
    if (atNadir && pane.mirrored) return;
    const centre = atNadir ? x : Math.min(Math.max(x, left + half), right - half);
    context.textAlign = 'center';
    context.fillStyle = this.colors?.text ?? '';
    context.fillText(text, centre, this.rulerPx / 2 - 2);
  }

  /** Which side is which, in words and colour. @param {number} dpr */
  drawSides(dpr) {
    for (const pane of this.waterfall.panes) {
      this.setFont(0.75, true);
      const whole = pane.channel === 'A' ? 'Starboard A' : 'Port B';
      const fits = this.context.measureText('Starboard A').width + 2 * this.rem < pane.width / dpr;
      const words = fits ? whole : pane.channel;
      const color = pane.channel === 'A' ? '#5fe09b' : '#ff9088';
      const y = this.rulerPx + pane.y / dpr + 0.9 * this.rem;
      const middle = (pane.mirrored ? pane.x + pane.width : pane.x) / dpr;
      const side = this.waterfall.view.layout === 'side';
      const x = side ? middle + (pane.mirrored ? -0.75 : 0.75) * this.rem : (pane.x + pane.width / 2) / dpr;
      const align = side ? (pane.mirrored ? 'right' : 'left') : 'center';
      this.plate(words, x, y, color, align, true);
      const silence = this.silence[pane.channel];
      if (silence) this.plate(silence, x, y + 1.5 * this.rem, MARK, align, true);
    }
  }

  /** @param {Pane} pane @param {number} dpr */
  drawTimes(pane, dpr) {
    const { context, waterfall } = this;
    if (pane.x > 0 && waterfall.panes.length > 1) return;
    const rowS = waterfall.secondsPerRow;
    const spanS = pane.height * rowS;
    const step = niceTimeStep(spanS, pane.height / dpr / TIME_LABEL_EVERY_PX);
    const offset = Number.isFinite(this.unixOffsetS) ? this.unixOffsetS : 0;
    const top = waterfall.topS + offset;
    const width = this.waterfall.canvas.width / dpr;
    for (let time = Math.floor(top / step) * step; time > top - spanS; time -= step) {
      const y = Math.round(this.rulerPx + waterfall.yAtTime(pane, time - offset) / dpr);
      if (this.grid) {
        context.fillStyle = GRID;
        context.fillRect(0, y, width, 1);
      }
      // The badge and the name of the side stand there.
      if (y < this.rulerPx + pane.y / dpr + 2.6 * this.rem) continue;
      this.plate(this.timeLabel(time, step), 4, y, ON_PICTURE, 'left', false);
    }
  }

  /** @param {number} time @param {number} step */
  timeLabel(time, step) {
    if (!Number.isFinite(this.unixOffsetS)) return `${duration(time)}`;
    const text = clockTime(time);
    return step >= 60 ? text.slice(0, 5) : text;
  }

  /**
   * Text on a dark plate: legible over any palette.
   * @param {string} text
   * @param {number} x
   * @param {number} y
   * @param {string} color
   * @param {'left' | 'center' | 'right'} align
   * @param {boolean} bold
   */
  plate(text, x, y, color, align, bold) {
    const { context } = this;
    this.setFont(0.75, bold);
    const padding = 0.3 * this.rem;
    const width = context.measureText(text).width + 2 * padding;
    const height = 1.25 * this.rem;
    const left = align === 'left' ? x : align === 'right' ? x - width : x - width / 2;
    context.fillStyle = PLATE;
    context.beginPath();
    context.roundRect(left, y - height / 2, width, height, 0.25 * this.rem);
    context.fill();
    context.textAlign = 'left';
    context.fillStyle = color;
    context.fillText(text, left + padding, y + 0.5);
  }

  /**
   * Where a spot is on the overlay, null when it is out of sight.
   * @param {Spot} spot
   * @returns {{x: number, y: number} | null}
   */
  locate(spot) {
    const dpr = this.dpr ?? 1;
    const pane = this.waterfall.panes.find((candidate) => candidate.channel === spot.channel);
    if (!pane) return null;
    const x = this.waterfall.xAt(pane, spot.rangeM);
    const y = this.waterfall.yAtTime(pane, spot.timeS);
    if (x < pane.x - 1 || x > pane.x + pane.width + 1 || y < pane.y - 1 || y > pane.y + pane.height + 1)
      return null;
    return { x: x / dpr, y: this.rulerPx + y / dpr };
  }

  /** @param {Marker} marker */
  drawMarker(marker) {
    const at = this.locate(marker.spot);
    if (!at) return;
    const { context } = this;
    const size = (marker.selected ? 0.7 : 0.55) * this.rem;
    context.beginPath();
    context.moveTo(at.x, at.y - size);
    context.lineTo(at.x + size, at.y);
    context.lineTo(at.x, at.y + size);
    context.lineTo(at.x - size, at.y);
    context.closePath();
    this.outlined(MARK, marker.selected ? 2.5 : 1.5);
    this.setFont(0.75, marker.selected);
    const right = at.x + size + context.measureText(marker.name).width + this.rem;
    const onRight = right > this.canvas.width / (this.dpr ?? 1);
    const x = at.x + (onRight ? -1 : 1) * (size + 0.25 * this.rem);
    this.plate(marker.name, x, at.y, MARK, onRight ? 'right' : 'left', marker.selected);
  }

  /** @param {string} color @param {number} width */
  outlined(color, width) {
    const { context } = this;
    context.strokeStyle = 'rgb(0 0 0 / 0.7)';
    context.lineWidth = width + 2;
    context.stroke();
    context.strokeStyle = color;
    context.lineWidth = width;
    context.stroke();
    context.lineWidth = 1;
  }

  /** @param {{from: Spot, to: Spot, label: string}} measurement */
  drawMeasurement({ from, to, label }) {
    const a = this.locate(from);
    const b = this.locate(to);
    if (!a || !b) return;
    const { context } = this;
    context.beginPath();
    context.moveTo(a.x, a.y);
    context.lineTo(b.x, b.y);
    this.outlined(MEASURE, 1.5);
    for (const end of [a, b]) {
      context.beginPath();
      context.arc(end.x, end.y, 0.25 * this.rem, 0, 2 * Math.PI);
      this.outlined(MEASURE, 1.5);
    }
    const x = (a.x + b.x) / 2;
    this.plate(label, x, Math.min(a.y, b.y) - 1.1 * this.rem, MEASURE, 'center', true);
  }

  /** @param {Spot} spot */
  drawCursor(spot) {
    const at = this.locate(spot);
    if (!at) return;
    const { context } = this;
    const dpr = this.dpr ?? 1;
    const arm = 0.7 * this.rem;
    const gap = 0.25 * this.rem;
    const pane = this.waterfall.panes.find((candidate) => candidate.channel === spot.channel);
    if (!pane) return;
    context.fillStyle = 'rgb(255 255 255 / 0.35)';
    context.fillRect(pane.x / dpr, Math.round(at.y), pane.width / dpr, 1);
    context.fillRect(Math.round(at.x), this.rulerPx + pane.y / dpr, 1, pane.height / dpr);
    context.beginPath();
    context.moveTo(at.x - arm, at.y);
    context.lineTo(at.x - gap, at.y);
    context.moveTo(at.x + gap, at.y);
    context.lineTo(at.x + arm, at.y);
    context.moveTo(at.x, at.y - arm);
    context.lineTo(at.x, at.y - gap);
    context.moveTo(at.x, at.y + gap);
    context.lineTo(at.x, at.y + arm);
    this.outlined(ON_PICTURE, 1.5);
  }
}
