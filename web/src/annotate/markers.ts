// Markers: labelled in one frame, corrected in others. Two labelled views tell where a marker is in all.

import { el } from '../dom.ts';
import { labelsAt, putLabel, removeMarker } from './labels.ts';
import { colourOf, cross, line, name, ring, swatch } from './marks.ts';
import { epipolar, project, triangulate } from './camera.ts';
import type { P2, P3, WorkView } from './camera.ts';
import { apart, within } from './tool.ts';
import type { Room, Spot, Tool } from './tool.ts';
import { readJson } from './wire.ts';
import type { LabelDoc, Marker, Tracks } from './wire.ts';

const PATH = '/api/labels';
/** How near a click must be to a marker to mean it [px of the screen]. */
const REACH = 9;

type Guess = { at: P2; from: 'labels' | 'track' | 'pose' };

export class Markers implements Tool {
  doc: LabelDoc = { frame: 0, markers: [] };
  private isHere = false;
  private isAsked = false;
  private readonly tracks = new Map<number, Tracks | null>();
  private points = new Map<number, P3>();
  private pointsOf: unknown[] = [];
  private drag: { id: number; before: LabelDoc } | null = null;

  constructor(private readonly room: Room) {
    void this.load();
  }

  async load(): Promise<void> {
    [this.isHere, this.isAsked] = [false, true];
    try {
      const { value, version } = await readJson<LabelDoc>(this.room.api, PATH);
      this.doc = value;
      this.isHere = true;
      const body = () => ({ bytes: JSON.stringify(this.doc), kind: 'application/json' });
      this.room.saver.open(PATH, version, body, () => { this.room.history.clear(); void this.load(); });
      this.room.redraw();
    } catch (error) {
      this.room.error(error as Error);
    } finally {
      this.isAsked = false;
    }
  }

  get atRest(): boolean {
    return this.isHere && this.tracks.get(this.room.look.frame) !== null;
  }

  enter(): void {
    if (!this.isHere && !this.isAsked) void this.load();
    const { frame } = this.room.look;
    if (this.tracks.has(frame)) return;
    this.tracks.set(frame, null);
    this.room.api.json<Tracks>(`/api/tracks/${frame}`).then((tracks) => this.tracks.set(frame, tracks), (error: Error) => {
      this.tracks.delete(frame);
      this.room.error(error);
    }).finally(() => this.room.redraw());
  }

  // ---- what is where

  private get isFirst(): boolean {
    return this.room.look.frame === this.doc.frame;
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
      for (const marker of this.doc.markers) {
        const p = triangulate(this.seen(marker.id));
        if (p) this.points.set(marker.id, p);
      }
    }
    return this.points.get(id);
  }

  private track(id: number, view: string): P2 | undefined {
    return this.isFirst ? undefined : this.tracks.get(this.room.look.frame)?.views[view]?.[id];
  }

  private guess(id: number, view: WorkView): Guess | null {
    const p = this.point(id);
    const at = p && project(view, p);
    if (at) return { at, from: 'labels' };
    const track = this.track(id, view.name);
    if (track) return { at: track, from: 'track' };
    const posed = this.isFirst ? undefined : this.tracks.get(this.room.look.frame)?.markers[id];
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
    this.room.history.add({
      what, bytes: 0,
      show: () => this.room.set({ tool, frame, view, marker }),
      undo: () => this.apply(before),
      redo: () => this.apply(after),
    });
  }

  private change(what: string, how: (doc: LabelDoc) => void): void {
    if (!this.isHere) return;
    const after = structuredClone(this.doc);
    how(after);
    this.commit(what, this.doc, after);
  }

  private newId(): number {
    return Math.max(-1, ...this.doc.markers.map((m) => m.id)) + 1;
  }

  fresh(): void {
    if (!this.isFirst) {
      this.room.say('New markers are labelled in the first frame.', `Home goes to frame ${this.doc.frame}; here markers are corrected.`);
      return;
    }
    const id = this.newId();
    this.change('new marker', (doc) => doc.markers.push({ id, views: {} }));
    this.room.set({ marker: id });
  }

  /** The marker that a click places; a new one where none is chosen. */
  private chosen(): number | null {
    const { marker } = this.room.look;
    if (marker !== null && this.doc.markers.some((m) => m.id === marker)) return marker;
    if (!this.isFirst) {
      this.room.say('Choose the marker that is here.', 'Click it where it is tracked, in the list, or step with j and k.');
      return null;
    }
    this.fresh();
    return this.room.look.marker;
  }

  private nearest({ view, at, px }: Spot): number | null {
    let best: [number, number] | null = null;
    for (const { id } of this.doc.markers) {
      const there = this.label(id, view.name) ?? this.track(id, view.name);
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

  /** Takes what is predicted in this view for a label. */
  accept(): void {
    const { marker, view: name } = this.room.look;
    const view = this.room.view(name);
    const guess = marker === null ? null : this.guess(marker, view);
    if (marker === null || !guess) {
      this.room.say('Nothing is predicted in this view.', 'Label the marker in two other views first.');
      return;
    }
    if (guess.at[0] < 0 || guess.at[1] < 0 || guess.at[0] > view.width || guess.at[1] > view.height) {
      this.room.say('The marker is outside this view.');
      return;
    }
    this.change('label', (doc) => putLabel(doc, this.room.look.frame, marker, name, guess.at));
  }

  step(by: number): void {
    const ids = this.doc.markers.map((m) => m.id);
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
    if (this.isFirst) this.room.set({ marker: null });
  }

  // ---- looks

  draw(ink: CanvasRenderingContext2D, view: WorkView, px: number, large: boolean): void {
    const { marker } = this.room.look;
    if (marker !== null) {
      // Once it is labelled here, its lines only confirm.
      ink.globalAlpha = this.label(marker, view.name) ? 0.35 : 0.9;
      for (const [from, at] of this.seen(marker)) {
        if (from !== view) line(ink, epipolar(from, at, view, this.room.centre), colourOf(marker), (large ? 1.2 : 0.9) * px);
      }
      ink.globalAlpha = 1;
    }
    for (const { id } of this.doc.markers) {
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
      const count = this.doc.markers.filter((m) => this.label(m.id, view.name)).length;
      return count ? `${count} labelled` : '';
    }
    const off = this.residual(marker, view);
    if (off !== null) return `${off.toFixed(2)} px`;
    if (this.label(marker, view.name)) return 'labelled';
    const guess = this.guess(marker, view);
    return guess ? { labels: 'predicted', track: 'tracked', pose: 'expected' }[guess.from] : '';
  }

  focus(view: WorkView): P2 | null {
    const { marker } = this.room.look;
    return marker === null ? null : this.label(marker, view.name) ?? this.guess(marker, view)?.at ?? null;
  }

  frames(): number[] {
    const first = this.doc.markers.length ? [this.doc.frame] : [];
    return [...first, ...(this.doc.corrections ?? []).map((c) => c.frame)];
  }

  panel(): (Node | false)[] {
    const { frame, marker } = this.room.look;
    const tracks = this.tracks.get(frame);
    const usable = this.doc.markers.filter((m) => Object.keys(m.views).length >= 2).length;
    const pose = tracks && tracks.rms_px !== null
      ? `Pose of the last run: ${tracks.used} markers, ${tracks.rms_px.toFixed(2)} px${tracks.interpolated ? ', between its neighbours' : ''}.`
      : 'This frame was not tracked yet: run to stage pose.';
    const about = this.isFirst
      ? `${usable} of at least 5 markers are labelled in two or more views.`
      : `${pose} What you label here corrects the tracks before and after, up to the next correction.`;
    const row = ({ id }: Marker) => {
      const [views, rms] = [this.seen(id).length, this.rms(id)];
      const tracked = tracks && Object.values(tracks.views).filter((seen) => seen[id]).length;
      const words = views > 0 ? `${views} view${views > 1 ? 's' : ''}` : !this.isFirst && tracked ? `tracked in ${tracked}` : 'none yet';
      return el(
        'button', { type: 'button', className: 'item', 'aria-pressed': String(id === marker), onclick: () => this.room.set({ marker: id }) },
        swatch(colourOf(id)), el('b', {}, String(id)), el('span', {}, words), el('span', { className: rms !== null && rms > 2 ? 'bad' : '' }, rms === null ? '' : `${rms.toFixed(2)} px`),
      );
    };
    return [
      el('h2', {}, this.isFirst ? 'Markers' : 'Corrections'), el('p', {}, about),
      this.doc.markers.length === 0 && this.isHere && el('p', {}, 'Click a marker in one view, then in a second one: lines show where it can be. From then on m labels it in the others. n begins the next.'),
      el('div', { className: 'items' }, ...this.doc.markers.map(row)),
    ];
  }

  counters(): Record<string, unknown> {
    const rms = Object.fromEntries(this.doc.markers.map((m) => [m.id, this.rms(m.id)]));
    const { marker } = this.room.look;
    const guesses = marker === null ? {} : Object.fromEntries(this.room.views.map((v) => [v.name, this.guess(marker, v)]));
    return { labels: this.doc, rms, guesses };
  }
}
