// Drives the page of `strandflow annotate` in a real Chromium: labels, paints, sketches, undoes; kills the program and the
// browser, and looks whether everything is still there.
//
//   node test/annotate.mjs PROGRAM TAKE TRUTH OUTDIR
//
// TRUTH is a file of marker labels; TAKE has none yet. Writes screenshots to OUTDIR; exit code 0 if all is as it should be.
// With PAGE=dist the page comes from dist/. CHROMIUM names another browser than /usr/bin/chromium.

import { spawn } from 'node:child_process';
import { access, mkdir, readFile } from 'node:fs/promises';
import { createInterface } from 'node:readline';
import { chromium } from 'playwright-core';

const [program, take, truthFile, out] = process.argv.slice(2);
if (!out) {
  console.error('usage: node test/annotate.mjs PROGRAM TAKE TRUTH OUTDIR');
  process.exit(2);
}
await mkdir(out, { recursive: true });
const truth = JSON.parse(await readFile(truthFile, 'utf8'));
const ARGS = ['--no-sandbox', '--disable-quic', '--no-first-run', '--disable-background-networking', '--disable-component-update', '--disable-sync'];

const started = Date.now();
const wrong = [];
const check = (is, what) => {
  if (!is) wrong.push(what);
  console.log(`${is ? '  ok ' : 'WRONG'} ${((Date.now() - started) / 1000).toFixed(1).padStart(5)} s  ${what}`);
};

/** Starts the program; resolves with the address that it prints. */
async function serve(port) {
  const child = spawn(program, ['annotate', take, '--port', String(port)], { stdio: ['ignore', 'pipe', 'ignore'] });
  for await (const line of createInterface({ input: child.stdout })) return { child, url: line.trim() };
  throw new Error('the program printed no address');
}
const ended = (child) => new Promise((done) => child.once('exit', done));
const file = (path) => readFile(`${take}/user/${path}`);
const isThere = (path) => access(`${take}/user/${path}`).then(() => true, () => false);
const labels = async () => JSON.parse(await file('marker_labels.json'));

let server = await serve(0);
const port = new URL(server.url).port;
const browser = await chromium.launch({ executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium', headless: true, args: ARGS });
const trouble = [];
try {
  const context = await browser.newContext({ viewport: { width: 1280, height: 760 }, colorScheme: 'dark' });
  let page;
  /** Documents that were asked for. */
  const asked = [];
  const open = async (url) => {
    page = await context.newPage();
    page.setDefaultTimeout(10000);
    page.on('console', (m) => ['error', 'warning'].includes(m.type()) && trouble.push(`console: ${m.text()}`));
    page.on('pageerror', (e) => trouble.push(`exception: ${e.message}`));
    page.on('response', (r) => r.status() >= 400 && trouble.push(`${r.status()} ${new URL(r.url()).pathname}`));
    page.on('request', (r) => {
      const to = new URL(r.url());
      if (r.method() === 'GET' && /^\/api\/(labels|mask|sketches)/.test(to.pathname)) asked.push(to.pathname);
      if (['http:', 'https:', 'ws:', 'wss:'].includes(to.protocol) && to.host !== `127.0.0.1:${port}`) trouble.push(`request to another host: ${to.host}`);
    });
    if (process.env.PAGE) {
      const types = { html: 'text/html', js: 'text/javascript', css: 'text/css' };
      await page.route((to) => ['/', '/app.js', '/app.css'].includes(to.pathname), (route) => {
        const ending = { '/': 'html', '/app.js': 'js', '/app.css': 'css' }[new URL(route.request().url()).pathname];
        return route.fulfill({ path: new URL(`../${process.env.PAGE}/annotate.${ending}`, import.meta.url).pathname, contentType: types[ending] });
      });
    }
    await page.goto(url);
    await page.evaluate(() => window.strandflow.ready);
  };
  const state = () => page.evaluate(() => window.strandflow.state());
  const set = (change) => page.evaluate((c) => window.strandflow.set(c), change);
  const rest = () => page.waitForFunction(() => window.strandflow.state().atRest, null, { polling: 30 }).then(state);
  const shot = (name) => page.screenshot({ path: `${out}/${name}.png` });
  const key = async (...names) => { for (const name of names) await page.keyboard.press(name); };
  const move = async (at) => page.mouse.move(...(await page.evaluate((p) => window.strandflow.place(p), at)));
  const click = async (at) => { await move(at); await page.mouse.down(); await page.mouse.up(); };
  const drag = async (points) => {
    await move(points[0]);
    await page.mouse.down();
    for (const at of points.slice(1)) await move(at);
    await page.mouse.up();
  };
  /** Presses a key; milliseconds until the page shows `what` in its state otherwise. */
  const until = (what, name, ctrlKey) => page.evaluate(async ([what, key, ctrlKey]) => {
    const show = () => JSON.stringify(window.strandflow.state()[what]);
    const [before, began] = [show(), performance.now()];
    dispatchEvent(new KeyboardEvent('keydown', { key, ctrlKey, bubbles: true }));
    while (show() === before && performance.now() - began < 5000) await new Promise((wait) => setTimeout(wait, 0));
    return performance.now() - began;
  }, [what, name, ctrlKey]);
  const apart = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);

  // ---- markers: two views by hand, the others as predicted
  await open(server.url);
  let s = await rest();
  check(s.tool === 'markers' && s.labels.markers.length === 0 && !page.url().includes('token='), 'an empty table, without the token in the address');
  const usable = truth.markers.filter((m) => Object.keys(m.views).length >= 3).slice(0, 6);
  check(usable.length >= 5, `${usable.length} markers are seen by three views`);
  let worst = 0;
  for (const [n, marker] of usable.entries()) {
    const [one, two, ...others] = Object.keys(marker.views);
    await key('n');
    for (const view of [one, two]) {
      await set({ view, zoom: { at: marker.views[view], times: 12 } });
      await click(marker.views[view]);
    }
    for (const [i, view] of others.entries()) {
      if (n === 1 && i === 0) {
        // In the small view itself, close up.
        await set({ close: true });
        await rest();
        await page.getByLabel(`Work on ${view}`).click({ modifiers: ['Control'] });
        await set({ close: false });
        s = await state();
        check(s.view === two && apart(s.labels.markers[n].views[view], marker.views[view]) < 2.5, 'Ctrl and a click labels in a small view');
        continue;
      }
      await set({ view });
      const guess = (await state()).guesses[view];
      worst = Math.max(worst, apart(guess.at, marker.views[view]));
      await key(n === 2 && i === 0 ? 'Shift+M' : 'm');
      if (n === 2 && i === 0) {
        s = await state();
        check(s.view !== view && s.labels.markers[n].views[view] && !s.labels.markers[n].views[s.view] && s.guesses[s.view], 'Shift m goes on to a view without a label');
      }
    }
    if (n === 0) { await set({ close: true, zoom: null }); await rest(); await shot('markers'); await set({ close: false }); }
  }
  s = await rest();
  // A ball is four pixels wide here, and its centre as far off as its shading puts it.
  check(worst < 1.6, `two views predict the others within ${worst.toFixed(2)} px`);
  check(Object.values(s.rms).every((r) => r < (r === s.rms[1] ? 1 : 0.4)), `residuals: ${Object.values(s.rms).map((r) => r.toFixed(2)).join(', ')} px`);
  const saved = await labels();
  check(saved.markers.length === usable.length && apart(saved.markers[0].views[Object.keys(usable[0].views)[0]], Object.values(usable[0].views)[0]) < 0.3, 'labels are on the disk');

  // ---- a label dragged away and brought back
  const [first] = Object.keys(usable[0].views);
  const at = usable[0].views[first];
  await set({ marker: 0, view: first, zoom: { at, times: 8 } });
  await drag([at, [at[0] + 2, at[1] + 1], [at[0] + 4, at[1] + 2]]);
  s = await rest();
  check(s.rms[0] > 0.8, `a label 4 px off is seen by its residual: ${s.rms[0].toFixed(2)} px`);
  check(apart((await labels()).markers[0].views[first], at) > 3, 'and is on the disk');
  await key('Control+z');
  s = await rest();
  check(s.rms[0] < 0.4 && apart((await labels()).markers[0].views[first], at) < 0.3, 'undone, also on the disk');
  await key('Delete');
  await rest();
  check((await labels()).markers[0].views[first] === undefined, 'Del takes a label away');
  await key('u');
  await rest();

  // ---- a correction in a later frame, by keyboard alone: without a run, nothing is tracked yet
  await key('0', 'ArrowRight', 'ArrowRight');
  await rest();
  await set({ marker: 1, zoom: { at, times: 8 } });
  await key('d', 'd', 's', 'Enter');
  s = await rest();
  check(s.frame === 2 && s.labels.corrections?.[0]?.frame === 2, 'a correction in frame 2, by keys');
  await key('Control+z');
  await rest();
  check(!(await labels()).corrections?.length, 'undone');

  // ---- a marker that begins in a later frame
  const later = truth.markers.find((m) => Object.keys(m.views).length >= 2 && !usable.includes(m)) ?? usable[1];
  await key('n');
  for (const view of Object.keys(later.views).slice(0, 2)) {
    await set({ view, zoom: { at: later.views[view], times: 8 } });
    await click([later.views[view][0] + 1, later.views[view][1] + 1]);
  }
  s = await rest();
  const number = usable.length;
  check(s.marker === number && s.base === 0 && s.labels.corrections[0].markers[0].id === number && Object.keys((await labels()).corrections[0].markers[0].views).length === 2, 'n begins a marker in frame 2');
  check((await page.locator('#panel').innerText()).includes('from frame 2') && (await page.locator('#panel').innerText()).includes('n begins a new marker'), 'and the page says where it begins and what it is');
  await shot('later');
  await key('Control+z', 'Control+z', 'Control+z');
  s = await rest();
  check(!(await labels()).corrections?.length && s.labels.markers.length === number, 'undone, click by click');

  // ---- hair: a stroke, undone and redone, erased, filled
  await key('2', '0');
  await set({ view: 'cam01', brush: 6 });
  s = await rest();
  check(s.origin === 'none' && s.inside === 0, 'no mask before a run');
  await drag([[40, 40], [80, 40], [80, 70], [40, 70], [40, 40]]);
  s = await rest();
  const painted = s.inside;
  check(s.origin === 'given' && painted > 1000 && await isThere('hair_masks/cam01/000002.png'), `${painted} pixels painted, on the disk`);
  await shot('hair');
  const kept0 = asked.length;
  const took = [await until('inside', 'z', true), await until('inside', 'y', true), await until('inside', 'z', true)];
  s = await rest();
  check(asked.length === kept0 && Math.max(...took) < 100, `undo and redo ask the program for nothing, and take ${took.map((ms) => ms.toFixed(0)).join(', ')} ms`);
  check((await page.locator('#where').innerText()).includes('Undone: stroke'), 'and say what they did');
  await shot('undone');
  check(s.origin === 'none' && s.inside === 0 && !(await isThere('hair_masks/cam01/000002.png')), 'undone: the file is gone');
  await key('Control+y');
  s = await rest();
  check(s.origin === 'given' && s.inside === painted, 'redone to the pixel');
  await move([60, 55]);
  await key('f');
  s = await rest();
  const filled = s.inside;
  check(filled > painted + 300, `the hole is filled: ${filled}`);
  await key('e');
  await drag([[34, 55], [90, 55]]);
  s = await rest();
  check(s.inside < filled - 300, 'erased');
  await key('Control+z', 'e', ',', '.', 'b', 'd', 'b');
  s = await rest();
  check(s.inside >= filled && s.brush > 1, 'the pen by keys');
  const hair = s.inside;

  // ---- the program is killed: what is drawn waits, and goes out when it is back with another token
  const quiet = [...trouble];
  server.child.kill('SIGKILL');
  await ended(server.child);
  await drag([[100, 20], [110, 24]]);
  await page.waitForFunction(() => window.strandflow.state().trouble !== '');
  const more = (await state()).inside;
  await until('inside', 'z', true);
  const less = (await state()).inside;
  await until('inside', 'y', true);
  check(more > hair && less === hair && (await state()).inside === more, 'without the program strokes are undone and redone all the same');
  await shot('lost');
  server = await serve(port);
  const token = new URL(server.url).searchParams.get('token');
  await page.waitForSelector('#renew[open] input');
  await page.fill('#renew input', server.url);
  await key('Enter');
  s = await rest();
  check(s.inside > hair && s.trouble === '', 'after a killed program the stroke is saved');
  trouble.splice(0, Infinity, ...quiet);

  // ---- a mask of the subject, and one that is taken over and given back
  await key('3');
  await set({ view: 'cam00', frame: 1 });
  await rest();
  await drag([[30, 20], [60, 60]]);
  await rest();
  check(await isThere('subject_masks/cam00/000001.png'), 'a subject mask');
  await key('Delete');
  s = await rest();
  check(s.origin === 'none' && !(await isThere('subject_masks/cam00/000001.png')), 'Del gives it back');

  // ---- a strand in two views
  await key('4', 'n');
  await set({ frame: 0, view: 'cam00' });
  await rest();
  await drag([[60, 30], [62, 45], [66, 60]]);
  await rest();
  check(await isThere('sketch_drafts/000000.json') && !(await isThere('sketches/000000.json')), 'a strand of one view waits');
  await key(']');
  await rest();
  await drag([[58, 30], [60, 45], [61, 60]]);
  s = await rest();
  await shot('strands');
  const sketches = JSON.parse(await file('sketches/000000.json'));
  check(sketches.strands.length === 1 && Object.keys(sketches.strands[0].views).join() === 'cam00,cam01' && sketches.strands[0].views.cam00.length >= 3, 'a strand of two views is a sketch');
  check(apart(sketches.strands[0].views.cam00[0], [60, 30]) < 0.3, 'root first, in pixels');

  // ---- one correction for the run, then the browser is killed
  await key('1');
  await set({ frame: 2, marker: 0, view: first, zoom: { at, times: 8 } });
  await rest();
  await click([at[0], at[1]]);
  s = await rest();
  const sorted = (markers) => markers.map((m) => [m.id, Object.entries(m.views).sort()]);
  const look = ({ tool, frame, view, marker, brush, zoom, labels }) =>
    JSON.stringify([tool, frame, view, marker, brush, zoom?.times, sorted(labels.markers), labels.corrections?.map((c) => [c.frame, sorted(c.markers)])]);
  const before = look(s);
  const unzoomed = look({ ...s, zoom: null });
  const address = page.url();
  await page.close({ runBeforeUnload: false });
  await open(`${address.split('#')[0]}?token=${token}#${address.split('#')[1]}`);
  s = await rest();
  check(look(s) === before, 'opened again, the page goes on where it was');
  await page.reload();
  await page.evaluate(() => window.strandflow.ready);
  s = await rest();
  check(look(s) === before, 'and after a reload');
  check(s.history[0] > 10, `${s.history[0]} steps can be undone still`);
  await key('Control+z');
  s = await rest();
  check(!s.labels.corrections?.length && !(await labels()).corrections?.length && s.history[1] === 1, 'a label of before the reload is undone, also on the disk');
  await shot('reloaded');
  await key('Control+z');
  s = await rest();
  check(s.tool === 'strands' && Object.keys(s.sketches.strands[0].views).join() === 'cam00' && await isThere('sketch_drafts/000000.json'), 'and a stroke of another tool');
  await key('Control+y', 'Control+y');
  s = await rest();
  check(look({ ...s, zoom: null }) === unzoomed && (await labels()).corrections[0].frame === 2, 'and done again');
  // Back to the hair of before: strands, subject and hair masks of other views and frames.
  const depth = s.history[0];
  while ((s = await rest()).tool !== 'hair') await key('u');
  await key('u');
  s = await rest();
  check(s.view === 'cam01' && s.frame === 2 && s.inside < more, 'and strokes of a mask that is read anew');
  for (let i = s.history[1]; i > 0; i--) await key('Control+y');
  s = await rest();
  check(look({ ...s, zoom: null }) === unzoomed && s.history[0] === depth, 'and all of it done again');

  // ---- two windows: the older one is told, and shows what the newer one wrote
  const older = page;
  await open(`http://127.0.0.1:${port}/?token=${token}#${address.split('#')[1]}`);
  await rest();
  await key('Delete');
  await rest();
  const kept = [...trouble];
  page = older;
  await key('Delete');
  await page.waitForSelector('.notice');
  check((await page.locator('.notice').first().innerText()).includes('changed meanwhile'), 'a change of an older version is refused, and told');
  s = await rest();
  check(!s.labels.corrections?.length && !(await labels()).corrections?.length, 'and what is on the disk is shown');
  trouble.splice(0, Infinity, ...kept);
  await click([at[0], at[1]]);
  await rest();
  check((await labels()).corrections[0].frame === 2, 'then it can be labelled again');

  // ---- all views, the keys, light and narrow
  await page.emulateMedia({ colorScheme: 'light' });
  await key('g');
  await rest();
  await shot('sheet');
  await key('g', '?');
  const listed = await page.locator('#help kbd').count();
  check(listed > 30, `${listed} keys are listed`);
  await shot('keys');
  await key('Escape');
  await page.setViewportSize({ width: 800, height: 600 });
  await page.waitForTimeout(150);
  await shot('light-narrow');
  check(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), 'nothing sticks out at 800 px');
  check(trouble.length === 0, `no errors, failed requests or other hosts${trouble.length ? `: ${[...new Set(trouble)].join('; ')}` : ''}`);
} catch (error) {
  check(false, `${error.message.split('\n')[0]} (${trouble.join('; ')})`);
} finally {
  await browser.close();
  server.child.kill('SIGKILL');
}
console.log(`${wrong.length ? `${wrong.length} wrong` : 'all right'}, ${((Date.now() - started) / 1000).toFixed(0)} s`);
process.exit(wrong.length ? 1 : 0);
