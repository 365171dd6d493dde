// @ts-check
// Light or dark: by address, by switch, by the system's preference. Colours for canvases come from the same CSS.

/** @typedef {'light' | 'dark'} Theme */
/** @typedef {'auto' | Theme} Preference */

const STORED_AS = 'bluerov-slam.theme';
/** @type {Set<(theme: Theme) => void>} */
const listeners = new Set();
/** @type {Theme | null} what the settings want */
let fallback = null;

/**
 * @param {string | null} wanted  from the address
 * @param {string | null} stored
 * @returns {Preference}
 */
export function choosePreference(wanted, stored) {
  for (const theme of [wanted, stored]) if (theme === 'light' || theme === 'dark') return theme;
  return 'auto';
}

/** @returns {Preference} */
export function preference() {
  let stored = null;
  try {
    stored = localStorage.getItem(STORED_AS);
  } catch {
    // No storage in a sandboxed iframe.
  }
  return choosePreference(new URLSearchParams(location.search).get('theme'), stored);
}

/** @returns {Theme} */
export function currentTheme() {
  return document.documentElement.dataset.theme === 'light' ? 'light' : 'dark';
}

/** @param {Theme} theme */
function apply(theme) {
  if (currentTheme() === theme && document.documentElement.dataset.theme) return;
  document.documentElement.dataset.theme = theme;
  for (const listener of listeners) listener(theme);
}

/**
 * What the settings want on all pages, where neither the address nor the switch of this browser says otherwise.
 * @param {unknown} theme  'light' or 'dark'; anything else follows the system
 */
export function setDefaultTheme(theme) {
  const system = matchMedia('(prefers-color-scheme: light)').matches ? 'light' : 'dark';
  fallback = theme === 'light' || theme === 'dark' ? theme : null;
  if (preference() === 'auto') apply(fallback ?? system);
}

/** @param {Theme} theme */
export function chooseTheme(theme) {
  try {
    localStorage.setItem(STORED_AS, theme);
  } catch {
    // It holds for this visit then.
  }
  apply(theme);
}

/**
 * Called with the new theme after each change.
 * @param {(theme: Theme) => void} listener
 */
export function onThemeChange(listener) {
  listeners.add(listener);
}

/**
 * Custom properties of the page as strings, for canvases: `colors('--accent', '--line')`.
 * @param {...string} names
 */
export function colors(...names) {
  const style = getComputedStyle(document.documentElement);
  return names.map((name) => style.getPropertyValue(name).trim());
}

/**
 * Makes a button switch between light and dark, and follows the system while nobody has chosen.
 * @param {HTMLButtonElement | null} button
 */
export function startTheme(button) {
  const light = matchMedia('(prefers-color-scheme: light)');
  light.addEventListener('change', () => {
    if (preference() === 'auto' && !fallback) apply(light.matches ? 'light' : 'dark');
  });
  if (!button) return;
  const label = () => {
    const other = currentTheme() === 'dark' ? 'light' : 'dark';
    button.setAttribute('aria-label', `Switch to the ${other} theme`);
    button.title = `Switch to the ${other} theme`;
  };
  button.addEventListener('click', () => chooseTheme(currentTheme() === 'dark' ? 'light' : 'dark'));
  onThemeChange(label);
  label();
}
