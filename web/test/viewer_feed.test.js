// @ts-check
import assert from 'node:assert/strict';
import { afterEach, beforeEach, mock, test } from 'node:test';
import { Feed } from '../viewer/feed.js';
import { PingRing } from '../viewer/ping_ring.js';

const HEADER_BYTES = 40;
const SAMPLES = 8;
const CAPACITY = 1024;

/** @param {'A' | 'B'} channel @param {number} number @param {number} timeS */
function binaryPing(channel, number, timeS) {
  const bytes = new Uint8Array(HEADER_BYTES + SAMPLES).fill(number & 255, HEADER_BYTES);
  const view = new DataView(bytes.buffer);
  view.setUint16(0, 0x0150, true);
  view.setUint8(2, channel === 'A' ? 0 : 1);
  view.setUint32(4, number >>> 0, true);
  view.setFloat64(8, 1e9 + timeS, true);
  view.setFloat64(16, timeS, true);
  view.setUint16(24, SAMPLES, true);
  view.setUint16(28, 20, true);
  return bytes;
}

/** A dive as the service keeps it: number and time of each ping of A. */
class Dive {
  constructor() {
    /** @type {[number, number][]} */
    this.pings = [];
    this.requests = 0;
    this.failing = false;
  }

  /** @param {number} count @param {number} fromS */
  add(count, fromS) {
    const first = this.pings.length ? this.pings[this.pings.length - 1][0] + 1 : 1;
    for (let k = 0; k < count; k++) this.pings.push([first + k, fromS + k * 0.1]);
  }

  /** @param {string} address */
  async answer(address) {
    this.requests += 1;
    if (this.failing) throw new TypeError('network');
    const query = new URL(address, 'http://x/').searchParams;
    const of = (/** @type {string} */ key) => (query.has(key) ? Number(query.get(key)) : null);
    const [before, after, limit] = [of('before'), of('after'), of('limit') ?? 200];
    const all = query.get('channel') === 'A' ? this.pings : [];
    const wanted = all.filter(([n]) => (before === null || n < before) && (after === null || n > after));
    const chosen = after !== null ? wanted.slice(0, limit) : wanted.slice(-limit);
    const parts = chosen.flatMap(([number, timeS]) => {
      const ping = binaryPing('A', number, timeS);
      return [...new Uint8Array(new Uint32Array([ping.length]).buffer), ...ping];
    });
    const first = all.length ? String(all[0][0]) : '';
    return new Response(Uint8Array.from(parts), { headers: { 'X-First-Ping': first } });
  }
}

const realFetch = globalThis.fetch;
/** @type {Dive} */
let dive;

beforeEach(() => {
  dive = new Dive();
  globalThis.fetch = /** @type {any} */ ((/** @type {string} */ address) => dive.answer(address));
});

afterEach(() => {
  mock.timers.reset();
  globalThis.fetch = realFetch;
});

/** What the feed needs of a waterfall. @param {number} windowS */
function waterfallOf(windowS) {
  const rings = [0, 1, 2, 3].map(() => new PingRing(CAPACITY));
  const view = { live: true, topS: NaN };
  return {
    rings,
    view,
    windowS,
    get newestS() {
      return rings[0].newestS;
    },
    live: (/** @type {string} */ channel) => rings[channel === 'A' ? 0 : 1],
    back: (/** @type {string} */ channel) => rings[channel === 'A' ? 2 : 3],
    invalidate() {},
    goLive() {
      view.live = true;
    },
  };
}

/** @param {number} [windowS] */
function feedOf(windowS = 20) {
  const waterfall = waterfallOf(windowS);
  let restarts = 0;
  const feed = new Feed(/** @type {any} */ (waterfall), {
    onText: () => {},
    onPing: () => {},
    onRestart: () => (restarts += 1),
    onState: () => {},
    onHistory: () => {},
  });
  return { feed, waterfall, restarts: () => restarts };
}

/** Lets all calls that follow from one another come to their end. @param {Feed} feed */
async function settle(feed) {
  for (let k = 0; k < 200; k++) {
    await new Promise((done) => setImmediate(done));
    if (Object.values(feed.channels).every(({ busy, repairs }) => !busy && repairs === 0)) return;
  }
  assert.fail('the feed goes on asking');
}

/** @param {Feed} feed @param {number} number @param {number} timeS */
const receive = (feed, number, timeS) => feed.receive(binaryPing('A', number, timeS).buffer, 'ws://x/ws');

/** Whether the rings hold every ping of a stretch of time. @param {any} waterfall @param {number} fromS @param {number} toS */
function covered(waterfall, fromS, toS) {
  const held = new Set();
  for (const ring of [waterfall.rings[0], waterfall.rings[2]]) {
    for (let k = 0; k < ring.length; k++) held.add(ring.number[ring.slot(k)]);
  }
  return dive.pings.filter(([, s]) => s >= fromS && s <= toS).every(([number]) => held.has(number));
}

/** @param {Feed} feed @param {any} waterfall @param {number} topS */
async function show(feed, waterfall, topS) {
  waterfall.view.live = false;
  waterfall.view.topS = topS;
  feed.moved();
  await settle(feed);
}

test('a page that is opened in mid-dive shows what came before, in order', async () => {
  dive.add(600, 100);
  const { feed, waterfall } = feedOf(40);
  feed.ensure();
  await settle(feed);
  assert.ok(covered(waterfall, 160 - 40, 160));
  const ring = waterfall.rings[0];
  for (let k = 1; k < ring.length; k++)
    assert.equal(ring.number[ring.slot(k)], ring.number[ring.slot(k - 1)] + 1);
});

test('the whole of a long dive can be reached, near and far, back and forth', async () => {
  dive.add(20000, 0);
  const { feed, waterfall } = feedOf(20);
  feed.ensure();
  await settle(feed);
  for (const topS of [1980, 1900, 1000, 985, 970, 990, 1010, 30, 20, 1700, 1999]) {
    await show(feed, waterfall, topS);
    assert.ok(covered(waterfall, Math.max(0, topS - 20), topS), `top at ${topS} s`);
  }
  assert.ok(Math.abs(feed.oldestS) < 0.2);
});

test('a pause of an hour in the dive does not hide what lies before it', async () => {
  dive.add(5000, 0);
  dive.add(5000, 4100);
  const { feed, waterfall } = feedOf(20);
  feed.ensure();
  await settle(feed);
  for (const topS of [4110, 480, 300, 4300]) {
    await show(feed, waterfall, topS);
    assert.ok(covered(waterfall, topS - 20, topS), `top at ${topS} s`);
  }
});

test('looking where nothing was recorded asks a few times and then rests', async () => {
  dive.add(5000, 0);
  dive.add(5000, 4100);
  const { feed, waterfall } = feedOf(20);
  feed.ensure();
  await settle(feed);
  const before = dive.requests;
  await show(feed, waterfall, 2500);
  assert.ok(dive.requests - before <= 14, `${dive.requests - before} requests`);
});

test('numbers missed on the way are fetched and put in their place', async () => {
  dive.add(30, 0);
  const { feed, waterfall } = feedOf();
  for (const [number, timeS] of dive.pings) if (number <= 10 || number > 14) receive(feed, number, timeS);
  await settle(feed);
  const ring = waterfall.rings[0];
  const numbers = Array.from({ length: ring.length }, (_, k) => ring.number[ring.slot(k)]);
  assert.deepEqual(
    numbers,
    dive.pings.map(([number]) => number),
  );
  assert.equal(feed.channels.A.missed, 0);
});

test('what the service no longer has is counted as missed', async () => {
  const { feed } = feedOf();
  receive(feed, 1, 0);
  receive(feed, 6, 0.5);
  await settle(feed);
  assert.equal(feed.channels.A.missed, 4);
});

test('numbers go on over the 32-bit wrap without a gap', async () => {
  const { feed, waterfall } = feedOf();
  for (let k = 0; k < 6; k++) receive(feed, 0xfffffffd + k, k * 0.1);
  assert.equal(waterfall.rings[0].length, 6);
  assert.equal(feed.channels.A.missed, 0);
  assert.equal(dive.requests, 0);
});

test('another run of the clock clears the picture and starts anew', async () => {
  const { feed, waterfall, restarts } = feedOf();
  for (let k = 0; k < 5; k++) receive(feed, k, 5000 + k * 0.1);
  receive(feed, 0, 12);
  assert.equal(restarts(), 1);
  assert.equal(waterfall.rings[0].length, 1);
  assert.equal(waterfall.rings[0].newestS, 12);
});

test('a hole of the run before is not filled into the new one', async () => {
  dive.add(6, 100);
  const { feed, waterfall, restarts } = feedOf();
  receive(feed, 1, 100);
  receive(feed, 6, 100.5);
  const { A } = feed.channels;
  receive(feed, 1, 12);
  dive.pings = [[1, 12]];
  await settle(feed);
  assert.equal(restarts(), 1);
  assert.equal(waterfall.rings[0].length, 1);
  assert.equal(A.repairs, 0);
  assert.equal(feed.channels.A.missed, 0);
});

test('a repeated or late ping changes nothing', async () => {
  const { feed, waterfall } = feedOf();
  receive(feed, 1, 1);
  receive(feed, 2, 1.1);
  receive(feed, 2, 1.1);
  receive(feed, 1, 1);
  assert.equal(waterfall.rings[0].length, 2);
});

test('a service that does not answer is not hammered', async () => {
  mock.timers.enable({ apis: ['setTimeout'] });
  dive.failing = true;
  const { feed } = feedOf();
  for (let k = 0; k < 20; k++) {
    feed.ensure();
    await settle(feed);
  }
  assert.ok(dive.requests <= 2, `${dive.requests} requests`);
  assert.equal(feed.historyFailed, true);
});

test('damaged messages are counted, unknown ones ignored', () => {
  const { feed } = feedOf();
  feed.receive(new ArrayBuffer(7), 'ws://x/ws');
  feed.receive('{broken', 'ws://x/ws');
  feed.receive('{"topic":"news"}', 'ws://x/ws');
  assert.equal(feed.malformed, 2);
});
