// @ts-check
// One value on the page: label, number, unit, and its age once it is stale. Unknown is "-" and keeps its place.

import { make, setAttribute, setNumber, setText } from '../shared/dom.js';
import { shownUnit, shownValue } from '../shared/display.js';
import { age, fixed } from '../shared/format.js';
import { FIELD_BY_KEY } from './fields.js';
import { STALE_S, ageS } from './model.js';

/**
 * @typedef {import('./model.js').Model} Model
 * @typedef {import('./fields.js').Field} Field
 */

export class ValueCell {
  /**
   * @param {string} key  of a field
   * @param {(value: number | null) => string} [format]  instead of the field's decimals
   */
  constructor(key, format) {
    const field = FIELD_BY_KEY.get(key);
    if (!field) throw new Error(`there is no field ${key}`);
    this.field = field;
    this.format = format ?? ((/** @type {number | null} */ value) => fixed(value, field.decimals));
    this.ageText = make('span', { class: 'age', title: 'since it was last known' });
    this.number = make('span', { class: 'number none', text: '-' });
    if (field.width) this.number.style.minWidth = `${field.width}ch`;
    this.unit = make('span', { class: 'unit', text: field.unit });
    this.root = make(
      'div',
      { class: 'cell', title: field.hint ?? null, dataset: { field: key } },
      make('dt', {}, make('span', { text: field.label }), this.ageText),
      make('dd', {}, this.number, this.unit),
    );
  }

  /**
   * @param {Model} model
   * @param {number} nowMs
   */
  update(model, nowMs) {
    const reading = model.reading(this.field.key);
    setNumber(this.number, this.format(shownValue(reading.value, this.field.unit)));
    setText(this.unit, shownUnit(this.field.unit));
    const seconds = ageS(reading.atMs, nowMs);
    const stale = seconds !== null && seconds > STALE_S;
    setText(this.ageText, stale ? age(seconds) : '');
    setAttribute(
      this.root,
      'class',
      stale ? (reading.value === null ? 'cell unknown' : 'cell stale') : 'cell',
    );
  }
}

/**
 * The age of a whole card, calm while fresh.
 * @param {number | null} seconds
 */
export function cardAge(seconds) {
  if (seconds === null) return '-';
  return seconds < 1 ? '< 1 s' : seconds <= STALE_S ? `${Math.floor(seconds)} s` : `${age(seconds)} ago`;
}
