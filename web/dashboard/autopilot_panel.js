// @ts-check
// ArduSub and our position: whether it is sent, and the parameters the autopilot needs to fly on it.

import { call } from '../shared/api.js';
import { ask } from '../shared/dialog.js';
import { make, setText } from '../shared/dom.js';
import { count } from '../shared/format.js';
import { Notice } from '../shared/notice.js';
import { button, panel } from './panel.js';

export class AutopilotPanel {
  constructor() {
    this.notice = new Notice();
    this.odometry = make('p', { text: 'Nothing is sent to the autopilot' });
    this.rows = make('tbody');
    this.set = button('Set parameters', () => void this.setParameters());
    this.set.disabled = true;
    this.root = panel(
      'autopilot',
      'Autopilot',
      'ArduSub can hold its position on this estimate. Switch it on under Settings (navigation).',
      this.odometry,
      make(
        'table',
        { class: 'parameters' },
        make(
          'thead',
          {},
          make(
            'tr',
            {},
            ...['Parameter', 'Needed', 'Now', ''].map((text) => make('th', { scope: 'col', text })),
          ),
        ),
        this.rows,
      ),
      make(
        'div',
        { class: 'tools' },
        button('Read again', () => void this.load()),
        this.set,
      ),
      this.notice.root,
    );
  }

  /** @param {any} odometry */
  showOdometry(odometry) {
    if (!odometry) return;
    const sent = odometry.enabled ? ` (${count(odometry.sent)} sent)` : '';
    setText(this.odometry, `${odometry.text ?? '-'}${sent}`);
  }

  async load() {
    this.notice.say('Asking the autopilot', 'busy');
    try {
      this.show(await call('api/navigation/autopilot'));
      this.notice.say('');
    } catch (error) {
      this.notice.say(error instanceof Error ? error.message : String(error), 'error');
    }
  }

  /** @param {any} answer */
  show(answer) {
    const parameters = Array.isArray(answer) ? answer : (answer?.parameters ?? []);
    this.wrong = parameters.filter((/** @type {any} */ p) => p?.current !== p?.needed);
    this.rows.replaceChildren(
      ...parameters.map((/** @type {any} */ p) =>
        make(
          'tr',
          { dataset: { fits: p.current === null ? 'unknown' : String(p.current === p.needed) } },
          make('th', { scope: 'row', text: String(p.name) }),
          make('td', { text: value(p.needed) }),
          make('td', { text: value(p.current) }),
          make('td', { class: 'hint', text: String(p.text ?? '') }),
        ),
      ),
    );
    this.set.disabled = !this.wrong.some(
      (/** @type {any} */ p) => p.current !== null && p.current !== undefined,
    );
  }

  async setParameters() {
    const wrong = (this.wrong ?? []).map(
      (/** @type {any} */ p) => `${p.name}: ${value(p.current)} \u2192 ${value(p.needed)}`,
    );
    const sure = await ask({
      title: 'Change parameters of the autopilot?',
      lines: ['The vehicle must be disarmed. These will be written and read back:', ...wrong],
      action: 'Set parameters',
      danger: true,
    });
    if (!sure) return;
    await this.notice.during('Writing and reading back', 'Set, and read back', async () => {
      this.show(
        await call('api/navigation/autopilot', {
          method: 'POST',
          body: { action: 'set_parameters', confirm: true },
          timeoutMs: 30000,
        }),
      );
    });
  }
}

/** @param {unknown} number */
function value(number) {
  return typeof number === 'number' ? String(number) : '-';
}
