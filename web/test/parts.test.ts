// The parts of the page that need no browser.

import assert from 'node:assert/strict';
import { test } from 'node:test';
import { ByteCache } from '../src/cache.ts';
import { MAPS, bucket, number, scaleOf, strandHues, tableColour } from '../src/colour.ts';
import { Loader } from '../src/loader.ts';
import type { Wanted } from '../src/loader.ts';
import { MOST_POINTS, Pace } from '../src/pace.ts';
import { neighbours, pickInSpace, pickOnImage } from '../src/pick.ts';
import { step } from '../src/player.ts';
import { curve, extent } from '../src/plots.ts';
import { decodeMesh, decodeProjected, decodeRows, decodeStrands, decodeValues, position, poseAt } from '../src/protocol.ts';
import type { Strands, Take } from '../src/protocol.ts';
import { firstState, fromHash, newestSet, toHash } from '../src/state.ts';
import { Requests, ahead, fullLevel, level, wants } from '../src/wants.ts';
import type { Api } from '../src/api.ts';

const MAGIC = 0x53465331;

function body(header: number[], ...arrays: ArrayBufferView[]): ArrayBuffer {
  const parts = [new Uint32Array([MAGIC, ...header]), ...arrays].map((a) => new Uint8Array(a.buffer, a.byteOffset, a.byteLength));
  const out = new Uint8Array(parts.reduce((sum, p) => sum + p.length, 0));
  let at = 0;
  for (const p of parts) {
    out.set(p, at);
    at += p.length;
  }
  return out.buffer;
}

/** Two strands of three points; the second one's tip is missing. */
const XYZ = [0, 0, 0, 0, 10, 0, 0, 20, 0, 30, 0, 0, 30, 10, 0, 65535, 0, 0];
const two = (): Strands => decodeStrands(body([2, 3, 16], new Float64Array([100, 0, -5, 0.5, 1, 1]), new Uint16Array(XYZ)));

const take = (): Take => ({
  name: 't', fps: 100, frames: [5, 25], gravity: [0, 0, -9810], world_from_head: { first: 5, poses: [] }, bounds: { lo: [0, 0, 0], hi: [1, 1, 1] },
  views: [{ name: 'cam0', width: 64, height: 48, fx: 1, fy: 1, cx: 1, cy: 1, camera_from_world: [], center: [0, 0, 0], footage: true }],
  sets: [
    { id: 'grow', title: 'grown', strands: 8000, points: 301, frames: [5, 25], done: [5, 6, 7], attributes: ['provenance'] },
    { id: 'blend', title: 'blended', strands: 8000, points: 61, frames: [5, 25], done: Array.from({ length: 20 }, (_, i) => i + 5), attributes: ['provenance', 'error'] },
    { id: 'animate/wind', title: 'wind', strands: 100, points: 10, frames: [5, 25], done: [5], attributes: [] },
    { id: 'truth', title: 'truth', strands: 4500, points: 20, frames: [5, 25], done: [5], attributes: [] },
  ],
  attributes: [
    { name: 'provenance', per: 'point', unit: '', range: [0, 2], categories: ['missing', 'observed', 'diffused'] },
    { name: 'error', per: 'point', unit: 'mm', range: [0, 30] },
  ],
  layers: { head: true, hull: true }, stages: [],
});

test('positions: quantised, in place, missing where x is 65535', () => {
  const s = two();
  assert.deepEqual([s.strands, s.points], [2, 3]);
  assert.deepEqual(position(s, 0, 1), [100, 10, -5]);
  assert.deepEqual(position(s, 1, 0), [115, 0, -5]);
  assert.equal(position(s, 1, 2), null);
});

test('bodies that are cut short or foreign are refused', () => {
  const whole = body([2, 3, 16], new Float64Array(6), new Uint16Array(18));
  assert.throws(() => decodeStrands(whole.slice(0, whole.byteLength - 2)), /promises/);
  assert.throws(() => decodeStrands(new ArrayBuffer(8)), /no header/);
  assert.throws(() => decodeValues(new ArrayBuffer(32)), /not binary data/);
  assert.throws(() => decodeStrands(body([1, 1, 32], new Float32Array(3))), /32 bits/);
});

test('values, pixels, meshes and rows', () => {
  assert.deepEqual([...decodeValues(body([3, 1, 32], new Float32Array([1, 2, 3]))).values], [1, 2, 3]);
  assert.deepEqual([...decodeProjected(body([1, 2, 32], new Float32Array([1, 2, 3, 4]))).uv], [1, 2, 3, 4]);
  const mesh = decodeMesh(body([3, 1, 0], new Float32Array(9), new Uint32Array([0, 1, 2])));
  assert.deepEqual([mesh.vertices.length, ...mesh.faces], [9, 0, 1, 2]);
  assert.equal(decodeRows(7)(body([2, 0, 0], new Float32Array(14))).count, 2);
});

test('a pose that is not there is the nearest one that is', () => {
  const eye = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
  const lost = eye.map(() => null);
  assert.equal(poseAt({ first: 3, poses: [lost, eye, lost] }, 3), eye);
  assert.equal(poseAt({ first: 3, poses: [lost, eye, lost] }, 99), eye);
  assert.equal(poseAt({ first: 0, poses: [] }, 0), undefined);
});

test('the cache keeps within its bound and drops what was not used', () => {
  const dropped: string[] = [];
  const cache = new ByteCache<string>(100, (v) => dropped.push(v));
  cache.set('a', 'A', 40);
  cache.set('b', 'B', 40);
  cache.get('a');
  cache.set('c', 'C', 40);
  assert.deepEqual([dropped, cache.bytes, cache.has('a'), cache.has('b')], [['B'], 80, true, false]);
  cache.set('a', 'A2', 10);
  assert.equal(cache.bytes, 50);
  cache.set('huge', 'H', 500);
  assert.deepEqual([cache.size, cache.has('huge')], [1, true]);
});

test('what is not wanted any more is given up, but for what goes one at a time', async () => {
  const signals = new Map<string, AbortSignal>();
  const finish = new Map<string, () => void>();
  const thing = (path: string, lane?: string): Wanted => ({
    path, lane,
    fetch: (p, signal) => new Promise((done) => {
      signals.set(p, signal);
      finish.set(p, () => done({ value: p, bytes: 1 }));
    }),
  });
  const loader = new Loader(new ByteCache<unknown>(100), () => {}, () => {}, () => 0);
  loader.want([thing('a'), thing('hull 1', 'hull'), thing('hull 2', 'hull')]);
  assert.deepEqual([...signals.keys()], ['a', 'hull 1']);
  loader.want([thing('b'), thing('hull 3', 'hull')]);
  assert.deepEqual([signals.get('a')!.aborted, signals.get('hull 1')!.aborted, signals.has('hull 3')], [true, false, false]);
  finish.get('hull 1')!();
  await new Promise((r) => setTimeout(r, 0));
  assert.equal(loader.get('hull 1'), 'hull 1');
  assert.ok(signals.has('hull 3'));
});

test('a refused thing is not asked for again at once', async () => {
  let [asked, now] = [0, 0];
  const errors: string[] = [];
  const loader = new Loader(new ByteCache<unknown>(100), () => {}, (path) => errors.push(path), () => now);
  const list: Wanted[] = [{ path: 'x', fetch: () => (asked++, Promise.reject(new Error('no'))) }];
  for (let i = 0; i < 3; i++) {
    loader.want(list);
    await new Promise((r) => setTimeout(r, 0));
  }
  assert.deepEqual([asked, errors, loader.isRefused('x')], [1, ['x'], true]);
  now = 6000;
  loader.want(list);
  assert.equal(asked, 2);
});

test('colours: ends of the maps, categories, missing values, zero in the middle', () => {
  assert.deepEqual(tableColour(MAPS.viridis, 0), [0x44, 0x01, 0x54]);
  assert.deepEqual(tableColour(MAPS.viridis, 255), [0xfd, 0xe7, 0x25]);
  const [provenance, error] = take().attributes;
  const categories = scaleOf(provenance, null);
  assert.deepEqual(tableColour(categories.table, bucket(categories, 1)), [0x00, 0x9e, 0x73]);
  const scale = scaleOf(error, null);
  assert.deepEqual([bucket(scale, -9), bucket(scale, 30), bucket(scale, NaN)], [0, 255, -1]);
  assert.deepEqual(scaleOf({ name: 'length_change', per: 'strand', unit: '%', range: [-2, 5] }, null).range, [-5, 5]);
  assert.deepEqual(scaleOf(error, [1, 2]).range, [1, 2]);
  assert.deepEqual([...strandHues(0, 2, 3)].map((v) => v.toFixed(3)), ['0.000', '0.236', '0.472']);
});

test('numbers as a person reads them', () => {
  assert.deepEqual([number(0), number(239.04), number(-0.81249), number(51234.4), number(null), number(3e-7)], ['0', '239', '−0.812', '51234', '–', '3e−7']);
});

const CLIP = [0.02, 0, 0, 0, 0, 0.02, 0, 0, 0, 0, 1, 0, -2, 0, 0, 1];

test('the nearest segment on the screen is picked; nothing beyond reach, nothing hidden', () => {
  // x 100…115 goes to 0…0.3 of clip space, y 0…20 to 0…0.4; the picture is 100 by 100.
  const hit = pickInSpace(two(), CLIP, 100, 100, 52, 40, 5);
  assert.deepEqual([hit?.strand, hit?.point], [0, 0]);
  assert.equal(hit?.pixels.toFixed(3), '2.000');
  assert.equal(pickInSpace(two(), CLIP, 100, 100, 64, 45, 5)?.strand, 1);
  assert.equal(pickInSpace(two(), CLIP, 100, 100, 58, 45, 5), null);
  assert.equal(pickInSpace(two(), CLIP, 100, 100, 64, 45, 5, (s) => s !== 1), null);
  // The second strand ends before its missing tip.
  assert.equal(pickInSpace(two(), CLIP, 100, 100, 65, 30, 5), null);
});

test('picking on the footage, and neighbours by root', () => {
  const uv = new Float32Array([0, 0, 10, 0, 20, 0, 0, 5, NaN, NaN, 20, 5]);
  assert.deepEqual([pickOnImage({ strands: 2, points: 3, uv }, 12, 1, 3)?.strand, pickOnImage({ strands: 2, points: 3, uv }, 10, 5, 3)], [0, null]);
  assert.deepEqual(neighbours(two(), 1, 5), [1, 0]);
});

test('playing waits for what has not arrived, skips on a slow machine, and loops', () => {
  const all = () => true;
  assert.deepEqual(step(5, 0.4, [0, 10], true, all), { frame: 5, carry: 0.4, waits: false, ended: false });
  assert.equal(step(5, 3.5, [0, 10], true, all).frame, 8);
  assert.equal(step(5, 3.5, [0, 10], true, (f) => f <= 6).frame, 6);
  assert.deepEqual(step(5, 1.2, [0, 10], true, () => false), { frame: 5, carry: 1, waits: true, ended: false });
  assert.equal(step(9, 1, [0, 10], true, all).frame, 0);
  assert.equal(step(9, 1, [0, 10], false, all).ended, true);
  assert.equal(step(8, 5, [0, 10], false, all).frame, 9);
  assert.deepEqual(ahead(take(), 23, 4, true), [24, 5, 6, 7]);
  assert.deepEqual(ahead(take(), 23, 4, false), [24]);
});

test('detail follows what drawing takes, and one slow picture is not believed', () => {
  const pace = new Pace();
  pace.drew(488_000, 4000);
  for (let i = 0; i < 3; i++) pace.drew(488_000, 12);
  assert.deepEqual([pace.moving, pace.rest], [2000, MOST_POINTS]);
  for (let i = 0; i < 5; i++) pace.drew(488_000, 4000);
  assert.deepEqual([pace.moving, pace.rest], [500, 60_000]);
  for (let i = 0; i < 5; i++) pace.drew(96_000, 3);
  assert.deepEqual([pace.moving, pace.rest], [2000, MOST_POINTS]);
});

test('levels: all points where they are few enough, never more than there are', () => {
  const [grow, blend] = take().sets;
  assert.deepEqual(fullLevel(blend, MOST_POINTS), { stride: 1, points: 0 });
  assert.deepEqual(fullLevel(grow, MOST_POINTS), { stride: 1, points: 124 });
  assert.deepEqual(fullLevel(grow, 1), { stride: 1, points: 12 });
  assert.deepEqual(level(blend, 2000), { stride: 4, points: 14 });
});

test('what is wanted: the coarse frame first, all detail only at rest, nothing of frames that are not done', () => {
  const t = take();
  const moment = { state: { ...firstState(t), by: 'error' }, take: t, moving: true, most: 2000, rest: MOST_POINTS };
  const requests = new Requests({} as Api);
  const moving = wants(moment, requests).map((w) => w.path);
  assert.equal(moving[0], '/api/strands/blend/15?first=0&count=2000&stride=4&points=14&bits=16');
  assert.equal(moving[1], '/api/attribute/blend/error/15?first=0&count=2000&stride=4&points=14');
  assert.ok(!moving.some((p) => p.includes('count=8000')));
  assert.ok(wants({ ...moment, moving: false }, requests).some((w) => w.path === '/api/strands/blend/15?first=0&count=8000&stride=1&bits=16'));
  const grow = wants({ ...moment, state: { ...moment.state, set: 'grow', frame: 15 } }, requests, 0).map((w) => w.path);
  assert.deepEqual(grow, ['/api/mesh/head']);
  const film = wants({ ...moment, state: { ...moment.state, mode: 'footage' } }, requests, 0).map((w) => w.path);
  assert.equal(film[0], '/api/image/cam0/15?width=480');
});

test('a look survives its address; what the take lacks is ignored', () => {
  const t = take();
  const first = firstState(t);
  assert.deepEqual([newestSet(t)?.id, first.set, first.frame, toHash(first, first)], ['blend', 'blend', 15, '']);
  const look = {
    ...first, set: 'animate/wind', other: 'truth', frame: 9, by: 'error', range: [0, 3] as [number, number], selected: 12, isolated: true, follow: true,
    camera: { position: [1, 2, 3] as [number, number, number], target: [0, 0.5, 0] as [number, number, number] }, layers: { ...first.layers, hull: true, floor: false },
  };
  assert.deepEqual(fromHash(`#${toHash(look, first)}`, first, t), look);
  assert.deepEqual(fromHash('#set=nothing&by=nothing&frame=x&camera=1,2&view=cam9', first, t), first);
  assert.equal(fromHash('#frame=900', first, t).frame, 24);
});

test('plots: the pen is lifted over gaps, one value has a range', () => {
  assert.equal(curve([0, 1, 2, 3], [1, null, 2, 3], (f) => f, (v) => v), 'M0.0 1.0M2.0 2.0L3.0 3.0');
  assert.equal(extent([null]), null);
  const [lo, hi] = extent([5])!;
  assert.ok(lo < 5 && hi > 5);
});
