// @ts-check
/** How the picture looks: layout, palette, gain, grid, mirroring; every change is remembered in this browser. */

import { DEFAULT_GAIN } from './levels.js';
import { PALETTES } from './palettes.js';
import { savePreferences } from './preferences.js';

/** @typedef {import('./ranging.js').Layout} Layout */
/** @typedef {import('./gain.js').GainSettings} GainSettings */

/** @type {Layout[]} */
const LAYOUTS = ['side', 'stacked', 'B', 'A'];
const MOST_GAIN_DB = 24;

export class Looks {
  /**
   * @param {import('./waterfall.js').Waterfall} waterfall
   * @param {import('./overlay.js').Overlay} overlay
   * @param {import('./preferences.js').Preferences} preferences
   */
  constructor(waterfall, overlay, preferences) {
    this.waterfall = waterfall;
    this.overlay = overlay;
    this.preferences = preferences;
    /** The vehicle's own setting; it and the switch of this page together decide. */
    this.serviceMirror = false;
    /** @type {() => void} */
    this.onChange = () => {};
    waterfall.levels.automatic = preferences.automatic;
    overlay.grid = preferences.grid;
    this.applyMirror();
  }

  /** @param {Layout} layout */
  setLayout(layout) {
    this.waterfall.view.layout = layout;
    this.preferences.layout = layout;
    this.waterfall.layOut();
    this.changed();
  }

  nextLayout() {
    this.setLayout(LAYOUTS[(LAYOUTS.indexOf(this.waterfall.view.layout) + 1) % LAYOUTS.length]);
  }

  /** @param {string} palette @param {boolean} inverted */
  setPalette(palette, inverted) {
    this.waterfall.setPalette(palette, inverted);
    Object.assign(this.preferences, { palette, inverted });
    this.changed();
  }

  /** @returns {string} its label */
  nextPalette() {
    const index = PALETTES.findIndex((palette) => palette.id === this.waterfall.palette);
    const next = PALETTES[(index + 1) % PALETTES.length];
    this.setPalette(next.id, this.waterfall.inverted);
    return next.label;
  }

  invert() {
    this.setPalette(this.waterfall.palette, !this.waterfall.inverted);
  }

  /** @param {Partial<GainSettings>} change */
  setGain(change) {
    const { levels } = this.waterfall;
    Object.assign(levels.gain, change);
    if ('black' in change || 'white' in change) this.setAutomatic(false);
    this.preferences.gain = { ...levels.gain };
    this.waterfall.gainChanged('tvg' in change || 'spreadingDb' in change || 'absorptionDbPerM' in change);
    this.changed();
  }

  /** @param {number} db @returns {number} the gain now */
  changeGain(db) {
    const gainDb = Math.min(MOST_GAIN_DB, Math.max(-MOST_GAIN_DB, this.waterfall.levels.gain.gainDb + db));
    this.setGain({ gainDb });
    return gainDb;
  }

  /** @param {boolean} automatic */
  setAutomatic(automatic) {
    this.waterfall.levels.automatic = automatic;
    this.preferences.automatic = automatic;
    // Locked levels are what a reload must find again.
    this.preferences.gain = { ...this.waterfall.levels.gain };
    if (automatic) this.waterfall.gainChanged(true);
    this.changed();
  }

  resetGain() {
    Object.assign(this.waterfall.levels.gain, DEFAULT_GAIN);
    this.setAutomatic(true);
  }

  toggleGrid() {
    this.overlay.grid = !this.overlay.grid;
    this.preferences.grid = this.overlay.grid;
    this.changed();
  }

  mirror() {
    this.preferences.mirrored = !this.preferences.mirrored;
    this.applyMirror();
    this.changed();
  }

  /** @param {boolean} mirror */
  setServiceMirror(mirror) {
    if (mirror === this.serviceMirror) return;
    this.serviceMirror = mirror;
    this.applyMirror();
  }

  applyMirror() {
    this.waterfall.view.swapped = this.preferences.mirrored !== this.serviceMirror;
    this.waterfall.layOut();
  }

  changed() {
    this.save();
    this.onChange();
    this.waterfall.invalidate();
  }

  save() {
    savePreferences(this.preferences);
  }
}
