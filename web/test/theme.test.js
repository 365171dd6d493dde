// @ts-check
import assert from 'node:assert/strict';
import { readFileSync } from 'node:fs';
import { test } from 'node:test';

const CSS = readFileSync(new URL('../shared/theme.css', import.meta.url), 'utf8');

/**
 * The custom properties of the n-th block.
 * @param {number} n  0 dark, 1 light
 */
function properties(n) {
  const blocks = [...CSS.matchAll(/:root[^{]*\{([^}]*)\}/g)].map((match) => match[1]);
  return new Map(
    [...blocks[n].matchAll(/(--[\w-]+):\s*([^;]+);/g)].map((match) => [match[1], match[2].trim()]),
  );
}

/** @param {string} hex */
function luminance(hex) {
  const channels = [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16) / 255);
  const [r, g, b] = channels.map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4));
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}

/**
 * @param {string} a
 * @param {string} b
 */
function contrast(a, b) {
  const [low, high] = [luminance(a), luminance(b)].sort((x, y) => x - y);
  return (high + 0.05) / (low + 0.05);
}

const GROUNDS = ['--bg', '--surface', '--raised', '--sunken'];
const TEXTS = ['--text', '--dim', '--stale', '--accent', '--ok', '--warn', '--fault', '--off'];
const LINES = [
  '--line-strong',
  '--focus',
  '--plot-depth',
  '--plot-temperature',
  '--plot-salinity',
  '--plot-sound',
];

for (const [n, theme] of ['dark', 'light'].entries()) {
  const colors = properties(n);
  const of = (/** @type {string} */ name) => colors.get(name) ?? assert.fail(`${theme} has no ${name}`);

  test(`${theme}: all text has the contrast of WCAG AA on all grounds`, () => {
    for (const ground of GROUNDS) {
      for (const text of TEXTS) {
        const ratio = contrast(of(text), of(ground));
        assert.ok(ratio >= 4.5, `${text} on ${ground}: ${ratio.toFixed(2)}`);
      }
    }
    assert.ok(contrast(of('--accent-text'), of('--accent')) >= 4.5);
  });

  test(`${theme}: lines that carry meaning are seen`, () => {
    for (const ground of GROUNDS) {
      for (const line of LINES) {
        const ratio = contrast(of(line), of(ground));
        assert.ok(ratio >= 3, `${line} on ${ground}: ${ratio.toFixed(2)}`);
      }
    }
  });
}

test('both themes define the same colours', () => {
  const isColor = (/** @type {[string, string]} */ [, value]) => value.startsWith('#');
  const names = [...properties(1)].filter(isColor).map(([name]) => name);
  for (const name of names) assert.ok(properties(0).has(name), name);
  for (const name of [...GROUNDS, ...TEXTS, ...LINES]) assert.ok(names.includes(name), name);
});
