// @ts-check
// Switching MAVLink on, with what BlueOS needs for it and whether anybody answers.

import { make, setAttribute, setText } from '../shared/dom.js';
import { age, count, isKnown } from '../shared/format.js';
import { showState, stateIcon } from '../shared/status_icons.js';

/** @typedef {import('../shared/status_icons.js').State} State */

/**
 * @param {Record<string, any> | null | undefined} mavlink
 * @returns {{state: State, text: string}}
 */
export function answerSentence(mavlink) {
  if (typeof mavlink?.enabled !== 'boolean')
    return { state: 'unknown', text: 'The bridge has not reported yet.' };
  if (!mavlink.enabled) return { state: 'off', text: 'Off: nothing is sent.' };
  const sent = `${count(mavlink.sent)} sent to ${mavlink.target ?? '-'}`;
  if (!mavlink.peer_alive) {
    const last = isKnown(mavlink.last_heard_s) ? ` Last heard ${age(mavlink.last_heard_s)} ago.` : '';
    return {
      state: 'warn',
      text: `${sent}, but nobody answers: the endpoint is missing, or the router is down.${last}`,
    };
  }
  return {
    state: 'ok',
    text: `${sent}; ${mavlink.peer ?? 'the router'} answers, ${count(mavlink.received)} received.`,
  };
}

/**
 * @param {unknown} target  "host:port"
 */
export function portOf(target) {
  const found = /:(\d+)$/.exec(String(target ?? ''));
  return found ? found[1] : '14401';
}

export class MavlinkPanel {
  /** @param {(changes: Record<string, any>) => Promise<boolean>} send */
  constructor(send) {
    this.icon = stateIcon();
    this.sentence = make('span', { text: answerSentence(null).text });
    this.toggle = make('button', { class: 'button', type: 'button', text: 'Switch on', disabled: true });
    this.port = make('b', { text: '14401' });
    this.enabled = false;
    this.toggle.addEventListener('click', async () => {
      this.toggle.disabled = true;
      await send({ 'mavlink.enabled': !this.enabled });
      this.toggle.disabled = false;
    });
    const step = (/** @type {(Node | string)[]} */ ...words) => make('li', {}, ...words);
    this.root = make(
      'section',
      { class: 'card mavlink-panel' },
      make(
        'header',
        { class: 'card-head' },
        make('h2', { text: 'MAVLink to the autopilot and ground station' }),
      ),
      make('p', { class: 'answer' }, this.icon, this.sentence),
      make('div', { class: 'actions' }, this.toggle),
      make(
        'details',
        {},
        make('summary', { text: 'How to add the endpoint in BlueOS' }),
        make(
          'ol',
          { class: 'steps' },
          step('Open BlueOS, menu Vehicle, page MAVLink Endpoints (shown in Pirate Mode).'),
          step(
            'Add one: name BlueROV SLAM, type UDP Server, address 127.0.0.1, port ',
            this.port,
            ', and save.',
          ),
          step('The router restarts: telemetry stops for some seconds. Do it on deck, not in a dive.'),
          step('Switch it on here. Within a few seconds this card says who answers.'),
        ),
        make('p', {
          class: 'hint',
          text: 'Never send to port 14401 of the surface computer: QGroundControl reads NMEA there. No parameter of the autopilot is changed.',
        }),
      ),
    );
  }

  /** @param {Record<string, any> | null | undefined} mavlink */
  update(mavlink) {
    const { state, text } = answerSentence(mavlink);
    showState(this.icon, state);
    setText(this.sentence, text);
    setText(this.port, portOf(mavlink?.target));
    if (state === 'unknown') return;
    this.enabled = mavlink?.enabled === true;
    if (this.toggle.textContent === 'Switch on' && this.toggle.disabled) this.toggle.disabled = false;
    setText(this.toggle, this.enabled ? 'Switch off' : 'Switch on');
    setAttribute(this.toggle, 'aria-pressed', String(this.enabled));
  }
}
