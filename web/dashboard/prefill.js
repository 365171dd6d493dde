// @ts-check
// A page opened in mid-dive begins with the last minutes of the running recording instead of empty plots.

import { call } from '../shared/api.js';
import { isKnown } from '../shared/format.js';
import { readFields } from './fields.js';
import { QUANTITIES } from './time_plots.js';

/** Some ten minutes at 2 Hz, and four seconds of a 1 Mbit/s tether. */
const TAIL_BYTES = 500_000;

/**
 * Rows of a session log, oldest first. The first line of a tail is cut, and the last may be: both are skipped.
 * @param {string} text
 * @returns {Array<{unixS: number, data: Record<string, any>}>}
 */
export function parseTail(text) {
  const rows = [];
  for (const line of text.split('\n')) {
    try {
      const data = JSON.parse(line);
      if (typeof data?.t_unix === 'number' && typeof data.imu === 'object')
        rows.push({ unixS: data.t_unix, data });
    } catch {
      // A cut line.
    }
  }
  return rows;
}

/**
 * @param {import('./model.js').Model} model
 * @param {import('./live.js').LivePage} live
 */
export async function prefill(model, live) {
  let rows;
  try {
    const list = await call('api/recordings');
    const active = list?.recordings?.find((/** @type {any} */ r) => r?.name === list.active);
    const logs = (active?.files ?? []).filter((/** @type {any} */ f) => String(f?.name).endsWith('.jsonl'));
    const file = logs[logs.length - 1];
    if (!file) return;
    const answer = await fetch(`api/recordings/${active.name}/files/${file.name}`, {
      headers: { Range: `bytes=-${TAIL_BYTES}` },
      signal: AbortSignal.timeout(20000),
    });
    // A server that ignores the range would send a whole day's log: leave it.
    if (answer.status !== 206 && file.bytes > 2 * TAIL_BYTES) return;
    rows = parseTail(await answer.text());
  } catch {
    return;
  }
  if (model.sensors) giveRows(rows, model, live);
  else live.beforeFirst = () => giveRows(rows, model, live);
}

/**
 * The log's salinity is the wire's, in steps of 0.1 PSU: beside the live one its steps would look like events.
 * @param {Record<string, any>} data
 */
function withoutCoarse(data) {
  return { ...data, ctd: { ...data.ctd, s: null } };
}

/**
 * From the log's time, which is that of measurement, to the page's, which is that of arrival: so that the log's last
 * sample joins the first one seen here.
 * @param {import('./model.js').Model} model
 */
export function steadyMinusLogS(model) {
  const measured = model.extra.measured_unix_s;
  return isKnown(measured) ? model.sensorsAtMs / 1000 - measured : -model.unixAt(0);
}

/**
 * @param {ReturnType<typeof parseTail>} rows
 * @param {import('./model.js').Model} model
 * @param {import('./live.js').LivePage} live
 */
function giveRows(rows, model, live) {
  const readings = new Map(
    [...model.readings.keys()].map((key) => [key, { value: /** @type {number | null} */ (null), atMs: NaN }]),
  );
  const value = (/** @type {string} */ key) => readings.get(key)?.value ?? null;
  const offsetS = steadyMinusLogS(model);
  /** @type {Array<[number, (number | null)[]]>} */
  const history = [];
  for (const { unixS, data } of rows) {
    readFields(readings, withoutCoarse(data), {}, 0);
    history.push([unixS + offsetS, QUANTITIES.map((quantity) => value(quantity.key))]);
    live.gauge?.remember(value('depth'));
    live.profile.add(value('depth'), value('temperature'), value('soundSpeed'));
  }
  live.history.prepend(history);
}
