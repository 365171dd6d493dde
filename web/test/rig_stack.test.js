import assert from 'node:assert/strict';
import { test } from 'node:test';
import { principalAxes } from '../rig/stack_view.js';

/** @param {number[][]} vectors @param {number[]} values */
const composed = (vectors, values) =>
  [0, 1, 2].map((i) =>
    [0, 1, 2].map((j) => [0, 1, 2].reduce((sum, k) => sum + vectors[i][k] * values[k] * vectors[j][k], 0)),
  );

test('axes of a covariance make it again, at right angles', () => {
  const matrix = [
    [90, 25, -7],
    [25, 60, 4],
    [-7, 4, 12],
  ];
  const { values, vectors } = principalAxes(matrix);
  composed(vectors, values).forEach((row, i) =>
    row.forEach((value, j) => assert.ok(Math.abs(value - matrix[i][j]) < 1e-9)),
  );
  composed(vectors, [1, 1, 1]).forEach((row, i) =>
    row.forEach((value, j) => assert.ok(Math.abs(value - Number(i === j)) < 1e-12)),
  );
});

test('a round covariance stays round', () => {
  const { values } = principalAxes([
    [4, 0, 0],
    [0, 4, 0],
    [0, 0, 4],
  ]);
  assert.deepEqual(values, [4, 4, 4]);
});
