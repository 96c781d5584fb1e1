// Which strand lies under the pointer: the nearest segment on the screen, over all strands that are drawn.

import { MISSING } from './protocol.ts';
import type { Projected, Strands } from './protocol.ts';

export interface Picked {
  /** Index within what was searched, not the strand's number. */
  strand: number;
  /** Point before the place, and how far along to the next. */
  point: number;
  along: number;
  pixels: number;
  depth: number;
}

/** Within this many pixels of the pointer the strand in front wins; beyond, the nearest on the screen. */
const SAME = 2.5;

class Search {
  best: Picked | null = null;

  constructor(private readonly x: number, private readonly y: number, private readonly reach: number) {}

  segment(strand: number, point: number, ax: number, ay: number, az: number, bx: number, by: number, bz: number): void {
    const [dx, dy] = [bx - ax, by - ay];
    const length = dx * dx + dy * dy;
    const along = length > 0 ? Math.min(1, Math.max(0, ((this.x - ax) * dx + (this.y - ay) * dy) / length)) : 0;
    const pixels = Math.hypot(ax + along * dx - this.x, ay + along * dy - this.y);
    if (pixels > this.reach) return;
    const depth = az + along * (bz - az);
    if (this.best) {
      const [now, then] = [Math.max(pixels, SAME), Math.max(this.best.pixels, SAME)];
      if (now > then || (now === then && depth >= this.best.depth)) return;
    }
    this.best = { strand, point, along, pixels, depth };
  }
}

/**
 * `clip`: column-major 4×4 from the strands' space to clip space; `x`, `y` and sizes in pixels from the top left.
 * `drawn`: false for strands that are hidden.
 */
export function pickInSpace(
  s: Strands, clip: ArrayLike<number>, width: number, height: number, x: number, y: number, reach: number,
  drawn: (strand: number) => boolean = () => true,
): Picked | null {
  const search = new Search(x, y, reach);
  const m = clip;
  for (let strand = 0; strand < s.strands; strand++) {
    if (!drawn(strand)) continue;
    let [px, py, pz, had] = [0, 0, 0, false];
    for (let point = 0; point < s.points; point++) {
      const at = (strand * s.points + point) * 3;
      const missing = s.xyz[at] === MISSING;
      const X = s.lo[0] + s.xyz[at] * s.step[0];
      const Y = s.lo[1] + s.xyz[at + 1] * s.step[1];
      const Z = s.lo[2] + s.xyz[at + 2] * s.step[2];
      const w = m[3] * X + m[7] * Y + m[11] * Z + m[15];
      if (missing || w <= 0) {
        had = false;
        continue;
      }
      const sx = ((m[0] * X + m[4] * Y + m[8] * Z + m[12]) / w * 0.5 + 0.5) * width;
      const sy = (0.5 - (m[1] * X + m[5] * Y + m[9] * Z + m[13]) / w * 0.5) * height;
      if (had) search.segment(strand, point - 1, px, py, pz, sx, sy, w);
      [px, py, pz, had] = [sx, sy, w, true];
    }
  }
  return search.best;
}

export function pickOnImage(p: Projected, x: number, y: number, reach: number, drawn: (strand: number) => boolean = () => true): Picked | null {
  const search = new Search(x, y, reach);
  for (let strand = 0; strand < p.strands; strand++) {
    if (!drawn(strand)) continue;
    for (let point = 0; point + 1 < p.points; point++) {
      const at = (strand * p.points + point) * 2;
      const [ax, ay, bx, by] = [p.uv[at], p.uv[at + 1], p.uv[at + 2], p.uv[at + 3]];
      // A missing point is NaN, and so is what is computed with it: no comparison holds.
      if (!(Math.abs(ax + ay + bx + by) < Infinity)) continue;
      search.segment(strand, point, ax, ay, 1, bx, by, 1);
    }
  }
  return search.best;
}

/** The `count` strands whose roots lie nearest to a strand's root, itself first. */
export function neighbours(s: Strands, strand: number, count: number): number[] {
  const root = (i: number) => {
    const at = i * s.points * 3;
    return s.xyz[at] === MISSING ? null : [0, 1, 2].map((k) => s.lo[k] + s.xyz[at + k] * s.step[k]);
  };
  const here = root(strand);
  if (!here) return [strand];
  const near: [number, number][] = [];
  for (let i = 0; i < s.strands; i++) {
    const there = root(i);
    if (there) near.push([Math.hypot(there[0] - here[0], there[1] - here[1], there[2] - here[2]), i]);
  }
  near.sort((a, b) => a[0] - b[0]);
  return near.slice(0, count).map(([, i]) => i);
}
