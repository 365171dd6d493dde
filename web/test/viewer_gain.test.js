// @ts-check
import assert from 'node:assert/strict';
import { test } from 'node:test';
import {
  HISTOGRAM_BINS,
  RangeProfile,
  TVG_BINS,
  addToHistogram,
  approachLevels,
  autoLevels,
  displayLevel,
  fillCurve,
} from '../viewer/gain.js';
import { DEFAULT_GAIN } from '../viewer/levels.js';

const FLAT = { ...DEFAULT_GAIN, gamma: 1 };

test('levels stretch from black to white and clip outside', () => {
  const gain = { ...FLAT, black: 0.2, white: 0.6 };
  assert.equal(displayLevel(51, 1, gain), 0);
  assert.ok(Math.abs(displayLevel(102, 1, gain) - 0.5) < 1e-9);
  assert.equal(displayLevel(255, 1, gain), 1);
});

test('6.02 dB doubles the brightness; a gamma below one lifts weak echoes', () => {
  const plain = displayLevel(60, 1, FLAT);
  assert.ok(Math.abs(displayLevel(60, 1, { ...FLAT, gainDb: 6.0206 }) / plain - 2) < 1e-3);
  assert.ok(displayLevel(60, 1, { ...FLAT, gamma: 0.5 }) > plain);
});

test('equal black and white do not divide by zero', () => {
  assert.ok(Number.isFinite(displayLevel(128, 1, { ...FLAT, black: 0.5, white: 0.5 })));
});

test('the curve is 0 dB in the middle, rises with range, and stays within its limit', () => {
  const table = new Float32Array(TVG_BINS);
  fillCurve(table, 30, { ...FLAT, spreadingDb: 20, absorptionDbPerM: 0 });
  const middle = (table[255] + table[256]) / 2;
  assert.ok(Math.abs(middle - 1) < 0.01);
  // 20 dB a decade: twice the range is 6 dB, a factor of two.
  assert.ok(Math.abs(table[511] - 2) < 0.01);
  for (let k = 1; k < TVG_BINS; k++) assert.ok(table[k] >= table[k - 1]);
  fillCurve(table, 200, { ...FLAT, spreadingDb: 60, absorptionDbPerM: 0.5 });
  assert.ok(Math.max(...table) <= 10 ** 1.5 + 1e-4);
});

test('the measured gain evens out a mean that falls with range', () => {
  const profile = new RangeProfile();
  const samples = Uint8Array.from({ length: 1000 }, (_, i) => 200 - 0.15 * i);
  for (let k = 0; k < 20; k++) profile.add(samples, 0, 1000, 0, 0.03, 30, 1);
  const table = new Float32Array(TVG_BINS);
  profile.fillGains(table);
  for (const i of [50, 300, 600, 950]) {
    const bin = Math.floor((i * 0.03 * TVG_BINS) / 30);
    assert.ok(Math.abs((samples[i] / 255) * table[bin] - 0.25) < 0.01, `sample ${i}`);
  }
});

test('bins that no ping reaches keep a gain', () => {
  const profile = new RangeProfile();
  profile.add(new Uint8Array(100).fill(80), 0, 100, 0, 0.1, 30, 1);
  const table = new Float32Array(TVG_BINS);
  profile.fillGains(table);
  assert.ok(table.every((gain) => Number.isFinite(gain) && gain > 0));
});

test('auto-level finds the ends of the histogram and forgives a few outliers', () => {
  const samples = new Uint8Array(10000);
  for (let i = 0; i < samples.length; i++) samples[i] = 60 + (i % 80);
  samples[0] = 255;
  samples[1] = 0;
  const histogram = new Float64Array(HISTOGRAM_BINS);
  addToHistogram(histogram, samples, 0, samples.length, 0, 0, new Float32Array(TVG_BINS).fill(1), 1);
  const levels = autoLevels(histogram);
  assert.ok(levels);
  assert.ok(Math.abs(levels.black - 61 / 255) < 0.02, `black ${levels.black}`);
  assert.ok(Math.abs(levels.white - 139 / 255) < 0.02, `white ${levels.white}`);
});

test('auto-level of nothing is nothing; of one value it keeps a span', () => {
  assert.equal(autoLevels(new Float64Array(HISTOGRAM_BINS)), null);
  const histogram = new Float64Array(HISTOGRAM_BINS);
  histogram[HISTOGRAM_BINS - 1] = 50;
  const levels = autoLevels(histogram);
  assert.ok(levels && levels.white - levels.black >= 0.07 && levels.white <= 1);
});

test('levels approach their target, then rest', () => {
  const gain = { ...FLAT };
  let steps = 0;
  while (approachLevels(gain, { black: 0.2, white: 0.7 }, 0.35) && steps < 100) steps += 1;
  assert.ok(steps > 3 && steps < 30);
  assert.ok(Math.abs(gain.black - 0.2) < 0.01 && Math.abs(gain.white - 0.7) < 0.01);
});
