// @ts-check
import assert from 'node:assert/strict';
import { afterEach, test } from 'node:test';
import { bannerText, connectionFault, streamFault } from '../dashboard/banner.js';
import { counterParts, counterRows, counterText } from '../dashboard/counters.js';
import { fullScale } from '../dashboard/depth_gauge.js';
import { ratesBody } from '../dashboard/esp32_panel.js';
import { answerSentence, portOf } from '../dashboard/mavlink_panel.js';
import { Follower, turnDeg } from '../dashboard/motion.js';
import { csvOfSpan, fileStamp } from '../dashboard/plot_export.js';
import { parseTail } from '../dashboard/prefill.js';
import { clockSentence, factsOf } from '../dashboard/recording_entry.js';
import { recorderSentence } from '../dashboard/recordings.js';
import {
  defaultText,
  inputText,
  kindOf,
  limitsText,
  parseInput,
  sameValue,
  wordsOf,
} from '../dashboard/setting_values.js';
import { socketCandidates } from '../dashboard/source.js';
import { timeSplits } from '../dashboard/time_axis.js';
import { aloneInWater } from '../dashboard/profile_plot.js';
import { roomyRange } from '../dashboard/time_plots.js';
import { TROUBLES, isRelated } from '../dashboard/troubleshooting.js';
import { honestScale } from '../dashboard/uplot.js';
import { inShownUnits, setUnits, shownUnit, shownValue } from '../shared/display.js';
import { asState } from '../shared/status_icons.js';
import { detailLines, hintOf } from '../shared/status_strip.js';
import { choosePreference } from '../shared/theme.js';

afterEach(() => setUnits('metric'));

/** @param {Partial<import('../dashboard/setting_values.js').Setting>} parts */
const setting = (parts) => ({ key: 'group.name', value: parts.default, default: null, ...parts });

test('a fault is named with its cure, worst first, and the others are counted', () => {
  const faults = [
    { level: 'error', title: 'Sonar B is silent', cure: 'Check 12 V.' },
    { level: 'warning', title: 'No fix' },
  ];
  assert.deepEqual(bannerText(faults), {
    state: 'fault',
    title: 'Sonar B is silent',
    cure: 'Check 12 V.',
    more: '+1 more',
  });
  assert.equal(bannerText(faults.slice(1)).state, 'warn');
});

test('not knowing is not the same as no fault', () => {
  assert.equal(bannerText(null).state, 'unknown');
  assert.equal(bannerText([], [{ label: 'IMU', state: 'unknown' }]).state, 'unknown');
  assert.match(bannerText([], [{ label: 'IMU', state: 'unknown' }]).cure, /IMU/);
  assert.equal(bannerText([], [{ label: 'IMU', state: 'ok' }]).state, 'ok');
});

test("the page's own troubles have a cause and a cure", () => {
  for (const fault of [connectionFault(12), connectionFault(null), streamFault(3), streamFault(null)]) {
    assert.ok(fault.cause && fault.cure);
  }
  assert.match(connectionFault(12).cause ?? '', /12 s/);
});

test('each trouble of the list has a cure', () => {
  const titles = TROUBLES.map((trouble) => trouble.title).join('\n');
  for (const word of [
    /port/,
    /CRC/,
    /sonar/,
    /IMU/,
    /no fix/,
    /depth or temperature/,
    /reach the extension/,
  ]) {
    assert.match(titles, word);
  }
  assert.ok(TROUBLES.every((trouble) => trouble.cure.length > 0));
});

test('of the list, only what names a fault of now is marked', () => {
  const related = (/** @type {string[]} */ ...ids) =>
    TROUBLES.filter((trouble) =>
      isRelated(
        trouble,
        ids.map((id) => ({ id, title: id })),
      ),
    );
  assert.deepEqual(
    related('port_absent').map((trouble) => trouble.title),
    ['The serial port is not found'],
  );
  assert.deepEqual(
    related('sonar_a_silent', 'gps_no_fix').map((trouble) => trouble.title),
    ['A sonar is not detected', 'The GPS answers but has no fix'],
  );
  assert.deepEqual(related(), []);
});

test('only a layer alone in unmeasured water is drawn as a point', () => {
  const plot = /** @type {any} */ ({ data: [[], [17, null, 12, 11, null, 9]] });
  assert.deepEqual(aloneInWater(plot, 1), [0, 5]);
});

test('the marks of an axis say where they stand', () => {
  const { range, values } = honestScale(() => [0, 20]);
  range(null, 0, 20);
  const marks = (/** @type {number[]} */ splits, /** @type {number} */ step) =>
    values(null, splits, 0, 0, step);
  assert.deepEqual(marks([10, 12.5, 15], 2.5), ['10.0', '12.5', '15.0']);
  assert.deepEqual(marks([0.25, 0.5], 0.25), ['0.25', '0.50']);
  assert.deepEqual(marks([1, 2], 1), ['1', '2']);
  assert.deepEqual(marks([0.1, 0.2], 0.1), ['0.1', '0.2']);
  assert.deepEqual(marks([1500, 1520], 20), ['1500', '1520']);
});

test('an opened chip always says something', () => {
  assert.deepEqual(detailLines({ id: 'x', label: 'X', state: 'nonsense' }), [['State', 'Unknown']]);
  assert.deepEqual(
    detailLines({ id: 'x', label: 'X', state: 'fault', text: 'silent', cause: 'c', cure: 'd', age_s: 34 }),
    [
      ['State', 'silent'],
      ['Cause', 'c'],
      ['Cure', 'd'],
      ['Last data', '34 s ago'],
    ],
  );
  assert.equal(asState('__proto__'), 'unknown');
});

test('the hint of a chip holds its whole text and what is behind it, and no age that would change it', () => {
  const chip = { id: 'x', label: 'Acoustics', state: 'ok', text: 'Fix within 3.0 m', age_s: 0.4 };
  /** @type {Array<[string, string]>} */
  const parts = [['Distance', '20.0 m, within 2.0 m (95 %)']];
  assert.equal(
    hintOf({ ...chip, parts }),
    'Acoustics: Fix within 3.0 m\nDistance: 20.0 m, within 2.0 m (95 %)',
  );
  assert.equal(hintOf({ ...chip, cause: 'c', cure: 'd' }), 'Acoustics: Fix within 3.0 m\nCause: c\nCure: d');
  setUnits('imperial');
  assert.match(hintOf({ ...chip, parts }), /65\.6 ft, within 6\.6 ft/);
  setUnits('metric');
});

test('settings turn into inputs of their kind', () => {
  assert.equal(kindOf(setting({ default: true })), 'switch');
  assert.equal(kindOf(setting({ default: 115200, choices: [115200, 921600] })), 'choice');
  assert.equal(kindOf(setting({ default: 1.5 })), 'number');
  assert.equal(kindOf(setting({ default: null, minimum: 0 })), 'number');
  assert.equal(kindOf(setting({ default: ['a'] })), 'list');
  assert.equal(kindOf(setting({ default: [{ a: 1 }] })), 'json');
  assert.equal(kindOf(setting({ key: 'http.token', default: '' })), 'secret');
  assert.equal(kindOf(setting({ default: 'auto' })), 'text');
});

test('what was typed turns back into the same value', () => {
  const values = [
    true,
    false,
    0,
    -1.25,
    'auto',
    '',
    [],
    ['a', 'b.local'],
    [0, 0.2, -0.1],
    [{ host: 'a' }],
    { a: null },
  ];
  for (const value of values) {
    const one = setting({ default: value, value });
    assert.ok(sameValue(parseInput(one, inputText(value)).value, value), JSON.stringify(value));
  }
  assert.equal(parseInput(setting({ default: 115200, choices: [115200, 921600] }), '921600').value, 921600);
});

test('what cannot be sent is refused beside its input', () => {
  const limited = setting({ default: 5, minimum: 1, maximum: 10, unit: 'MB' });
  assert.equal(parseInput(limited, '11').error, 'Allowed: 1 to 10 MB');
  assert.equal(parseInput(limited, 'many').error, 'Write a number');
  assert.equal(parseInput(limited, '').error, 'Write a number');
  assert.equal(parseInput(limited, ' 2,5 ').value, 2.5);
  assert.match(parseInput(setting({ default: { a: 1 } }), '{').error, /Write it like/);
  assert.match(parseInput(setting({ default: [1, 2] }), '1, x').error, /numbers/);
  assert.deepEqual(parseInput(setting({ default: null, minimum: 0 }), ''), { value: null, error: '' });
});

test('settings have readable names, limits and defaults', () => {
  assert.equal(wordsOf('sonar.a_depression_deg'), 'A depression');
  assert.equal(wordsOf('mavlink.target_host'), 'Target host');
  assert.notEqual(wordsOf('recording.max_file_mb'), wordsOf('recording.max_file_minutes'));
  assert.equal(limitsText(setting({ minimum: 1 })), 'at least 1');
  assert.equal(limitsText(setting({})), '');
  assert.equal(defaultText(setting({ default: false })), 'off');
  assert.equal(defaultText(setting({ default: [] })), 'none');
  assert.equal(defaultText(setting({ default: 256, unit: 'MB' })), '256 MB');
});

test('any counter is shown with its unit, and null as a dash', () => {
  assert.equal(counterText('bytes', 12345678), '12.3 MB');
  assert.equal(counterText('bytes_per_s', 1000), '1.00 kB/s');
  assert.equal(counterText('lost_percent', 0.25), '0.3 %');
  assert.equal(counterText('error', null), '-');
  assert.equal(counterText('steps', []), 'none');
  assert.equal(counterText('x', NaN), '-');
  assert.equal(counterText('file', '/a/b/session_1/link_000.mcap'), 'session_1/link_000.mcap');
});

test('counters inside counters are spread out, each label once', () => {
  const rows = counterRows({
    bytes: 1,
    bytes_per_s: 2,
    frames_by_type: { '0x01': 3, 4: 5, '0x7f': 1 },
    by_message: { sent: { ATTITUDE: 2 } },
  });
  const labels = rows.map(([label]) => label);
  assert.equal(new Set(labels).size, labels.length);
  assert.ok(
    labels.includes('0x01 SENSORS') &&
      labels.includes('4 KOGGER_COMPRESSED') &&
      labels.includes('Sent: ATTITUDE'),
  );
  assert.ok(labels.includes('0x7f unknown type'));
});

test('parts that have not reported say so', () => {
  for (const status of [{}, { link: null, sonars: null, forwarding: 7, versions: null }]) {
    const parts = new Map(counterParts(status));
    assert.deepEqual(parts.get('Link'), [['Has not reported', '-']]);
  }
});

test('MAVLink says whether anybody answers', () => {
  assert.equal(answerSentence(undefined).state, 'unknown');
  assert.equal(answerSentence({ enabled: false }).state, 'off');
  const silent = answerSentence({
    enabled: true,
    target: 'h:14401',
    sent: 12,
    peer_alive: false,
    last_heard_s: 40,
  });
  assert.equal(silent.state, 'warn');
  assert.match(silent.text, /nobody answers.*40 s ago/);
  assert.equal(
    answerSentence({ enabled: true, sent: 1, peer_alive: true, peer: '1/1', received: 3 }).state,
    'ok',
  );
  assert.equal(portOf('127.0.0.1:14999'), '14999');
  assert.equal(portOf(null), '14401');
});

test('rates of the ESP32 keep their limits', () => {
  assert.deepEqual(ratesBody(['2', '', '']), { body: { sensors_rate_hz: 2 }, error: '' });
  assert.deepEqual(ratesBody(['0,5', '20', '4']).body, {
    sensors_rate_hz: 0.5,
    imu_rate_hz: 20,
    decimation: 4,
  });
  for (const wrong of [
    ['21', '', ''],
    ['', '0', ''],
    ['', '', '2.5'],
    ['x', '', ''],
    ['', '', ''],
  ]) {
    assert.notEqual(ratesBody(wrong).error, '');
  }
});

test('the socket is sought beside the page first, then past the proxy', () => {
  assert.deepEqual(socketCandidates('http://blueos.local/extensionv2/blueslam/'), [
    'ws://blueos.local/extensionv2/blueslam/ws',
    'ws://blueos.local:8099/ws',
    'ws://blueos.local:8766/',
  ]);
  assert.deepEqual(socketCandidates('http://h:8099/'), ['ws://h:8099/ws', 'ws://h:8766/']);
  assert.deepEqual(socketCandidates('https://h/x/'), ['wss://h/x/ws']);
});

test('the recorder is told in one sentence', () => {
  assert.match(recorderSentence(null), /not reported/);
  assert.match(recorderSentence({ state: 'stopped' }), /Not recording/);
  const running = {
    state: 'recording',
    file: '/x/session_20260101_000000/link_000.mcap',
    bytes: 1000,
    bytes_per_s: 10,
    dropped: 3,
  };
  assert.match(recorderSentence(running), /session_20260101_000000: .*3 records LOST/);
  assert.equal(recorderSentence({ state: 'recording', error: 'Disk full.' }), 'Disk full.');
});

test('a dive with a wrong clock says so', () => {
  assert.equal(clockSentence({ wall_clock_trusted: true }), '');
  assert.match(clockSentence({ wall_clock_trusted: false, gps_utc_offset_s: -3600 }), /\u22123600\.0 s/);
  assert.match(clockSentence({ wall_clock_trusted: false, gps_utc_offset_s: null }), /no GPS time/);
  assert.match(factsOf({}), /^- \u00b7 - \u00b7 -/);
});

test('marks of the time axis stand on whole steps of the wall clock and fit', () => {
  for (const [span, most] of [
    [60, 7],
    [600, 4],
    [3600, 7],
    [3600, 2],
    [0.1, 7],
    [1e6, 7],
  ]) {
    const zero = 1_795_339_352.37;
    const splits = timeSplits(1000, 1000 + span, zero, most);
    assert.ok(splits.length <= most + 1 || span > 4e4, `${span} s: ${splits.length}`);
    for (const split of splits)
      assert.ok(Math.abs(((split + zero) % 1) - 0) < 1e-3 || Math.abs(((split + zero) % 1) - 1) < 1e-3);
  }
});

test('a plot of nothing has no scale, and noise does not fill one', () => {
  assert.deepEqual(roomyRange(null, null, 1), [null, null]);
  assert.deepEqual(roomyRange(NaN, 1, 1), [null, null]);
  const [low, high] = roomyRange(5, 5.001, 1);
  assert.ok(Number(high) - Number(low) >= 0.99);
});

test('the table of what is seen leaves unknown fields empty', () => {
  const quantities = [
    { key: 'depth', label: 'Depth', unit: 'm' },
    { key: 'temperature', label: 'Temperature', unit: '\u00b0C' },
  ];
  const csv = csvOfSpan(
    quantities,
    [0, 1, 2],
    [
      [1.5, null, 2],
      [null, null, 9],
    ],
    (s) => s + 1_000_000_000,
  );
  assert.deepEqual(csv.split('\r\n'), [
    'time_utc,unix_s,depth [m],temperature [\u00b0C]',
    '2001-09-09T01:46:40.000Z,1000000000.000,1.5,',
    '2001-09-09T01:46:42.000Z,1000000002.000,2,9',
    '',
  ]);
  assert.equal(fileStamp(1_000_000_000), '20010909-014640');
});

test('the cut lines of a log tail are skipped', () => {
  const line = JSON.stringify({ ts: 1, imu: { r: 1 }, t_unix: 5 });
  assert.deepEqual(
    parseTail(`"r": 1}\n${line}\n{"other": 1}\n{"ts": 2, "im`).map((row) => row.unixS),
    [5],
  );
});

test('a pointer turns the short way and arrives', () => {
  assert.equal(turnDeg(350, 10), 20);
  assert.equal(turnDeg(-170, 170), -20);
  const follower = new Follower(true, 0.1);
  follower.aim(350);
  follower.aim(10);
  let steps = 0;
  while (follower.step(1 / 60, false)) {
    assert.ok(Math.abs(turnDeg(0, follower.shown)) <= 10.1, String(follower.shown));
    steps += 1;
    assert.ok(steps < 100);
  }
  assert.equal(follower.shown, 10);
});

test('reduced motion arrives at once', () => {
  const follower = new Follower(false, 0.1);
  follower.aim(0);
  follower.aim(100);
  assert.equal(follower.step(1 / 60, true), false);
  assert.equal(follower.shown, 100);
});

test('the depth gauge leaves water below the deepest point', () => {
  for (const deepest of [0, 4, 9.9, 60, 299, 9000]) assert.ok(fullScale(deepest) > deepest);
});

test('units are converted only when shown', () => {
  assert.equal(shownUnit('m'), 'm');
  setUnits('imperial');
  assert.equal(shownUnit('m'), 'ft');
  assert.ok(Math.abs(Number(shownValue(0.3048, 'm')) - 1) < 1e-12);
  assert.equal(shownValue(100, '\u00b0C'), 212);
  assert.equal(shownValue(null, 'm'), null);
  assert.equal(shownValue(35, 'PSU'), 35);
  assert.equal(
    inShownUnits('Dead reckoning, within 8.0 m, 3 min since the last fix'),
    'Dead reckoning, within 26.2 ft, 3 min since the last fix',
  );
  assert.equal(
    inShownUnits('Current known to 0.05 m/s, moved 1 km'),
    'Current known to 0.16 ft/s, moved 0.6 mi',
  );
  for (const same of ['20 min', '5 m2', '3 m/min', 'A10 m', '12 mm', '1025 kg/m3', 'channels 1 to 6'])
    assert.equal(inShownUnits(same), same);
  setUnits('metric');
  assert.equal(inShownUnits('within 8.0 m'), 'within 8.0 m');
  setUnits('imperial');
});

test('the theme follows the address, then the switch, then the system', () => {
  assert.equal(choosePreference('dark', 'light'), 'dark');
  assert.equal(choosePreference('pink', 'light'), 'light');
  assert.equal(choosePreference(null, null), 'auto');
});
