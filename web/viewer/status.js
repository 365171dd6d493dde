// @ts-check
/** The words of the status strip and of the empty picture. Pure. */

import { age, fixed } from '../shared/format.js';

/** @typedef {import('../shared/status_strip.js').ChipData} ChipData */

/**
 * @typedef {object} Facts
 * @property {'connecting' | 'open' | 'waiting' | 'stopped'} phase of the page's own connection
 * @property {boolean} coarse only the 200-bin stream could be reached
 * @property {any} status data of the status topic, null while unknown
 * @property {number} statusAgeS
 * @property {Record<'A' | 'B', {ageS: number, perS: number, missed: number, loss: import('./row_table.js').Loss}>} channels
 *   as this page receives them; the loss of the last minute
 * @property {number} malformed
 */

const SILENT_AFTER_S = 3;
const LOSS_ALLOWED_PERCENT = 2;

/** The chips before anything is known: their places are reserved. */
export const FIRST_CHIPS = /** @type {ChipData[]} */ (
  [
    ['link', 'Link'],
    ['sonar_b', 'Port B'],
    ['sonar_a', 'Stbd A'],
    ['loss', 'Loss'],
    ['extension', 'Extension'],
  ].map(([id, label]) => ({ id, label, state: 'unknown', text: '-' }))
);

/** @param {Facts} facts @returns {ChipData[]} */
export function chipsOf(facts) {
  return [
    linkChip(facts),
    sonarChip(facts, 'B'),
    sonarChip(facts, 'A'),
    lossChip(facts),
    extensionChip(facts),
  ];
}

/** @param {Facts} facts @returns {ChipData} */
function linkChip({ phase, coarse, malformed }) {
  const chip = { id: 'link', label: 'Link' };
  if (phase !== 'open') {
    return {
      ...chip,
      state: 'fault',
      text: phase === 'connecting' ? 'connecting' : 'lost',
      cause: 'The page has no connection to the viewer service.',
      cure: 'Check the tether and that the extension is running. The page keeps trying by itself.',
    };
  }
  if (coarse) {
    return {
      ...chip,
      state: 'warn',
      text: '200 bins',
      cause: 'Only the coarse stream on port 8101 can be reached: 200 bins a ping, no history, no settings.',
      cure: 'Open the page at port 8100 of the vehicle directly, or update BlueOS so that its proxy passes WebSockets.',
    };
  }
  if (malformed > 0) {
    return {
      ...chip,
      state: 'warn',
      text: `${malformed} damaged`,
      cause: `${malformed} frames from the service could not be read and were left out.`,
      cure: 'Reload the page: page and service may be of different versions.',
    };
  }
  return { ...chip, state: 'ok', text: 'connected' };
}

/** @param {Facts} facts @param {'A' | 'B'} name @returns {ChipData} */
function sonarChip({ phase, status, channels }, name) {
  const words = name === 'A' ? 'Starboard' : 'Port';
  const chip = { id: name === 'A' ? 'sonar_a' : 'sonar_b', label: name === 'A' ? 'Stbd A' : 'Port B' };
  const here = channels[name];
  if (phase !== 'open') return { ...chip, state: 'unknown', text: '-' };
  if (here.ageS < SILENT_AFTER_S) return { ...chip, state: 'ok', text: `${fixed(here.perS, 1)} pings/s` };
  const alive = status?.channels?.[name]?.alive;
  return {
    ...chip,
    state: 'fault',
    text: Number.isFinite(here.ageS) ? `silent ${age(here.ageS)}` : 'no pings',
    cause: alive
      ? `Sonar ${name} answers but sends no echograms.`
      : `Nothing is heard of sonar ${name} (${words.toLowerCase()}).`,
    cure: alive
      ? 'Open the sonar settings and set a period above 0 ms.'
      : 'Check the 12 V supply, the cable, 921600 baud on both sides, and the sonar chips of the dashboard.',
  };
}

/** @param {Facts} facts @returns {ChipData} */
function lossChip({ phase, status, channels }) {
  const chip = { id: 'loss', label: 'Loss' };
  const sides = [channels.A, channels.B];
  const sum = (/** @type {(side: Facts['channels']['A']) => number} */ of) => of(sides[0]) + of(sides[1]);
  const pings = sum((side) => side.loss.pings);
  const lost = sum((side) => side.loss.lost);
  const incomplete = sum((side) => side.loss.incomplete);
  const missed = sum((side) => side.missed);
  if (phase !== 'open' || pings === 0) return { ...chip, state: 'unknown', text: '-' };
  const percent = (100 * (lost + incomplete)) / (pings + lost);
  const text = `${fixed(percent, 1)} %`;
  if (percent <= LOSS_ALLOWED_PERCENT && missed === 0) return { ...chip, state: 'ok', text };
  const total = ['A', 'B'].reduce((all, name) => all + (status?.channels?.[name]?.incomplete ?? 0), 0);
  return {
    ...chip,
    state: 'warn',
    text,
    cause:
      `In the last minute ${lost} pings did not come and ${incomplete} of ${pings} lack parts (since start: ${total}). ` +
      `${missed} pings did not reach this page.`,
    cure: 'Use fewer samples or a longer period, raise the USB link to 921600 baud on the dashboard, or improve the tether.',
  };
}

/** @param {Facts} facts @returns {ChipData} */
function extensionChip({ phase, status, statusAgeS }) {
  const chip = { id: 'extension', label: 'Extension' };
  if (phase !== 'open' || !status || statusAgeS > SILENT_AFTER_S)
    return { ...chip, state: 'unknown', text: '-' };
  if (status.extension_link) return { ...chip, state: 'ok', text: 'linked' };
  return {
    ...chip,
    state: 'fault',
    text: 'not linked',
    cause: 'The viewer service has no link to the extension: no settings, no contacts, no position.',
    cure: 'Start the extension on the same computer (both share one state folder); the link comes back by itself.',
  };
}

/**
 * What the empty picture says.
 * @param {{connection: {state: {phase: string}}}} feed
 * @param {boolean} hasData
 * @param {any} status
 * @returns {{title: string, text: string} | null} null when there is a picture
 */
export function waitingText(feed, hasData, status) {
  if (hasData) return null;
  if (feed.connection.state.phase !== 'open') {
    return {
      title: 'Connecting to the viewer service',
      text: 'If this stays: check the tether, and that the BlueROV SLAM extension is running in BlueOS.',
    };
  }
  if (status && !status.extension_link) {
    return {
      title: 'Waiting for the extension',
      text: 'The viewer runs, but the extension that reads the ESP32 is not linked to it. Start it, or see the dashboard.',
    };
  }
  return {
    title: 'Waiting for the first ping',
    text:
      'No sonar has sent an echogram yet. Likely causes: no 12 V at the sonars, a sonar not at 921600 baud, ' +
      'or no ESP32 on USB. The chips above and the dashboard name the fault.',
  };
}
