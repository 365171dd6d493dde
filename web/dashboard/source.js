// @ts-check
// Where the page's messages come from: the socket beside it, the direct ports, and plain HTTP for the status where
// only the seed's bare socket passes.

import { call } from '../shared/api.js';
import { Connection, directSocketUrl, retryOnReturn, socketUrl } from '../shared/connection.js';

const EXTENSION_PORT = 8099;
const SENSOR_PORT = 8766;
const POLL_MS = 1000;

/**
 * Addresses to try: beside the page, the extension's own port past the proxy, and the seed's bare socket.
 * @param {string} pageUrl
 * @param {number} sensorPort
 * @returns {string[]}
 */
export function socketCandidates(pageUrl, sensorPort = SENSOR_PORT) {
  const beside = socketUrl(pageUrl);
  const all = [beside, directSocketUrl(pageUrl, EXTENSION_PORT, 'ws'), directSocketUrl(pageUrl, sensorPort)];
  return [...new Set(all.filter((url) => url !== null))];
}

export class Source {
  /**
   * @param {(text: unknown) => void} onMessage
   * @param {(state: import('../shared/connection.js').ConnectionState) => void} onState
   */
  constructor(onMessage, onState) {
    this.onMessage = onMessage;
    this.sensorPort = SENSOR_PORT;
    this.polling = false;
    this.connection = new Connection({
      candidates: () => socketCandidates(location.href, this.sensorPort),
      onMessage,
      onState: (state) => {
        this.polling = state.phase !== 'open' || !state.url.endsWith('/ws');
        onState(state);
      },
    });
  }

  start() {
    this.connection.start();
    retryOnReturn(this.connection);
    setInterval(() => void this.poll(), POLL_MS);
  }

  /** Status by HTTP, while the socket does not bring it. A proxy that blocks sockets still passes this. */
  async poll() {
    if (!this.polling || this.asking || document.hidden) return;
    this.asking = true;
    try {
      const [state, overview] = await Promise.all([
        call('api/state', { timeoutMs: 3000 }),
        this.portKnown ? null : call('api/status', { timeoutMs: 3000 }),
      ]);
      if (Number.isInteger(overview?.ws_port)) {
        this.sensorPort = overview.ws_port;
        this.portKnown = true;
      }
      if (this.polling) this.onMessage(JSON.stringify({ topic: 'status', data: state }));
    } catch {
      // Nobody there: the page says so by the age of what it shows.
    } finally {
      this.asking = false;
    }
  }
}
