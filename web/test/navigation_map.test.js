import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import test from 'node:test';

import {
  distanceAndBearing,
  metresPerDegree,
  niceStep,
  toGeodetic,
  toLocal,
} from '../dashboard/local_frame.js';
import { COLORINGS, colorOf } from '../dashboard/map_colors.js';
import { geoJsonOf, gpxOf } from '../dashboard/map_export.js';
import { fromMercator, toMercator } from '../dashboard/map_tiles.js';
import { Track } from '../dashboard/track.js';

/** @type {import('../shared/theme.js').Theme[]} */
const THEMES = ['dark', 'light'];
const ORIGIN = { latitude_deg: 47.6, longitude_deg: -2.7 };

/** @param {number} count */
function straight(count) {
  const track = new Track(64);
  track.setOrigin(ORIGIN);
  for (let i = 0; i < count; i += 1)
    track.add(1000 + i, i, -2 * i, 5, 0.4 + i, 0.5, i < 3 ? 'aided' : 'dead_reckoning');
  return track;
}

test('a degree is as long as the ellipsoid says', () => {
  // WGS-84 at 45 degrees north: 111131.8 m and 78846.8 m, from tables of the ellipsoid.
  const { north, east } = metresPerDegree(45);
  assert.ok(Math.abs(north - 111131.8) < 0.5);
  assert.ok(Math.abs(east - 78846.8) < 0.5);
});

test('metres to degrees and back', () => {
  const origin = { latitudeDeg: -33.9, longitudeDeg: 151.2 };
  const { latitudeDeg, longitudeDeg } = toGeodetic(origin, 812.5, -1430.25);
  const { northM, eastM } = toLocal(origin, latitudeDeg, longitudeDeg);
  assert.ok(Math.abs(northM - 812.5) < 1e-6);
  assert.ok(Math.abs(eastM + 1430.25) < 1e-6);
});

test('bearings are true, clockwise from north', () => {
  const { distanceM, bearingDeg } = distanceAndBearing([0, 0], [3, 4]);
  assert.equal(distanceM, 5);
  assert.ok(Math.abs(bearingDeg - 36.8698976) < 1e-6);
  assert.equal(distanceAndBearing([0, 0], [-1, 0]).bearingDeg, 270);
});

test('grid steps are 1, 2 or 5 by powers of ten', () => {
  assert.deepEqual(
    [0.03, 0.1, 0.11, 3, 5, 5.1, 70].map(niceStep).map((step) => Number(step.toPrecision(6))),
    [0.05, 0.1, 0.2, 5, 5, 10, 100],
  );
});

test('a track keeps order, and unknown stays unknown', () => {
  const track = new Track(8);
  track.add(10, 1, 2, null, null, null, 'aided');
  track.add(10.2, 9, 9, 1, 1, 1, 'aided'); // too soon
  track.add(9, 9, 9, 1, 1, 1, 'aided'); // back in time
  track.add(11, null, 2, 1, 1, 1, 'aided'); // no position
  assert.equal(track.length, 1);
  assert.ok(Number.isNaN(track.depthM[0]) && Number.isNaN(track.majorM[0]));
});

test('a full track is thinned where it is old, and keeps both ends', () => {
  const track = straight(64);
  track.add(2000, 500, 500, 5, 1, 0.5, 'aided');
  assert.ok(track.length < 64);
  assert.equal(track.timeS[0], 1000);
  assert.equal(track.timeS[track.length - 1], 2000);
  assert.equal(track.timeS[track.length - 2], 1063);
  for (let i = 1; i < track.length; i += 1) assert.ok(track.timeS[i] > track.timeS[i - 1]);
});

test('a moved origin empties the track, the same one does not', () => {
  const track = straight(5);
  assert.equal(track.setOrigin({ ...ORIGIN }), false);
  assert.equal(track.length, 5);
  assert.equal(track.setOrigin({ latitude_deg: null, longitude_deg: null }), false);
  assert.equal(track.length, 5);
  assert.equal(track.setOrigin({ latitude_deg: 48, longitude_deg: -2.7 }), true);
  assert.equal(track.length, 0);
});

test('what the service remembers goes before what the page has seen', () => {
  const track = straight(3);
  track.load({
    origin: ORIGIN,
    points: [[990, 0, 0, 1, 0.5, 0.1, 'aided'], [1001.6, 7, 7, 1, 0.5, 0.1, 'aided'], 'not a point'],
    fixes: [[995, 1, 2, 1.5, 'gps', true], [996, 'x', 2, 1, 'gps', true], null],
  });
  assert.deepEqual([...track.timeS.slice(0, track.length)], [990, 1001.6]);
  track.load({ origin: ORIGIN, points: [[995, 0, 0, 1, 0.5, 0.1, 'aided']], fixes: [] });
  assert.deepEqual([...track.timeS.slice(0, track.length)], [995, 1001.6]);
  assert.equal(track.fixes.length, 1);
});

test('an answer that is none leaves the page alive', () => {
  const track = straight(3);
  track.load(null);
  assert.equal(track.length, 3);
});

test('colours: unknown has its own, the largest uncertainty the last', () => {
  const track = straight(60);
  const uncertainty = COLORINGS.find((coloring) => coloring.key === 'uncertainty');
  assert.ok(uncertainty);
  assert.equal(uncertainty.step(track, 0), 0);
  assert.equal(uncertainty.step(track, 59), uncertainty.palette.dark.length - 1);
  track.majorM[0] = NaN;
  assert.equal(uncertainty.step(track, 0), -1);
  for (const theme of THEMES)
    assert.ok(!uncertainty.palette[theme].includes(colorOf(uncertainty, -1, theme)));
  for (const coloring of COLORINGS)
    for (let i = 1; i < track.length; i += 1) {
      const step = coloring.step(track, i);
      assert.ok(step >= 0 && step < coloring.palette.dark.length && step < coloring.palette.light.length);
    }
});

test('each colour of the track stands out from its ground, in both themes', () => {
  const css = readFileSync(new URL('../shared/theme.css', import.meta.url), 'utf8');
  const grounds = [...css.matchAll(/--sunken: (#[0-9a-f]{6})/g)].map((match) => match[1]);
  assert.equal(grounds.length, 2);
  const ground = { dark: grounds[0], light: grounds[1] };
  for (const coloring of COLORINGS)
    for (const theme of THEMES)
      for (let step = -1; step < coloring.palette[theme].length; step += 1)
        assert.ok(
          contrast(colorOf(coloring, step, theme), ground[theme]) >= 3,
          `${coloring.key} ${step} ${theme}`,
        );
});

/**
 * WCAG 2 contrast of two colours.
 * @param {string} a
 * @param {string} b
 */
function contrast(a, b) {
  const [darker, lighter] = [luminance(a), luminance(b)].sort((x, y) => x - y);
  return (lighter + 0.05) / (darker + 0.05);
}

/** @param {string} hex */
function luminance(hex) {
  const [r, g, b] = [1, 3, 5].map((at) => {
    const level = parseInt(hex.slice(at, at + 2), 16) / 255;
    return level <= 0.04045 ? level / 12.92 : ((level + 0.055) / 1.055) ** 2.4;
  });
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}

test('GeoJSON has longitude first, depth as negative height, and says what is simulated', () => {
  const track = straight(4);
  track.addFix({ t: 1000, northM: 0, eastM: 0, stdM: NaN, source: 'gps', accepted: false });
  const { features } = JSON.parse(geoJsonOf(track, { simulated: true }) ?? '');
  assert.deepEqual(features[0].geometry.coordinates[0], [-2.7, 47.6, -5]);
  assert.equal(features[0].geometry.coordinates.length, 4);
  assert.equal(features[0].properties.simulated, true);
  assert.deepEqual(features[0].properties.mode, ['aided', 'aided', 'aided', 'dead_reckoning']);
  assert.equal(features[0].properties.times_utc[1], '1970-01-01T00:16:41.000Z');
  assert.equal(features[1].properties.std_m, null);
  assert.equal(features[1].properties.accepted, false);
});

test('GPX tells the same points', () => {
  const text = gpxOf(straight(2), { simulated: false }) ?? '';
  assert.match(
    text,
    /<trkpt lat="47.6000000" lon="-2.7000000"><ele>-5.00<\/ele><time>1970-01-01T00:16:40.000Z<\/time>/,
  );
  assert.equal(text.match(/<trkpt/g)?.length, 2);
  assert.ok(!text.includes('simulated'));
});

test('without an origin there is nothing to save', () => {
  assert.equal(geoJsonOf(new Track(4), { simulated: false }), null);
  assert.equal(gpxOf(new Track(4), { simulated: false }), null);
});

test('tiles: Web Mercator and back', () => {
  // The edge of the square world, and a place by the defining formula.
  const [x, y] = toMercator(85.0511287798066, 180);
  assert.ok(Math.abs(x - 20037508.342789) < 1e-3 && Math.abs(y - 20037508.342789) < 1e-2);
  for (const metres of toMercator(0, 0)) assert.ok(Math.abs(metres) < 1e-6);
  const back = fromMercator(...toMercator(47.6, -2.7));
  assert.ok(Math.abs(back.latitudeDeg - 47.6) < 1e-10 && Math.abs(back.longitudeDeg + 2.7) < 1e-10);
});
