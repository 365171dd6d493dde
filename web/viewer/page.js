// @ts-check
/** The page: one object that keys, pointer, tools and panels act on, and one place where a frame updates the words. */

import { call } from '../shared/api.js';
import { byId, setText } from '../shared/dom.js';
import { fixed, signed } from '../shared/format.js';
import { StatusStrip } from '../shared/status_strip.js';
import { startTheme, onThemeChange } from '../shared/theme.js';
import { ContactDesk } from './contact_desk.js';
import { showHelp, toast } from './dialogs.js';
import { Feed } from './feed.js';
import { listenToKeys } from './keyboard.js';
import { Looks } from './looks.js';
import { ContactsPanel } from './panel_contacts.js';
import { PicturePanel } from './panel_picture.js';
import { SonarPanel } from './panel_sonar.js';
import { PointerControl } from './pointer.js';
import { loadPreferences } from './preferences.js';
import { measure } from './ranging.js';
import { lossBetween } from './row_table.js';
import { Readout } from './readout.js';
import { saveSnapshot } from './snapshot.js';
import { Stage } from './stage.js';
import { FIRST_CHIPS, chipsOf, originOf, waitingText } from './status.js';
import { ToolBar } from './tools.js';
import { Track } from './track.js';
import { Transport } from './transport.js';

/** @typedef {import('./overlay.js').Spot} Spot */
/** @typedef {import('./ranging.js').Layout} Layout */
/** @typedef {'picture' | 'contacts' | 'sonar'} PanelName */

const SLOW_MS = 500;
const STALE_AFTER_S = 3;
const LOSS_WINDOW_S = 60;
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
    this.track = new Track();
    this.looks = new Looks(this.waterfall, this.overlay, this.preferences);
    this.desk = new ContactDesk(this.stage, this.track, byId('drop', HTMLFormElement), (topS) =>
      this.showTop(topS),
    );
    /** @type {any} */
    this.status = null;
    this.statusAtMs = -Infinity;
    /** @type {any} */
    this.vehicle = null;
    this.vehicleAtMs = -Infinity;
    this.newPings = 0;
    this.perS = { A: NaN, B: NaN };
    /** @type {Record<'A' | 'B', number>} */
    this.lastPingS = { A: NaN, B: NaN };
    /** @type {Spot | null} */
    this.keyboardMeasure = null;
    /** @type {PanelName | null} */
    this.openPanel = null;
    this.feed = new Feed(this.waterfall, {
      onText: (message) => this.takeText(message),
      onPing: (ping) => this.takePing(ping),
      onRestart: () => this.track.clear(),
      onState: (state) => {
        if (state.phase === 'open') void this.loadTrack();
        this.slowUpdate();
      },
      onHistory: () => this.historyCame(),
    });
    this.transport = new Transport(this.waterfall, this.overlay, this.feed, {
      onTop: (topS) => this.showTop(topS),
      onKey: (windows) => this.scroll(windows),
    });
    this.transport.onPaused = (paused) => this.tools?.showPaused(paused);
    this.makeParts();
  }

  makeParts() {
    this.strip = new StatusStrip(byId('strip', HTMLElement), FIRST_CHIPS);
    this.readout = new Readout(byId('readout', HTMLElement));
    this.tools = new ToolBar(byId('tools', HTMLElement), this);
    this.picturePanel = new PicturePanel(
      byId('panel-picture', HTMLElement),
      this.waterfall,
      this.looks,
      this.preferences,
    );
    this.contactsPanel = new ContactsPanel(
      byId('panel-contacts', HTMLElement),
      this.desk.list,
      this.waterfall,
      this.desk,
    );
    this.sonarPanel = new SonarPanel(byId('panel-sonar', HTMLElement));
    this.desk.onChange = (contacts) => {
      this.contactsPanel?.refresh();
      this.tools?.showContacts(contacts.length);
    };
    this.looks.onChange = () => {
      this.picturePanel?.refresh();
      this.picturePanel?.drawHistogram();
    };
    this.pointer = new PointerControl(this.stage, {
      onHover: (spot) => this.setCursor(spot),
      onClick: (spot, x, y) => this.desk.ask(spot, { x, y }),
      onTap: (spot) => this.setCursor(spot),
      onMeasure: (from, to) => this.showMeasurement(from, to),
      measuring: () => this.tools?.measuring ?? false,
      onScroll: (seconds) => this.scrollSeconds(seconds),
      onMoved: () => this.moved(),
    });
    this.stage.beforeAxes = () => this.followMouse();
    this.stage.onDrawn = () => this.frameDrawn();
    this.waterfall.onLevels = () => this.levelsMeasured();
  }

  start() {
    startTheme(null);
    onThemeChange(() => this.picturePanel?.drawHistogram());
    this.picturePanel?.refresh();
    byId('back-to-live', HTMLButtonElement).addEventListener('click', () => this.goLive());
    byId('panel-close', HTMLButtonElement).addEventListener('click', () => this.showPanel(null));
    byId('panel', HTMLElement).addEventListener('keydown', (event) => {
      if (event.key === 'Escape') this.showPanel(null);
    });
    listenToKeys(this);
    this.fadeWhenIdle();
    this.feed.start();
    this.desk.list.refresh().catch(() => {});
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

  get origin() {
    return originOf(this.status, this.feed.simulated);
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
    this.looks.setServiceMirror(status?.mirror === true);
    if (recordingChanged) this.desk.list.refresh().catch(() => {});
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

  /** Pings from before this page was opened, or while it was cut off, have places, too. */
  async loadTrack() {
    try {
      this.track.load(await call('api/track'));
    } catch {
      // Without it, places are known from now on.
    }
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
  }

  /** @param {number} unixS @param {number} monotonicS */
  noteClock(unixS, monotonicS) {
    const offset = unixS - monotonicS;
    // Steps of the wall clock count, its milliseconds of jitter would make the labels dance.
    if (Math.abs(offset - this.overlay.unixOffsetS) < 0.5) return;
    this.overlay.unixOffsetS = offset;
    this.desk.placeMarkers();
  }

  /* Every frame, and twice a second */

  /** The picture moves under a resting mouse: the cursor stays with the mouse, not with the ping. */
  followMouse() {
    const spot = this.desk.asking ? null : this.pointer?.hovered();
    if (spot) this.overlay.cursor = spot;
  }

  frameDrawn() {
    this.readout?.showCursor(
      this.overlay.cursor,
      this.waterfall,
      this.track,
      this.overlay.unixOffsetS,
      this.overlay.unit,
    );
    this.transport.show(this.newPings);
    this.transport.showTimeline();
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
      const ring = this.waterfall.live(name);
      const loss = lossBetween(ring, ring.newestS - LOSS_WINDOW_S, ring.newestS);
      channels[name] = { ageS: (now - lastArrivalMs) / 1000, perS: this.perS[name], missed, loss };
    }
    const { phase } = this.feed.connection.state;
    this.transport.showSilence(phase === 'open');
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
    const origin = this.origin;
    setText(byId('simulated', HTMLElement), origin);
    byId('simulated', HTMLElement).hidden = origin === '';
    this.transport.isReplay = origin === 'REPLAY';
    if (now - this.vehicleAtMs > STALE_AFTER_S * 1000) this.readout?.showVehicle(null);
    this.transport.showWaiting(waitingText(this.feed, this.waterfall.hasData, this.status));
    this.transport.show(this.newPings);
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
    this.looks.save();
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
    if (this.desk.asking) return;
    this.overlay.cursor = spot;
    this.waterfall.invalidate();
  }

  /** @param {number} dx @param {number} dy steps of 12 pixels */
  moveCursor(dx, dy) {
    const { waterfall, stage } = this;
    this.pointer?.release();
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
    this.pointer?.release();
    this.overlay.cursor = null;
    this.overlay.measurement = null;
    this.keyboardMeasure = null;
    this.tools?.setMeasuring(false);
    this.waterfall.invalidate();
  }

  dropContact() {
    this.desk.dropAtCursor();
  }

  /* Looks, for the keys */

  /** @param {Layout} layout */
  setLayout(layout) {
    this.looks.setLayout(layout);
  }

  nextLayout() {
    this.looks.nextLayout();
  }

  nextPalette() {
    toast(`Palette ${this.looks.nextPalette()}`);
  }

  invert() {
    this.looks.invert();
  }

  /** @param {number} db */
  changeGain(db) {
    toast(`Gain ${signed(this.looks.changeGain(db), 1)} dB`);
  }

  toggleAuto() {
    this.looks.setAutomatic(!this.waterfall.levels.automatic);
    toast(this.waterfall.levels.automatic ? 'Auto-level on' : 'Levels locked');
  }

  toggleGrid() {
    this.looks.toggleGrid();
  }

  mirror() {
    this.looks.mirror();
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
    if (name === 'contacts') this.desk.list.refresh().catch((error) => toast(error.message, 'fault'));
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
        origin: this.origin,
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
