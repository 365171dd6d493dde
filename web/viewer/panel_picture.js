// @ts-check
/** Picture panel: layout, palette, levels with their histogram, time-varied gain. */

import { make, setText } from '../shared/dom.js';
import { fixed, signed } from '../shared/format.js';
import { HISTOGRAM_BINS, displayLevel } from './gain.js';
import { PALETTES, cssGradient, paletteTable } from './palettes.js';

/** @typedef {import('./waterfall.js').Waterfall} Waterfall */
/** @typedef {import('./gain.js').GainSettings} GainSettings */

/** Key, label, least, most, step, text of a value. @type {[keyof GainSettings, string, number, number, number, (v: number) => string][]} */
const SLIDERS = [
  ['gainDb', 'Gain', -24, 24, 0.5, (v) => `${signed(v, 1)} dB`],
  ['gamma', 'Contrast', 0.3, 2.5, 0.05, (v) => fixed(v, 2)],
  ['black', 'Black level', 0, 0.95, 0.005, (v) => `${fixed(100 * v, 1)} %`],
  ['white', 'White level', 0.05, 1, 0.005, (v) => `${fixed(100 * v, 1)} %`],
];
/** @type {typeof SLIDERS} */
const CURVE_SLIDERS = [
  ['spreadingDb', 'Spreading', 0, 60, 1, (v) => `${fixed(v)} dB/dec`],
  ['absorptionDbPerM', 'Absorption', 0, 0.5, 0.01, (v) => `${fixed(v, 2)} dB/m`],
];
const SMALLEST_SPAN = 0.02;

export class PicturePanel {
  /**
   * @param {HTMLElement} root
   * @param {Waterfall} waterfall
   * @param {import('./looks.js').Looks} actions
   * @param {{grid: boolean, mirrored: boolean}} stored
   */
  constructor(root, waterfall, actions, stored) {
    this.root = root;
    this.waterfall = waterfall;
    this.actions = actions;
    /** @type {Map<string, {input: HTMLInputElement, output: HTMLOutputElement, text: (v: number) => string}>} */
    this.sliders = new Map();
    this.canvas = make('canvas', {
      class: 'histogram',
      role: 'img',
      'aria-label': 'Histogram of the echoes in view',
    });
    this.layouts = segments(
      'layout',
      [
        ['side', 'Side by side'],
        ['stacked', 'Stacked'],
        ['B', 'Port'],
        ['A', 'Stbd'],
      ],
      (value) => actions.setLayout(/** @type {any} */ (value)),
    );
    this.auto = segments(
      'auto',
      [
        ['auto', 'Auto-level'],
        ['locked', 'Locked'],
      ],
      (value) => actions.setAutomatic(value === 'auto'),
    );
    this.tvg = segments(
      'tvg',
      [
        ['off', 'Off'],
        ['curve', 'By formula'],
        ['flatten', 'Measured'],
      ],
      (value) => actions.setGain({ tvg: /** @type {any} */ (value) }),
    );
    this.curve = make('div', {}, ...CURVE_SLIDERS.map((spec) => this.slider(spec)));
    this.inverted = checkbox('Inverted', waterfall.inverted, (on) =>
      actions.setPalette(waterfall.palette, on),
    );
    this.grid = checkbox('Range and time grid', stored.grid, () => actions.toggleGrid());
    this.mirrored = checkbox('Mirror left and right', stored.mirrored, () => actions.mirror());
    root.append(
      make('h3', { text: 'View' }),
      this.layouts,
      make('h3', { text: 'Levels' }),
      this.canvas,
      this.auto,
      ...SLIDERS.map((spec) => this.slider(spec)),
      make('h3', { text: 'Time-varied gain' }),
      this.tvg,
      make('p', {
        class: 'hint',
        text: 'Measured: evens out the mean echo of the pings in view at each range.',
      }),
      this.curve,
      make('h3', { text: 'Palette' }),
      this.palettes(),
      this.inverted.label,
      make('h3', { text: 'More' }),
      this.grid.label,
      this.mirrored.label,
      make(
        'div',
        { class: 'buttons' },
        make('button', {
          class: 'button',
          type: 'button',
          text: 'Default levels',
          on: { click: () => actions.resetGain() },
        }),
      ),
    );
  }

  /** @param {typeof SLIDERS[number]} spec */
  slider([key, label, least, most, step, text]) {
    const id = `gain-${key}`;
    const input = make('input', { type: 'range', id, min: least, max: most, step });
    const output = make('output', { for: id });
    input.addEventListener('input', () => this.slid(key, Number(input.value)));
    this.sliders.set(key, { input, output, text });
    return make('div', { class: 'control' }, make('label', { for: id, text: label }), input, output);
  }

  /** @param {keyof GainSettings} key @param {number} value */
  slid(key, value) {
    const { gain } = this.waterfall.levels;
    /** @type {Partial<GainSettings>} */
    const change = { [key]: value };
    // The two levels push each other instead of crossing.
    if (key === 'black') change.white = Math.max(gain.white, value + SMALLEST_SPAN);
    if (key === 'white') change.black = Math.min(gain.black, value - SMALLEST_SPAN);
    this.actions.setGain(change);
  }

  palettes() {
    this.ramps = PALETTES.map((palette) => ({ id: palette.id, ramp: make('span', { class: 'ramp' }) }));
    const items = PALETTES.map((palette, k) => {
      const input = make('input', { type: 'radio', name: 'palette', value: palette.id });
      input.checked = palette.id === this.waterfall.palette;
      input.addEventListener('change', () => this.actions.setPalette(palette.id, this.waterfall.inverted));
      return make('label', { class: 'palette' }, input, palette.label, this.ramps?.[k].ramp ?? null);
    });
    return make('div', { class: 'palettes', role: 'radiogroup', 'aria-label': 'Palette' }, ...items);
  }

  /** Everything but the histogram, after a change from anywhere. */
  refresh() {
    const { waterfall } = this;
    const { gain, automatic } = waterfall.levels;
    for (const [key, { input, output, text }] of this.sliders) {
      const value = /** @type {number} */ (gain[/** @type {keyof GainSettings} */ (key)]);
      if (document.activeElement !== input || Number(input.value) !== value) input.value = String(value);
      setText(output, text(value));
    }
    choose(this.auto, automatic ? 'auto' : 'locked');
    choose(this.tvg, gain.tvg);
    choose(this.layouts, waterfall.view.layout);
    choose(this.root, waterfall.palette, 'palette');
    this.inverted.input.checked = waterfall.inverted;
    this.mirrored.input.checked = this.actions.preferences.mirrored;
    this.grid.input.checked = this.actions.overlay.grid;
    this.curve.hidden = gain.tvg !== 'curve';
    for (const { id, ramp } of this.ramps ?? [])
      ramp.style.background = cssGradient(paletteTable(id, waterfall.inverted));
  }

  /** Bars in the colour that the picture gives them, and the curve that leads there. */
  drawHistogram() {
    if (!this.canvas.offsetParent) return;
    const dpr = window.devicePixelRatio || 1;
    const width = Math.round(this.canvas.clientWidth * dpr);
    const height = Math.round(this.canvas.clientHeight * dpr);
    if (this.canvas.width !== width || this.canvas.height !== height) {
      this.canvas.width = width;
      this.canvas.height = height;
    }
    const context = /** @type {CanvasRenderingContext2D} */ (this.canvas.getContext('2d'));
    const { histogram, gain } = this.waterfall.levels;
    const { table } = this.waterfall;
    const strip = Math.round(10 * dpr);
    context.clearRect(0, 0, width, height);
    let most = 0;
    for (let k = 1; k < HISTOGRAM_BINS - 1; k++) most = Math.max(most, histogram[k]);
    for (let k = 0; k < HISTOGRAM_BINS; k++) {
      const x = Math.floor((k * width) / HISTOGRAM_BINS);
      const barWidth = Math.floor(((k + 1) * width) / HISTOGRAM_BINS) - x;
      const at = 4 * Math.round(255 * displayLevel(((k + 0.5) / HISTOGRAM_BINS) * 255, 1, gain));
      context.fillStyle = `rgb(${table[at]} ${table[at + 1]} ${table[at + 2]})`;
      context.fillRect(x, height - strip, barWidth, strip);
      const bar = most > 0 ? Math.min(1, Math.sqrt(histogram[k] / most)) * (height - strip - 4 * dpr) : 0;
      context.fillStyle = getComputedStyle(this.canvas).color;
      context.globalAlpha = 0.55;
      context.fillRect(x, height - strip - bar, barWidth, bar);
      context.globalAlpha = 1;
    }
    this.drawCurve(context, width, height - strip, dpr);
  }

  /** @param {CanvasRenderingContext2D} context @param {number} width @param {number} height @param {number} dpr */
  drawCurve(context, width, height, dpr) {
    const { gain } = this.waterfall.levels;
    context.beginPath();
    for (let k = 0; k <= 96; k++) {
      const level = displayLevel((k / 96) * 255, 1, gain);
      context.lineTo((k / 96) * width, height - level * (height - 3 * dpr) - dpr);
    }
    context.strokeStyle = getComputedStyle(document.documentElement).getPropertyValue('--accent');
    context.lineWidth = 2 * dpr;
    context.stroke();
  }
}

/**
 * @param {string} name
 * @param {[string, string][]} choices
 * @param {(value: string) => void} onChange
 */
export function segments(name, choices, onChange) {
  const labels = choices.map(([value, label]) => {
    const input = make('input', { type: 'radio', name, value });
    input.addEventListener('change', () => onChange(value));
    return make('label', {}, input, label);
  });
  return make('div', { class: 'segments', role: 'radiogroup', 'aria-label': name }, ...labels);
}

/** @param {HTMLElement} root @param {string} value @param {string} [name] */
export function choose(root, value, name) {
  const selector = name ? `input[name="${name}"]` : 'input[type=radio]';
  for (const input of root.querySelectorAll(selector)) {
    if (input instanceof HTMLInputElement) input.checked = input.value === value;
  }
}

/** @param {string} text @param {boolean} on @param {(on: boolean) => void} onChange */
function checkbox(text, on, onChange) {
  const input = make('input', { type: 'checkbox' });
  input.checked = on;
  input.addEventListener('change', () => onChange(input.checked));
  return { input, label: make('label', { class: 'check' }, input, text) };
}
