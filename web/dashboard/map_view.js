// @ts-check
// The map itself: OpenLayers moves and zooms; of two layers the lower is kept from picture to picture, the upper holds
// what moves. North is up, units are metres.

import { colors, onThemeChange } from '../shared/theme.js';
import { MapBase } from './map_base.js';
import { extentOfAcoustics, drawAcoustics } from './map_acoustics.js';
import { MapPainter } from './map_painter.js';
import { remPx } from './uplot.js';

/**
 * @typedef {import('./openlayers.js').OpenLayers} OpenLayers
 * @typedef {import('./map_place.js').Place} Place
 * @typedef {import('./map_place.js').Scene} Scene
 */

const BASE_COLORS = ['--line', '--dim', '--text', '--accent', '--fault', '--sunken'];
const MOVING_COLORS = ['--text', '--accent', '--vehicle', '--surface', '--stale'];
const ACOUSTIC_COLORS = ['--plot-sound', '--text', '--surface', '--stale'];
const LARGEST_M = 200_000;
const FINEST_M_PER_PX = 0.004;
const START_M_PER_PX = 0.15;
/** The vehicle is followed once it leaves this share of the picture's middle. */
const CALM_SHARE = 0.3;
const SMALLEST_EXTENT_M = 20;
/** A picture of more pieces than this (a dive without an IMU jitters) is moved rather than drawn while it is dragged, */
const MANY_PIECES = 1500;
/** and drawn whole no more often than this. */
const DRAG_REDRAW_MS = 150;

export class MapView {
  /**
   * @param {OpenLayers} ol
   * @param {HTMLElement} target
   * @param {Scene} scene
   */
  constructor(ol, target, scene) {
    this.scene = scene;
    this.target = target;
    this.base = new MapBase();
    this.painter = new MapPainter();
    this.baseCanvas = mapCanvas();
    this.canvas = mapCanvas();
    this.baseDrawnMs = -Infinity;
    this.redrawTimer = 0;
    /** @type {Place} */
    this.place = { width: 0, height: 0, ratio: 1, centerE: 0, centerN: 0, metresPerPx: 1 };
    this.projection = new ol.Projection({
      code: 'LOCAL-METRIC',
      units: 'm',
      extent: [-LARGEST_M, -LARGEST_M, LARGEST_M, LARGEST_M],
      getPointResolution: (/** @type {number} */ resolution) => resolution,
    });
    ol.addProjection(this.projection);
    this.view = new ol.View({
      projection: this.projection,
      center: [0, 0],
      resolution: START_M_PER_PX,
      minResolution: FINEST_M_PER_PX,
      maxResolution: 200,
      enableRotation: false,
      constrainResolution: false,
    });
    this.layer = new ol.Layer({ render: (/** @type {any} */ frame) => this.paintBase(frame) });
    this.moving = new ol.Layer({ render: (/** @type {any} */ frame) => this.paintMoving(frame) });
    this.map = new ol.Map({
      target,
      view: this.view,
      layers: [this.layer, this.moving],
      controls: [],
      interactions: ol.defaultInteractions({ altShiftDragRotate: false, pinchRotate: false }),
    });
    onThemeChange(() => this.readColors());
    this.readColors();
  }

  readColors() {
    this.base.colors = colors(...BASE_COLORS);
    this.painter.colors = colors(...MOVING_COLORS);
    this.acousticColors = colors(...ACOUSTIC_COLORS);
    this.base.fontPx = this.painter.fontPx = Math.round(0.6875 * remPx());
    this.base.forget();
    this.redraw();
  }

  /** Something of the scene has changed: draw with the browser's next frame. */
  redraw() {
    this.layer.changed();
  }

  /** @param {any} frame  OpenLayers' frame state */
  paintBase(frame) {
    const c = this.prepare(this.baseCanvas, frame);
    if (!c || this.moveBase(frame.viewHints)) return this.baseCanvas;
    this.base.draw(c, this.place, this.scene);
    this.baseCanvas.style.transform = '';
    this.baseDrawnMs = performance.now();
    return this.baseCanvas;
  }

  /**
   * While the view is on the move, a picture that is dear to draw is only moved; whether that will do.
   * @param {number[]} hints  OpenLayers': animating, interacting
   */
  moveBase([animating, interacting]) {
    if (!(animating || interacting) || this.base.pieces < MANY_PIECES) return false;
    const shift = this.base.shiftTo(this.place);
    const restMs = this.baseDrawnMs + DRAG_REDRAW_MS - performance.now();
    if (!shift || restMs <= 0) return false;
    this.baseCanvas.style.transform = `translate(${shift[0]}px, ${shift[1]}px)`;
    clearTimeout(this.redrawTimer);
    this.redrawTimer = window.setTimeout(() => this.redraw(), restMs);
    return true;
  }

  /** @param {any} frame */
  paintMoving(frame) {
    const c = this.prepare(this.canvas, frame);
    if (!c) return this.canvas;
    c.clearRect(0, 0, this.place.width, this.place.height);
    drawAcoustics(c, this.place, this.scene, this.acousticColors ?? [], this.painter.fontPx);
    this.painter.draw(c, this.place, this.scene);
    return this.canvas;
  }

  /**
   * @param {HTMLCanvasElement} canvas
   * @param {any} frame
   */
  prepare(canvas, frame) {
    const { place } = this;
    [place.width, place.height] = frame.size;
    place.ratio = frame.pixelRatio;
    [place.centerE, place.centerN] = frame.viewState.center;
    place.metresPerPx = frame.viewState.resolution;
    const width = Math.round(place.width * place.ratio);
    const height = Math.round(place.height * place.ratio);
    if (canvas.width !== width || canvas.height !== height) {
      canvas.width = width;
      canvas.height = height;
      this.base.forget();
    }
    const c = canvas.getContext('2d');
    c?.setTransform(place.ratio, 0, 0, place.ratio, 0, 0);
    return c;
  }

  /**
   * Keeps the vehicle in the middle part of the picture.
   * @param {number} eastM
   * @param {number} northM
   * @param {boolean} atOnce
   */
  follow(eastM, northM, atOnce) {
    const size = this.map.getSize();
    const center = this.view.getCenter();
    const resolution = this.view.getResolution();
    if (!size || !center || !resolution) return;
    const offX = Math.abs(eastM - center[0]) / resolution / size[0];
    const offY = Math.abs(northM - center[1]) / resolution / size[1];
    if (!atOnce && (this.view.getAnimating() || Math.max(offX, offY) < CALM_SHARE)) return;
    if (atOnce || isMotionReduced()) this.view.setCenter([eastM, northM]);
    else this.view.animate({ center: [eastM, northM], duration: 400 });
  }

  /** The whole track and the vehicle with its ellipse, in one picture. */
  fit() {
    const { track, state } = this.scene;
    const extent = track.extent();
    const position = state?.position;
    const size = this.map.getSize();
    if (!size) return;
    const radius = Number.isFinite(state?.ellipse?.major_m) ? state?.ellipse.major_m : 0;
    const north = extent ? [...extent.north] : [];
    const east = extent ? [...extent.east] : [];
    if (Number.isFinite(position?.north_m) && Number.isFinite(position?.east_m)) {
      north.push(position.north_m - radius, position.north_m + radius);
      east.push(position.east_m - radius, position.east_m + radius);
    }
    for (const [n, e] of extentOfAcoustics(this.scene.acoustics)) {
      north.push(n);
      east.push(e);
    }
    if (north.length === 0) return;
    const box = [Math.min(...east), Math.min(...north), Math.max(...east), Math.max(...north)];
    const needed = Math.max((box[2] - box[0]) / size[0], (box[3] - box[1]) / size[1]);
    const least = SMALLEST_EXTENT_M / Math.min(size[0], size[1]);
    this.view.setCenter([(box[0] + box[2]) / 2, (box[1] + box[3]) / 2]);
    this.view.setResolution(Math.max(needed * 1.2, least));
  }

  /** @param {number} factor  above 1: closer */
  zoom(factor) {
    const resolution = this.view.getResolution();
    if (!resolution) return;
    const next = Math.max(FINEST_M_PER_PX, resolution / factor);
    if (isMotionReduced()) this.view.setResolution(next);
    else this.view.animate({ resolution: next, duration: 150 });
  }

  /**
   * East and north under a pointer.
   * @param {number[]} pixel
   * @returns {[number, number] | null}
   */
  at(pixel) {
    const coordinate = this.map.getCoordinateFromPixel(pixel);
    return coordinate ? [coordinate[0], coordinate[1]] : null;
  }
}

function mapCanvas() {
  const canvas = document.createElement('canvas');
  canvas.className = 'map-canvas';
  return canvas;
}

function isMotionReduced() {
  return matchMedia('(prefers-reduced-motion: reduce)').matches;
}
