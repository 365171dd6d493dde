// @ts-check
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { test } from 'node:test';
import {
  MalformedPingError,
  decodeHistory,
  decodePing,
  decodeSeedPing,
  numberDistance,
} from '../viewer/decoding.js';

const vectors = JSON.parse(
  readFileSync(new URL('../../tests/vectors/waterfall.json', import.meta.url), 'utf8'),
);

/** @param {string} hex */
const bytesOf = (hex) => Uint8Array.from(Buffer.from(hex, 'hex'));

for (const { name, hex, fields, seed_json: seed } of vectors.pings) {
  test(`binary ping "${name}" decodes to its fields`, () => {
    const ping = decodePing(bytesOf(hex));
    assert.equal(ping.channel, fields.channel);
    assert.equal(ping.subChannel, fields.sub_channel);
    assert.equal(ping.number, fields.number);
    assert.equal(ping.route, fields.route);
    assert.equal(ping.decimation, fields.decimation);
    assert.equal(ping.firstSample, fields.first_sample);
    assert.ok(Math.abs(ping.resolutionM * 1000 - fields.resolution_mm) < 1e-9);
    assert.equal(ping.simulated, fields.simulated);
    assert.equal(Number.isNaN(ping.timeUnixS) ? null : ping.timeUnixS, fields.time_unix_s);
    assert.deepEqual([...ping.gaps], fields.gaps.flat());
    assert.equal(Buffer.from(ping.samples).toString('hex'), fields.samples_hex ?? fields.samples);
  });

  test(`seed JSON of "${name}" gives 200 bins of its strongest samples`, () => {
    const ping = decodeSeedPing(JSON.stringify(seed), 1000);
    assert.equal(ping.channel, fields.channel);
    assert.equal(ping.samples.length, 200);
    assert.equal(Math.max(...ping.samples), Math.max(...decodePing(bytesOf(hex)).samples));
    assert.ok(Number.isNaN(ping.resolutionM));
  });
}

for (const { name, hex } of vectors.invalid) {
  test(`"${name}" is refused with a reason`, () => {
    assert.throws(() => decodePing(bytesOf(hex)), MalformedPingError);
  });
}

test('a gap outside the ping, an absurd clock and a zero resolution are refused', () => {
  const gaps = vectors.pings.find((/** @type {any} */ vector) => vector.name === 'gaps');
  for (const [offset, value] of [
    [42, 0xff],
    [28, 0],
  ]) {
    const bytes = bytesOf(gaps.hex);
    bytes[offset] = value;
    bytes[offset + 1] = value;
    assert.throws(() => decodePing(bytes), MalformedPingError);
  }
  const bytes = bytesOf(gaps.hex);
  bytes.fill(0xff, 16, 24);
  assert.throws(() => decodePing(bytes), /monotonic/);
});

test('history is pings behind their lengths; damage is counted and stepped over', () => {
  const good = bytesOf(vectors.pings[0].hex);
  const bad = bytesOf(vectors.invalid[4].hex);
  const framed = (/** @type {Uint8Array} */ ping) => {
    const length = new Uint8Array(4);
    new DataView(length.buffer).setUint32(0, ping.length, true);
    return [...length, ...ping];
  };
  const body = Uint8Array.from([...framed(good), ...framed(bad), ...framed(good)]);
  const whole = decodeHistory(body.buffer);
  assert.equal(whole.pings.length, 2);
  assert.equal(whole.malformed, 1);
  const cut = decodeHistory(body.buffer.slice(0, body.length - 1));
  assert.equal(cut.pings.length, 1);
  assert.equal(cut.malformed, 2);
  assert.deepEqual(decodeHistory(new ArrayBuffer(0)), { pings: [], malformed: 0 });
});

test('seed text that is no ping is refused, whatever it is', () => {
  for (const text of [
    '',
    '{',
    'null',
    '5',
    '{"ch":"C","amp":"","n":1}',
    '{"ch":"A","amp":"*","n":1}',
    '{"ch":"A"}',
  ]) {
    assert.throws(() => decodeSeedPing(text, 0), MalformedPingError);
  }
});

test('ping numbers keep their order over the 32-bit wrap', () => {
  assert.equal(numberDistance(5, 3), 2);
  assert.equal(numberDistance(1, 0xffffffff), 2);
  assert.equal(numberDistance(0xffffffff, 1), -2);
});
