// How much may be drawn so that it stays fluent: from what drawing took lately. A graphics card draws all there is; a browser
// on a server without one paints in software, a hundred times slower.

/** Points of a frame that a browser holds and draws with ease. */
export const MOST_POINTS = 1_000_000;

const MOVING_MS = 40;
const REST_MS = 500;
const MOVING_STEPS = [2000, 1000, 500];
const REST_STEPS = [MOST_POINTS, 500_000, 250_000, 120_000, 60_000];
const POINTS_WHILE_MOVING = 14;
/** More is shown again only where there is much room: between the two nothing changes. */
const ROOM = 0.4;

function fitting(steps: number[], now: number, cost: (step: number) => number, limit: number): number {
  const best = steps.find((step) => cost(step) <= limit) ?? steps[steps.length - 1];
  return best > now && cost(best) > limit * ROOM ? now : best;
}

export class Pace {
  private readonly late: number[] = [];
  /** Strands while frames change. */
  moving = MOVING_STEPS[0];
  /** Points of a frame at rest. */
  rest = REST_STEPS[0];

  /** Returns whether anything changed. */
  drew(points: number, ms: number): boolean {
    // Of a few thousand points the rest of the picture is the greater part.
    if (points < 5000) return false;
    this.late.push(ms / points);
    if (this.late.length > 5) this.late.shift();
    if (this.late.length < 2) return false;
    // The least of late: shaders that are made and other work on the machine only ever add.
    const each = Math.min(...this.late);
    const [moving, rest] = [this.moving, this.rest];
    this.moving = fitting(MOVING_STEPS, moving, (strands) => strands * POINTS_WHILE_MOVING * each, MOVING_MS);
    this.rest = fitting(REST_STEPS, rest, (all) => all * each, REST_MS);
    return moving !== this.moving || rest !== this.rest;
  }
}
