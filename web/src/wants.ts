// What the page needs from the program for a state: a pure list of requests, most urgent first.

import type { Api } from './api.ts';
import { MOST_POINTS } from './pace.ts';
import { decodeMesh, decodeProjected, decodeRows, decodeStrands, decodeValues } from './protocol.ts';
import type { StrandSet, Take } from './protocol.ts';
import type { Detail, State } from './state.ts';
import type { Wanted } from './loader.ts';

/** Every `stride`-th strand with `points` points; 0 points: as many as the store has. */
export interface Level {
  stride: number;
  points: number;
}

/** Strands while frames change, points of a frame at rest. What is automatic follows the machine (`Pace`). */
export const DETAIL: Record<Exclude<Detail, 'auto'>, { most: number; rest: number }> = {
  coarse: { most: 500, rest: 100_000 },
  normal: { most: 2000, rest: MOST_POINTS },
  fine: { most: 8000, rest: Infinity },
};
const MOVING_POINTS = 14;
const SHEET: { strands: number; points: number } = { strands: 500, points: 12 };
const AHEAD = 16;
/** Pictures are large, and the program decodes them one by one. */
const AHEAD_PICTURES = 3;

/** The level for at most `most` strands of a set; never more points than the store has. */
export function level(set: StrandSet, most: number, points = MOVING_POINTS): Level {
  return { stride: Math.max(1, Math.ceil(set.strands / most)), points: Math.min(points, set.points) };
}

/** All strands, with all their points where no more than `rest` come together. */
export function fullLevel(set: StrandSet, rest: number): Level {
  if (set.strands * set.points <= rest) return { stride: 1, points: 0 };
  return { stride: 1, points: Math.min(set.points, Math.max(12, Math.floor(rest / set.strands / 4) * 4)) };
}

const part = (set: StrandSet, l: Level) =>
  `first=0&count=${Math.ceil(set.strands / l.stride)}&stride=${l.stride}${l.points ? `&points=${l.points}` : ''}`;

export const paths = {
  strands: (set: StrandSet, frame: number, l: Level) => `/api/strands/${set.id}/${frame}?${part(set, l)}&bits=16`,
  one: (set: StrandSet, frame: number, index: number) => `/api/strands/${set.id}/${frame}?first=${index}&count=1&stride=1&bits=16`,
  values: (set: StrandSet, name: string, frame: number, l: Level) => `/api/attribute/${set.id}/${name}/${frame}?${part(set, l)}`,
  projected: (set: StrandSet, view: string, frame: number, l: Level) => `/api/project/${set.id}/${view}/${frame}?${part(set, l)}`,
  projectedOne: (set: StrandSet, view: string, frame: number, index: number) =>
    `/api/project/${set.id}/${view}/${frame}?first=${index}&count=1&stride=1`,
  details: (set: StrandSet, index: number) => `/api/strand/${set.id}/${index}`,
  image: (view: string, frame: number, width: number) => `/api/image/${view}/${frame}${width ? `?width=${width}` : ''}`,
  mask: (view: string, frame: number) => `/api/mask/${view}/${frame}`,
  orientation: (view: string, frame: number) => `/api/orientation/${view}/${frame}`,
  head: () => '/api/mesh/head',
  hull: (frame: number) => `/api/mesh/hull/${frame}`,
  lines: (frame: number) => `/api/lines/${frame}?most=30000`,
  arrows: (frame: number) => `/api/arrows/${frame}?most=3000`,
};

/** How each kind of thing is fetched and how much memory it takes. */
export class Requests {
  constructor(private readonly api: Api) {}

  binary(path: string, decode: (body: ArrayBuffer) => unknown, lane?: string): Wanted {
    return {
      path,
      lane,
      fetch: async (p, signal) => {
        const body = await this.api.bytes(p, signal);
        return { value: decode(body), bytes: body.byteLength };
      },
    };
  }

  picture(path: string): Wanted {
    return {
      path,
      fetch: async (p, signal) => {
        const value = await this.api.picture(p, signal);
        return { value, bytes: value.width * value.height * 4 };
      },
    };
  }

  json(path: string): Wanted {
    return {
      path,
      fetch: async (p, signal) => {
        const text = JSON.stringify(await this.api.json(p, signal));
        return { value: JSON.parse(text), bytes: text.length * 2 };
      },
    };
  }
}

export interface Moment {
  state: State;
  take: Take;
  /** Frames change, or the camera moves on a slow machine: little detail at once rather than all of it late. */
  moving: boolean;
  /** Strands of a frame while moving. */
  most: number;
  /** Points of a frame at rest. */
  rest: number;
}

export const isDone = (set: StrandSet, frame: number) => set.done.includes(frame);
export const setOf = (take: Take, id: string) => take.sets.find((set) => set.id === id);

/** The sets that are shown, the main one first. */
export function shownSets({ state, take }: Moment): StrandSet[] {
  return [state.set, state.other].map((id) => setOf(take, id)).filter((set) => set !== undefined);
}

/** The attribute that a set is coloured by, if it has it. */
export function attributeOf({ state, take }: Moment, set: StrandSet) {
  return set.attributes.includes(state.by) ? take.attributes.find((a) => a.name === state.by) : undefined;
}

export function movingLevel(moment: Moment, set: StrandSet): Level {
  // Of isolated strands, a few dozen, none may be left out.
  return level(set, moment.state.isolated ? set.strands : moment.most);
}

/** Level of the strands over the footage. */
export function footageLevel(moment: Moment, set: StrandSet): Level {
  if (!moment.state.view) return level(set, SHEET.strands, SHEET.points);
  return moment.moving || moment.rest < 200_000 ? movingLevel(moment, set) : level(set, 8000, 24);
}

/** Pictures of many views at a time are small; 0: as large as they are. */
export const imageWidth = (state: State) => (state.mode === 'space' ? 320 : state.view ? 0 : 480);

/** The frames that come next, in the order in which they will be needed. */
export function ahead(take: Take, frame: number, count: number, loop: boolean): number[] {
  const [lo, hi] = take.frames;
  const out: number[] = [];
  for (let i = 1; i <= Math.min(count, hi - lo - 1); i++) {
    const next = frame + i;
    if (next < hi) out.push(next);
    else if (loop) out.push(lo + ((next - lo) % (hi - lo)));
  }
  return out;
}

/** `most`: frames to fetch ahead of their time. */
export function wants(moment: Moment, requests: Requests, most = moment.state.mode === 'space' ? AHEAD : AHEAD_PICTURES): Wanted[] {
  return moment.state.mode === 'space' ? inSpace(moment, requests, most) : onFootage(moment, requests, most);
}

function inSpace(moment: Moment, requests: Requests, most: number): Wanted[] {
  const { state, take, moving } = moment;
  const list: Wanted[] = [];
  const sets = shownSets(moment);
  const frameOf = (set: StrandSet, frame: number, l: Level) => {
    if (!isDone(set, frame) || !state.layers.strands) return;
    list.push(requests.binary(paths.strands(set, frame, l), decodeStrands));
    const attribute = attributeOf(moment, set);
    if (attribute) list.push(requests.binary(paths.values(set, attribute.name, frame, l), decodeValues));
  };
  const one = (frame: number) => {
    const set = sets[0];
    if (state.selected !== null && set && isDone(set, frame)) {
      list.push(requests.binary(paths.one(set, frame, state.selected), decodeStrands));
    }
  };
  // The coarse frame comes first even at rest: it is there in no time.
  for (const set of sets) frameOf(set, state.frame, movingLevel(moment, set));
  one(state.frame);
  if (take.layers.head) list.push(requests.binary(paths.head(), decodeMesh));
  if (!moving) for (const set of sets) frameOf(set, state.frame, fullLevel(set, moment.rest));
  if (state.selected !== null && sets[0]) list.push(requests.json(paths.details(sets[0], state.selected)));
  if (state.layers.hull && take.layers.hull) list.push(requests.binary(paths.hull(state.frame), decodeMesh, 'hull'));
  if (state.layers.lines && take.layers.lines) list.push(requests.binary(paths.lines(state.frame), decodeRows(7), 'lines'));
  if (state.layers.arrows && take.layers.arrows) list.push(requests.binary(paths.arrows(state.frame), decodeRows(6), 'arrows'));
  if (state.layers.cameras && state.layers.images) {
    for (const view of take.views) if (view.footage) list.push({ ...requests.picture(paths.image(view.name, state.frame, imageWidth(state))), lane: `image ${view.name}` });
  }
  for (const frame of ahead(take, state.frame, most, state.loop)) {
    for (const set of sets) frameOf(set, frame, movingLevel(moment, set));
    one(frame);
  }
  return list;
}

function onFootage(moment: Moment, requests: Requests, most: number): Wanted[] {
  const { state, take } = moment;
  const list: Wanted[] = [];
  const views = state.view ? take.views.filter((view) => view.name === state.view) : take.views;
  const frameOf = (frame: number) => {
    for (const view of views) {
      if (state.layers.footage && view.footage) list.push(requests.picture(paths.image(view.name, frame, imageWidth(state))));
      if (state.layers.masks && take.layers.masks) list.push(requests.picture(paths.mask(view.name, frame)));
      if (state.layers.orientation && take.layers.orientation) list.push(requests.picture(paths.orientation(view.name, frame)));
    }
    if (!state.layers.strands) return;
    for (const set of shownSets(moment)) {
      if (!isDone(set, frame)) continue;
      const l = footageLevel(moment, set);
      for (const view of views) list.push(requests.binary(paths.projected(set, view.name, frame, l), decodeProjected));
      const attribute = attributeOf(moment, set);
      if (attribute) list.push(requests.binary(paths.values(set, attribute.name, frame, l), decodeValues));
    }
    const set = shownSets(moment)[0];
    if (state.selected !== null && set && isDone(set, frame)) {
      for (const view of views) list.push(requests.binary(paths.projectedOne(set, view.name, frame, state.selected), decodeProjected));
    }
  };
  frameOf(state.frame);
  const set = shownSets(moment)[0];
  if (state.selected !== null && set) list.push(requests.json(paths.details(set, state.selected)));
  for (const frame of ahead(take, state.frame, most, state.loop)) frameOf(frame);
  return list;
}
