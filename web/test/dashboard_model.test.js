// @ts-check
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { DepthProfile } from '../dashboard/depth_profile.js';
import { DepthRate } from '../dashboard/depth_rate.js';
import { fixWord, hasFix } from '../dashboard/fields.js';
import { GAP_S, History, LONGEST_S } from '../dashboard/history.js';
import { Model, ageS } from '../dashboard/model.js';

const SEED = {
  ts: 12345,
  imu: { r: 1.5, p: -2.3, y: 180, ax: 1, ay: 0, az: 0, alive: true },
  gps: { lat: 47.6123, lon: -2.7456, alt: 5, sat: 8, alive: true },
  ec: { conductivity: 42000, salinity: 35.5, alive: true },
  depth: { press: 1013.25, temp: 15.2, ok: true },
  celsius: { temp: 15.18, ok: true },
  ctd: { sv: 1507.9, d: 0.5, s: 35.4, t: 15.2 },
  ka: { pkts: 420, bytes: 28000, alive: true },
  kb: { pkts: 380, bytes: 32000, alive: true },
};
const EXTRA = {
  salinity_psu: 35.1,
  sound_speed_mps: 1508.2,
  depth_m: 0.52,
  conductivity_us: 42001,
  gps_fix: '3d',
  hdop: 0.9,
};

/** @param {object} [data] @param {object} [extra] */
const sensors = (data = SEED, extra = EXTRA) => JSON.stringify({ topic: 'sensors', t: 1000, data, extra });

test('the full-range values win over those of the wire', () => {
  const model = new Model();
  assert.equal(model.receive(sensors(), 50), 'sensors');
  assert.equal(model.reading('salinity').value, 35.1);
  assert.equal(model.reading('depth').value, 0.52);
  assert.equal(model.reading('temperature').value, 15.18);
  assert.equal(ageS(model.reading('depth').atMs, 2550), 2.5);
});

test("the seed's own socket feeds the page too", () => {
  const model = new Model();
  assert.equal(model.receive(JSON.stringify(SEED), 1), 'sensors');
  assert.equal(model.reading('soundSpeed').value, 1507.9);
  assert.equal(model.reading('latitude').value, 47.6123);
});

test('a sensor that says it is silent has no value', () => {
  const model = new Model();
  const silent = {
    ...SEED,
    imu: { ...SEED.imu, alive: false },
    celsius: { temp: 0, ok: false },
    depth: { press: 0, temp: 0, ok: false },
  };
  model.receive(sensors(silent), 1);
  for (const key of ['roll', 'pitch', 'heading', 'temperature', 'pressure', 'depth'])
    assert.equal(model.reading(key).value, null, key);
});

test('a value that vanishes keeps the time it was last known', () => {
  const model = new Model();
  model.receive(sensors(), 1000);
  model.receive(sensors({ ...SEED, celsius: { temp: null, ok: false } }), 9000);
  assert.deepEqual(model.reading('temperature'), { value: null, atMs: 1000 });
});

test('nothing a server may send breaks the model', () => {
  const model = new Model();
  for (const bad of [
    '',
    '{',
    'null',
    '[]',
    '3',
    '"x"',
    '{"topic":"sensors"}',
    '{"topic":"sensors","data":[]}',
    '{"topic":"status","data":null}',
    '{"topic":"sensors","data":{"imu":null,"gps":7}}',
    '{"topic":"navigation","data":{}}',
  ]) {
    model.receive(bad, 1);
  }
  assert.equal(model.reading('roll').value, null);
  assert.ok(model.messagesIgnored >= 5);
});

test('no fix gives no position', () => {
  assert.equal(hasFix(SEED, { gps_fix: 'none' }), false);
  assert.equal(fixWord(SEED, { gps_fix: 'none' }), 'No fix');
  assert.equal(fixWord({ ...SEED, gps: { lat: 0, lon: 0, sat: 3, alive: true } }, {}), 'No fix');
  assert.equal(fixWord({ ...SEED, gps: { lat: null, lon: null, sat: null, alive: false } }, {}), 'Silent');
  assert.equal(fixWord(SEED, { gps_fix: '2d' }), '2D fix');
  assert.equal(fixWord(SEED, {}), 'Fix');
  assert.equal(fixWord(null, {}), 'Unknown');
});

test('ages do not follow a wall clock that jumps', () => {
  const model = new Model();
  model.receive(sensors(), 1000);
  model.receive(JSON.stringify({ topic: 'sensors', t: -5e6, data: SEED, extra: EXTRA }), 2000);
  assert.equal(ageS(model.sensorsAtMs, 3000), 1);
  assert.equal(model.unixAt(3000), -5e6 + 1);
});

test('events stand newest first, once each, and are bounded', () => {
  const model = new Model();
  model.takeEvents([{ t: 1, level: 'info', text: 'a' }, { t: 3, level: 'error', text: 'c' }, null, 'x']);
  model.receive('{"topic":"event","t":2,"level":"warning","text":"b"}', 1);
  model.takeEvents([{ t: 1, level: 'info', text: 'a' }]);
  assert.deepEqual(
    model.events.map((entry) => entry.text),
    ['c', 'b', 'a'],
  );
  model.takeEvents(Array.from({ length: 900 }, (_, i) => ({ t: i + 10, level: 'info', text: String(i) })));
  assert.equal(model.events.length, 500);
});

/** @param {History} history @param {number} from @param {number} to */
function span(history, from, to) {
  /** @type {number[]} */
  const times = [];
  /** @type {(number | null)[][]} */
  const columns = history.keys.map(() => []);
  history.copySpan(from, to, times, columns);
  return { times, columns };
}

test('a pause in the data stays a gap in the plot', () => {
  const history = new History(['depth']);
  history.append(0, [1]);
  history.append(1, [2]);
  history.append(1 + GAP_S + 1, [3]);
  assert.deepEqual(span(history, 0, 100).columns[0], [1, 2, null, 3]);
});

test('the history holds an hour and no more, however long the dive', () => {
  const history = new History(['depth', 'temperature']);
  for (let i = 0; i < 60_000; i += 1) history.append(i * 0.25, [i, null]);
  const newest = 59_999 * 0.25;
  assert.equal(history.newestS, newest);
  const { times, columns } = span(history, -Infinity, Infinity);
  assert.ok(newest - times[0] >= LONGEST_S);
  assert.ok(times.length < 16_000);
  assert.equal(columns[0].at(-1), 59_999);
  assert.equal(columns[1].at(-1), null);
  assert.ok(times.every((t, i) => i === 0 || t > times[i - 1]));
});

test('time that goes backwards is ignored', () => {
  const history = new History(['depth']);
  history.append(10, [1]);
  history.append(5, [2]);
  assert.equal(history.length, 1);
});

test('earlier samples can be put in front', () => {
  const history = new History(['depth']);
  history.append(10, [3]);
  history.prepend([
    [8, [1]],
    [9, [2]],
    [10, [99]],
    [11, [99]],
  ]);
  assert.deepEqual(span(history, 0, 100), { times: [8, 9, 10], columns: [[1, 2, 3]] });
});

test('a span reaches one sample beyond both ends', () => {
  const history = new History(['depth']);
  for (let i = 0; i < 10; i += 1) history.append(i, [i]);
  assert.deepEqual(span(history, 3.5, 6.5).times, [3, 4, 5, 6, 7]);
});

test('the profile averages each layer of water', () => {
  const profile = new DepthProfile();
  profile.add(1.0, 10, 1500);
  profile.add(1.1, 12, null);
  profile.add(-0.1, 20, 1520);
  profile.add(NaN, 1, 1);
  profile.add(1e9, 1, 1);
  profile.add(null, 1, 1);
  profile.add(5, null, null);
  assert.deepEqual(profile.rows(), [
    [0.125, 1.125],
    [20, 11],
    [1520, 1500],
  ]);
});

test('the profile does not run through water that was never measured', () => {
  const profile = new DepthProfile();
  profile.add(0.1, 17, 1514);
  profile.add(9.1, 12, 1498);
  profile.add(9.9, 11, 1497);
  const [depth, temperature, soundSpeed] = profile.rows();
  assert.deepEqual(temperature, [17, null, 12, 11]);
  assert.deepEqual(soundSpeed, [1514, null, 1498, 1497]);
  assert.ok(depth[1] > depth[0] && depth[1] < depth[2]);
});

test('the depth rate is the slope of the last seconds', () => {
  const rate = new DepthRate();
  for (let i = 0; i < 40; i += 1) rate.add(i * 500, 10 + i * 0.25);
  assert.ok(Math.abs((rate.mps() ?? NaN) - 0.5) < 1e-9);
});

test('the depth rate is unknown after a reset of the device and while depth is', () => {
  const rate = new DepthRate();
  for (let i = 0; i < 10; i += 1) rate.add(i * 500, i);
  rate.add(0, 3);
  assert.equal(rate.mps(), null);
  for (let i = 1; i < 500; i += 1) rate.add(i * 20, 3);
  assert.ok(Math.abs(rate.mps() ?? NaN) < 1e-12);
  rate.add(20_000, null);
  assert.equal(rate.mps(), null);
});
