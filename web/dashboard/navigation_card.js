// @ts-check
// What the navigator estimates, in numbers, each with its uncertainty.

import { inShownUnits, shownUnit, shownValue } from '../shared/display.js';
import { make, setNumber, setText } from '../shared/dom.js';
import { age, fixed, heading, isKnown } from '../shared/format.js';

/**
 * @typedef {Record<string, any>} State
 * @typedef {object} Row
 * @property {string} label
 * @property {string} unit
 * @property {(state: State) => string} text
 * @property {string} [hint]
 */

/** @param {unknown} metres @param {number} decimals */
const length = (metres, decimals) => fixed(shownValue(/** @type {any} */ (metres), 'm'), decimals);
/** @param {unknown} mps */
const speed = (mps) => fixed(shownValue(/** @type {any} */ (mps), 'm/s'), 2);
/** @param {unknown} degrees */
const bearing = (degrees) => (isKnown(degrees) ? `${heading(degrees)}\u00b0` : '-');

/** @type {Row[]} */
export const ROWS = [
  { label: 'North', unit: 'm', text: (s) => length(s.position?.north_m, 1) },
  { label: 'East', unit: 'm', text: (s) => length(s.position?.east_m, 1) },
  {
    label: 'Within (95 %)',
    unit: 'm',
    text: (s) => length(s.ellipse?.major_m, 1),
    hint: 'Long half axis of the ellipse',
  },
  { label: 'Since a fix', unit: '', text: (s) => age(s.since_fix_s) },
  { label: 'Speed', unit: 'm/s', text: (s) => speed(s.velocity?.speed_mps), hint: 'Over ground' },
  { label: 'Course', unit: '', text: (s) => bearing(s.velocity?.course_deg), hint: 'Over ground, true' },
  {
    label: 'True heading',
    unit: '',
    text: (s) => plusMinus(bearing(s.attitude?.heading_deg), s.std?.heading_deg),
  },
  { label: 'Distance', unit: 'm', text: (s) => length(s.distance_m, 0), hint: 'Way made since the start' },
  {
    label: 'Current',
    unit: 'm/s',
    text: (s) => speed(currentOf(s)?.speed),
    hint: 'Of the water over ground',
  },
  {
    label: 'Sets to',
    unit: '',
    text: (s) => bearing(currentOf(s)?.towards),
    hint: 'Where the current flows to, true',
  },
];

export class NavigationCard {
  /** @param {import('./card.js').Card} card */
  constructor(card) {
    this.sentence = make('p', { class: 'navigation-sentence', text: 'Waiting for the navigator' });
    this.numbers = ROWS.map(() => make('span', { class: 'number none', text: '-' }));
    this.units = ROWS.map((row) => make('span', { class: 'unit', text: row.unit }));
    this.trust = make('p', { class: 'navigation-trust hint' });
    // Read aloud; the sentence itself counts seconds, and would be read without end.
    this.spokenKey = '';
    this.spoken = make('p', { class: 'visually-hidden', role: 'status' });
    card.add(
      this.sentence,
      make(
        'dl',
        { class: 'cells' },
        ...ROWS.map((row, i) =>
          make(
            'div',
            { class: 'cell', title: row.hint ?? null },
            make('dt', {}, make('span', { text: row.label })),
            make('dd', {}, this.numbers[i], this.units[i]),
          ),
        ),
      ),
      this.trust,
      this.spoken,
    );
  }

  /** @param {State} state */
  show(state) {
    const text = typeof state.text === 'string' ? inShownUnits(state.text) : '';
    setText(this.sentence, text || '-');
    ROWS.forEach((row, i) => {
      setNumber(this.numbers[i], row.text(state));
      setText(this.units[i], shownUnit(row.unit));
    });
    const trust = trustSentence(state.sensors);
    setText(this.trust, trust);
    const key = `${state.mode} ${trust}`;
    if (key === this.spokenKey) return;
    this.spokenKey = key;
    setText(this.spoken, `${text}. ${trust}`);
  }
}

/**
 * Which sensors hold the estimate and which are left out, in one line.
 * @param {unknown} sensors
 */
export function trustSentence(sensors) {
  if (!Array.isArray(sensors)) return '';
  const named = (/** @type {string} */ trust) =>
    sensors.filter((s) => s?.trust === trust).map((s) => String(s.label ?? s.id));
  const used = named('used');
  const doubted = [...named('rejected'), ...named('ignored')];
  const first = used.length > 0 ? `Rests on ${used.join(', ')}.` : 'Rests on no sensor.';
  return doubted.length > 0 ? `${first} Not trusted: ${doubted.join(', ')} (see Navigation).` : first;
}

/**
 * Speed and direction of the current, null while unknown.
 * @param {State} state
 */
export function currentOf(state) {
  const north = state.current?.north_mps;
  const east = state.current?.east_mps;
  if (!isKnown(north) || !isKnown(east)) return null;
  const magnitude = Math.hypot(north, east);
  const std = state.current?.std_mps;
  // A direction of what may be nothing would be noise.
  const sure = isKnown(std) ? magnitude > std : true;
  return { speed: magnitude, towards: sure ? ((Math.atan2(east, north) * 180) / Math.PI + 360) % 360 : null };
}

/**
 * @param {string} text
 * @param {unknown} stdDeg
 */
function plusMinus(text, stdDeg) {
  return text !== '-' && isKnown(stdDeg) ? `${text} \u00b1${fixed(2 * stdDeg, 1)}\u00b0` : text;
}
