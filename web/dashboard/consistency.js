// @ts-check
// Whether the sensors agree with each other as well as they claim to, in words and as small bars.

import { inShownUnits } from '../shared/display.js';
import { make, setAttribute, setText } from '../shared/dom.js';
import { age, count, fixed, isKnown } from '../shared/format.js';
import { showState, stateIcon } from '../shared/status_icons.js';
import { panel } from './panel.js';

/** @type {Record<string, {state: import('../shared/status_icons.js').State, word: string}>} */
const TRUSTS = {
  used: { state: 'ok', word: 'Used' },
  rejected: { state: 'warn', word: 'Rejected' },
  ignored: { state: 'fault', word: 'Ignored' },
  waiting: { state: 'unknown', word: 'Waiting' },
  absent: { state: 'off', word: 'Absent' },
};
/** NIS ratios on a bar from a tenth to ten, so that too good and too bad are equally far from the middle. */
const DECADES = 1;

/**
 * @typedef {object} RowView
 * @property {HTMLElement} root
 * @property {HTMLElement} icon
 * @property {HTMLElement} name
 * @property {HTMLElement} word
 * @property {HTMLElement} reason
 * @property {HTMLElement} band
 * @property {HTMLElement} mark
 * @property {HTMLElement} ratio
 * @property {HTMLElement} counts
 */

export class ConsistencyPanel {
  constructor() {
    /** @type {Map<string, RowView>} */
    this.views = new Map();
    this.sentence = make('p', {
      class: 'consistency-sentence',
      role: 'status',
      text: 'Waiting for the navigator',
    });
    this.list = make('div', { class: 'consistency' });
    this.root = panel(
      'consistency',
      'Trust in each sensor',
      'The bar compares how far readings were off with how far they may be: the mark belongs inside the band around 1.',
      this.sentence,
      this.list,
    );
  }

  /** @param {Record<string, any>} state  the topic's data */
  show(state) {
    const sensors = Array.isArray(state.sensors) ? state.sensors : [];
    setText(this.sentence, verdict(sensors));
    for (const sensor of sensors) this.showSensor(sensor);
  }

  /** @param {any} sensor */
  showSensor(sensor) {
    const view = this.views.get(sensor.id) ?? this.addSensor(sensor.id);
    const trust = TRUSTS[sensor.trust] ?? TRUSTS.absent;
    showState(view.icon, trust.state);
    setText(view.name, String(sensor.label ?? sensor.id));
    setText(view.word, trust.word);
    setText(view.reason, inShownUnits(String(sensor.reason ?? '')));
    view.reason.hidden = !sensor.reason;
    setAttribute(view.root, 'data-trust', String(sensor.trust));
    const band = Array.isArray(sensor.nis_band) && sensor.nis_band.every(isKnown) ? sensor.nis_band : null;
    view.band.hidden = band === null;
    if (band) {
      view.band.style.left = `${place(band[0])}%`;
      view.band.style.right = `${100 - place(band[1])}%`;
    }
    const known = isKnown(sensor.nis_ratio);
    view.mark.hidden = !known;
    if (known) view.mark.style.left = `${place(sensor.nis_ratio)}%`;
    const outside = known && band !== null && (sensor.nis_ratio < band[0] || sensor.nis_ratio > band[1]);
    setAttribute(view.mark, 'data-outside', String(outside));
    setText(view.ratio, fixed(sensor.nis_ratio, 2));
    const last = isKnown(sensor.age_s) ? `, last ${age(sensor.age_s)} ago` : '';
    setText(view.counts, `${count(sensor.accepted)} used, ${count(sensor.rejected)} rejected${last}`);
    view.counts.hidden = sensor.trust === 'absent';
  }

  /** @param {string} id */
  addSensor(id) {
    const view = {
      icon: stateIcon(),
      name: make('b'),
      word: make('span', { class: 'trust-word' }),
      reason: make('p', { class: 'trust-reason' }),
      band: make('i', { class: 'nis-band' }),
      mark: make('i', { class: 'nis-mark' }),
      ratio: make('span', { class: 'number', text: '-' }),
      counts: make('p', { class: 'hint' }),
      root: make('section', { class: 'sensor-trust' }),
    };
    view.root.append(
      make('p', { class: 'trust-head' }, view.icon, view.name, view.word),
      make(
        'div',
        { class: 'nis', title: 'Mean of NIS / degrees of freedom, 0.1 to 10' },
        make('i', { class: 'nis-one' }),
        view.band,
        view.mark,
      ),
      view.ratio,
      make('div', { class: 'trust-text' }, view.reason, view.counts),
    );
    this.views.set(id, view);
    this.list.append(view.root);
    return view;
  }
}

/**
 * Where a ratio stands on the bar, percent.
 * @param {number} ratio
 */
export function place(ratio) {
  const decades = Math.log10(Math.max(ratio, 1e-9));
  return Math.min(100, Math.max(0, 50 + (50 * decades) / DECADES));
}

/**
 * One sentence about all of them.
 * @param {any[]} sensors
 */
export function verdict(sensors) {
  if (sensors.length === 0) return 'Waiting for the navigator';
  const label = (/** @type {any} */ s) => String(s.label ?? s.id);
  const doubted = sensors.filter((s) => s.trust === 'rejected' || s.trust === 'ignored');
  if (doubted.length > 0)
    return `Not trusted: ${doubted.map(label).join(', ')}. The position goes on without, and its uncertainty grows.`;
  const used = sensors.filter((s) => s.trust === 'used');
  if (used.length === 0) return 'No sensor is used yet.';
  const odd = used.filter((s) => s.reason);
  if (odd.length > 0) return `${odd.map(label).join(', ')}: used, but something is odd. It says below what.`;
  const strained = used.filter(
    (s) => isKnown(s.nis_ratio) && Array.isArray(s.nis_band) && s.nis_ratio > s.nis_band[1],
  );
  if (strained.length > 0)
    return `${strained.map(label).join(', ')}: farther off than claimed. The stated uncertainty may be too small.`;
  const lax = used.filter(
    (s) => isKnown(s.nis_ratio) && Array.isArray(s.nis_band) && s.nis_ratio < s.nis_band[0],
  );
  if (lax.length > 0) return `All sensors agree; ${lax.map(label).join(', ')} better than claimed.`;
  return 'All sensors agree as well as they claim.';
}
