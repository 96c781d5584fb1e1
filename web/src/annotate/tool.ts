// What every tool can do, and what it works with.

import type { Api } from '../api.ts';
import type { P2, P3, WorkView } from './camera.ts';
import type { History, Step } from './history.ts';
import type { Look } from './state.ts';
import type { Saver, Work } from './wire.ts';

export type Part = 'all' | 'view' | 'cursor';

export interface Room {
  work: Work;
  views: WorkView[];
  /** What the cameras look at. */
  centre: P3;
  look: Look;
  history: History;
  saver: Saver;
  api: Api;
  view(name: string): WorkView;
  set(change: Partial<Look>): void;
  /** Draws anew: everything, the view that is worked on, or where the cursor is. */
  redraw(what?: Part): void;
  say(text: string, hint?: string): void;
  error(error: Error): void;
}

/** An image point of a view. */
export interface Spot {
  view: WorkView;
  at: P2;
  /** Image pixels a pixel of the screen. */
  px: number;
}

export type Tone = '' | 'todo' | 'bad';

export interface Tool {
  /** Asks for what the frame needs. */
  enter(): void;
  /** Asks anew for what a run may have made meanwhile. */
  refresh(): void;
  /** Has the document of a step at hand, in the frame and view that are shown; whether it is there. */
  ready(): Promise<boolean>;
  /** Makes one side of a step what its document has. */
  restore(step: Step, side: unknown): void;
  /** Whether everything that is asked for is here. */
  readonly atRest: boolean;
  /** Draws over a view, in image pixels; `px` of them are one of the screen. `large`: the view that is worked on. */
  draw(ink: CanvasRenderingContext2D, view: WorkView, px: number, large: boolean): void;
  /** The pointer goes down, moves while it is down, and comes up. */
  down(spot: Spot): void;
  move(spot: Spot): void;
  up(): void;
  /** The same as a click, at the cursor. */
  act(spot: Spot): void;
  step(by: number): void;
  fresh(): void;
  remove(everywhere: boolean): void;
  /** What stands under a small view. */
  caption(view: WorkView): string;
  /** Whether that is something to do, or wrong. */
  tone(view: WorkView): Tone;
  /** Where a small view looks when close. */
  focus(view: WorkView): P2 | null;
  /** What the side panel shows. */
  panel(): (Node | false)[];
  /** Frames with something of this tool. */
  frames(): number[];
  /** For whoever drives the page. */
  counters(): Record<string, unknown>;
}

export const apart = (a: P2, b: P2) => Math.hypot(a[0] - b[0], a[1] - b[1]);

/** A point within its view. */
export function within(view: WorkView, [x, y]: P2): P2 {
  return [Math.min(view.width, Math.max(0, x)), Math.min(view.height, Math.max(0, y))];
}

/** What is sent has no more digits than anybody can point at. */
export const rounded = ([x, y]: P2): P2 => [Math.round(x * 100) / 100, Math.round(y * 100) / 100];
