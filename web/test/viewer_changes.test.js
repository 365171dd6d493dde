// @ts-check
import assert from 'node:assert/strict';
import { test } from 'node:test';
import { PictureChanges, eachChange } from '../viewer/picture_changes.js';

/** @param {number[]} codes */
const tableOf = (codes) => Int16Array.from(codes.flatMap((code) => [code, 1]));

/** @param {number[]} before @param {number} beforeTop @param {number[]} after @param {number} afterTop */
function changes(before, beforeTop, after, afterTop) {
  /** @type {[number, number][]} */
  const found = [];
  eachChange(tableOf(before), beforeTop, tableOf(after), afterTop, after.length, (from, to) =>
    found.push([from, to]),
  );
  return found;
}

test('a picture that moved on is painted only where it is new', () => {
  assert.deepEqual(changes([3, 3, 2, 2, 1, 1], 20, [4, 4, 3, 3, 2, 2], 22), [[0, 2]]);
});

test('a picture that moved back is painted at its lower edge', () => {
  assert.deepEqual(changes([4, 4, 3, 3, 2, 2], 22, [3, 3, 2, 2, 1, 1], 20), [[4, 6]]);
});

test('an unchanged picture is not painted', () => {
  assert.deepEqual(changes([1, 2, 3], 5, [1, 2, 3], 5), []);
});

test('a ping that came late is painted in its place', () => {
  assert.deepEqual(changes([5, -2, -2, 3, 2], 9, [5, 4, 4, 3, 2], 9), [[1, 3]]);
});

test('a jump in time paints everything', () => {
  assert.deepEqual(changes([1, 2, 3], 5, [1, 2, 3], 500), [[0, 3]]);
});

test('another gain, palette or ring content paints everything, the same state does not', () => {
  const panes = [{ channel: /** @type {const} */ ('A'), x: 0, y: 0, width: 4, height: 3, mirrored: false }];
  /** @type {any} */
  const gain = { gainDb: 0, gamma: 1, black: 0, white: 1 };
  const colors = { nothingRgb: new Float32Array(3), hatchRgb: new Float32Array(3) };
  const state = { gain, fromM: 0, toM: 30, tvgMaximumM: 30, dpr: 1, ...colors };
  /** @type {any} */
  const rings = [{ generation: 0 }];
  const picture = new PictureChanges();
  const table = tableOf([1, 2, 3]);
  const painted = () => {
    let rows = 0;
    picture.begin(panes, state, rings);
    picture.each(0, table, 7, 3, (from, to) => (rows += to - from));
    picture.end([table, table], 7);
    return rows;
  };
  assert.equal(painted(), 3);
  assert.equal(painted(), 0);
  gain.gainDb = 3;
  assert.equal(painted(), 3);
  rings[0].generation += 1;
  assert.equal(painted(), 3);
  panes[0].mirrored = true;
  assert.equal(painted(), 3);
  picture.everything();
  assert.equal(painted(), 3);
  assert.equal(painted(), 0);
});
