// @ts-check
// The dashboard: joins the source of messages, the model and the pages. Each part is in a file of its own.

import { byId, setAttribute, setText } from '../shared/dom.js';
import { age } from '../shared/format.js';
import { showState } from '../shared/status_icons.js';
import { StatusStrip, unknownChips } from '../shared/status_strip.js';
import { startTheme } from '../shared/theme.js';
import { Banner, connectionFault } from './banner.js';
import { HealthPage } from './health.js';
import { LivePage } from './live.js';
import { Model, STALE_S, ageS } from './model.js';
import { prefill } from './prefill.js';
import { RecordingsPage } from './recordings.js';
import { SettingsPage } from './settings.js';
import { Source } from './source.js';
import { Tabs } from './tabs.js';

const CHIPS = /** @type {Array<[string, string]>} */ ([
  ['link', 'Link'],
  ['sonar_a', 'Sonar A'],
  ['sonar_b', 'Sonar B'],
  ['imu', 'IMU'],
  ['depth', 'Depth'],
  ['ctd', 'CTD'],
  ['gps', 'GPS'],
  ['recorder', 'Recorder'],
  ['mavlink', 'MAVLink'],
]);
const REFRESH_MS = 250;
/** Status comes each second: three missed are a silence. */
const STATUS_STALE_S = STALE_S + 1.5;

const model = new Model();
const strip = new StatusStrip(byId('strip', HTMLElement), unknownChips(CHIPS));
const connection = byId('connection', HTMLElement);
const badge = byId('source-badge', HTMLElement);
let phase = 'connecting';

startTheme(byId('theme', HTMLButtonElement));
const live = new LivePage(byId('panel-live', HTMLElement), model);
const recordings = new RecordingsPage(byId('panel-recordings', HTMLElement), model);
const settings = new SettingsPage(byId('panel-settings', HTMLElement), model);
const health = new HealthPage(byId('panel-health', HTMLElement), model);
/** @type {Record<string, {show: () => void}>} */
const pages = { live, recordings, settings, health };
const tabs = new Tabs(byId('tabs', HTMLElement), (id) => pages[id]?.show());
const banner = new Banner(byId('banner', HTMLElement), () => {
  tabs.show('health');
  byId('panel-health', HTMLElement).focus();
});

/** @param {unknown} text */
function onMessage(text) {
  const nowMs = performance.now();
  const changed = model.receive(text, nowMs);
  if (changed === 'sensors') live.onSensors(nowMs);
  else if (changed === 'status') onStatus();
  else if (changed === 'event') health.onEvents();
}

function onStatus() {
  const status = model.status ?? {};
  if (Array.isArray(status.chips)) strip.update(status.chips.filter((chip) => typeof chip?.id === 'string'));
  const word = status.source === 'replay' ? 'REPLAY' : status.simulated === true ? 'SIMULATED' : '';
  setText(badge, word);
  badge.hidden = word === '';
  live.onStatus();
  recordings.onStatus();
  settings.onStatus();
  health.onStatus();
  refresh();
}

function showConnection(/** @type {number} */ nowMs) {
  const heard = ageS(Math.max(model.sensorsAtMs || 0, model.statusAtMs || 0) || NaN, nowMs);
  const lost = phase !== 'open' && (heard === null || heard > STALE_S);
  const silent = phase === 'open' && heard !== null && heard > STATUS_STALE_S;
  const state = lost ? 'fault' : silent ? 'warn' : heard === null ? 'unknown' : 'ok';
  setAttribute(connection, 'data-state', state);
  const icon = connection.querySelector('.state-icon');
  const text = connection.querySelector('.connection-text');
  if (icon instanceof HTMLElement) showState(icon, state);
  const word = {
    ok: 'Live',
    unknown: 'Connecting',
    warn: 'Silent',
    fault: phase === 'connecting' ? 'Connecting' : 'Reconnecting',
  };
  const since = heard !== null && (lost || silent) ? ` ${age(heard)}` : '';
  if (text) setText(text, `${word[state]}${since}`);
}

function refresh() {
  const nowMs = performance.now();
  const statusAge = ageS(model.statusAtMs, nowMs);
  const isStale = statusAge === null || statusAge > STATUS_STALE_S;
  strip.setStale(isStale && statusAge !== null);
  showConnection(nowMs);
  const faults = Array.isArray(model.status?.faults)
    ? model.status.faults.filter((fault) => fault !== null)
    : [];
  const neverAndLost = statusAge === null && nowMs > 5000;
  const own = neverAndLost || (isStale && statusAge !== null) ? [connectionFault(statusAge)] : [];
  const all = statusAge === null && !neverAndLost ? null : [...own, ...faults];
  banner.show(all, Array.isArray(model.status?.chips) ? model.status.chips : []);
  health.showFaults(all);
  live.refresh(nowMs);
}

/** Drawing waits for the browser's own frame, so that a hidden tab costs nothing. */
function draw() {
  live.draw(performance.now());
}

setInterval(() => {
  refresh();
  requestAnimationFrame(draw);
}, REFRESH_MS);
tabs.start();
refresh();
new Source(onMessage, (state) => {
  phase = state.phase;
  if (phase === 'open') health.loadEvents();
}).start();
void prefill(model, live);
