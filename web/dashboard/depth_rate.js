// @ts-check
// How fast the vehicle sinks: the slope of the last seconds of depth by the device's own clock.

const SPAN_MS = 4000;
const FEWEST = 4;
const POINTS = 96; // 4 s at 20 Hz, and some

export class DepthRate {
  constructor() {
    this.timeMs = new Float64Array(POINTS);
    this.depthM = new Float64Array(POINTS);
    this.length = 0;
  }

  /**
   * @param {unknown} deviceMs  the device's clock; a step back or a long pause begins anew
   * @param {number | null} depthM
   */
  add(deviceMs, depthM) {
    if (typeof deviceMs !== 'number' || depthM === null) {
      this.length = 0;
      return;
    }
    const sinceLast = this.length > 0 ? deviceMs - this.timeMs[this.length - 1] : 0;
    if (sinceLast < 0 || sinceLast > SPAN_MS) this.length = 0;
    let drop = 0;
    while (drop < this.length && deviceMs - this.timeMs[drop] > SPAN_MS) drop += 1;
    if (this.length - drop === POINTS) drop += 1;
    if (drop > 0) {
      this.timeMs.copyWithin(0, drop, this.length);
      this.depthM.copyWithin(0, drop, this.length);
      this.length -= drop;
    }
    this.timeMs[this.length] = deviceMs;
    this.depthM[this.length] = depthM;
    this.length += 1;
  }

  /** @returns {number | null} m/s, positive when sinking; null while too few samples say anything */
  mps() {
    const n = this.length;
    if (n < FEWEST) return null;
    let meanT = 0;
    let meanD = 0;
    for (let i = 0; i < n; i += 1) {
      meanT += this.timeMs[i] / n;
      meanD += this.depthM[i] / n;
    }
    let covariance = 0;
    let variance = 0;
    for (let i = 0; i < n; i += 1) {
      const dt = this.timeMs[i] - meanT;
      covariance += dt * (this.depthM[i] - meanD);
      variance += dt * dt;
    }
    return variance > 0 ? (1000 * covariance) / variance : null;
  }
}
