// @ts-check
/** Live, paused or silent: the words over the picture, the way back to live, the time line, the empty picture. */

import { byId, setText } from '../shared/dom.js';
import { age, clockTime, count, duration } from '../shared/format.js';
import { Timeline } from './timeline.js';

const SILENT_AFTER_S = 3;

export class Transport {
  /**
   * @param {import('./waterfall.js').Waterfall} waterfall
   * @param {import('./overlay.js').Overlay} overlay
   * @param {import('./feed.js').Feed} feed
   * @param {{onTop: (topS: number) => void, onKey: (windows: number) => void}} handlers
   */
  constructor(waterfall, overlay, feed, handlers) {
    this.waterfall = waterfall;
    this.overlay = overlay;
    this.feed = feed;
    this.root = byId('transport', HTMLElement);
    this.state = byId('transport-state', HTMLElement);
    this.back = byId('back-to-live', HTMLButtonElement);
    this.newPings = byId('new-pings', HTMLElement);
    this.waiting = byId('waiting', HTMLElement);
    this.timeline = new Timeline(
      byId('timeline', HTMLElement),
      byId('timeline-thumb', HTMLElement),
      handlers,
    );
    this.isReplay = false;
    /** @type {(paused: boolean) => void} */
    this.onPaused = () => {};
  }

  /** @param {{title: string, text: string} | null} waiting null when there is a picture */
  showWaiting(waiting) {
    this.waiting.hidden = waiting === null;
    this.root.hidden = waiting !== null;
    if (!waiting) return;
    setText(byId('waiting-title', HTMLElement), waiting.title);
    setText(byId('waiting-text', HTMLElement), waiting.text);
  }

  /** @param {number} newPings that came while paused */
  show(newPings) {
    const { view, hasData } = this.waterfall;
    if (!hasData) return;
    const { A, B } = this.feed.channels;
    const silentS = (performance.now() - Math.max(A.lastArrivalMs, B.lastArrivalMs)) / 1000;
    const kind = !view.live ? 'paused' : silentS < SILENT_AFTER_S ? 'live' : 'stale';
    if (this.state.dataset.state !== kind) this.state.dataset.state = kind;
    setText(this.state, this.words(kind, silentS));
    if (this.back.hidden !== view.live) this.back.hidden = view.live;
    setText(this.newPings, newPings > 0 ? `(${count(newPings)} new)` : '');
    this.onPaused(!view.live);
  }

  /**
   * An empty half of a live picture says why it is empty.
   * @param {boolean} isOpen without a connection the page itself is deaf
   */
  showSilence(isOpen) {
    const { feed, overlay, waterfall } = this;
    for (const name of /** @type {const} */ (['A', 'B'])) {
      const silentS = (performance.now() - feed.channels[name].lastArrivalMs) / 1000;
      const isSilent = isOpen && waterfall.view.live && silentS > SILENT_AFTER_S;
      const words = !isSilent ? '' : Number.isFinite(silentS) ? `silent for ${age(silentS)}` : 'no pings';
      if (overlay.silence[name] === words) continue;
      overlay.silence[name] = words;
      waterfall.invalidate();
    }
  }

  /** @param {'live' | 'paused' | 'stale'} kind @param {number} silentS */
  words(kind, silentS) {
    if (kind === 'live') return this.isReplay ? '\u25cf Replay' : '\u25cf Live';
    if (kind === 'paused') return `Paused at ${this.topLabel()}`;
    return Number.isFinite(silentS) ? `No new pings for ${age(silentS)}` : 'No live pings';
  }

  /** Time at the upper edge: of the day where it is known. */
  topLabel() {
    const { unixOffsetS } = this.overlay;
    const { topS } = this.waterfall;
    return Number.isFinite(unixOffsetS) ? clockTime(topS + unixOffsetS) : duration(topS);
  }

  showTimeline() {
    const { topS, windowS, newestS, view, hasData } = this.waterfall;
    if (!hasData) return;
    this.timeline.show({
      oldestS: this.feed.oldestS,
      newestS,
      topS: Math.min(topS, newestS),
      windowS,
      label: view.live ? 'live' : this.topLabel(),
      marks: this.overlay.markers.map((marker) => marker.spot.timeS),
    });
  }
}
