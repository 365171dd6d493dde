// @ts-check
// The track as files that other programs read: GeoJSON and GPX. Depth is told as a negative altitude.

import { toGeodetic } from './local_frame.js';

/** @typedef {import('./track.js').Track} Track */

/** Degrees with a centimetre's places. */
const PLACES = 7;

/**
 * One LineString with times, depths and radii of the 95 % ellipse beside it, and a point for each fix.
 * @param {Track} track
 * @param {{simulated: boolean}} facts
 */
export function geoJsonOf(track, { simulated }) {
  const { origin } = track;
  if (!origin) return null;
  const coordinates = [];
  for (let i = 0; i < track.length; i += 1) {
    const { latitudeDeg, longitudeDeg } = toGeodetic(origin, track.northM[i], track.eastM[i]);
    const depth = track.depthM[i];
    const position = [round(longitudeDeg), round(latitudeDeg)];
    coordinates.push(Number.isNaN(depth) ? position : [...position, -Math.round(depth * 100) / 100]);
  }
  const indices = Array.from({ length: track.length }, (_, i) => i);
  const known = (/** @type {number} */ value) => (Number.isNaN(value) ? null : Math.round(value * 100) / 100);
  const line = {
    type: 'Feature',
    geometry: { type: 'LineString', coordinates },
    properties: {
      name: 'track',
      simulated,
      times_utc: indices.map((i) => new Date(track.timeS[i] * 1000).toISOString()),
      ellipse_95_major_m: indices.map((i) => known(track.majorM[i])),
      speed_mps: indices.map((i) => known(track.speedMps[i])),
      mode: indices.map((i) => (track.mode[i] ? 'aided' : 'dead_reckoning')),
    },
  };
  const fixes = track.fixes.map((fix) => {
    const { latitudeDeg, longitudeDeg } = toGeodetic(origin, fix.northM, fix.eastM);
    return {
      type: 'Feature',
      geometry: { type: 'Point', coordinates: [round(longitudeDeg), round(latitudeDeg)] },
      properties: {
        name: 'fix',
        source: fix.source,
        time_utc: new Date(fix.t * 1000).toISOString(),
        std_m: known(fix.stdM),
        accepted: fix.accepted,
      },
    };
  });
  return JSON.stringify({ type: 'FeatureCollection', features: [line, ...fixes] });
}

/**
 * @param {Track} track
 * @param {{simulated: boolean}} facts
 */
export function gpxOf(track, { simulated }) {
  const { origin } = track;
  if (!origin) return null;
  const points = [];
  for (let i = 0; i < track.length; i += 1) {
    const { latitudeDeg, longitudeDeg } = toGeodetic(origin, track.northM[i], track.eastM[i]);
    const depth = Number.isNaN(track.depthM[i]) ? '' : `<ele>${(-track.depthM[i]).toFixed(2)}</ele>`;
    const time = new Date(track.timeS[i] * 1000).toISOString();
    points.push(
      `<trkpt lat="${latitudeDeg.toFixed(PLACES)}" lon="${longitudeDeg.toFixed(PLACES)}">${depth}<time>${time}</time></trkpt>`,
    );
  }
  const name = simulated ? 'BlueROV SLAM track (simulated)' : 'BlueROV SLAM track';
  return [
    '<?xml version="1.0" encoding="UTF-8"?>',
    '<gpx version="1.1" creator="BlueROV SLAM" xmlns="http://www.topografix.com/GPX/1/1">',
    `<trk><name>${name}</name><trkseg>`,
    ...points,
    '</trkseg></trk>',
    '</gpx>',
    '',
  ].join('\n');
}

/** @param {number} degrees */
function round(degrees) {
  return Number(degrees.toFixed(PLACES));
}
