// @ts-check
/** The line below the picture: what is under the cursor, and the vehicle now. Places are reserved, nothing jumps. */

import { make, setText } from '../shared/dom.js';
import { clockTime, count, fixed, geodetic, heading } from '../shared/format.js';
import { echoPosition, echoWithinM, groundRangeM } from './ranging.js';
import { LOST } from './row_table.js';

/** @typedef {import('./waterfall.js').Waterfall} Waterfall */
/** @typedef {import('./overlay.js').Spot} Spot */
/** @typedef {import('./track.js').Track} Track */

/** Name, width in characters, whether a phone leaves it out, whether it starts the right-hand group. */
const PLACES = /** @type {const} */ ([
  ['range', 'Range', 13, false, false],
  ['time', 'Time', 10, false, false],
  ['amplitude', 'Echo', 11, false, false],
  ['ping', 'Ping', 7, true, false],
  ['position', 'Position', 39, true, false],
  ['heading', 'Heading', 5, true, true],
  ['depth', 'Depth', 8, false, false],
]);

export class Readout {
  /** @param {HTMLElement} root */
  constructor(root) {
    /** @type {Record<string, HTMLElement>} */
    this.values = {};
    for (const [id, name, width, spare, far] of PLACES) {
      const value = make('dd', { text: '-', style: `--wide: ${width}ch`, id: `readout-${id}` });
      this.values[id] = value;
      const kind = [spare ? 'spare' : '', far ? 'far' : ''].join(' ').trim();
      root.append(make('div', { class: kind || null }, make('dt', { text: name }), value));
    }
  }

  /**
   * @param {Spot | null} spot
   * @param {Waterfall} waterfall
   * @param {Track} track
   * @param {number} unixOffsetS
   * @param {string} unit
   */
  showCursor(spot, waterfall, track, unixOffsetS, unit) {
    const pane = spot && waterfall.panes.find((candidate) => candidate.channel === spot.channel);
    if (!spot || !pane) {
      for (const id of ['range', 'time', 'amplitude', 'ping', 'position']) setText(this.values[id], '-');
      return;
    }
    setText(this.values.range, `${fixed(spot.rangeM, 2)} ${unit} ${spot.channel === 'A' ? 'stbd' : 'port'}`);
    setText(this.values.time, Number.isFinite(unixOffsetS) ? clockWithTenths(spot.timeS + unixOffsetS) : '-');
    const ping = waterfall.pingAt(pane, waterfall.yAtTime(pane, spot.timeS));
    if (typeof ping === 'number') {
      setText(this.values.amplitude, ping === LOST ? 'lost' : '-');
      setText(this.values.ping, '-');
    } else {
      const amplitude = ping.ring.amplitudeAt(ping.slot, spot.rangeM);
      setText(this.values.amplitude, amplitudeText(amplitude));
      setText(this.values.ping, count(ping.ring.number[ping.slot]));
    }
    setText(this.values.position, positionText(spot, track));
  }

  /** @param {any} vehicle data of the vehicle topic; null when it is old */
  showVehicle(vehicle) {
    const known = vehicle && Number.isFinite(vehicle.heading_deg);
    setText(this.values.heading, known ? `${heading(vehicle.heading_deg)}\u00b0` : '-');
    setText(this.values.depth, vehicle ? `${fixed(vehicle.depth_m, 1)} m`.replace('- m', '-') : '-');
  }
}

/** @param {number | 'gap' | null} amplitude */
export function amplitudeText(amplitude) {
  if (amplitude === 'gap') return 'missing';
  if (amplitude === null) return '-';
  return `${amplitude} (${Math.round((100 * amplitude) / 255)} %)`;
}

/** @param {number} unixS */
function clockWithTenths(unixS) {
  const tenths = Math.floor(unixS * 10) / 10;
  return `${clockTime(tenths)}.${Math.round((tenths - Math.floor(tenths)) * 10) % 10}`;
}

/**
 * Where the echo lies: by the navigator's estimate, else by the GPS of the surface (how good that is, nobody says).
 * Where the height is unknown the slant range is taken as the way over ground.
 * @param {Spot} spot
 * @param {Track} track
 * @returns {{latitudeDeg: number, longitudeDeg: number, withinM: number | null, groundM: number | null} | null}
 */
export function positionOf(spot, track) {
  const state = track.at(spot.timeS);
  const estimate = state?.estimate;
  const known = estimate && isPosition(estimate) ? estimate : state && isPosition(state) ? state : null;
  if (!known) return null;
  const groundM = groundRangeM(spot.rangeM, estimate?.altitude_m);
  const rangeM = groundM ?? spot.rangeM;
  const position = echoPosition(
    known.latitude_deg,
    known.longitude_deg,
    known.heading_deg,
    spot.channel,
    rangeM,
  );
  const isEstimate = known === estimate;
  const withinM = isEstimate ? echoWithinM(estimate.within_m, estimate.heading_std_deg, rangeM) : null;
  return { ...position, withinM, groundM };
}

/**
 * @param {{latitude_deg: number | null, longitude_deg: number | null, heading_deg: number | null}} state
 * @returns {state is {latitude_deg: number, longitude_deg: number, heading_deg: number}}
 */
function isPosition(state) {
  return (
    Number.isFinite(state.latitude_deg) &&
    Number.isFinite(state.longitude_deg) &&
    Number.isFinite(state.heading_deg)
  );
}

/** @param {Spot} spot @param {Track} track */
export function positionText(spot, track) {
  const position = positionOf(spot, track);
  if (!position) return '-';
  const { latitudeDeg, longitudeDeg, withinM, groundM } = position;
  const within = withinM === null ? '' : ` \u00b1${fixed(withinM, withinM < 10 ? 1 : 0)} m`;
  const slant = groundM === null ? ' slant' : '';
  return `\u2248 ${geodetic(latitudeDeg, 'latitude', 5)}, ${geodetic(longitudeDeg, 'longitude', 5)}${within}${slant}`;
}
