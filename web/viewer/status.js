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

/** What the extension alone knows; the sonars and the link are judged with what this page sees itself. */
const FROM_EXTENSION = /** @type {Array<[string, string]>} */ ([
  ['imu', 'IMU'],
  ['depth', 'Depth'],
  ['ctd', 'CTD'],
  ['gps', 'GPS'],
  ['recorder', 'Recorder'],
  ['mavlink', 'MAVLink'],
  ['navigation', 'Navigation'],
  ['acoustics', 'Acoustics'],
]);
const WORST_FIRST = ['fault', 'warn', 'unknown', 'off', 'ok'];

/** The chips before anything is known: their places are reserved. */
export const FIRST_CHIPS = /** @type {ChipData[]} */ (
  [
    ['link', 'Link'],
    ['sonar_b', 'Port B'],
    ['sonar_a', 'Stbd A'],
    ['loss', 'Loss'],
    ...FROM_EXTENSION,
    ['others', 'Vehicle'],
  ].map(([id, label]) => ({ id, label, state: 'unknown', text: '-' }))
);

/** @param {Facts} facts @returns {ChipData[]} */
export function chipsOf(facts) {
  const known = extensionChips(facts);
  const parts = FROM_EXTENSION.map(
    ([id, label]) => known.get(id) ?? { id, label, state: 'unknown', text: '-' },
  );
  return [
    linkChip(facts, known),
    sonarChip(facts, 'B', known),
    sonarChip(facts, 'A', known),
    lossChip(facts),
    ...parts,
    othersChip(parts),
  ];
}

/**
 * What the extension says of each part, as long as it says it.
 * @param {Facts} facts
 * @returns {Map<string, ChipData>}
 */
function extensionChips({ phase, status, statusAgeS }) {
  const isHeard = phase === 'open' && status?.extension_link && statusAgeS <= SILENT_AFTER_S;
  const chips = isHeard && Array.isArray(status.chips) ? status.chips : [];
  return new Map(chips.map((/** @type {ChipData} */ chip) => [chip.id, chip]));
}

/**
 * The first thing on the way from the ESP32 to this page that does not hold.
 * @param {Facts} facts
 * @param {Map<string, ChipData>} known
 * @returns {ChipData}
 */
function linkChip({ phase, coarse, malformed, status }, known) {
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
  if (status && !status.extension_link) {
    return {
      ...chip,
      state: 'fault',
      text: 'no extension',
      cause: 'The viewer service has no link to the extension: no settings, no contacts, no position.',
      cure: 'Start the extension on the same computer (both share one state folder); the link comes back by itself.',
    };
  }
  const board = known.get('link');
  if (board && board.state !== 'ok') return { ...board, ...chip };
  if (malformed > 0) {
    return {
      ...chip,
      state: 'warn',
      text: `${malformed} damaged`,
      cause: `${malformed} frames from the service could not be read and were left out.`,
      cure: 'Reload the page: page and service may be of different versions.',
    };
  }
  return board ? { ...board, ...chip } : { ...chip, state: 'ok', text: 'connected' };
}

/**
 * All that has no chip of its own where there is no room for it: the worst of them speaks.
 * @param {ChipData[]} parts
 * @returns {ChipData}
 */
function othersChip(parts) {
  const chip = { id: 'others', label: 'Vehicle' };
  const rank = (/** @type {ChipData} */ part) => WORST_FIRST.indexOf(part.state);
  const wrong = parts.filter((part) => part.state === 'fault' || part.state === 'warn');
  wrong.sort((one, other) => rank(one) - rank(other));
  const lines = parts.map((part) => /** @type {[string, string]} */ ([part.label, part.text ?? '-']));
  if (wrong.length === 0) {
    const isKnown = parts.every((part) => part.state !== 'unknown');
    return { ...chip, state: isKnown ? 'ok' : 'unknown', text: isKnown ? 'no faults' : '-', parts: lines };
  }
  const [{ state, label, text, cause, cure }] = wrong;
  return { ...chip, state, text: `${label}: ${text}`, cause, cure, parts: lines };
}

/**
 * @param {Facts} facts
 * @param {'A' | 'B'} name
 * @param {Map<string, ChipData>} known
 * @returns {ChipData}
 */
function sonarChip({ phase, status, channels }, name, known) {
  const words = name === 'A' ? 'Starboard' : 'Port';
  const chip = { id: name === 'A' ? 'sonar_a' : 'sonar_b', label: name === 'A' ? 'Stbd A' : 'Port B' };
  const here = channels[name];
  if (phase !== 'open') return { ...chip, state: 'unknown', text: '-' };
  if (here.ageS < SILENT_AFTER_S) {
    // The rate is known from the second ping on.
    const text = Number.isFinite(here.perS) ? `${fixed(here.perS, 1)} pings/s` : 'receiving';
    return { ...chip, state: 'ok', text };
  }
  // The extension knows more: behind a link that is down, a sonar has no fault of its own.
  const reported = known.get(chip.id);
  if (reported && reported.state !== 'ok') return { ...reported, ...chip };
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

/**
 * What is not the water of now must be called so.
 * @param {any} status
 * @param {boolean} simulated as the pings say, for as long as there is no status
 * @returns {'REPLAY' | 'SIMULATED' | ''}
 */
export function originOf(status, simulated) {
  if (status?.source === 'replay') return 'REPLAY';
  return (status?.simulated ?? simulated) ? 'SIMULATED' : '';
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
  const board = status?.chips?.find((/** @type {ChipData} */ chip) => chip.id === 'link');
  if (board?.state === 'fault') {
    return { title: board.text, text: [board.cause, board.cure].filter(Boolean).join(' ') };
  }
  return {
    title: 'Waiting for the first ping',
    text:
      'No sonar has sent an echogram yet. Likely causes: no 12 V at the sonars, a sonar not at 921600 baud, ' +
      'or no ESP32 on USB. The chips above and the dashboard name the fault.',
  };
}
