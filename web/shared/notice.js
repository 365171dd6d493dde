// @ts-check
// One line that keeps its place and says how the last action went.

import { make, setAttribute, setText } from './dom.js';

export class Notice {
  constructor() {
    this.root = make('p', { class: 'notice-line', role: 'status' });
  }

  /**
   * @param {string} text
   * @param {'ok' | 'error' | 'busy'} [level]
   */
  say(text, level = 'ok') {
    setAttribute(this.root, 'data-level', level);
    setText(this.root, text);
  }

  /**
   * Runs an action and says how it went.
   * @template T
   * @param {string} busy
   * @param {string} done
   * @param {() => Promise<T>} action
   * @returns {Promise<T | null>} null when it failed
   */
  async during(busy, done, action) {
    this.say(busy, 'busy');
    try {
      const result = await action();
      this.say(done);
      return result;
    } catch (error) {
      this.say(error instanceof Error ? error.message : String(error), 'error');
      return null;
    }
  }
}
