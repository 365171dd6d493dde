// @ts-check
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { PingRing } from '../viewer/ping_ring.js';
import { LOST, NOTHING, countLost, evenScale, fillRowTable } from '../viewer/row_table.js';

/**
 * @param {number} number
 * @param {number} timeS
 * @param {Partial<import('../viewer/decoding.js').Ping>} [change]
 * @returns {import('../viewer/decoding.js').Ping}
 */
export function pingAt(number, timeS, change = {}) {
  return {
    channel: 'A',
    subChannel: 0,
    simulated: false,
    number,
    timeUnixS: 1e9 + timeS,
    monotonicS: timeS,
    firstSample: 0,
    resolutionM: 0.02,
    decimation: 1,
    route: 0,
    gaps: new Uint16Array(0),
    samples: new Uint8Array(100).fill(number & 255),
    ...change,
  };
}

/** @param {number} capacity @param {number[]} times */
function ringOf(capacity, times) {
  const ring = new PingRing(capacity);
  times.forEach((time, k) => appendAt(ring, k, time));
  return ring;
}

/** Exactly there: how arrivals become places is another test. @param {PingRing} ring @param {number} number @param {number} timeS */
function appendAt(ring, number, timeS) {
  ring.append(pingAt(number, timeS));
  const slot = ring.slot(ring.length - 1);
  ring.timeS[slot] = timeS;
  ring.periodS[slot] = 0.1;
}

/** @param {PingRing} ring @param {number} rows @param {number} topRow @param {number} secondsPerRow */
function rowsOf(ring, rows, topRow, secondsPerRow) {
  const table = new Int16Array(2 * rows);
  fillRowTable(table, rows, ring, 0, topRow, secondsPerRow, false);
  return Array.from({ length: rows }, (_, k) => {
    const code = table[2 * k];
    return code < 0 ? code : ring.number[code];
  });
}

test('the newest ping is on top and each ping keeps its rows while the picture scrolls', () => {
  const ring = ringOf(64, [1, 1.1, 1.2, 1.3]);
  // Two rows a ping: row k of the time grid ends at k * 0.05 s.
  assert.deepEqual(rowsOf(ring, 6, 26, 0.05), [3, 3, 2, 2, 1, 1]);
  appendAt(ring, 4, 1.4);
  assert.deepEqual(rowsOf(ring, 8, 28, 0.05), [4, 4, 3, 3, 2, 2, 1, 1]);
});

test('a lost ping leaves hatched rows, not its neighbour drawn twice', () => {
  const ring = ringOf(64, [1, 1.1, 1.2, 1.4, 1.5]);
  assert.deepEqual(rowsOf(ring, 10, 30, 0.05), [4, 4, 3, 3, LOST, LOST, 2, 2, 1, 1]);
  assert.equal(countLost(ring, 0, 2), 1);
});

test('jitter of the arrival is not a loss', () => {
  const ring = ringOf(64, [1, 1.1, 1.24, 1.3, 1.45, 1.5]);
  assert.ok(!rowsOf(ring, 10, 30, 0.05).includes(LOST));
  assert.equal(countLost(ring, 0, 2), 0);
});

test('before the oldest and after the newest ping there is nothing', () => {
  const ring = ringOf(64, [1, 1.1, 1.2]);
  assert.deepEqual(rowsOf(ring, 8, 26, 0.05), [NOTHING, NOTHING, 2, 2, 1, 1, 0, 0]);
  assert.deepEqual(rowsOf(new PingRing(8), 2, 10, 0.05), [NOTHING, NOTHING]);
});

test('several pings in one row are averaged together, none is skipped', () => {
  const ring = ringOf(64, [1.0, 1.1, 1.2, 1.3, 1.4, 1.5]);
  const table = new Int16Array(4);
  fillRowTable(table, 2, ring, 0, 5, 0.301, false);
  assert.deepEqual([...table], [3, 3, 0, 3]);
});

test('the second ring fills only what the first left empty', () => {
  const live = ringOf(64, [2, 2.1]);
  const back = ringOf(64, [1.8, 1.9, 2.0]);
  const table = new Int16Array(2 * 8);
  fillRowTable(table, 8, live, 0, 42, 0.05, false);
  fillRowTable(table, 8, back, 2, 42, 0.05, true);
  const codes = Array.from({ length: 8 }, (_, k) => table[2 * k]);
  assert.deepEqual(codes, [1, 1, 0, 0, 128 + 1, 128 + 1, 128, 128]);
});

test('the scale gives every ping the same whole number of rows', () => {
  assert.ok(Math.abs(evenScale(0.048, 0.1) - 0.05) < 1e-12);
  assert.ok(Math.abs(evenScale(0.26, 0.1) - 0.3) < 1e-12);
  assert.equal(evenScale(0.04, NaN), 0.04);
});

test('a full ring forgets the oldest; time order and slots stay right', () => {
  const ring = ringOf(4, [1, 2, 3, 4, 5, 6]);
  assert.equal(ring.length, 4);
  assert.equal(ring.oldestS, 3);
  assert.equal(ring.newestS, 6);
  assert.equal(ring.lastAtOrBefore(4.5), 1);
  assert.equal(ring.lastAtOrBefore(2.9), -1);
  assert.equal(ring.lastAtOrBefore(99), 3);
});

test('older pings go in front, duplicates and what is not older are left out', () => {
  const ring = ringOf(8, [5, 6]);
  const stored = ring.prependAll([pingAt(10, 3), pingAt(11, 4), pingAt(12, 5)]);
  assert.equal(stored, 2);
  assert.deepEqual(
    [0, 1, 2, 3].map((k) => ring.timeS[ring.slot(k)]),
    [3, 4, 5, 6],
  );
  assert.equal(ring.append(pingAt(1, 6)), false);
});

test('what was missing goes between', () => {
  const ring = ringOf(8, [1, 2, 5, 6]);
  const later = ring.takeAfter(ring.lastAtOrBefore(3), 'A');
  for (const ping of [pingAt(20, 3), pingAt(21, 4), ...later]) ring.append(ping);
  assert.deepEqual(
    Array.from({ length: ring.length }, (_, k) => ring.number[ring.slot(k)]),
    [0, 1, 20, 21, 2, 3],
  );
  assert.equal(ring.amplitudeAt(ring.slot(5), 1), 3);
});

test('the period follows the pings and rides over a loss', () => {
  const ring = new PingRing(64);
  let time = 0;
  for (let k = 0; k < 30; k++) ring.append(pingAt(k, (time += k === 20 ? 0.2 : 0.1)));
  assert.ok(Math.abs(ring.currentPeriodS - 0.1) < 1e-3);
  for (let k = 0; k < 20; k++) ring.append(pingAt(50 + k, (time += 0.2)));
  assert.ok(Math.abs(ring.currentPeriodS - 0.2) < 1e-3);
});

test('a loss is hatched at its place once the following pings confirm it, live and from history alike', () => {
  const pings = Array.from({ length: 40 }, (_, k) => pingAt(k, 0.1 * (k < 20 ? k : k + 2)));
  const live = new PingRing(64);
  for (const ping of pings) live.append(ping);
  const back = new PingRing(64);
  back.append(pingAt(40, 4.2));
  back.prependAll(pings);
  for (const ring of [live, back]) {
    assert.equal(countLost(ring, 0, 10), 2);
    const index = ring.indexOfNumber(20);
    const hole = ring.timeS[ring.slot(index)] - ring.timeS[ring.slot(index - 1)];
    assert.ok(Math.abs(hole - 0.3) < 0.02, `hole ${hole}`);
  }
});

test('longer pings widen the ring without losing what it holds', () => {
  const ring = ringOf(8, [1]);
  ring.append(pingAt(7, 2, { samples: new Uint8Array(3000).fill(9) }));
  assert.equal(ring.width, 4096);
  assert.equal(ring.amplitudeAt(ring.slot(0), 1), 0);
  assert.equal(ring.amplitudeAt(ring.slot(1), 59), 9);
  assert.ok(Math.abs(ring.farthestM(ring.slot(1)) - 60) < 0.01);
});

test('a ping beyond the texture width is reduced by its strongest samples, to scale', () => {
  const samples = new Uint8Array(20000);
  samples[12345] = 200;
  const ring = new PingRing(4);
  ring.append(pingAt(1, 1, { samples, resolutionM: 0.01, gaps: Uint16Array.from([100, 199]) }));
  assert.equal(ring.amplitudeAt(0, 123.45), 200);
  assert.equal(ring.amplitudeAt(0, 1.5), 'gap');
  assert.ok(Math.abs(ring.farthestM(0) - 200) < 0.1);
});

test('gaps and ranges outside the ping are not amplitudes', () => {
  const ring = new PingRing(4);
  ring.append(pingAt(1, 1, { firstSample: 50, gaps: Uint16Array.from([10, 20]) }));
  assert.equal(ring.amplitudeAt(0, 50 * 0.02), 1);
  assert.equal(ring.amplitudeAt(0, 65 * 0.02), 'gap');
  assert.equal(ring.amplitudeAt(0, 40 * 0.02), null);
  assert.equal(ring.amplitudeAt(0, 151 * 0.02), null);
  assert.equal(ring.amplitudeAt(0, -1), null);
});

test('a ping that was cut short does not change the range that is shown', () => {
  const ring = new PingRing(64);
  for (let k = 0; k < 10; k++) ring.append(pingAt(k, k * 0.1));
  ring.append(pingAt(10, 1, { samples: new Uint8Array(30) }));
  assert.ok(Math.abs(ring.recentRangeM - 2) < 1e-6);
  assert.ok(Number.isNaN(new PingRing(4).recentRangeM));
});

test('an empty ping is stored and shows nothing', () => {
  const ring = new PingRing(4);
  ring.append(pingAt(1, 1, { samples: new Uint8Array(0) }));
  assert.equal(ring.amplitudeAt(0, 0), null);
});
