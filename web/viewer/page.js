// @ts-check
/** The page: one object that keys, pointer, tools and panels act on, and one place where a frame updates the words. */

import { call } from '../shared/api.js';
import { byId, setText } from '../shared/dom.js';
import { clockTime, count, duration, fixed, signed } from '../shared/format.js';
import { StatusStrip } from '../shared/status_strip.js';
import { startTheme, onThemeChange } from '../shared/theme.js';
import { ContactList, nextName } from './contacts.js';
import { showHelp, toast } from './dialogs.js';
import { Feed } from './feed.js';
import { listenToKeys } from './keyboard.js';
import { DEFAULT_GAIN } from './levels.js';
import { PALETTES } from './palettes.js';
import { ContactsPanel, askForContact } from './panel_contacts.js';
import { PicturePanel } from './panel_picture.js';
import { SonarPanel } from './panel_sonar.js';
import { PointerControl } from './pointer.js';
import { loadPreferences, savePreferences } from './preferences.js';
import { measure } from './ranging.js';
import { Readout, positionOf } from './readout.js';
import { saveSnapshot } from './snapshot.js';
import { Stage } from './stage.js';
import { FIRST_CHIPS, chipsOf, waitingText } from './status.js';
import { Timeline } from './timeline.js';
import { ToolBar } from './tools.js';
import { Track } from './track.js';

/** @typedef {import('./overlay.js').Spot} Spot */
/** @typedef {import('./contacts.js').Contact} Contact */
/** @typedef {import('./ranging.js').Layout} Layout */
/** @typedef {'picture' | 'contacts' | 'sonar'} PanelName */

const SLOW_MS = 500;
const STALE_AFTER_S = 3;
const IDLE_AFTER_MS = 6000;
const RATE_SMOOTHING = 0.1;
const PANEL_TITLES = { picture: 'Picture', contacts: 'Contacts', sonar: 'Sonar settings' };

/** @typedef {import('./keyboard.js').KeyActions} KeyActions */

/** @implements {KeyActions} */
export class ViewerPage {
  /** @param {HTMLElement} stageElement */
  constructor(stageElement) {
    this.preferences = loadPreferences();
    const { palette, inverted, layout, secondsPerPixel, gain } = this.preferences;
    this.stage = new Stage(
      stageElement,
      byId('picture', HTMLCanvasElement),
      byId('axes', HTMLCanvasElement),
      {
        view: { layout, secondsPerPixel },
        gain,
        palette,
        inverted,
      },
    );
    this.waterfall = this.stage.waterfall;
    this.overlay = this.stage.overlay;
    this.waterfall.levels.automatic = this.preferences.automatic;
    this.overlay.grid = this.preferences.grid;
    this.track = new Track();
    this.contacts = new ContactList();
    /** @type {any} */
    this.status = null;
    this.statusAtMs = -Infinity;
    /** @type {any} */
    this.vehicle = null;
    this.vehicleAtMs = -Infinity;
    this.serviceMirror = false;
    this.newPings = 0;
    this.perS = { A: NaN, B: NaN };
    /** @type {Record<'A' | 'B', number>} */
    this.lastPingS = { A: NaN, B: NaN };
    /** @type {Spot | null} */
    this.keyboardMeasure = null;
    this.dropping = false;
    /** @type {PanelName | null} */
    this.openPanel = null;
    this.feed = new Feed(this.waterfall, {
      onText: (message) => this.takeText(message),
      onPing: (ping) => this.takePing(ping),
      onRestart: () => this.track.clear(),
      onState: () => this.slowUpdate(),
      onHistory: () => this.historyCame(),
    });
    this.makeParts();
  }

  makeParts() {
    this.strip = new StatusStrip(byId('strip', HTMLElement), FIRST_CHIPS);
    this.readout = new Readout(byId('readout', HTMLElement));
    this.tools = new ToolBar(byId('tools', HTMLElement), this);
    this.timeline = new Timeline(byId('timeline', HTMLElement), byId('timeline-thumb', HTMLElement), {
      onTop: (topS) => this.showTop(topS),
      onKey: (windows) => this.scroll(windows),
    });
    this.picturePanel = new PicturePanel(
      byId('panel-picture', HTMLElement),
      this.waterfall,
      {
        setLayout: (layout) => this.setLayout(layout),
        setPalette: (palette, inverted) => this.setPalette(palette, inverted),
        setAutomatic: (automatic) => this.setAutomatic(automatic),
        setGain: (change) => this.setGain(change),
        setGrid: () => this.toggleGrid(),
        setMirrored: () => this.mirror(),
        resetGain: () => this.resetGain(),
      },
      { grid: this.preferences.grid, mirrored: this.preferences.mirrored },
    );
    this.contactsPanel = new ContactsPanel(
      byId('panel-contacts', HTMLElement),
      this.contacts,
      this.waterfall,
      {
        goTo: (contact) => this.goToContact(contact),
        timeOf: (contact) => this.timeOf(contact),
        dropAtCursor: () => this.dropContact(),
      },
    );
    this.sonarPanel = new SonarPanel(byId('panel-sonar', HTMLElement));
    this.contacts.onChange = () => this.contactsChanged();
    this.pointer = new PointerControl(this.stage, {
      onHover: (spot) => this.setCursor(spot),
      onClick: (spot, x, y) => this.askContact(spot, { x, y }),
      onTap: (spot) => this.setCursor(spot),
      onMeasure: (from, to) => this.showMeasurement(from, to),
      measuring: () => this.tools?.measuring ?? false,
      onScroll: (seconds) => this.scrollSeconds(seconds),
      onMoved: () => this.moved(),
    });
    this.stage.onDrawn = () => this.frameDrawn();
    this.waterfall.onLevels = () => this.levelsMeasured();
  }

  start() {
    startTheme(null);
    onThemeChange(() => this.picturePanel?.drawHistogram());
    this.applyMirror();
    this.picturePanel?.refresh();
    byId('back-to-live', HTMLButtonElement).addEventListener('click', () => this.goLive());
    byId('panel-close', HTMLButtonElement).addEventListener('click', () => this.showPanel(null));
    byId('panel', HTMLElement).addEventListener('keydown', (event) => {
      if (event.key === 'Escape') this.showPanel(null);
    });
    listenToKeys(this);
    this.fadeWhenIdle();
    this.feed.start();
    this.contacts.refresh().catch(() => {});
    this.slowUpdate();
    setInterval(() => this.slowUpdate(), SLOW_MS);
  }

  fadeWhenIdle() {
    let timer = 0;
    const awake = () => {
      document.body.classList.remove('idle');
      clearTimeout(timer);
      timer = window.setTimeout(() => document.body.classList.add('idle'), IDLE_AFTER_MS);
    };
    for (const name of ['pointermove', 'pointerdown', 'keydown'])
      window.addEventListener(name, awake, { passive: true });
    awake();
  }

  /* What arrives */

  /** @param {any} message */
  takeText(message) {
    if (message?.topic === 'status') this.takeStatus(message.data);
    else if (message?.topic === 'sonar') this.takeSonar(message.data);
    else if (message?.topic === 'vehicle') this.takeVehicle(message.data);
  }

  /** @param {any} status */
  takeStatus(status) {
    const recordingChanged = this.status && this.status.recording !== status?.recording;
    this.status = status;
    this.statusAtMs = performance.now();
    const mirror = status?.mirror === true;
    if (mirror !== this.serviceMirror) {
      this.serviceMirror = mirror;
      this.applyMirror();
    }
    if (recordingChanged) this.contacts.refresh().catch(() => {});
  }

  /** @param {any} sonar */
  takeSonar(sonar) {
    this.sonarPanel?.update(sonar);
    for (const channel of /** @type {const} */ (['A', 'B'])) {
      this.feed.coarseRangeM[channel] = sonar?.[channel]?.read?.range_m ?? NaN;
    }
  }

  /** @param {any} vehicle */
  takeVehicle(vehicle) {
    this.vehicle = vehicle;
    this.vehicleAtMs = performance.now();
    const { newestS } = this.waterfall;
    if (Number.isFinite(newestS)) this.track.add({ ...vehicle, timeS: newestS });
    this.readout?.showVehicle(vehicle);
  }

  /** @param {import('./decoding.js').Ping} ping */
  takePing(ping) {
    this.noteClock(ping.timeUnixS, ping.monotonicS);
    const interval = ping.monotonicS - this.lastPingS[ping.channel];
    if (interval > 0) {
      const rate = 1 / this.waterfall.live(ping.channel).currentPeriodS;
      const before = this.perS[ping.channel];
      this.perS[ping.channel] = Number.isFinite(before) ? before + (rate - before) * RATE_SMOOTHING : rate;
    }
    this.lastPingS[ping.channel] = ping.monotonicS;
    if (!this.waterfall.view.live) this.newPings += 1;
  }

  historyCame() {
    const ring = this.waterfall.live('A').length ? this.waterfall.live('A') : this.waterfall.live('B');
    if (!ring.length || Number.isFinite(this.overlay.unixOffsetS)) return;
    const slot = ring.slot(ring.length - 1);
    this.noteClock(ring.unixS[slot], ring.timeS[slot]);
    this.contactsChanged();
  }

  /** @param {number} unixS @param {number} monotonicS */
  noteClock(unixS, monotonicS) {
    const offset = unixS - monotonicS;
    // Steps of the wall clock count, its milliseconds of jitter would make the labels dance.
    if (Math.abs(offset - this.overlay.unixOffsetS) < 0.5) return;
    this.overlay.unixOffsetS = offset;
    this.placeMarkers();
  }

  /* Every frame, and twice a second */

  frameDrawn() {
    this.readout?.showCursor(
      this.overlay.cursor,
      this.waterfall,
      this.track,
      this.overlay.unixOffsetS,
      this.overlay.unit,
    );
    this.showTransport();
    if (this.waterfall.hasData) this.showTimeline();
  }

  levelsMeasured() {
    this.picturePanel?.drawHistogram();
    if (this.openPanel === 'picture') this.picturePanel?.refresh();
  }

  slowUpdate() {
    const now = performance.now();
    const channels = /** @type {any} */ ({});
    for (const name of /** @type {const} */ (['A', 'B'])) {
      const { lastArrivalMs, missed } = this.feed.channels[name];
      channels[name] = { ageS: (now - lastArrivalMs) / 1000, perS: this.perS[name], missed };
    }
    const { phase } = this.feed.connection.state;
    this.strip?.update(
      chipsOf({
        phase,
        coarse: this.feed.coarse,
        status: this.status,
        statusAgeS: (now - this.statusAtMs) / 1000,
        channels,
        malformed: this.feed.malformed,
      }),
    );
    this.strip?.setStale(phase !== 'open');
    this.overlay.unit = this.feed.coarse && !(this.feed.coarseRangeM.A > 0) ? 'bin' : 'm';
    byId('simulated', HTMLElement).hidden = !(this.status?.simulated ?? this.feed.simulated);
    if (now - this.vehicleAtMs > STALE_AFTER_S * 1000) this.readout?.showVehicle(null);
    this.showWaiting();
    this.showTransport();
  }

  showWaiting() {
    const waiting = waitingText(this.feed, this.waterfall.hasData, this.status);
    byId('waiting', HTMLElement).hidden = waiting === null;
    byId('transport', HTMLElement).hidden = waiting !== null;
    if (!waiting) return;
    setText(byId('waiting-title', HTMLElement), waiting.title);
    setText(byId('waiting-text', HTMLElement), waiting.text);
  }

  showTransport() {
    const { view, hasData } = this.waterfall;
    if (!hasData) return;
    const state = byId('transport-state', HTMLElement);
    const latest = Math.max(this.feed.channels.A.lastArrivalMs, this.feed.channels.B.lastArrivalMs);
    const silentS = (performance.now() - latest) / 1000;
    const silent = !(silentS < STALE_AFTER_S);
    const kind = !view.live ? 'paused' : silent ? 'stale' : 'live';
    if (state.dataset.state !== kind) state.dataset.state = kind;
    const words = Number.isFinite(silentS) ? `No new pings for ${duration(silentS)}` : 'No live pings';
    setText(
      state,
      kind === 'live' ? '\u25cf Live' : kind === 'stale' ? words : `Paused at ${this.topLabel()}`,
    );
    const back = byId('back-to-live', HTMLButtonElement);
    if (back.hidden !== view.live) back.hidden = view.live;
    setText(byId('new-pings', HTMLElement), this.newPings > 0 ? `(${count(this.newPings)} new)` : '');
    this.tools?.showPaused(!view.live);
  }

  topLabel() {
    const { unixOffsetS } = this.overlay;
    const { topS } = this.waterfall;
    return Number.isFinite(unixOffsetS) ? clockTime(topS + unixOffsetS) : duration(topS);
  }

  showTimeline() {
    const { topS, windowS, newestS } = this.waterfall;
    this.timeline?.show({
      oldestS: this.feed.oldestS,
      newestS,
      topS: Math.min(topS, newestS),
      windowS,
      label: this.waterfall.view.live ? 'live' : this.topLabel(),
      marks: this.overlay.markers.map((marker) => marker.spot.timeS),
    });
  }

  /* Time and range */

  togglePause() {
    if (this.waterfall.view.live) this.waterfall.pause();
    else this.goLive();
  }

  goLive() {
    this.newPings = 0;
    this.waterfall.goLive();
    this.moved();
  }

  goOldest() {
    this.showTop(-Infinity);
  }

  /** @param {number} topS */
  showTop(topS) {
    this.waterfall.showTop(topS, this.feed.oldestS);
    this.moved();
  }

  /** @param {number} windows */
  scroll(windows) {
    this.scrollSeconds(windows * this.waterfall.windowS);
  }

  /** @param {number} seconds */
  scrollSeconds(seconds) {
    this.waterfall.scroll(seconds, this.feed.oldestS);
    this.moved();
  }

  moved() {
    if (this.waterfall.view.live) this.newPings = 0;
    this.preferences.secondsPerPixel = this.waterfall.view.secondsPerPixel;
    this.save();
    this.feed.moved();
  }

  /** @param {number} factor */
  zoomRange(factor) {
    this.waterfall.zoomRange(factor, this.overlay.cursor?.rangeM ?? 0);
  }

  wholeRange() {
    this.waterfall.showRange(0, Infinity);
  }

  /** @param {number} factor */
  zoomTime(factor) {
    this.waterfall.zoomTime(factor, 0);
    this.moved();
  }

  /* Cursor, measuring, contacts */

  /** @param {Spot | null} spot */
  setCursor(spot) {
    if (this.dropping) return;
    this.overlay.cursor = spot;
    this.waterfall.invalidate();
  }

  /** @param {number} dx @param {number} dy steps of 12 pixels */
  moveCursor(dx, dy) {
    const { waterfall, stage } = this;
    const pane =
      waterfall.panes.find((p) => p.channel === this.overlay.cursor?.channel) ?? waterfall.panes.at(-1);
    if (!pane) return;
    const step = 8 * stage.dpr;
    const from = this.overlay.cursor;
    const x = (from ? waterfall.xAt(pane, from.rangeM) : pane.x + pane.width / 2) + dx * step;
    const y = (from ? waterfall.yAtTime(pane, from.timeS) : pane.y + pane.height / 2) + dy * step;
    const box = stage.element.getBoundingClientRect();
    const spot = stage.spotAt(box.left + x / stage.dpr, box.top + stage.overlay.rulerPx + y / stage.dpr);
    if (!spot) return;
    this.setCursor(spot);
    if (this.keyboardMeasure) this.showMeasurement(this.keyboardMeasure, spot);
  }

  measurePoint() {
    const { cursor } = this.overlay;
    if (!cursor) {
      this.moveCursor(0, 0);
      toast('Move the cursor with Shift and the arrows, then press M again.');
    } else if (this.keyboardMeasure) this.keyboardMeasure = null;
    else this.keyboardMeasure = { ...cursor };
  }

  /** @param {Spot} from @param {Spot} to */
  showMeasurement(from, to) {
    const { acrossM, alongS } = measure(from, to);
    const label = `${fixed(acrossM, 2)} ${this.overlay.unit} across, ${fixed(alongS, 1)} s along`;
    this.overlay.measurement = { from: { ...from }, to: { ...to }, label };
    this.waterfall.invalidate();
  }

  clear() {
    this.overlay.cursor = null;
    this.overlay.measurement = null;
    this.keyboardMeasure = null;
    this.tools?.setMeasuring(false);
    this.waterfall.invalidate();
  }

  dropContact() {
    const { cursor } = this.overlay;
    const at = cursor && this.overlay.locate(cursor);
    if (!cursor || !at) {
      toast('First put the cursor on an echo: tap it, or Shift and the arrows.');
      return;
    }
    const box = this.stage.element.getBoundingClientRect();
    this.askContact(cursor, { x: box.left + at.x, y: box.top + at.y });
  }

  /** @param {Spot} spot @param {{x: number, y: number}} at */
  askContact(spot, at) {
    this.overlay.cursor = { ...spot };
    this.dropping = true;
    this.waterfall.invalidate();
    const where = `${fixed(spot.rangeM, 1)} ${this.overlay.unit} ${spot.channel === 'A' ? 'starboard' : 'port'}`;
    askForContact(
      byId('drop', HTMLFormElement),
      at,
      where,
      nextName(this.contacts.contacts),
      async (name, note) => {
        await this.contacts.add(this.contactAt(spot, name, note));
        toast(`${name} saved`);
      },
      () => {
        this.dropping = false;
        this.stage.element.focus({ preventScroll: true });
      },
    );
  }

  /** @param {Spot} spot @param {string} name @param {string} note */
  contactAt(spot, name, note) {
    const pane = this.waterfall.panes.find((candidate) => candidate.channel === spot.channel);
    const ping = pane ? this.waterfall.pingAt(pane, this.waterfall.yAtTime(pane, spot.timeS)) : -1;
    const position = positionOf(spot, this.track);
    const unixS = spot.timeS + this.overlay.unixOffsetS;
    return {
      name,
      note,
      channel: spot.channel,
      ping_number: typeof ping === 'number' ? null : ping.ring.number[ping.slot],
      range_m: Math.round(spot.rangeM * 1000) / 1000,
      time_unix_s: Number.isFinite(unixS) ? unixS : null,
      latitude_deg: position?.latitudeDeg ?? null,
      longitude_deg: position?.longitudeDeg ?? null,
    };
  }

  /** @param {Contact} contact on the page's time axis; NaN while the wall clock is unknown */
  timeOf(contact) {
    return (contact.time_unix_s ?? NaN) - this.overlay.unixOffsetS;
  }

  contactsChanged() {
    this.placeMarkers();
    this.contactsPanel?.refresh();
    this.tools?.showContacts(this.contacts.contacts.length);
  }

  placeMarkers() {
    this.overlay.markers = this.contacts.contacts
      .filter((contact) => contact.range_m !== null && Number.isFinite(this.timeOf(contact)))
      .map((contact) => ({
        spot: { channel: contact.channel, rangeM: contact.range_m ?? 0, timeS: this.timeOf(contact) },
        name: contact.name,
        selected: false,
      }));
    this.waterfall.invalidate();
  }

  /** @param {Contact} contact */
  goToContact(contact) {
    const timeS = this.timeOf(contact);
    if (!Number.isFinite(timeS)) {
      toast('The time of this contact is not known, so it cannot be shown.', 'fault');
      return;
    }
    for (const marker of this.overlay.markers) marker.selected = marker.spot.timeS === timeS;
    this.showTop(timeS + this.waterfall.windowS / 2);
  }

  /* Looks */

  /** @param {Layout} layout */
  setLayout(layout) {
    this.waterfall.view.layout = layout;
    this.preferences.layout = layout;
    this.waterfall.layOut();
    this.lookChanged();
  }

  nextLayout() {
    /** @type {Layout[]} */
    const order = ['side', 'stacked', 'B', 'A'];
    this.setLayout(order[(order.indexOf(this.waterfall.view.layout) + 1) % order.length]);
  }

  /** @param {string} palette @param {boolean} inverted */
  setPalette(palette, inverted) {
    this.waterfall.setPalette(palette, inverted);
    Object.assign(this.preferences, { palette, inverted });
    this.lookChanged();
    this.picturePanel?.drawHistogram();
  }

  nextPalette() {
    const index = PALETTES.findIndex((palette) => palette.id === this.waterfall.palette);
    const next = PALETTES[(index + 1) % PALETTES.length];
    this.setPalette(next.id, this.waterfall.inverted);
    toast(`Palette ${next.label}`);
  }

  invert() {
    this.setPalette(this.waterfall.palette, !this.waterfall.inverted);
  }

  /** @param {Partial<import('./gain.js').GainSettings>} change */
  setGain(change) {
    const { levels } = this.waterfall;
    Object.assign(levels.gain, change);
    if ('black' in change || 'white' in change) this.setAutomatic(false);
    this.preferences.gain = { ...levels.gain };
    this.waterfall.gainChanged('tvg' in change || 'spreadingDb' in change || 'absorptionDbPerM' in change);
    this.lookChanged();
  }

  /** @param {number} db */
  changeGain(db) {
    const gainDb = Math.min(24, Math.max(-24, this.waterfall.levels.gain.gainDb + db));
    this.setGain({ gainDb });
    toast(`Gain ${signed(gainDb, 1)} dB`);
  }

  /** @param {boolean} automatic */
  setAutomatic(automatic) {
    this.waterfall.levels.automatic = automatic;
    this.preferences.automatic = automatic;
    if (automatic) this.waterfall.gainChanged(true);
    this.lookChanged();
  }

  toggleAuto() {
    this.setAutomatic(!this.waterfall.levels.automatic);
    toast(this.waterfall.levels.automatic ? 'Auto-level on' : 'Levels locked');
  }

  resetGain() {
    Object.assign(this.waterfall.levels.gain, DEFAULT_GAIN);
    this.setAutomatic(true);
  }

  toggleGrid() {
    this.overlay.grid = !this.overlay.grid;
    this.preferences.grid = this.overlay.grid;
    this.lookChanged();
  }

  mirror() {
    this.preferences.mirrored = !this.preferences.mirrored;
    this.applyMirror();
    this.lookChanged();
  }

  /** The setting of the vehicle and the switch of this page together. */
  applyMirror() {
    this.waterfall.view.swapped = this.preferences.mirrored !== this.serviceMirror;
    this.waterfall.layOut();
  }

  lookChanged() {
    this.save();
    this.picturePanel?.refresh();
    this.waterfall.invalidate();
  }

  save() {
    savePreferences(this.preferences);
  }

  /* Panels and the rest */

  /** @param {PanelName} name */
  togglePanel(name) {
    this.showPanel(this.openPanel === name ? null : name);
  }

  /** @param {PanelName | null} name */
  showPanel(name) {
    const before = this.openPanel;
    this.openPanel = name;
    byId('panel', HTMLElement).hidden = name === null;
    for (const each of /** @type {PanelName[]} */ (['picture', 'contacts', 'sonar'])) {
      byId(`panel-${each}`, HTMLElement).hidden = each !== name;
    }
    this.tools?.showPanel(name);
    if (name === null) {
      if (before) this.tools?.focusPanel(before);
      return;
    }
    setText(byId('panel-title', HTMLElement), PANEL_TITLES[name]);
    byId('panel-title', HTMLElement).focus({ preventScroll: true });
    if (name === 'picture') this.levelsMeasured();
    if (name === 'contacts') this.contacts.refresh().catch((error) => toast(error.message, 'fault'));
    if (name === 'sonar')
      call('api/sonar')
        .then((sonar) => this.takeSonar(sonar))
        .catch(() => {});
  }

  async snapshot() {
    const { gain } = this.waterfall.levels;
    try {
      await saveSnapshot(this.stage, {
        vehicle: performance.now() - this.vehicleAtMs < STALE_AFTER_S * 1000 ? this.vehicle : null,
        simulated: this.status?.simulated ?? this.feed.simulated,
        unixOffsetS: this.overlay.unixOffsetS,
        gainText: `Gain ${signed(gain.gainDb, 1)} dB, time-varied gain ${gain.tvg === 'off' ? 'off' : gain.tvg}`,
      });
      toast('Snapshot saved');
    } catch (error) {
      toast(error instanceof Error ? error.message : String(error), 'fault');
    }
  }

  fullScreen() {
    if (document.fullscreenElement) document.exitFullscreen();
    else
      document.documentElement
        .requestFullscreen?.()
        .catch(() => toast('Full screen is not allowed here.', 'fault'));
  }

  theme() {
    this.tools?.switchTheme();
  }

  help() {
    showHelp();
  }
}
