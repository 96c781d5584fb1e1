// Hair and subject masks: what a person gave or the program made, painted over. The first stroke makes the whole mask given.

import { el } from '../dom.ts';
import { cut, fill, paste, stroke, union } from './brush.ts';
import type { Plane, Rect } from './brush.ts';
import type { P2, WorkView } from './camera.ts';
import { swatch } from './marks.ts';
import { greyPng } from './png.ts';
import type { Step } from './history.ts';
import type { Room, Spot, Tone, Tool } from './tool.ts';
import { readMask } from './wire.ts';
import type { MaskKind, Origin } from './wire.ts';

const COLOURS: Record<MaskKind, [number, number, number]> = { hair: [255, 140, 40], subject: [60, 130, 240] };
/** Of the inside [0 to 255]; its border is seen whatever colour the hair has. */
const [INSIDE, BORDER] = [85, 235];
/** Masks that are kept beside those that are shown [bytes]. */
const MOST_BYTES = 256 * 2 ** 20;

interface Sheet extends Plane {
  path: string;
  view: string;
  frame: number;
  origin: Origin;
  /** The mask as it was before it became a person's, where this page saw it. */
  base: { data: Uint8Array; origin: Origin } | null;
  picture: OffscreenCanvas;
}

/** A part of a mask, before or after a step. */
interface Piece {
  rect: Rect;
  data: Uint8Array;
  origin: Origin;
}

export class Masks implements Tool {
  private readonly sheets = new Map<string, Sheet>();
  private readonly asked = new Map<string, Promise<Sheet | undefined>>();
  private pen: { sheet: Sheet; last: P2; before: Uint8Array; rect: Rect | null } | null = null;

  constructor(private readonly room: Room, private readonly kind: MaskKind) {}

  private path(view: string, frame: number): string {
    return `/api/mask/${this.kind}/${encodeURIComponent(view)}/${frame}`;
  }

  private sheet(view: string): Sheet | undefined {
    return this.sheets.get(this.path(view, this.room.look.frame));
  }

  enter(): void {
    const { frame, view } = this.room.look;
    for (const { name } of [this.room.view(view), ...this.room.views]) void this.load(name, frame);
  }

  /** Masks that the program made may be others by now. */
  refresh(): void {
    for (const sheet of [...this.sheets.values()]) {
      if (sheet.origin === 'given' || !this.room.saver.isSaved(sheet.path)) continue;
      if (sheet.frame === this.room.look.frame) void this.load(sheet.view, sheet.frame, true);
      else this.sheets.delete(sheet.path);
    }
  }

  async ready(): Promise<boolean> {
    const { view, frame } = this.room.look;
    return (await this.load(view, frame)) !== undefined;
  }

  restore(step: Step, side: unknown): void {
    const [sheet, { rect, data, origin }] = [this.sheets.get(step.path), side as Piece];
    if (!sheet) return;
    if (sheet.origin !== 'given' && origin === 'given') sheet.base = { data: sheet.data.slice(), origin: sheet.origin };
    if (origin !== 'given' && sheet.base) this.toBase(sheet);
    else {
      paste(sheet, rect, data);
      sheet.origin = origin;
      this.tint(sheet, rect);
    }
    this.changed(sheet);
  }

  /** The mask as it was before it became a person's. */
  private toBase(sheet: Sheet): void {
    sheet.data.set(sheet.base!.data);
    sheet.origin = sheet.base!.origin;
    this.tint(sheet, whole(sheet));
  }

  get atRest(): boolean {
    return this.room.views.every((view) => this.sheet(view.name)) && this.pen === null;
  }

  private load(view: string, frame: number, anew = false): Promise<Sheet | undefined> {
    const path = this.path(view, frame);
    const known = this.sheets.get(path);
    if (known && !anew) {
      // The last one used is the last to go.
      this.sheets.delete(path);
      this.sheets.set(path, known);
      return Promise.resolve(known);
    }
    const asked = this.asked.get(path) ?? this.fetch(path, view, frame).finally(() => {
      this.asked.delete(path);
      this.room.redraw();
    });
    this.asked.set(path, asked);
    return asked;
  }

  private async fetch(path: string, view: string, frame: number): Promise<Sheet | undefined> {
    try {
      const { version, origin, width, height, data } = await readMask(this.room.api, path);
      const sheet: Sheet = { path, view, frame, origin, base: null, width, height, data: new Uint8Array(data), picture: new OffscreenCanvas(width, height) };
      // A stroke that came meanwhile, or is under way, counts.
      if (!this.room.saver.isSaved(path) || this.pen?.sheet.path === path) return this.sheets.get(path);
      this.sheets.set(path, sheet);
      this.tint(sheet, whole(sheet));
      this.room.saver.open(path, version, () => this.body(path), () => { this.room.history.drop(path); void this.load(view, frame, true); });
      this.bound();
      return sheet;
    } catch (error) {
      this.room.error(error as Error);
      return undefined;
    }
  }

  private async body(path: string) {
    const sheet = this.sheets.get(path);
    if (!sheet || sheet.origin !== 'given') return null;
    return { bytes: await greyPng(sheet.width, sheet.height, sheet.data), kind: 'image/png' };
  }

  private bound(): void {
    let bytes = 0;
    for (const sheet of this.sheets.values()) bytes += 6 * sheet.data.length;
    for (const [path, sheet] of this.sheets) {
      if (bytes <= MOST_BYTES) return;
      if (sheet.frame === this.room.look.frame || !this.room.saver.isSaved(path)) continue;
      this.sheets.delete(path);
      bytes -= 6 * sheet.data.length;
    }
  }

  private tint(sheet: Sheet, touched: Rect): void {
    // A pixel more: borders move with their neighbours.
    const { width, height, data } = sheet;
    const [x0, y0, x1, y1] = [Math.max(0, touched.x0 - 1), Math.max(0, touched.y0 - 1), Math.min(width, touched.x1 + 1), Math.min(height, touched.y1 + 1)];
    if (x1 <= x0 || y1 <= y0) return;
    const ink = sheet.picture.getContext('2d')!;
    const pixels = ink.createImageData(x1 - x0, y1 - y0);
    const [r, g, b] = COLOURS[this.kind];
    const isOut = (x: number, y: number) => x >= 0 && y >= 0 && x < width && y < height && data[y * width + x] < 128;
    let to = 0;
    for (let y = y0; y < y1; y++) {
      for (let x = x0; x < x1; x++, to += 4) {
        const cover = data[y * width + x];
        if (cover === 0) continue;
        const isBorder = cover >= 128 && (isOut(x - 1, y) || isOut(x + 1, y) || isOut(x, y - 1) || isOut(x, y + 1));
        pixels.data[to] = r;
        pixels.data[to + 1] = isBorder ? Math.min(255, g + 60) : g;
        pixels.data[to + 2] = b;
        pixels.data[to + 3] = isBorder ? BORDER : (INSIDE * cover) / 255;
      }
    }
    ink.putImageData(pixels, x0, y0);
  }

  // ---- changes

  private changed(sheet: Sheet): void {
    const given = (this.room.work[this.kind][sheet.view] ??= []);
    const at = given.indexOf(sheet.frame);
    if (sheet.origin === 'given' && at < 0) given.push(sheet.frame);
    if (sheet.origin !== 'given' && at >= 0) given.splice(at, 1);
    this.room.saver.save(sheet.path);
    this.room.redraw();
    if (sheet.origin !== 'given' && !sheet.base) this.reload(sheet);
  }

  /** What the program made comes with the next answer, once the correction is gone from the disk. */
  private reload(sheet: Sheet): void {
    if (this.sheets.get(sheet.path) !== sheet || sheet.origin === 'given' || sheet.base) return;
    if (this.room.saver.isSaved(sheet.path)) void this.load(sheet.view, sheet.frame, true);
    else setTimeout(() => this.reload(sheet), 50);
  }

  /** Makes what was painted a step that can be undone, and saves it. */
  private commit(what: string, sheet: Sheet, before: Uint8Array, rect: Rect | null, origin: Origin): void {
    if (!rect) return;
    const { tool, view, frame } = this.room.look;
    const old = cut({ ...sheet, data: before }, rect);
    const now = cut(sheet, rect);
    const [from, to] = [sheet.origin, origin];
    if (from === to && old.every((v, i) => v === now[i])) return;
    if (from !== 'given' && to === 'given') sheet.base = { data: before === sheet.data ? before.slice() : before, origin: from };
    sheet.origin = to;
    this.changed(sheet);
    this.room.history.add({
      what, path: sheet.path, look: { tool, view, frame },
      before: { rect, data: old, origin: from } satisfies Piece, after: { rect, data: now, origin: to } satisfies Piece,
      bytes: old.length + now.length,
    });
  }

  down(spot: Spot): void {
    const sheet = this.sheet(spot.view.name);
    if (!sheet) return;
    this.pen = { sheet, last: spot.at, before: sheet.data.slice(), rect: null };
    this.move(spot);
  }

  move({ at }: Spot): void {
    const pen = this.pen;
    if (!pen) return;
    const rect = stroke(pen.sheet, pen.last, at, this.room.look.brush, this.room.look.erase);
    this.tint(pen.sheet, rect);
    pen.rect = union(pen.rect, rect);
    pen.last = at;
    this.room.redraw('view');
  }

  up(): void {
    const pen = this.pen;
    this.pen = null;
    if (pen) this.commit('stroke', pen.sheet, pen.before, pen.rect, 'given');
  }

  act(spot: Spot): void {
    this.down(spot);
    this.up();
  }

  /** Fills the hole, or erases the piece, at a place. */
  fill({ view, at }: Spot): void {
    const sheet = this.sheet(view.name);
    if (!sheet) return;
    const before = sheet.data.slice();
    const rect = fill(sheet, at, this.room.look.erase);
    if (!rect) return this.room.say(this.room.look.erase ? 'There is no piece of the mask here.' : 'Here is no hole of the mask.');
    this.tint(sheet, rect);
    this.commit('fill', sheet, before, rect, 'given');
  }

  /** Takes the mask as it is for a correction: a key frame from which it is carried. */
  fresh(): void {
    const sheet = this.sheet(this.room.look.view);
    if (!sheet || sheet.origin === 'given') return;
    this.commit('taken over', sheet, sheet.data, { x0: 0, y0: 0, x1: 1, y1: 1 }, 'given');
  }

  /** Takes the correction back: the program's own mask holds again. */
  remove(everywhere: boolean): void {
    const sheet = this.sheet(this.room.look.view);
    if (!sheet) return;
    const all = whole(sheet);
    const before = sheet.data.slice();
    if (everywhere) {
      sheet.data.fill(0);
      this.tint(sheet, all);
      this.commit('cleared', sheet, before, all, 'given');
    } else if (sheet.origin === 'given') {
      if (sheet.base) {
        this.toBase(sheet);
        sheet.origin = 'given';
      }
      this.commit('mask given back', sheet, before, all, sheet.base?.origin ?? 'none');
    }
  }

  /** The next frame that has a mask of this view given. */
  step(by: number): void {
    const frames = (this.room.work[this.kind][this.room.look.view] ?? []).filter((f) => (f - this.room.look.frame) * by > 0);
    if (frames.length) this.room.set({ frame: by > 0 ? Math.min(...frames) : Math.max(...frames) });
  }

  // ---- looks

  draw(ink: CanvasRenderingContext2D, view: WorkView): void {
    const sheet = this.sheet(view.name);
    if (!sheet) return;
    ink.drawImage(sheet.picture, 0, 0);
  }

  caption(view: WorkView): string {
    const sheet = this.sheet(view.name);
    return sheet ? { given: 'given', computed: 'carried', none: 'no mask' }[sheet.origin] : '';
  }

  /** The first frame needs a hair mask in every view. */
  tone(view: WorkView): Tone {
    return this.missing().includes(view.name) && this.room.look.frame === this.room.work.frames[0] ? 'todo' : '';
  }

  /** Views without the hair mask that a run cannot do without. */
  private missing(): string[] {
    const [first] = this.room.work.frames;
    if (this.kind !== 'hair') return [];
    return this.room.views.filter((view) => !this.room.work.hair[view.name]?.includes(first)).map((view) => view.name);
  }

  focus(): P2 | null {
    return null;
  }

  frames(): number[] {
    return [...new Set(Object.values(this.room.work[this.kind]).flat())].sort((a, b) => a - b);
  }

  panel(): (Node | false)[] {
    const { brush, erase, view } = this.room.look;
    const sheet = this.sheet(view);
    const [r, g, b] = COLOURS[this.kind];
    const held = this.room.work[this.kind][view] ?? [];
    const words = this.kind === 'hair'
      ? 'A mask that you give is carried to the frames around it, as far as they are nearer to it than to another one you gave. The first frame needs one.'
      : 'A mask that you give replaces the computed one of this frame alone.';
    const from = sheet && { given: 'Yours.', computed: 'Made by the last run; a stroke makes it yours.', none: 'None yet: paint one, or run to stage masks.' }[sheet.origin];
    const [first] = this.room.work.frames;
    const missing = this.missing();
    const size = el('input', { type: 'range', min: '1', max: '100', value: String(Math.min(100, brush)), 'aria-label': 'Radius of the brush' });
    size.addEventListener('input', () => this.room.set({ brush: Number(size.value) }));
    const mode = (what: string, on: boolean) =>
      el('button', { type: 'button', 'aria-pressed': String(on), onclick: () => this.room.set({ erase: what === 'Erase' }) }, what);
    return [
      el('h2', {}, swatch(`rgb(${r} ${g} ${b})`), this.kind === 'hair' ? 'Hair mask' : 'Subject mask'),
      el('p', {}, from ?? 'Loading …'),
      el('div', { className: 'switch' }, mode('Paint', !erase), mode('Erase', erase)),
      el('label', { className: 'slide' }, `Brush ${brush} px`, size),
      el('p', {}, words),
      missing.length > 0 && el('p', {}, `Frame ${first} lacks a hair mask in ${missing.length} of ${this.room.views.length} views:`),
      missing.length > 0 && el('div', { className: 'links' }, ...missing.map((name) => el('button', { type: 'button', className: 'quiet', onclick: () => this.room.set({ view: name, frame: first, sheet: false }) }, name))),
      held.length > 0 && el('p', {}, `Given in ${view}: ${[...held].sort((x, y) => x - y).slice(0, 24).join(', ')}${held.length > 24 ? ' …' : ''}`),
    ];
  }

  counters(): Record<string, unknown> {
    const sheet = this.sheet(this.room.look.view);
    if (!sheet) return {};
    let inside = 0;
    for (const v of sheet.data) if (v >= 128) inside += 1;
    return { origin: sheet.origin, inside, size: [sheet.width, sheet.height] };
  }
}

function whole({ width, height }: Plane): Rect {
  return { x0: 0, y0: 0, x1: width, y1: height };
}
