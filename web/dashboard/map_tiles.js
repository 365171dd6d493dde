// @ts-check
// A picture of the place below the grid, from tiles that the user has put on the vehicle. They come in Web Mercator;
// OpenLayers bends them into the local metric frame, which needs an origin on the Earth.

import { call } from '../shared/api.js';
import { toGeodetic, toLocal } from './local_frame.js';

const DEG = Math.PI / 180;
const MERCATOR_RADIUS_M = 6378137;

/** @typedef {{latitudeDeg: number, longitudeDeg: number}} Origin */

/**
 * Web Mercator of a place.
 * @param {number} latitudeDeg
 * @param {number} longitudeDeg
 * @returns {[number, number]}
 */
export function toMercator(latitudeDeg, longitudeDeg) {
  const y = Math.log(Math.tan(Math.PI / 4 + (latitudeDeg * DEG) / 2));
  return [MERCATOR_RADIUS_M * longitudeDeg * DEG, MERCATOR_RADIUS_M * y];
}

/**
 * @param {number} x
 * @param {number} y
 */
export function fromMercator(x, y) {
  return {
    latitudeDeg: (2 * Math.atan(Math.exp(y / MERCATOR_RADIUS_M)) - Math.PI / 2) / DEG,
    longitudeDeg: x / MERCATOR_RADIUS_M / DEG,
  };
}

export class MapTiles {
  /**
   * @param {import('./openlayers.js').OpenLayers} ol
   * @param {import('./map_view.js').MapView} view
   */
  constructor(ol, view) {
    this.ol = ol;
    this.view = view;
    /** @type {Origin | null} */
    this.origin = null;
    /** @type {number[]} */
    this.zooms = [];
    this.wanted = true;
    ol.addCoordinateTransforms(
      'EPSG:3857',
      view.projection,
      ([x, y]) => {
        const place = fromMercator(x, y);
        const { northM, eastM } = toLocal(this.here(), place.latitudeDeg, place.longitudeDeg);
        return [eastM, northM];
      },
      ([eastM, northM]) => {
        const { latitudeDeg, longitudeDeg } = toGeodetic(this.here(), northM, eastM);
        return toMercator(latitudeDeg, longitudeDeg);
      },
    );
  }

  here() {
    return this.origin ?? { latitudeDeg: 0, longitudeDeg: 0 };
  }

  /** What tiles there are; none is the usual answer. */
  async load() {
    try {
      const { zooms } = await call('api/tiles');
      if (Array.isArray(zooms)) this.zooms = zooms.filter(Number.isInteger);
    } catch {
      // The grid alone, then.
    }
    this.show();
  }

  /** Whether the user has put any there. */
  get exist() {
    return this.zooms.length > 0;
  }

  /** @param {boolean} wanted  the picture may hide a faint track */
  want(wanted) {
    if (wanted === this.wanted) return;
    this.wanted = wanted;
    this.show();
  }

  /** @param {Origin | null} origin */
  setOrigin(origin) {
    if (
      origin?.latitudeDeg === this.origin?.latitudeDeg &&
      origin?.longitudeDeg === this.origin?.longitudeDeg
    )
      return;
    this.origin = origin;
    this.show();
  }

  /** Anew for another origin: what was bent about the old one lies wrong. */
  show() {
    if (this.layer) this.view.map.removeLayer(this.layer);
    this.layer = null;
    const visible = this.wanted && this.origin !== null && this.exist;
    this.view.scene.hasTiles = visible;
    if (visible) {
      this.layer = new this.ol.TileLayer({
        zIndex: -1,
        source: new this.ol.XYZ({
          url: `${new URL('api/tiles/', location.href).href}{z}/{x}/{y}.png`,
          minZoom: Math.min(...this.zooms),
          maxZoom: Math.max(...this.zooms),
          transition: 0,
          wrapX: false,
        }),
      });
      this.view.map.addLayer(this.layer);
    }
    this.view.redraw();
  }
}
