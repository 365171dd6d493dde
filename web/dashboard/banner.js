// @ts-check
// One line that is always there: what is wrong most, or that nothing is.

import { make, setAttribute, setText } from '../shared/dom.js';
import { age } from '../shared/format.js';
import { showState } from '../shared/status_icons.js';

/**
 * @typedef {{id?: string, level?: string, title: string, cause?: string | null, cure?: string | null}} Fault
 * @typedef {{state: import('../shared/status_icons.js').State, title: string, cure: string, more: string}} BannerText
 */

/**
 * The page's own trouble: no word from the extension.
 * @param {number | null} silentS
 * @returns {Fault}
 */
export function connectionFault(silentS) {
  const since = silentS === null ? '' : ` for ${age(silentS)}`;
  return {
    id: 'page',
    level: 'error',
    title: 'This page does not hear the extension',
    cause: `No message${since}. What is shown is the last that came.`,
    cure: 'Check the tether and that the extension is running (BlueOS, Extensions); it reconnects by itself.',
  };
}

/**
 * Status comes by plain HTTP, but no socket does.
 * @param {number | null} silentS
 * @returns {Fault}
 */
export function streamFault(silentS) {
  const since = silentS === null ? 'never came' : `stopped ${age(silentS)} ago`;
  return {
    id: 'stream',
    level: 'error',
    title: 'No live values reach this page',
    cause: `The WebSocket is refused or closed: values ${since}. Status still comes by plain HTTP.`,
    cure: 'It reconnects by itself. If it stays so, the proxy passes no WebSocket: update BlueOS, or map ports 8099 and 8766.',
  };
}

/**
 * @param {Fault[] | null} faults  worst first; null while nothing is known
 * @param {any[]} [chips]  those that ask for a look without being a fault are named
 * @returns {BannerText}
 */
export function bannerText(faults, chips = []) {
  if (faults === null) return { state: 'unknown', title: 'Waiting for the first status', cure: '', more: '' };
  if (faults.length === 0) {
    const look = chips.filter((chip) => chip?.state === 'warn' || chip?.state === 'fault');
    const unknown = chips.filter((chip) => chip?.state === 'unknown').map((chip) => chip.label);
    if (unknown.length > 0) {
      return {
        state: 'unknown',
        title: 'No fault reported',
        cure: `nothing known of: ${unknown.join(', ')}`,
        more: '',
      };
    }
    const names = look.map((chip) => `${chip.label}${chip.text ? `: ${chip.text}` : ''}`);
    return { state: 'ok', title: 'No faults', cure: names.join(', '), more: '' };
  }
  const [worst] = faults;
  const level = String(worst.level ?? 'error');
  return {
    state: level === 'warning' || level === 'warn' || level === 'info' ? 'warn' : 'fault',
    title: String(worst.title ?? worst.cause ?? 'Fault'),
    cure: String(worst.cure ?? worst.cause ?? ''),
    more: faults.length > 1 ? `+${faults.length - 1} more` : 'Details',
  };
}

export class Banner {
  /**
   * @param {HTMLElement} root
   * @param {() => void} onMore
   */
  constructor(root, onMore) {
    this.root = root;
    const icon = root.querySelector('.state-icon');
    const text = root.querySelector('.banner-text');
    const more = root.querySelector('.banner-more');
    if (!(icon instanceof HTMLElement) || !text || !more) throw new Error('the banner is incomplete');
    this.icon = icon;
    this.more = more;
    this.title = make('strong');
    this.cure = make('span');
    text.append(this.title, this.cure);
    more.addEventListener('click', onMore);
    this.show(null);
  }

  /**
   * @param {Fault[] | null} faults
   * @param {any[]} [chips]
   */
  show(faults, chips) {
    const { state, title, cure, more } = bannerText(faults, chips);
    setAttribute(this.root, 'data-state', state);
    setAttribute(this.root, 'title', cure ? `${title}. ${cure}` : null);
    showState(this.icon, state);
    setText(this.title, title);
    setText(this.cure, cure);
    setText(this.more, more || 'Details');
  }
}
