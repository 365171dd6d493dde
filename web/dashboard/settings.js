// @ts-check
// The settings page, made from what the extension says its settings are. Apply is all or nothing.

import { call } from '../shared/api.js';
import { useDisplaySettings } from '../shared/display.js';
import { make, saveBlob, setText } from '../shared/dom.js';
import { Notice } from '../shared/notice.js';
import { Esp32Panel } from './esp32_panel.js';
import { MavlinkPanel } from './mavlink_panel.js';
import { SettingRow } from './setting_row.js';
import { wordsOf } from './setting_values.js';

export class SettingsPage {
  /**
   * @param {HTMLElement} root
   * @param {import('./model.js').Model} model
   */
  constructor(root, model) {
    this.model = model;
    this.notice = new Notice();
    /** @type {Map<string, SettingRow>} */
    this.rows = new Map();
    this.mavlink = new MavlinkPanel((changes) => this.send(changes));
    this.esp32 = new Esp32Panel();
    this.groups = make('div', { class: 'setting-groups' });
    this.jumps = make('nav', { class: 'setting-jumps', 'aria-label': 'Groups of settings' });
    this.summary = make('p', { class: 'changes', role: 'status' });
    this.apply = make('button', {
      class: 'button primary',
      type: 'button',
      text: 'Apply',
      on: { click: () => void this.applyChanges() },
    });
    this.revert = make('button', {
      class: 'button',
      type: 'button',
      text: 'Revert',
      on: { click: () => this.revertAll() },
    });
    this.bar = make('div', { class: 'apply-bar' }, this.summary, this.revert, this.apply);
    this.file = make('p', { class: 'hint path' });
    root.append(
      make('div', { class: 'setting-cards' }, this.mavlink.root, this.esp32.root, this.buildBackup()),
      this.notice.root,
      this.jumps,
      this.groups,
      this.bar,
    );
    this.showChanges();
  }

  buildBackup() {
    const chooser = make('input', {
      type: 'file',
      accept: '.json,application/json',
      class: 'visually-hidden',
      tabindex: '-1',
      'aria-hidden': 'true',
    });
    chooser.addEventListener('change', () => void this.restore(chooser));
    return make(
      'section',
      { class: 'card' },
      make('header', { class: 'card-head' }, make('h2', { text: 'Backup' })),
      make('p', {
        class: 'hint',
        text: 'All settings that differ from their defaults, in one file. An older file is brought up to date when it is restored.',
      }),
      make(
        'div',
        { class: 'actions' },
        make('button', {
          class: 'button',
          type: 'button',
          text: 'Save backup',
          on: { click: () => void this.backup() },
        }),
        make('button', {
          class: 'button',
          type: 'button',
          text: 'Restore...',
          on: { click: () => chooser.click() },
        }),
        chooser,
      ),
      this.file,
    );
  }

  show() {
    void this.load(false);
  }

  onStatus() {
    this.mavlink.update(this.model.status?.mavlink);
    this.esp32.update(this.model.status?.firmware);
  }

  /** @param {boolean} overwrite  throw away what was typed and not applied */
  async load(overwrite) {
    try {
      this.showSettings(await call('api/settings'), overwrite);
    } catch (error) {
      this.notice.say(error instanceof Error ? error.message : String(error), 'error');
    }
  }

  /**
   * @param {any} answer
   * @param {boolean} overwrite
   */
  showSettings(answer, overwrite) {
    const settings = /** @type {import('./setting_values.js').Setting[]} */ (
      Array.isArray(answer?.settings) ? answer.settings : []
    );
    setText(this.file, answer?.file ?? '');
    useDisplaySettings(answer);
    for (const setting of settings) {
      const row = this.rows.get(setting.key);
      if (row) row.take(setting, overwrite);
      else this.addRow(setting);
    }
    this.showChanges();
  }

  /** @param {import('./setting_values.js').Setting} setting */
  addRow(setting) {
    const group = setting.group ?? setting.key.split('.')[0];
    const row = new SettingRow(setting, () => this.showChanges());
    this.rows.set(setting.key, row);
    this.groupOf(group).append(row.root);
  }

  /** @param {string} group */
  groupOf(group) {
    const id = `settings-${group}`;
    const found = document.getElementById(id);
    if (found) return found;
    const title = make('h2', { text: wordsOf(group), tabindex: '-1' });
    const section = make('section', { class: 'card', id }, make('header', { class: 'card-head' }, title));
    this.groups.append(section);
    // A button, not a link: the address names the tab.
    this.jumps.append(
      make('button', {
        class: 'button',
        type: 'button',
        text: wordsOf(group),
        on: {
          click: () => {
            section.scrollIntoView({ block: 'start' });
            title.focus({ preventScroll: true });
          },
        },
      }),
    );
    return section;
  }

  get dirty() {
    return [...this.rows.values()].filter((row) => row.isDirty);
  }

  showChanges() {
    const { dirty } = this;
    const wrong = dirty.filter((row) => row.parsed.error);
    const many = dirty.length === 1 ? '1 change' : `${dirty.length} changes`;
    const text =
      dirty.length === 0 ? 'No changes' : wrong.length > 0 ? `${many}, ${wrong.length} not valid` : many;
    setText(this.summary, text);
    this.apply.disabled = dirty.length === 0 || wrong.length > 0;
    this.revert.disabled = dirty.length === 0;
    this.bar.classList.toggle('active', dirty.length > 0);
  }

  revertAll() {
    for (const row of this.dirty) row.revert();
    this.notice.say('');
  }

  async applyChanges() {
    const { dirty } = this;
    const restart = dirty.some((row) => row.setting.restart);
    const done = restart ? 'Applied. Some of it takes effect after a restart of the extension.' : 'Applied.';
    this.apply.disabled = true;
    const sent = await this.send(
      Object.fromEntries(dirty.map((row) => [row.setting.key, row.parsed.value])),
      done,
    );
    if (!sent) this.markNamed(dirty);
    this.showChanges();
  }

  /**
   * Puts the server's refusal beside the setting it names.
   * @param {SettingRow[]} rows
   */
  markNamed(rows) {
    const text = this.notice.root.textContent ?? '';
    for (const row of rows) if (text.includes(row.setting.key)) row.showError(text);
  }

  /**
   * @param {Record<string, any>} changes
   * @param {string} [done]
   * @returns {Promise<boolean>}
   */
  async send(changes, done = 'Applied.') {
    const answer = await this.notice.during('Applying', done, () =>
      call('api/settings', { method: 'PATCH', body: changes }),
    );
    if (answer === null) return false;
    useDisplaySettings(answer);
    for (const setting of answer?.settings ?? [])
      this.rows.get(setting.key)?.take(setting, Object.hasOwn(changes, setting.key));
    return true;
  }

  async backup() {
    const saved = await this.notice.during('Fetching the settings', 'Backup saved.', () =>
      call('api/settings/backup'),
    );
    if (saved === null) return;
    saveBlob(
      new Blob([JSON.stringify(saved, null, 2)], { type: 'application/json' }),
      'bluerov-slam-settings.json',
    );
  }

  /** @param {HTMLInputElement} chooser */
  async restore(chooser) {
    const [file] = chooser.files ?? [];
    if (!file) return;
    const text = await file.text();
    chooser.value = '';
    await this.notice.during('Restoring', `Restored from ${file.name}.`, async () => {
      let body;
      try {
        body = JSON.parse(text);
      } catch {
        throw new Error(`${file.name} is not a settings backup: it holds no JSON.`);
      }
      await call('api/settings/restore', { method: 'POST', body });
      await this.load(true);
    });
  }
}
