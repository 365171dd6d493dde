// The parts of OpenLayers that the map uses, as one module beside the page (see vendor.mjs).
export { default as Map } from 'ol/Map.js';
export { default as View } from 'ol/View.js';
export { default as Layer } from 'ol/layer/Layer.js';
export { default as TileLayer } from 'ol/layer/Tile.js';
export { default as XYZ } from 'ol/source/XYZ.js';
export { default as Projection } from 'ol/proj/Projection.js';
export { addCoordinateTransforms, addProjection } from 'ol/proj.js';
export { defaults as defaultInteractions } from 'ol/interaction/defaults.js';
