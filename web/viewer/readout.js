// @ts-check
/** The line below the picture: what is under the cursor, and the vehicle now. Places are reserved, nothing jumps. */

import { make, setText } from '../shared/dom.js';
import { clockTime, count, fixed, geodetic, heading } from '../shared/format.js';
import { echoPosition } from './ranging.js';
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
  ['position', 'Position', 26, true, false],
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
 * Where the echo lies, its slant range taken as the way over ground; hence the "about".
 * @param {Spot} spot
 * @param {Track} track
 * @returns {{latitudeDeg: number, longitudeDeg: number} | null}
 */
export function positionOf(spot, track) {
  const state = track.at(spot.timeS);
  if (!state || state.latitude_deg === null || state.longitude_deg === null || state.heading_deg === null)
    return null;
  return echoPosition(state.latitude_deg, state.longitude_deg, state.heading_deg, spot.channel, spot.rangeM);
}

/** @param {Spot} spot @param {Track} track */
function positionText(spot, track) {
  const position = positionOf(spot, track);
  if (!position) return 'unknown';
  const { latitudeDeg, longitudeDeg } = position;
  return `\u2248 ${geodetic(latitudeDeg, 'latitude', 5)}, ${geodetic(longitudeDeg, 'longitude', 5)}`;
}
