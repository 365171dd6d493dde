// @ts-check
/** Where the vehicle was when: what the `vehicle` topic said while this page was open. Pure. */

/**
 * @typedef {object} VehicleState
 * @property {number} timeS the page's time axis
 * @property {number | null} heading_deg
 * @property {number | null} depth_m
 * @property {number | null} latitude_deg
 * @property {number | null} longitude_deg
 * @property {Estimate | null} [estimate] of the navigator
 * @typedef {object} Estimate
 * @property {number | null} latitude_deg
 * @property {number | null} longitude_deg
 * @property {number | null} within_m radius of 95 %
 * @property {number | null} heading_deg true
 * @property {number | null} heading_std_deg
 * @property {number | null} altitude_m
 */

const MOST_STATES = 20000;
/** Further away in time than this, a state says nothing about a ping. */
const LONGEST_DISTANCE_S = 2;

export class Track {
  constructor() {
    /** @type {VehicleState[]} in the order of time */
    this.states = [];
  }

  clear() {
    this.states.length = 0;
  }

  /** @param {VehicleState} state */
  add(state) {
    const last = this.states.at(-1);
    if (last && state.timeS <= last.timeS) return;
    this.states.push(state);
    if (this.states.length > MOST_STATES) this.states.splice(0, MOST_STATES / 10);
  }

  /**
   * @param {number} timeS
   * @returns {VehicleState | null} the nearest in time, null when none is near
   */
  at(timeS) {
    let low = 0;
    let high = this.states.length;
    while (low < high) {
      const middle = (low + high) >>> 1;
      if (this.states[middle].timeS < timeS) low = middle + 1;
      else high = middle;
    }
    const later = this.states[low];
    const earlier = this.states[low - 1];
    const nearest = !later || (earlier && timeS - earlier.timeS < later.timeS - timeS) ? earlier : later;
    return nearest && Math.abs(nearest.timeS - timeS) <= LONGEST_DISTANCE_S ? nearest : null;
  }
}
