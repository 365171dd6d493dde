// @ts-check
// One animation frame loop for all instruments; it sleeps while nothing moves.

/** @typedef {{frame: (elapsedS: number) => boolean}} Animated  frame answers whether it needs another */

/** @type {Set<Animated>} */
const awake = new Set();
let running = false;
let lastMs = 0;

/** @param {number} nowMs */
function tick(nowMs) {
  const elapsedS = Math.min(0.1, Math.max(0, (nowMs - lastMs) / 1000));
  lastMs = nowMs;
  for (const item of awake) if (!item.frame(elapsedS)) awake.delete(item);
  running = awake.size > 0;
  if (running) requestAnimationFrame(tick);
}

/**
 * Draw this at the next frame, and on until it rests.
 * @param {Animated} item
 */
export function wake(item) {
  awake.add(item);
  if (running) return;
  running = true;
  lastMs = performance.now();
  requestAnimationFrame(tick);
}
