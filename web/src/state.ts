// What the page shows. Everything on it follows from this one value (and from what has arrived so far).

import type { StrandSet, Take, Vec3 } from './protocol.ts';

export const LAYERS = ['head', 'cameras', 'images', 'hull', 'lines', 'arrows', 'roots', 'floor', 'footage', 'strands', 'masks', 'orientation'] as const;
export type Layer = (typeof LAYERS)[number];

export type Detail = 'auto' | 'coarse' | 'normal' | 'fine';

export interface Camera {
  position: Vec3;
  target: Vec3;
}

export interface State {
  mode: 'space' | 'footage';
  set: string;
  /** A second set to compare with, or ''. */
  other: string;
  layout: 'side' | 'over';
  frame: number;
  playing: boolean;
  /** Times the footage's own speed. */
  rate: number;
  loop: boolean;
  /** `hair`, `strand`, `root` or the name of an attribute. */
  by: string;
  /** The colours' range where it is not the attribute's own. */
  range: [number, number] | null;
  layers: Record<Layer, boolean>;
  follow: boolean;
  /** Width of a drawn strand, mm. */
  width: number;
  detail: Detail;
  /** The enlarged view of the footage, or '' for all of them. */
  view: string;
  /** Of the strands over the footage. */
  opacity: number;
  selected: number | null;
  /** Only the picked strand and its neighbours are drawn. */
  isolated: boolean;
  camera: Camera | null;
}

/** The latest stage that has strands: stages come in the order of their work, truth and animations after them. */
export function newestSet(take: Take): StrandSet | undefined {
  const stages = take.sets.filter((set) => set.done.length > 0 && set.id !== 'truth' && !set.id.startsWith('animate/'));
  return stages.at(-1) ?? take.sets.find((set) => set.done.length > 0);
}

export function firstState(take: Take): State {
  const set = newestSet(take);
  const frames = set?.done.length ? set.done : [take.frames[0]];
  return {
    mode: 'space',
    set: set?.id ?? '',
    other: '',
    layout: 'side',
    frame: frames[Math.floor(frames.length / 2)],
    playing: false,
    rate: 1,
    loop: true,
    by: 'hair',
    range: null,
    layers: {
      head: true, cameras: true, images: false, hull: false, lines: false, arrows: false, roots: false, floor: true,
      footage: true, strands: true, masks: false, orientation: false,
    },
    follow: false,
    width: 0.5,
    detail: 'auto',
    view: '',
    opacity: 0.65,
    selected: null,
    isolated: false,
    camera: null,
  };
}

const round = (v: number) => Math.round(v * 10) / 10;

/** What differs from the first look, as it stands behind the `#`. */
export function toHash(state: State, first: State): string {
  const q = new URLSearchParams();
  const put = (key: string, value: string | number, usual: string | number) => value !== usual && q.set(key, String(value));
  put('mode', state.mode, first.mode);
  put('set', state.set, first.set);
  put('with', state.other, first.other);
  put('layout', state.layout, first.layout);
  put('frame', state.frame, first.frame);
  put('rate', state.rate, first.rate);
  put('loop', Number(state.loop), Number(first.loop));
  put('by', state.by, first.by);
  if (state.range) q.set('range', state.range.join(','));
  const on = (s: State) => LAYERS.filter((name) => s.layers[name]).join(',');
  put('layers', on(state), on(first));
  put('follow', Number(state.follow), Number(first.follow));
  put('width', state.width, first.width);
  put('detail', state.detail, first.detail);
  put('view', state.view, first.view);
  put('opacity', state.opacity, first.opacity);
  if (state.selected !== null) q.set('strand', String(state.selected));
  put('isolated', Number(state.isolated), Number(first.isolated));
  if (state.camera) q.set('camera', [...state.camera.position, ...state.camera.target].map(round).join(','));
  return q.toString().replaceAll('%2C', ',').replaceAll('%2F', '/');
}

/** Reads a look; what it does not know, or what the take does not have, stays as in the first look. */
export function fromHash(hash: string, first: State, take: Take): State {
  const q = new URLSearchParams(hash.replace(/^#/, ''));
  const state: State = { ...first, layers: { ...first.layers } };
  const text = (key: string, known: readonly string[]) => {
    const given = q.get(key);
    return given !== null && known.includes(given) ? given : null;
  };
  const num = (key: string) => {
    const given = q.get(key);
    return given !== null && given !== '' && Number.isFinite(Number(given)) ? Number(given) : null;
  };
  const many = (key: string, count: number) => {
    const given = q.get(key)?.split(',').map(Number) ?? [];
    return given.length === count && given.every(Number.isFinite) ? given : null;
  };
  const ids = take.sets.map((set) => set.id);
  state.mode = (text('mode', ['space', 'footage']) as State['mode']) ?? state.mode;
  state.set = text('set', ids) ?? state.set;
  state.other = text('with', ids) ?? state.other;
  state.layout = (text('layout', ['side', 'over']) as State['layout']) ?? state.layout;
  state.frame = clampFrame(take, num('frame') ?? state.frame);
  state.rate = num('rate') ?? state.rate;
  state.loop = (num('loop') ?? Number(state.loop)) === 1;
  state.by = text('by', ['hair', 'strand', 'root', ...take.attributes.map((a) => a.name)]) ?? state.by;
  state.range = (many('range', 2) as [number, number] | null) ?? state.range;
  const layers = q.get('layers')?.split(',');
  if (layers) for (const name of LAYERS) state.layers[name] = layers.includes(name);
  state.follow = (num('follow') ?? Number(state.follow)) === 1;
  state.width = Math.min(4, Math.max(0.05, num('width') ?? state.width));
  state.detail = (text('detail', ['auto', 'coarse', 'normal', 'fine']) as Detail) ?? state.detail;
  state.view = text('view', take.views.map((view) => view.name)) ?? state.view;
  state.opacity = Math.min(1, Math.max(0, num('opacity') ?? state.opacity));
  state.selected = num('strand');
  state.isolated = state.selected !== null && num('isolated') === 1;
  const camera = many('camera', 6);
  if (camera) state.camera = { position: camera.slice(0, 3) as Vec3, target: camera.slice(3) as Vec3 };
  return state;
}

export function clampFrame(take: Take, frame: number): number {
  return Math.min(take.frames[1] - 1, Math.max(take.frames[0], Math.round(frame)));
}

type Listener = (state: State, before: State) => void;

/** Holds the state; whoever listens is told of every change, with the state before it. */
export class Store {
  private readonly listeners: Listener[] = [];

  constructor(public state: State) {}

  listen(listener: Listener): void {
    this.listeners.push(listener);
  }

  set(change: Partial<State>): void {
    const before = this.state;
    this.state = { ...before, ...change };
    for (const listener of this.listeners) listener(this.state, before);
  }
}
