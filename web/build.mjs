// Bundles the pages into dist/, or with --tests the unit tests into .test/ (Node 20 does not run TypeScript by itself).
import { build } from 'esbuild';
import { cp, mkdir, readdir, rm } from 'node:fs/promises';

const here = new URL('.', import.meta.url).pathname;
const common = { absWorkingDir: here, bundle: true, format: 'esm', target: 'es2022', logLevel: 'warning', legalComments: 'eof' };

if (process.argv.includes('--tests')) {
  await rm(`${here}.test`, { recursive: true, force: true });
  const tests = (await readdir(`${here}test`)).filter((name) => name.endsWith('.test.ts'));
  await build({ ...common, entryPoints: tests.map((name) => `test/${name}`), outdir: '.test', outExtension: { '.js': '.mjs' }, platform: 'node' });
} else {
  await rm(`${here}dist`, { recursive: true, force: true });
  await mkdir(`${here}dist`, { recursive: true });
  const pages = { app: ['src/main.ts', 'src/app.css', 'src/index.html', 'index'], annotate: ['src/annotate/main.ts', 'src/annotate/annotate.css', 'src/annotate/annotate.html', 'annotate'] };
  for (const [name, [script, style, text, called]] of Object.entries(pages)) {
    await build({ ...common, entryPoints: { [name]: script }, outdir: 'dist', minify: true });
    await build({ ...common, entryPoints: { [name]: style }, outdir: 'dist', minify: true });
    await cp(`${here}${text}`, `${here}dist/${called}.html`);
  }
}
