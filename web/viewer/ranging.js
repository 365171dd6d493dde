// @ts-check
/** Axes, panes and the sonar's arithmetic. Pure. */

/** @typedef {import('./decoding.js').Channel} Channel */
/** @typedef {'side' | 'stacked' | 'A' | 'B'} Layout */

/**
 * One picture of one channel, in device pixels from the upper left. Range grows to the right, or to the left when
 * mirrored.
 * @typedef {{channel: Channel, x: number, y: number, width: number, height: number, mirrored: boolean}} Pane
 */

/**
 * @param {Layout} layout
 * @param {number} width
 * @param {number} height
 * @param {boolean} swapped the other way round: port on the right
 * @returns {Pane[]}
 */
export function panesOf(layout, width, height, swapped) {
  if (layout === 'A' || layout === 'B') {
    const mirrored = (layout === 'B') !== swapped;
    return [{ channel: layout, x: 0, y: 0, width, height, mirrored }];
  }
  if (layout === 'stacked') {
    const upper = Math.floor(height / 2);
    return [
      { channel: 'A', x: 0, y: 0, width, height: upper, mirrored: false },
      { channel: 'B', x: 0, y: upper, width, height: height - upper, mirrored: false },
    ];
  }
  const half = Math.floor(width / 2);
  return [
    { channel: swapped ? 'A' : 'B', x: 0, y: 0, width: half, height, mirrored: true },
    { channel: swapped ? 'B' : 'A', x: half, y: 0, width: width - half, height, mirrored: false },
  ];
}

/**
 * @param {Pane[]} panes
 * @param {number} x
 * @param {number} y
 * @returns {Pane | null}
 */
export function paneAt(panes, x, y) {
  for (const pane of panes) {
    if (x >= pane.x && x < pane.x + pane.width && y >= pane.y && y < pane.y + pane.height) return pane;
  }
  return null;
}

/**
 * @param {Pane} pane
 * @param {number} x
 * @param {number} fromM range at the nadir edge
 * @param {number} toM range at the far edge
 */
export function rangeAtX(pane, x, fromM, toM) {
  const across = (x - pane.x) / pane.width;
  return fromM + (toM - fromM) * (pane.mirrored ? 1 - across : across);
}

/**
 * @param {Pane} pane
 * @param {number} rangeM
 * @param {number} fromM
 * @param {number} toM
 */
export function xAtRange(pane, rangeM, fromM, toM) {
  const across = (rangeM - fromM) / (toM - fromM);
  return pane.x + pane.width * (pane.mirrored ? 1 - across : across);
}

/**
 * The smallest of 1, 2, 5 x 10^k that leaves at most `most` steps in `span`.
 * @param {number} span
 * @param {number} most
 */
export function niceStep(span, most) {
  if (!(span > 0) || !(most >= 1)) return 1;
  const rough = span / most;
  const power = 10 ** Math.floor(Math.log10(rough));
  for (const factor of [1, 2, 5, 10]) if (factor * power >= rough * (1 - 1e-9)) return factor * power;
  return 10 * power;
}

const TIME_STEPS_S = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600];

/**
 * @param {number} spanS
 * @param {number} most
 */
export function niceTimeStep(spanS, most) {
  const rough = spanS / Math.max(1, most);
  for (const step of TIME_STEPS_S) if (step >= rough) return step;
  return 3600 * Math.ceil(rough / 3600);
}

/** @param {number} step @returns {number} decimals that tell neighbouring ticks apart */
export function decimalsFor(step) {
  return Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
}

/**
 * Time for the sound to the end of the range and back, s.
 * @param {number} rangeM
 * @param {number} soundSpeedMps
 */
export function twoWayTimeS(rangeM, soundSpeedMps) {
  return (2 * rangeM) / soundSpeedMps;
}

/**
 * The page's own sum, shown beside the fields while they are edited; the service decides.
 * @param {number} rangeM
 * @param {number} soundSpeedMps
 * @param {number} periodMs
 * @returns {{fits: boolean, leastMs: number, text: string} | null} null when something is unknown
 */
export function periodArithmetic(rangeM, soundSpeedMps, periodMs) {
  if (!(rangeM > 0) || !(soundSpeedMps > 0) || !(periodMs > 0)) return null;
  const needMs = 1000 * twoWayTimeS(rangeM, soundSpeedMps);
  const fits = periodMs >= needMs;
  const sum = `2 \u00d7 ${trim(rangeM)} m / ${trim(soundSpeedMps)} m/s = ${needMs.toFixed(1)} ms`;
  return {
    fits,
    leastMs: Math.ceil(needMs),
    text: `${sum} ${fits ? '\u2264' : '>'} period ${trim(periodMs)} ms`,
  };
}

/** @param {number} value */
const trim = (value) => String(Number(value.toFixed(2)));

const EARTH_RADIUS_M = 6371008.8;
const RAD = Math.PI / 180;

/**
 * The way over ground to an echo on a flat bottom, null where the height is unknown. Nearer than the height there is
 * no bottom, only water.
 * @param {number} slantM
 * @param {number | null | undefined} altitudeM
 */
export function groundRangeM(slantM, altitudeM) {
  if (typeof altitudeM !== 'number' || !(altitudeM >= 0)) return null;
  return slantM > altitudeM ? Math.sqrt(slantM * slantM - altitudeM * altitudeM) : null;
}

/**
 * Radius of 95 % about an echo: of the vehicle's own position, and of the heading over the way to it.
 * @param {number | null} vehicleWithinM
 * @param {number | null} headingStdDeg
 * @param {number} rangeM
 */
export function echoWithinM(vehicleWithinM, headingStdDeg, rangeM) {
  if (vehicleWithinM === null || headingStdDeg === null) return null;
  return Math.hypot(vehicleWithinM, 2 * headingStdDeg * RAD * rangeM);
}

/**
 * Where an echo lies: the vehicle's position, `rangeM` over ground to the side. If that is the slant range, it is good
 * to the height above the bottom.
 * @param {number} latitudeDeg
 * @param {number} longitudeDeg
 * @param {number} headingDeg
 * @param {Channel} channel A to starboard, B to port
 * @param {number} rangeM
 * @returns {{latitudeDeg: number, longitudeDeg: number}}
 */
export function echoPosition(latitudeDeg, longitudeDeg, headingDeg, channel, rangeM) {
  const bearing = (headingDeg + (channel === 'A' ? 90 : -90)) * RAD;
  const north = rangeM * Math.cos(bearing);
  const east = rangeM * Math.sin(bearing);
  return {
    latitudeDeg: latitudeDeg + north / EARTH_RADIUS_M / RAD,
    longitudeDeg: longitudeDeg + east / (EARTH_RADIUS_M * Math.cos(latitudeDeg * RAD)) / RAD,
  };
}

/**
 * Distance between two places of the picture. Across the track by slant range (both sides of the nadir add up), along
 * the track by speed and time where the speed is known.
 * @param {{channel: Channel, rangeM: number, timeS: number}} from
 * @param {{channel: Channel, rangeM: number, timeS: number}} to
 */
export function measure(from, to) {
  const side = (/** @type {{channel: Channel, rangeM: number}} */ p) =>
    p.channel === 'A' ? p.rangeM : -p.rangeM;
  return { acrossM: Math.abs(side(to) - side(from)), alongS: Math.abs(to.timeS - from.timeS) };
}
