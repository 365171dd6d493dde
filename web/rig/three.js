// @ts-check
// The 3-D library, found beside the page. Without it the numbers work on and the page says what is missing.

/** @typedef {typeof import('../../scripts/three.mjs')} Three */

const ADDRESS = new URL('../vendor/three/three.js', import.meta.url).href;

/** @returns {Promise<Three | null>} */
export async function loadThree() {
  try {
    return await import(ADDRESS);
  } catch {
    return null;
  }
}
