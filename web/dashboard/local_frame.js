// @ts-check
// Metres north and east of an origin <-> latitude and longitude (WGS-84): good to centimetres within some kilometres.

const DEG = Math.PI / 180;
const SEMI_MAJOR_M = 6378137;
const ECCENTRICITY_2 = 6.69437999014e-3;

/**
 * Metres of one degree of latitude and of longitude at a latitude.
 * @param {number} latitudeDeg
 */
export function metresPerDegree(latitudeDeg) {
  const sine = Math.sin(latitudeDeg * DEG);
  const w = 1 - ECCENTRICITY_2 * sine * sine;
  const meridian = (SEMI_MAJOR_M * (1 - ECCENTRICITY_2)) / w ** 1.5;
  const normal = SEMI_MAJOR_M / Math.sqrt(w);
  return { north: meridian * DEG, east: normal * Math.cos(latitudeDeg * DEG) * DEG };
}

/**
 * @param {{latitudeDeg: number, longitudeDeg: number}} origin
 * @param {number} northM
 * @param {number} eastM
 */
export function toGeodetic(origin, northM, eastM) {
  const latitudeDeg = origin.latitudeDeg + northM / metresPerDegree(origin.latitudeDeg).north;
  // The parallels get shorter on the way north: the middle of the way is right to the second order.
  const middle = metresPerDegree((origin.latitudeDeg + latitudeDeg) / 2).east;
  return { latitudeDeg, longitudeDeg: origin.longitudeDeg + eastM / middle };
}

/**
 * @param {{latitudeDeg: number, longitudeDeg: number}} origin
 * @param {number} latitudeDeg
 * @param {number} longitudeDeg
 */
export function toLocal(origin, latitudeDeg, longitudeDeg) {
  const middle = metresPerDegree((origin.latitudeDeg + latitudeDeg) / 2).east;
  return {
    northM: (latitudeDeg - origin.latitudeDeg) * metresPerDegree(origin.latitudeDeg).north,
    eastM: (longitudeDeg - origin.longitudeDeg) * middle,
  };
}

/**
 * Distance and true bearing from one point to another.
 * @param {[number, number]} from  east, north
 * @param {[number, number]} to
 */
export function distanceAndBearing(from, to) {
  const east = to[0] - from[0];
  const north = to[1] - from[1];
  return { distanceM: Math.hypot(east, north), bearingDeg: (Math.atan2(east, north) / DEG + 360) % 360 };
}

/**
 * A step of 1, 2 or 5 times a power of ten, not below `least`.
 * @param {number} least
 */
export function niceStep(least) {
  const power = 10 ** Math.floor(Math.log10(least));
  for (const factor of [1, 2, 5]) if (power * factor >= least * (1 - 1e-9)) return power * factor;
  return power * 10;
}
