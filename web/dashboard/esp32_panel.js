// @ts-check
// The rates of the ESP32: asked for, and acknowledged by it.

import { call } from '../shared/api.js';
import { make, setText } from '../shared/dom.js';
import { UNKNOWN, duration } from '../shared/format.js';
import { Notice } from '../shared/notice.js';

/** Limits of CONFIG keys 1 to 3 (wire protocol, section 1). */
export const RATES = [
  {
    key: 'sensors_rate_hz',
    label: 'Sensor frames',
    unit: 'Hz',
    minimum: 0.5,
    maximum: 20,
    usual: 2,
    step: 0.5,
  },
  { key: 'imu_rate_hz', label: 'IMU samples', unit: 'Hz', minimum: 1, maximum: 20, usual: 20, step: 1 },
  { key: 'decimation', label: 'Sonar decimation', unit: ': 1', minimum: 1, maximum: 8, usual: 4, step: 1 },
];

/**
 * What was filled in, as the call's body.
 * @param {string[]} texts  in the order of RATES; empty leaves it as it is
 * @returns {{body: Record<string, number>, error: string}}
 */
export function ratesBody(texts) {
  /** @type {Record<string, number>} */
  const body = {};
  for (const [i, rate] of RATES.entries()) {
    const text = (texts[i] ?? '').trim().replace(',', '.');
    if (text === '') continue;
    const value = Number(text);
    const whole = rate.key !== 'decimation' || Number.isInteger(value);
    if (!(value >= rate.minimum && value <= rate.maximum && whole)) {
      return { body: {}, error: `${rate.label}: ${text} is outside ${rate.minimum} to ${rate.maximum}.` };
    }
    body[rate.key] = value;
  }
  return { body, error: Object.keys(body).length === 0 ? 'Fill in at least one.' : '' };
}

export class Esp32Panel {
  constructor() {
    this.notice = new Notice();
    this.firmware = make('p', { class: 'hint', text: 'Firmware: -' });
    this.inputs = RATES.map((rate) =>
      make('input', {
        class: 'field',
        id: `rate-${rate.key}`,
        inputmode: 'decimal',
        autocomplete: 'off',
        placeholder: `usual ${rate.usual}`,
      }),
    );
    this.root = make(
      'section',
      { class: 'card' },
      make('header', { class: 'card-head' }, make('h2', { text: 'ESP32' })),
      this.firmware,
      make(
        'form',
        { class: 'rates', on: { submit: (/** @type {Event} */ event) => void this.send(event) } },
        ...RATES.flatMap((rate, i) => [
          make('label', { for: `rate-${rate.key}`, text: rate.label }),
          make(
            'span',
            { class: 'rate-input' },
            this.inputs[i],
            make('span', { class: 'unit', text: rate.unit }),
          ),
        ]),
        make('button', { class: 'button', type: 'submit', text: 'Send to the ESP32' }),
      ),
      make('p', {
        class: 'hint',
        text: 'It forgets them at its next start. At 115200 baud, 2 Hz leaves the most room for the sonars.',
      }),
      this.notice.root,
    );
  }

  /** @param {Record<string, any> | null | undefined} firmware */
  update(firmware) {
    const text = firmware
      ? `Firmware ${firmware.version ?? UNKNOWN}, up ${duration(firmware.uptime_s)}`
      : 'Firmware: has not reported';
    setText(this.firmware, text);
  }

  /** @param {Event} event */
  async send(event) {
    event.preventDefault();
    const { body, error } = ratesBody(this.inputs.map((input) => input.value));
    if (error) {
      this.notice.say(error, 'error');
      return;
    }
    await this.notice.during('Waiting for its acknowledgement', 'The ESP32 acknowledged.', async () => {
      const answer = await call('api/esp32', { method: 'POST', body });
      const result = answer?.result;
      if (result !== undefined && result !== 'ok')
        throw new Error(`The ESP32 answered: ${answer?.message ?? result}.`);
    });
  }
}
