// @ts-check
/** What a renderer needs to know besides pings. @typedef {import('./gain.js').GainSettings} GainSettings */

/**
 * @typedef {object} PictureState
 * @property {GainSettings} gain
 * @property {number} fromM range at the nadir edge of a pane
 * @property {number} toM range at its far edge
 * @property {number} tvgMaximumM range of the last bin of the time-varied gain
 * @property {Float32Array} nothingRgb where there is no data, 0..1
 * @property {Float32Array} hatchRgb strokes of the hatching, 0..1
 * @property {number} dpr device pixels per CSS pixel
 */

export {};
