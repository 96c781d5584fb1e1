// How the page copes with 8,000 strands × 200 frames: plays them, scrubs, and fetches every frame with all its detail.
//
//   node test/scale.mjs [STRANDS FRAMES]
//
// Chromium paints in software here (SwiftShader), so the figures are a lower bound.

import { chromium } from 'playwright-core';
import { serve } from './mock.mjs';

const [strands = 8000, frames = 200] = process.argv.slice(2).map(Number);
const mock = await serve({ strands, frames });
const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium',
  args: ['--no-sandbox', '--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--ignore-gpu-blocklist', '--disable-quic', '--no-first-run'],
});
const page = await browser.newPage({ viewport: { width: 1200, height: 720 } });
const devtools = await page.context().newCDPSession(page);
const heap = async () => {
  await devtools.send('HeapProfiler.collectGarbage');
  const { usedSize, backingStorageSize = 0 } = await devtools.send('Runtime.getHeapUsage');
  return { js: usedSize / 2 ** 20, buffers: backingStorageSize / 2 ** 20 };
};
const say = (what, value) => console.log(`${what.padEnd(46)} ${value}`);
const mb = (v) => `${v.toFixed(0)} MB`;

const opened = Date.now();
await page.goto(mock.url);
await page.evaluate(() => window.strandflow.ready);
say('first look, all strands drawn after', `${((Date.now() - opened) / 1000).toFixed(1)} s`);
const start = await heap();
say('heap, buffers at first', `${mb(start.js)}, ${mb(start.buffers)}`);

const played = await page.evaluate(async (ms) => {
  const { state, set } = window.strandflow;
  set({ playing: true });
  await new Promise((r) => setTimeout(r, 1500));
  const [a, from] = [state(), performance.now()];
  await new Promise((r) => setTimeout(r, ms));
  const [b, to] = [state(), performance.now()];
  set({ playing: false });
  return { shown: (b.framesPlayed - a.framesPlayed) / ((to - from) / 1000), drawn: (b.renders - a.renders) / ((to - from) / 1000), strands: b.strands, points: b.points, ms: b.drawMs };
}, 8000);
say('playing: frames shown, pictures drawn a second', `${played.shown.toFixed(1)}, ${played.drawn.toFixed(1)} (${played.strands} strands × ${played.points} points, ${played.ms.toFixed(0)} ms a picture)`);

const scrub = await page.evaluate(async (count) => {
  const { state, set } = window.strandflow;
  const took = [];
  for (let i = 0; i < 25; i++) {
    const frame = (i * 37) % count;
    const from = performance.now();
    set({ frame });
    const renders = state().renders;
    while (state().shownFrame !== frame || state().renders === renders) await new Promise((r) => requestAnimationFrame(r));
    took.push(performance.now() - from);
  }
  took.sort((a, b) => a - b);
  return { median: took[12], most: took[24] };
}, frames);
say('a scrub step to a frame far away, on the screen', `median ${scrub.median.toFixed(0)} ms, at most ${scrub.most.toFixed(0)} ms`);

const pass = await page.evaluate(async ({ count, all }) => {
  const { state, app } = window.strandflow;
  const { loader, requests } = await app;
  const paths = Array.from({ length: count }, (_, f) => `/api/strands/blend/${f}?first=0&count=${all}&stride=1&bits=16`);
  let most = 0;
  for (const path of paths) {
    const wanted = requests.binary(path, (body) => ({ xyz: new Uint16Array(body, 64) }), 'pass');
    // The page wants things of its own in between; what is of a lane is not given up for them.
    while (!loader.has(path)) {
      loader.want([wanted]);
      await new Promise((r) => setTimeout(r, 10));
    }
    most = Math.max(most, state().cacheBytes);
  }
  const s = state();
  return { most: most / 2 ** 20, now: s.cacheBytes / 2 ** 20, limit: s.cacheLimit / 2 ** 20, entries: s.cacheEntries, fetched: s.fetched, aborted: s.aborted };
}, { count: frames, all: strands });
const end = await heap();
say('every frame fetched with all detail: cache', `${mb(pass.now)}, at most ${mb(pass.most)} of ${mb(pass.limit)}; ${pass.entries} entries of ${pass.fetched} fetched, ${pass.aborted} given up`);
say('heap, buffers after it', `${mb(end.js)}, ${mb(end.buffers)}`);
await browser.close();
mock.close();
process.exit(pass.most <= pass.limit ? 0 : 1);
