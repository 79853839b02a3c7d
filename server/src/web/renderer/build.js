// Makes splat-renderer.js, one file without imports, of the versions in package.json: npm ci && npm run build
import { readFileSync } from 'node:fs';
import { build } from 'esbuild';

const { dependencies, devDependencies } = JSON.parse(readFileSync('package.json', 'utf8'));
const made = Object.entries({ ...dependencies, ...devDependencies }).map(([name, version]) => `${name} ${version}`);

await build({
  entryPoints: ['entry.js'],
  outfile: 'splat-renderer.js',
  bundle: true,
  minify: true,
  format: 'esm',
  target: 'es2022',
  legalComments: 'inline',
  banner: { js: `/* ${made.join(', ')}. MIT licences: NOTICE in the folder that this file is made in. */` },
});
