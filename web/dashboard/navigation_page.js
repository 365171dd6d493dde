// @ts-check
// The navigation page: what to do before the dive, calibrations, which sensors are trusted and why, the autopilot.

import { call } from '../shared/api.js';
import { make } from '../shared/dom.js';
import { Notice } from '../shared/notice.js';
import { AssistantPanel } from './assistant.js';
import { AutopilotPanel } from './autopilot_panel.js';
import { CalibrationPanel } from './calibration.js';
import { ConsistencyPanel } from './consistency.js';

const POLL_MS = 1000;

export class NavigationPage {
  /**
   * @param {HTMLElement} root
   * @param {import('./model.js').Model} model
   */
  constructor(root, model) {
    this.root = root;
    this.model = model;
    this.notice = new Notice();
    const act = (/** @type {Record<string, unknown>} */ body, /** @type {string} */ busy) =>
      this.act(body, busy);
    this.assistant = new AssistantPanel(act);
    this.calibration = new CalibrationPanel(act);
    this.consistency = new ConsistencyPanel();
    this.autopilot = new AutopilotPanel();
    this.notice.root.classList.add('navigation-notice');
    root.append(
      make(
        'div',
        { class: 'navigation-panels' },
        make('div', {}, this.assistant.root, this.calibration.root),
        make('div', {}, this.consistency.root, this.autopilot.root),
      ),
      this.notice.root,
    );
    setInterval(() => void this.poll(), POLL_MS);
  }

  /** The tab was chosen. */
  show() {
    this.onNavigation();
    void this.poll();
    void this.autopilot.load();
  }

  onNavigation() {
    if (this.root.hidden || !this.model.navigation) return;
    this.consistency.show(this.model.navigation);
    this.autopilot.showOdometry(this.model.navigation.odometry);
  }

  async poll() {
    if (this.root.hidden || document.hidden || this.polling) return;
    this.polling = true;
    try {
      const answer = await call('api/navigation/calibration');
      this.assistant.show(answer?.assistant);
      this.calibration.show(answer?.kinds);
    } catch (error) {
      this.notice.say(error instanceof Error ? error.message : String(error), 'error');
    } finally {
      this.polling = false;
    }
  }

  /**
   * @param {Record<string, unknown>} body
   * @param {string} busy
   */
  async act(body, busy) {
    this.notice.say(busy, 'busy');
    try {
      const answer = await call('api/navigation', { method: 'POST', body });
      this.notice.say(typeof answer?.message === 'string' ? answer.message : 'Done');
    } catch (error) {
      this.notice.say(error instanceof Error ? error.message : String(error), 'error');
    }
    await this.poll();
  }
}
