// @ts-check
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { contactsCsv, contactsOf, nextName } from '../viewer/contacts.js';
import { candidates } from '../viewer/feed.js';
import { KEYS, isTakenBy, keyFor } from '../viewer/keyboard.js';
import { PALETTES } from '../viewer/palettes.js';
import { parsePreferences } from '../viewer/preferences.js';
import { amplitudeText, positionOf, positionText } from '../viewer/readout.js';
import { FIELDS, outcomeText, parseField, readBack, samplesFor } from '../viewer/sonar_fields.js';
import { FIRST_CHIPS, chipsOf, originOf, waitingText } from '../viewer/status.js';
import { Track } from '../viewer/track.js';
import { widgetOptions } from '../viewer/widget.js';
import { detailLines } from '../shared/status_strip.js';

/** @type {import('../viewer/contacts.js').Contact} */
const CONTACT = {
  id: 'a1',
  name: 'Anchor',
  note: '',
  channel: 'A',
  ping_number: 7,
  range_m: 12.5,
  time_unix_s: 1.7e9,
  latitude_deg: null,
  longitude_deg: null,
  position_within_m: null,
  ground_range_m: null,
};

const ALIVE = { ageS: 0.1, perS: 10, missed: 0, loss: { pings: 600, lost: 0, incomplete: 3 } };

/** @type {import('../viewer/status.js').Facts} */
const FACTS = {
  phase: 'open',
  coarse: false,
  status: {
    extension_link: true,
    chips: [
      { id: 'link', label: 'Link', state: 'ok', text: '55 frames/s' },
      { id: 'sonar_a', label: 'Sonar A', state: 'ok', text: '10.0 pings/s' },
      { id: 'sonar_b', label: 'Sonar B', state: 'ok', text: '10.0 pings/s' },
      { id: 'imu', label: 'IMU', state: 'ok', text: 'Nine axes' },
      { id: 'depth', label: 'Depth', state: 'ok', text: '2.46 m' },
      { id: 'ctd', label: 'CTD', state: 'ok', text: '34.6 PSU' },
      { id: 'gps', label: 'GPS', state: 'ok', text: 'Fix' },
      { id: 'recorder', label: 'Recorder', state: 'ok', text: 'Recording' },
      { id: 'mavlink', label: 'MAVLink', state: 'ok', text: 'Sending' },
      { id: 'navigation', label: 'Navigation', state: 'ok', text: 'Known within 2.1 m' },
      { id: 'acoustics', label: 'Acoustics', state: 'ok', text: 'Fix within 2.1 m' },
    ],
    channels: {
      A: { alive: true, pings: 100, incomplete: 0 },
      B: { alive: false, pings: 100, incomplete: 0 },
    },
  },
  statusAgeS: 0.5,
  channels: { A: ALIVE, B: ALIVE },
  malformed: 0,
};

/** The status with other chips of the extension. @param {object[]} changed */
function reported(...changed) {
  const chips = FACTS.status.chips.map((/** @type {any} */ chip) => ({
    ...chip,
    ...changed.find((/** @type {any} */ change) => change.id === chip.id),
  }));
  return { ...FACTS.status, chips };
}

/** @param {Partial<import('../viewer/status.js').Facts>} change @param {string} id */
function chip(change, id) {
  const found = chipsOf({ ...FACTS, ...change }).find((candidate) => candidate.id === id);
  assert.ok(found);
  return found;
}

test('all is well: every chip of the dashboard, each with a place reserved before', () => {
  const chips = chipsOf(FACTS);
  assert.deepEqual(
    chips.map(({ id }) => id),
    FIRST_CHIPS.map(({ id }) => id),
  );
  assert.ok(chips.every(({ state }) => state === 'ok'));
});

test('every fault names its cause and its cure', () => {
  const silent = { ...ALIVE, ageS: 12 };
  const faults = [
    chip({ phase: 'waiting' }, 'link'),
    chip({ coarse: true }, 'link'),
    chip({ malformed: 3 }, 'link'),
    chip({ channels: { A: silent, B: silent } }, 'sonar_a'),
    chip({ channels: { A: silent, B: silent } }, 'sonar_b'),
    chip({ channels: { ...FACTS.channels, A: { ...ALIVE, missed: 5 } } }, 'loss'),
    chip({ status: { ...FACTS.status, extension_link: false } }, 'link'),
  ];
  for (const fault of faults) {
    assert.ok(fault.state === 'fault' || fault.state === 'warn', fault.id);
    assert.ok(fault.cause && fault.cure, fault.id);
  }
});

test('a sonar that answers but does not ping is told from one that is dead', () => {
  const silent = { ...ALIVE, ageS: Infinity, perS: NaN };
  const channels = { A: silent, B: silent };
  assert.match(String(chip({ channels }, 'sonar_a').cause), /answers/);
  assert.match(String(chip({ channels }, 'sonar_b').cure), /12 V/);
});

test('loss is lost and incomplete pings of both sides together', () => {
  const bad = { ...ALIVE, loss: { pings: 90, lost: 10, incomplete: 0 } };
  const good = { ...ALIVE, loss: { pings: 100, lost: 0, incomplete: 0 } };
  assert.equal(chip({ channels: { A: bad, B: good } }, 'loss').text, '5.0 %');
  assert.equal(chip({ channels: { A: bad, B: good } }, 'loss').state, 'warn');
  assert.equal(chip({ channels: { A: good, B: good } }, 'loss').state, 'ok');
  const none = { ...ALIVE, loss: { pings: 0, lost: 0, incomplete: 0 } };
  assert.equal(chip({ channels: { A: none, B: none } }, 'loss').text, '-');
});

test('an ESP32 that is not there is the fault of the link, not of the sonars behind it', () => {
  const silent = { ...ALIVE, ageS: 12 };
  const status = reported(
    { id: 'link', state: 'fault', text: 'ESP32 not found', cause: 'No port.', cure: 'Plug it in.' },
    { id: 'sonar_a', state: 'unknown', text: 'No link' },
    { id: 'sonar_b', state: 'unknown', text: 'No link' },
  );
  const facts = { status, channels: { A: silent, B: silent } };
  assert.equal(chip(facts, 'link').text, 'ESP32 not found');
  assert.equal(chip(facts, 'link').cure, 'Plug it in.');
  assert.equal(chip(facts, 'sonar_a').state, 'unknown');
  assert.equal(chip(facts, 'sonar_a').label, 'Stbd A');
});

test('what the extension says of a silent sonar is told with its cause', () => {
  const channels = { A: { ...ALIVE, ageS: 12 }, B: ALIVE };
  const status = reported({
    id: 'sonar_a',
    state: 'fault',
    text: 'Silent',
    cause: 'No answer.',
    cure: '12 V.',
  });
  assert.equal(chip({ status, channels }, 'sonar_a').cause, 'No answer.');
  assert.equal(chip({ status, channels }, 'sonar_b').state, 'ok');
});

test('where there is no room, the worst of the other parts speaks for all', () => {
  assert.equal(chip({}, 'others').state, 'ok');
  const status = reported(
    { id: 'gps', state: 'warn', text: 'No fix', cause: 'Sky.', cure: 'Wait.' },
    { id: 'recorder', state: 'fault', text: 'Disk full', cause: 'Full.', cure: 'Delete.' },
  );
  const others = chip({ status }, 'others');
  assert.deepEqual([others.state, others.cure], ['fault', 'Delete.']);
  assert.equal(others.text, 'Recorder: Disk full');
  assert.deepEqual(
    detailLines(others).filter(([label]) => label === 'GPS' || label === 'Depth'),
    [
      ['Depth', '2.46 m'],
      ['GPS', 'No fix'],
    ],
  );
});

test('chips of an extension that fell silent are forgotten', () => {
  assert.equal(chip({ statusAgeS: 5 }, 'depth').state, 'unknown');
});

test('without a connection nothing is claimed about what lies behind it', () => {
  for (const id of ['sonar_a', 'sonar_b', 'loss', 'imu', 'recorder', 'others']) {
    assert.equal(chip({ phase: 'waiting' }, id).state, 'unknown');
  }
});

test('a replay and a simulation are called so, whoever says it first', () => {
  assert.equal(originOf(null, false), '');
  assert.equal(originOf(null, true), 'SIMULATED');
  assert.equal(originOf({ simulated: false, source: 'serial' }, true), '');
  assert.equal(originOf({ simulated: true, source: 'serial' }, false), 'SIMULATED');
  assert.equal(originOf({ simulated: false, source: 'replay' }, false), 'REPLAY');
});

test('the empty picture says what it waits for', () => {
  const open = { connection: { state: { phase: 'open' } } };
  assert.equal(waitingText(open, true, null), null);
  assert.match(
    waitingText({ connection: { state: { phase: 'waiting' } } }, false, null)?.title ?? '',
    /Connecting/,
  );
  assert.match(waitingText(open, false, { extension_link: false })?.title ?? '', /extension/);
  assert.match(waitingText(open, false, { extension_link: true })?.text ?? '', /12 V/);
  const chips = [
    { id: 'link', state: 'fault', text: 'ESP32 not found', cause: 'No port.', cure: 'Plug it in.' },
  ];
  assert.deepEqual(waitingText(open, false, { extension_link: true, chips }), {
    title: 'ESP32 not found',
    text: 'No port. Plug it in.',
  });
});

test('the socket beside the page comes first, our own ports only on plain http', () => {
  assert.deepEqual(candidates('http://192.168.2.2/extensionv2/sonar/'), [
    'ws://192.168.2.2/extensionv2/sonar/ws',
    'ws://192.168.2.2:8100/ws',
    'ws://192.168.2.2:8101/',
  ]);
  assert.deepEqual(candidates('http://blueos.local:8100/'), [
    'ws://blueos.local:8100/ws',
    'ws://blueos.local:8101/',
  ]);
  assert.deepEqual(candidates('https://blueos.local/extensionv2/sonar/'), [
    'wss://blueos.local/extensionv2/sonar/ws',
  ]);
});

test('contacts are read from a list or an object; what cannot be shown is left out', () => {
  assert.deepEqual(contactsOf({ contacts: [CONTACT, { id: 'x' }, null] }), [CONTACT]);
  assert.deepEqual(contactsOf([CONTACT]), [CONTACT]);
  assert.deepEqual(contactsOf('nonsense'), []);
});

test('CSV quotes what needs it, leaves unknown empty and disarms formulas', () => {
  const csv = contactsCsv([{ ...CONTACT, name: 'a "big", one', note: '=1+1' }]);
  const [head, row] = csv.split('\r\n');
  assert.equal(head.split(',').length, 11);
  assert.equal(row, `a1,"a ""big"", one",'=1+1,A,7,12.5,1700000000,,,,`);
});

test('a new contact gets a name that nobody has', () => {
  assert.equal(nextName([]), 'Contact 1');
  assert.equal(nextName([CONTACT, { ...CONTACT, name: 'Contact 3' }]), 'Contact 4');
});

test('no two keys do different things', () => {
  const all = KEYS.flatMap((key) => key.keys);
  assert.equal(new Set(all).size, all.length);
});

test('keys are found by name, with Shift only where it matters, never with Ctrl', () => {
  const event = { shiftKey: false, ctrlKey: false, altKey: false, metaKey: false };
  assert.match(keyFor({ ...event, key: ' ' })?.does ?? '', /Pause/);
  assert.equal(keyFor({ ...event, key: 'S', shiftKey: true }), keyFor({ ...event, key: 's' }));
  assert.notEqual(keyFor({ ...event, key: 'ArrowUp', shiftKey: true }), keyFor({ ...event, key: 'ArrowUp' }));
  assert.equal(keyFor({ ...event, key: 's', ctrlKey: true }), null);
  assert.match(keyFor({ ...event, key: '?', shiftKey: true })?.does ?? '', /list/);
});

test('a control keeps the keys that it needs itself', () => {
  /** @param {string} selector @returns {any} */
  const element = (selector) => ({
    closest: () => null,
    matches: (/** @type {string} */ asked) => asked.split(', ').some((part) => part.startsWith(selector)),
  });
  assert.equal(isTakenBy(null, ' '), false);
  assert.equal(isTakenBy(element('button'), ' '), true);
  assert.equal(isTakenBy(element('button'), 'p'), false);
  assert.equal(isTakenBy(element('input[type=range]'), 'ArrowUp'), true);
  assert.equal(isTakenBy(element('input[type=range]'), 'p'), false);
  assert.equal(isTakenBy(element('textarea'), 'p'), true);
});

test('damaged or foreign preferences fall back to defaults, key by key', () => {
  const defaults = parsePreferences(null);
  assert.deepEqual(parsePreferences('{'), defaults);
  assert.deepEqual(parsePreferences('[1]'), defaults);
  const some = parsePreferences(
    '{"palette":"grey","layout":"upside","gain":{"gainDb":3,"gamma":"x"},"more":1}',
  );
  assert.equal(some.palette, 'grey');
  assert.equal(some.layout, defaults.layout);
  assert.deepEqual(some.gain, { gainDb: 3 });
});

test('typed settings are checked against the limits of the service', () => {
  const range = FIELDS[0];
  assert.deepEqual(parseField(range, ' 12,5 ', undefined), { value: 12.5 });
  for (const text of ['', 'abc', '0', '201'])
    assert.ok('problem' in parseField(range, text, [0.1, 200]), text);
});

test('what was asked and what was read are told apart', () => {
  const sonar = {
    A: { asked: { range_m: 30 }, read: { range_m: 20 } },
    B: { asked: {}, read: { range_m: 20 } },
  };
  assert.deepEqual(readBack('range_m', 1, sonar, ['A', 'B']), {
    text: 'Reads A 20.0 (asked 30.0), B 20.0',
    differs: true,
  });
  assert.deepEqual(readBack('range_m', 1, sonar, ['B']), { text: 'Reads 20.0', differs: false });
  assert.deepEqual(readBack('pulses', 0, null, ['A']), { text: 'Not read yet', differs: false });
  assert.equal(samplesFor(30, 20), 1500);
  assert.ok(Number.isNaN(samplesFor(30, null)));
});

test('the outcome names each sonar, and one refusal is not called done', () => {
  const both = outcomeText({ A: { ok: true, message: 'set' }, B: { ok: false, message: 'no answer' } });
  assert.deepEqual(both, { ok: false, text: 'A: set. B: no answer' });
});

test('a position is only as near as the vehicle said it was', () => {
  const track = new Track();
  const state = { heading_deg: 0, depth_m: 1, latitude_deg: 1, longitude_deg: 2 };
  for (const timeS of [10, 11, 12, 11.5]) track.add({ ...state, timeS });
  assert.equal(track.states.length, 3);
  assert.equal(track.at(10.4)?.timeS, 10);
  assert.equal(track.at(13.9)?.timeS, 12);
  assert.equal(track.at(14.1), null);
  assert.equal(new Track().at(1), null);
});

test('what the service remembers fills what the page has not heard', () => {
  const track = new Track();
  const live = { heading_deg: 0, depth_m: 1, latitude_deg: 1, longitude_deg: 2 };
  for (const timeS of [10, 10.5, 20]) track.add({ ...live, timeS });
  const columns = ['monotonic_s', 'heading_deg', 'depth_m', 'estimate.latitude_deg', 'estimate.within_m'];
  const rows = [5, 10.1, 15, 20.1].map((timeS) => [timeS, 90, null, 47.5, 3]);
  track.load({ columns, states: [...rows, [null, 1, 1, 1, 1]] });
  assert.deepEqual(
    track.states.map((state) => state.timeS),
    [5, 10, 10.5, 15, 20],
  );
  assert.equal(track.at(5)?.estimate?.latitude_deg, 47.5);
  assert.equal(track.at(5)?.depth_m, null);
  assert.equal(track.at(10.1)?.heading_deg, 0);
  track.load(null);
  track.add({ ...live, timeS: 21 });
  assert.equal(track.states.length, 6);
});

test('an echo lies to the side of the estimate, with its uncertainty, and says what was assumed', () => {
  const gps = { heading_deg: 90, depth_m: 5, latitude_deg: 10, longitude_deg: 20 };
  const estimate = {
    latitude_deg: 47.6,
    longitude_deg: -2.7,
    within_m: 3,
    heading_deg: 0,
    heading_std_deg: 2,
    altitude_m: 6,
  };
  const spot = { channel: /** @type {const} */ ('A'), rangeM: 10, timeS: 1 };
  const at = (/** @type {object} */ change) => {
    const track = new Track();
    track.add({ ...gps, timeS: 1, estimate: { ...estimate, ...change } });
    return track;
  };
  // 3-4-5: slant 10 m from 6 m above the bottom is 8 m over ground, due east of a vehicle that heads north.
  const found = positionOf(spot, at({}));
  assert.equal(found?.groundM, 8);
  assert.ok(Math.abs((found?.latitudeDeg ?? 0) - 47.6) < 1e-9);
  assert.ok(
    Math.abs((found?.longitudeDeg ?? 0) + 2.7 - 8 / (111194.93 * Math.cos((47.6 * Math.PI) / 180))) < 1e-8,
  );
  assert.ok(Math.abs((found?.withinM ?? 0) - Math.hypot(3, (8 * 4 * Math.PI) / 180)) < 1e-9);
  assert.match(positionText(spot, at({})), / \u00b13\.1 m$/);
  assert.equal(positionOf(spot, at({ altitude_m: null }))?.groundM, null);
  assert.match(positionText(spot, at({ altitude_m: null })), /m slant$/);
  assert.equal(positionOf({ ...spot, rangeM: 5 }, at({}))?.groundM, null);
  assert.equal(positionOf(spot, at({ heading_std_deg: null }))?.withinM, null);
  // Without an estimate the GPS, whose error nobody tells; without both nothing.
  const surface = positionOf(spot, at({ latitude_deg: null }));
  assert.ok((surface?.latitudeDeg ?? 99) < 10 && surface?.withinM === null);
  const none = new Track();
  none.add({ ...gps, latitude_deg: null, timeS: 1 });
  assert.equal(positionText(spot, none), '-');
});

test('amplitude, missing part and nothing are three different words', () => {
  assert.equal(amplitudeText(255), '255 (100 %)');
  assert.equal(amplitudeText('gap'), 'missing');
  assert.equal(amplitudeText(null), '-');
});

test('the widget takes its options from the address and survives nonsense', () => {
  const options = (/** @type {string} */ query) => widgetOptions(new URLSearchParams(query));
  assert.deepEqual(options('channel=a&palette=viridis'), {
    layout: 'A',
    palette: 'viridis',
    inverted: false,
  });
  assert.deepEqual(options('channel=C&palette=x&inverted=1'), {
    layout: 'side',
    palette: PALETTES[0].id,
    inverted: true,
  });
});
