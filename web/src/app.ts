// Ties state to picture: a change of state leads to what is wanted, what is wanted arrives, what has arrived is shown.

import * as THREE from 'three';
import type { Api } from './api.ts';
import { ByteCache } from './cache.ts';
import { ROOT_SCALE, STRAND_SCALE, number, scaleOf, strandHues, words } from './colour.ts';
import type { Rgb, Scale } from './colour.ts';
import { byId, el } from './dom.ts';
import { Footage } from './footage.ts';
import type { Drawn, Picture } from './footage.ts';
import { Keys } from './keys.ts';
import { Loader } from './loader.ts';
import { Notices } from './notices.ts';
import { PickedPanel, Panels, comparison, legend } from './panels.ts';
import { neighbours, pickInSpace, pickOnImage } from './pick.ts';
import type { Picked } from './pick.ts';
import { Pace } from './pace.ts';
import { Lately, step } from './player.ts';
import { MISSING, poseAt } from './protocol.ts';
import type { Mesh, Projected, Rows, StrandDetails, StrandSet, Strands, Take, Values, Vec3, View } from './protocol.ts';
import { Space } from './space.ts';
import { Store, clampFrame, firstState, fromHash, toHash } from './state.ts';
import type { State } from './state.ts';
import type { StrandCloud } from './strands.ts';
import { Timeline } from './timeline.ts';
import { DETAIL, Requests, attributeOf, footageLevel, fullLevel, imageWidth, isDone, movingLevel, paths, setOf, shownSets, wants } from './wants.ts';
import type { Level, Moment } from './wants.ts';

const CACHE_BYTES = 256 * 2 ** 20;
/** After this long without a change of frame all detail is fetched. */
const REST_MS = 180;
/** A take that is being run grows; and a program that has ended is noticed. */
const LOOK_AGAIN_MS = 10000;
const NEIGHBOURS = 40;
const PICK_PX = 12;

interface Shown {
  set: StrandSet;
  frame: number;
  level: Level;
  full: boolean;
  strands: Strands;
  values: Float32Array | null;
}

export class App {
  readonly store: Store;
  private readonly first: State;
  private readonly cache: ByteCache<unknown>;
  private readonly loader: Loader;
  private readonly requests: Requests;
  private readonly notices = new Notices();
  readonly space: Space;
  private readonly footage: Footage;
  private readonly panels: Panels;
  private readonly picked: PickedPanel;
  private readonly timeline: Timeline;
  private readonly shown: (Shown | null)[] = [null, null];
  private readonly labels: HTMLElement[];
  /** Colour ramps and per-strand numbers that are computed here, kept for what they were computed from. */
  private readonly derived = new WeakMap<Strands, Map<string, Float32Array>>();
  private readonly hues = new WeakMap<Projected, Float32Array>();
  private scale: Scale | null = null;
  private isolated: Set<number> | null = null;
  private inks: Record<string, string> = {};
  private readonly pace = new Pace();
  private movedAt = 0;
  private turning = false;
  private due = false;
  private restTimer = 0;
  private hashTimer = 0;
  private carry = 0;
  private readonly fullTook = new Lately(0.5);
  private lastDraw = 0;
  private fps = new Lately(0.1);
  private framesPlayed = 0;
  private errors = 0;

  constructor(api: Api, readonly take: Take) {
    this.first = firstState(take);
    this.store = new Store(fromHash(location.hash, this.first, take));
    this.cache = new ByteCache<unknown>(CACHE_BYTES, (value) => value instanceof ImageBitmap && value.close());
    this.loader = new Loader(this.cache, () => this.refreshSoon(), (_, error) => {
      this.errors += 1;
      this.notices.error(error);
    });
    this.requests = new Requests(api);
    this.space = new Space(byId('canvas'), take, () => this.drawn(), (ms) => this.took(ms));
    this.footage = new Footage(byId('footage'), take.views, (view) => this.store.set({ view }), (u, v, reach) => this.pickOnFootage(u, v, reach));
    const go = (frame: number) => this.go(frame);
    const deeds = { home: () => this.home(), through: (view: string) => this.through(view), isolate: (on: boolean) => this.store.set({ isolated: on }), go };
    this.panels = new Panels(take, this.store, deeds);
    this.picked = new PickedPanel(byId('picked'), take, this.store, deeds);
    this.timeline = new Timeline(take, this.store, go);
    this.labels = take.views.map((view) => el('button', { type: 'button', title: `Look through ${view.name}`, onclick: () => this.through(view.name) }, view.name));
    byId('labels').append(...this.labels);
    new Keys({
      store: this.store, take, go, home: deeds.home, fold: () => this.panels.fold(),
      compare: () => this.store.set({ other: this.store.state.other ? '' : comparison(take, this.store.state.set) }),
    });

    this.theme();
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => this.theme());
    if (this.store.state.camera) this.space.look(this.store.state.camera);
    else this.space.look(this.space.home(null));
    this.watchPointer();
    addEventListener('hashchange', () => this.readHash());
    new ResizeObserver(() => this.refreshSoon()).observe(byId('footage'));
    new ResizeObserver(() => this.refreshSoon()).observe(byId('have'));
    this.store.listen((state, before) => this.changed(state, before));
    this.refreshSoon();
    this.clock(performance.now());
    setInterval(() => void this.lookAgain(api), LOOK_AGAIN_MS);
    for (const note of take.notes ?? []) this.notices.say(note.fact, note.hint);
    if (take.sets.every((set) => set.done.length === 0)) {
      this.notices.say('This take has no strands yet.', 'Run `strandflow run` on it; footage, cameras and what is finished are shown already.', true);
    }
  }

  /** Takes over which frames have been done since; what the controls would have to be built anew for, a reload shows. */
  private async lookAgain(api: Api): Promise<void> {
    const now = document.hidden ? null : await api.json<Take>('/api/take').catch(() => null);
    if (!now) return;
    const usable = (take: Take) => JSON.stringify([take.sets.map((set) => [set.id, set.done.length > 0]), take.layers]);
    if (usable(now) !== usable(this.take)) this.notices.say('The take has more to show by now.', 'Reload the page to see it; it keeps the look.', true);
    for (const set of this.take.sets) set.done = now.sets.find((s) => s.id === set.id)?.done ?? set.done;
    this.refreshSoon();
  }

  // ---- what others call

  alive(alive: boolean): void {
    const text = 'The program does not answer: it has ended, or the tunnel is closed.';
    if (alive) this.notices.take(text);
    else this.notices.say(text, 'What was fetched can still be looked at.', true);
  }

  /** Resolves when the first frame is drawn with all its detail. */
  async settled(): Promise<void> {
    for (;;) {
      const c = this.counters();
      if (c.renders > 0 && c.atRest) return;
      await new Promise((r) => setTimeout(r, 50));
    }
  }

  counters() {
    const { state } = this.store;
    const [a, b] = this.shown;
    return {
      frame: state.frame,
      shownFrame: a?.frame ?? null,
      set: state.set,
      mode: state.mode,
      strands: a?.strands.strands ?? 0,
      points: a?.strands.points ?? 0,
      otherStrands: b?.strands.strands ?? 0,
      otherFrame: b?.frame ?? null,
      full: a?.full ?? false,
      atRest: this.atRest,
      idle: this.loader.idle,
      drawMs: this.lastTook,
      cacheBytes: this.cache.bytes,
      cacheLimit: this.cache.limit,
      cacheEntries: this.cache.size,
      fetched: this.loader.fetched,
      aborted: this.loader.aborted,
      renders: this.space.renders,
      framesPlayed: this.framesPlayed,
      errors: this.errors,
      notices: this.notices.said,
      selected: state.selected,
      isolated: this.isolated?.size ?? 0,
    };
  }

  // ---- state

  private get moment(): Moment {
    const { state } = this.store;
    return { state, take: this.take, moving: this.moving, ...(state.detail === 'auto' ? { most: this.pace.moving, rest: this.pace.rest } : DETAIL[state.detail]) };
  }

  /** Little detail while frames change, and while the camera turns where all of it is too slow for this machine. */
  private get moving(): boolean {
    const { state } = this.store;
    return state.playing || performance.now() - this.movedAt < REST_MS || (this.turning && (this.fullTook.value ?? 0) > 70);
  }

  /** All that the state asks for is on the screen; what is fetched ahead does not count. */
  private get atRest(): boolean {
    const { moment } = this;
    if (this.moving || this.due) return false;
    if (!wants(moment, this.requests, 0).every(({ path }) => this.loader.has(path) || this.loader.isRefused(path))) return false;
    return moment.state.mode === 'footage' || (!this.space.busy && this.complete(0) && this.complete(1));
  }

  /** All of a set's frame is shown, or there is none. */
  private complete(which: 0 | 1): boolean {
    const shown = this.shown[which];
    return !this.hasFrame(which) || (shown !== null && shown.frame === this.store.state.frame && shown.full);
  }

  private hasFrame(which: 0 | 1): boolean {
    const { state } = this.store;
    const set = setOf(this.take, which === 0 ? state.set : state.other);
    return set !== undefined && isDone(set, state.frame) && state.layers.strands;
  }

  private go(frame: number): void {
    this.store.set({ frame: clampFrame(this.take, frame), playing: false });
  }

  private changed(state: State, before: State): void {
    if (state.frame !== before.frame) {
      this.movedAt = performance.now();
      this.restSoon();
    }
    if (state.playing !== before.playing) {
      this.carry = 0;
      this.fps.forget();
      this.restSoon();
    }
    if (state.set !== before.set) {
      this.shown.fill(null);
      const set = setOf(this.take, state.set);
      // A strand keeps its number from stage to stage, but sets of other sizes have other strands.
      if (state.selected !== null && setOf(this.take, before.set)?.strands !== set?.strands) this.store.set({ selected: null, isolated: false });
      if (set && !['hair', 'strand', 'root'].includes(state.by) && !set.attributes.includes(state.by)) {
        this.notices.say(`${words(set.title)}: it has no ${state.by.replaceAll('_', ' ')}.`, 'It is shown in the colour of hair.');
      }
    }
    if (state.other !== before.other) this.shown[1] = null;
    if (state.selected !== before.selected || state.isolated !== before.isolated || state.set !== before.set) this.isolate();
    clearTimeout(this.hashTimer);
    // The address changes when things have come to rest: browsers refuse too many changes a second.
    this.hashTimer = window.setTimeout(() => this.writeHash(), 300);
    this.refreshSoon();
  }

  private writeHash(): void {
    const hash = toHash(this.store.state, this.first);
    if (hash !== location.hash.replace(/^#/, '')) history.replaceState(null, '', hash ? `#${hash}` : location.pathname + location.search);
  }

  private readHash(): void {
    const state = fromHash(location.hash, this.first, this.take);
    this.store.set(state);
    if (state.camera) this.space.look(state.camera);
  }

  private restSoon(): void {
    clearTimeout(this.restTimer);
    this.restTimer = window.setTimeout(() => this.refreshSoon(), REST_MS + 10);
  }

  private isolate(): void {
    const { state } = this.store;
    const full = this.shown[0];
    if (!state.isolated || state.selected === null) this.isolated = null;
    else if (full?.full) this.isolated = new Set(neighbours(full.strands, state.selected, NEIGHBOURS));
    // Else as soon as all strands are here.
    this.applyIsolation();
  }

  private applyIsolation(): void {
    const total = Math.max(...this.take.sets.map((set) => set.strands), 1);
    this.space.a.only(this.isolated, total);
    this.space.b.only(this.isolated, total);
    this.space.touch();
  }

  // ---- time

  private clock(before: number): void {
    requestAnimationFrame((now) => {
      const { state } = this.store;
      if (state.playing) this.advance(now - before);
      this.clock(now);
    });
  }

  private advance(ms: number): void {
    const { state } = this.store;
    const moment = this.moment;
    const had = state.frame;
    // A tab that slept does not jump ahead.
    const next = step(had, this.carry + (Math.min(ms, 500) / 1000) * this.take.fps * state.rate, this.take.frames, state.loop, (frame) => this.ready(moment, frame));
    this.carry = next.carry;
    if (next.ended) this.store.set({ playing: false });
    else if (next.frame !== had) {
      this.framesPlayed += 1;
      this.store.set({ frame: next.frame });
    }
  }

  /** All that a frame needs while moving has arrived, or never will. */
  private ready(moment: Moment, frame: number): boolean {
    const { state } = moment;
    const here = (path: string) => this.loader.has(path) || this.loader.isRefused(path);
    if (state.mode === 'footage') {
      const views = state.view ? [state.view] : this.take.views.map((view) => view.name);
      return shownSets(moment).every((set) => !isDone(set, frame) || !state.layers.strands || views.every((view) => here(paths.projected(set, view, frame, footageLevel(moment, set)))))
        && (!state.layers.footage || this.take.views.every((view) => !views.includes(view.name) || !view.footage || here(paths.image(view.name, frame, imageWidth(state)))));
    }
    return shownSets(moment).every((set) => {
      if (!isDone(set, frame)) return true;
      const level = movingLevel(moment, set);
      const attribute = attributeOf(moment, set);
      return here(paths.strands(set, frame, level)) && (!attribute || here(paths.values(set, attribute.name, frame, level)));
    });
  }

  // ---- showing

  private refreshSoon(): void {
    if (this.due) return;
    this.due = true;
    requestAnimationFrame(() => {
      this.due = false;
      this.refresh();
    });
  }

  private refresh(): void {
    const moment = this.moment;
    const { state } = moment;
    this.loader.want(wants(moment, this.requests));
    // While playing only the frame changes, and the page's own drawing is not free either.
    if (Object.entries(state).some(([key, value]) => !['frame', 'playing', 'camera'].includes(key) && this.panelsShow?.[key as keyof State] !== value)) this.panels.show(state);
    this.panelsShow = state;
    this.timeline.show(state);
    const set = setOf(this.take, state.set);
    const attribute = this.take.attributes.find((a) => a.name === state.by);
    this.scale = state.by === 'strand' ? STRAND_SCALE : state.by === 'root' ? ROOT_SCALE : attribute ? scaleOf(attribute, state.range) : null;
    if (state.mode === 'space') this.showSpace(moment);
    else this.showFootage(moment);
    const details = set && state.selected !== null ? this.loader.get<StrandDetails>(paths.details(set, state.selected)) : undefined;
    this.picked.show(state, details);
    this.showLegend(moment);
    this.showBuffered(moment);
    this.showStatus(moment);
  }

  private showSpace(moment: Moment): void {
    const { state } = moment;
    const { space, take, loader } = this;
    const sets = [setOf(take, state.set), state.other ? setOf(take, state.other) : undefined];
    space.split = state.other !== '' && state.layout === 'side';
    space.width = state.width;
    const clouds = [space.a, space.b];
    for (const i of [0, 1]) this.showSet(moment, i as 0 | 1, sets[i], clouds[i]);
    if (state.isolated && !this.isolated) this.isolate();

    const frame = this.shown[0]?.frame ?? state.frame;
    const one = this.showMark(state, frame);
    const { layers } = state;
    space.head.show(loader.get<Mesh>(paths.head()));
    space.head.object.visible = layers.head && take.layers.head === true;
    space.hull.show(loader.get<Mesh>(paths.hull(state.frame)));
    space.hull.object.visible = layers.hull && take.layers.hull === true;
    space.lines.show(loader.get<Rows>(paths.lines(state.frame)));
    space.lines.object.visible = layers.lines && take.layers.lines === true;
    space.arrows.show(loader.get<Rows>(paths.arrows(state.frame)));
    space.arrows.object.visible = layers.arrows && take.layers.arrows === true;
    space.roots.object.visible = layers.roots;
    if (layers.roots) space.roots.show(this.shown[0]?.strands);
    space.floor.object.visible = layers.floor;
    for (const frustum of space.frusta) {
      frustum.object.visible = layers.cameras;
      if (layers.cameras) frustum.picture(layers.images ? loader.get<ImageBitmap>(paths.image(frustum.view.name, state.frame, imageWidth(state))) : null);
    }
    const knewHead = space.headMiddle() !== null;
    space.pose(poseAt(take.world_from_head, frame), state.follow);
    if (knewHead && !state.camera && !this.looked) {
      // The first look is settled once the head is known, and is then the user's.
      this.looked = true;
      space.look(space.home(space.headMiddle()));
    }
    this.showPanes(state, sets);
    // What arrives ahead of time changes nothing on the screen, and drawing is dear.
    const { scale } = this;
    const seen = [
      frame, state.layers, state.width, state.follow, state.layout, state.by, state.selected, scale?.table, ...(scale?.range ?? [0, 0]),
      ...this.shown.flatMap((s) => [s?.strands, s?.values]), this.space.seen(), one,
      ...space.frusta.map((f) => layers.images && loader.has(paths.image(f.view.name, state.frame, imageWidth(state)))),
    ];
    if (seen.some((thing, i) => thing !== this.seen[i])) space.touch();
    this.seen = seen;
  }

  private panelsShow: State | null = null;
  private looked = false;
  private seen: unknown[] = [];

  /** Puts the best that has arrived of a set's frame into its cloud; until there is anything, what was shown stays. */
  private showSet(moment: Moment, which: 0 | 1, set: StrandSet | undefined, cloud: StrandCloud): void {
    const { state } = moment;
    if (!set || !isDone(set, state.frame) || !state.layers.strands) {
      this.shown[which] = null;
      cloud.hide();
      return;
    }
    const attribute = attributeOf(moment, set);
    const here = (level: Level) => {
      const strands = this.loader.get<Strands>(paths.strands(set, state.frame, level));
      if (!strands) return null;
      if (!attribute) return { strands, values: null };
      const path = paths.values(set, attribute.name, state.frame, level);
      const values = this.loader.get<Values>(path);
      return values || this.loader.isRefused(path) ? { strands, values: values?.values ?? null } : null;
    };
    const coarse = movingLevel(moment, set);
    const full = moment.moving ? null : here(fullLevel(set, moment.rest));
    const best = full ?? here(coarse);
    if (!best) {
      if (!this.shown[which]) cloud.hide();
      return;
    }
    const level = full ? fullLevel(set, moment.rest) : coarse;
    cloud.show(best.strands, 0, level.stride);
    const values = this.valuesOf(state, best.strands, level, best.values);
    this.shown[which] = { set, frame: state.frame, level, full: full !== null, strands: best.strands, values };
    const overlaid = which === 1 && state.layout === 'over';
    if (overlaid) cloud.flat(rgb(this.inks.second));
    else if (this.scale && values) cloud.coloured(values, this.scale.table, this.scale.range, this.scale.categories !== undefined);
    else cloud.hair();
  }

  /** The numbers that strands are coloured by: the program's, or ones that follow from the strands themselves. */
  private valuesOf(state: State, strands: Strands, level: Level, sent: Float32Array | null): Float32Array | null {
    if (state.by !== 'strand' && state.by !== 'root') return sent;
    const known = this.derived.get(strands) ?? new Map<string, Float32Array>();
    this.derived.set(strands, known);
    let values = known.get(state.by);
    if (!values) {
      values = state.by === 'strand' ? strandHues(0, level.stride, strands.strands) : this.rootHues(strands, state.frame);
      known.set(state.by, values);
    }
    return values;
  }

  /** The direction of each root about the head's upright axis, 0 to 1; in head space, so that it stays with the strand. */
  private rootHues(s: Strands, frame: number): Float32Array {
    const pose = poseAt(this.take.world_from_head, frame);
    const headFromWorld = new THREE.Matrix4();
    if (pose) headFromWorld.fromArray(pose).transpose().invert();
    const up = this.space.camera.up.clone();
    const east = new THREE.Vector3(up.y, up.z, up.x).cross(up).normalize();
    const north = up.clone().cross(east);
    const roots: (THREE.Vector3 | null)[] = [];
    const middle = new THREE.Vector3();
    for (let i = 0; i < s.strands; i++) {
      const at = i * s.points * 3;
      const there = s.xyz[at] !== MISSING;
      const root = new THREE.Vector3(...[0, 1, 2].map((k) => s.lo[k] + s.xyz[at + k] * s.step[k]) as Vec3).applyMatrix4(headFromWorld);
      roots.push(there ? root : null);
      if (there) middle.add(root);
    }
    middle.divideScalar(Math.max(1, roots.filter(Boolean).length));
    return Float32Array.from(roots, (root) => {
      if (!root) return NaN;
      root.sub(this.space.headMiddle() ?? middle);
      return Math.atan2(root.dot(north), root.dot(east)) / (2 * Math.PI) + 0.5;
    });
  }

  private showMark(state: State, frame: number): Strands | undefined {
    const set = setOf(this.take, state.set);
    const one = set && state.selected !== null && isDone(set, frame) ? this.loader.get<Strands>(paths.one(set, frame, state.selected)) : undefined;
    if (one && state.selected !== null) this.space.mark.show(one, state.selected, 1);
    else if (!this.moving || state.selected === null) this.space.mark.hide();
    this.space.mark.flat(rgb(this.inks.pick));
    return one;
  }

  private panesSaid = '';

  private showPanes(state: State, sets: (StrandSet | undefined)[]): void {
    const split = this.space.split;
    const line = (set: StrandSet, second: boolean, frameThere: boolean) => [
      el('b', { className: second && !split ? 'second' : '' }, words(set.title)),
      !frameThere && el('span', {}, set.done.length ? `frame ${state.frame} is not computed` : 'no frames yet'),
    ];
    const panes = split || !sets[1] ? sets.map((set, i) => (set && (i === 0 || split) ? [line(set, i === 1, isDone(set, state.frame))] : [])) : [sets.map((set, i) => (set ? line(set, i === 1, isDone(set, state.frame)) : []))];
    const said = JSON.stringify([split, sets.map((set) => set && [set.id, isDone(set, state.frame) || state.frame])]);
    if (said === this.panesSaid) return;
    this.panesSaid = said;
    byId('panes').replaceChildren(...panes.filter((lines) => lines.length > 0).map((lines) => el('div', {}, ...lines.flat())));
  }

  private showFootage(moment: Moment): void {
    const { state } = moment;
    this.footage.layout(state.view);
    this.footage.draw((view) => this.picture(moment, view), state.opacity);
  }

  private picture(moment: Moment, view: View): Picture {
    const { state } = moment;
    const { loader, take } = this;
    const of = (layer: 'footage' | 'masks' | 'orientation', path: string) => (state.layers[layer] ? loader.get<ImageBitmap>(path) : undefined);
    const picture: Picture = {
      image: of('footage', paths.image(view.name, state.frame, imageWidth(state))),
      mask: take.layers.masks ? of('masks', paths.mask(view.name, state.frame)) : undefined,
      orientation: take.layers.orientation ? of('orientation', paths.orientation(view.name, state.frame)) : undefined,
      strands: [],
      note: '',
    };
    const sets = shownSets(moment);
    const notes: string[] = [];
    if (state.layers.footage && !view.footage) notes.push('no footage');
    for (const [i, set] of sets.entries()) {
      if (!state.layers.strands) break;
      if (!isDone(set, state.frame)) {
        notes.push(`${set.id}: frame not computed`);
        continue;
      }
      const drawn = this.projectedSet(moment, set, view, i === 1);
      if (drawn) picture.strands.push(drawn);
    }
    if (state.selected !== null && sets[0]) picture.mark = loader.get<Projected>(paths.projectedOne(sets[0], view.name, state.frame, state.selected));
    picture.note = notes.join(' · ');
    return picture;
  }

  private projectedSet(moment: Moment, set: StrandSet, view: View, second: boolean): Drawn | null {
    const { state } = moment;
    const level = footageLevel(moment, set);
    const projected = this.loader.get<Projected>(paths.projected(set, view.name, state.frame, level));
    if (!projected) return null;
    const attribute = attributeOf(moment, set);
    let values = attribute ? this.loader.get<Values>(paths.values(set, attribute.name, state.frame, level))?.values ?? null : null;
    if (state.by === 'strand') {
      this.hues.set(projected, (values = this.hues.get(projected) ?? strandHues(0, level.stride, projected.strands)));
    }
    return {
      projected,
      values: second ? null : values,
      scale: second || !values ? null : this.scale,
      // Hair's own colour would not be seen on hair.
      colour: second ? rgb(this.inks.second) : [255, 196, 92],
      visible: this.isolated,
      stride: level.stride,
    };
  }

  private showLegend(moment: Moment): void {
    const { state } = moment;
    const notes: string[] = [];
    const lacking = shownSets(moment).filter((set, i) => this.scale && !['strand', 'root'].includes(state.by) && !set.attributes.includes(state.by) && !(i === 1 && state.layout === 'over'));
    for (const set of lacking) notes.push(`${set.id} does not have it`);
    if (state.by === 'root' && state.mode === 'footage') notes.push('not over the footage');
    if (state.mode === 'space' && state.layers.arrows && this.take.layers.arrows) {
      notes.push(`Velocities: the way of ${this.space.arrows.seconds * 1000} ms, up to ${number(this.space.arrows.fastest)} mm/s`);
    }
    if (state.mode === 'space' && state.layers.lines && this.take.layers.lines) notes.push('Lifted lines: brighter is more certain');
    legend(this.scale, notes);
  }

  private showBuffered(moment: Moment): void {
    const set = shownSets(moment)[0];
    const { inks } = this;
    this.timeline.buffered((frame) => {
      if (!set || !isDone(set, frame)) return 0;
      if (moment.state.mode === 'space' && this.loader.has(paths.strands(set, frame, fullLevel(set, moment.rest)))) return 3;
      return this.ready(moment, frame) ? 2 : 1;
    }, [inks.none, inks.not, inks.coarse, inks.all]);
  }

  private showStatus(moment: Moment): void {
    const { state } = moment;
    const lines: string[] = [];
    for (const shown of state.mode === 'space' ? this.shown : []) {
      if (!shown) continue;
      const { strands, points } = shown.strands;
      lines.push(`${strands.toLocaleString('en')}${shown.full ? '' : ` of ${shown.set.strands.toLocaleString('en')}`} strands × ${points} points`);
    }
    if (state.playing && this.fps.value) lines.push(`${(1000 / this.fps.value).toFixed(0)} frames/s`);
    lines.push(`memory ${(this.cache.bytes / 2 ** 20).toFixed(0)} of ${CACHE_BYTES / 2 ** 20} MB`);
    const text = lines.join('\n');
    if (byId('status').textContent !== text) byId('status').textContent = text;
  }

  /** The card has finished a picture. */
  private took(ms: number): void {
    this.lastTook = ms;
    const [a, b] = this.shown;
    if (a?.full) this.fullTook.add(ms);
    const points = [a, b].reduce((sum, s) => sum + (s ? s.strands.strands * s.strands.points : 0), 0);
    if (this.pace.drew(points, ms) || this.store.state.playing) this.refreshSoon();
  }

  private lastTook = 0;

  /** After every drawing of the 3D picture. */
  private drawn(): void {
    const now = performance.now();
    const since = now - this.lastDraw;
    this.lastDraw = now;
    if (this.store.state.playing && since < 1000) this.fps.add(since);
    const { state } = this.store;
    const box = byId('canvas');
    for (const [i, frustum] of this.space.frusta.entries()) {
      const label = this.labels[i];
      const at = state.layers.cameras && state.mode === 'space' && !frustum.aside ? this.space.onScreen(frustum.apex) : null;
      const inside = at !== null && at.x > 0 && at.y > 0 && at.x < (this.space.panes()[0].width) && at.y < box.clientHeight;
      if (label.hidden === inside) label.hidden = !inside;
      const move = inside ? `translate(${at.x.toFixed(0)}px, ${at.y.toFixed(0)}px) translate(-50%, -140%)` : '';
      if (inside && label.style.transform !== move) label.style.transform = move;
    }
  }

  // ---- camera and picking

  private home(): void {
    this.space.look(this.space.home(this.space.headMiddle()));
    this.store.set({ camera: null });
  }

  private through(name: string): void {
    const view = this.take.views.find((v) => v.name === name);
    if (!view) return;
    this.space.look(this.space.through(view));
    this.store.set({ camera: this.space.looking, mode: 'space' });
  }

  private watchPointer(): void {
    const canvas = byId<HTMLCanvasElement>('canvas');
    let down = { x: 0, y: 0 };
    let before = '';
    this.space.orbit.addEventListener('start', () => {
      this.turning = true;
      before = JSON.stringify(this.space.looking);
    });
    this.space.orbit.addEventListener('end', () => {
      this.turning = false;
      // A click that only picks does not move the camera.
      if (JSON.stringify(this.space.looking) !== before) this.store.set({ camera: this.space.looking });
    });
    this.space.orbit.addEventListener('change', () => this.turning && this.moving && this.refreshSoon());
    canvas.addEventListener('pointerdown', (event) => (down = { x: event.clientX, y: event.clientY }));
    canvas.addEventListener('pointerup', (event) => {
      if (event.button === 0 && Math.hypot(event.clientX - down.x, event.clientY - down.y) < 4) this.pick(event);
    });
  }

  private pick(event: PointerEvent): void {
    const box = byId('canvas').getBoundingClientRect();
    const [x, y] = [event.clientX - box.left, event.clientY - box.top];
    const panes = this.space.panes();
    const which = panes.findIndex((pane) => x < pane.x + pane.width);
    const pane = panes[Math.max(0, which)];
    const shown = this.shown[this.space.split && which === 1 ? 1 : 0];
    if (!shown) return;
    const { isolated } = this;
    const visible = (strand: number) => !isolated || isolated.has(strand * shown.level.stride);
    const hit = pickInSpace(shown.strands, this.space.clip(pane), pane.width, pane.height, x - pane.x, y - pane.y, PICK_PX, visible);
    // In the second pane the same strand number is picked, if the first set has it.
    this.select(hit, shown.level.stride);
  }

  private pickOnFootage(u: number, v: number, reach: number): void {
    const moment = this.moment;
    const set = shownSets(moment)[0];
    if (!set) return;
    const level = footageLevel(moment, set);
    const projected = this.loader.get<Projected>(paths.projected(set, moment.state.view, moment.state.frame, level));
    if (projected) this.select(pickOnImage(projected, u, v, reach), level.stride);
  }

  private select(hit: Picked | null, stride: number): void {
    const number = hit ? hit.strand * stride : null;
    const set = setOf(this.take, this.store.state.set);
    if (number !== null && set && number >= set.strands) return;
    this.store.set({ selected: number, isolated: number !== null && this.store.state.isolated });
  }

  private theme(): void {
    const css = getComputedStyle(document.documentElement);
    const ink = (name: string) => css.getPropertyValue(`--${name}`).trim();
    this.space.inks({
      background: ink('scene'), line: ink('scene-line'), faint: ink('scene-faint'), head: ink('scene-head'), hull: ink('scene-hull'), accent: ink('accent'),
    });
    this.inks = {
      second: ink('second'), pick: ink('pick'), none: ink('have-none'), not: ink('have-not'), coarse: ink('have-coarse'), all: ink('have-all'),
    };
    this.refreshSoon();
  }
}

function rgb(hex: string): Rgb {
  const c = new THREE.Color(hex).getHex();
  return [c >> 16, (c >> 8) & 255, c & 255];
}
