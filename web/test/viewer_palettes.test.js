// @ts-check
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { PALETTES, cssGradient, lightness, paletteTable } from '../viewer/palettes.js';

test('tables are 256 opaque colours that begin and end with their anchors', () => {
  for (const { id, anchors } of PALETTES) {
    const table = paletteTable(id, false);
    assert.equal(table.length, 1024);
    for (let k = 0; k < 256; k++) assert.equal(table[4 * k + 3], 255);
    const hex = (/** @type {number} */ k) =>
      `#${[0, 1, 2].map((c) => table[4 * k + c].toString(16).padStart(2, '0')).join('')}`;
    assert.equal(hex(0), anchors[0]);
    assert.equal(hex(255), anchors.at(-1));
  }
});

test('a stronger echo is never darker', () => {
  for (const { id } of PALETTES) {
    const table = paletteTable(id, false);
    for (let k = 1; k < 256; k++) {
      assert.ok(lightness(table, k) >= lightness(table, k - 1) - 0.004, `${id} at ${k}`);
    }
  }
});

test('palettes called uniform rise in even steps of lightness', () => {
  for (const { id, uniform } of PALETTES) {
    if (!uniform) continue;
    const table = paletteTable(id, false);
    const whole = lightness(table, 255) - lightness(table, 0);
    for (let k = 16; k < 256; k += 16) {
      const share = (lightness(table, k) - lightness(table, k - 16)) / whole;
      assert.ok(share > 0.25 / 16 && share < 2.2 / 16, `${id}: ${share * 16} of an even step at ${k}`);
    }
  }
});

test('inverted is the same table backwards', () => {
  const table = paletteTable('viridis', false);
  const inverted = paletteTable('viridis', true);
  for (let k = 0; k < 256; k++) {
    for (let c = 0; c < 3; c++) assert.ok(Math.abs(table[4 * k + c] - inverted[4 * (255 - k) + c]) <= 1);
  }
});

test('an unknown palette falls back instead of failing', () => {
  assert.deepEqual(paletteTable('no such', false), paletteTable(PALETTES[0].id, false));
});

test('the preview gradient starts with the weakest colour', () => {
  assert.match(cssGradient(paletteTable('grey', false)), /^linear-gradient\(to right, rgb\(0 0 0\)/);
});
