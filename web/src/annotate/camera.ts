// Cameras with their lenses: the same geometry as the program's, for lines that follow the pointer.

import { distort, undistort } from './lens.ts';
import type { View } from '../protocol.ts';
import type { Lens } from './lens.ts';

export type P2 = [number, number];
export type P3 = [number, number, number];

export interface WorkView extends View {
  distortion: Lens;
}

const add = (a: P3, b: P3, s = 1): P3 => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
const dot = (a: P3, b: P3) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/** The image point of a world point; null behind the camera. */
export function project(view: WorkView, p: P3): P2 | null {
  const m = view.camera_from_world;
  const [x, y, z] = [0, 4, 8].map((r) => m[r] * p[0] + m[r + 1] * p[1] + m[r + 2] * p[2] + m[r + 3]);
  if (!(z > 1e-3)) return null;
  const [u, v] = distort(view.distortion, [x / z, y / z]);
  return [view.fx * u + view.cx, view.fy * v + view.cy];
}

/** The direction (unit) of the ray through an image point; it starts at the view's centre. */
export function direction(view: WorkView, pixel: P2): P3 {
  const [x, y] = undistort(view.distortion, [(pixel[0] - view.cx) / view.fx, (pixel[1] - view.cy) / view.fy]);
  const m = view.camera_from_world;
  const d = [0, 1, 2].map((c) => m[c] * x + m[4 + c] * y + m[8 + c]) as P3;
  return d.map((e) => e / Math.hypot(...d)) as P3;
}

/** Solves a symmetric 3×3 system; null where it has no one solution. */
function solve(a: number[][], b: P3): P3 | null {
  const det = (m: number[][]) =>
    m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0]) + m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
  const whole = det(a);
  if (!(Math.abs(whole) > 1e-12)) return null;
  return [0, 1, 2].map((c) => det(a.map((row, r) => row.map((e, k) => (k === c ? b[r] : e)))) / whole) as P3;
}

/** The point nearest to some rays. */
function nearest(rays: { from: P3; along: P3 }[]): P3 | null {
  const a = [[0, 0, 0], [0, 0, 0], [0, 0, 0]];
  const b: P3 = [0, 0, 0];
  for (const { from, along } of rays) {
    for (let r = 0; r < 3; r++) {
      for (let c = 0; c < 3; c++) {
        const m = (r === c ? 1 : 0) - along[r] * along[c];
        a[r][c] += m;
        b[r] += m * from[c];
      }
    }
  }
  return solve(a, b);
}

/** The point that the cameras look at. */
export function lookedAt(views: WorkView[]): P3 {
  const rays = views.map((view) => ({ from: view.center, along: view.camera_from_world.slice(8, 11) as P3 }));
  return nearest(rays) ?? add(rays[0]?.from ?? [0, 0, 0], rays[0]?.along ?? [0, 0, 1], 1000);
}

/** The point with the least squared distances to its image points; null where rays are parallel or it lies behind a camera. */
export function triangulate(seen: [WorkView, P2][]): P3 | null {
  if (seen.length < 2) return null;
  const start = nearest(seen.map(([view, pixel]) => ({ from: view.center, along: direction(view, pixel) })));
  if (!start) return null;
  let p = start;
  for (let step = 0; step < 10; step++) {
    const a = [[0, 0, 0], [0, 0, 0], [0, 0, 0]];
    const g: P3 = [0, 0, 0];
    for (const [view, pixel] of seen) {
      const at = project(view, p);
      if (!at) return null;
      const moved = ([[1, 0, 0], [0, 1, 0], [0, 0, 1]] as P3[]).map((e) => {
        const [plus, minus] = [project(view, add(p, e, 1e-3)) ?? at, project(view, add(p, e, -1e-3)) ?? at];
        return [(plus[0] - minus[0]) / 2e-3, (plus[1] - minus[1]) / 2e-3];
      });
      for (const k of [0, 1]) {
        for (let r = 0; r < 3; r++) {
          g[r] += moved[r][k] * (at[k] - pixel[k]);
          for (let c = 0; c < 3; c++) a[r][c] += moved[r][k] * moved[c][k];
        }
      }
    }
    const by = solve(a, g);
    if (!by) return start;
    p = add(p, by, -1);
    if (dot(by, by) < 1e-18) break;
  }
  return p;
}

const SAMPLES = 64;

/** What an image point of one view can be in another: a curve where the lens bends it, in the order of depth. */
export function epipolar(from: WorkView, pixel: P2, to: WorkView, centre: P3): P2[] {
  const along = direction(from, pixel);
  const far = Math.hypot(...add(centre, from.center, -1));
  const curve: P2[] = [];
  for (let i = 0; i <= SAMPLES; i++) {
    // From a third of the distance to three times it, evenly in inverse depth: so the picture is sampled evenly.
    const p = project(to, add(from.center, along, far / (1 / 3 + (i / SAMPLES) * (3 - 1 / 3))));
    // A lens is known within its image only.
    const inside = p && p[0] > -0.3 * to.width && p[0] < 1.3 * to.width && p[1] > -0.3 * to.height && p[1] < 1.3 * to.height;
    if (inside) curve.push(p);
  }
  return curve;
}
