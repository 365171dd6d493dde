// @ts-check
/**
 * Pings into the rings: live from the socket, older ones from /api/history, and what the page missed in between.
 */

import { Connection, directSocketUrl, retryOnReturn, socketUrl } from '../shared/connection.js';
import { MalformedPingError, decodeHistory, decodePing, decodeSeedPing, numberDistance } from './decoding.js';

/** @typedef {import('./waterfall.js').Waterfall} Waterfall */
/** @typedef {import('./decoding.js').Ping} Ping */
/** @typedef {import('./decoding.js').Channel} Channel */
/** @typedef {import('./ping_ring.js').PingRing} PingRing */

const VIEWER_PORT = 8100;
const SEED_PORT = 8101;
const PAGE_OF_PINGS = 256;
/** Holes up to this many pings are fetched again after an interruption. */
const LARGEST_REPAIR = 2000;
/** A jump of the clock backwards by more than this is another run, not disorder. */
const RESTART_S = 1;
const RETRY_HISTORY_MS = 4000;
/** Guesses of a ping number by time before giving up on a jump. */
const MOST_JUMPS = 10;
/** The seed's 200 bins carry no range: drawn as bins of this size unless the sonar's range was read. */
const UNKNOWN_RESOLUTION_M = 1;

/** @type {Channel[]} */
const CHANNELS = ['A', 'B'];

/**
 * @typedef {object} ChannelFeed
 * @property {boolean} busy a history call is under way
 * @property {number} repairs holes that are being fetched
 * @property {number} notBeforeMs after a failure
 * @property {number | null} firstNumber oldest ping that the service keeps; null = not known yet
 * @property {boolean} emptyHistory
 * @property {number} firstS its time, NaN until known
 * @property {number} jumps
 * @property {number} received
 * @property {number} missed numbers that this page never got
 * @property {number} lastArrivalMs
 */

export class Feed {
  /**
   * @param {Waterfall} waterfall
   * @param {{onText: (message: any) => void, onPing: (ping: Ping) => void, onRestart: () => void,
   *   onState: (state: import('../shared/connection.js').ConnectionState) => void, onHistory: () => void}} handlers
   */
  constructor(waterfall, handlers) {
    this.waterfall = waterfall;
    this.handlers = handlers;
    this.malformed = 0;
    this.simulated = false;
    this.coarse = false;
    this.coarseRangeM = { A: NaN, B: NaN };
    this.historyFailed = false;
    /** @type {Record<Channel, ChannelFeed>} */
    this.channels = { A: newChannel(), B: newChannel() };
    this.connection = new Connection({
      candidates: () => candidates(location.href),
      onMessage: (data, state) => this.receive(data, state.url),
      onState: (state) => this.stateChanged(state),
    });
  }

  start() {
    this.connection.start();
    retryOnReturn(this.connection);
    this.ensure();
  }

  /** @param {import('../shared/connection.js').ConnectionState} state */
  stateChanged(state) {
    if (state.phase === 'open') {
      this.coarse = isSeed(state.url);
      for (const name of CHANNELS) {
        this.channels[name].notBeforeMs = 0;
        this.channels[name].emptyHistory = false;
      }
      this.ensure();
    }
    this.handlers.onState(state);
  }

  /** @param {string | ArrayBuffer} data @param {string} url */
  receive(data, url) {
    try {
      if (typeof data !== 'string') this.take(decodePing(new Uint8Array(data)));
      else if (isSeed(url)) this.take(this.scaled(decodeSeedPing(data, Date.now() / 1000)));
      else this.handlers.onText(JSON.parse(data));
    } catch (error) {
      if (!(error instanceof MalformedPingError || error instanceof SyntaxError)) throw error;
      this.malformed += 1;
    }
  }

  /** @param {Ping} ping from the seed's JSON */
  scaled(ping) {
    const rangeM = this.coarseRangeM[ping.channel];
    ping.resolutionM = rangeM > 0 ? rangeM / ping.samples.length : UNKNOWN_RESOLUTION_M;
    return ping;
  }

  /** @param {Ping} ping */
  take(ping) {
    if (ping.subChannel !== 0) return;
    const ring = this.waterfall.live(ping.channel);
    const channel = this.channels[ping.channel];
    if (ring.length && ping.monotonicS < ring.newestArrivalS - RESTART_S) this.restart();
    const missing = ring.length ? numberDistance(ping.number, ring.newestNumber) - 1 : 0;
    const before = ring.newestNumber;
    if (!ring.append(ping)) return;
    channel.received += 1;
    channel.lastArrivalMs = performance.now();
    this.simulated = ping.simulated;
    if (missing > 0 && missing <= LARGEST_REPAIR && !this.coarse) this.repair(ping.channel, before, missing);
    else if (missing > 0) channel.missed += missing;
    this.handlers.onPing(ping);
    this.waterfall.invalidate();
  }

  /** Another run of the service's clock: nothing on the picture can be placed in time any more. */
  restart() {
    for (const ring of this.waterfall.rings) ring.clear();
    for (const name of CHANNELS) this.channels[name] = newChannel();
    this.waterfall.goLive();
    this.handlers.onRestart();
  }

  /**
   * Numbers are missing between two live pings: the service has them unless it was restarted.
   * @param {Channel} name
   * @param {number} after
   * @param {number} missing
   */
  async repair(name, after, missing) {
    const channel = this.channels[name];
    channel.repairs += 1;
    const pings = await this.fetchPings(name, `after=${after}&limit=${missing}`);
    channel.repairs -= 1;
    if (channel !== this.channels[name]) return;
    const ring = this.waterfall.live(name);
    const found = (pings ?? []).filter((ping) => {
      const distance = numberDistance(ping.number, after);
      return distance > 0 && distance <= missing;
    });
    channel.missed += missing - found.length;
    if (!found.length) return;
    const index = ring.indexOfNumber(after);
    if (index < 0) return;
    const later = ring.takeAfter(index, name);
    for (const ping of found) ring.append(ping);
    for (const ping of later) ring.append(ping);
    this.waterfall.invalidate();
  }

  /**
   * Loads what the picture shows and the rings do not hold; called after each move, cheap when there is nothing to do.
   */
  ensure() {
    if (this.coarse) return;
    for (const name of CHANNELS) {
      const channel = this.channels[name];
      if (channel.busy || performance.now() < channel.notBeforeMs) continue;
      const request = this.nextRequest(name);
      if (request) this.load(name, request);
    }
  }

  /** The picture moved to another time: jumping is allowed again. */
  moved() {
    for (const name of CHANNELS) this.channels[name].jumps = 0;
    this.ensure();
  }

  /** Oldest time that can be shown, of the channels in view. */
  get oldestS() {
    let oldest = NaN;
    for (const name of CHANNELS) {
      const { firstS } = this.channels[name];
      const known = Number.isFinite(firstS) ? firstS : this.waterfall.live(name).oldestS;
      if (known < oldest || Number.isNaN(oldest)) oldest = known;
    }
    return oldest;
  }

  /**
   * @param {Channel} name
   * @returns {{query: string, into: 'live' | 'older' | 'newer' | 'jump' | 'first'} | null}
   */
  nextRequest(name) {
    const { waterfall } = this;
    const channel = this.channels[name];
    const live = waterfall.live(name);
    if (!live.length) return channel.emptyHistory ? null : { query: `limit=${PAGE_OF_PINGS}`, into: 'live' };
    if (channel.firstNumber === null) {
      return { query: `before=${live.oldestNumber}&limit=${PAGE_OF_PINGS}`, into: 'live' };
    }
    if (Number.isNaN(channel.firstS)) {
      return { query: `before=${(channel.firstNumber + 1) >>> 0}&limit=1`, into: 'first' };
    }
    const topS = waterfall.view.live ? waterfall.newestS : waterfall.view.topS;
    const bottomS = topS - waterfall.windowS * 1.2;
    if (bottomS >= live.oldestS || live.oldestNumber === channel.firstNumber) return null;
    if (live.length + PAGE_OF_PINGS < live.capacity * 0.75 && topS > live.oldestS - waterfall.windowS) {
      return { query: `before=${live.oldestNumber}&limit=${PAGE_OF_PINGS}`, into: 'live' };
    }
    return this.scrollBackRequest(name, topS, bottomS);
  }

  /**
   * @param {Channel} name
   * @param {number} topS
   * @param {number} bottomS
   * @returns {{query: string, into: 'older' | 'newer' | 'jump'} | null}
   */
  scrollBackRequest(name, topS, bottomS) {
    const channel = this.channels[name];
    const live = this.waterfall.live(name);
    const back = this.waterfall.back(name);
    const wantedTopS = Math.min(topS, live.oldestS);
    const margin = this.waterfall.windowS;
    const far = !back.length || wantedTopS < back.oldestS - margin || bottomS > back.newestS + margin;
    if (far) {
      if (channel.jumps >= MOST_JUMPS) return null;
      channel.jumps += 1;
      const number = this.guessNumber(name, wantedTopS + margin * 0.2);
      return { query: `before=${number}&limit=${PAGE_OF_PINGS}`, into: 'jump' };
    }
    if (bottomS < back.oldestS && back.oldestNumber !== channel.firstNumber) {
      return { query: `before=${back.oldestNumber}&limit=${PAGE_OF_PINGS}`, into: 'older' };
    }
    if (wantedTopS > back.newestS)
      return { query: `after=${back.newestNumber}&limit=${PAGE_OF_PINGS}`, into: 'newer' };
    return null;
  }

  /**
   * A ping number for a time, between the known ones on either side of it.
   * @param {Channel} name
   * @param {number} timeS
   */
  guessNumber(name, timeS) {
    const channel = this.channels[name];
    const live = this.waterfall.live(name);
    const back = this.waterfall.back(name);
    let low = { s: channel.firstS, n: channel.firstNumber ?? 0 };
    let high = { s: live.oldestS, n: live.oldestNumber };
    if (back.length && back.newestS < timeS) low = { s: back.newestS, n: back.newestNumber };
    if (back.length && back.oldestS > timeS) high = { s: back.oldestS, n: back.oldestNumber };
    const share = (timeS - low.s) / Math.max(high.s - low.s, 1e-6);
    const steps = Math.ceil(numberDistance(high.n, low.n) * Math.min(1, Math.max(0, share)));
    return (low.n + Math.max(1, steps) + 1) >>> 0;
  }

  /**
   * @param {Channel} name
   * @param {{query: string, into: string}} request
   */
  async load(name, { query, into }) {
    const channel = this.channels[name];
    channel.busy = true;
    const pings = await this.fetchPings(name, query);
    channel.busy = false;
    if (channel !== this.channels[name]) return;
    if (!pings) {
      channel.notBeforeMs = performance.now() + RETRY_HISTORY_MS;
      setTimeout(() => this.ensure(), RETRY_HISTORY_MS + 50);
      return;
    }
    this.store(name, pings, into);
    this.waterfall.invalidate();
    this.handlers.onHistory();
    this.ensure();
  }

  /**
   * @param {Channel} name
   * @param {Ping[]} pings
   * @param {string} into
   */
  store(name, pings, into) {
    const channel = this.channels[name];
    const live = this.waterfall.live(name);
    const back = this.waterfall.back(name);
    if (!pings.length) {
      if (!live.length) channel.emptyHistory = true;
      else if (into === 'live') channel.firstNumber = live.oldestNumber;
      else if (into === 'older') channel.firstNumber = back.oldestNumber;
      if (Number.isNaN(channel.firstS)) channel.firstS = live.oldestS;
      channel.notBeforeMs = performance.now() + RETRY_HISTORY_MS;
      return;
    }
    if (into === 'first') channel.firstS = pings[0].monotonicS;
    else if (into === 'newer') for (const ping of pings) back.append(ping);
    else if (into === 'older') back.prependAll(pings);
    else if (into === 'jump') {
      back.clear();
      back.prependAll(pings);
    } else {
      const hole = live.length ? numberDistance(live.oldestNumber, pings[pings.length - 1].number) - 1 : 0;
      // Live pings overtook this answer: ask again for those just before the oldest.
      if (hole <= 0) live.prependAll(pings);
      this.simulated = pings[pings.length - 1].simulated;
    }
  }

  /**
   * @param {Channel} name
   * @param {string} query
   * @returns {Promise<Ping[] | null>} null when the service did not answer
   */
  async fetchPings(name, query) {
    try {
      const response = await fetch(`api/history?channel=${name}&${query}`, { cache: 'no-store' });
      if (!response.ok) throw new Error(String(response.status));
      const { pings, malformed } = decodeHistory(await response.arrayBuffer());
      this.malformed += malformed;
      this.noteFirst(name, response.headers.get('X-First-Ping'));
      this.historyFailed = false;
      return pings.filter((ping) => ping.subChannel === 0);
    } catch {
      this.historyFailed = true;
      return null;
    }
  }

  /**
   * The service forgets its oldest pings as it fills: the time of the first moves on with its number.
   * @param {Channel} name
   * @param {string | null} header
   */
  noteFirst(name, header) {
    if (!header || !/^\d+$/.test(header)) return;
    const channel = this.channels[name];
    const first = Number(header) >>> 0;
    if (channel.firstNumber !== null) {
      const forgotten = numberDistance(first, channel.firstNumber);
      channel.firstS += forgotten * this.waterfall.live(name).currentPeriodS;
    }
    channel.firstNumber = first;
  }
}

/** @returns {ChannelFeed} */
function newChannel() {
  return {
    busy: false,
    repairs: 0,
    notBeforeMs: 0,
    firstNumber: null,
    emptyHistory: false,
    firstS: NaN,
    jumps: 0,
    received: 0,
    missed: 0,
    lastArrivalMs: -Infinity,
  };
}

/**
 * Beside the page first; then our own ports, for a proxy that passes no WebSocket.
 * @param {string} pageUrl
 */
export function candidates(pageUrl) {
  const all = [
    socketUrl(pageUrl),
    directSocketUrl(pageUrl, VIEWER_PORT, 'ws'),
    directSocketUrl(pageUrl, SEED_PORT),
  ];
  return /** @type {string[]} */ ([...new Set(all)].filter((url) => url !== null));
}

/** @param {string} url */
function isSeed(url) {
  return url.endsWith(`:${SEED_PORT}/`);
}
