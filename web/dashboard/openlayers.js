// @ts-check
// The map library, found beside the page. Without it the page works on and says what is missing.

/** @typedef {typeof import('../../scripts/openlayers.mjs')} OpenLayers */

const ADDRESS = new URL('../vendor/ol/ol.js', import.meta.url).href;

/** @returns {Promise<OpenLayers | null>} */
export async function loadOpenLayers() {
  try {
    return await import(ADDRESS);
  } catch {
    return null;
  }
}

export const MISSING_MAP =
  'The map library is missing from this installation: reinstall the extension (or run make setup).';
