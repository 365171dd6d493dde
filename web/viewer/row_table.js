// @ts-check
/**
 * Which ping each row of the picture shows. Rows lie on a fixed grid in time, so a row keeps its pings while it
 * scrolls and nothing shimmers. Pure.
 *
 * A ping owns the time back to the one before it. Where that is longer than a period may jitter, it owns one period and
 * the rest was lost: hatched.
 */

/** @typedef {import('./ping_ring.js').PingRing} PingRing */

/** Row codes below zero. */
export const NOTHING = -1;
export const LOST = -2;

/** At most this many pings are averaged into one row of the picture. */
export const MOST_PINGS_IN_A_ROW = 16;
/** Jitter of the ping interval that is not yet a loss. */
const LATENESS_ALLOWED = 1.75;

/**
 * @param {Int16Array} table pairs (code, pings): code = layer * capacity + slot of the oldest of them
 * @param {number} rows
 * @param {PingRing} ring
 * @param {number} layer of the ring in the texture
 * @param {number} topRow index of the first row on the time grid; time at its upper edge = topRow * secondsPerRow
 * @param {number} secondsPerRow
 * @param {boolean} onlyEmpty leave rows alone that already show something
 */
export function fillRowTable(table, rows, ring, layer, topRow, secondsPerRow, onlyEmpty) {
  const base = layer * ring.capacity;
  let index = ring.lastAtOrBefore(topRow * secondsPerRow);
  for (let row = 0; row < rows; row++) {
    const bottomS = (topRow - row - 1) * secondsPerRow;
    let pings = 0;
    while (index - pings >= 0 && ring.timeS[ring.slot(index - pings)] > bottomS) pings += 1;
    index -= pings;
    if (onlyEmpty && table[2 * row] !== NOTHING) continue;
    const above = index + 1;
    if (pings > 0) {
      table[2 * row] = base + ring.slot(above);
      table[2 * row + 1] = Math.min(pings, MOST_PINGS_IN_A_ROW);
    } else {
      table[2 * row] = codeBetween(ring, above, bottomS + secondsPerRow / 2, base);
      table[2 * row + 1] = 1;
    }
  }
}

/**
 * @param {PingRing} ring
 * @param {number} above index of the first ping later than the row
 * @param {number} timeS middle of the row
 * @param {number} base
 */
function codeBetween(ring, above, timeS, base) {
  if (above >= ring.length) return NOTHING;
  const slot = ring.slot(above);
  const pingS = ring.timeS[slot];
  const period = ring.periodS[slot];
  const intervalS = above === 0 ? Infinity : pingS - ring.timeS[ring.slot(above - 1)];
  if (intervalS <= LATENESS_ALLOWED * period || pingS - timeS <= period) return base + slot;
  return above === 0 ? NOTHING : LOST;
}

/** @typedef {{pings: number, lost: number, incomplete: number}} Loss */

/**
 * How complete a stretch of time is.
 * @param {PingRing} ring
 * @param {number} fromS
 * @param {number} toS
 * @returns {Loss}
 */
export function lossBetween(ring, fromS, toS) {
  const first = ring.lastAtOrBefore(fromS) + 1;
  const last = ring.lastAtOrBefore(toS);
  let incomplete = 0;
  for (let index = first; index <= last; index++) if (ring.gaps[ring.slot(index)].length > 0) incomplete += 1;
  return { pings: last - first + 1, lost: countLost(ring, fromS, toS), incomplete };
}

/**
 * Pings that should have come between the stored ones of a stretch of time, by their intervals.
 * @param {PingRing} ring
 * @param {number} fromS
 * @param {number} toS
 */
export function countLost(ring, fromS, toS) {
  let lost = 0;
  const last = ring.lastAtOrBefore(toS);
  for (let index = Math.max(1, ring.lastAtOrBefore(fromS) + 1); index <= last; index++) {
    const slot = ring.slot(index);
    const periods = (ring.timeS[slot] - ring.timeS[ring.slot(index - 1)]) / ring.periodS[slot];
    if (periods > LATENESS_ALLOWED) lost += Math.round(periods) - 1;
  }
  return lost;
}

/**
 * A scale near the wished one at which every ping gets the same whole number of rows, or every row the same whole
 * number of pings.
 * @param {number} secondsPerRow wished
 * @param {number} periodS
 */
export function evenScale(secondsPerRow, periodS) {
  if (!(periodS > 0)) return secondsPerRow;
  return secondsPerRow <= periodS
    ? periodS / Math.round(periodS / secondsPerRow)
    : periodS * Math.round(secondsPerRow / periodS);
}
