// @ts-check
/** Keys of the viewer: one table for what they do and for the help that lists them. */

/**
 * @typedef {object} Key
 * @property {string[]} keys as in KeyboardEvent.key, letters in lower case; "Shift+" before it where it matters
 * @property {string} shown
 * @property {string} does
 * @property {(app: KeyActions) => void} act
 */

/**
 * What the keys can do.
 * @typedef {object} KeyActions
 * @property {() => void} togglePause
 * @property {() => void} goLive
 * @property {() => void} goOldest
 * @property {(windows: number) => void} scroll shares of what is seen, positive to older
 * @property {(factor: number) => void} zoomRange
 * @property {(factor: number) => void} zoomTime
 * @property {() => void} wholeRange
 * @property {(dx: number, dy: number) => void} moveCursor steps
 * @property {() => void} dropContact
 * @property {() => void} measurePoint
 * @property {() => void} clear
 * @property {(name: 'picture' | 'contacts' | 'sonar') => void} togglePanel
 * @property {(layout: import('./ranging.js').Layout) => void} setLayout
 * @property {() => void} nextPalette
 * @property {() => void} invert
 * @property {(db: number) => void} changeGain
 * @property {() => void} toggleAuto
 * @property {() => void} toggleGrid
 * @property {() => void} mirror
 * @property {() => void} snapshot
 * @property {() => void} fullScreen
 * @property {() => void} theme
 * @property {() => void} help
 */

/** @type {Key[]} */
export const KEYS = [
  { keys: [' '], shown: 'Space', does: 'Pause, or back to live', act: (app) => app.togglePause() },
  { keys: ['l', 'End'], shown: 'L  End', does: 'Back to live', act: (app) => app.goLive() },
  { keys: ['Home'], shown: 'Home', does: 'Beginning of the dive', act: (app) => app.goOldest() },
  { keys: ['ArrowDown'], shown: '\u2193', does: 'Older pings', act: (app) => app.scroll(0.1) },
  { keys: ['ArrowUp'], shown: '\u2191', does: 'Newer pings', act: (app) => app.scroll(-0.1) },
  { keys: ['PageDown'], shown: 'Page \u2193', does: 'One screen older', act: (app) => app.scroll(0.9) },
  { keys: ['PageUp'], shown: 'Page \u2191', does: 'One screen newer', act: (app) => app.scroll(-0.9) },
  { keys: ['+', '='], shown: '+', does: 'Closer in range', act: (app) => app.zoomRange(0.8) },
  { keys: ['-', '_'], shown: '\u2212', does: 'Wider in range', act: (app) => app.zoomRange(1.25) },
  { keys: ['0'], shown: '0', does: 'Whole range', act: (app) => app.wholeRange() },
  { keys: ['['], shown: '[', does: 'Fewer seconds in view', act: (app) => app.zoomTime(0.8) },
  { keys: [']'], shown: ']', does: 'More seconds in view', act: (app) => app.zoomTime(1.25) },
  {
    keys: ['Shift+ArrowLeft'],
    shown: 'Shift \u2190',
    does: 'Cursor left',
    act: (app) => app.moveCursor(-1, 0),
  },
  {
    keys: ['Shift+ArrowRight'],
    shown: 'Shift \u2192',
    does: 'Cursor right',
    act: (app) => app.moveCursor(1, 0),
  },
  { keys: ['Shift+ArrowUp'], shown: 'Shift \u2191', does: 'Cursor up', act: (app) => app.moveCursor(0, -1) },
  {
    keys: ['Shift+ArrowDown'],
    shown: 'Shift \u2193',
    does: 'Cursor down',
    act: (app) => app.moveCursor(0, 1),
  },
  {
    keys: ['Enter', 'n'],
    shown: 'Enter  N',
    does: 'Name a contact at the cursor',
    act: (app) => app.dropContact(),
  },
  {
    keys: ['m'],
    shown: 'M',
    does: 'Measure from the cursor, again to end',
    act: (app) => app.measurePoint(),
  },
  { keys: ['Escape'], shown: 'Esc', does: 'Clear cursor and measurement', act: (app) => app.clear() },
  {
    keys: ['p'],
    shown: 'P',
    does: 'Picture panel: palette, gain, levels',
    act: (app) => app.togglePanel('picture'),
  },
  { keys: ['c'], shown: 'C', does: 'Contacts panel', act: (app) => app.togglePanel('contacts') },
  { keys: ['o'], shown: 'O', does: 'Sonar settings panel', act: (app) => app.togglePanel('sonar') },
  { keys: ['1'], shown: '1', does: 'Port and starboard side by side', act: (app) => app.setLayout('side') },
  { keys: ['2'], shown: '2', does: 'Stacked', act: (app) => app.setLayout('stacked') },
  { keys: ['3'], shown: '3', does: 'Port only', act: (app) => app.setLayout('B') },
  { keys: ['4'], shown: '4', does: 'Starboard only', act: (app) => app.setLayout('A') },
  { keys: ['x'], shown: 'X', does: 'Mirror left and right', act: (app) => app.mirror() },
  { keys: ['v'], shown: 'V', does: 'Next palette', act: (app) => app.nextPalette() },
  { keys: ['i'], shown: 'I', does: 'Invert the palette', act: (app) => app.invert() },
  { keys: ['.'], shown: '.', does: 'Gain up 1 dB', act: (app) => app.changeGain(1) },
  { keys: [','], shown: ',', does: 'Gain down 1 dB', act: (app) => app.changeGain(-1) },
  { keys: ['a'], shown: 'A', does: 'Auto-level or locked', act: (app) => app.toggleAuto() },
  { keys: ['g'], shown: 'G', does: 'Grid', act: (app) => app.toggleGrid() },
  { keys: ['s'], shown: 'S', does: 'Snapshot as PNG', act: (app) => app.snapshot() },
  { keys: ['f'], shown: 'F', does: 'Full screen', act: (app) => app.fullScreen() },
  { keys: ['t'], shown: 'T', does: 'Light or dark', act: (app) => app.theme() },
  { keys: ['?', 'h'], shown: '?', does: 'This list', act: (app) => app.help() },
];

/**
 * @param {{key: string, shiftKey: boolean, ctrlKey: boolean, altKey: boolean, metaKey: boolean}} event
 * @returns {Key | null}
 */
export function keyFor(event) {
  if (event.ctrlKey || event.altKey || event.metaKey) return null;
  const plain = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  const name = event.shiftKey && plain.startsWith('Arrow') ? `Shift+${plain}` : plain;
  return KEYS.find((key) => key.keys.includes(name)) ?? null;
}

/**
 * Keys belong to a control that uses them itself: text fields all of them, buttons Space and Enter, sliders arrows.
 * @param {Element | null} target
 * @param {string} key
 */
export function isTakenBy(target, key) {
  if (!target) return false;
  if (target.closest('dialog')) return true;
  if (target.matches('input[type=range], input[type=radio], input[type=checkbox], [role=slider]')) {
    return key === ' ' || key.startsWith('Arrow') || ['Home', 'End', 'PageUp', 'PageDown'].includes(key);
  }
  if (target.matches('input, textarea, select')) return true;
  return target.matches('button, a') && (key === ' ' || key === 'Enter');
}

/** @param {KeyActions} app */
export function listenToKeys(app) {
  window.addEventListener('keydown', (event) => {
    const target = event.target instanceof Element ? event.target : null;
    if (event.defaultPrevented || isTakenBy(target, event.key)) return;
    const key = keyFor(event);
    if (!key) return;
    event.preventDefault();
    key.act(app);
  });
}
