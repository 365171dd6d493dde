// @ts-check
// One setting: input, unit, default, limits and the reason for it.

import { make, setAttribute, setText } from '../shared/dom.js';
import {
  defaultText,
  inputText,
  kindOf,
  limitsText,
  parseInput,
  sameValue,
  wordsOf,
} from './setting_values.js';

/** @typedef {import('./setting_values.js').Setting} Setting */

export class SettingRow {
  /**
   * @param {Setting} setting
   * @param {() => void} onChange
   */
  constructor(setting, onChange) {
    this.setting = setting;
    this.kind = kindOf(setting);
    this.onChange = onChange;
    const id = `setting-${setting.key}`;
    this.input = this.buildInput(id);
    this.input.addEventListener('input', () => this.changed());
    this.error = make('p', { class: 'setting-error', id: `${id}-error`, role: 'alert' });
    this.reset = make('button', {
      class: 'button reset',
      type: 'button',
      text: 'Default',
      'aria-label': `${wordsOf(setting.key)}: back to the default`,
      on: { click: () => this.toDefault() },
    });
    this.effect = make('span', { class: 'needs-restart' });
    const limits = limitsText(setting);
    this.root = make(
      'div',
      { class: 'setting', dataset: { key: setting.key } },
      make(
        'div',
        { class: 'setting-words' },
        make('label', { for: id, text: wordsOf(setting.key) }),
        make('p', { class: 'hint', id: `${id}-reason`, text: sentence(setting.reason) }),
        make(
          'p',
          { class: 'hint setting-facts' },
          make('code', { text: setting.key }),
          make('span', { text: `default ${defaultText(setting)}` }),
          limits ? make('span', { text: limits }) : null,
          this.effect,
        ),
      ),
      make(
        'div',
        { class: 'setting-input' },
        this.input,
        make('span', { class: 'unit', text: setting.unit ?? '' }),
        this.reset,
        this.error,
      ),
    );
    this.take(setting);
  }

  /** @param {string} id */
  buildInput(id) {
    const common = { id, 'aria-describedby': `${id}-reason ${id}-error` };
    if (this.kind === 'switch')
      return make('input', { ...common, type: 'checkbox', role: 'switch', class: 'switch' });
    if (this.kind === 'choice') {
      const options = (this.setting.choices ?? []).map((choice) =>
        make('option', { value: String(choice), text: String(choice) }),
      );
      return make('select', { ...common, class: 'field' }, ...options);
    }
    const type = this.kind === 'secret' ? 'password' : 'text';
    const mode = this.kind === 'number' ? 'decimal' : null;
    return make('input', {
      ...common,
      type,
      class: `field ${this.kind}`,
      inputmode: mode,
      autocomplete: 'off',
      spellcheck: 'false',
    });
  }

  get text() {
    const { input } = this;
    return input instanceof HTMLInputElement && input.type === 'checkbox'
      ? String(input.checked)
      : input.value;
  }

  /** @param {any} value */
  write(value) {
    if (this.input instanceof HTMLInputElement && this.input.type === 'checkbox')
      this.input.checked = value === true;
    else this.input.value = inputText(value);
  }

  /**
   * What the server holds now; what somebody typed and did not apply stays.
   * @param {Setting} setting
   * @param {boolean} [overwrite]
   */
  take(setting, overwrite = true) {
    const keep = !overwrite && this.isDirty;
    this.setting = setting;
    if (!keep) this.write(setting.value);
    this.input.disabled = Boolean(setting.fixed_by);
    setText(this.effect, effectText(setting));
    this.changed();
  }

  toDefault() {
    this.write(this.setting.default);
    this.changed();
  }

  revert() {
    this.write(this.setting.value);
    this.changed();
  }

  get parsed() {
    return parseInput(this.setting, this.text);
  }

  get isDirty() {
    return !sameValue(this.parsed.value, this.setting.value);
  }

  changed() {
    const { error } = this.parsed;
    this.showError(error);
    this.root.classList.toggle('dirty', this.isDirty);
    this.reset.style.visibility =
      this.input.disabled || sameValue(this.parsed.value, this.setting.default) ? 'hidden' : 'visible';
    this.onChange();
  }

  /** @param {string} text */
  showError(text) {
    setText(this.error, text);
    setAttribute(this.input, 'aria-invalid', text ? 'true' : null);
  }
}

/** @param {string | undefined} text */
function sentence(text) {
  if (!text) return '';
  const first = text.charAt(0).toUpperCase() + text.slice(1);
  return /[.!?]$/.test(first) ? first : `${first}.`;
}

/**
 * When a change would take effect, or why it cannot be made here.
 * @param {Setting} setting
 */
function effectText(setting) {
  if (setting.fixed_by) return `fixed by the ${setting.fixed_by}`;
  if (setting.pending) return 'saved, takes effect after a restart';
  return setting.restart ? 'takes effect after a restart' : '';
}
