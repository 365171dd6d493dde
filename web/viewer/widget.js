// @ts-check
/** The Cockpit widget: the waterfall alone. ?theme=light|dark, ?channel=A|B|both, ?palette=, ?inverted=1 */

import { byId, setText } from '../shared/dom.js';
import { startTheme } from '../shared/theme.js';
import { Feed } from './feed.js';
import { DEFAULT_PALETTE, PALETTES } from './palettes.js';
import { Stage } from './stage.js';
import { originOf, waitingText } from './status.js';

/**
 * @param {URLSearchParams} query
 * @returns {{layout: import('./ranging.js').Layout, palette: string, inverted: boolean}}
 */
export function widgetOptions(query) {
  const channel = (query.get('channel') ?? 'both').toUpperCase();
  const palette = query.get('palette') ?? DEFAULT_PALETTE;
  return {
    layout: channel === 'A' || channel === 'B' ? channel : 'side',
    palette: PALETTES.some((known) => known.id === palette) ? palette : DEFAULT_PALETTE,
    inverted: query.get('inverted') === '1',
  };
}

function start() {
  const options = widgetOptions(new URLSearchParams(location.search));
  startTheme(null);
  const stage = new Stage(
    byId('stage', HTMLElement),
    byId('picture', HTMLCanvasElement),
    byId('axes', HTMLCanvasElement),
    { view: { layout: options.layout }, gain: {}, palette: options.palette, inverted: options.inverted },
  );
  const waiting = byId('waiting', HTMLElement);
  const badge = byId('simulated', HTMLElement);
  /** @type {any} */
  let status = null;
  const feed = new Feed(stage.waterfall, {
    onText: (message) => {
      if (message.topic === 'status') status = message.data;
    },
    onPing: (ping) => {
      stage.overlay.unixOffsetS = ping.timeUnixS - ping.monotonicS;
    },
    onRestart: () => {},
    onState: () => {},
    onHistory: () => {},
  });
  feed.start();
  setInterval(() => {
    const origin = originOf(status, feed.simulated);
    setText(badge, origin);
    badge.hidden = origin === '';
    const text = waitingText(feed, stage.waterfall.hasData, status);
    waiting.hidden = text === null;
    if (text) setText(waiting, text.title);
  }, 500);
}

if (typeof document !== 'undefined') start();
