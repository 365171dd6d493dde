// @ts-check
// Where metres of the local frame lie in the picture, and what there is to draw.

/**
 * @typedef {object} Scene
 * @property {import('./track.js').Track} track
 * @property {import('./map_colors.js').Coloring} coloring
 * @property {Record<string, any> | null} state  the newest message's data, null before the first
 * @property {Record<string, any> | null} acoustics  the newest of the array's topic, null before the first
 * @property {boolean} stale
 * @property {boolean} hasTiles  a picture of the place lies below
 * @property {[number, number][]} measure  east, north
 * @typedef {object} Place
 * @property {number} width  CSS pixels
 * @property {number} height
 * @property {number} ratio  device pixels in one of them
 * @property {number} centerE  metres in the middle of the picture
 * @property {number} centerN
 * @property {number} metresPerPx
 */

/**
 * @param {Place} place
 * @param {number} eastM
 */
export function xOf(place, eastM) {
  return place.width / 2 + (eastM - place.centerE) / place.metresPerPx;
}

/**
 * @param {Place} place
 * @param {number} northM
 */
export function yOf(place, northM) {
  return place.height / 2 - (northM - place.centerN) / place.metresPerPx;
}
