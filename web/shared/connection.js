// @ts-check
// A WebSocket that comes back by itself, and the rules for finding it wherever the page is put.

/**
 * @typedef {'connecting' | 'open' | 'waiting' | 'stopped'} Phase
 * @typedef {{phase: Phase, candidate: number, url: string, attempt: number, retryAtMs: number | null}} ConnectionState
 *
 * @typedef {object} ConnectionOptions
 * @property {() => string[]} candidates  addresses to try, best first; asked again before each round
 * @property {(data: any, state: ConnectionState) => void} onMessage  text or ArrayBuffer, as received
 * @property {(state: ConnectionState) => void} [onState]
 * @property {number} [silenceMs]  no message for this long means the peer is gone
 * @property {new (url: string) => any} [WebSocketClass]
 * @property {{setTimeout: (f: () => void, ms: number) => any, clearTimeout: (id: any) => void, now: () => number}} [timers]
 */

const FIRST_RETRY_MS = 400;
const LONGEST_RETRY_MS = 5000;
const CONNECT_TIMEOUT_MS = 5000;
const SILENCE_MS = 8000; // the services speak at least once a second

/**
 * The socket beside the page: works at `/`, under BlueOS's `/extensionv2/<name>/` and in an iframe.
 * @param {string} pageUrl
 * @param {string} [path]
 */
export function socketUrl(pageUrl, path = 'ws') {
  const url = new URL(path, pageUrl);
  url.protocol = url.protocol === 'https:' ? 'wss:' : 'ws:';
  url.search = '';
  url.hash = '';
  return url.href;
}

/**
 * The same host on a port of ours, for proxies that pass no WebSocket (BlueOS 1.4.3). A page on https must not open
 * a plain socket, so there is none for it.
 * @param {string} pageUrl
 * @param {number} port
 * @param {string} [path]
 * @returns {string | null}
 */
export function directSocketUrl(pageUrl, port, path = '') {
  const page = new URL(pageUrl);
  return page.protocol === 'http:' ? `ws://${page.hostname}:${port}/${path}` : null;
}

/**
 * Waiting time before the n-th new round (from 0): doubling, with a spread so that many clients do not return at once.
 * @param {number} attempt
 * @param {() => number} [random]
 */
export function retryDelayMs(attempt, random = Math.random) {
  const full = Math.min(LONGEST_RETRY_MS, FIRST_RETRY_MS * 2 ** Math.min(attempt, 16));
  return Math.round(full * (0.75 + 0.5 * random()));
}

/** Keeps one WebSocket open to the first candidate that answers. */
export class Connection {
  /** @param {ConnectionOptions} options */
  constructor(options) {
    this.options = options;
    this.timers = options.timers ?? {
      setTimeout: (f, ms) => setTimeout(f, ms),
      clearTimeout: (id) => clearTimeout(id),
      now: () => performance.now(),
    };
    /** @type {ConnectionState} */
    this.state = { phase: 'stopped', candidate: 0, url: '', attempt: 0, retryAtMs: null };
    /** @type {any} */
    this.socket = null;
    /** @type {string[]} */
    this.urls = [];
    this.lastHeardMs = 0;
    /** @type {any} */
    this.timer = null;
  }

  start() {
    if (this.state.phase === 'stopped') this.beginRound();
    return this;
  }

  stop() {
    this.drop();
    this.change({ phase: 'stopped', retryAtMs: null });
  }

  /** Do not wait any longer: the network or the tab is back. */
  retryNow() {
    if (this.state.phase !== 'waiting') return;
    this.timers.clearTimeout(this.timer);
    this.beginRound();
  }

  /**
   * @param {string | ArrayBuffer} data
   * @returns {boolean} whether it could be sent
   */
  send(data) {
    if (this.state.phase !== 'open') return false;
    this.socket.send(data);
    return true;
  }

  beginRound() {
    this.urls = this.options.candidates();
    this.open(0);
  }

  /** @param {number} candidate */
  open(candidate) {
    const url = this.urls[candidate] ?? '';
    this.change({ phase: 'connecting', candidate, url, retryAtMs: null });
    let socket;
    try {
      socket = new (this.options.WebSocketClass ?? WebSocket)(url);
    } catch {
      this.failed(candidate);
      return;
    }
    this.socket = socket;
    socket.binaryType = 'arraybuffer';
    this.timer = this.timers.setTimeout(() => this.failed(candidate), CONNECT_TIMEOUT_MS);
    socket.onopen = () => this.opened(socket);
    socket.onclose = () => socket === this.socket && this.failed(candidate);
    socket.onmessage = (/** @type {any} */ event) => {
      if (socket !== this.socket) return;
      this.lastHeardMs = this.timers.now();
      this.options.onMessage(event.data, this.state);
    };
  }

  /** @param {any} socket */
  opened(socket) {
    if (socket !== this.socket) return;
    this.timers.clearTimeout(this.timer);
    this.lastHeardMs = this.timers.now();
    this.change({ phase: 'open', attempt: 0 });
    this.watch();
  }

  watch() {
    const limit = this.options.silenceMs ?? SILENCE_MS;
    this.timer = this.timers.setTimeout(() => {
      if (this.timers.now() - this.lastHeardMs >= limit) this.wait();
      else this.watch();
    }, limit / 4);
  }

  /** @param {number} candidate */
  failed(candidate) {
    const wasOpen = this.state.phase === 'open';
    if (!wasOpen && candidate + 1 < this.urls.length) {
      this.drop();
      this.open(candidate + 1);
    } else {
      this.wait();
    }
  }

  wait() {
    this.drop();
    const delay = retryDelayMs(this.state.attempt);
    this.timer = this.timers.setTimeout(() => this.beginRound(), delay);
    this.change({
      phase: 'waiting',
      attempt: this.state.attempt + 1,
      retryAtMs: this.timers.now() + delay,
    });
  }

  drop() {
    this.timers.clearTimeout(this.timer);
    const socket = this.socket;
    this.socket = null;
    if (!socket) return;
    socket.onopen = socket.onclose = socket.onmessage = null;
    try {
      socket.close();
    } catch {
      // It was closed already.
    }
  }

  /** @param {Partial<ConnectionState>} change */
  change(change) {
    Object.assign(this.state, change);
    this.options.onState?.(this.state);
  }
}

/**
 * Reconnect at once when the browser says that the network or the tab is back.
 * @param {Connection} connection
 */
export function retryOnReturn(connection) {
  window.addEventListener('online', () => connection.retryNow());
  document.addEventListener('visibilitychange', () => {
    if (!document.hidden) connection.retryNow();
  });
}
