// @ts-check
/**
 * Bytes from the viewer service to pings. Pure: no network, no DOM.
 * The layout is in docs/interfaces.md section 4.
 */

/** @typedef {'A' | 'B'} Channel */

/**
 * One echogram. Sample i lies at slant range `(firstSample + i) * resolutionM`.
 * @typedef {object} Ping
 * @property {Channel} channel A looks to starboard, B to port
 * @property {number} subChannel 0, or 1 for the second half of a dual-channel sonar
 * @property {boolean} simulated
 * @property {number} number counts the received pings of this channel, wraps at 2^32
 * @property {number} timeUnixS NaN when the wall clock is unknown
 * @property {number} monotonicS the host's monotonic clock at the measurement
 * @property {number} firstSample
 * @property {number} resolutionM NaN when unknown (seed JSON)
 * @property {number} decimation
 * @property {number} route
 * @property {Uint16Array} gaps start, end, start, end...: half-open sample ranges that never arrived
 * @property {Uint8Array} samples
 */

const MAGIC = 0x50;
const VERSION = 1;
const HEADER_BYTES = 40;
const FLAG_SUB_CHANNEL_1 = 2;
const FLAG_SIMULATED = 4;

/** A frame that cannot be a ping; its message says why. Counted by the caller, never fatal. */
export class MalformedPingError extends Error {}

/**
 * @param {Uint8Array} bytes exactly one binary ping
 * @returns {Ping} whose samples are a view on `bytes`
 */
export function decodePing(bytes) {
  if (bytes.length < HEADER_BYTES) throw new MalformedPingError(`${bytes.length} bytes, header needs 40`);
  if (bytes[0] !== MAGIC) throw new MalformedPingError(`first byte ${bytes[0]}, expected ${MAGIC}`);
  if (bytes[1] !== VERSION) throw new MalformedPingError(`version ${bytes[1]}, expected ${VERSION}`);
  if (bytes[2] > 1) throw new MalformedPingError(`channel ${bytes[2]}, expected 0 or 1`);
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const count = view.getUint16(24, true);
  const gapCount = view.getUint16(32, true);
  const expected = HEADER_BYTES + 4 * gapCount + count;
  if (bytes.length !== expected) throw new MalformedPingError(`${bytes.length} bytes, expected ${expected}`);
  const resolutionMm = view.getUint16(28, true);
  const monotonicS = view.getFloat64(16, true);
  if (resolutionMm === 0) throw new MalformedPingError('resolution 0 mm');
  if (!Number.isFinite(monotonicS)) throw new MalformedPingError('monotonic time is not a number');
  return {
    channel: bytes[2] === 0 ? 'A' : 'B',
    subChannel: bytes[3] & FLAG_SUB_CHANNEL_1 ? 1 : 0,
    simulated: (bytes[3] & FLAG_SIMULATED) !== 0,
    number: view.getUint32(4, true),
    timeUnixS: view.getFloat64(8, true),
    monotonicS,
    firstSample: view.getUint16(26, true),
    resolutionM: resolutionMm / 1000,
    decimation: bytes[30],
    route: bytes[31],
    gaps: readGaps(view, gapCount, count),
    samples: bytes.subarray(HEADER_BYTES + 4 * gapCount),
  };
}

/**
 * @param {DataView} view
 * @param {number} gapCount
 * @param {number} sampleCount
 */
function readGaps(view, gapCount, sampleCount) {
  const gaps = new Uint16Array(2 * gapCount);
  for (let k = 0; k < gapCount; k++) {
    const start = view.getUint16(HEADER_BYTES + 4 * k, true);
    const end = view.getUint16(HEADER_BYTES + 4 * k + 2, true);
    if (start > end || end > sampleCount)
      throw new MalformedPingError(`gap ${start}..${end} of ${sampleCount}`);
    gaps[2 * k] = start;
    gaps[2 * k + 1] = end;
  }
  return gaps;
}

/**
 * The body of GET /api/history: pings, each behind its u32 length. A damaged one is counted and stepped over.
 * @param {ArrayBuffer} body
 * @returns {{pings: Ping[], malformed: number}}
 */
export function decodeHistory(body) {
  const bytes = new Uint8Array(body);
  const view = new DataView(body);
  const pings = [];
  let malformed = 0;
  let at = 0;
  while (at < bytes.length) {
    const length = at + 4 <= bytes.length ? view.getUint32(at, true) : Infinity;
    if (at + 4 + length > bytes.length) return { pings, malformed: malformed + 1 };
    try {
      pings.push(decodePing(bytes.subarray(at + 4, at + 4 + length)));
    } catch (error) {
      if (!(error instanceof MalformedPingError)) throw error;
      malformed += 1;
    }
    at += 4 + length;
  }
  return { pings, malformed };
}

/**
 * The original 200-bin JSON of port 8101: no time and no range, so the time of arrival stands in for the former.
 * @param {string} text
 * @param {number} arrivedUnixS
 * @returns {Ping}
 */
export function decodeSeedPing(text, arrivedUnixS) {
  let message;
  try {
    message = JSON.parse(text);
  } catch {
    throw new MalformedPingError('not JSON');
  }
  const { ch, amp, n } = message ?? {};
  if ((ch !== 'A' && ch !== 'B') || typeof amp !== 'string' || !Number.isInteger(n)) {
    throw new MalformedPingError('expected {"ch": "A" or "B", "amp": base64, "n": number}');
  }
  let samples;
  try {
    samples = Uint8Array.from(atob(amp), (character) => character.charCodeAt(0));
  } catch {
    throw new MalformedPingError('amp is not base64');
  }
  return {
    channel: ch,
    subChannel: 0,
    simulated: false,
    number: n >>> 0,
    timeUnixS: arrivedUnixS,
    monotonicS: arrivedUnixS,
    firstSample: 0,
    resolutionM: NaN,
    decimation: 1,
    route: 0,
    gaps: new Uint16Array(0),
    samples,
  };
}

/**
 * How far `later` is ahead of `earlier` for numbers that wrap at 2^32; negative when it is behind.
 * @param {number} later
 * @param {number} earlier
 */
export function numberDistance(later, earlier) {
  return (later - earlier) | 0;
}
