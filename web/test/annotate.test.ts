// Parts of the page that labels and corrects, without a browser: lenses and lines, brushes, PNG.

import assert from 'node:assert/strict';
import { test } from 'node:test';
import { inflateSync } from 'node:zlib';
import { cut, fill, paste, stroke } from '../src/annotate/brush.ts';
import type { Plane } from '../src/annotate/brush.ts';
import { direction, epipolar, lookedAt, project, triangulate } from '../src/annotate/camera.ts';
import type { P2, P3, WorkView } from '../src/annotate/camera.ts';
import { distort, undistort } from '../src/annotate/lens.ts';
import type { Lens } from '../src/annotate/lens.ts';
import { History } from '../src/annotate/history.ts';
import type { Keeper, Kept, Past } from '../src/annotate/history.ts';
import { baseOf, framesOf, labelsAt, markersOf, putLabel, removeMarker } from '../src/annotate/labels.ts';
import { nameOf } from '../src/annotate/keys.ts';
import { greyPng } from '../src/annotate/png.ts';
import { firstLook, fromHash, toHash } from '../src/annotate/state.ts';
import type { LabelDoc, Work } from '../src/annotate/wire.ts';

/** A camera on a circle around the origin, which it looks at, through a lens that bends. */
function view(angle: number, distortion: Lens = { brown_conrady: [-0.21, 0.08, 0.0012, -0.0007, 0.01, 0.002, 0, 0] }): WorkView {
  const [s, c] = [Math.sin(angle), Math.cos(angle)];
  const far = 1100;
  // x right, y down, z towards the origin.
  const rows = [[c, 0, -s, 0], [0, 1, 0, 20], [s, 0, c, far], [0, 0, 0, 1]];
  const center: P3 = [-s * far, -20, -c * far];
  return { name: `cam${angle}`, width: 640, height: 480, fx: 900, fy: 905, cx: 322, cy: 238, camera_from_world: rows.flat(), center, footage: true, distortion };
}

const apart = (a: readonly number[], b: readonly number[]) => Math.hypot(...a.map((v, i) => v - b[i]));

test('a ray through the image of a point meets it, lens and all', () => {
  const at: P3 = [61, -88, 47];
  for (const lens of ['none', view(0).distortion] as Lens[]) {
    const v = view(0.6, lens);
    const pixel = project(v, at)!;
    const along = direction(v, pixel);
    const reach = apart(at, v.center);
    assert.ok(apart(v.center.map((c, i) => c + along[i] * reach), at) < 1e-6);
  }
  assert.equal(project(view(0), [0, 0, -5000]), null);
});

test('the lens bends as the program\'s does', () => {
  // x = 0.2, y = -0.1 by the formula of OpenCV's rational model, worked out by hand.
  const v = { ...view(0, { brown_conrady: [-0.2, 0.1, 0.001, -0.002, 0.05, 0.3, -0.1, 0.02] }), camera_from_world: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1] };
  const r2 = 0.05;
  const radial = (1 - 0.2 * r2 + 0.1 * r2 ** 2 + 0.05 * r2 ** 3) / (1 + 0.3 * r2 - 0.1 * r2 ** 2 + 0.02 * r2 ** 3);
  const [x, y] = [0.2 * radial + 2 * 0.001 * -0.02 - 0.002 * (r2 + 0.08), -0.1 * radial + 0.001 * (r2 + 0.02) + 2 * -0.002 * -0.02];
  assert.ok(apart(project(v, [200, -100, 1000])!, [900 * x + 322, 905 * y + 238]) < 1e-9);
});

test('every lens bends as the program\'s does, and is undone', () => {
  // The image of (-0.45, 0.35) by OpenCV, and by the published formulas: as in crates/geometry/src/lens_tests.rs.
  const rational = [-0.28, 0.09, 1.5e-3, -7e-4, -0.012, 0.04, -0.01, 0.003];
  const fisheye = { fisheye: true, radial: [-0.03, 0.012, -0.004, 0.0007], tangential: [0, 0], prism: [0, 0], skew: 0 };
  const frame = { ...fisheye, fisheye: false, tangential: [1e-3, -6e-4], skew: 0.004 };
  const known: [Lens, P2][] = [
    ['none', [-0.45, 0.35]],
    [{ brown_conrady: rational }, [-0.4092081665023236, 0.31858357394625164]],
    [{ tilted: [...rational, 2e-3, -5e-4, -1e-3, 3e-4, 0.02, -0.03] }, [-0.40639806561992003, 0.3162435140738647]],
    [{ polynomial: fisheye }, [-0.4060203810244708, 0.31579362968569946]],
    [{ polynomial: frame }, [-0.445486619520789, 0.3477447990019531]],
    [{ fov: 0.9 }, [-0.44153932075169844, 0.3434194716957654]],
  ];
  for (const [lens, image] of known) {
    const seen = distort(lens, [-0.45, 0.35]);
    assert.ok(apart(seen, image) < 1e-14, JSON.stringify(lens) + seen);
    assert.ok(apart(undistort(lens, seen), [-0.45, 0.35]) < 1e-12, JSON.stringify(lens));
  }
});

test('views that agree give the point, and what disagrees shows', () => {
  const views = [0, 0.5, 1.1].map((a) => view(a));
  const at: P3 = [-40, 30, 25];
  const seen = views.map((v) => [v, project(v, at)!] as [WorkView, P2]);
  assert.ok(apart(triangulate(seen)!, at) < 1e-5);
  seen[1] = [views[1], [seen[1][1][0], seen[1][1][1] + 6]];
  const off = apart(project(views[1], triangulate(seen)!)!, seen[1][1]);
  assert.ok(off > 1 && off < 6, String(off));
  assert.equal(triangulate(seen.slice(0, 1)), null);
  assert.ok(apart(lookedAt(views), [0, -20, 0]) < 1e-6);
});

test('an epipolar line runs through the point\'s image', () => {
  const [a, b] = [view(0), view(0.7)];
  for (const at of [[0, 0, 0], [90, -70, 60], [-80, 100, -90]] as P3[]) {
    const [from, to] = [project(a, at)!, project(b, at)!];
    const curve = epipolar(a, from, b, [0, 0, 0]);
    const off = curve.slice(1).map((q, i) => {
      const p = curve[i];
      const t = Math.min(1, Math.max(0, ((to[0] - p[0]) * (q[0] - p[0]) + (to[1] - p[1]) * (q[1] - p[1])) / apart(p, q) ** 2));
      return apart(to, [p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])]);
    });
    assert.ok(Math.min(...off) < 0.1, String(Math.min(...off)));
  }
});

const plane = (width: number, height: number): Plane => ({ width, height, data: new Uint8Array(width * height) });

test('a stroke covers its capsule, with an edge of one pixel, and an eraser takes it away', () => {
  const p = plane(40, 20);
  const rect = stroke(p, [10.5, 10.5], [30.5, 10.5], 4, false);
  assert.equal(p.data[10 * 40 + 20], 255);
  assert.equal(p.data[10 * 40 + 10 - 5], 0);
  assert.ok(p.data.some((v) => v > 0 && v < 255));
  const area = p.data.reduce((sum, v) => sum + v / 255, 0);
  assert.ok(Math.abs(area - (Math.PI * 16 + 20 * 8)) < 8, String(area));
  const old = cut(p, rect);
  stroke(p, [-100, 10], [200, 10], 30, true);
  assert.ok(p.data.every((v) => v === 0));
  paste(p, rect, old);
  assert.ok(Math.abs(p.data.reduce((sum, v) => sum + v / 255, 0) - area) < 1e-9);
  // Beyond the image nothing happens, and nothing breaks.
  stroke(p, [-50, -50], [-40, -40], 5, false);
});

test('a hole is filled to its border and no further', () => {
  const p = plane(40, 40);
  for (const [a, b] of [[[10, 10], [30, 10]], [[30, 10], [30, 30]], [[30, 30], [10, 30]], [[10, 30], [10, 10]]] as [P2, P2][]) stroke(p, a, b, 2, false);
  assert.equal(fill(p, [10, 10], false), null);
  fill(p, [20, 20], false);
  assert.ok(p.data[20 * 40 + 20] === 255 && p.data[2 * 40 + 2] === 0 && p.data[20 * 40 + 7] === 0);
  assert.ok(p.data.subarray(20 * 40 + 9, 20 * 40 + 31).every((v) => v === 255));
  fill(p, [20, 20], true);
  assert.ok(p.data.every((v) => v === 0));
});

test('a PNG holds the mask', async () => {
  const data = Uint8Array.from({ length: 35 }, (_, i) => i * 7);
  const png = Buffer.from(await greyPng(7, 5, data));
  assert.deepEqual([...png.subarray(0, 8)], [137, 80, 78, 71, 13, 10, 26, 10]);
  assert.deepEqual([png.readUInt32BE(16), png.readUInt32BE(20), png[24], png[25]], [7, 5, 8, 0]);
  // The checksum of an IEND chunk is known.
  assert.equal(png.readUInt32BE(png.length - 4), 0xae426082);
  const rows = inflateSync(png.subarray(41, 41 + png.readUInt32BE(33)));
  assert.deepEqual([...rows].filter((_, i) => i % 8 !== 0), [...data]);
});

/** A history over documents in memory, and what it was asked to restore. */
function recorded(past: Past | null = null, keeper: Keeper | null = null) {
  const said: unknown[] = [];
  const history = new History({ open: () => Promise.resolve(true), restore: (_, side) => void said.push(side) }, past, keeper);
  const step = (name: string, path = '/a', bytes = 1) => history.add({ what: name, path, look: { frame: 0 }, before: `-${name}`, after: `+${name}`, bytes });
  return { history, said, step };
}

test('steps are undone and redone in order, and old ones go when they are too large', async () => {
  const { history, said, step } = recorded();
  for (const name of ['a', 'b', 'c']) step(name, '/a', 100 * 2 ** 20);
  // 300 MB are more than are kept: the oldest goes.
  await history.undo();
  await history.undo();
  await history.redo();
  assert.deepEqual(said, ['-c', '+c']);
  step('d', '/a', 100 * 2 ** 20);
  assert.deepEqual(history.depth, [1, 0]);
});

test('steps outlive the page, but not a change of their document by somebody else', async () => {
  const steps = new Map<number, Kept>();
  let order: Past = { done: [], undone: [], versions: new Map() };
  const keeper: Keeper = {
    put: (kept) => void steps.set(kept.n, kept),
    drop: (numbers) => numbers.forEach((n) => steps.delete(n)),
    order: (done, undone, versions) => { order = { done: done.map((n) => steps.get(n)!), undone: undone.map((n) => steps.get(n)!), versions: new Map(versions) }; },
  };
  const first = recorded(null, keeper);
  first.history.opened('/a', '1');
  first.history.opened('/b', '1');
  first.step('a', '/a');
  first.history.saved('/a', '2');
  first.step('b', '/b');
  first.history.saved('/b', '2');
  first.step('c', '/a');
  first.history.saved('/a', '3');
  await first.history.undo();
  first.history.saved('/a', '2');

  const again = recorded(structuredClone(order), keeper);
  again.history.opened('/a', '2');
  assert.deepEqual(again.history.depth, [2, 1]);
  await again.history.redo();
  await again.history.undo();
  await again.history.undo();
  assert.deepEqual(again.said, ['+c', '-c', '-b']);

  const dropped: string[] = [];
  const changed = recorded(structuredClone(order), keeper);
  changed.history.onDropped = (path) => dropped.push(path);
  changed.history.opened('/a', 'another');
  assert.deepEqual([changed.history.depth, dropped, [...steps.keys()]], [[0, 1], ['/a'], [1]]);
  await changed.history.redo();
  assert.deepEqual(changed.said, ['+b']);
});

test('the look in the address is read again, and nonsense is left', () => {
  const work = { frames: [2, 9], views: [view(0), view(1)] } as unknown as Work;
  const look = { ...firstLook(work), tool: 'hair' as const, frame: 5, view: 'cam1', marker: 3, brush: 17, erase: true, zoom: { at: [12.5, 8] as [number, number], times: 4 } };
  assert.deepEqual(fromHash(`#${toHash(look)}`, work), look);
  assert.deepEqual(fromHash('#tool=x&frame=99&view=none&marker=-1&brush=1e9&zoom=1,2', work), { ...firstLook(work), frame: 8, brush: 200 });
});

test('corrections come, stay in order, and go with their last label or their marker', () => {
  const doc: LabelDoc = { frame: 0, markers: [{ id: 1, views: { a: [1, 2] } }, { id: 2, views: {} }] };
  putLabel(doc, 9, 2, 'a', [3.14159, 4]);
  putLabel(doc, 5, 1, 'b', [5, 6]);
  putLabel(doc, 5, 2, 'b', [7, 8]);
  assert.deepEqual(doc.corrections?.map((c) => [c.frame, c.markers.map((m) => m.id)]), [[5, [1, 2]], [9, [2]]]);
  assert.deepEqual(labelsAt(doc, 9), [{ id: 2, views: { a: [3.14, 4] } }]);
  putLabel(doc, 9, 2, 'a', null);
  assert.deepEqual(doc.corrections?.map((c) => c.frame), [5]);
  removeMarker(doc, 5, 2);
  assert.deepEqual([labelsAt(doc, 0).map((m) => m.id), labelsAt(doc, 5).map((m) => m.id)], [[1], [1]]);
  removeMarker(doc, 5, 1);
  assert.ok(doc.corrections?.length === 0 && labelsAt(doc, 0).length === 1);
});

test('markers begin in any frame, and tracks in the first that has enough', () => {
  const doc: LabelDoc = { frame: 0, markers: [] };
  for (let id = 0; id < 5; id++) for (const view of ['a', 'b']) putLabel(doc, 7, id, view, [id, id]);
  putLabel(doc, 3, 6, 'a', [1, 1]);
  assert.deepEqual([markersOf(doc), baseOf(doc, [0, 9]), baseOf(doc, [0, 7]), framesOf(doc, 6)], [[0, 1, 2, 3, 4, 6], 7, null, [3]]);
  putLabel(doc, 8, 6, 'b', [1, 1]);
  removeMarker(doc, 8, 6);
  assert.deepEqual(framesOf(doc, 6), [3]);
  putLabel(doc, 8, 6, 'b', [1, 1]);
  removeMarker(doc, 3, 6);
  assert.deepEqual(markersOf(doc), [0, 1, 2, 3, 4]);
});

test('keys have one name each', () => {
  const name = (key: string, more = {}) => nameOf({ key, ctrlKey: false, metaKey: false, altKey: false, shiftKey: false, ...more } as KeyboardEvent);
  assert.deepEqual([name('Z', { shiftKey: true, ctrlKey: true }), name('?', { shiftKey: true }), name('Delete', { shiftKey: true }), name('a', { metaKey: true })], ['ctrl+shift+z', '?', 'shift+Delete', 'ctrl+a']);
});
