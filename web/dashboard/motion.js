// @ts-check
// Moving a pointer to where the value is: fast enough to be true, smooth enough to be read.

/** Two thirds of the way in this time; well under the half second between samples. */
const SETTLE_S = 0.09;

/**
 * @param {number} current
 * @param {number} target
 * @param {number} elapsedS
 */
export function approach(current, target, elapsedS) {
  return current + (target - current) * (1 - Math.exp(-elapsedS / SETTLE_S));
}

/**
 * From one angle to another by the short way, degrees in (-180, 180].
 * @param {number} fromDeg
 * @param {number} toDeg
 */
export function turnDeg(fromDeg, toDeg) {
  const turn = (((toDeg - fromDeg) % 360) + 540) % 360;
  return turn - 180;
}

/** A value on its way. */
export class Follower {
  /**
   * @param {boolean} isAngle
   * @param {number} tolerance  near enough to rest
   */
  constructor(isAngle, tolerance) {
    this.isAngle = isAngle;
    this.tolerance = tolerance;
    /** @type {number | null} */
    this.target = null;
    this.shown = 0;
  }

  /** @param {number | null} target */
  aim(target) {
    if (this.target === null && target !== null) this.shown = target;
    this.target = target;
  }

  /**
   * @param {number} elapsedS
   * @param {boolean} atOnce  for those who asked for reduced motion
   * @returns {boolean} whether it still moves
   */
  step(elapsedS, atOnce) {
    if (this.target === null) return false;
    const way = this.isAngle ? turnDeg(this.shown, this.target) : this.target - this.shown;
    if (atOnce || Math.abs(way) <= this.tolerance || !Number.isFinite(way)) {
      this.shown = this.target;
      return false;
    }
    this.shown = approach(this.shown, this.shown + way, elapsedS);
    if (this.isAngle) this.shown %= 360;
    return true;
  }
}
