// @ts-check
/** The tool bar at the edge: beside the picture on a wide screen, below it on a phone. */

import { make, setAttribute, setText } from '../shared/dom.js';
import { chooseTheme, currentTheme } from '../shared/theme.js';
import { toast } from './dialogs.js';
import { icon, setIcon } from './icons.js';

/** @typedef {import('./page.js').ViewerPage} ViewerPage */

export class ToolBar {
  /** @param {HTMLElement} root @param {ViewerPage} page */
  constructor(root, page) {
    this.root = root;
    this.measuring = false;
    /** @type {Record<string, {button: HTMLButtonElement, icon: SVGElement, text: HTMLElement}>} */
    this.tools = {};
    this.add('pause', 'Pause', 'Pause, or back to live (Space)', () => page.togglePause());
    this.add('picture', 'Picture', 'Palette, gain and levels (P)', () => page.togglePanel('picture'));
    this.add('contacts', 'Contacts', 'Named contacts (C)', () => page.togglePanel('contacts'));
    this.add('sonar', 'Sonar', 'Sonar settings (O)', () => page.togglePanel('sonar'));
    this.add('measure', 'Measure', 'Measure by dragging (M for the keyboard)', () =>
      this.setMeasuring(!this.measuring),
    );
    this.add('layout', 'View', 'Side by side, stacked, one side (1 to 4)', () => page.nextLayout());
    this.add('snapshot', 'Save', 'Snapshot as PNG (S)', () => page.snapshot());
    this.add('sensors', 'Sensors', 'The dashboard with every sensor, in another tab', () =>
      openDashboard(page.status?.dashboard_port),
    );
    this.add('theme', 'Theme', 'Light or dark (T)', () => this.switchTheme());
    this.add('full', 'Full', 'Full screen (F)', () => page.fullScreen());
    this.add('help', 'Keys', 'Keys and gestures (?)', () => page.help());
    this.count = make('span', { class: 'count', 'aria-hidden': 'true' });
    this.count.hidden = true;
    this.tools.contacts.button.append(this.count);
    for (const name of ['picture', 'contacts', 'sonar']) {
      setAttribute(this.tools[name].button, 'aria-expanded', 'false');
      setAttribute(this.tools[name].button, 'aria-controls', 'panel');
    }
    setAttribute(this.tools.measure.button, 'aria-pressed', 'false');
  }

  /** @param {string} name @param {string} label @param {string} title @param {() => void} click */
  add(name, label, title, click) {
    const image = icon(name);
    const text = make('span', { text: label });
    const button = make('button', {
      class: 'tool',
      type: 'button',
      id: `tool-${name}`,
      title,
      on: { click },
    });
    button.append(image, text);
    setAttribute(button, 'aria-label', `${label}: ${title}`);
    this.tools[name] = { button, icon: image, text };
    this.root.append(button);
  }

  /** @param {boolean} on */
  setMeasuring(on) {
    this.measuring = on;
    setAttribute(this.tools.measure.button, 'aria-pressed', String(on));
  }

  /** @param {boolean} paused */
  showPaused(paused) {
    const { icon: image, text, button } = this.tools.pause;
    setIcon(image, paused ? 'play' : 'pause');
    setText(text, paused ? 'Live' : 'Pause');
    setAttribute(button, 'aria-label', paused ? 'Live: back to live (Space)' : 'Pause (Space)');
  }

  /** @param {number} contacts */
  showContacts(contacts) {
    this.count.hidden = contacts === 0;
    setText(this.count, String(contacts));
    setAttribute(this.tools.contacts.button, 'aria-label', `Contacts: ${contacts} named (C)`);
  }

  /** @param {string | null} name */
  showPanel(name) {
    for (const each of ['picture', 'contacts', 'sonar']) {
      setAttribute(this.tools[each].button, 'aria-expanded', String(each === name));
    }
  }

  /** @param {string} name */
  focusPanel(name) {
    this.tools[name].button.focus();
  }

  switchTheme() {
    chooseTheme(currentTheme() === 'dark' ? 'light' : 'dark');
  }
}

/**
 * It has its own port; the path of this page may be a proxy's.
 * @param {unknown} port
 */
function openDashboard(port) {
  if (Number.isInteger(port)) window.open(`http://${location.hostname}:${port}/`, '_blank', 'noopener');
  else toast('The service has not said yet where the dashboard is.', 'fault');
}
