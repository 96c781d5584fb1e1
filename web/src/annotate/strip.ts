// The small views: all of them, as large as fit. A click makes one the large view.

import { byId, el } from '../dom.ts';
import type { P2, WorkView } from './camera.ts';

/** A close view shows this share of the image's width. */
const CLOSE = 1 / 6;
const [GAP, CAPTION, LEAST] = [8, 20, 96];

export interface Small {
  image: ImageBitmap | undefined;
  focus: P2 | null;
  caption: string;
  isCurrent: boolean;
  draw: (ink: CanvasRenderingContext2D, px: number) => void;
}

interface Tile {
  view: WorkView;
  node: HTMLElement;
  canvas: HTMLCanvasElement;
  note: HTMLElement;
}

export class Strip {
  private readonly room = byId('strip');
  private readonly tiles: Tile[];

  constructor(views: WorkView[], choose: (view: string) => void) {
    this.tiles = views.map((view, i) => {
      const [canvas, note] = [el('canvas'), el('span')];
      const key = i < 9 ? ` (${i + 1} with Alt)` : '';
      const open = el('button', { type: 'button', className: 'open', title: `${view.name}${key}`, 'aria-label': `Work on ${view.name}`, onclick: () => choose(view.name) }, canvas);
      const name = el('b', {}, view.name);
      const node = el('figure', { className: 'tile' }, open, el('figcaption', {}, name, note));
      if (view.held_out) name.append(el('i', { title: 'held out: takes no part in the reconstruction' }, ' held out'));
      return { view, node, canvas, note };
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
    for (const { view, node, canvas, note } of this.tiles) {
      const { image, focus, caption, isCurrent, draw } = small(view);
      node.classList.toggle('current', isCurrent);
      if (note.textContent !== caption) note.textContent = caption;
      const [width, height] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
      if (width === 0) continue;
      if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
      const ink = canvas.getContext('2d')!;
      const scale = (width / view.width) * (focus ? 1 / CLOSE : 1);
      const at = focus ?? [view.width / 2, view.height / 2];
      ink.setTransform(1, 0, 0, 1, 0, 0);
      ink.clearRect(0, 0, width, height);
      ink.setTransform(scale, 0, 0, scale, width / 2 - at[0] * scale, height / 2 - at[1] * scale);
      if (image) ink.drawImage(image, 0, 0, view.width, view.height);
      ink.save();
      draw(ink, ratio / scale);
      ink.restore();
    }
  }
}
