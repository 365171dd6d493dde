// @ts-check
/** Where the vehicle was when: what the service remembers, and what it said while this page was open. Pure. */

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
/** Two states nearer than this are the same one, heard live and asked for. */
const SAME_S = 0.25;

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
   * Puts what the service remembers where this page has nothing: before it was opened, and while it was cut off.
   * @param {any} answer  of GET api/track
   */
  load(answer) {
    const columns = Array.isArray(answer?.columns) ? answer.columns : [];
    const states = Array.isArray(answer?.states) ? answer.states : [];
    const found = states.map((/** @type {any[]} */ row) => stateOf(columns, row));
    const all = [
      ...this.states,
      ...found.filter((/** @type {VehicleState} */ s) => Number.isFinite(s.timeS)),
    ];
    all.sort((a, b) => a.timeS - b.timeS);
    this.states = all.filter((state, i) => i === 0 || state.timeS - all[i - 1].timeS > SAME_S);
    this.states.splice(0, this.states.length - MOST_STATES);
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

/**
 * @param {string[]} columns
 * @param {any[]} row
 * @returns {VehicleState}
 */
function stateOf(columns, row) {
  /** @type {any} */
  const state = { timeS: NaN, estimate: {} };
  columns.forEach((name, i) => {
    if (name === 'monotonic_s') state.timeS = Number(row[i] ?? NaN);
    else if (name.startsWith('estimate.')) state.estimate[name.slice(9)] = row[i] ?? null;
    else state[name] = row[i] ?? null;
  });
  return state;
}
