// @ts-check
// The dashboard: joins the source of messages, the model and the pages. Each part is in a file of its own.

import { loadDisplaySettings } from '../shared/display.js';
import { byId, setAttribute, setText } from '../shared/dom.js';
import { age } from '../shared/format.js';
import { showState } from '../shared/status_icons.js';
import { StatusStrip, unknownChips } from '../shared/status_strip.js';
import { startTheme } from '../shared/theme.js';
import { Banner, connectionFault, streamFault } from './banner.js';
import { HealthPage } from './health.js';
import { LivePage } from './live.js';
import { Model, STALE_S, ageS } from './model.js';
import { NavigationPage } from './navigation_page.js';
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
  ['navigation', 'Navigation'],
  ['acoustics', 'Acoustics'],
]);
const REFRESH_MS = 250;
/** Status comes each second: three missed are a silence. */
const STATUS_STALE_S = STALE_S + 1.5;
/** Before this, no word is no fault yet. */
const FIRST_WAIT_MS = 4000;

const model = new Model();
const strip = new StatusStrip(byId('strip', HTMLElement), unknownChips(CHIPS));
const connection = byId('connection', HTMLElement);
const connectionIcon = byId('connection-icon', HTMLElement);
const connectionText = byId('connection-text', HTMLElement);
const badge = byId('source-badge', HTMLElement);
let phase = 'connecting';

startTheme(byId('theme', HTMLButtonElement));
const live = new LivePage(byId('panel-live', HTMLElement), model);
const navigation = new NavigationPage(byId('panel-navigation', HTMLElement), model);
const recordings = new RecordingsPage(byId('panel-recordings', HTMLElement), model);
const settings = new SettingsPage(byId('panel-settings', HTMLElement), model);
const health = new HealthPage(byId('panel-health', HTMLElement), model);
/** @type {Record<string, {show: () => void}>} */
const pages = { live, navigation, recordings, settings, health };
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
  else if (changed === 'navigation') onNavigation(nowMs);
  else if (changed === 'acoustics') live.onAcoustics(nowMs);
  else if (changed === 'event') health.onEvents();
}

/** @param {number} nowMs */
function onNavigation(nowMs) {
  live.onNavigation(nowMs);
  navigation.onNavigation();
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

/**
 * How this page itself is served.
 * @param {number} nowMs
 * @returns {{state: import('../shared/status_icons.js').State, text: string, fault: import('./banner.js').Fault | null}}
 */
function ownState(nowMs) {
  const sensorsS = ageS(model.sensorsAtMs, nowMs);
  const statusS = ageS(model.statusAtMs, nowMs);
  const since = (/** @type {number | null} */ seconds) => (seconds === null ? '' : ` ${age(seconds)}`);
  const isHeard = statusS !== null && statusS <= STATUS_STALE_S;
  const isReplay = model.status?.source === 'replay';
  if (phase === 'open' && isHeard) return { state: 'ok', text: isReplay ? 'Replay' : 'Live', fault: null };
  if (isHeard && phase !== 'open' && (sensorsS === null || sensorsS > STATUS_STALE_S)) {
    return { state: 'warn', text: `Status only${since(sensorsS)}`, fault: streamFault(sensorsS) };
  }
  if (isHeard) return { state: 'warn', text: 'Reconnecting', fault: null };
  if (statusS === null && nowMs < FIRST_WAIT_MS) return { state: 'unknown', text: 'Connecting', fault: null };
  const word = phase === 'open' ? 'Silent' : 'Reconnecting';
  return { state: 'fault', text: `${word}${since(statusS)}`, fault: connectionFault(statusS) };
}

function refresh() {
  const nowMs = performance.now();
  const own = ownState(nowMs);
  setAttribute(connection, 'data-state', own.state);
  showState(connectionIcon, own.state);
  setText(connectionText, own.text);
  strip.setStale(own.state === 'fault');
  const reported = Array.isArray(model.status?.faults)
    ? model.status.faults.filter((fault) => fault !== null)
    : null;
  const all = own.fault ? [own.fault, ...(reported ?? [])] : reported;
  banner.show(all, Array.isArray(model.status?.chips) ? model.status.chips : []);
  health.showFaults(all);
  live.refresh(nowMs);
}

/** @param {any} answer  of GET api/settings */
function viewerPort(answer) {
  const settings = Array.isArray(answer?.settings) ? answer.settings : [];
  return settings.find((/** @type {any} */ setting) => setting?.key === 'viewer.port')?.value;
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
void loadDisplaySettings().then((answer) => live.linkViewer(viewerPort(answer)));
