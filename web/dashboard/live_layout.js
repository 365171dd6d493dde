// @ts-check
// The cards of the live page, as elements; what fills them is in live.js.

import { make } from '../shared/dom.js';
import { shownValue } from '../shared/display.js';
import { UNKNOWN, bytes, compassPoint, count, fixed, geodetic, heading, signed } from '../shared/format.js';
import { Card } from './card.js';
import { ValueCell } from './value_cell.js';

/** @param {ValueCell[]} cells */
export function cellList(...cells) {
  return make('dl', { class: 'cells' }, ...cells.map((cell) => cell.root));
}

/**
 * A signed angle; its sign of degrees stands with the number, so that it comes and goes with it.
 * @param {number | null} value
 */
export function degrees(value) {
  return value === null ? UNKNOWN : `${signed(value, 1)}\u00b0`;
}

/** @param {string} label */
export function instrumentCanvas(label) {
  return make('canvas', { class: 'instrument', role: 'img', 'aria-label': label });
}

/**
 * A big number that belongs to an instrument.
 * @param {string} unit
 * @param {number} width  usual characters
 */
export function hero(unit, width) {
  const number = make('span', { class: 'number none', text: '-' });
  number.style.minWidth = `${width}ch`;
  const unitText = make('span', { class: 'unit', text: unit });
  return { number, unit: unitText, root: make('p', { class: 'hero' }, number, unitText) };
}

export const SCIENCE_CELLS = () => [
  new ValueCell('temperature'),
  new ValueCell('salinity'),
  new ValueCell('soundSpeed'),
  new ValueCell('conductivity', count),
  new ValueCell('pressure'),
  new ValueCell('sensorSalinity'),
];

export const GPS_CELLS = () => [
  new ValueCell('satellites', count),
  new ValueCell('hdop'),
  new ValueCell('latitude', (value) => geodetic(value, 'latitude')),
  new ValueCell('longitude', (value) => geodetic(value, 'longitude')),
];

/**
 * @typedef {object} StatusItem
 * @property {string} label
 * @property {string} unit
 * @property {(status: Record<string, any>) => string} text
 */

/** @type {StatusItem[]} */
export const LINK_ITEMS = [
  { label: 'Rate', unit: '', text: (s) => perSecond(s.link?.bytes_per_s) },
  { label: 'Frames', unit: '', text: (s) => count(s.link?.frames) },
  { label: 'CRC errors', unit: '', text: (s) => count(s.link?.crc_errors) },
  { label: 'Resyncs', unit: '', text: (s) => count(s.link?.resyncs) },
  { label: 'Skipped', unit: '', text: (s) => bytes(s.link?.bytes_skipped) },
  { label: 'Reconnects', unit: '', text: (s) => count(s.link?.reconnects) },
];

/** @param {unknown} value */
export function perSecond(value) {
  const text = bytes(value);
  return text === '-' ? text : `${text}/s`;
}

/** @type {Array<[string, string, (sonar: Record<string, any>) => string]>} label, unit, value */
export const SONAR_ROWS = [
  ['Ping rate', '/s', (s) => fixed(s.pings_per_s, 1)],
  ['Pings', '', (s) => count(s.pings)],
  ['Range', 'm', (s) => fixed(shownValue(s.range_m, 'm'), 1)],
  ['Samples', '', (s) => count(s.samples)],
  ['Resolution', 'mm', (s) => fixed(s.resolution_mm, 0)],
  ['Lost', '%', (s) => fixed(s.lost_percent, 1)],
  ['Incomplete', '', (s) => count(s.incomplete)],
  ['Checksum errors', '', (s) => count(s.checksum_errors)],
  ['Dropped, link full', '', (s) => count(s.dropped_by_firmware)],
];

/** The table of both sonars; `cells[row][0 for A, 1 for B]`. */
export function sonarTable() {
  const units = SONAR_ROWS.map(([, unit]) => make('span', { class: 'unit', text: unit }));
  const cells = SONAR_ROWS.map(() => [make('td', { text: '-' }), make('td', { text: '-' })]);
  const rows = SONAR_ROWS.map(([label], i) =>
    make('tr', {}, make('th', { scope: 'row' }, label, units[i]), cells[i][1], cells[i][0]),
  );
  const table = make(
    'table',
    { class: 'sonars' },
    make(
      'thead',
      {},
      make(
        'tr',
        {},
        make('td'),
        make('th', { scope: 'col' }, make('b', { text: 'B' }), ' port'),
        make('th', { scope: 'col' }, make('b', { text: 'A' }), ' starboard'),
      ),
    ),
    make('tbody', {}, ...rows),
  );
  return { table, cells, units };
}

/** The status items as cells like those of the sensors. */
export function statusCells() {
  const numbers = LINK_ITEMS.map(() => make('span', { class: 'number', text: '-' }));
  const root = make(
    'dl',
    { class: 'cells compact' },
    ...LINK_ITEMS.map((item, i) =>
      make(
        'div',
        { class: 'cell' },
        make('dt', {}, make('span', { text: item.label })),
        make('dd', {}, numbers[i]),
      ),
    ),
  );
  return { numbers, root };
}

export function cards() {
  return {
    attitude: new Card('attitude', 'Attitude', 'imu'),
    heading: new Card('heading', 'Heading', 'imu'),
    depth: new Card('depth', 'Depth', 'depth'),
    map: new Card('map', 'Map', 'navigation'),
    motion: new Card('motion', 'Motion', null),
    navigation: new Card('navigation', 'Navigation', 'navigation'),
    acoustics: new Card('acoustics', 'Acoustics', null),
    plots: new Card('plots', 'Over time', null),
    profile: new Card('profile', 'Water profile', null),
    ctd: new Card('ctd', 'Water', 'ctd'),
    gps: new Card('gps', 'GPS', 'gps'),
    sonars: new Card('sonars', 'Sonars', null),
    link: new Card('link', 'Link to the ESP32', 'link'),
  };
}

/**
 * "214" and "SW": what stands in the middle of the compass.
 * @param {number | null} degrees
 */
export function headingTexts(degrees) {
  return { degrees: heading(degrees), point: degrees === null ? '' : compassPoint(degrees) };
}
