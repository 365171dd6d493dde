// @ts-check
// What the acoustic array puts on the map: the transmitter, and where its newest pulse says the vehicle is.

import { isKnown } from '../shared/format.js';
import { xOf, yOf } from './map_place.js';

const DEG = Math.PI / 180;
/** A pulse older than this is not drawn: the vehicle is elsewhere by now. */
const SHOWN_S = 10;

/**
 * @typedef {import('./map_place.js').Place} Place
 * @typedef {import('./map_place.js').Scene} Scene
 */

/**
 * @param {CanvasRenderingContext2D} c
 * @param {Place} place
 * @param {Scene} scene
 * @param {string[]} colors  of sound, text, surface and what is old
 * @param {number} fontPx
 */
export function drawAcoustics(c, place, { acoustics, stale }, colors, fontPx) {
  if (acoustics?.enabled !== true) return;
  const [sound, text, surface, old] = colors;
  const fresh = !stale && isKnown(acoustics.age_s) && acoustics.age_s <= SHOWN_S;
  const { fix, beacon } = acoustics;
  if (fresh && isPlaced(fix)) drawFix(c, place, fix, beacon, sound, surface);
  if (isPlaced(beacon)) drawBeacon(c, place, beacon, fresh ? sound : old, text, surface, fontPx);
}

/**
 * Points that "Fit" must show, as [north, east].
 * @param {Record<string, any> | null} acoustics
 * @returns {[number, number][]}
 */
export function extentOfAcoustics(acoustics) {
  const beacon = acoustics?.enabled === true ? acoustics.beacon : null;
  return isPlaced(beacon) ? [[beacon.north_m, beacon.east_m]] : [];
}

/** @param {any} thing */
function isPlaced(thing) {
  return isKnown(thing?.north_m) && isKnown(thing?.east_m);
}

/**
 * The 95 % ellipse of one pulse, dashed, a diamond in its middle, and the line of sight.
 * @param {CanvasRenderingContext2D} c
 * @param {Place} place
 * @param {Record<string, any>} fix
 * @param {Record<string, any> | null} beacon
 * @param {string} sound
 * @param {string} surface
 */
function drawFix(c, place, fix, beacon, sound, surface) {
  const x = xOf(place, fix.east_m);
  const y = yOf(place, fix.north_m);
  c.save();
  c.strokeStyle = sound;
  c.fillStyle = sound;
  if (beacon && isPlaced(beacon)) {
    c.globalAlpha = 0.5;
    c.lineWidth = 1;
    c.setLineDash([2, 4]);
    c.beginPath();
    c.moveTo(x, y);
    c.lineTo(xOf(place, beacon.east_m), yOf(place, beacon.north_m));
    c.stroke();
  }
  const { major_m: major, minor_m: minor, bearing_deg: bearing } = fix.ellipse ?? {};
  if (isKnown(major) && isKnown(minor)) {
    c.beginPath();
    c.ellipse(
      x,
      y,
      Math.max(major / place.metresPerPx, 1),
      Math.max(minor / place.metresPerPx, 1),
      ((bearing ?? 0) - 90) * DEG,
      0,
      2 * Math.PI,
    );
    c.globalAlpha = 0.1;
    c.fill();
    c.globalAlpha = 1;
    c.lineWidth = 1.5;
    c.setLineDash([5, 4]);
    c.stroke();
  }
  c.globalAlpha = 1;
  c.setLineDash([]);
  c.translate(x, y);
  c.rotate(45 * DEG);
  c.strokeStyle = surface;
  c.lineWidth = 2;
  c.strokeRect(-4, -4, 8, 8);
  c.fillRect(-4, -4, 8, 8);
  c.restore();
}

/**
 * A buoy that calls: a dot and two arcs to each side, with its name.
 * @param {CanvasRenderingContext2D} c
 * @param {Place} place
 * @param {Record<string, any>} beacon
 * @param {string} color
 * @param {string} text
 * @param {string} surface
 * @param {number} fontPx
 */
function drawBeacon(c, place, beacon, color, text, surface, fontPx) {
  const size = fontPx / 11;
  c.save();
  c.translate(xOf(place, beacon.east_m), yOf(place, beacon.north_m));
  for (const [style, width] of /** @type {[string, number][]} */ ([
    [surface, 4.5],
    [color, 2],
  ])) {
    c.strokeStyle = style;
    c.lineWidth = width * size;
    for (const radius of [7, 11.5])
      for (const middle of [0, Math.PI]) {
        c.beginPath();
        c.arc(0, 0, radius * size, middle - 0.8, middle + 0.8);
        c.stroke();
      }
    c.beginPath();
    c.arc(0, 0, 3.5 * size, 0, 2 * Math.PI);
    c.stroke();
  }
  c.fillStyle = color;
  c.fill();
  c.font = `600 ${fontPx}px system-ui, sans-serif`;
  c.textAlign = 'center';
  c.textBaseline = 'top';
  c.lineWidth = 3;
  c.strokeStyle = surface;
  c.strokeText('Beacon', 0, 14 * size);
  c.fillStyle = text;
  c.fillText('Beacon', 0, 14 * size);
  c.restore();
}
