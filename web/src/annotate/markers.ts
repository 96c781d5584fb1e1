// Markers: labelled in any frame. Two labelled views tell where a marker is in all.

import { el } from '../dom.ts';
import type { Step } from './history.ts';
import { NEEDED, baseOf, framesOf, labelledFrames, labelsAt, markersOf, putLabel, removeMarker, usableAt } from './labels.ts';
import { colourOf, cross, line, name, ring, swatch } from './marks.ts';
import { epipolar, project, triangulate } from './camera.ts';
import type { P2, P3, WorkView } from './camera.ts';
import { apart, within } from './tool.ts';
import type { Room, Spot, Tone, Tool } from './tool.ts';
import { readJson } from './wire.ts';
import type { LabelDoc, Tracks } from './wire.ts';

const PATH = '/api/labels';
/** How near a click must be to a marker to mean it [px of the screen]. */
const REACH = 9;
/** A label that is further from where all others put it is shown as wrong [px]. */
const WRONG_PX = 2;
/** From more views than that lines are a thicket. */
const CROWD = 3;
/** Fewest known markers that fix the head by themselves where it was lost. */
const FIX = 3;

type Guess = { at: P2; from: 'labels' | 'track' | 'pose' };

export class Markers implements Tool {
  doc: LabelDoc = { frame: 0, markers: [] };
  private isHere = false;
  private asked: Promise<void> | null = null;
  private readonly tracks = new Map<number, Tracks | null>();
  private points = new Map<number, P3>();
  private pointsOf: unknown[] = [];
  /** What follows from the document alone. */
  private known: { of: LabelDoc | null; ids: number[]; base: number | null } = { of: null, ids: [], base: null };
  private drag: { id: number; before: LabelDoc } | null = null;

  constructor(private readonly room: Room) {
    void this.load();
  }

  private load(): Promise<void> {
    this.asked ??= this.fetch().finally(() => { this.asked = null; });
    return this.asked;
  }

  private async fetch(): Promise<void> {
    this.isHere = false;
    try {
      const { value, version } = await readJson<LabelDoc>(this.room.api, PATH);
      this.doc = value;
      this.isHere = true;
      const body = () => ({ bytes: JSON.stringify(this.doc), kind: 'application/json' });
      this.room.saver.open(PATH, version, body, () => { this.room.history.drop(PATH); void this.load(); });
      this.room.redraw();
    } catch (error) {
      this.room.error(error as Error);
    }
  }

  async ready(): Promise<boolean> {
    if (!this.isHere) await this.load();
    return this.isHere;
  }

  restore(_: Step, side: unknown): void {
    this.apply(side as LabelDoc);
  }

  get atRest(): boolean {
    return this.isHere && this.tracks.get(this.room.look.frame) !== null;
  }

  enter(): void {
    if (!this.isHere) void this.load();
    const { frame } = this.room.look;
    if (this.tracks.has(frame)) return;
    this.tracks.set(frame, null);
    this.track(frame);
  }

  refresh(): void {
    const { frame } = this.room.look;
    for (const known of [...this.tracks.keys()]) if (known !== frame) this.tracks.delete(known);
    if (this.tracks.has(frame)) this.track(frame);
  }

  private track(frame: number): void {
    this.room.api.json<Tracks>(`/api/tracks/${frame}`).then((tracks) => this.tracks.set(frame, tracks), (error: Error) => {
      this.tracks.delete(frame);
      this.room.error(error);
    }).finally(() => this.room.redraw());
  }

  // ---- what is where

  private facts() {
    if (this.known.of !== this.doc) this.known = { of: this.doc, ids: markersOf(this.doc), base: baseOf(this.doc, this.room.work.frames) };
    return this.known;
  }

  /** The numbers of all markers. */
  private get ids(): number[] {
    return this.facts().ids;
  }

  /** The frame from which tracks begin. */
  private get base(): number | null {
    return this.facts().base;
  }

  /** Whether labels in this frame correct what is known from another one. */
  private get corrects(): boolean {
    return this.base !== null && this.room.look.frame !== this.base;
  }

  private label(id: number, view: string): P2 | undefined {
    return labelsAt(this.doc, this.room.look.frame).find((m) => m.id === id)?.views[view];
  }

  private seen(id: number): [WorkView, P2][] {
    const marker = labelsAt(this.doc, this.room.look.frame).find((m) => m.id === id);
    return Object.entries(marker?.views ?? {}).flatMap(([name, at]) => {
      const view = this.room.views.find((v) => v.name === name);
      return view ? [[view, at] as [WorkView, P2]] : [];
    });
  }

  /** World position of a marker by its labels. */
  private point(id: number): P3 | undefined {
    const of = [this.doc, this.room.look.frame];
    if (of.some((thing, i) => thing !== this.pointsOf[i])) {
      [this.pointsOf, this.points] = [of, new Map()];
      for (const id of this.ids) {
        const p = triangulate(this.seen(id));
        if (p) this.points.set(id, p);
      }
    }
    return this.points.get(id);
  }

  private tracked(id: number, view: string): P2 | undefined {
    return this.tracks.get(this.room.look.frame)?.views[view]?.[id];
  }

  private guess(id: number, view: WorkView): Guess | null {
    const p = this.point(id);
    const at = p && project(view, p);
    if (at) return { at, from: 'labels' };
    const track = this.tracked(id, view.name);
    if (track) return { at: track, from: 'track' };
    const posed = this.tracks.get(this.room.look.frame)?.markers[id];
    const put = posed && project(view, posed);
    return put ? { at: put, from: 'pose' } : null;
  }

  /** Distance of a label to where all labels put the marker [px]. */
  private residual(id: number, view: WorkView): number | null {
    const [label, p] = [this.label(id, view.name), this.point(id)];
    const at = p && project(view, p);
    return label && at ? apart(label, at) : null;
  }

  private rms(id: number): number | null {
    const off = this.seen(id).map(([view]) => this.residual(id, view)).filter((r): r is number => r !== null);
    return off.length ? Math.sqrt(off.reduce((sum, r) => sum + r * r, 0) / off.length) : null;
  }

  // ---- changes

  private apply(doc: LabelDoc): void {
    // What is not there cannot be saved, so it is not changed.
    if (!this.isHere) return;
    this.doc = doc;
    this.room.saver.save(PATH);
    this.room.redraw();
  }

  private commit(what: string, before: LabelDoc, after: LabelDoc): void {
    const { tool, frame, view, marker } = this.room.look;
    this.apply(after);
    this.room.history.add({ what, path: PATH, look: { tool, frame, view, marker }, before, after, bytes: 2 * JSON.stringify(after).length });
  }

  private change(what: string, how: (doc: LabelDoc) => void): void {
    if (!this.isHere) return;
    const after = structuredClone(this.doc);
    how(after);
    this.commit(what, this.doc, after);
  }

  /** A new marker, in whatever frame. It has its number in the file's first list, and its labels where they are made. */
  fresh(): void {
    if (!this.isHere) return;
    const id = Math.max(-1, ...this.ids) + 1;
    this.change('new marker', (doc) => doc.markers.push({ id, views: {} }));
    this.room.set({ marker: id });
  }

  /** The marker that a click places; a new one where none is chosen. */
  private chosen(): number | null {
    const { marker } = this.room.look;
    if (marker !== null && this.ids.includes(marker)) return marker;
    if (this.corrects) {
      this.room.say('Choose the marker that is here.', 'Click it where it is tracked, in the list, or step with j and k; n begins a new one.');
      return null;
    }
    this.fresh();
    return this.room.look.marker;
  }

  private nearest({ view, at, px }: Spot): number | null {
    let best: [number, number] | null = null;
    for (const id of this.ids) {
      const there = this.label(id, view.name) ?? this.tracked(id, view.name);
      const off = there ? apart(there, at) / px : Infinity;
      if (off <= REACH && (!best || off < best[1])) best = [id, off];
    }
    return best?.[0] ?? null;
  }

  // ---- hands

  down(spot: Spot): void {
    if (!this.isHere) return;
    const hit = this.nearest(spot);
    if (hit !== null) {
      this.room.set({ marker: hit });
      this.drag = { id: hit, before: this.doc };
      return;
    }
    this.act(spot);
    const { marker } = this.room.look;
    if (marker !== null && this.label(marker, spot.view.name)) this.drag = { id: marker, before: this.doc };
  }

  move({ view, at }: Spot): void {
    if (!this.drag) return;
    const doc = structuredClone(this.drag.before);
    putLabel(doc, this.room.look.frame, this.drag.id, view.name, within(view, at));
    this.doc = doc;
    this.room.redraw();
  }

  up(): void {
    const drag = this.drag;
    this.drag = null;
    if (drag && this.doc !== drag.before) this.commit('moved label', drag.before, this.doc);
  }

  act({ view, at }: Spot): void {
    const id = this.chosen();
    if (id === null) return;
    this.change('label', (doc) => putLabel(doc, this.room.look.frame, id, view.name, within(view, at)));
  }

  /** Takes what is predicted in this view for a label; whether it did. */
  accept(): boolean {
    const { marker, view: name } = this.room.look;
    const view = this.room.view(name);
    const guess = marker === null ? null : this.guess(marker, view);
    if (marker === null || !guess) {
      this.room.say('Nothing is predicted in this view.', 'Label the marker in two other views first.');
      return false;
    }
    if (!isInside(view, guess.at)) {
      this.room.say('The marker is outside this view.');
      return false;
    }
    this.change('label', (doc) => putLabel(doc, this.room.look.frame, marker, name, guess.at));
    return true;
  }

  /** Goes to the next view in which the marker is predicted and not labelled. */
  goOn(by: number): void {
    const { views, look: { marker, view } } = this.room;
    if (marker === null) return this.room.say('Choose a marker first.', 'Click it, or step with j and k.');
    const at = views.findIndex((v) => v.name === view);
    const others = views.map((_, i) => views[(((at + by * (i + 1)) % views.length) + views.length) % views.length]);
    const next = others.find((v) => this.isOpen(marker, v) && v.name !== view);
    if (next) this.room.set({ view: next.name });
    else this.room.say(`Marker ${marker} is labelled in every view that predicts it.`);
  }

  private isOpen(id: number, view: WorkView): boolean {
    const guess = this.label(id, view.name) ? null : this.guess(id, view);
    return guess !== null && isInside(view, guess.at);
  }

  step(by: number): void {
    const { ids } = this;
    if (ids.length === 0) return;
    const at = ids.indexOf(this.room.look.marker ?? -1);
    this.room.set({ marker: ids[at < 0 ? 0 : (at + by + ids.length) % ids.length] });
  }

  remove(everywhere: boolean): void {
    const { marker, view, frame } = this.room.look;
    if (marker === null) return;
    if (!everywhere) {
      if (this.label(marker, view)) this.change('removed label', (doc) => putLabel(doc, frame, marker, view, null));
      return;
    }
    this.change('removed marker', (doc) => removeMarker(doc, frame, marker));
    if (!this.ids.includes(marker)) this.room.set({ marker: null });
  }

  // ---- looks

  draw(ink: CanvasRenderingContext2D, view: WorkView, px: number, large: boolean): void {
    const { marker } = this.room.look;
    if (marker !== null) {
      const seen = this.seen(marker);
      // Once it is labelled here, its lines only confirm; those of many views hide what they meet in.
      const isCrowded = seen.length > CROWD;
      ink.globalAlpha = isCrowded ? 0.25 : this.label(marker, view.name) ? 0.35 : 0.9;
      for (const [from, at] of isCrowded && !large ? [] : seen) {
        if (from !== view) line(ink, epipolar(from, at, view, this.room.centre), colourOf(marker), (large ? 1.2 : 0.9) * px);
      }
      ink.globalAlpha = 1;
    }
    for (const id of this.ids) {
      const isChosen = id === marker;
      const [label, guess] = [this.label(id, view.name), this.guess(id, view)];
      if (label) ring(ink, label, (isChosen ? 7 : 5) * px, colourOf(id), isChosen ? 2.4 * px : 1.6 * px);
      // Where all labels together put it: beside the label this is its residual.
      if (guess && (!label || guess.from === 'labels')) {
        if (guess.from === 'track') ring(ink, guess.at, 5 * px, colourOf(id, 0.7), 1.2 * px, [2.5 * px, 2.5 * px]);
        else cross(ink, guess.at, (isChosen ? 6 : 4) * px, colourOf(id), (label ? 1 : 1.4) * px);
      }
      const at = label ?? guess?.at;
      if (at && (large || isChosen)) name(ink, String(id), [at[0] + 9 * px, at[1] - 7 * px], 12 * px, colourOf(id), isChosen);
    }
  }

  caption(view: WorkView): string {
    const { marker } = this.room.look;
    if (marker === null) {
      const count = this.ids.filter((id) => this.label(id, view.name)).length;
      return count ? `${count} labelled` : '';
    }
    const off = this.residual(marker, view);
    if (off !== null) return `${off.toFixed(2)} px`;
    if (this.label(marker, view.name)) return 'labelled';
    const guess = this.guess(marker, view);
    return guess ? { labels: 'predicted', track: 'tracked', pose: 'expected' }[guess.from] : '';
  }

  tone(view: WorkView): Tone {
    const { marker } = this.room.look;
    if (marker === null) return '';
    const off = this.residual(marker, view);
    if (off !== null) return off > WRONG_PX ? 'bad' : '';
    return this.isOpen(marker, view) ? 'todo' : '';
  }

  focus(view: WorkView): P2 | null {
    const { marker } = this.room.look;
    return marker === null ? null : this.label(marker, view.name) ?? this.guess(marker, view)?.at ?? null;
  }

  frames(): number[] {
    return labelledFrames(this.doc);
  }

  /** What labels in this frame do. */
  private about(): string {
    const usable = usableAt(this.doc, this.room.look.frame);
    if (this.base === null) return `${usable} of at least ${NEEDED} markers are labelled here in two or more views. Any frame will do, so long as it has ${NEEDED}: choose one that shows many.`;
    if (!this.corrects) return `${usable} markers are labelled here in two or more views. Tracks begin here, to both ends of the take.`;
    return `Tracks begin in frame ${this.base}. A label here corrects them, up to the next correction; n begins a new marker, which the head carries to all frames.`;
  }

  /** What the last run knows of this frame. */
  private pose(): string {
    const tracks = this.tracks.get(this.room.look.frame);
    if (!this.corrects || !tracks) return '';
    if (tracks.rms_px === null) return 'Not tracked yet: run to stage pose.';
    return `Last run: ${tracks.used} markers, ${tracks.rms_px.toFixed(2)} px${tracks.interpolated ? ', pose between its neighbours' : ''}.`;
  }

  /** What a marker that begins here lacks yet to have a place on the head. */
  private lack(): string {
    const { look: { frame, marker } } = this.room;
    const tracks = this.tracks.get(frame);
    if (!this.corrects || !tracks?.interpolated) return '';
    const begins = (id: number) => framesOf(this.doc, id)[0] === frame;
    const isNew = this.ids.some(begins) || (marker !== null && framesOf(this.doc, marker).length === 0);
    const known = labelsAt(this.doc, frame).filter((m) => !begins(m.id) && Object.keys(m.views).length >= 2).length;
    if (!isNew || known >= FIX) return '';
    return `The last run lost the head here, and a new marker has its place by it: label ${FIX - known} of the known markers here, too.`;
  }

  panel(): (Node | false)[] {
    const { frame, marker } = this.room.look;
    const tracks = this.tracks.get(frame);
    const row = (id: number) => {
      const [views, rms, frames] = [this.seen(id).length, this.rms(id), framesOf(this.doc, id)];
      const tracked = tracks && Object.values(tracks.views).filter((seen) => seen[id]).length;
      const here = views > 0 ? `${views} view${views > 1 ? 's' : ''}` : tracked ? `tracked in ${tracked}` : '';
      const begins = frames.length > 0 && frames[0] !== (this.base ?? frames[0]) ? `from frame ${frames[0]}` : '';
      const words = [here, begins].filter((word) => word !== '').join(', ') || (frames.length > 0 ? `in frame ${frames[0]}` : 'none yet');
      return el(
        'button', { type: 'button', className: 'item', 'aria-pressed': String(id === marker), onclick: () => this.room.set({ marker: id }) },
        swatch(colourOf(id)), el('b', {}, String(id)), el('span', {}, words), el('span', { className: rms !== null && rms > WRONG_PX ? 'bad' : '' }, rms === null ? '' : `${rms.toFixed(2)} px`),
      );
    };
    const [pose, lack] = [this.pose(), this.lack()];
    return [
      el('h2', {}, this.corrects ? 'Corrections' : 'Markers'), el('p', {}, this.about()),
      pose !== '' && el('p', {}, pose),
      lack !== '' && el('p', { className: 'bad' }, lack),
      this.ids.length === 0 && this.isHere && el('p', {}, 'Click a marker in one view, then in a second one: lines show where it can be. From then on m labels it in the others (Shift m goes on to the next), and so does Ctrl and a click in a small view; c shows these close up. n begins the next.'),
      el('div', { className: 'items' }, ...this.ids.map(row)),
    ];
  }

  counters(): Record<string, unknown> {
    const rms = Object.fromEntries(this.ids.map((id) => [id, this.rms(id)]));
    const { marker } = this.room.look;
    const guesses = marker === null ? {} : Object.fromEntries(this.room.views.map((v) => [v.name, this.guess(marker, v)]));
    return { labels: this.doc, rms, guesses, base: this.base };
  }
}

function isInside(view: WorkView, [x, y]: P2): boolean {
  return x >= 0 && y >= 0 && x <= view.width && y <= view.height;
}
