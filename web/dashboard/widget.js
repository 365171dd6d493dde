// @ts-check
// The Cockpit widget: one panel of the dashboard, chosen by ?panel=attitude|depth|ctd|link, themed by ?theme=.

import { loadDisplaySettings, shownUnit, shownValue } from '../shared/display.js';
import { byId, make, setAttribute, setNumber, setText } from '../shared/dom.js';
import { fixed, heading, signed } from '../shared/format.js';
import { STATE_WORDS, asState, showState, stateIcon } from '../shared/status_icons.js';
import { startTheme } from '../shared/theme.js';
import { Attitude } from './attitude.js';
import { DepthGauge } from './depth_gauge.js';
import { DepthRate } from './depth_rate.js';
import {
  LINK_ITEMS,
  SCIENCE_CELLS,
  cellList,
  degrees,
  hero,
  instrumentCanvas,
  statusCells,
} from './live_layout.js';
import { Model, STALE_S, ageS } from './model.js';
import { Source } from './source.js';
import { ValueCell, cardAge } from './value_cell.js';

/**
 * @typedef {object} Panel
 * @property {string} title
 * @property {string} chip
 * @property {Node[]} nodes
 * @property {ValueCell[]} cells
 * @property {(model: Model) => void} update
 * @property {(model: Model) => number} knownAtMs
 */

/** @returns {Panel} */
function attitudePanel() {
  const canvas = instrumentCanvas('Artificial horizon');
  const horizon = new Attitude(canvas);
  const cells = [
    new ValueCell('roll', degrees),
    new ValueCell('pitch', degrees),
    new ValueCell('heading', (v) => (v === null ? '-' : `${heading(v)}\u00b0`)),
  ];
  return {
    title: 'Attitude',
    chip: 'imu',
    nodes: [canvas, cellList(...cells)],
    cells,
    update: (model) => horizon.show(model.reading('roll').value, model.reading('pitch').value),
    knownAtMs: (model) => model.reading('roll').atMs,
  };
}

/** @returns {Panel} */
function depthPanel() {
  const canvas = instrumentCanvas('Depth gauge');
  const gauge = new DepthGauge(canvas);
  const number = hero('m', 3.45);
  const rate = new DepthRate();
  const rateText = make('p', { class: 'hint' });
  return {
    title: 'Depth',
    chip: 'depth',
    nodes: [canvas, make('div', {}, number.root, rateText)],
    cells: [],
    update: (model) => {
      const depth = model.reading('depth').value;
      rate.add(model.sensors?.ts, depth);
      gauge.show(depth);
      setNumber(number.number, fixed(shownValue(depth, 'm'), 2));
      setText(number.unit, shownUnit('m'));
      setText(rateText, `Rate, est. ${signed(shownValue(rate.mps(), 'm/s'), 2)} ${shownUnit('m/s')}`);
    },
    knownAtMs: (model) => model.reading('depth').atMs,
  };
}

/** @returns {Panel} */
function ctdPanel() {
  const cells = SCIENCE_CELLS();
  return {
    title: 'Water',
    chip: 'ctd',
    nodes: [cellList(...cells)],
    cells,
    update: () => {},
    knownAtMs: (model) => model.reading('temperature').atMs,
  };
}

/** @returns {Panel} */
function linkPanel() {
  const { numbers, root } = statusCells();
  return {
    title: 'Link to the ESP32',
    chip: 'link',
    nodes: [root],
    cells: [],
    update: (model) => LINK_ITEMS.forEach((item, i) => setText(numbers[i], item.text(model.status ?? {}))),
    knownAtMs: (model) => model.statusAtMs,
  };
}

const PANELS = { attitude: attitudePanel, depth: depthPanel, ctd: ctdPanel, link: linkPanel };
const wanted = new URLSearchParams(location.search).get('panel') ?? 'attitude';
const name = Object.hasOwn(PANELS, wanted) ? /** @type {keyof typeof PANELS} */ (wanted) : 'attitude';

startTheme(null);
const model = new Model();
const panel = PANELS[name]();
const root = byId('widget', HTMLElement);
const icon = stateIcon();
const age = make('span', { class: 'card-age', text: '-' });
const simulated = make('span', { class: 'badge' });
simulated.hidden = true;
root.append(
  make('header', { class: 'widget-head' }, icon, make('span', { text: panel.title }), simulated, age),
  make('div', { class: `widget-body widget-${name}` }, ...panel.nodes),
);

function refresh() {
  const nowMs = performance.now();
  const seconds = ageS(panel.knownAtMs(model), nowMs);
  setText(age, cardAge(seconds));
  // Status comes once a second, so it is late only after the next one is missed too.
  root.classList.toggle('stale', seconds !== null && seconds > (name === 'link' ? 2 * STALE_S : STALE_S));
  for (const cell of panel.cells) cell.update(model, nowMs);
}

function showStatus() {
  const chip = (model.status?.chips ?? []).find(
    (/** @type {any} */ candidate) => candidate?.id === panel.chip,
  );
  const state = asState(chip?.state);
  showState(icon, state);
  setAttribute(icon, 'title', [STATE_WORDS[state], chip?.cause, chip?.cure].filter(Boolean).join(': '));
  const word =
    model.status?.source === 'replay' ? 'REPLAY' : model.status?.simulated === true ? 'SIMULATED' : '';
  setText(simulated, word);
  simulated.hidden = word === '';
}

new Source(
  (text) => {
    const changed = model.receive(text, performance.now());
    if (changed === 'status') showStatus();
    if (changed === 'sensors' || name === 'link') panel.update(model);
    refresh();
  },
  () => {},
).start();
setInterval(refresh, 250);
void loadDisplaySettings();
