// @ts-check
// The card of the map: tools around the picture, what stands under the pointer, and words while nothing is known.

import { call } from '../shared/api.js';
import { inShownUnits, shownUnit, shownValue } from '../shared/display.js';
import { make, saveBlob, setText } from '../shared/dom.js';
import { age, fixed, geodetic, heading, isKnown } from '../shared/format.js';
import { currentTheme, onThemeChange } from '../shared/theme.js';
import { COLORINGS, lengthText } from './map_colors.js';
import { geoJsonOf, gpxOf } from './map_export.js';
import { MapView } from './map_view.js';
import { MapTiles } from './map_tiles.js';
import { MISSING_MAP, loadOpenLayers } from './openlayers.js';
import { STALE_S, ageS } from './model.js';
import { fileStamp } from './plot_export.js';
import { distanceAndBearing, niceStep, toGeodetic } from './local_frame.js';
import { Track } from './track.js';

const ZOOM_STEP = 1.6;
const SCALE_PX = 120;
/** Half a megabyte: some seconds on a slow tether. */
const TRACK_POINTS = 8_000;
const STORED_AS = 'bluerov-slam.map';
const TILES_STORED_AS = 'bluerov-slam.map-tiles';

export class MapCard {
  /**
   * @param {import('./card.js').Card} card
   * @param {import('./model.js').Model} model
   * @param {(track: Track) => void} onTrack  the track of before this page was opened is here
   */
  constructor(card, model, onTrack) {
    this.model = model;
    this.onTrack = onTrack;
    this.track = new Track();
    /** @type {import('./map_place.js').Scene} */
    this.scene = {
      track: this.track,
      coloring: COLORINGS[0],
      state: null,
      acoustics: null,
      stale: false,
      hasTiles: false,
      measure: [],
    };
    /** @type {MapView | null} */
    this.view = null;
    this.following = true;
    this.measuring = false;
    this.tilesWanted = true;
    this.hasCentred = false;
    this.legendKey = '';
    this.build(card);
    this.choose(stored(STORED_AS));
    this.showTiles(stored(TILES_STORED_AS) !== 'off');
    onThemeChange(() => this.choose(this.scene.coloring.key));
    void this.load();
  }

  /** @param {import('./card.js').Card} card */
  build(card) {
    const button = (
      /** @type {string} */ text,
      /** @type {string} */ title,
      /** @type {() => void} */ click,
      /** @type {boolean | null} */ pressed = null,
    ) =>
      make('button', {
        class: 'button',
        type: 'button',
        title,
        'aria-pressed': pressed === null ? null : String(pressed),
        text,
        on: { click },
      });
    this.followButton = button(
      'Follow',
      'Keep the vehicle in the picture',
      () => this.setFollowing(!this.following),
      true,
    );
    this.measureButton = button(
      'Measure',
      'Distance and bearing between two clicks',
      () => this.setMeasuring(!this.measuring),
      false,
    );
    this.tilesButton = button(
      'Tiles',
      'Your own map tiles below the track',
      () => this.showTiles(!this.tilesWanted),
      true,
    );
    // Only who has put tiles there needs a switch for them.
    this.tilesButton.hidden = true;
    this.select = make(
      'select',
      {
        class: 'field',
        'aria-label': 'Colour of the track',
        on: { change: () => this.choose(this.select?.value ?? '') },
      },
      ...COLORINGS.map((coloring) => make('option', { value: coloring.key, text: coloring.label })),
    );
    card.head.append(
      make('div', { class: 'tools' }, this.select),
      make(
        'div',
        { class: 'tools' },
        this.followButton,
        button('Fit', 'Show the whole track', () => this.fit()),
        this.measureButton,
        this.tilesButton,
        button('GeoJSON', 'Save the track as GeoJSON', () => this.save('geojson')),
        button('GPX', 'Save the track as GPX', () => this.save('gpx')),
      ),
    );
    this.sentence = make('p', { class: 'map-sentence', id: 'map-sentence' });
    this.cursor = make('p', { class: 'map-cursor' });
    this.scaleText = make('span');
    this.scaleBar = make('div', { class: 'map-scale', 'aria-hidden': 'true' }, this.scaleText);
    this.legend = make('div', { class: 'map-legend' });
    this.empty = make('p', { class: 'map-empty' });
    this.target = make('div', {
      class: 'map-target',
      tabindex: 0,
      role: 'application',
      'aria-label':
        'Map. Arrow keys move, plus and minus zoom, F follows, 0 shows the whole track, M measures with Enter.',
      'aria-describedby': 'map-sentence',
      on: {
        keydown: (/** @type {KeyboardEvent} */ event) => this.onKey(event),
      },
    });
    const zoom = (/** @type {string} */ text, /** @type {string} */ label, /** @type {number} */ factor) =>
      make('button', {
        class: 'icon-button',
        type: 'button',
        'aria-label': label,
        title: label,
        text,
        on: { click: () => this.view?.zoom(factor) },
      });
    card.add(
      this.sentence,
      make(
        'div',
        { class: 'map-area' },
        this.target,
        make(
          'div',
          { class: 'map-north', 'aria-label': 'North is up', role: 'img' },
          make('b', { text: 'N' }),
        ),
        make(
          'div',
          { class: 'map-zoom' },
          zoom('+', 'Closer', ZOOM_STEP),
          zoom('\u2212', 'Farther', 1 / ZOOM_STEP),
        ),
        this.empty,
        this.scaleBar,
        this.cursor,
      ),
      this.legend,
    );
    this.showWords();
  }

  async load() {
    const ol = await loadOpenLayers();
    if (!ol) {
      this.target?.replaceChildren(make('p', { class: 'notice', text: MISSING_MAP }));
      return;
    }
    if (!this.target) return;
    this.view = new MapView(ol, this.target, this.scene);
    this.view.map.on('pointermove', (event) => this.onPointer(event.pixel));
    this.view.map.on('pointerdrag', () => this.setFollowing(false));
    this.view.map.on('singleclick', (event) => this.onClick(event.pixel));
    this.view.view.on('change:resolution', () => this.showScale());
    this.showScale();
    this.center();
    this.tiles = new MapTiles(ol, this.view);
    this.tiles.want(this.tilesWanted);
    this.tiles.setOrigin(this.track.origin);
    await this.tiles.load();
    if (this.tilesButton) this.tilesButton.hidden = !this.tiles.exist;
  }

  /** @param {boolean} wanted */
  showTiles(wanted) {
    this.tilesWanted = wanted;
    this.tilesButton?.setAttribute('aria-pressed', String(wanted));
    this.tiles?.want(wanted);
    store(TILES_STORED_AS, wanted ? 'on' : 'off');
  }

  /** @param {number} nowMs  of the newest message of the topic */
  onNavigation(nowMs) {
    const state = this.model.navigation;
    if (!state) return;
    this.scene.state = state;
    if (this.track.setOrigin(state.origin)) {
      this.hasCentred = false;
      this.tiles?.setOrigin(this.track.origin);
      void this.fetchTrack();
    }
    const t = this.model.unixAt(nowMs);
    const { position } = state;
    this.track.add(
      t,
      position?.north_m,
      position?.east_m,
      position?.depth_m,
      state.ellipse?.major_m,
      state.velocity?.speed_mps,
      state.mode,
    );
    const fix = state.fix;
    if (fix) {
      this.track.addFix({
        t,
        northM: fix.north_m,
        eastM: fix.east_m,
        stdM: isKnown(fix.std_m) ? fix.std_m : NaN,
        source: String(fix.source),
        accepted: fix.accepted ?? null,
      });
    }
    this.center();
    this.showWords();
    this.view?.redraw();
  }

  /** @param {Record<string, any>} data  of the array's topic */
  onAcoustics(data) {
    const shows = data.beacon || data.fix || this.scene.acoustics?.beacon || this.scene.acoustics?.fix;
    this.scene.acoustics = data;
    if (shows) this.view?.redraw();
  }

  /** What was before this page was opened, and where the origin has moved to. */
  async fetchTrack() {
    try {
      this.track.load(await call(`api/navigation/track?points=${TRACK_POINTS}`));
    } catch {
      // The live track goes on without it; the page says elsewhere that the extension is silent.
      return;
    }
    this.tiles?.setOrigin(this.track.origin);
    this.onTrack(this.track);
    this.showLegend();
    this.view?.redraw();
  }

  center() {
    const position = this.scene.state?.position;
    if (!this.view || !isKnown(position?.north_m) || !isKnown(position?.east_m)) return;
    if (this.following || !this.hasCentred)
      this.view.follow(position.east_m, position.north_m, !this.hasCentred);
    this.hasCentred = true;
  }

  /** @param {number} nowMs */
  refresh(nowMs) {
    const seconds = ageS(this.model.navigationAtMs, nowMs);
    const stale = seconds !== null && seconds > STALE_S;
    if (stale !== this.scene.stale) {
      this.scene.stale = stale;
      this.view?.redraw();
    }
    if (stale) this.showWords(seconds);
    // Units of the settings may come after the map.
    this.showScale();
    this.showLegend();
  }

  /** @param {number | null} [oldS]  age of what is shown, once it is too old to be believed */
  showWords(oldS = null) {
    const state = this.scene.state;
    const known = isKnown(state?.position?.north_m);
    const text = typeof state?.text === 'string' ? inShownUnits(state.text) : 'Waiting for the navigator';
    if (this.sentence) {
      setText(this.sentence, oldS === null ? text : `${age(oldS)} ago: ${text}`);
      this.sentence.dataset.mode = oldS === null ? String(state?.mode ?? 'unknown') : 'stale';
    }
    if (!this.empty) return;
    this.empty.hidden = known || this.track.length > 0;
    setText(this.empty, known ? '' : inShownUnits(missing(state)));
  }

  /** @param {string} key */
  choose(key) {
    this.scene.coloring = COLORINGS.find((coloring) => coloring.key === key) ?? COLORINGS[0];
    if (this.select) this.select.value = this.scene.coloring.key;
    store(STORED_AS, this.scene.coloring.key);
    this.legendKey = '';
    this.showLegend();
    this.view?.redraw();
  }

  showLegend() {
    const { coloring } = this.scene;
    const [from, to] = coloring.ends(this.track);
    const hears = this.scene.acoustics?.enabled === true;
    const key = `${coloring.key} ${from} ${to} ${hears}`;
    if (!this.legend || key === this.legendKey) return;
    this.legendKey = key;
    this.legend.replaceChildren(
      make('span', { text: from }),
      make(
        'span',
        { class: 'map-palette', 'aria-hidden': 'true' },
        ...coloring.palette[currentTheme()].map((color) => {
          const step = make('i');
          step.style.background = color;
          return step;
        }),
      ),
      make('span', { text: to }),
      make('span', { class: 'map-line solid', text: 'known by fixes' }),
      make('span', { class: 'map-line broken', text: 'dead reckoning' }),
      make('span', { class: 'map-fix used', text: 'fix used' }),
      make('span', { class: 'map-fix refused', text: 'rejected' }),
      hears ? make('span', { class: 'map-fix acoustic', text: 'acoustic pulse' }) : '',
    );
  }

  showScale() {
    const resolution = this.view?.view.getResolution();
    if (!resolution || !this.scaleBar || !this.scaleText) return;
    const metres = 1 / (shownValue(1, 'm') ?? 1);
    const step = niceStep((SCALE_PX / 2) * (resolution / metres));
    this.scaleBar.style.width = `${(step * metres) / resolution}px`;
    setText(this.scaleText, `${step < 1 ? fixed(step, 2) : fixed(step, 0)} ${shownUnit('m')}`);
  }

  /** @param {boolean} on */
  setFollowing(on) {
    this.following = on;
    this.followButton?.setAttribute('aria-pressed', String(on));
    const position = this.scene.state?.position;
    if (on && isKnown(position?.north_m) && isKnown(position?.east_m))
      this.view?.follow(position.east_m, position.north_m, true);
  }

  fit() {
    this.setFollowing(false);
    this.view?.fit();
  }

  /** @param {boolean} on */
  setMeasuring(on) {
    this.measuring = on;
    this.measureButton?.setAttribute('aria-pressed', String(on));
    this.scene.measure = [];
    this.target?.classList.toggle('measuring', on);
    if (this.cursor) setText(this.cursor, on ? 'Click two points, or Enter at the cross' : '');
    this.view?.redraw();
  }

  /** @param {number[]} pixel */
  onClick(pixel) {
    const point = this.view?.at(pixel);
    if (!this.measuring || !point) return;
    this.scene.measure = this.scene.measure.length === 1 ? [this.scene.measure[0], point] : [point];
    this.onPointer(pixel);
    this.view?.redraw();
  }

  /** The middle of the picture is the keyboard's pointer; arrow keys move the picture under it. */
  measureAtCross() {
    const size = this.view?.map.getSize();
    if (!size) return;
    this.setFollowing(false);
    this.onClick([size[0] / 2, size[1] / 2]);
  }

  /** @param {number[]} pixel */
  onPointer(pixel) {
    const point = this.view?.at(pixel);
    if (!point || !this.cursor) return;
    const [first, second] = this.scene.measure;
    if (this.measuring && first) {
      const { distanceM, bearingDeg } = distanceAndBearing(first, second ?? point);
      setText(this.cursor, `${lengthText(distanceM, 1)}, bearing ${heading(bearingDeg)}\u00b0 true`);
      return;
    }
    const [eastM, northM] = point;
    const local = `N ${fixed(shownValue(northM, 'm'), 1)}  E ${fixed(shownValue(eastM, 'm'), 1)} ${shownUnit('m')}`;
    const { origin } = this.track;
    if (!origin) {
      setText(this.cursor, local);
      return;
    }
    const { latitudeDeg, longitudeDeg } = toGeodetic(origin, northM, eastM);
    setText(
      this.cursor,
      `${local}   ${geodetic(latitudeDeg, 'latitude')}, ${geodetic(longitudeDeg, 'longitude')}`,
    );
  }

  /** @param {KeyboardEvent} event */
  onKey(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const key = event.key.toLowerCase();
    if (key === 'f') this.setFollowing(!this.following);
    else if (key === '0') this.fit();
    else if (key === 'm') this.setMeasuring(!this.measuring);
    else if (event.key === 'Escape' && this.measuring) this.setMeasuring(false);
    else if (event.key === 'Enter' && this.measuring) this.measureAtCross();
    else if (event.key.startsWith('Arrow')) {
      this.setFollowing(false);
      return;
    } else return;
    event.preventDefault();
  }

  /** @param {'geojson' | 'gpx'} kind */
  save(kind) {
    const facts = { simulated: this.scene.state?.simulated === true };
    const text = kind === 'gpx' ? gpxOf(this.track, facts) : geoJsonOf(this.track, facts);
    if (text === null || this.track.length === 0) {
      if (this.cursor) setText(this.cursor, 'There is no track to save yet');
      return;
    }
    const type = kind === 'gpx' ? 'application/gpx+xml' : 'application/geo+json';
    saveBlob(new Blob([text], { type }), `track_${fileStamp(this.model.unixAt(performance.now()))}.${kind}`);
  }

  /** The tab was chosen: the picture has a size now. */
  show() {
    this.view?.map.updateSize();
    this.view?.redraw();
  }
}

/**
 * What a position waits for, in words: the navigator's own where it has some.
 * @param {Record<string, any> | null} state
 */
function missing(state) {
  if (!state) return 'No position yet: waiting for the navigator.';
  if (state.mode === 'off')
    return typeof state.text === 'string' ? state.text : 'Navigation is switched off.';
  const gps = Array.isArray(state.sensors)
    ? state.sensors.find((/** @type {any} */ s) => s?.id === 'gps')
    : null;
  const reason = typeof gps?.reason === 'string' && gps.reason ? `GPS: ${gps.reason}` : '';
  return `No position yet. ${reason || (typeof state.text === 'string' ? `${state.text}.` : '')}`.trim();
}

/**
 * @param {string} name
 * @returns {string}
 */
function stored(name) {
  try {
    return localStorage.getItem(name) ?? '';
  } catch {
    return '';
  }
}

/**
 * @param {string} name
 * @param {string} value
 */
function store(name, value) {
  try {
    localStorage.setItem(name, value);
  } catch {
    // No storage in a sandboxed iframe: it holds for this visit.
  }
}
