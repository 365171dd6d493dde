// @ts-check
// The recordings page: disk, start and stop, and one entry for each dive.

import { call } from '../shared/api.js';
import { make, setAttribute, setText } from '../shared/dom.js';
import { age, bytes, isKnown } from '../shared/format.js';
import { Notice } from '../shared/notice.js';
import { RecordingEntry } from './recording_entry.js';
import { perSecond } from './live_layout.js';

const RELOAD_MS = 10000;
const NONE_YET = 'No recordings yet. Recording starts with the first valid frame.';
const NONE_HERE = 'No recordings in this folder.';

/**
 * The session's name in the path of one of its files.
 * @param {unknown} file
 */
function sessionOf(file) {
  return /session_\d+_\d+/.exec(String(file ?? ''))?.[0] ?? '';
}

/**
 * The recorder in one sentence.
 * @param {Record<string, any> | null | undefined} recorder
 */
export function recorderSentence(recorder) {
  if (!recorder?.state) return 'The recorder has not reported yet.';
  if (recorder.error) return String(recorder.error);
  if (recorder.state !== 'recording') return `Not recording (${recorder.state}).`;
  const left = isKnown(recorder.seconds_left) ? `, room for ${age(recorder.seconds_left)} more` : '';
  const lost = recorder.dropped > 0 ? `, ${recorder.dropped} records LOST` : '';
  return `Recording ${sessionOf(recorder.file)}: ${bytes(recorder.bytes)}, ${perSecond(recorder.bytes_per_s)}${left}${lost}.`;
}

export class RecordingsPage {
  /**
   * @param {HTMLElement} root
   * @param {import('./model.js').Model} model
   */
  constructor(root, model) {
    this.root = root;
    this.model = model;
    this.notice = new Notice();
    /** @type {Map<string, RecordingEntry>} */
    this.entries = new Map();
    this.sentence = make('p', { class: 'recorder-sentence', text: recorderSentence(null) });
    this.toggle = make('button', {
      class: 'button primary record-toggle',
      type: 'button',
      text: 'Start recording',
      on: { click: () => void this.startOrStop() },
    });
    this.disk = make('meter', { min: 0, max: 1, 'aria-label': 'Disk used' });
    this.diskText = make('span', { text: '-' });
    this.folder = make('p', { class: 'hint path' });
    this.list = make('div', { class: 'recordings' });
    this.empty = make('p', {
      class: 'notice',
      text: NONE_YET,
    });
    root.append(
      make(
        'section',
        { class: 'card' },
        make('header', { class: 'card-head' }, make('h2', { text: 'Recorder' })),
        make('div', { class: 'recorder' }, this.sentence, this.toggle),
        make('p', { class: 'disk' }, make('span', { text: 'Disk' }), this.disk, this.diskText),
        this.folder,
        this.notice.root,
      ),
      this.list,
    );
    setInterval(() => !root.hidden && !document.hidden && void this.load(), RELOAD_MS);
  }

  show() {
    void this.load();
  }

  get isRecording() {
    return this.model.status?.recorder?.state === 'recording';
  }

  onStatus() {
    const recorder = this.model.status?.recorder;
    const isReplay = this.model.status?.source === 'replay';
    setText(this.sentence, isReplay ? 'A replay is not recorded again.' : recorderSentence(recorder));
    this.toggle.hidden = isReplay;
    setText(this.empty, isReplay ? NONE_HERE : NONE_YET);
    setAttribute(this.sentence, 'data-state', recorder?.error || recorder?.dropped > 0 ? 'fault' : 'ok');
    setText(this.toggle, this.isRecording ? 'Stop recording' : 'Start recording');
    this.toggle.classList.toggle('primary', !this.isRecording);
  }

  async startOrStop() {
    const action = this.isRecording ? 'stop' : 'start';
    this.toggle.disabled = true;
    await this.notice.during(
      'Asking the recorder',
      action === 'start' ? 'Recording started.' : 'Recording stopped.',
      () => call('api/recording', { method: 'POST', body: { action } }),
    );
    this.toggle.disabled = false;
    await this.load();
  }

  async load() {
    try {
      this.showList(await call('api/recordings'));
      if (this.notice.root.dataset.level === 'error') this.notice.say('');
    } catch (error) {
      this.notice.say(String(error instanceof Error ? error.message : error), 'error');
    }
  }

  /** @param {any} answer */
  showList(answer) {
    const recordings = Array.isArray(answer?.recordings) ? answer.recordings : [];
    const { free_bytes: free, total_bytes: total } = answer ?? {};
    setText(
      this.diskText,
      isKnown(free) ? `${bytes(free)} free${isKnown(total) ? ` of ${bytes(total)}` : ''}` : '-',
    );
    if (isKnown(free) && isKnown(total) && total > 0) this.disk.value = 1 - free / total;
    setText(this.folder, answer?.folder ?? '');
    const names = new Set(recordings.map((/** @type {any} */ recording) => recording.name));
    for (const [name, entry] of this.entries) {
      if (names.has(name)) continue;
      entry.root.remove();
      this.entries.delete(name);
    }
    const newestFirst = [...recordings].sort((a, b) => String(b.name).localeCompare(String(a.name)));
    newestFirst.forEach((recording, i) => {
      const entry = this.entries.get(recording.name) ?? this.addEntry(recording.name);
      entry.update({ ...recording, active: recording.active === true || recording.name === answer.active });
      if (this.list.children[i] !== entry.root)
        this.list.insertBefore(entry.root, this.list.children[i] ?? null);
    });
    if (newestFirst.length === 0) this.list.append(this.empty);
    else this.empty.remove();
  }

  /** @param {string} name */
  addEntry(name) {
    const entry = new RecordingEntry(name, {
      reload: () => this.load(),
      nowUnixS: () => this.model.unixAt(performance.now()),
    });
    this.entries.set(name, entry);
    return entry;
  }
}
