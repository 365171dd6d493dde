// @ts-check
// The acoustic array on the live page: where the transmitter is, how well that is known, and how each receiver hears.

import { shownUnit, shownValue } from '../shared/display.js';
import { make, setAttribute, setNumber, setText } from '../shared/dom.js';
import { age, count, fixed, geodetic, isKnown } from '../shared/format.js';
import { asState, showState, stateIcon } from '../shared/status_icons.js';
import { AcousticsRose } from './acoustics_rose.js';
import { instrumentCanvas } from './live_layout.js';

/**
 * @typedef {Record<string, any>} Data
 * @typedef {object} Row
 * @property {string} label
 * @property {string} unit
 * @property {(data: Data) => string} text
 * @property {string} [hint]
 */

/** A pulse older than this says nothing about now; they come once a second. */
export const PULSE_STALE_S = 5;
/** Of 12 bits: what a receiver's bar is full at. */
const FULL_COUNTS = 2048;
/** A bar grows with the loudness, not with the voltage: quiet receivers are told apart, too. */
const QUIETEST_COUNTS = 1;

/** @param {unknown} metres */
const length = (metres) => fixed(shownValue(/** @type {any} */ (metres), 'm'), 1);

/** @type {Row[]} */
export const ROWS = [
  { label: 'Azimuth', unit: '', text: (d) => sideText(d.direction?.azimuth_deg), hint: 'From the bow' },
  {
    label: 'Elevation',
    unit: '',
    text: (d) => heightText(d.direction?.elevation_deg),
    hint: 'From the deck',
  },
  {
    label: 'Within (95 %)',
    unit: '',
    text: (d) => (isKnown(d.direction?.std_deg) ? `${fixed(2.45 * d.direction.std_deg, 2)}\u00b0` : '-'),
    hint: 'Of the direction',
  },
  { label: 'Distance', unit: 'm', text: (d) => length(d.range_m), hint: 'By the difference of the depths' },
  {
    label: 'Within (95 %)',
    unit: 'm',
    text: (d) => (isKnown(d.range_std_m) ? length(1.96 * d.range_std_m) : '-'),
    hint: 'Of the distance',
  },
  {
    label: 'Residual',
    unit: '\u00b5s',
    text: (d) => fixed(largest(d.residuals_us), 2),
    hint: 'What the delays lack most to one direction',
  },
  {
    label: 'Carrier cell',
    unit: '',
    text: (d) => SLIP_WORDS[d.slip?.state] ?? '-',
    hint: 'Whether a receiver may be wrong by a whole period of the carrier',
  },
  {
    label: 'Sound speed',
    unit: 'm/s',
    text: (d) => fixed(shownValue(/** @type {any} */ (d.sound_speed_mps), 'm/s'), 0),
  },
  {
    label: 'Pulses left out',
    unit: '',
    text: (d) => (isKnown(d.pings) && d.pings > 0 ? `${count(d.rejected)} of ${count(d.pings)}` : '-'),
  },
];

/** @type {Record<string, string>} */
const SLIP_WORDS = { sure: 'Sure', likely: 'Likely', ambiguous: 'Ambiguous' };

/** @type {Record<string, import('../shared/status_icons.js').State>} */
const RECEIVER_STATES = { used: 'ok', excluded: 'warn', silent: 'fault', dead: 'fault', clipped: 'warn' };

export class AcousticsCard {
  /** @param {import('./card.js').Card} card */
  constructor(card) {
    this.card = card;
    this.icon = stateIcon();
    this.sentence = make('p', { class: 'acoustics-text', text: 'Waiting for the extension' });
    this.cure = make('p', { class: 'acoustics-cure hint' });
    this.canvas = instrumentCanvas('Direction of the transmitter');
    /** @type {AcousticsRose | null} made once an array is fitted: before, its place has no size */
    this.rose = null;
    this.numbers = ROWS.map(() => make('span', { class: 'number none', text: '-' }));
    this.units = ROWS.map((row) => make('span', { class: 'unit', text: row.unit }));
    this.receivers = make('ul', { class: 'receivers', 'aria-label': 'Receivers' });
    /** @type {ReturnType<typeof receiverLine>[]} */
    this.lines = [];
    this.message = make('p', { class: 'acoustics-message' });
    this.body = make(
      'div',
      { class: 'acoustics-body' },
      make(
        'dl',
        { class: 'cells compact' },
        ...ROWS.map((row, i) =>
          make(
            'div',
            { class: 'cell', title: row.hint ?? null },
            make('dt', {}, make('span', { text: row.label })),
            make('dd', {}, this.numbers[i], this.units[i]),
          ),
        ),
      ),
      make('h3', { class: 'acoustics-head', text: 'Signal of each receiver' }),
      this.receivers,
      this.message,
    );
    this.body.hidden = true;
    // Read aloud when the matter changes; the sentence itself counts seconds.
    this.spoken = make('p', { class: 'visually-hidden', role: 'status' });
    this.spokenKey = '';
    card.add(
      make('div', { class: 'acoustics-state' }, this.icon, make('div', {}, this.sentence, this.cure)),
      this.body,
      this.spoken,
    );
    card.root.classList.add('quiet');
  }

  /**
   * @param {Data} data
   * @param {number | null} oldS  seconds since the newest message
   */
  show(data, oldS = 0) {
    const fitted = data.enabled === true;
    this.card.root.classList.toggle('quiet', !fitted);
    this.body.hidden = !fitted;
    showState(this.icon, data.state === 'waiting' ? 'unknown' : asState(data.state));
    this.icon.hidden = !fitted && data.state === 'off';
    setText(this.sentence, typeof data.text === 'string' ? data.text : '-');
    setText(this.cure, typeof data.cure === 'string' ? data.cure : '');
    this.speak(data);
    if (!fitted) return;
    if (!this.rose) {
      this.body.prepend(this.canvas);
      this.rose = new AcousticsRose(this.canvas);
    }
    const seconds = pulseAge(data, oldS);
    const fresh = seconds !== null && seconds <= PULSE_STALE_S;
    const direction = fresh ? data.direction : null;
    this.rose.show(
      direction?.azimuth_deg ?? null,
      direction?.elevation_deg ?? null,
      direction?.std_deg ?? null,
      data.accepted === true,
    );
    setAttribute(this.canvas, 'aria-label', roseText(direction));
    ROWS.forEach((row, i) => {
      setNumber(this.numbers[i], row.text(data));
      setText(this.units[i], shownUnit(row.unit));
    });
    const receivers = Array.isArray(data.receivers) ? data.receivers : [];
    this.showReceivers(receivers.map((receiver) => receiver ?? {}));
    setText(this.message, messageText(data.message));
    setAttribute(this.message, 'title', data.raw_bits ? `Bits of the frame: ${data.raw_bits}` : null);
  }

  /** @param {Data[]} receivers */
  showReceivers(receivers) {
    if (receivers.length !== this.lines.length) {
      this.lines = receivers.map(() => receiverLine());
      this.receivers.replaceChildren(...this.lines.map((line) => line.root));
    }
    receivers.forEach((receiver, i) => this.lines[i].show(receiver));
  }

  /** @param {Data} data */
  speak(data) {
    const key = `${data.state} ${String(data.text ?? '').replace(/\d+/g, '')}`;
    if (key === this.spokenKey) return;
    this.spokenKey = key;
    setText(this.spoken, `Acoustics: ${data.text ?? ''}. ${data.cure ?? ''}`);
  }
}

/** One receiver: its number, how loud it is, and why it is left out. */
function receiverLine() {
  const icon = stateIcon();
  const name = make('span', { class: 'receiver-name' });
  const fill = make('i', {});
  const number = make('span', { class: 'number none', text: '-' });
  const unit = make('span', { class: 'unit' });
  const reason = make('span', { class: 'receiver-reason hint' });
  const bar = make('span', { class: 'receiver-bar', 'aria-hidden': 'true' }, fill);
  const root = make(
    'li',
    {},
    icon,
    name,
    bar,
    make('span', { class: 'receiver-value' }, number, unit),
    reason,
  );
  return {
    root,
    /** @param {Data} receiver */
    show(receiver) {
      setText(name, String(receiver.index ?? '-'));
      showState(icon, RECEIVER_STATES[receiver.state] ?? 'unknown');
      setAttribute(root, 'data-state', typeof receiver.state === 'string' ? receiver.state : null);
      const share = `${Math.round(100 * loudness(receiver.signal_counts))}%`;
      if (fill.style.width !== share) fill.style.width = share;
      const snr = isKnown(receiver.snr_db);
      setNumber(number, snr ? fixed(receiver.snr_db, 0) : fixed(receiver.signal_counts, 0));
      setText(unit, snr ? 'dB' : 'counts');
      setText(reason, receiver.state === 'used' ? '' : String(receiver.reason ?? ''));
    },
  };
}

/**
 * 0 to 1 from one count to the end of twelve bits, by powers of ten.
 * @param {unknown} counts  standard deviation
 */
export function loudness(counts) {
  if (!isKnown(counts) || counts <= QUIETEST_COUNTS) return 0;
  return Math.min(1, Math.log(counts / QUIETEST_COUNTS) / Math.log(FULL_COUNTS / QUIETEST_COUNTS));
}

/** @param {unknown} degrees  right positive */
export function sideText(degrees) {
  if (!isKnown(degrees)) return '-';
  const size = Math.abs(degrees);
  if (size < 0.5) return 'Ahead';
  if (size > 179.5) return 'Astern';
  return `${fixed(size, 0)}\u00b0 ${degrees > 0 ? 'stbd' : 'port'}`;
}

/** @param {unknown} degrees  down positive */
export function heightText(degrees) {
  if (!isKnown(degrees)) return '-';
  const size = Math.abs(degrees);
  return size < 0.5 ? 'Level' : `${fixed(size, 0)}\u00b0 ${degrees > 0 ? 'down' : 'up'}`;
}

/** @param {unknown} values */
function largest(values) {
  const known = Array.isArray(values) ? values.filter(isKnown) : [];
  return known.length === 0 ? null : Math.max(...known.map(Math.abs));
}

/**
 * Seconds since the newest pulse, null before the first.
 * @param {Data} data
 * @param {number | null} oldS
 */
export function pulseAge(data, oldS) {
  return isKnown(data.age_s) ? data.age_s + (oldS ?? 0) : null;
}

/** @param {Data | null} direction */
function roseText(direction) {
  if (!direction) return 'Direction of the transmitter: unknown';
  return `Transmitter: ${sideText(direction.azimuth_deg)}, ${heightText(direction.elevation_deg)}`;
}

/**
 * What the transmitter said last, with its place and its depth in the units of the settings.
 * @param {Data | null | undefined} message
 */
export function messageText(message) {
  if (!message) return 'No message of the transmitter yet';
  const parts = [`${message.text}`];
  if (isKnown(message.latitude_deg) && isKnown(message.longitude_deg))
    parts.push(
      `${geodetic(message.latitude_deg, 'latitude')}, ${geodetic(message.longitude_deg, 'longitude')}`,
    );
  if (isKnown(message.depth_m)) parts.push(`depth ${length(message.depth_m)} ${shownUnit('m')}`);
  if (isKnown(message.std_m)) parts.push(`\u00b1${length(message.std_m)} ${shownUnit('m')}`);
  const errors = isKnown(message.corrected_errors) ? message.corrected_errors : 0;
  const corrected =
    errors === 0 ? 'no error' : errors === 1 ? '1 error corrected' : `${errors} errors corrected`;
  return `${parts.join(', ')} (${age(message.age_s)} ago, ${corrected})`;
}
