// @ts-check
// The health page: what is wrong and how to cure it, the event log, every counter, and the troubleshooting list.

import { call } from '../shared/api.js';
import { make, setText } from '../shared/dom.js';
import { dateTime } from '../shared/format.js';
import { showState, stateIcon } from '../shared/status_icons.js';
import { bannerText } from './banner.js';
import { counterParts } from './counters.js';
import { TROUBLES, isRelated } from './troubleshooting.js';

/** @typedef {import('./banner.js').Fault} Fault */

const LEVEL_STATES = /** @type {Record<string, import('../shared/status_icons.js').State>} */ ({
  info: 'ok',
  warning: 'warn',
  warn: 'warn',
  error: 'fault',
});
const FILTERS = /** @type {Array<[string, string[] | null]>} */ ([
  ['All', null],
  ['Warnings and errors', ['warning', 'warn', 'error']],
  ['Errors', ['error']],
]);

export class HealthPage {
  /**
   * @param {HTMLElement} root
   * @param {import('./model.js').Model} model
   */
  constructor(root, model) {
    this.root = root;
    this.model = model;
    this.faultsKey = '';
    this.eventsKey = '';
    this.filter = 0;
    this.faults = make('ul', { class: 'faults' });
    this.events = make('ol', { class: 'events', tabindex: '0', 'aria-label': 'Events' });
    this.counters = make('div', { class: 'counters' });
    /** @type {Map<string, {list: HTMLElement, values: Map<string, HTMLElement>}>} */
    this.parts = new Map();
    this.troubles = TROUBLES.map((trouble) => this.buildTrouble(trouble));
    root.append(
      make(
        'div',
        { class: 'health-top' },
        this.card('Now', this.faults),
        this.card('Events', this.buildFilters(), this.events),
      ),
      this.card(
        'Troubleshooting',
        make('div', { class: 'troubles' }, ...this.troubles.map((trouble) => trouble.root)),
      ),
      this.card('Counters', this.counters),
    );
  }

  /**
   * @param {string} title
   * @param {...Node} content
   */
  card(title, ...content) {
    return make(
      'section',
      { class: 'card' },
      make('header', { class: 'card-head' }, make('h2', { text: title })),
      ...content,
    );
  }

  buildFilters() {
    this.filterButtons = FILTERS.map(([text], i) =>
      make('button', {
        class: 'button',
        type: 'button',
        text,
        'aria-pressed': String(i === this.filter),
        on: { click: () => this.chooseFilter(i) },
      }),
    );
    return make(
      'div',
      { class: 'tools', role: 'group', 'aria-label': 'Events shown' },
      ...this.filterButtons,
    );
  }

  /** @param {(typeof TROUBLES)[number]} trouble */
  buildTrouble(trouble) {
    const mark = make('span', { class: 'badge', text: 'NOW' });
    mark.hidden = true;
    const root = make(
      'details',
      {},
      make('summary', {}, make('span', { text: trouble.title }), mark),
      make('ul', {}, ...trouble.cure.map((line) => make('li', { text: line }))),
    );
    return { root, mark, trouble };
  }

  show() {
    this.onStatus();
    this.onEvents();
    void this.loadEvents();
  }

  async loadEvents() {
    try {
      const answer = await call('api/events');
      this.model.takeEvents(Array.isArray(answer) ? answer : (answer?.events ?? []));
      this.onEvents();
    } catch {
      // The log on the page is then what came over the socket; the banner tells of the connection.
    }
  }

  /** @param {number} i */
  chooseFilter(i) {
    this.filter = i;
    this.filterButtons?.forEach((button, k) => button.setAttribute('aria-pressed', String(k === i)));
    this.onEvents();
  }

  /** @param {Fault[] | null} faults */
  showFaults(faults) {
    const key = JSON.stringify(faults);
    if (key === this.faultsKey) return;
    this.faultsKey = key;
    for (const { mark, trouble } of this.troubles) mark.hidden = !isRelated(trouble, faults ?? []);
    if (faults === null || faults.length === 0) {
      this.faults.replaceChildren(make('li', { class: 'hint', text: bannerText(faults).title }));
      return;
    }
    this.faults.replaceChildren(
      ...faults.map((fault) => {
        const icon = stateIcon();
        showState(icon, bannerText([fault]).state);
        return make(
          'li',
          {},
          icon,
          make(
            'div',
            {},
            make('strong', { text: fault.title }),
            make('p', { text: fault.cause ?? '' }),
            make('p', { class: 'cure', text: fault.cure ? `Cure: ${fault.cure}` : '' }),
          ),
        );
      }),
    );
  }

  onEvents() {
    if (this.root.hidden) return;
    const wanted = FILTERS[this.filter][1];
    const shown = this.model.events.filter((entry) => wanted === null || wanted.includes(entry.level));
    const key = `${this.filter} ${shown.length} ${shown[0]?.t} ${shown[0]?.text}`;
    if (key === this.eventsKey) return;
    this.eventsKey = key;
    const item = (/** @type {import('./model.js').EventEntry} */ entry) => {
      const icon = stateIcon();
      showState(icon, LEVEL_STATES[entry.level] ?? 'unknown');
      icon.title = entry.level;
      return make(
        'li',
        {},
        icon,
        make('time', { text: dateTime(entry.t) }),
        make('span', { text: entry.text }),
      );
    };
    const none = make('li', { class: 'hint', text: 'None' });
    this.events.replaceChildren(...(shown.length > 0 ? shown.map(item) : [none]));
  }

  onStatus() {
    const { status } = this.model;
    if (this.root.hidden || !status) return;
    for (const [title, rows] of counterParts(status)) this.showPart(title, rows);
  }

  /**
   * @param {string} title
   * @param {Array<[string, string]>} rows
   */
  showPart(title, rows) {
    const part = this.parts.get(title) ?? this.addPart(title);
    const labels = new Set(rows.map(([label]) => label));
    for (const [label, value] of part.values) {
      if (labels.has(label)) continue;
      value.parentElement?.remove();
      part.values.delete(label);
    }
    for (const [label, text] of rows) {
      let value = part.values.get(label);
      if (!value) {
        value = make('dd');
        part.values.set(label, value);
        part.list.append(make('div', {}, make('dt', { text: label }), value));
      }
      setText(value, text);
    }
  }

  /** @param {string} title */
  addPart(title) {
    const list = make('dl');
    this.counters.append(make('section', {}, make('h3', { text: title }), list));
    const part = { list, values: new Map() };
    this.parts.set(title, part);
    return part;
  }
}
