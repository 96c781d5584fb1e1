// Strands drawn in two or more views, root first. Each is guided by what it is in the views before.

import { el } from '../dom.ts';
import { epipolar, project, triangulate } from './camera.ts';
import type { P2, P3, WorkView } from './camera.ts';
import { colourOf, line, swatch } from './marks.ts';
import type { Step } from './history.ts';
import { apart, rounded, within } from './tool.ts';
import type { Room, Spot, Tone, Tool } from './tool.ts';
import { readJson } from './wire.ts';
import type { SketchDoc } from './wire.ts';

/** Points of a stroke are so far apart [px of the screen], and at least one of the image. */
const STEP = 3;
/** How near a click with Shift must be to a strand to choose it [px of the screen]. */
const REACH = 9;
/** Points by which a drawn strand is compared with another view. */
const SAMPLES = 24;

export class Sketches implements Tool {
  private readonly docs = new Map<number, SketchDoc | null>();
  private readonly asked = new Map<number, Promise<void>>();
  private pen: { before: SketchDoc; id: number; points: P2[] } | null = null;
  private guesses = new Map<number, P3[]>();
  private guessesOf: unknown = null;

  constructor(private readonly room: Room) {}

  private get doc(): SketchDoc | null {
    return this.docs.get(this.room.look.frame) ?? null;
  }

  get atRest(): boolean {
    return this.doc !== null && this.pen === null;
  }

  enter(): void {
    const { frame } = this.room.look;
    if (!this.docs.has(frame)) void this.load(frame);
  }

  refresh(): void {}

  async ready(): Promise<boolean> {
    const { frame } = this.room.look;
    if (!this.docs.get(frame)) await (this.asked.get(frame) ?? this.load(frame));
    return !!this.docs.get(frame);
  }

  restore(step: Step, side: unknown): void {
    this.apply(step.look.frame!, side as SketchDoc);
  }

  private load(frame: number): Promise<void> {
    const asked = this.fetch(frame).finally(() => this.asked.delete(frame));
    this.asked.set(frame, asked);
    return asked;
  }

  private async fetch(frame: number): Promise<void> {
    this.docs.set(frame, null);
    const path = `/api/sketches/${frame}`;
    try {
      const { value, version } = await readJson<SketchDoc>(this.room.api, path);
      this.docs.set(frame, value);
      const body = () => ({ bytes: JSON.stringify(this.docs.get(frame)), kind: 'application/json' });
      this.room.saver.open(path, version, body, () => { this.room.history.drop(path); void this.load(frame); });
    } catch (error) {
      this.docs.delete(frame);
      this.room.error(error as Error);
    }
    this.room.redraw();
  }

  // ---- changes

  private apply(frame: number, doc: SketchDoc): void {
    this.docs.set(frame, doc);
    const known = this.room.work.sketches.filter((f) => f !== frame);
    this.room.work.sketches = doc.strands.length ? [...known, frame].sort((a, b) => a - b) : known;
    this.room.saver.save(`/api/sketches/${frame}`);
    this.room.redraw();
  }

  private commit(what: string, before: SketchDoc, after: SketchDoc): void {
    const { tool, frame, view, strand } = this.room.look;
    this.apply(frame, after);
    this.room.history.add({
      what, path: `/api/sketches/${frame}`, look: { tool, frame, view, strand }, before, after, bytes: 2 * JSON.stringify(after).length,
    });
  }

  private put(doc: SketchDoc, id: number, view: string, points: P2[] | null): SketchDoc {
    const after = structuredClone(doc);
    let strand = after.strands.find((s) => s.id === id);
    if (!strand) after.strands.push(strand = { id, views: {} });
    if (points) strand.views[view] = points.map(rounded);
    else delete strand.views[view];
    after.strands = after.strands.filter((s) => Object.keys(s.views).length > 0).sort((a, b) => a.id - b.id);
    return after;
  }

  private drawn(id: number | null, view: string): P2[] | undefined {
    return this.doc?.strands.find((s) => s.id === id)?.views[view];
  }

  fresh(): void {
    this.room.set({ strand: Math.max(-1, ...(this.doc?.strands ?? []).map((s) => s.id)) + 1 });
  }

  step(by: number): void {
    const ids = (this.doc?.strands ?? []).map((s) => s.id);
    if (ids.length === 0) return;
    const at = ids.indexOf(this.room.look.strand ?? -1);
    this.room.set({ strand: ids[at < 0 ? 0 : (at + by + ids.length) % ids.length] });
  }

  remove(everywhere: boolean): void {
    const { strand, view } = this.room.look;
    if (!this.doc || strand === null) return;
    if (everywhere) this.commit('removed strand', this.doc, { strands: this.doc.strands.filter((s) => s.id !== strand) });
    else if (this.drawn(strand, view)) this.commit('removed stroke', this.doc, this.put(this.doc, strand, view, null));
  }

  // ---- hands

  choose({ view, at, px }: Spot): void {
    let best: [number, number] | null = null;
    for (const { id, views } of this.doc?.strands ?? []) {
      for (const p of views[view.name] ?? []) {
        const off = apart(p, at) / px;
        if (off <= REACH && (!best || off < best[1])) best = [id, off];
      }
    }
    if (best) this.room.set({ strand: best[0] });
  }

  down({ view, at }: Spot): void {
    if (!this.doc) return;
    if (this.room.look.strand === null) this.fresh();
    this.pen = { before: this.doc, id: this.room.look.strand!, points: [within(view, at)] };
  }

  move({ view, at, px }: Spot): void {
    if (!this.pen) return;
    const p = within(view, at);
    if (apart(p, this.pen.points.at(-1)!) < Math.max(1, STEP * px)) return;
    this.pen.points.push(p);
    this.room.redraw('view');
  }

  up(): void {
    const pen = this.pen;
    this.pen = null;
    if (pen && pen.points.length >= 2) this.commit('stroke', pen.before, this.put(pen.before, pen.id, this.room.look.view, pen.points));
  }

  /** Adds a point to the stroke of this view. */
  act({ view, at }: Spot): void {
    if (!this.doc) return;
    if (this.room.look.strand === null) this.fresh();
    const { strand, frame } = this.room.look;
    const isBegun = this.begun?.frame === frame && this.begun.view === view.name && this.begun.id === strand;
    const old = this.drawn(strand, view.name) ?? (isBegun ? [this.begun!.at] : []);
    const points = [...old, within(view, at)];
    this.begun = points.length === 1 ? { frame, view: view.name, id: strand!, at: points[0] } : null;
    if (points.length >= 2) this.commit('point', this.doc, this.put(this.doc, strand!, view.name, points));
    else this.room.redraw();
  }

  /** The first point of a stroke that is set by key: one point is no stroke yet. */
  private begun: { frame: number; view: string; id: number; at: P2 } | null = null;

  // ---- looks

  draw(ink: CanvasRenderingContext2D, view: WorkView, px: number, large: boolean): void {
    const { strand, view: current } = this.room.look;
    const strands = this.doc?.strands ?? [];
    const chosen = strands.find((s) => s.id === strand);
    for (const [name, points] of Object.entries(chosen?.views ?? {})) {
      const from = this.room.views.find((v) => v.name === name);
      if (!from || from === view) continue;
      // Where the root must be, and faintly the tip.
      line(ink, epipolar(from, points[0], view, this.room.centre), '#ffe08a', (large ? 1.3 : 1) * px);
      line(ink, epipolar(from, points.at(-1)!, view, this.room.centre), 'rgb(255 255 255 / 60%)', 0.9 * px, [4 * px, 4 * px]);
    }
    for (const { id, views } of strands) {
      const isChosen = id === strand;
      const points = views[view.name];
      const width = (isChosen ? 2.2 : 1.4) * px;
      if (points) {
        line(ink, points, colourOf(id), width);
        dot(ink, points[0], (isChosen ? 4 : 3) * px, colourOf(id));
      } else {
        const guess = this.guess(id).map((p) => project(view, p)).filter((p): p is P2 => p !== null);
        line(ink, guess, colourOf(id), 1.2 * px, [3 * px, 3 * px]);
      }
    }
    if (this.pen && view.name === current) {
      line(ink, this.pen.points, colourOf(this.pen.id), 2.2 * px);
      dot(ink, this.pen.points[0], 4 * px, colourOf(this.pen.id));
    }
    if (this.begun?.frame === this.room.look.frame && this.begun.view === view.name) dot(ink, this.begun.at, 4 * px, colourOf(this.begun.id));
  }

  /** The strand in space, by its first two views: where each point's line meets the other stroke. For looking only. */
  private guess(id: number): P3[] {
    if (this.guessesOf !== this.doc) [this.guessesOf, this.guesses] = [this.doc, new Map()];
    const known = this.guesses.get(id);
    if (known) return known;
    const views = Object.entries(this.doc?.strands.find((s) => s.id === id)?.views ?? {}).slice(0, 2);
    const [a, b] = views.map(([name, points]) => ({ view: this.room.views.find((v) => v.name === name), points }));
    const found: P3[] = [];
    if (a?.view && b?.view) {
      let from = 0;
      for (const p of evenly(a.points, SAMPLES)) {
        const meets = crossing(b.points, from, epipolar(a.view, p, b.view, this.room.centre));
        if (!meets) continue;
        from = meets.along;
        const at = triangulate([[a.view, p], [b.view, meets.at]]);
        if (at) found.push(at);
      }
    }
    this.guesses.set(id, found);
    return found;
  }

  caption(view: WorkView): string {
    const { strand } = this.room.look;
    if (strand !== null) return this.drawn(strand, view.name) ? 'drawn' : '';
    const count = (this.doc?.strands ?? []).filter((s) => s.views[view.name]).length;
    return count ? `${count} strands` : '';
  }

  tone(): Tone {
    return '';
  }

  focus(view: WorkView): P2 | null {
    const { strand } = this.room.look;
    const points = this.drawn(strand, view.name);
    if (points) return points[Math.floor(points.length / 2)];
    const guess = strand === null ? [] : this.guess(strand);
    return guess.length ? project(view, guess[Math.floor(guess.length / 2)]) : null;
  }

  frames(): number[] {
    return this.room.work.sketches;
  }

  panel(): (Node | false)[] {
    const { strand } = this.room.look;
    const strands = this.doc?.strands ?? [];
    const row = ({ id, views }: SketchDoc['strands'][number]) => {
      const count = Object.keys(views).length;
      return el(
        'button', { type: 'button', className: 'item', 'aria-pressed': String(id === strand), onclick: () => this.room.set({ strand: id }) },
        swatch(colourOf(id)), el('b', {}, String(id)), el('span', {}, `${count} view${count > 1 ? 's' : ''}`),
        el('span', { className: count < 2 ? 'bad' : '' }, count < 2 ? 'needs another' : ''),
      );
    };
    const isNew = strand !== null && !strands.some((s) => s.id === strand);
    return [
      el('h2', {}, 'Sketched strands'),
      el('p', {}, 'Draw a strand from its root to its tip, then the same strand in another view. The yellow line holds its root, the dashed one its tip.'),
      el('div', { className: 'items' }, ...strands.map(row)),
      isNew && el('p', {}, `Strand ${strand} is new: draw it.`),
    ];
  }

  counters(): Record<string, unknown> {
    return { sketches: this.doc, guess: this.room.look.strand === null ? [] : this.guess(this.room.look.strand) };
  }
}

function dot(ink: CanvasRenderingContext2D, [x, y]: P2, radius: number, colour: string): void {
  ink.beginPath();
  ink.arc(x, y, radius, 0, 2 * Math.PI);
  ink.fillStyle = colour;
  ink.fill();
  ink.strokeStyle = 'rgb(0 0 0 / 70%)';
  ink.lineWidth = radius / 3;
  ink.stroke();
}

/** Points of a line at even distances. */
function evenly(points: P2[], count: number): P2[] {
  const lengths = [0];
  for (let i = 1; i < points.length; i++) lengths.push(lengths[i - 1] + apart(points[i - 1], points[i]));
  const whole = lengths.at(-1)!;
  let k = 1;
  return Array.from({ length: count }, (_, n) => {
    const want = (whole * n) / (count - 1);
    while (k < points.length - 1 && lengths[k] < want) k += 1;
    const [a, b, span] = [points[k - 1], points[k], lengths[k] - lengths[k - 1]];
    const t = span > 0 ? Math.min(1, Math.max(0, (want - lengths[k - 1]) / span)) : 0;
    return [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])] as P2;
  });
}

/** Where a curve first meets a line of points, not before a place along it. */
function crossing(points: P2[], from: number, curve: P2[]): { at: P2; along: number } | null {
  for (let i = Math.floor(from); i + 1 < points.length; i++) {
    for (let j = 0; j + 1 < curve.length; j++) {
      const [a, b, c, d] = [points[i], points[i + 1], curve[j], curve[j + 1]];
      const [abx, aby, cdx, cdy] = [b[0] - a[0], b[1] - a[1], d[0] - c[0], d[1] - c[1]];
      const det = abx * cdy - aby * cdx;
      if (Math.abs(det) < 1e-9) continue;
      const t = ((c[0] - a[0]) * cdy - (c[1] - a[1]) * cdx) / det;
      const s = ((c[0] - a[0]) * aby - (c[1] - a[1]) * abx) / det;
      if (t >= 0 && t <= 1 && s >= 0 && s <= 1 && i + t >= from) return { at: [a[0] + t * abx, a[1] + t * aby], along: i + t };
    }
  }
  return null;
}
