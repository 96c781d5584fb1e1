// A curve over the frames, as SVG. The place of things is computed apart from the drawing, so that it can be tested.

import { number } from './colour.ts';
import { svg } from './dom.ts';

export interface Frame {
  x: (frame: number) => number;
  y: (value: number) => number;
  lo: number;
  hi: number;
}

/** A range with some air around it; one value alone gets a range as well. */
export function extent(values: (number | null)[]): [number, number] | null {
  const known = values.filter((v): v is number => v !== null && Number.isFinite(v));
  if (known.length === 0) return null;
  const [lo, hi] = [Math.min(...known), Math.max(...known)];
  const air = hi > lo ? (hi - lo) * 0.08 : Math.max(1e-3, Math.abs(hi) * 0.05);
  return [lo - air, hi + air];
}

/** Path data; the pen is lifted where values are missing. */
export function curve(frames: number[], values: (number | null)[], x: (f: number) => number, y: (v: number) => number): string {
  let [path, down] = ['', false];
  for (const [i, frame] of frames.entries()) {
    const v = values[i];
    if (v === null || v === undefined || !Number.isFinite(v)) {
      down = false;
      continue;
    }
    path += `${down ? 'L' : 'M'}${x(frame).toFixed(1)} ${y(v).toFixed(1)}`;
    down = true;
  }
  return path;
}

const WIDTH = 268;
const HEIGHT = 66;
const LEFT = 2;
const RIGHT = 2;

export interface Plot {
  node: SVGElement;
  at: (frame: number) => void;
}

/** `go` is called with the frame that is clicked. */
export function plot(title: string, unit: string, frames: number[], values: (number | null)[], go: (frame: number) => void): Plot | null {
  const range = extent(values);
  if (!range || frames.length === 0) return null;
  const [lo, hi] = range;
  const [first, last] = [frames[0], Math.max(frames[0] + 1, frames[frames.length - 1])];
  const x = (frame: number) => LEFT + ((frame - first) / (last - first)) * (WIDTH - LEFT - RIGHT);
  const y = (value: number) => HEIGHT - 3 - ((value - lo) / (hi - lo)) * (HEIGHT - 22);
  const known = values.filter((v): v is number => v !== null && Number.isFinite(v));
  const now = svg('text', { x: WIDTH - RIGHT, y: 11, class: 'now', 'text-anchor': 'end' });
  const cursor = svg('line', { class: 'cursor', y1: 18, y2: HEIGHT });
  const dot = svg('circle', { class: 'dot', r: 3 });
  const node = svg(
    'svg', { class: 'plot', viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: 'img', 'aria-label': `${title} over time, ${number(Math.min(...known))} to ${number(Math.max(...known))} ${unit}` },
    svg('text', { x: LEFT, y: 11, class: 'title' }, title),
    now,
    svg('line', { class: 'base', x1: LEFT, x2: WIDTH - RIGHT, y1: HEIGHT - 1, y2: HEIGHT - 1 }),
    svg('path', { class: 'curve', d: curve(frames, values, x, y) }),
    cursor,
    dot,
  );
  node.addEventListener('click', (event) => {
    const box = node.getBoundingClientRect();
    const along = (((event as MouseEvent).clientX - box.left) / box.width) * WIDTH;
    go(Math.round(first + ((along - LEFT) / (WIDTH - LEFT - RIGHT)) * (last - first)));
  });
  const at = (frame: number) => {
    const value = values[frames.indexOf(frame)];
    const here = x(Math.min(last, Math.max(first, frame))).toFixed(1);
    cursor.setAttribute('x1', here);
    cursor.setAttribute('x2', here);
    const is = value !== undefined && value !== null && Number.isFinite(value);
    dot.setAttribute('visibility', is ? 'visible' : 'hidden');
    dot.setAttribute('cx', here);
    if (is) dot.setAttribute('cy', y(value).toFixed(1));
    now.textContent = `${number(value)} ${unit}`;
  };
  return { node, at };
}
