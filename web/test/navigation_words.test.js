import assert from 'node:assert/strict';
import test from 'node:test';

import { resultText } from '../dashboard/calibration.js';
import { place, verdict } from '../dashboard/consistency.js';
import { Model } from '../dashboard/model.js';
import { ROWS, currentOf, trustSentence } from '../dashboard/navigation_card.js';

const GPS = { id: 'gps', label: 'GPS', trust: 'used', nis_ratio: 1.1, nis_band: [0.7, 1.4] };
const COMPASS = { id: 'compass', label: 'Compass', trust: 'used', nis_ratio: 1.0, nis_band: [0.7, 1.4] };

test('the verdict names what is not trusted before anything else', () => {
  assert.equal(verdict([]), 'Waiting for the navigator');
  assert.equal(verdict([GPS, COMPASS]), 'All sensors agree as well as they claim.');
  assert.match(verdict([{ ...GPS, trust: 'rejected', nis_ratio: 9 }, COMPASS]), /^Not trusted: GPS\./);
  assert.match(verdict([{ ...GPS, nis_ratio: 3 }, COMPASS]), /^GPS: farther off than claimed/);
  assert.match(verdict([{ ...GPS, nis_ratio: 0.2 }, COMPASS]), /GPS better than claimed/);
  assert.equal(verdict([{ ...GPS, trust: 'waiting' }]), 'No sensor is used yet.');
  assert.match(
    verdict([{ ...GPS, reason: 'half as fast as usual' }, COMPASS]),
    /^GPS: used, but something is odd/,
  );
});

test('ten times too good and ten times too bad are the ends of the bar', () => {
  assert.equal(place(1), 50);
  assert.equal(place(10), 100);
  assert.equal(place(0.1), 0);
  assert.equal(place(0), 0);
  assert.equal(place(1e9), 100);
});

test('the card says what the estimate rests on', () => {
  assert.equal(trustSentence([GPS, COMPASS]), 'Rests on GPS, Compass.');
  assert.match(trustSentence([GPS, { ...COMPASS, trust: 'ignored' }]), /Not trusted: Compass/);
  assert.equal(trustSentence(undefined), '');
});

test('a current below its uncertainty has no direction', () => {
  assert.deepEqual(currentOf({ current: { north_mps: 0, east_mps: 0.2, std_mps: 0.05 } }), {
    speed: 0.2,
    towards: 90,
  });
  assert.equal(currentOf({ current: { north_mps: 0.01, east_mps: 0.01, std_mps: 0.05 } })?.towards, null);
  assert.equal(currentOf({ current: { north_mps: null, east_mps: 1, std_mps: null } }), null);
});

test('each value is "-" while it is unknown, none is 0', () => {
  for (const state of [
    {},
    { position: { north_m: null }, velocity: null, current: {}, attitude: {}, ellipse: {} },
  ])
    for (const row of ROWS) assert.equal(row.text(state), '-', row.label);
});

test('a calibration without a residual claims none', () => {
  assert.equal(resultText({ state: 'none', residual: null }), 'Not made yet');
  assert.equal(resultText({ state: 'done', residual: null }), 'Made, residual unknown');
  assert.match(
    resultText({ state: 'done', residual: 0.0123, unit: 'deg', made_unix_s: null }),
    /^Residual 0.012 deg$/,
  );
});

test('the model takes the topic, and nothing that only looks like it', () => {
  const model = new Model();
  assert.equal(
    model.receive(JSON.stringify({ topic: 'navigation', t: 5, data: { mode: 'aided' } }), 1000),
    'navigation',
  );
  assert.equal(model.navigation?.mode, 'aided');
  assert.equal(model.navigationAtMs, 1000);
  assert.equal(model.receive(JSON.stringify({ topic: 'navigation', t: 6, data: null }), 2000), null);
  assert.equal(model.navigationAtMs, 1000);
});
