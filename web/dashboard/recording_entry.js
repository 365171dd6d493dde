// @ts-check
// One dive: its facts, its name and notes, its files, and what can be done with it.

import { call } from '../shared/api.js';
import { ask } from '../shared/dialog.js';
import { make, setAttribute, setText } from '../shared/dom.js';
import { bytes, clockTime, count, dateTime, duration, isKnown, signed } from '../shared/format.js';
import { Notice } from '../shared/notice.js';

/**
 * What the clock of this recording is worth.
 * @param {any} recording
 * @returns {string} empty when there is nothing to say
 */
export function clockSentence(recording) {
  if (recording.wall_clock_trusted !== false) return '';
  return isKnown(recording.gps_utc_offset_s)
    ? `The vehicle's clock was wrong in this dive; GPS time differs by ${signed(recording.gps_utc_offset_s, 1)} s and is noted with it.`
    : "The vehicle's clock may be wrong in this dive, and no GPS time was seen to correct it.";
}

/** @param {any} recording */
export function factsOf(recording) {
  return [
    dateTime(recording.started_unix_s),
    duration(recording.duration_s),
    bytes(recording.bytes),
    `pings A ${count(recording.pings_a)}, B ${count(recording.pings_b)}`,
  ].join(' \u00b7 ');
}

export class RecordingEntry {
  /**
   * @param {string} name
   * @param {{reload: () => Promise<void>, nowUnixS: () => number}} page
   */
  constructor(name, page) {
    this.name = name;
    this.page = page;
    this.address = `api/recordings/${encodeURIComponent(name)}`;
    this.notice = new Notice();
    this.heading = make('h3');
    this.live = make('span', { class: 'badge recording-now', text: 'RECORDING' });
    this.facts = make('p', { class: 'hint facts' });
    this.clock = make('p', { class: 'hint warn-text' });
    this.files = make('ul', { class: 'files' });
    this.annotations = make('ul', { class: 'annotations' });
    const { form, remark } = this.buildForms();
    this.remark = remark;
    this.remove = make('button', {
      class: 'button danger',
      type: 'button',
      text: 'Delete',
      on: { click: () => void this.askDelete() },
    });
    this.root = make(
      'article',
      { class: 'card recording', dataset: { name } },
      make(
        'div',
        { class: 'recording-words' },
        make('header', {}, this.heading, this.live),
        this.facts,
        this.clock,
      ),
      make(
        'div',
        { class: 'actions' },
        make('a', {
          class: 'button',
          href: `${this.address}/export`,
          download: `${name}.zip`,
          text: 'Export zip',
        }),
        this.remove,
      ),
      make(
        'details',
        {},
        make('summary', { text: 'Name, notes and remarks' }),
        form,
        this.annotations,
        remark,
      ),
      make('details', {}, make('summary', { text: 'Files' }), this.files),
      this.notice.root,
    );
  }

  buildForms() {
    const id = (/** @type {string} */ part) => `${this.name}-${part}`;
    this.title = make('input', {
      class: 'field',
      id: id('title'),
      maxlength: 200,
      placeholder: 'Wreck, second pass',
    });
    this.notes = make('textarea', { class: 'field', id: id('notes'), rows: 3, maxlength: 10000 });
    const form = make(
      'form',
      { class: 'dive-form', on: { submit: (/** @type {Event} */ event) => void this.save(event) } },
      make('label', { for: id('title'), text: 'Name' }),
      this.title,
      make('label', { for: id('notes'), text: 'Notes' }),
      this.notes,
      make('button', { class: 'button', type: 'submit', text: 'Save' }),
    );
    this.remarkText = make('input', { class: 'field', id: id('remark'), maxlength: 1000, required: true });
    const remark = make(
      'form',
      { class: 'remark-form', on: { submit: (/** @type {Event} */ event) => void this.addRemark(event) } },
      make('label', { for: id('remark'), text: 'Remark, dated now' }),
      make('div', {}, this.remarkText, make('button', { class: 'button', type: 'submit', text: 'Add' })),
    );
    return { form, remark };
  }

  /** @param {any} recording */
  update(recording) {
    this.recording = recording;
    setText(this.heading, recording.title || this.name);
    this.live.hidden = !recording.active;
    setText(this.facts, `${recording.title ? `${this.name} \u00b7 ` : ''}${factsOf(recording)}`);
    setText(this.clock, clockSentence(recording));
    this.remove.disabled = recording.active === true;
    setAttribute(this.remove, 'title', recording.active ? 'Stop the recording first' : null);
    this.remark.hidden = !recording.active;
    this.fill(this.title, recording.title ?? '');
    this.fill(this.notes, recording.notes ?? '');
    this.showFiles(Array.isArray(recording.files) ? recording.files : []);
    this.showAnnotations(Array.isArray(recording.annotations) ? recording.annotations : []);
  }

  /**
   * A text that somebody is changing is theirs until it is saved.
   * @param {HTMLInputElement | HTMLTextAreaElement | undefined} field
   * @param {string} text
   */
  fill(field, text) {
    if (!field || field.value !== (field.dataset.saved ?? '')) return;
    field.value = text;
    field.dataset.saved = text;
  }

  /** @param {any[]} files */
  showFiles(files) {
    const key = JSON.stringify(files);
    if (this.files.dataset.key === key) return;
    this.files.dataset.key = key;
    const item = (/** @type {any} */ file) =>
      make(
        'li',
        {},
        make('a', {
          href: `${this.address}/files/${encodeURIComponent(file.name)}`,
          download: file.name,
          text: file.name,
        }),
        make('span', { class: 'hint', text: bytes(file.bytes) }),
      );
    this.files.replaceChildren(...files.map(item));
  }

  /** @param {any[]} annotations */
  showAnnotations(annotations) {
    const key = JSON.stringify(annotations);
    if (this.annotations.dataset.key === key) return;
    this.annotations.dataset.key = key;
    const item = (/** @type {any} */ a) =>
      make(
        'li',
        {},
        make('span', { class: 'hint', text: clockTime(a.time_unix_s) }),
        ` ${a.kind === 'contact' ? 'Contact: ' : ''}${a.text || a.name || ''}`,
      );
    this.annotations.replaceChildren(...annotations.map(item));
  }

  /** @param {Event} event */
  async save(event) {
    event.preventDefault();
    if (!this.title || !this.notes) return;
    const body = { title: this.title.value, notes: this.notes.value };
    const saved = await this.notice.during('Saving', 'Saved.', async () => {
      await call(this.address, { method: 'PATCH', body });
      return true;
    });
    if (!saved) return;
    this.title.dataset.saved = this.title.value;
    this.notes.dataset.saved = this.notes.value;
    await this.page.reload();
  }

  /** @param {Event} event */
  async addRemark(event) {
    event.preventDefault();
    if (!this.remarkText) return;
    const body = { kind: 'note', text: this.remarkText.value, time_unix_s: this.page.nowUnixS() };
    const added = await this.notice.during('Saving', 'Added.', async () => {
      await call(`${this.address}/annotations`, { method: 'POST', body });
      return true;
    });
    if (!added) return;
    this.remarkText.value = '';
    await this.page.reload();
  }

  async askDelete() {
    const { title, bytes: size } = this.recording ?? {};
    const sure = await ask({
      title: `Delete ${title || this.name}?`,
      lines: [
        `${this.name}, ${bytes(size)}, with its notes and contacts.`,
        'This cannot be undone. Export it first if in doubt.',
      ],
      action: 'Delete for good',
      danger: true,
    });
    if (!sure) return;
    await this.notice.during('Deleting', 'Deleted.', async () => {
      await call(this.address, { method: 'DELETE', headers: { 'X-Confirm': this.name } });
      await this.page.reload();
    });
  }
}
