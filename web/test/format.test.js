// @ts-check
import assert from 'node:assert/strict';
import { test } from 'node:test';
import {
  age,
  bytes,
  clockTime,
  compassPoint,
  count,
  dateTime,
  duration,
  fixed,
  geodetic,
  heading,
  signed,
} from '../shared/format.js';

test('what is not known is a dash, never a zero', () => {
  for (const format of [
    fixed,
    signed,
    count,
    bytes,
    age,
    duration,
    heading,
    compassPoint,
    dateTime,
    clockTime,
  ]) {
    for (const unknown of [null, undefined, NaN, Infinity, -Infinity, '12', {}, true]) {
      assert.equal(format(unknown), '-', `${format.name}(${String(unknown)})`);
    }
  }
  assert.equal(geodetic(null, 'latitude'), '-');
});

test('zero is a value', () => {
  assert.equal(fixed(0, 2), '0.00');
  assert.equal(count(0), '0');
  assert.equal(bytes(0), '0 B');
});

test('a negative number that rounds to zero has no minus', () => {
  assert.equal(fixed(-0.004, 2), '0.00');
  assert.equal(signed(-0.04, 1), '+0.0');
});

test('minus is as wide as a digit', () => {
  assert.equal(fixed(-12.345, 1), '\u221212.3');
});

test('a huge value keeps its place', () => {
  for (const huge of [1e12, -1e12, 1e21, 1e300, Number.MAX_VALUE])
    assert.ok(fixed(huge, 2).length <= 9, fixed(huge, 2));
  for (const huge of [1e15, 2 ** 53, 1e300]) assert.ok(count(huge).length <= 16, count(huge));
  assert.equal(dateTime(1e300), '-');
});

test('thousands are set apart', () => {
  assert.equal(count(1234567), '1\u202f234\u202f567');
  assert.equal(count(-1234), '\u22121\u202f234');
});

test('bytes carry three digits and step by a thousand', () => {
  assert.equal(bytes(999), '999 B');
  assert.equal(bytes(1000), '1.00 kB');
  assert.equal(bytes(999_999), '1.00 MB');
  assert.equal(bytes(12_345_678), '12.3 MB');
});

test('ages grow coarser', () => {
  assert.equal(age(0.44), '0.4 s');
  assert.equal(age(9.96), '10 s');
  assert.equal(age(100), '2 min');
  assert.equal(age(7200), '2 h');
  assert.equal(age(400_000), '5 d');
  assert.equal(age(-3), '0.0 s');
});

test('headings wrap and never show 360', () => {
  assert.equal(heading(-90), '270');
  assert.equal(heading(359.6), '000');
  assert.equal(heading(725), '005');
  assert.equal(compassPoint(-45), 'NW');
  assert.equal(compassPoint(350), 'N');
});

test('positions carry their hemisphere', () => {
  assert.equal(geodetic(-2.7456, 'longitude'), '2.745600\u00b0 W');
  assert.equal(geodetic(47.6123, 'latitude'), '47.612300\u00b0 N');
});

test('durations read like a clock', () => {
  assert.equal(duration(61), '1:01');
  assert.equal(duration(3723.9), '1:02:03');
});
