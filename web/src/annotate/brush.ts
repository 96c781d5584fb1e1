// Painting into a mask of coverage 0 to 255. Image points have the first pixel's centre at (0.5, 0.5).

import type { P2 } from './camera.ts';

export interface Plane {
  width: number;
  height: number;
  data: Uint8Array;
}

/** Half open. */
export interface Rect {
  x0: number;
  y0: number;
  x1: number;
  y1: number;
}

export function union(a: Rect | null, b: Rect): Rect {
  if (!a) return b;
  return { x0: Math.min(a.x0, b.x0), y0: Math.min(a.y0, b.y0), x1: Math.max(a.x1, b.x1), y1: Math.max(a.y1, b.y1) };
}

/** Strokes a capsule from one point to another; its edge is soft over one pixel. What was touched. */
export function stroke(plane: Plane, from: P2, to: P2, radius: number, erase: boolean): Rect {
  const { width, height, data } = plane;
  const reach = radius + 1;
  const clip = (v: number, most: number) => Math.min(most, Math.max(0, v));
  const rect = {
    x0: clip(Math.floor(Math.min(from[0], to[0]) - reach), width),
    y0: clip(Math.floor(Math.min(from[1], to[1]) - reach), height),
    x1: clip(Math.ceil(Math.max(from[0], to[0]) + reach), width),
    y1: clip(Math.ceil(Math.max(from[1], to[1]) + reach), height),
  };
  const [dx, dy] = [to[0] - from[0], to[1] - from[1]];
  const squared = dx * dx + dy * dy;
  for (let y = rect.y0; y < rect.y1; y++) {
    for (let x = rect.x0; x < rect.x1; x++) {
      const [px, py] = [x + 0.5 - from[0], y + 0.5 - from[1]];
      const t = squared > 0 ? clip((px * dx + py * dy) / squared, 1) : 0;
      const cover = Math.round(255 * clip(radius + 0.5 - Math.hypot(px - t * dx, py - t * dy), 1));
      const at = y * width + x;
      data[at] = erase ? Math.min(data[at], 255 - cover) : Math.max(data[at], cover);
    }
  }
  return rect;
}

/** Fills the hole (or erases the piece) that holds a point; nothing where the point is not in one. */
export function fill(plane: Plane, at: P2, erase: boolean): Rect | null {
  const { width, height, data } = plane;
  const [x, y] = [Math.floor(at[0]), Math.floor(at[1])];
  const open = (i: number) => (erase ? data[i] > 0 : data[i] < 255);
  const core = (i: number) => (erase ? data[i] >= 128 : data[i] < 128);
  if (x < 0 || y < 0 || x >= width || y >= height || !core(y * width + x)) return null;
  const seen = new Uint8Array(width * height);
  const queue = [y * width + x];
  seen[queue[0]] = 1;
  let rect: Rect | null = null;
  while (queue.length > 0) {
    const i = queue.pop()!;
    const [px, py] = [i % width, Math.floor(i / width)];
    rect = union(rect, { x0: px, y0: py, x1: px + 1, y1: py + 1 });
    // The soft edge is taken along, but not crossed.
    const inside = core(i);
    data[i] = erase ? 0 : 255;
    if (!inside) continue;
    for (const [nx, ny] of [[px - 1, py], [px + 1, py], [px, py - 1], [px, py + 1]]) {
      const n = ny * width + nx;
      if (nx >= 0 && ny >= 0 && nx < width && ny < height && !seen[n] && open(n)) {
        seen[n] = 1;
        queue.push(n);
      }
    }
  }
  return rect;
}

export function cut(plane: Plane, { x0, y0, x1, y1 }: Rect): Uint8Array {
  const out = new Uint8Array((x1 - x0) * (y1 - y0));
  for (let y = y0; y < y1; y++) out.set(plane.data.subarray(y * plane.width + x0, y * plane.width + x1), (y - y0) * (x1 - x0));
  return out;
}

export function paste(plane: Plane, { x0, y0, x1, y1 }: Rect, piece: Uint8Array): void {
  for (let y = y0; y < y1; y++) plane.data.set(piece.subarray((y - y0) * (x1 - x0), (y - y0 + 1) * (x1 - x0)), y * plane.width + x0);
}
