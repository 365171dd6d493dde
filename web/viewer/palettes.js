// @ts-check
/**
 * 256-entry colour tables from a few anchors, interpolated in OKLab so that steps look equal
 * (Ottosson 2020, https://bottosson.github.io/posts/oklab/). Pure.
 */

/**
 * @typedef {object} Palette
 * @property {string} id
 * @property {string} label
 * @property {string[]} anchors sRGB, weakest echo first
 * @property {boolean} [uniform] lightness rises evenly, so equal steps of amplitude look equal
 */

/** @type {Palette[]} */
export const PALETTES = [
  {
    id: 'copper',
    label: 'Copper',
    anchors: ['#050302', '#2f1a0c', '#6d3f1c', '#b0692f', '#e39a4f', '#fbd39a', '#fff6e4'],
  },
  { id: 'grey', label: 'Grey', anchors: ['#000000', '#ffffff'], uniform: true },
  {
    id: 'viridis',
    label: 'Viridis',
    uniform: true,
    anchors: [
      '#440154',
      '#482878',
      '#3e4989',
      '#31688e',
      '#26828e',
      '#1f9e89',
      '#35b779',
      '#6ece58',
      '#b5de2b',
      '#fde725',
    ],
  },
  {
    id: 'inferno',
    label: 'Inferno',
    uniform: true,
    anchors: [
      '#000004',
      '#1b0c41',
      '#4a0c6b',
      '#781c6d',
      '#a52c60',
      '#cf4446',
      '#ed6925',
      '#fb9b06',
      '#f7d13d',
      '#fcffa4',
    ],
  },
  {
    id: 'cividis',
    label: 'Cividis',
    uniform: true,
    anchors: [
      '#00224e',
      '#1f3a6d',
      '#434e6c',
      '#61646f',
      '#7c7b78',
      '#9b9476',
      '#bcae6c',
      '#dfcb58',
      '#fee838',
    ],
  },
  {
    id: 'deep',
    label: 'Deep blue',
    anchors: ['#01040f', '#08213f', '#0f4a6b', '#2b7f93', '#7fb8b0', '#e6f3dc'],
    uniform: true,
  },
];

export const DEFAULT_PALETTE = 'copper';

/**
 * @param {string} id
 * @param {boolean} inverted
 * @returns {Uint8Array} 256 x RGBA; an unknown id gives the default palette
 */
export function paletteTable(id, inverted) {
  const palette = PALETTES.find((candidate) => candidate.id === id) ?? PALETTES[0];
  const anchors = palette.anchors.map((hex) => oklabFromSrgb(parseHex(hex)));
  if (inverted) anchors.reverse();
  const table = new Uint8Array(1024);
  for (let k = 0; k < 256; k++) {
    const position = (k / 255) * (anchors.length - 1);
    const lower = Math.min(Math.floor(position), anchors.length - 2);
    const lab = mix(anchors[lower], anchors[lower + 1], position - lower);
    const rgb = srgbFromOklab(lab);
    table.set([...rgb.map((value) => Math.round(255 * Math.min(1, Math.max(0, value)))), 255], 4 * k);
  }
  return table;
}

/**
 * @param {Uint8Array} table
 * @returns {string} for a CSS background, weakest echo on the left
 */
export function cssGradient(table) {
  const stops = [];
  for (let k = 0; k <= 16; k++) {
    const at = 4 * Math.round((k * 255) / 16);
    stops.push(`rgb(${table[at]} ${table[at + 1]} ${table[at + 2]})`);
  }
  return `linear-gradient(to right, ${stops.join(', ')})`;
}

/**
 * OKLab lightness of one table entry, 0..1: what a test of evenness measures.
 * @param {Uint8Array} table
 * @param {number} index
 */
export function lightness(table, index) {
  return oklabFromSrgb([table[4 * index] / 255, table[4 * index + 1] / 255, table[4 * index + 2] / 255])[0];
}

/** @typedef {[number, number, number]} Triple */

/** @param {string} hex @returns {Triple} */
function parseHex(hex) {
  const value = parseInt(hex.slice(1), 16);
  return [(value >> 16) / 255, ((value >> 8) & 255) / 255, (value & 255) / 255];
}

/** @param {Triple} from @param {Triple} to @param {number} share @returns {Triple} */
function mix(from, to, share) {
  return [
    from[0] + (to[0] - from[0]) * share,
    from[1] + (to[1] - from[1]) * share,
    from[2] + (to[2] - from[2]) * share,
  ];
}

/** @param {number} value */
const linear = (value) => (value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4);
/** @param {number} value */
const companded = (value) => (value <= 0.0031308 ? 12.92 * value : 1.055 * value ** (1 / 2.4) - 0.055);

/** @param {Triple} rgb @returns {Triple} */
function oklabFromSrgb([red, green, blue]) {
  const r = linear(red);
  const g = linear(green);
  const b = linear(blue);
  const l = Math.cbrt(0.4122214708 * r + 0.5363325363 * g + 0.0514459929 * b);
  const m = Math.cbrt(0.2119034982 * r + 0.6806995451 * g + 0.1073969566 * b);
  const s = Math.cbrt(0.0883024619 * r + 0.2817188376 * g + 0.6299787005 * b);
  return [
    0.2104542553 * l + 0.793617785 * m - 0.0040720468 * s,
    1.9779984951 * l - 2.428592205 * m + 0.4505937099 * s,
    0.0259040371 * l + 0.7827717662 * m - 0.808675766 * s,
  ];
}

/** @param {Triple} lab @returns {Triple} */
function srgbFromOklab([L, a, b]) {
  const l = (L + 0.3963377774 * a + 0.2158037573 * b) ** 3;
  const m = (L - 0.1055613458 * a - 0.0638541728 * b) ** 3;
  const s = (L - 0.0894841775 * a - 1.291485548 * b) ** 3;
  return [
    companded(4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s),
    companded(-1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s),
    companded(-0.0041960863 * l - 0.7034186147 * m + 1.707614701 * s),
  ];
}
