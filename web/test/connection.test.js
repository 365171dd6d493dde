// @ts-check
import assert from 'node:assert/strict';
import { beforeEach, test } from 'node:test';
import { Connection, directSocketUrl, retryDelayMs, socketUrl } from '../shared/connection.js';

/** A clock that moves only when told. */
class Timers {
  constructor() {
    this.nowMs = 0;
    this.next = 1;
    /** @type {Map<number, {at: number, call: () => void}>} */
    this.pending = new Map();
    this.now = () => this.nowMs;
    this.clearTimeout = (/** @type {number} */ id) => void this.pending.delete(id);
    this.setTimeout = (/** @type {() => void} */ call, /** @type {number} */ ms) => {
      this.pending.set(this.next, { at: this.nowMs + ms, call });
      return this.next++;
    };
  }

  /** @param {number} ms */
  advance(ms) {
    const end = this.nowMs + ms;
    for (;;) {
      const due = [...this.pending]
        .filter(([, timer]) => timer.at <= end)
        .sort((a, b) => a[1].at - b[1].at)[0];
      if (!due) break;
      this.pending.delete(due[0]);
      this.nowMs = due[1].at;
      due[1].call();
    }
    this.nowMs = end;
  }
}

/** @type {FakeSocket[]} */
let sockets = [];

class FakeSocket {
  /** @param {string} url */
  constructor(url) {
    this.url = url;
    this.closed = false;
    /** @type {(() => void) | null} */
    this.onopen = null;
    /** @type {(() => void) | null} */
    this.onclose = null;
    /** @type {((event: {data: any}) => void) | null} */
    this.onmessage = null;
    /** @type {any[]} */
    this.sent = [];
    sockets.push(this);
  }

  close() {
    this.closed = true;
  }

  /** @param {any} data */
  send(data) {
    this.sent.push(data);
  }
}

beforeEach(() => {
  sockets = [];
});

/** @param {string[]} urls */
function connect(urls) {
  const timers = new Timers();
  /** @type {any[]} */
  const messages = [];
  const connection = new Connection({
    candidates: () => urls,
    onMessage: (data) => messages.push(data),
    WebSocketClass: FakeSocket,
    timers,
  }).start();
  return { connection, timers, messages };
}

test('the socket lies beside the page, at the root and under a prefix', () => {
  assert.equal(socketUrl('http://blueos.local:8099/'), 'ws://blueos.local:8099/ws');
  assert.equal(
    socketUrl('http://blueos.local/extensionv2/blueslam/?theme=dark#x'),
    'ws://blueos.local/extensionv2/blueslam/ws',
  );
  assert.equal(socketUrl('https://x.cloud/extensionv2/b/widget'), 'wss://x.cloud/extensionv2/b/ws');
});

test('a direct port exists only where the browser allows a plain socket', () => {
  assert.equal(directSocketUrl('http://192.168.2.2/extensionv2/b/', 8766), 'ws://192.168.2.2:8766/');
  assert.equal(directSocketUrl('http://[fe80::1]/', 8099, 'ws'), 'ws://[fe80::1]:8099/ws');
  assert.equal(directSocketUrl('https://x.cloud/', 8766), null);
});

test('waiting grows, is bounded and spread', () => {
  assert.equal(
    retryDelayMs(0, () => 0.5),
    400,
  );
  assert.equal(
    retryDelayMs(3, () => 0.5),
    3200,
  );
  assert.equal(
    retryDelayMs(1000, () => 1),
    6250,
  );
  assert.ok(retryDelayMs(2, () => 0) < retryDelayMs(2, () => 1));
});

test('messages arrive and can be sent once open', () => {
  const { connection, messages } = connect(['ws://a/ws']);
  assert.equal(connection.send('early'), false);
  sockets[0].onopen?.();
  sockets[0].onmessage?.({ data: 'hello' });
  assert.equal(connection.send('hi'), true);
  assert.deepEqual([messages, sockets[0].sent, connection.state.phase], [['hello'], ['hi'], 'open']);
});

test('a refused address leads to the next one at once', () => {
  const { connection } = connect(['ws://a/ws', 'ws://a:8766/']);
  sockets[0].onclose?.();
  sockets[1].onopen?.();
  assert.deepEqual(
    [connection.state.phase, connection.state.candidate, connection.state.url],
    ['open', 1, 'ws://a:8766/'],
  );
});

test('an address that never answers is given up', () => {
  const { timers } = connect(['ws://a/ws', 'ws://b/ws']);
  timers.advance(5001);
  assert.equal(sockets[0].closed, true);
  assert.equal(sockets[1].url, 'ws://b/ws');
});

test('after a close it comes back by itself, first address first', () => {
  const { connection, timers } = connect(['ws://a/ws', 'ws://b/ws']);
  sockets[0].onclose?.();
  sockets[1].onopen?.();
  sockets[1].onclose?.();
  assert.equal(connection.state.phase, 'waiting');
  timers.advance(600);
  assert.equal(sockets[2].url, 'ws://a/ws');
  sockets[2].onopen?.();
  assert.equal(connection.state.phase, 'open');
});

test('a silent peer counts as gone', () => {
  const { connection, timers } = connect(['ws://a/ws']);
  sockets[0].onopen?.();
  timers.advance(6000);
  sockets[0].onmessage?.({ data: 'still here' });
  timers.advance(6000);
  assert.equal(connection.state.phase, 'open');
  timers.advance(4000);
  assert.equal(sockets[0].closed, true);
  assert.notEqual(connection.state.phase, 'open');
});

test('a returning network does not wait for the timer', () => {
  const { connection } = connect(['ws://a/ws']);
  sockets[0].onclose?.();
  connection.retryNow();
  assert.equal(sockets.length, 2);
});

test('a socket given up cannot speak any more', () => {
  const { connection, messages, timers } = connect(['ws://a/ws']);
  const late = sockets[0].onmessage;
  sockets[0].onclose?.();
  late?.({ data: 'late' });
  connection.stop();
  timers.advance(60_000);
  assert.deepEqual([messages, sockets.length, connection.state.phase], [[], 1, 'stopped']);
});
