// @ts-check
// Where the vehicle has been: metres north and east of the origin, in typed arrays that a map can run through.

import { isKnown } from '../shared/format.js';

export const AIDED = 1;
export const DEAD_RECKONING = 0;
/** Closer in time than this, two points are one: the vehicle moves some decimetres meanwhile. */
const CLOSEST_S = 0.45;
const CAPACITY = 50_000;
const FIXES_KEPT = 5_000;

/**
 * @typedef {{t: number, northM: number, eastM: number, stdM: number, source: string, accepted: boolean | null}} Fix
 */

export class Track {
  /** @param {number} [capacity] */
  constructor(capacity = CAPACITY) {
    this.capacity = capacity;
    this.timeS = new Float64Array(capacity);
    this.northM = new Float64Array(capacity);
    this.eastM = new Float64Array(capacity);
    this.depthM = new Float32Array(capacity);
    this.majorM = new Float32Array(capacity);
    this.speedMps = new Float32Array(capacity);
    this.mode = new Uint8Array(capacity);
    this.length = 0;
    /** @type {Fix[]} oldest first */
    this.fixes = [];
    /** @type {{latitudeDeg: number, longitudeDeg: number} | null} */
    this.origin = null;
    /** Counts up when anything but the end has changed: who has drawn it draws it anew. */
    this.epoch = 0;
  }

  /**
   * One point; what is not newer than the last is left out. Unknown numbers become NaN.
   * @param {unknown} t  unix seconds
   * @param {unknown} northM
   * @param {unknown} eastM
   * @param {unknown} depthM
   * @param {unknown} majorM
   * @param {unknown} speedMps
   * @param {unknown} mode
   */
  add(t, northM, eastM, depthM, majorM, speedMps, mode) {
    if (!isKnown(t) || !isKnown(northM) || !isKnown(eastM)) return;
    if (this.length > 0 && t - this.timeS[this.length - 1] < CLOSEST_S) return;
    if (this.length === this.capacity) this.thin();
    const i = this.length;
    this.timeS[i] = t;
    this.northM[i] = northM;
    this.eastM[i] = eastM;
    this.depthM[i] = isKnown(depthM) ? depthM : NaN;
    this.majorM[i] = isKnown(majorM) ? majorM : NaN;
    this.speedMps[i] = isKnown(speedMps) ? speedMps : NaN;
    this.mode[i] = mode === 'aided' ? AIDED : DEAD_RECKONING;
    this.length += 1;
  }

  /** Full: every second point of the older half goes, so that a whole day keeps its shape. */
  thin() {
    const half = this.length >> 1;
    let to = 0;
    for (let i = 0; i < this.length; i += i < half ? 2 : 1) {
      for (const column of this.columns()) column[to] = column[i];
      to += 1;
    }
    this.length = to;
    this.epoch += 1;
  }

  columns() {
    return [this.timeS, this.northM, this.eastM, this.depthM, this.majorM, this.speedMps, this.mode];
  }

  /** @param {Fix} fix */
  addFix(fix) {
    if (!isKnown(fix.northM) || !isKnown(fix.eastM)) return;
    if (this.fixes.length >= FIXES_KEPT) {
      this.fixes.splice(0, FIXES_KEPT / 2);
      this.epoch += 1;
    }
    this.fixes.push(fix);
  }

  clear() {
    this.length = 0;
    this.fixes.length = 0;
    this.epoch += 1;
  }

  /**
   * Takes the origin of the newest message. Points about another origin are elsewhere: they go.
   * @param {any} origin  {latitude_deg, longitude_deg}
   * @returns {boolean} whether it has moved, and the track must be fetched anew
   */
  setOrigin(origin) {
    const latitudeDeg = origin?.latitude_deg;
    const longitudeDeg = origin?.longitude_deg;
    if (!isKnown(latitudeDeg) || !isKnown(longitudeDeg)) return false;
    const before = this.origin;
    if (before && before.latitudeDeg === latitudeDeg && before.longitudeDeg === longitudeDeg) return false;
    this.origin = { latitudeDeg, longitudeDeg };
    this.clear();
    return true;
  }

  /**
   * Replaces everything by the answer of GET api/navigation/track; newer points that are here already stay.
   * @param {any} answer
   */
  load(answer) {
    const points = Array.isArray(answer?.points) ? answer.points : [];
    const fixes = Array.isArray(answer?.fixes) ? answer.fixes : [];
    const here = this.columns().map((column) => column.slice(0, this.length));
    const fixesHere = this.fixes.slice();
    this.setOrigin(answer?.origin);
    this.clear();
    for (const point of points) if (Array.isArray(point)) this.add(...asPoint(point));
    const newestS = this.length > 0 ? this.timeS[this.length - 1] : -Infinity;
    for (let i = 0; i < here[0].length; i += 1) {
      if (here[0][i] <= newestS) continue;
      const [t, north, east, depth, major, speed, mode] = here.map((column) => column[i]);
      this.add(t, north, east, depth, major, speed, mode === AIDED ? 'aided' : '');
    }
    for (const fix of fixes) {
      if (!Array.isArray(fix)) continue;
      const [t, northM, eastM, stdM, source, accepted] = fix;
      this.addFix({ t, northM, eastM, stdM: isKnown(stdM) ? stdM : NaN, source: String(source), accepted });
    }
    const lastFixS = this.fixes.length > 0 ? this.fixes[this.fixes.length - 1].t : -Infinity;
    for (const fix of fixesHere) if (fix.t > lastFixS) this.addFix(fix);
  }

  /**
   * What the track covers, with its fixes that were used; null while there is none.
   * @returns {{north: [number, number], east: [number, number]} | null}
   */
  extent() {
    if (this.length === 0) return null;
    const north = /** @type {[number, number]} */ ([Infinity, -Infinity]);
    const east = /** @type {[number, number]} */ ([Infinity, -Infinity]);
    for (let i = 0; i < this.length; i += 1) {
      north[0] = Math.min(north[0], this.northM[i]);
      north[1] = Math.max(north[1], this.northM[i]);
      east[0] = Math.min(east[0], this.eastM[i]);
      east[1] = Math.max(east[1], this.eastM[i]);
    }
    return { north, east };
  }
}

/**
 * @param {any[]} point
 * @returns {[unknown, unknown, unknown, unknown, unknown, unknown, unknown]}
 */
function asPoint(point) {
  return [point[0], point[1], point[2], point[3], point[4], point[5], point[6]];
}
