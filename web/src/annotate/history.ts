// Undo and redo of all tools, in the order of the strokes.

export interface Step {
  /** In words: "label", "stroke", … */
  what: string;
  /** Goes to where it happened. */
  show: () => void;
  undo: () => void | Promise<void>;
  redo: () => void | Promise<void>;
  bytes: number;
}

/** Bytes of masks that are kept for undoing. */
const MOST_BYTES = 192 * 2 ** 20;

export class History {
  private readonly done: Step[] = [];
  private readonly undone: Step[] = [];
  private work: Promise<void> = Promise.resolve();

  get depth(): [number, number] {
    return [this.done.length, this.undone.length];
  }

  add(step: Step): void {
    this.done.push(step);
    this.undone.length = 0;
    let bytes = this.done.reduce((sum, step) => sum + step.bytes, 0);
    // The newest step stays even where it alone is over the limit.
    while (bytes > MOST_BYTES && this.done.length > 1) bytes -= this.done.shift()!.bytes;
  }

  /** After someone else changed a document, what was done to the old one cannot be undone. */
  clear(): void {
    this.done.length = this.undone.length = 0;
  }

  undo(): Promise<void> {
    return this.move(this.done, this.undone, (step) => step.undo());
  }

  redo(): Promise<void> {
    return this.move(this.undone, this.done, (step) => step.redo());
  }

  /** One after the other: a step may have to read a mask again first. */
  private move(from: Step[], to: Step[], act: (step: Step) => void | Promise<void>): Promise<void> {
    this.work = this.work.then(async () => {
      const step = from.pop();
      if (!step) return;
      step.show();
      await act(step);
      to.push(step);
    });
    return this.work;
  }
}
