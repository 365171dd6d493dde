// Copies the browser libraries that the pages use from node_modules to web/vendor (shipped, never committed).
import { copyFileSync, mkdirSync, readFileSync, writeFileSync } from 'node:fs';
import { dirname, join } from 'node:path';

const FILES = {
  uplot: ['dist/uPlot.esm.js', 'dist/uPlot.min.css', 'LICENSE'],
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
writeFileSync('web/vendor/versions.json', `${JSON.stringify(versions, null, 2)}\n`);
