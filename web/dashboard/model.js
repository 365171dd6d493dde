// @ts-check
// What the page knows, and since when by the page's own steady clock: a wall clock that jumps changes no age.

import { FIELDS, readFields } from './fields.js';

/**
 * @typedef {{t: number, level: string, text: string}} EventEntry
 * @typedef {{value: number | null, atMs: number}} Reading  atMs: when the value was last known, NaN for never
 */

export const STALE_S = 2;
const EVENTS_KEPT = 500;

/**
 * @param {unknown} value
 * @returns {value is Record<string, any>}
 */
function isObject(value) {
  return typeof value === 'object' && value !== null && !Array.isArray(value);
}

export class Model {
  constructor() {
    /** @type {Record<string, any> | null} */
    this.sensors = null;
    /** @type {Record<string, any>} */
    this.extra = {};
    this.sensorsAtMs = NaN;
    /** @type {Record<string, any> | null} */
    this.status = null;
    this.statusAtMs = NaN;
    /** @type {Record<string, any> | null} what the navigator estimates */
    this.navigation = null;
    this.navigationAtMs = NaN;
    /** @type {Record<string, any> | null} what the acoustic array hears */
    this.acoustics = null;
    this.acousticsAtMs = NaN;
    /** @type {EventEntry[]} newest first */
    this.events = [];
    /** @type {Map<string, Reading>} */
    this.readings = new Map(FIELDS.map((field) => [field.key, { value: null, atMs: NaN }]));
    this.messagesIgnored = 0;
    /** The services' wall clock minus the page's steady clock, seconds; NaN while unknown. */
    this.wallOffsetS = NaN;
  }

  /**
   * Takes one message of the socket, or of the seed's own socket (bare sensor JSON).
   * @param {unknown} text
   * @param {number} nowMs
   * @returns {'sensors' | 'status' | 'navigation' | 'acoustics' | 'event' | null} what changed
   */
  receive(text, nowMs) {
    let message;
    try {
      message = JSON.parse(String(text));
    } catch {
      message = null;
    }
    if (!isObject(message)) {
      this.messagesIgnored += 1;
      return null;
    }
    if (typeof message.t === 'number') this.wallOffsetS = message.t - nowMs / 1000;
    if (message.topic === 'sensors' && isObject(message.data))
      return this.takeSensors(message.data, message.extra, nowMs);
    if (message.topic === 'status' && isObject(message.data)) return this.takeStatus(message.data, nowMs);
    if (message.topic === 'navigation' && isObject(message.data))
      return this.takeNavigation(message.data, nowMs);
    if (message.topic === 'acoustics' && isObject(message.data))
      return this.takeAcoustics(message.data, nowMs);
    if (message.topic === 'event') return this.takeEvents([message]);
    if (message.topic === undefined && isObject(message.imu)) return this.takeSensors(message, {}, nowMs);
    return null;
  }

  /**
   * @param {Record<string, any>} data
   * @param {unknown} extra
   * @param {number} nowMs
   * @returns {'sensors'}
   */
  takeSensors(data, extra, nowMs) {
    this.sensors = data;
    this.extra = isObject(extra) ? extra : {};
    this.sensorsAtMs = nowMs;
    readFields(this.readings, data, this.extra, nowMs);
    return 'sensors';
  }

  /**
   * @param {Record<string, any>} data
   * @param {number} nowMs
   * @returns {'status'}
   */
  takeStatus(data, nowMs) {
    this.status = data;
    this.statusAtMs = nowMs;
    return 'status';
  }

  /**
   * @param {Record<string, any>} data
   * @param {number} nowMs
   * @returns {'navigation'}
   */
  takeNavigation(data, nowMs) {
    this.navigation = data;
    this.navigationAtMs = nowMs;
    return 'navigation';
  }

  /**
   * @param {Record<string, any>} data
   * @param {number} nowMs
   * @returns {'acoustics'}
   */
  takeAcoustics(data, nowMs) {
    this.acoustics = data;
    this.acousticsAtMs = nowMs;
    return 'acoustics';
  }

  /**
   * @param {any[]} entries  in any order
   * @returns {'event'}
   */
  takeEvents(entries) {
    const seen = new Set(this.events.map((entry) => `${entry.t} ${entry.text}`));
    for (const { t, level, text } of entries.filter(isObject)) {
      if (seen.has(`${t} ${text}`)) continue;
      this.events.push({
        t: typeof t === 'number' ? t : NaN,
        level: String(level ?? 'info'),
        text: String(text ?? ''),
      });
    }
    this.events.sort((a, b) => (Number.isNaN(a.t) ? 1 : Number.isNaN(b.t) ? -1 : b.t - a.t));
    this.events.length = Math.min(this.events.length, EVENTS_KEPT);
    return 'event';
  }

  /**
   * @param {string} key
   * @returns {Reading}
   */
  reading(key) {
    const found = this.readings.get(key);
    if (!found) throw new Error(`there is no field ${key}`);
    return found;
  }

  /**
   * The services' wall clock at an instant of the page's steady clock.
   * @param {number} nowMs
   */
  unixAt(nowMs) {
    return Number.isNaN(this.wallOffsetS) ? Date.now() / 1000 : this.wallOffsetS + nowMs / 1000;
  }
}

/**
 * @param {number} atMs
 * @param {number} nowMs
 * @returns {number | null} seconds since, null for never
 */
export function ageS(atMs, nowMs) {
  return Number.isNaN(atMs) ? null : Math.max(0, (nowMs - atMs) / 1000);
}
