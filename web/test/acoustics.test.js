import assert from 'node:assert/strict';
import test from 'node:test';

import { heightText, loudness, messageText, pulseAge, sideText } from '../dashboard/acoustics_card.js';
import { extentOfAcoustics } from '../dashboard/map_acoustics.js';
import { Model } from '../dashboard/model.js';

test('directions are told as a helmsman says them', () => {
  assert.equal(sideText(0.2), 'Ahead');
  assert.equal(sideText(-179.9), 'Astern');
  assert.equal(sideText(22.4), '22\u00b0 stbd');
  assert.equal(sideText(-90), '90\u00b0 port');
  assert.equal(sideText(null), '-');
  assert.equal(heightText(-12), '12\u00b0 up');
  assert.equal(heightText(12), '12\u00b0 down');
  assert.equal(heightText(0.1), 'Level');
  assert.equal(heightText(undefined), '-');
});

test('loudness goes by powers of ten and stays inside its bar', () => {
  assert.equal(loudness(null), 0);
  assert.equal(loudness(0.5), 0);
  assert.equal(loudness(2048), 1);
  assert.equal(loudness(1e9), 1);
  assert.ok(Math.abs(loudness(Math.sqrt(2048)) - 0.5) < 1e-9);
});

test('a message is told with its place, depth and corrections', () => {
  assert.equal(messageText(null), 'No message of the transmitter yet');
  assert.equal(messageText({ text: 'hello', age_s: 2, corrected_errors: 0 }), 'hello (2.0 s ago, no error)');
  const place = { latitude_deg: 47.5, longitude_deg: -2.25, depth_m: 3, std_m: 1.5 };
  assert.equal(
    messageText({ text: 'Position report', age_s: 30, corrected_errors: 1, ...place }),
    'Position report, 47.500000\u00b0 N, 2.250000\u00b0 W, depth 3.0 m, \u00b11.5 m (30 s ago, 1 error corrected)',
  );
});

test('the age of a pulse goes on while the page hears nothing', () => {
  assert.equal(pulseAge({ age_s: null }, 3), null);
  assert.equal(pulseAge({ age_s: 1.5 }, 3), 4.5);
  assert.equal(pulseAge({ age_s: 1.5 }, null), 1.5);
});

test('only a placed beacon of a fitted array is in the picture', () => {
  const beacon = { north_m: 3, east_m: 4 };
  assert.deepEqual(extentOfAcoustics({ enabled: true, beacon }), [[3, 4]]);
  assert.deepEqual(extentOfAcoustics({ enabled: false, beacon }), []);
  assert.deepEqual(extentOfAcoustics({ enabled: true, beacon: { north_m: null, east_m: null } }), []);
  assert.deepEqual(extentOfAcoustics(null), []);
});

test('the model keeps the newest message of the array and when it came', () => {
  const model = new Model();
  assert.equal(
    model.receive(JSON.stringify({ topic: 'acoustics', t: 10, data: { enabled: true } }), 500),
    'acoustics',
  );
  assert.deepEqual(model.acoustics, { enabled: true });
  assert.equal(model.acousticsAtMs, 500);
  assert.equal(model.receive(JSON.stringify({ topic: 'acoustics', t: 10, data: [] }), 600), null);
});
