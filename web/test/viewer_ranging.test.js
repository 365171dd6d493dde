// @ts-check
import assert from 'node:assert/strict';
import { test } from 'node:test';
import {
  decimalsFor,
  echoPosition,
  measure,
  niceStep,
  niceTimeStep,
  paneAt,
  panesOf,
  periodArithmetic,
  rangeAtX,
  xAtRange,
} from '../viewer/ranging.js';

test('side by side: port on the left and mirrored, starboard on the right', () => {
  const [left, right] = panesOf('side', 1001, 600, false);
  assert.deepEqual([left.channel, left.mirrored, left.x], ['B', true, 0]);
  assert.deepEqual([right.channel, right.mirrored, right.x], ['A', false, 500]);
  assert.equal(left.width + right.width, 1001);
  assert.equal(rangeAtX(left, 500, 0, 30), 0);
  assert.equal(rangeAtX(left, 0, 0, 30), 30);
  assert.equal(rangeAtX(right, 500, 0, 30), 0);
});

test('mirrored by the setting, the sides change places', () => {
  assert.deepEqual(
    panesOf('side', 800, 600, true).map((pane) => [pane.channel, pane.mirrored]),
    [
      ['A', true],
      ['B', false],
    ],
  );
  assert.equal(panesOf('B', 800, 600, true)[0].mirrored, false);
});

test('stacked panes share the width and fill the height', () => {
  const panes = panesOf('stacked', 800, 601, false);
  assert.deepEqual(
    panes.map((pane) => pane.channel),
    ['A', 'B'],
  );
  assert.equal(panes[0].height + panes[1].height, 601);
});

test('pixels and ranges go both ways, zoomed and mirrored', () => {
  for (const pane of panesOf('side', 1234, 500, false)) {
    for (const range of [5, 7.25, 11.9]) {
      assert.ok(Math.abs(rangeAtX(pane, xAtRange(pane, range, 5, 12), 5, 12) - range) < 1e-9);
    }
  }
});

test('a point outside the panes belongs to none', () => {
  const panes = panesOf('side', 800, 600, false);
  assert.equal(paneAt(panes, 10, -1), null);
  assert.equal(paneAt(panes, 800, 10), null);
  assert.equal(paneAt(panes, 799, 599)?.channel, 'A');
});

test('ticks are 1, 2 or 5 times a power of ten, and not more than fit', () => {
  assert.equal(niceStep(30, 6), 5);
  assert.equal(niceStep(30, 3), 10);
  assert.equal(niceStep(1, 4), 0.5);
  assert.equal(niceStep(0.9, 10), 0.1);
  for (const span of [0.3, 1, 7, 29.98, 60, 200, 4000]) {
    for (const most of [1, 2, 5, 11]) assert.ok(span / niceStep(span, most) <= most + 1e-6);
  }
  assert.equal(niceStep(NaN, 5), 1);
  assert.equal(decimalsFor(0.5), 1);
  assert.equal(decimalsFor(0.05), 2);
  assert.equal(decimalsFor(5), 0);
  assert.equal(niceTimeStep(60, 10), 10);
  assert.equal(niceTimeStep(36000, 3), 14400);
});

test('the arithmetic of the period is shown, and says whether it fits', () => {
  const tight = periodArithmetic(30, 1500, 30);
  assert.deepEqual(tight, {
    fits: false,
    leastMs: 40,
    text: '2 \u00d7 30 m / 1500 m/s = 40.0 ms > period 30 ms',
  });
  assert.equal(periodArithmetic(30, 1500, 100)?.fits, true);
  assert.equal(periodArithmetic(30, NaN, 100), null);
});

test('an echo to starboard of a vehicle heading north lies east of it', () => {
  const east = echoPosition(60, 10, 0, 'A', 100);
  assert.ok(Math.abs(east.latitudeDeg - 60) < 1e-9);
  // 100 m at 60 degrees north: 1 degree of longitude is 55.6 km.
  assert.ok(Math.abs((east.longitudeDeg - 10) * 55597 - 100) < 0.1);
  const west = echoPosition(60, 10, 0, 'B', 100);
  assert.ok(west.longitudeDeg < 10);
  const north = echoPosition(60, 10, 270, 'A', 100);
  assert.ok(Math.abs((north.latitudeDeg - 60) * 111195 - 100) < 0.1);
});

test('across the nadir the two ranges add up', () => {
  const from = { channel: /** @type {const} */ ('A'), rangeM: 4, timeS: 10 };
  const to = { channel: /** @type {const} */ ('B'), rangeM: 3, timeS: 12.5 };
  assert.deepEqual(measure(from, to), { acrossM: 7, alongS: 2.5 });
  assert.equal(measure(from, { ...from, rangeM: 9 }).acrossM, 5);
});
