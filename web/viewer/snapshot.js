// @ts-check
/** What is seen, as a PNG with a line of facts under it. */

import { saveBlob } from '../shared/dom.js';
import { clockTime, dateTime, fixed, geodetic, heading } from '../shared/format.js';
import { PALETTES } from './palettes.js';

/** @typedef {import('./stage.js').Stage} Stage */

const FOOTER_REM = 4.75;

/**
 * @param {Stage} stage
 * @param {{vehicle: any, origin: string, unixOffsetS: number, gainText: string}} facts
 */
export async function saveSnapshot(stage, facts) {
  const canvas = composeSnapshot(stage, facts);
  const blob = await new Promise((/** @type {(blob: Blob | null) => void} */ done) =>
    canvas.toBlob(done, 'image/png'),
  );
  if (!blob)
    throw new Error('The browser could not make a PNG of this size. Make the window smaller and try again.');
  const at = new Date(
    (stage.waterfall.topS + (Number.isFinite(facts.unixOffsetS) ? facts.unixOffsetS : 0)) * 1000,
  );
  const stamp = Number.isFinite(at.getTime())
    ? at.toISOString().slice(0, 19).replace(/[-:]/g, '')
    : 'undated';
  saveBlob(blob, `sonar_${stamp}Z.png`);
}

/**
 * @param {Stage} stage
 * @param {{vehicle: any, origin: string, unixOffsetS: number, gainText: string}} facts
 */
function composeSnapshot(stage, facts) {
  const { waterfall, overlay, dpr } = stage;
  const footer = Math.round(FOOTER_REM * overlay.rem * dpr);
  const ruler = Math.round(overlay.rulerPx * dpr);
  const canvas = document.createElement('canvas');
  canvas.width = stage.picture.width;
  canvas.height = ruler + stage.picture.height + footer;
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext('2d'));
  // Drawn now, in this task: a WebGL canvas keeps its pixels no longer.
  waterfall.draw();
  context.drawImage(stage.picture, 0, ruler);
  context.drawImage(stage.axes, 0, 0);
  context.fillStyle = '#0a1016';
  context.fillRect(0, canvas.height - footer, canvas.width, footer);
  drawFacts(context, stage, facts, canvas.height - footer);
  return canvas;
}

/**
 * @param {CanvasRenderingContext2D} context
 * @param {Stage} stage
 * @param {{vehicle: any, origin: string, unixOffsetS: number, gainText: string}} facts
 * @param {number} top
 */
function drawFacts(context, stage, facts, top) {
  const { waterfall, overlay, dpr } = stage;
  const em = overlay.rem * dpr;
  const left = 0.75 * em;
  const room = context.canvas.width - 2 * left;
  const lines = snapshotLines(waterfall, facts);
  context.textBaseline = 'middle';
  context.fillStyle = '#e9f0f4';
  context.font = `600 ${Math.round(0.875 * em)}px ${overlay.font}`;
  context.fillText(lines[0], left, top + 0.95 * em, room);
  context.font = `${Math.round(0.8125 * em)}px ${overlay.font}`;
  context.fillStyle = '#a3b5c1';
  context.fillText(lines[1], left, top + 2.2 * em, room);
  const width = Math.min(18 * em, room);
  for (let k = 0; k < 256; k++) {
    const at = 4 * k;
    context.fillStyle = `rgb(${waterfall.table[at]} ${waterfall.table[at + 1]} ${waterfall.table[at + 2]})`;
    context.fillRect(left + (k * width) / 256, top + 3.2 * em, width / 256 + 1, 0.8 * em);
  }
  if (room < 26 * em) return;
  const label = PALETTES.find((palette) => palette.id === waterfall.palette)?.label ?? waterfall.palette;
  context.fillStyle = '#a3b5c1';
  context.fillText(
    `${label}${waterfall.inverted ? ' inverted' : ''}, weak to strong echo. ${facts.gainText}`,
    left + width + 0.75 * em,
    top + 3.6 * em,
    room - width - em,
  );
}

/**
 * @param {import('./waterfall.js').Waterfall} waterfall
 * @param {{vehicle: any, origin: string, unixOffsetS: number}} facts
 */
export function snapshotLines(waterfall, { vehicle, origin, unixOffsetS }) {
  const newest = waterfall.topS + unixOffsetS;
  const oldest = newest - waterfall.windowS;
  const { fromM, toM } = waterfall.state;
  const time = Number.isFinite(newest) ? `${dateTime(oldest)} to ${clockTime(newest)}` : 'time unknown';
  const first = [origin || null, 'Side-scan sonar', time, `range ${fixed(fromM, 1)} to ${fixed(toM, 1)} m`];
  const known = vehicle && Number.isFinite(vehicle.latitude_deg) && Number.isFinite(vehicle.longitude_deg);
  const second = [
    known
      ? `Vehicle ${geodetic(vehicle.latitude_deg, 'latitude')}, ${geodetic(vehicle.longitude_deg, 'longitude')}`
      : 'Position unknown',
    vehicle && Number.isFinite(vehicle.heading_deg) ? `heading ${heading(vehicle.heading_deg)}\u00b0` : null,
    vehicle && Number.isFinite(vehicle.depth_m) ? `depth ${fixed(vehicle.depth_m, 1)} m` : null,
  ];
  return [first, second].map((parts) => parts.filter((part) => part !== null).join('   '));
}
