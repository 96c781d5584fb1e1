// The footage with strands drawn over it: a sheet of all views, or one of them enlarged.

import { bucket, css, tableColour } from './colour.ts';
import type { Rgb, Scale } from './colour.ts';
import { el } from './dom.ts';
import type { Projected, View } from './protocol.ts';

/** Strands of one set as they are to be drawn. */
export interface Drawn {
  projected: Projected;
  /** One a point or one a strand, with its scale; else one colour. */
  values: Float32Array | null;
  scale: Scale | null;
  colour: Rgb;
  /** Numbers of the strands that are shown, where some are hidden; of every `stride`-th. */
  visible: Set<number> | null;
  stride: number;
}

export interface Picture {
  image?: ImageBitmap;
  mask?: ImageBitmap;
  orientation?: ImageBitmap;
  strands: Drawn[];
  mark?: Projected;
  /** What is missing, for whoever looks. */
  note: string;
}

const SHADES = 24;

/** Strokes of one colour go to the canvas in one path: that is what makes thousands of them quick. */
export function strokes(drawn: Drawn): Map<number, Path2D> {
  const paths = new Map<number, Path2D>();
  const { projected: p, values, scale, visible, stride } = drawn;
  const perStrand = values !== null && values.length === p.strands;
  const shades = scale?.categories ? 256 : SHADES;
  for (let strand = 0; strand < p.strands; strand++) {
    if (visible && !visible.has(strand * stride)) continue;
    let [pen, shade] = [null as Path2D | null, -2];
    for (let point = 0; point < p.points; point++) {
      const at = (strand * p.points + point) * 2;
      const [u, v] = [p.uv[at], p.uv[at + 1]];
      // NaN: no such point.
      if (!(Math.abs(u) < 1e5 && Math.abs(v) < 1e5)) {
        pen = null;
        continue;
      }
      if (pen) pen.lineTo(u, v);
      if (values && scale) {
        const b = bucket(scale, values[perStrand ? strand : strand * p.points + point]);
        const next = b < 0 ? -1 : Math.round((b * (shades - 1)) / 255);
        if (next !== shade) [pen, shade] = [null, next];
      } else shade = 0;
      if (!pen) {
        pen = paths.get(shade) ?? new Path2D();
        paths.set(shade, pen);
        pen.moveTo(u, v);
      }
    }
  }
  return paths;
}

function shadeColour(drawn: Drawn, shade: number): string {
  if (!drawn.scale) return css(drawn.colour);
  if (shade < 0) return css([138, 138, 138]);
  return css(tableColour(drawn.scale.table, Math.round((shade * 255) / ((drawn.scale.categories ? 256 : SHADES) - 1))));
}

class Tile {
  readonly node: HTMLElement;
  readonly canvas = el('canvas');
  private readonly note = el('span', { className: 'note' });
  private seen: unknown[] = [];

  constructor(readonly view: View, open: () => void) {
    this.node = el(
      'figure', { className: 'tile' },
      el('button', { className: 'open', title: `Enlarge ${view.name}`, 'aria-label': `Enlarge ${view.name}`, onclick: open }, this.canvas),
      el('figcaption', {}, el('b', {}, view.name), this.note),
    );
  }

  draw(picture: Picture, opacity: number, wide: number): void {
    const { view, canvas } = this;
    const box = canvas.getBoundingClientRect();
    const ratio = Math.min(2, devicePixelRatio);
    const [width, height] = [Math.round(box.width * ratio), Math.round(box.height * ratio)];
    if (width === 0) return;
    if (this.note.textContent !== picture.note) this.note.textContent = picture.note;
    // Thousands of strokes are dear: only where something is new.
    const seen = [
      picture.image, picture.mask, picture.orientation, picture.mark, opacity, wide, width, height, picture.strands.length,
      ...picture.strands.flatMap((d) => [d.projected, d.values, d.scale?.table, ...(d.scale?.range ?? []), ...d.colour, d.visible]),
    ];
    if (seen.length === this.seen.length && seen.every((thing, i) => thing === this.seen[i])) return;
    this.seen = seen;
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    const ink = canvas.getContext('2d')!;
    ink.setTransform(width / view.width, 0, 0, height / view.height, 0, 0);
    ink.globalAlpha = 1;
    ink.clearRect(0, 0, view.width, view.height);
    for (const bitmap of [picture.image, picture.mask, picture.orientation]) {
      if (!bitmap) continue;
      ink.globalAlpha = bitmap === picture.image ? 1 : 0.75;
      ink.drawImage(bitmap, 0, 0, view.width, view.height);
    }
    const pixel = view.width / width;
    ink.lineJoin = ink.lineCap = 'round';
    ink.lineWidth = Math.max(pixel * 0.9, wide);
    ink.globalAlpha = opacity;
    for (const drawn of picture.strands) {
      for (const [shade, path] of strokes(drawn)) {
        ink.strokeStyle = shadeColour(drawn, shade);
        ink.stroke(path);
      }
    }
    if (picture.mark) {
      const path = strokes({ projected: picture.mark, values: null, scale: null, colour: [0, 0, 0], visible: null, stride: 1 }).get(0);
      ink.globalAlpha = 1;
      for (const [colour, width] of [['#000', 4.5], ['#ff3d81', 2.6]] as const) {
        ink.strokeStyle = colour;
        ink.lineWidth = width * pixel * ratio;
        if (path) ink.stroke(path);
      }
    }
  }
}

export class Footage {
  private readonly tiles: Tile[];
  private enlarged = '';

  constructor(
    private readonly room: HTMLElement,
    views: View[],
    open: (view: string) => void,
    /** A click on the enlarged view, in pixels of its image. */
    picked: (u: number, v: number, reach: number) => void,
  ) {
    this.tiles = views.map((view) => new Tile(view, () => this.enlarged || open(view.name)));
    for (const tile of this.tiles) {
      tile.canvas.addEventListener('click', (event) => {
        if (!this.enlarged) return;
        const box = tile.canvas.getBoundingClientRect();
        const scale = tile.view.width / box.width;
        picked((event.clientX - box.left) * scale, (event.clientY - box.top) * scale, 10 * scale);
      });
    }
    room.append(...this.tiles.map((tile) => tile.node));
  }

  /** The sheet is cut so that the views are as large as they can be. */
  layout(enlarged: string): void {
    this.enlarged = enlarged;
    const shown = this.tiles.filter((tile) => !enlarged || tile.view.name === enlarged);
    for (const tile of this.tiles) {
      tile.node.hidden = !shown.includes(tile);
      tile.node.classList.toggle('one', tile.view.name === enlarged);
    }
    if (shown.length === 0) return;
    const { clientWidth: width, clientHeight: height } = this.room;
    const aspect = shown[0].view.width / shown[0].view.height;
    const [gap, caption] = [12, 26];
    let best = 0;
    for (let columns = 1; columns <= shown.length; columns++) {
      const rows = Math.ceil(shown.length / columns);
      const across = (width - gap * (columns + 1)) / columns;
      const down = ((height - gap * (rows + 1)) / rows - caption) * aspect;
      best = Math.max(best, Math.min(across, down));
    }
    for (const tile of shown) {
      tile.canvas.style.width = `${Math.floor(best)}px`;
      tile.canvas.style.height = `${Math.floor((best * tile.view.height) / tile.view.width)}px`;
    }
  }

  draw(picture: (view: View) => Picture, opacity: number): void {
    for (const tile of this.tiles) {
      if (!tile.node.hidden) tile.draw(picture(tile.view), opacity, this.enlarged ? 0.45 : 0.7);
    }
  }
}
