// @ts-check
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { PingClock } from '../viewer/ping_clock.js';

/** @param {number[]} arrivals @returns {number[]} */
function placed(arrivals) {
  const clock = new PingClock();
  /** @type {number[]} */
  const times = [];
  for (const arrival of arrivals) {
    times.push(clock.place(arrival));
    const loss = clock.loss();
    if (loss) for (let k = times.length - loss.pings; k < times.length; k++) times[k] += loss.shiftS;
  }
  return times;
}

/** @param {number[]} times */
const intervals = (times) => times.slice(1).map((time, k) => time - times[k]);

/** @param {number} count @param {number} periodS */
const steady = (count, periodS) => Array.from({ length: count }, (_, k) => 5 + k * periodS);

test('steady pings stay where they are', () => {
  const arrivals = steady(50, 0.1);
  placed(arrivals).forEach((time, k) => assert.ok(Math.abs(time - arrivals[k]) < 1e-9));
});

test('jitter is smoothed and does not drift away', () => {
  const arrivals = steady(400, 0.1).map((time, k) => time + 0.02 * Math.sin(k * 1.7));
  const times = placed(arrivals);
  assert.ok(Math.max(...intervals(times).slice(30)) < 0.12);
  assert.ok(Math.abs(times[399] - arrivals[399]) < 0.05);
});

test('a hiccup that hands over five pings at once leaves no hole', () => {
  const arrivals = steady(60, 0.1);
  for (let k = 30; k < 35; k++) arrivals[k] = arrivals[35] - 0.001 * (35 - k);
  const longest = Math.max(...intervals(placed(arrivals)).slice(20));
  assert.ok(longest < 0.16, `longest interval ${longest}`);
});

test('a lost ping leaves a hole of one period, at its place', () => {
  const arrivals = steady(60, 0.1).filter((_, k) => k !== 30);
  const found = intervals(placed(arrivals));
  assert.equal(
    found.findIndex((interval) => interval > 0.175),
    29,
  );
  assert.ok(Math.abs(found[29] - 0.2) < 0.02);
  assert.equal(found.filter((interval) => interval > 0.175).length, 1);
});

test('a pause is shown at once and in full', () => {
  const arrivals = [...steady(30, 0.1), ...steady(30, 0.1).map((time) => time + 20)];
  const times = placed(arrivals);
  assert.ok(Math.abs(times[30] - arrivals[30]) < 1e-9);
});

test('another period is followed within some seconds', () => {
  const arrivals = [...steady(40, 0.1)];
  for (let k = 1; k <= 60; k++) arrivals.push(arrivals[39] + 0.25 * k);
  const times = placed(arrivals);
  assert.ok(Math.abs(times[99] - arrivals[99]) < 0.3, `${times[99]} against ${arrivals[99]}`);
  for (const interval of intervals(times).slice(70)) assert.ok(Math.abs(interval - 0.25) < 0.03);
});

test('places are always in order', () => {
  let state = 7;
  const random = () => (state = (state * 16807) % 2147483647) / 2147483647;
  let time = 0;
  const arrivals = Array.from(
    { length: 3000 },
    () => (time += random() < 0.1 ? 0.6 * random() : 0.02 + 0.1 * random()),
  );
  for (const interval of intervals(placed(arrivals))) assert.ok(interval > 0);
});
