// @ts-check
// The dive-start assistant: its steps, how far each one is, and the one action each needs.

import { inShownUnits } from '../shared/display.js';
import { make, setText } from '../shared/dom.js';
import { showState, stateIcon } from '../shared/status_icons.js';
import { ask } from '../shared/dialog.js';
import { button, panel } from './panel.js';

/**
 * @typedef {(body: Record<string, unknown>, busy: string) => Promise<void>} Act
 * @typedef {{item: HTMLLIElement, icon: HTMLElement, title: HTMLElement, text: HTMLElement, word: HTMLElement}} StepView
 */

/** @type {Record<string, import('../shared/status_icons.js').State>} */
const STATES = { done: 'ok', warning: 'warn', active: 'unknown', todo: 'off' };
const WORDS = /** @type {Record<string, string>} */ ({
  done: 'Done',
  warning: 'Not enough yet',
  active: 'Now',
  todo: 'Later',
});

export class AssistantPanel {
  /** @param {Act} act */
  constructor(act) {
    this.act = act;
    /** @type {Map<string, StepView>} */
    this.views = new Map();
    this.list = make('ol', { class: 'assistant-steps' });
    this.waiting = make('p', { class: 'hint', text: 'Waiting for the navigator' });
    this.root = panel(
      'assistant',
      'Before the dive',
      'A few minutes at the surface that decide how well the position is known under water.',
      this.waiting,
      this.list,
    );
  }

  /** @param {any} assistant  of GET api/navigation/calibration */
  show(assistant) {
    const steps = Array.isArray(assistant?.steps) ? assistant.steps : [];
    this.waiting.hidden = steps.length > 0;
    for (const step of steps) {
      const view = this.views.get(step.id) ?? this.addStep(step);
      view.item.dataset.state = String(step.state);
      showState(view.icon, STATES[step.state] ?? 'unknown');
      setText(view.title, String(step.title ?? step.id));
      setText(view.word, WORDS[step.state] ?? '');
      setText(view.text, inShownUnits(String(step.text ?? '')));
    }
  }

  /**
   * @param {any} step
   * @returns {StepView}
   */
  addStep(step) {
    const view = {
      icon: stateIcon(),
      title: make('b'),
      word: make('span', { class: 'step-word' }),
      text: make('p', { class: 'hint' }),
      item: make('li'),
    };
    view.item.append(
      view.icon,
      make('div', {}, make('p', {}, view.title, ' ', view.word), view.text),
      this.action(step.action, step.kind),
    );
    this.views.set(step.id, view);
    this.list.append(view.item);
    return view;
  }

  /**
   * @param {unknown} action
   * @param {unknown} kind  of the calibration that the step begins
   */
  action(action, kind) {
    if (action === 'zero_depth')
      return button('Zero now', () => void this.act({ action }, 'Zeroing the depth'));
    if (action === 'set_origin') return button('Set here', () => void this.setOrigin());
    if (action === 'start_calibration')
      return button('Begin', () => {
        showCalibrations(String(kind));
        void this.act({ action, kind }, 'Starting');
      });
    if (action === 'show_calibration') return button('Show', () => showCalibrations());
    return make('span');
  }

  async setOrigin() {
    const sure = await ask({
      title: 'Set the origin here?',
      lines: [
        'North and east will be counted from where the vehicle is now. The track on the map starts anew; recordings keep theirs.',
      ],
      action: 'Set the origin',
    });
    if (sure) await this.act({ action: 'set_origin' }, 'Setting the origin');
  }
}

/**
 * The guided calibrations, which stand further down: the one of a kind, or all of them.
 * @param {string} [kind]
 */
function showCalibrations(kind) {
  const calibrations = document.querySelector('.panel-calibration');
  const one = kind ? calibrations?.querySelector(`.calibration[data-kind="${kind}"]`) : calibrations;
  one?.scrollIntoView({ block: kind ? 'center' : 'start' });
  one?.querySelector('button')?.focus({ preventScroll: true });
}
