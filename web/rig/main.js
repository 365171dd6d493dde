// @ts-check
// The rig's page: set points, poses and motions in, the stack and what is known of it out. The server computes.

import { call } from '../shared/api.js';
import { byId, make, setText } from '../shared/dom.js';
import { onThemeChange, startTheme } from '../shared/theme.js';
import { Player } from './player.js';
import { showMargins, showTruth } from './readouts.js';
import { StackView } from './stack_view.js';
import { loadThree } from './three.js';

const AXES = [
  ['x', 'mm', 'forward'],
  ['y', 'mm', 'right'],
  ['z', 'mm', 'down'],
  ['roll', '°', ''],
  ['pitch', '°', ''],
  ['yaw', '°', ''],
];
const DEMOS = { 'axis-limits': 'Axis limits', 'inverted-pairs': 'Inverted pairs', circle: 'Circle' };
const AIMS = { least_motion: 'least motion', conditioning: 'best conditioning', margin: 'largest margin' };
const PLATFORMS = 4;
const MISSING = 'The 3-D library is missing from this installation: reinstall it (or run make setup).';

/** Which platform the sliders move; null: all alike. @type {number | null} */
let which = null;
let points = Array.from({ length: PLATFORMS }, () => [0, 0, 0, 0, 0, 0]);
/** @type {StackView | null} */
let view = null;
/** @type {any} */
let motion = null;
let asked = 0;

const verdict = byId('verdict', HTMLParagraphElement);
const planned = byId('planned', HTMLParagraphElement);
const player = new Player((frame) => showFrame(frame));
/** @type {{slider: HTMLInputElement, number: HTMLInputElement}[]} */
let axes = [];

/** @param {unknown} error */
function complain(error) {
  verdict.dataset.state = 'fault';
  setText(verdict, error instanceof Error ? error.message : String(error));
}

/** @param {number[][]} rows */
const flat = (rows) => rows.flat().join(',');

/** @param {any} answer */
function showScene(answer) {
  view?.show(answer);
  showTruth(byId('truth', HTMLTableElement), answer.tool, answer.std);
  showMargins(byId('margins', HTMLDivElement), answer.platforms);
  const broken = answer.platforms.findIndex((/** @type {any} */ platform) => platform.broken);
  verdict.dataset.state = broken < 0 ? 'ok' : 'fault';
  setText(
    verdict,
    broken < 0
      ? 'Within reach'
      : `Out of reach at platform ${broken + 1}: ${answer.platforms[broken].broken}. Move back towards home.`,
  );
}

/** Asks for the scene at the set points; a later question makes an earlier answer worthless. */
async function refresh() {
  asked += 1;
  const mine = asked;
  try {
    const answer = await call(`api/rig/scene?set_points=${flat(points)}`);
    if (mine === asked) showScene(answer);
  } catch (error) {
    if (mine === asked) complain(error);
  }
}

/** @param {number} frame */
function showFrame(frame) {
  if (!motion) return;
  points = motion.set_points[frame];
  view?.show({
    base_mm: motion.base_mm[frame],
    arm_ends_mm: motion.arm_ends_mm[frame],
    plate_mm: motion.plate_mm[frame],
    tool_mm: motion.tool_mm[frame],
    tool_rotation: motion.tool_rotation[frame],
    covariance_mm2: null,
  });
  showAxes();
  showTruth(byId('truth', HTMLTableElement), motion.tool[frame], null);
  byId('margins', HTMLDivElement).replaceChildren(
    make('p', { class: 'note', text: 'Told when it stands still.' }),
  );
  verdict.dataset.state = motion.reach[frame] >= 0 ? 'ok' : 'fault';
  setText(verdict, `Moving; ${Math.round(100 * motion.reach[frame])} % of the rods' reach at home is left`);
  if (frame === motion.times_s.length - 1) refresh();
}

/** @param {string} query */
async function play(query) {
  try {
    const answer = await call(`api/rig/demo?${query}`, { timeoutMs: 60000 });
    asked += 1;
    motion = answer;
    player.load(answer.times_s);
  } catch (error) {
    complain(error);
  }
}

function showAxes() {
  const shown = points[which ?? 0];
  const alike =
    which !== null || points.every((point) => point.every((value, k) => Math.abs(value - shown[k]) < 5e-4));
  axes.forEach(({ slider, number }, k) => {
    slider.value = String(shown[k]);
    number.value = alike ? String(Math.round(shown[k] * 100) / 100) : '';
    number.placeholder = alike ? '' : 'differ';
  });
}

/**
 * @param {number} axis
 * @param {number} value
 */
function set(axis, value) {
  if (!Number.isFinite(value)) return;
  motion = null;
  player.close();
  points = points.map((point, place) =>
    which === null || which === place ? point.map((old, k) => (k === axis ? value : old)) : point,
  );
  showAxes();
  refresh();
}

/** @param {number[]} limits  of one platform, mm and degrees */
function buildAxes(limits) {
  axes = AXES.map(([name, unit, sense], k) => {
    const range = { min: String(-limits[k]), max: String(limits[k]) };
    const label = sense ? `${name}, ${unit}, positive ${sense}` : `${name}, ${unit}`;
    const slider = make('input', {
      type: 'range',
      step: String(limits[k] / 100),
      ...range,
      'aria-label': label,
    });
    const number = make('input', {
      class: 'field',
      type: 'number',
      step: 'any',
      'aria-label': `${label}, number`,
    });
    slider.addEventListener('input', () => set(k, Number(slider.value)));
    number.addEventListener('change', () => set(k, number.valueAsNumber));
    const row = make('div', { class: 'axis', title: sense ? `positive ${sense}` : null });
    row.append(make('span', { text: name }), slider, number, make('span', { class: 'unit', text: unit }));
    byId('axes', HTMLDivElement).append(row);
    return { slider, number };
  });
}

function buildWhich() {
  const box = byId('which', HTMLParagraphElement);
  const choices = [null, 0, 1, 2, 3];
  const buttons = choices.map((choice) =>
    make('button', {
      class: 'button',
      type: 'button',
      text: choice === null ? 'All' : String(choice + 1),
      'aria-label': choice === null ? 'All platforms alike' : `Platform ${choice + 1}`,
      'aria-pressed': String(choice === which),
      on: {
        click: () => {
          which = choice;
          buttons.forEach((button, k) => button.setAttribute('aria-pressed', String(choices[k] === choice)));
          showAxes();
        },
      },
    }),
  );
  const home = make('button', { class: 'button', type: 'button', text: 'Home' });
  home.addEventListener('click', () => play(`name=move&start=${flat(points)}&end=0,0,0,0,0,0`));
  box.append(...buttons, home);
}

/** @param {number[]} home  pose of the tool */
function buildPose(home) {
  const box = byId('pose', HTMLDivElement);
  const fields = AXES.map(([name, unit], k) => {
    const field = make('input', { class: 'field', type: 'number', step: 'any', value: String(home[k]) });
    box.append(make('label', { text: `${name}, ${unit}` }, field));
    return field;
  });
  const aim = byId('aim', HTMLSelectElement);
  for (const [value, text] of Object.entries(AIMS)) aim.append(make('option', { value, text }));
  byId('tool', HTMLFormElement).addEventListener('submit', async (event) => {
    event.preventDefault();
    const tool = fields.map((field) => field.value.trim() || 'x').join(',');
    delete planned.dataset.state;
    setText(planned, 'Planning...');
    try {
      const answer = await call(`api/rig/plan?tool=${tool}&aim=${aim.value}&start=${flat(points)}`);
      setText(planned, answer.words);
      planned.dataset.state = answer.reached ? 'ok' : 'fault';
      play(`name=move&start=${flat(points)}&end=${flat(answer.set_points)}`);
    } catch (error) {
      planned.dataset.state = 'fault';
      setText(planned, error instanceof Error ? error.message : String(error));
    }
  });
}

function buildMotions() {
  const box = byId('demos', HTMLParagraphElement);
  for (const [name, text] of Object.entries(DEMOS)) {
    const button = make('button', { class: 'button', type: 'button', text });
    button.addEventListener('click', () => play(`name=${name}`));
    box.append(button);
  }
  const form = byId('track', HTMLFormElement);
  form.addEventListener('submit', (event) => {
    event.preventDefault();
    const place = String(new FormData(form).get('transmitter')).replaceAll(/\s/g, '');
    play(`name=tracking&transmitter=${encodeURIComponent(place)}`);
  });
}

async function start() {
  startTheme(byId('theme', HTMLButtonElement));
  buildWhich();
  buildMotions();
  const three = await loadThree();
  if (three) {
    try {
      view = new StackView(three, byId('stack', HTMLCanvasElement));
      onThemeChange(() => view?.paint());
    } catch {
      // No WebGL: the numbers stay.
    }
  }
  if (!view) {
    const missing = byId('missing', HTMLParagraphElement);
    missing.hidden = false;
    setText(
      missing,
      three ? 'This browser shows no 3-D graphics (WebGL); the numbers beside are complete.' : MISSING,
    );
  }
  try {
    const limits = await call('api/rig/limits');
    buildAxes(limits.platform);
    buildPose(limits.home_tool);
    showAxes();
    await refresh();
  } catch (error) {
    complain(error);
  }
}

start();
