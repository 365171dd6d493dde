// @ts-check
// Temperature and sound speed against depth, as means of the dive so far in layers of a quarter metre.

export const LAYER_M = 0.25;
const DEEPEST_M = 1000;
/** What a fast descent skips between two samples; a longer way was not measured and is not drawn. */
const MOST_SKIPPED_M = 1;
const LAYERS = DEEPEST_M / LAYER_M;

/** Sums of one quantity by layer. */
class LayerMeans {
  constructor() {
    this.sums = new Float64Array(LAYERS);
    this.counts = new Uint32Array(LAYERS);
  }

  /**
   * @param {number} layer
   * @param {number} value
   */
  add(layer, value) {
    this.sums[layer] += value;
    this.counts[layer] += 1;
  }

  /** @param {number} layer */
  mean(layer) {
    return this.counts[layer] > 0 ? this.sums[layer] / this.counts[layer] : null;
  }
}

export class DepthProfile {
  constructor() {
    this.temperature = new LayerMeans();
    this.soundSpeed = new LayerMeans();
    this.deepest = -1;
    this.version = 0;
  }

  /**
   * @param {number | null} depthM
   * @param {number | null} temperatureDegc
   * @param {number | null} soundSpeedMps
   */
  add(depthM, temperatureDegc, soundSpeedMps) {
    if (depthM === null || !(depthM >= -LAYER_M && depthM < DEEPEST_M)) return;
    if (temperatureDegc === null && soundSpeedMps === null) return;
    const layer = Math.max(0, Math.floor(depthM / LAYER_M));
    if (temperatureDegc !== null) this.temperature.add(layer, temperatureDegc);
    if (soundSpeedMps !== null) this.soundSpeed.add(layer, soundSpeedMps);
    this.deepest = Math.max(this.deepest, layer);
    this.version += 1;
  }

  /**
   * @returns {[number[], (number | null)[], (number | null)[]]} depth of each visited layer's middle, temperature,
   *   sound speed; a row of null breaks the line where water was not measured
   */
  rows() {
    /** @type {[number[], (number | null)[], (number | null)[]]} */
    const rows = [[], [], []];
    let visited = -1;
    for (let layer = 0; layer <= this.deepest; layer += 1) {
      const temperature = this.temperature.mean(layer);
      const soundSpeed = this.soundSpeed.mean(layer);
      if (temperature === null && soundSpeed === null) continue;
      const skippedM = (layer - visited - 1) * LAYER_M;
      if (visited >= 0 && skippedM > MOST_SKIPPED_M) {
        rows[0].push(((visited + layer + 1) / 2) * LAYER_M);
        rows[1].push(null);
        rows[2].push(null);
      }
      visited = layer;
      rows[0].push((layer + 0.5) * LAYER_M);
      rows[1].push(temperature);
      rows[2].push(soundSpeed);
    }
    return rows;
  }
}
