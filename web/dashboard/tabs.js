// @ts-check
// Tabs by pointer, by arrow keys and by address (#settings), one panel shown.

/** @param {HTMLElement} list  holds the buttons with role=tab */
export class Tabs {
  /**
   * @param {HTMLElement} list
   * @param {(id: string) => void} onShow
   */
  constructor(list, onShow) {
    /** @type {HTMLElement[]} */
    this.tabs = [...list.querySelectorAll('[role=tab]')].filter((node) => node instanceof HTMLElement);
    this.onShow = onShow;
    list.addEventListener('click', (event) => {
      const tab = event.target instanceof Element ? event.target.closest('[role=tab]') : null;
      if (tab instanceof HTMLElement) this.choose(tab);
    });
    list.addEventListener('keydown', (event) => this.onKey(event));
    window.addEventListener('hashchange', () => this.show(location.hash.slice(1)));
  }

  get ids() {
    return this.tabs.map(pageOf);
  }

  start() {
    this.show(location.hash.slice(1) || this.ids[0]);
  }

  /** @param {KeyboardEvent} event */
  onKey(event) {
    const at = this.tabs.findIndex((tab) => tab === document.activeElement);
    const last = this.tabs.length - 1;
    const to = {
      ArrowRight: at === last ? 0 : at + 1,
      ArrowLeft: at === 0 ? last : at - 1,
      Home: 0,
      End: last,
    }[event.key];
    if (at < 0 || to === undefined) return;
    event.preventDefault();
    this.tabs[to].focus();
    this.choose(this.tabs[to]);
  }

  /** @param {HTMLElement} tab */
  choose(tab) {
    const id = pageOf(tab);
    // replaceState, not the address itself: in an iframe a new entry would catch the outer page's back button.
    history.replaceState(null, '', `#${id}`);
    this.show(id);
  }

  /** @param {string} id */
  show(id) {
    if (!this.ids.includes(id)) return;
    for (const tab of this.tabs) {
      const chosen = pageOf(tab) === id;
      tab.setAttribute('aria-selected', String(chosen));
      tab.tabIndex = chosen ? 0 : -1;
      document.getElementById(`panel-${pageOf(tab)}`)?.toggleAttribute('hidden', !chosen);
    }
    this.onShow(id);
  }
}

/**
 * The page's name in the address. The panel's own id differs, or the browser would scroll to it.
 * @param {HTMLElement} tab
 */
function pageOf(tab) {
  return (tab.getAttribute('aria-controls') ?? '').replace('panel-', '');
}
