// Undo and redo of all tools, in the order of the strokes. A step holds both sides of what it changed, so that nothing is asked
// of the program; the browser keeps the steps, so that they outlive a reload.

import type { Look } from './state.ts';

export interface Step {
  /** In words: "label", "stroke", … */
  what: string;
  /** The document that was changed. */
  path: string;
  /** Where it happened. */
  look: Partial<Look>;
  before: unknown;
  after: unknown;
  bytes: number;
}

/** A step with its number, by which it is kept. */
export interface Kept {
  n: number;
  step: Step;
}

/** What outlives a reload. */
export interface Keeper {
  put(kept: Kept): void;
  drop(numbers: number[]): void;
  /** Which steps can be undone and redone, and the versions of the documents that they made. */
  order(done: number[], undone: number[], versions: Map<string, string>): void;
}

export interface Past {
  done: Kept[];
  undone: Kept[];
  versions: Map<string, string>;
}

interface Hands {
  /** Goes to where a step happened and has its document at hand; whether it is there. */
  open: (step: Step) => Promise<boolean>;
  /** Makes one side of a step what the document has. */
  restore: (step: Step, side: unknown) => void;
}

/** Bytes of steps that are kept for undoing. */
const MOST_BYTES = 192 * 2 ** 20;

export class History {
  private readonly done: Kept[];
  private readonly undone: Kept[];
  private readonly versions: Map<string, string>;
  private next: number;
  private work: Promise<Step | null> = Promise.resolve(null);
  /** Documents whose steps were given up, because somebody else changed them. */
  onDropped: (path: string) => void = () => {};

  constructor(private readonly hands: Hands, past: Past | null = null, private readonly keeper: Keeper | null = null) {
    [this.done, this.undone, this.versions] = [past?.done ?? [], past?.undone ?? [], past?.versions ?? new Map()];
    this.next = Math.max(-1, ...[...this.done, ...this.undone].map((kept) => kept.n)) + 1;
  }

  get depth(): [number, number] {
    return [this.done.length, this.undone.length];
  }

  /** The steps that would be undone and redone next. */
  get ends(): [Step | undefined, Step | undefined] {
    return [this.done.at(-1)?.step, this.undone.at(-1)?.step];
  }

  /** How many steps were ever made. */
  get made(): number {
    return this.next;
  }

  add(step: Step): void {
    const gone = this.undone.splice(0);
    const kept = { n: this.next++, step };
    this.done.push(kept);
    let bytes = this.done.reduce((sum, { step }) => sum + step.bytes, 0);
    // The newest step stays even where it alone is over the limit.
    while (bytes > MOST_BYTES && this.done.length > 1) {
      gone.push(this.done[0]);
      bytes -= this.done.shift()!.step.bytes;
    }
    this.keeper?.put(kept);
    this.forget(gone);
  }

  /** A document came. Steps of another version of it, changed by someone else or after the page was last open, are given up. */
  opened(path: string, version: string): void {
    const known = this.versions.get(path);
    if (known !== undefined && known !== version) this.drop(path);
    this.versions.set(path, version);
  }

  /** A document is on the disk. */
  saved(path: string, version: string): void {
    this.versions.set(path, version);
    this.order();
  }

  /** After someone else changed a document, what was done to the old one cannot be undone. */
  drop(path: string): void {
    const gone: Kept[] = [];
    for (const list of [this.done, this.undone]) {
      const mine = list.filter(({ step }) => step.path === path);
      gone.push(...mine);
      list.splice(0, Infinity, ...list.filter((kept) => !mine.includes(kept)));
    }
    if (gone.length === 0) return;
    this.forget(gone);
    this.onDropped(path);
  }

  /** Undoes; the step that was undone. */
  undo(): Promise<Step | null> {
    return this.move(this.done, this.undone, 'before');
  }

  redo(): Promise<Step | null> {
    return this.move(this.undone, this.done, 'after');
  }

  /** One after the other: a mask of another frame may have to be read first, which may show that its steps are gone. */
  private move(from: Kept[], to: Kept[], side: 'before' | 'after'): Promise<Step | null> {
    this.work = this.work.then(async () => {
      for (;;) {
        const kept = from.at(-1);
        if (!kept || !(await this.hands.open(kept.step))) return null;
        if (from.at(-1) !== kept) continue;
        from.pop();
        to.push(kept);
        this.hands.restore(kept.step, kept.step[side]);
        this.order();
        return kept.step;
      }
    });
    return this.work;
  }

  private forget(gone: Kept[]): void {
    if (gone.length > 0) this.keeper?.drop(gone.map((kept) => kept.n));
    this.order();
  }

  private order(): void {
    this.keeper?.order(this.done.map((kept) => kept.n), this.undone.map((kept) => kept.n), this.versions);
  }
}
