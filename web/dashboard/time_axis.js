// @ts-check
// Where the marks of a time axis stand: on whole seconds, minutes or quarters of the wall clock.

const STEPS_S = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600];
const MOST_MARKS = 12;

/**
 * @param {number} fromS  steady clock
 * @param {number} toS
 * @param {number} unixOfZeroS  the wall clock at steady time 0
 * @param {number} [most]  marks that have room
 * @returns {number[]} steady times
 */
export function timeSplits(fromS, toS, unixOfZeroS, most = 7) {
  const step =
    STEPS_S.find((s) => (toS - fromS) / s <= Math.max(1, Math.min(most, MOST_MARKS))) ??
    STEPS_S[STEPS_S.length - 1];
  const first = Math.ceil((fromS + unixOfZeroS) / step) * step - unixOfZeroS;
  const splits = [];
  for (let i = 0; first + i * step <= toS && i <= 2 * MOST_MARKS; i += 1) splits.push(first + i * step);
  return splits;
}
