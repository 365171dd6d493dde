// @ts-check
/** Sonar panel: what to ask, what was read back, and the actions that need a second thought. */

import { call } from '../shared/api.js';
import { make, setText } from '../shared/dom.js';
import { age, count, fixed } from '../shared/format.js';
import { confirmed } from './dialogs.js';
import { choose, segments } from './panel_picture.js';
import { periodArithmetic } from './ranging.js';
import { FIELDS, outcomeText, parseField, readBack, samplesFor } from './sonar_fields.js';

/** @typedef {import('./sonar_fields.js').Channel} Channel */

const SETTING_TIMEOUT_MS = 20000;

export class SonarPanel {
  /** @param {HTMLElement} root */
  constructor(root) {
    /** @type {any} */
    this.sonar = null;
    /** @type {'A' | 'B' | 'both'} */
    this.target = 'both';
    /** What the user typed and has not sent. @type {Map<string, string>} */
    this.typed = new Map();
    /** @type {boolean | null} */
    this.boost = null;
    this.busy = false;
    /** @type {Map<string, {input: HTMLInputElement, read: HTMLElement}>} */
    this.rows = new Map();
    this.targets = segments(
      'target',
      [
        ['both', 'Both'],
        ['B', 'Port B'],
        ['A', 'Stbd A'],
      ],
      (value) => this.choose(value),
    );
    this.form = make('form', { novalidate: true });
    this.form.addEventListener('submit', (event) => {
      event.preventDefault();
      this.apply();
    });
    for (const field of FIELDS) this.form.append(this.row(field));
    this.boostInput = make('input', { type: 'checkbox', id: 'sonar-boost' });
    this.boostInput.addEventListener('change', () => {
      this.boost = this.boostInput.checked;
      this.refresh();
    });
    this.boostRead = make('p', { class: 'read' });
    this.sum = make('p', { class: 'sum', id: 'sonar-sum', 'aria-live': 'polite' });
    this.answer = make('p', { class: 'answer', id: 'sonar-answer', role: 'status' });
    this.applyButton = make('button', { class: 'button primary', type: 'submit', text: 'Apply' });
    this.revertButton = make('button', {
      class: 'button',
      type: 'button',
      text: 'Revert',
      on: { click: () => this.revert() },
    });
    this.form.append(
      make(
        'div',
        { class: 'setting' },
        make('div', {}, make('label', { for: 'sonar-boost', text: 'Boost' }), this.boostRead),
        this.boostInput,
      ),
      make(
        'div',
        { class: 'decide' },
        this.sum,
        this.answer,
        make('div', { class: 'buttons' }, this.revertButton, this.applyButton),
      ),
    );
    this.device = make('dl', { class: 'device' });
    root.append(
      this.targets,
      this.form,
      make('h3', { text: 'Sonar' }),
      this.device,
      make('div', { class: 'buttons' }, ...this.actions()),
    );
    choose(this.targets, this.target);
    this.refresh();
  }

  /** @returns {Channel[]} */
  get channels() {
    return this.target === 'both' ? ['A', 'B'] : [this.target];
  }

  /** @param {import('./sonar_fields.js').Field} field */
  row(field) {
    const id = `sonar-${field.key}`;
    const input = make('input', {
      class: 'field',
      id,
      inputmode: 'decimal',
      autocomplete: 'off',
      'aria-describedby': `${id}-read`,
    });
    input.addEventListener('input', () => {
      this.typed.set(field.key, input.value);
      this.refresh();
    });
    const read = make('p', { class: 'read', id: `${id}-read` });
    this.rows.set(field.key, { input, read });
    const row = make(
      'div',
      { class: 'setting' },
      make('div', {}, make('label', { for: id, text: field.label }), read),
      input,
      make('span', { class: 'unit', text: field.unit }),
    );
    if (field.key === 'sound_speed_mps') {
      this.ctdButton = make('button', {
        class: 'button',
        type: 'button',
        text: 'Use CTD value',
        on: { click: () => this.useCtd() },
      });
      row.append(this.ctdButton);
    }
    return row;
  }

  actions() {
    const button = (/** @type {string} */ text, /** @type {() => void} */ click, kind = '') =>
      make('button', { class: `button ${kind}`.trim(), type: 'button', text, on: { click } });
    return [
      button('Read again', () => this.act('refresh')),
      button('Stop pinging', () => this.act('stop')),
      button('Save to flash', () =>
        this.actConfirmed(
          'save_to_flash',
          'Save to flash?',
          'The sonar keeps these settings when it loses power.',
          'Save',
        ),
      ),
      button(
        'Reboot',
        () =>
          this.actConfirmed(
            'reboot',
            'Reboot the sonar?',
            'It is silent for some seconds; settings not saved to flash are lost.',
            'Reboot',
          ),
        'danger',
      ),
    ];
  }

  /** @param {string} target */
  choose(target) {
    this.target = /** @type {any} */ (target);
    this.refresh();
  }

  /** @param {any} sonar data of GET /api/sonar */
  update(sonar) {
    this.sonar = sonar;
    this.refresh();
  }

  useCtd() {
    const speed = this.sonar?.sound_speed_ctd_mps;
    if (!Number.isFinite(speed)) return;
    this.typed.set('sound_speed_mps', speed.toFixed(1));
    this.refresh();
  }

  revert() {
    this.typed.clear();
    this.boost = null;
    this.say('', '');
    this.refresh();
  }

  /** @param {string} key the value in force: typed, or read from the first sonar chosen */
  effective(key) {
    const typed = this.typed.get(key);
    const field = FIELDS.find((candidate) => candidate.key === key);
    if (typed !== undefined && field) {
      const parsed = parseField(field, typed, undefined);
      return 'value' in parsed ? parsed.value : NaN;
    }
    return this.sonar?.[this.channels[0]]?.read?.[key] ?? NaN;
  }

  refresh() {
    for (const field of FIELDS) this.refreshRow(field);
    const readBoost = this.sonar?.[this.channels[0]]?.read?.boost;
    this.boostInput.checked = this.boost ?? readBoost === true;
    setText(this.boostRead, readBack('boost', 0, this.sonar, this.channels).text);
    this.refreshSum();
    this.refreshDevice();
    const nothing = this.typed.size === 0 && this.boost === null;
    this.applyButton.disabled = nothing || this.busy;
    this.revertButton.disabled = nothing || this.busy;
    const speed = this.sonar?.sound_speed_ctd_mps;
    if (this.ctdButton) {
      this.ctdButton.disabled = !Number.isFinite(speed);
      setText(
        this.ctdButton,
        Number.isFinite(speed) ? `Use CTD value (${fixed(speed, 1)} m/s)` : 'Use CTD value (none yet)',
      );
    }
  }

  /** @param {import('./sonar_fields.js').Field} field */
  refreshRow(field) {
    const row = this.rows.get(field.key);
    if (!row) return;
    const typed = this.typed.get(field.key);
    const value = this.sonar?.[this.channels[0]]?.read?.[field.key];
    const text = typed ?? (Number.isFinite(value) ? String(Number(value.toFixed(field.decimals))) : '');
    if (row.input.value !== text) row.input.value = text;
    const { text: read, differs } = readBack(field.key, field.decimals, this.sonar, this.channels);
    const problem = typed === undefined ? null : parseField(field, typed, this.sonar?.limits?.[field.key]);
    const bad = problem !== null && 'problem' in problem;
    row.input.setAttribute('aria-invalid', String(bad));
    setText(row.read, bad ? problem.problem : read);
    row.read.dataset.state = bad || differs ? 'warn' : '';
  }

  refreshSum() {
    const rangeM = this.effective('range_m');
    const samples = samplesFor(rangeM, this.effective('resolution_mm'));
    const speed = this.effective('sound_speed_mps');
    const sum = periodArithmetic(rangeM, Number.isFinite(speed) ? speed : 1500, this.effective('period_ms'));
    const samplesText = Number.isFinite(samples) ? `${count(samples)} samples a ping. ` : '';
    setText(this.sum, `${samplesText}${sum ? `Two-way time ${sum.text}` : ''}`);
    const refused = sum !== null && !sum.fits;
    this.sum.dataset.state = refused ? 'fault' : '';
    const period = this.rows.get('period_ms');
    if (!refused || !period) return;
    period.input.setAttribute('aria-invalid', 'true');
    setText(period.read, `Too short: ${sum.leastMs} ms at least`);
    period.read.dataset.state = 'warn';
  }

  refreshDevice() {
    const rows = this.channels.flatMap((channel) => {
      const sonar = this.sonar?.[channel];
      const device = sonar?.device ?? {};
      const text = [
        device.name,
        device.board,
        device.firmware && `firmware ${device.firmware}`,
        device.serial && `no. ${device.serial}`,
      ];
      const known = text.filter((part) => part !== null && part !== undefined && part !== '').join(', ');
      const readAge = Number.isFinite(sonar?.read_at)
        ? `read ${age(Date.now() / 1000 - sonar.read_at)} ago`
        : 'never read';
      const state = sonar?.pending ? 'busy' : sonar?.alive ? 'alive' : 'silent';
      return [
        [channel === 'A' ? 'Starboard A' : 'Port B', `${state}, ${readAge}`],
        ['', known || 'no answer about itself yet'],
        ['', sonar?.last_result ? `Last: ${sonar.last_result}` : ''],
      ];
    });
    const shown = rows.filter(([, text]) => text !== '');
    const key = JSON.stringify(shown);
    if (this.device.dataset.key === key) return;
    this.device.dataset.key = key;
    this.device.replaceChildren(
      ...shown.flatMap(([name, text]) => [make('dt', { text: name }), make('dd', { text })]),
    );
  }

  /** @returns {Record<string, number | boolean> | null} null when a field is wrong */
  asked() {
    /** @type {Record<string, number | boolean>} */
    const asked = {};
    for (const [key, text] of this.typed) {
      const field = FIELDS.find((candidate) => candidate.key === key);
      if (!field) continue;
      const parsed = parseField(field, text, this.sonar?.limits?.[key]);
      if ('problem' in parsed) {
        this.say(parsed.problem, 'fault');
        this.rows.get(key)?.input.focus();
        return null;
      }
      asked[key] = parsed.value;
    }
    if (this.boost !== null) asked.boost = this.boost;
    return asked;
  }

  async apply() {
    const asked = this.asked();
    if (!asked || this.busy) return;
    await this.send(`api/sonar/${this.target}`, asked, 'Asking the sonar\u2026', () => {
      this.typed.clear();
      this.boost = null;
    });
  }

  /** @param {string} action @param {string} title @param {string} text @param {string} label */
  async actConfirmed(action, title, text, label) {
    const names = this.target === 'both' ? 'Both sonars' : `Sonar ${this.target}`;
    if (await confirmed(title, `${names}. ${text}`, label)) await this.act(action);
  }

  /** @param {string} action */
  async act(action) {
    for (const channel of this.channels) {
      await this.send(
        `api/sonar/${channel}/action`,
        { action, confirm: true },
        'Asking the sonar\u2026',
        () => {},
      );
    }
  }

  /**
   * @param {string} path
   * @param {object} body
   * @param {string} meanwhile
   * @param {() => void} onDone
   */
  async send(path, body, meanwhile, onDone) {
    this.busy = true;
    this.say(meanwhile, '');
    this.refresh();
    try {
      const { ok, text } = outcomeText(
        await call(path, { method: 'POST', body, timeoutMs: SETTING_TIMEOUT_MS }),
      );
      if (ok) onDone();
      this.say(text, ok ? 'ok' : 'warn');
    } catch (error) {
      this.say(error instanceof Error ? error.message : String(error), 'fault');
    }
    this.busy = false;
    this.refresh();
  }

  /** @param {string} text @param {string} state */
  say(text, state) {
    setText(this.answer, text);
    this.answer.dataset.state = state;
  }
}
