// Copies the browser libraries that the pages use from node_modules to web/vendor (shipped, never committed).
import { copyFileSync, mkdirSync, readFileSync, writeFileSync } from 'node:fs';
import { dirname, join } from 'node:path';
import { build } from 'esbuild';

const FILES = {
  uplot: ['dist/uPlot.esm.js', 'dist/uPlot.min.css', 'LICENSE'],
  ol: ['LICENSE.md'],
  three: ['LICENSE'],
  'swagger-ui-dist': ['swagger-ui-bundle.js', 'swagger-ui.css', 'LICENSE'],
};

const versions = {};
for (const [name, files] of Object.entries(FILES)) {
  const source = join('node_modules', name);
  versions[name] = JSON.parse(readFileSync(join(source, 'package.json'), 'utf8')).version;
  for (const file of files) {
    const target = join('web/vendor', name, file);
    mkdirSync(dirname(target), { recursive: true });
    copyFileSync(join(source, file), target);
  }
}
// Libraries of hundreds of modules: the few that the pages use, as one file each.
const BUNDLES = {
  'scripts/openlayers.mjs': 'web/vendor/ol/ol.js',
  'scripts/three.mjs': 'web/vendor/three/three.js',
};
for (const [parts, outfile] of Object.entries(BUNDLES)) {
  await build({
    entryPoints: [parts],
    outfile,
    bundle: true,
    format: 'esm',
    minify: true,
    legalComments: 'none',
    logLevel: 'error',
  });
}
writeFileSync('web/vendor/versions.json', `${JSON.stringify(versions, null, 2)}\n`);
