// Which frame is due while playing.

export interface Step {
  frame: number;
  /** Frames' worth of time that is left over. */
  carry: number;
  /** The next frame has not arrived yet. */
  waits: boolean;
  /** Ran past the end and stopped there. */
  ended: boolean;
}

/**
 * Goes on by `due` frames of time. Frames may be passed over on a slow machine, but never to one that has not arrived: then
 * the clock waits, so that what was recorded is seen, if late.
 */
export function step(frame: number, due: number, [lo, hi]: [number, number], loop: boolean, ready: (frame: number) => boolean): Step {
  const whole = Math.floor(due);
  if (whole < 1) return { frame, carry: due, waits: false, ended: false };
  const count = hi - lo;
  for (let by = Math.min(whole, Math.max(1, count - 1)); by >= 1; by--) {
    const past = frame + by >= hi;
    if (past && !loop) {
      if (frame === hi - 1) return { frame, carry: 0, waits: false, ended: true };
      continue;
    }
    const next = past ? lo + ((frame + by - lo) % count) : frame + by;
    if (ready(next)) return { frame: next, carry: Math.min(1, due - whole), waits: false, ended: false };
  }
  return { frame, carry: Math.min(1, due), waits: true, ended: false };
}

/** Mean of what came lately, heavier the later. */
export class Lately {
  value: number | null = null;
  constructor(private readonly share = 0.15) {}

  add(v: number): void {
    this.value = this.value === null ? v : this.value + this.share * (v - this.value);
  }

  forget(): void {
    this.value = null;
  }
}
