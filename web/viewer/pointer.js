// @ts-check
/**
 * Mouse, wheel, pen and fingers on the picture.
 * Mouse: click drops a contact, drag measures, Shift-drag or middle-drag moves, wheel scrolls time, Ctrl-wheel zooms
 * range, Shift-wheel zooms time. Fingers: one moves, two zoom, a tap sets the cursor; with the measuring tool a drag
 * measures.
 */

/** @typedef {import('./stage.js').Stage} Stage */
/** @typedef {import('./overlay.js').Spot} Spot */

/**
 * @typedef {object} PointerHandlers
 * @property {(spot: Spot | null) => void} onHover
 * @property {(spot: Spot, clientX: number, clientY: number) => void} onClick of a mouse
 * @property {(spot: Spot) => void} onTap of a finger
 * @property {(from: Spot, to: Spot) => void} onMeasure
 * @property {() => boolean} measuring the measuring tool is chosen
 * @property {(seconds: number) => void} onScroll positive to older pings
 * @property {() => void} onMoved
 */

const DRAG_FROM_PX = 5;
const WHEEL_SHARE = 0.0012;
const ZOOM_PER_WHEEL_PX = 0.0015;
const LINE_PX = 16;

export class PointerControl {
  /** @param {Stage} stage @param {PointerHandlers} handlers */
  constructor(stage, handlers) {
    this.stage = stage;
    this.handlers = handlers;
    /** @type {Map<number, {x: number, y: number}>} */
    this.pointers = new Map();
    /** @type {'none' | 'maybe' | 'measure' | 'pan' | 'pinch'} */
    this.mode = 'none';
    /** @type {Spot | null} */
    this.startSpot = null;
    this.start = { x: 0, y: 0 };
    /** Where the mouse rests: the picture moves under it. @type {{x: number, y: number} | null} */
    this.hover = null;
    this.pinch = { distanceX: 0, distanceY: 0 };
    const { element } = stage;
    element.addEventListener('pointerdown', (event) => this.down(event));
    element.addEventListener('pointermove', (event) => this.move(event));
    element.addEventListener('pointerup', (event) => this.up(event));
    element.addEventListener('pointercancel', (event) => this.forget(event));
    element.addEventListener('pointerleave', (event) => {
      if (event.pointerType !== 'mouse' || this.mode !== 'none') return;
      this.hover = null;
      this.handlers.onHover(null);
    });
    element.addEventListener('wheel', (event) => this.wheel(event), { passive: false });
    element.addEventListener('contextmenu', (event) => event.preventDefault());
  }

  /** @param {PointerEvent} event */
  down(event) {
    if (event.target instanceof Element && event.target.closest('button')) return;
    if (event.button === 2) return;
    this.stage.element.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (this.pointers.size === 2) {
      this.mode = 'pinch';
      this.pinch = this.spread();
      return;
    }
    this.start = { x: event.clientX, y: event.clientY };
    this.startSpot = this.stage.spotAt(event.clientX, event.clientY);
    const pan = event.button === 1 || event.shiftKey;
    this.mode = pan ? 'pan' : 'maybe';
    if (event.button === 1) event.preventDefault();
  }

  /** @param {PointerEvent} event */
  move(event) {
    const last = this.pointers.get(event.pointerId);
    const spot = this.stage.spotAt(event.clientX, event.clientY);
    if (event.pointerType === 'mouse') {
      this.hover = { x: event.clientX, y: event.clientY };
      this.handlers.onHover(spot);
    }
    if (!last) return;
    if (this.mode === 'maybe') this.decide(event);
    if (this.mode === 'measure' && this.startSpot && spot) this.handlers.onMeasure(this.startSpot, spot);
    if (this.mode === 'pan') this.pan(event.clientX - last.x, event.clientY - last.y);
    last.x = event.clientX;
    last.y = event.clientY;
    if (this.mode === 'pinch') this.applyPinch();
  }

  /** The keyboard took the cursor. */
  release() {
    this.hover = null;
  }

  /** @returns {Spot | null} what lies under the resting mouse now */
  hovered() {
    return this.hover && this.mode === 'none' ? this.stage.spotAt(this.hover.x, this.hover.y) : null;
  }

  /** @param {PointerEvent} event */
  decide(event) {
    const distance = Math.hypot(event.clientX - this.start.x, event.clientY - this.start.y);
    if (distance < DRAG_FROM_PX) return;
    this.mode = event.pointerType === 'mouse' || this.handlers.measuring() ? 'measure' : 'pan';
  }

  /** @param {PointerEvent} event */
  up(event) {
    const known = this.pointers.has(event.pointerId);
    const mode = this.mode;
    this.forget(event);
    if (!known || mode !== 'maybe' || !this.startSpot) return;
    if (event.pointerType === 'mouse') this.handlers.onClick(this.startSpot, event.clientX, event.clientY);
    else this.handlers.onTap(this.startSpot);
  }

  /** @param {PointerEvent} event */
  forget(event) {
    this.pointers.delete(event.pointerId);
    // After a pinch the remaining finger must not jump the picture.
    this.mode = 'none';
  }

  /** @param {number} dx @param {number} dy CSS pixels */
  pan(dx, dy) {
    const { stage, handlers } = this;
    const { waterfall } = stage;
    handlers.onScroll(-dy * stage.dpr * waterfall.secondsPerRow);
    const pane = waterfall.panes.find((candidate) => candidate.channel === this.startSpot?.channel);
    if (!pane) return;
    const { fromM, toM } = waterfall.state;
    const metres = ((dx * stage.dpr) / pane.width) * (toM - fromM) * (pane.mirrored ? 1 : -1);
    if (waterfall.view.toM !== null || fromM > 0) waterfall.showRange(fromM + metres, toM - fromM);
  }

  spread() {
    const [a, b] = [...this.pointers.values()];
    return { distanceX: Math.abs(a.x - b.x), distanceY: Math.abs(a.y - b.y) };
  }

  applyPinch() {
    const [a, b] = [...this.pointers.values()];
    if (!a || !b) return;
    const { stage } = this;
    const now = this.spread();
    const x = (a.x + b.x) / 2;
    const y = (a.y + b.y) / 2;
    const spot = stage.spotAt(x, y);
    const before = Math.hypot(this.pinch.distanceX, this.pinch.distanceY);
    const after = Math.hypot(now.distanceX, now.distanceY);
    if (before < 20 || after < 20) return;
    const factor = before / after;
    // Mostly sideways: range; mostly up and down: time; between: both.
    const sideways = now.distanceX / after;
    if (sideways > 0.38 && spot) stage.waterfall.zoomRange(factor, spot.rangeM);
    if (sideways < 0.92) stage.waterfall.zoomTime(factor, stage.toPicture(x, y).y);
    this.pinch = now;
    this.handlers.onMoved();
  }

  /** @param {WheelEvent} event */
  wheel(event) {
    event.preventDefault();
    const { stage } = this;
    const { waterfall } = stage;
    const scale = event.deltaMode === 1 ? LINE_PX : event.deltaMode === 2 ? 400 : 1;
    // Some systems turn Shift-wheel sideways.
    const delta = (event.deltaY || event.deltaX) * scale;
    const { y } = stage.toPicture(event.clientX, event.clientY);
    if (event.ctrlKey || event.metaKey) {
      const spot = stage.spotAt(event.clientX, event.clientY);
      waterfall.zoomRange(Math.exp(delta * ZOOM_PER_WHEEL_PX), spot?.rangeM ?? 0);
    } else if (event.shiftKey) {
      waterfall.zoomTime(Math.exp(delta * ZOOM_PER_WHEEL_PX), y);
    } else {
      this.handlers.onScroll(delta * WHEEL_SHARE * waterfall.windowS);
    }
    this.handlers.onMoved();
  }
}
