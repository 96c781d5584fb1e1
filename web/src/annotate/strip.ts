// The small views: all of them, as large as fit. A click makes one the large view.

import { byId, el } from '../dom.ts';
import type { P2, WorkView } from './camera.ts';
import { line } from './marks.ts';
import type { Spot, Tone } from './tool.ts';

/** A close view shows this share of the image's width. */
const CLOSE = 1 / 6;
const [GAP, CAPTION, LEAST] = [8, 20, 96];

export interface Small {
  image: ImageBitmap | undefined;
  focus: P2 | null;
  caption: string;
  tone: Tone;
  isCurrent: boolean;
  /** As long as it is the same, so is what `draw` draws. */
  change: string;
  draw: (ink: CanvasRenderingContext2D, px: number) => void;
  /** A line that follows the cursor. */
  guide: P2[];
}

interface Tile {
  view: WorkView;
  node: HTMLElement;
  canvas: HTMLCanvasElement;
  note: HTMLElement;
  /** Everything but the line that follows the cursor. */
  base: HTMLCanvasElement;
  drawn: string;
  isGuided: boolean;
  /** The image point in its middle, and image pixels a pixel of the screen. */
  seen: { at: P2; px: number };
}

export class Strip {
  private readonly room = byId('strip');
  private readonly tiles: Tile[];

  /** A click chooses a view; with Ctrl it is meant for what the view shows there. */
  constructor(views: WorkView[], choose: (view: string) => void, work: (spot: Spot) => void) {
    this.tiles = views.map((view, i) => {
      const [canvas, note] = [el('canvas'), el('span')];
      const key = i < 9 ? ` (${i + 1} with Alt)` : '';
      const open = el('button', { type: 'button', className: 'open', title: `${view.name}${key}`, 'aria-label': `Work on ${view.name}` }, canvas);
      const name = el('b', {}, view.name);
      const node = el('figure', { className: 'tile' }, open, el('figcaption', {}, name, note));
      const tile: Tile = { view, node, canvas, note, base: el('canvas'), drawn: '', isGuided: false, seen: { at: [view.width / 2, view.height / 2], px: 1 } };
      open.addEventListener('click', (event) => {
        if (event.ctrlKey || event.metaKey) work(spotOf(tile, event));
        else choose(view.name);
      });
      if (view.held_out) name.append(el('i', { title: 'held out: takes no part in the reconstruction' }, ' held out'));
      return tile;
    });
    this.room.append(...this.tiles.map((tile) => tile.node));
  }

  /** The number of columns by which the views are largest. */
  layout(): void {
    const { clientWidth: width, clientHeight: height } = this.room;
    const count = this.tiles.length;
    if (count === 0 || width === 0) return;
    const aspect = this.tiles[0].view.width / this.tiles[0].view.height;
    let [best, chosen] = [0, 1];
    for (let columns = 1; columns <= count; columns++) {
      const across = (width - GAP * (columns + 1)) / columns;
      const rows = Math.ceil(count / columns);
      const wide = Math.min(across, ((height - GAP * (rows + 1)) / rows - CAPTION) * aspect);
      if (wide > best) [best, chosen] = [wide, columns];
    }
    // Smaller ones tell nothing: they are scrolled instead.
    if (best < LEAST) [best, chosen] = [LEAST, Math.max(1, Math.floor((width - GAP) / (LEAST + GAP)))];
    this.room.style.gridTemplateColumns = `repeat(${chosen}, max-content)`;
    for (const { canvas, view } of this.tiles) {
      canvas.style.width = `${Math.floor(best)}px`;
      canvas.style.height = `${Math.floor((best * view.height) / view.width)}px`;
    }
  }

  draw(small: (view: WorkView) => Small): void {
    const ratio = Math.min(2, devicePixelRatio);
    for (const tile of this.tiles) {
      const { view, node, canvas, note, base } = tile;
      const { image, focus, caption, tone, isCurrent, change, draw, guide } = small(view);
      node.classList.toggle('current', isCurrent);
      if (note.textContent !== caption) note.textContent = caption;
      if (note.className !== tone) note.className = tone;
      const [width, height] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
      if (width === 0) continue;
      const now = `${width} ${height} ${change}`;
      const isNew = now !== tile.drawn;
      if (!isNew && guide.length === 0 && !tile.isGuided) continue;
      [tile.drawn, tile.isGuided] = [now, guide.length > 0];
      const scale = (width / view.width) * (focus ? 1 / CLOSE : 1);
      const at = focus ?? [view.width / 2, view.height / 2];
      tile.seen = { at, px: ratio / scale };
      const inView = (ink: CanvasRenderingContext2D) =>
        ink.setTransform(scale, 0, 0, scale, width / 2 - at[0] * scale, height / 2 - at[1] * scale);
      if (isNew) {
        for (const one of [canvas, base]) if (one.width !== width || one.height !== height) [one.width, one.height] = [width, height];
        const ink = base.getContext('2d')!;
        ink.setTransform(1, 0, 0, 1, 0, 0);
        ink.clearRect(0, 0, width, height);
        inView(ink);
        if (image) ink.drawImage(image, 0, 0, view.width, view.height);
        draw(ink, ratio / scale);
      }
      const ink = canvas.getContext('2d')!;
      ink.setTransform(1, 0, 0, 1, 0, 0);
      ink.clearRect(0, 0, width, height);
      ink.drawImage(base, 0, 0);
      inView(ink);
      line(ink, guide, '#9be7ff', ratio / scale, [(3 * ratio) / scale, (3 * ratio) / scale]);
    }
  }
}

function spotOf({ view, canvas, seen }: Tile, event: MouseEvent): Spot {
  const box = canvas.getBoundingClientRect();
  const [x, y] = [event.clientX - box.left - box.width / 2, event.clientY - box.top - box.height / 2];
  return { view, at: [seen.at[0] + x * seen.px, seen.at[1] + y * seen.px], px: seen.px };
}
