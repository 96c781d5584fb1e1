// Drives the page in a real Chromium and looks at what it shows.
//
//   node test/view.mjs URL OUTDIR     against a running `strandflow view`
//   node test/view.mjs mock OUTDIR    against the stand-in
//
// With PAGE=dist the page comes from dist/, not from the program, which holds the one it was built with.
// Writes screenshots to OUTDIR; exit code 0 if all is as it should be. CHROMIUM names another browser than /usr/bin/chromium.

import { mkdir } from 'node:fs/promises';
import { chromium } from 'playwright-core';
import { serve } from './mock.mjs';

const ARGS = [
  '--no-sandbox', '--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--ignore-gpu-blocklist', '--disable-quic',
  '--no-first-run', '--disable-background-networking', '--disable-component-update', '--disable-sync',
];

const [address, out] = process.argv.slice(2);
if (!address || !out) {
  console.error('usage: node test/view.mjs URL|mock OUTDIR');
  process.exit(2);
}
await mkdir(out, { recursive: true });
const mock = address === 'mock' ? await serve({ strands: 2000, frames: 60 }) : null;
const url = mock?.url ?? address;
const origin = new URL(url).origin;

const wrong = [];
const check = (is, what) => {
  if (!is) wrong.push(what);
  console.log(`${is ? '  ok ' : 'WRONG'} ${((Date.now() - started) / 1000).toFixed(1).padStart(5)} s  ${what}`);
};

const started = Date.now();
const browser = await chromium.launch({ executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium', headless: true, args: ARGS });
try {
  const context = await browser.newContext({ viewport: { width: 1200, height: 720 }, colorScheme: 'light' });
  const page = await context.newPage();
  page.setDefaultTimeout(20000);
  const trouble = [];
  page.on('console', (m) => ['error', 'warning'].includes(m.type()) && trouble.push(`console: ${m.text()}`));
  page.on('pageerror', (e) => trouble.push(`exception: ${e.message}`));
  page.on('response', (r) => r.status() >= 400 && trouble.push(`${r.status()} ${new URL(r.url()).pathname}`));
  // What the page itself gave up is no failure.
  page.on('requestfailed', (r) => r.failure()?.errorText !== 'net::ERR_ABORTED' && trouble.push(`failed: ${r.url()} ${r.failure()?.errorText}`));
  page.on('request', (r) => {
    const to = new URL(r.url());
    if (['http:', 'https:', 'ws:', 'wss:'].includes(to.protocol) && to.origin !== origin) trouble.push(`request to another host: ${to.host}`);
  });

  if (process.env.PAGE) {
    const types = { 'index.html': 'text/html', 'app.js': 'text/javascript', 'app.css': 'text/css' };
    await page.route((to) => ['/', '/app.js', '/app.css'].includes(to.pathname), (route) => {
      const name = new URL(route.request().url()).pathname.slice(1) || 'index.html';
      return route.fulfill({ path: new URL(`../${process.env.PAGE}/${name}`, import.meta.url).pathname, contentType: types[name] });
    });
  }

  const state = () => page.evaluate(() => window.strandflow.state());
  const set = (change) => page.evaluate((c) => window.strandflow.set(c), change);
  const shot = (name) => page.screenshot({ path: `${out}/${name}.png` });
  const rest = (what) =>
    page.waitForFunction(() => { return window.strandflow.state().atRest; }, null, { polling: 50 }).then(state, () => { throw new Error(`did not come to rest: ${what}`); });
  /** Layers of the 3D picture that are on; all others are off. */
  const layers = (...on) =>
    set({ layers: Object.fromEntries(['head', 'cameras', 'images', 'hull', 'lines', 'arrows', 'roots', 'floor', 'footage', 'strands', 'masks', 'orientation'].map((n) => [n, on.includes(n)])) });

  /** Takes a picture of the page; tells of parts of it which share differs from the part's first pixel, and the mean colour. */
  const looks = async (name, ...parts) => {
    const png = await page.screenshot({ path: `${out}/${name}.png` });
    return page.evaluate(async ({ base64, parts }) => {
      const bytes = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
      const bitmap = await createImageBitmap(new Blob([bytes], { type: 'image/png' }));
      const ink = new OffscreenCanvas(bitmap.width, bitmap.height).getContext('2d', { willReadFrequently: true });
      ink.drawImage(bitmap, 0, 0);
      return parts.map((part) => {
        const [x, y, width, height] = [part.x, part.y, part.width, part.height].map(Math.round);
        const { data } = ink.getImageData(x, y, width, height);
        const [mean, n] = [[0, 0, 0], data.length / 4];
        let other = 0;
        for (let i = 0; i < data.length; i += 4) {
          if (Math.abs(data[i] - data[0]) + Math.abs(data[i + 1] - data[1]) + Math.abs(data[i + 2] - data[2]) > 24) other += 1;
          for (let k = 0; k < 3; k++) mean[k] += data[i + k] / n;
        }
        return { other: other / n, mean };
      });
    }, { base64: png.toString('base64'), parts });
  };
  const differ = (a, b) => Math.hypot(...a.mean.map((c, k) => c - b.mean[k]));
  const box = (id) => page.locator(id).boundingBox();
  const middle = async (id, part = 0.4) => {
    const b = await box(id);
    return { x: b.x + b.width * (0.5 - part / 2), y: b.y + b.height * (0.5 - part / 2), width: b.width * part, height: b.height * part };
  };
  const corner = async () => {
    const b = await box('#canvas');
    return { x: b.x + 4, y: b.y + b.height * 0.3, width: 40, height: 60 };
  };

  // ---- first look
  await page.goto(url);
  await page.evaluate(() => window.strandflow.ready);
  const take = await page.evaluate(async () => (await window.strandflow.app).take);
  let s = await rest('first look');
  const main = take.sets.find((x) => x.id === s.set);
  check(main !== undefined && s.strands === main.strands && s.points >= 8, `first look: all ${s.strands} strands of ${s.set} with ${s.points} points`);
  check(s.frame === main.done[Math.floor(main.done.length / 2)], `first look: middle frame ${s.frame}`);
  check(!page.url().includes('token='), 'the address does not hold the token');
  await shot('first');
  await layers('strands');
  await rest('bare');
  const [hair, ground] = await looks('strands', await middle('#canvas'), await corner());
  check(hair.other > 0.2 && differ(hair, ground) > 25, `hair in the middle of the picture (differs by ${differ(hair, ground).toFixed(0)})`);
  check(ground.other < 0.02, 'nothing in its corner');
  const shown = s;

  // ---- colours
  for (const by of ['strand', 'root', ...main.attributes]) {
    await page.selectOption('#by', by);
    const looked = ['strand', 'provenance', 'speed', 'error'].includes(by);
    if (looked) await rest(by);
    else await page.waitForFunction((name) => document.getElementById('legend').innerText.toLowerCase().startsWith(name), by.replaceAll('_', ' '), { polling: 50 });
    const legend = (await page.locator('#legend').innerText()).replace(/\s+/g, ' ');
    const about = take.attributes.find((a) => a.name === by);
    if (about?.categories) check(about.categories.every((c) => legend.includes(c)), `${by}: legend names ${legend}`);
    else check(legend.toLowerCase().includes(by.replaceAll('_', ' ').slice(0, 4)) && (!about?.unit || legend.includes(about.unit)), `${by}: legend says ${legend}`);
    if (!looked) continue;
    const [now] = await looks(`by-${by}`, await middle('#canvas'));
    check(differ(now, hair) > 4, `${by}: colours differ from hair by ${differ(now, hair).toFixed(0)}`);
  }
  await page.selectOption('#by', 'hair');
  await rest('hair');
  check(await page.locator('#legend').isHidden(), 'no legend for hair');

  // ---- layers
  await layers();
  await rest('no layers');
  const bare = await page.evaluate(() => window.strandflow.state().renders);
  for (const [layer, sent] of [['hull', 'hull'], ['lines', 'lines'], ['arrows', 'arrows']]) {
    const box = page.locator('#layers label', { hasText: { hull: 'Visual hull', lines: 'Lifted lines', arrows: 'Velocities' }[layer] }).locator('input');
    if (take.layers[sent]) {
      await box.check();
      await page.waitForTimeout(150);
      await rest(layer);
    } else check(await box.isDisabled(), `${layer}: disabled, as the take has none`);
  }
  await set({ layers: { ...(await page.evaluate(async () => (await window.strandflow.app).store.state.layers)), roots: true, head: true, floor: true } });
  s = await rest('all layers');
  check(s.renders > bare, 'layers were drawn');
  await shot('layers');
  await layers('strands', 'head', 'cameras', 'images', 'floor');
  await page.waitForTimeout(150);
  await rest('images');
  await page.evaluate(async () => { const a = await window.strandflow.app; const c = a.space.looking; a.space.look({ position: c.position.map((v, k) => c.target[k] + (v - c.target[k]) * 4), target: c.target }); });
  await page.waitForTimeout(300);
  await shot('cameras');
  await page.click('#home');
  await layers('strands', 'head', 'floor');

  // ---- picking
  await rest('before picking');
  const canvas = await box('#canvas');
  for (const [x, y] of [[0.5, 0.5], [0.47, 0.4], [0.53, 0.6], [0.5, 0.3]]) {
    await page.mouse.click(canvas.x + canvas.width * x, canvas.y + canvas.height * y);
    s = await state();
    if (s.selected !== null) break;
  }
  check(s.selected !== null, `a click picks strand ${s.selected}`);
  await page.waitForSelector('#picked svg.plot');
  await rest('picked');
  const panel = (await page.locator('#picked').innerText()).replace(/\s+/g, ' ');
  check(panel.toLowerCase().includes(`strand ${s.selected}`), 'the panel names it');
  const length = Number(/Length now ([\d.]+) mm/i.exec(panel)?.[1]);
  check(length > 1 && length < 2000, `its length is ${length} mm`);
  check((await page.locator('#picked svg.plot .curve').count()) >= 2, 'length and speed are plotted over time');
  check(/observed|diffused|simulated|completed/.test(panel), 'its provenance is stated');
  await shot('picked');
  await page.keyboard.press('i');
  s = await rest('isolated');
  check(s.isolated > 1 && s.isolated <= 40, `${s.isolated} neighbours are isolated`);
  await shot('isolated');
  await page.keyboard.press('Escape');
  check((await state()).selected === null, 'Esc lets go');

  // ---- comparing
  const other = take.sets.find((x) => x.id === 'truth' && x.done.length) ?? take.sets.find((x) => x.id !== main.id && x.done.includes(shown.frame));
  if (other) {
    await page.selectOption('#other', other.id);
    s = await rest('side by side');
    check(s.otherStrands > 0 && s.otherFrame === s.shownFrame, `side by side: ${s.otherStrands} strands of ${other.id}`);
    const b = await box('#canvas');
    const halves = await looks('compare-side', ...[0.25, 0.75].map((x) => ({ x: b.x + b.width * x - 60, y: b.y + b.height * 0.35, width: 120, height: 150 })));
    check(halves.every((h) => differ(h, ground) > 15), 'hair in both halves');
    check((await page.locator('#panes div').count()) === 2, 'both are named');
    await page.click('#layout button[data-value=over]');
    await rest('overlaid');
    await page.waitForTimeout(200);
    await shot('compare-over');
    await page.keyboard.press('c');
    check((await state()).otherStrands === 0, 'comparing ends');
  }

  // ---- time
  await page.keyboard.press('Home');
  s = await rest('first frame');
  check(s.frame === take.frames[0], 'Home goes to the first frame');
  await page.keyboard.press('ArrowRight');
  s = await rest('next frame');
  check(s.frame === take.frames[0] + 1, 'an arrow goes on by a frame');
  await page.keyboard.press('f');
  await page.keyboard.press('Space');
  await page.waitForTimeout(2500);
  s = await state();
  check(s.framesPlayed >= 3, `played ${s.framesPlayed} frames in 2.5 s`);
  check(s.points <= 14 && s.strands <= 2000, `little detail while playing: ${s.strands} strands × ${s.points} points`);
  await shot('playing');
  await page.keyboard.press('Space');
  s = await rest('after playing');
  check(s.full, 'all detail at rest');
  check(s.cacheBytes <= s.cacheLimit, `memory ${(s.cacheBytes / 2 ** 20).toFixed(1)} MB within its bound`);
  await page.keyboard.press('f');

  // ---- footage
  if (take.views.length > 0) {
    await set({ frame: shown.frame, mode: 'footage' });
    await layers('footage', 'strands');
    await rest('sheet');
    await page.waitForTimeout(200);
    check((await page.locator('.tile:visible').count()) === take.views.length, `all ${take.views.length} views on the sheet`);
    await shot('footage-sheet');
    await page.locator('.tile:visible .open').first().click();
    await rest('one view');
    await page.waitForTimeout(200);
    check((await page.locator('.tile:visible').count()) === 1, 'a click enlarges a view');
    const tile = await middle('.tile:visible canvas', 0.9);
    await set({ opacity: 0 });
    await page.waitForTimeout(200);
    const [film] = await looks('footage-bare', tile);
    await set({ opacity: 1 });
    await page.waitForTimeout(200);
    const [over] = await looks('footage-one', tile);
    check(differ(film, over) > 1, `strands over the footage (differ by ${differ(film, over).toFixed(1)})`);
    await layers('footage', 'masks', 'orientation');
    await page.waitForTimeout(150);
    await rest('masks');
    await page.waitForTimeout(200);
    const [masked] = await looks('footage-masks', tile);
    if (take.layers.masks || take.layers.orientation) check(differ(film, masked) > 1, 'masks and orientations over the footage');
    await page.keyboard.press('Escape');
    await page.keyboard.press('v');
  }

  // ---- a look that is shared, dark, and narrow; the token is not in its address
  await layers('strands', 'head', 'floor');
  await set({ by: main.attributes[0], frame: take.frames[0] + 1 });
  await rest('a look');
  await page.waitForTimeout(400);
  check(page.url().includes('#') && page.url().includes(`frame=${take.frames[0] + 1}`), `the look is in the address: ${new URL(page.url()).hash}`);
  await page.emulateMedia({ colorScheme: 'dark' });
  await page.setViewportSize({ width: 800, height: 600 });
  await page.reload();
  await page.evaluate(() => window.strandflow.ready);
  s = await rest('reloaded');
  check(s.frame === take.frames[0] + 1, 'a reload shows the same look');
  await page.waitForTimeout(200);
  await shot('dark-narrow');
  check(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), 'nothing sticks out at 800 px');

  // ---- a wrong token, and a program that has ended
  const quiet = [...trouble];
  const wary = await context.newPage();
  await wary.goto(`${origin}/?token=wrong`);
  await wary.waitForSelector('#cover input');
  check((await wary.locator('#cover').innerText()).includes('token'), 'a wrong token is asked for again');
  await wary.close();
  if (mock) {
    mock.close();
    await page.keyboard.press('End');
    await page.waitForSelector('.notice');
    check((await page.locator('.notice').first().innerText()).includes('does not answer'), 'a program that has ended is said to have');
    await shot('ended');
  }
  trouble.splice(0, Infinity, ...quiet);

  check(trouble.length === 0, `no errors, failed requests or other hosts${trouble.length ? `: ${[...new Set(trouble)].join('; ')}` : ''}`);
} catch (error) {
  check(false, error.message.split('\n')[0]);
} finally {
  await browser.close();
  mock?.close();
}
console.log(`${wrong.length ? `${wrong.length} wrong` : 'all right'}, ${((Date.now() - started) / 1000).toFixed(0)} s`);
process.exit(wrong.length ? 1 : 0);
