// Fetches what is wanted now. Wanting is a whole list, most urgent first: what is not on it any more is given up.

import type { ByteCache } from './cache.ts';

/** A thing the program can send. Its path is its name in the cache. */
export interface Wanted {
  path: string;
  fetch: (path: string, signal: AbortSignal) => Promise<{ value: unknown; bytes: number }>;
  /**
   * Things of one lane come one at a time and are not given up half way: what takes longer than a frame lasts (a hull, say)
   * would else never arrive while frames change.
   */
  lane?: string;
}

interface Flight {
  wanted: Wanted;
  stop: AbortController;
}

const AT_ONCE = 5;
/** A refused thing is asked for again after this long, should it still be wanted. */
const AGAIN_MS = 5000;

export class Loader {
  private queue: Wanted[] = [];
  private readonly flights = new Map<string, Flight>();
  private readonly refused = new Map<string, number>();
  aborted = 0;
  fetched = 0;

  constructor(
    private readonly cache: ByteCache<unknown>,
    private readonly arrived: () => void,
    private readonly failed: (path: string, error: Error) => void,
    private readonly now: () => number = () => performance.now(),
  ) {}

  /** What has arrived, if it is still there. */
  get<T>(path: string): T | undefined {
    return this.cache.get(path) as T | undefined;
  }

  has(path: string): boolean {
    return this.cache.has(path);
  }

  /** The program refused it a moment ago: there is no use in waiting for it. */
  isRefused(path: string): boolean {
    return this.waits(path);
  }

  want(list: Wanted[]): void {
    const paths = new Set(list.map((w) => w.path));
    for (const [path, flight] of this.flights) {
      if (paths.has(path) || flight.wanted.lane) continue;
      flight.stop.abort();
      this.flights.delete(path);
      this.aborted += 1;
    }
    this.queue = list;
    this.next();
  }

  /** Nothing wanted is missing, but for what was refused. */
  get idle(): boolean {
    return this.flights.size === 0;
  }

  private next(): void {
    for (const wanted of this.queue) {
      if (this.flights.size >= AT_ONCE) return;
      if (this.cache.has(wanted.path) || this.flights.has(wanted.path) || this.waits(wanted.path)) continue;
      if (wanted.lane && [...this.flights.values()].some((f) => f.wanted.lane === wanted.lane)) continue;
      void this.start(wanted);
    }
  }

  private waits(path: string): boolean {
    const at = this.refused.get(path);
    if (at === undefined) return false;
    if (this.now() - at < AGAIN_MS) return true;
    this.refused.delete(path);
    return false;
  }

  private async start(wanted: Wanted): Promise<void> {
    const flight = { wanted, stop: new AbortController() };
    this.flights.set(wanted.path, flight);
    try {
      const { value, bytes } = await wanted.fetch(wanted.path, flight.stop.signal);
      if (flight.stop.signal.aborted) return;
      this.cache.set(wanted.path, value, bytes);
      this.fetched += 1;
    } catch (error) {
      if (flight.stop.signal.aborted) return;
      this.refused.set(wanted.path, this.now());
      this.failed(wanted.path, error as Error);
    }
    this.flights.delete(wanted.path);
    this.arrived();
    this.next();
  }
}
