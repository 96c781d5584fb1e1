// Footage as it arrives, whole for the large view and small for the others; what is next in time is fetched ahead.

import { Api } from '../api.ts';
import { ByteCache } from '../cache.ts';

const MOST_BYTES = 384 * 2 ** 20;
/** Requests at once; the browser allows six. */
const AT_ONCE = 5;

export class Images {
  private readonly have = new ByteCache<ImageBitmap>(MOST_BYTES, (bitmap) => bitmap.close());
  private wanted: string[] = [];
  private readonly busy = new Map<string, AbortController>();
  private readonly missing = new Map<string, string>();

  constructor(private readonly api: Api, private readonly arrived: () => void) {}

  static path(view: string, frame: number, width: number | null): string {
    return `/api/image/${encodeURIComponent(view)}/${frame}${width ? `?width=${width}` : ''}`;
  }

  get(path: string): ImageBitmap | undefined {
    return this.have.get(path);
  }

  /** Why an image cannot be had. */
  why(path: string): string | undefined {
    return this.missing.get(path);
  }

  get atRest(): boolean {
    return this.busy.size === 0 && this.wanted.every((path) => this.have.has(path) || this.missing.has(path));
  }

  /** All that is wanted now, the most urgent first; what else was under way is given up. */
  want(paths: string[]): void {
    this.wanted = paths;
    for (const [path, gone] of this.busy) if (!paths.includes(path)) gone.abort();
    this.next();
  }

  /** After the program came back, what was missing may be there. */
  forgetMissing(): void {
    this.missing.clear();
    this.next();
  }

  private next(): void {
    for (const path of this.wanted) {
      if (this.busy.size >= AT_ONCE) return;
      if (!this.have.has(path) && !this.busy.has(path) && !this.missing.has(path)) void this.fetch(path);
    }
  }

  private async fetch(path: string): Promise<void> {
    const gone = new AbortController();
    this.busy.set(path, gone);
    try {
      const bitmap = await this.api.picture(path, gone.signal);
      this.have.set(path, bitmap, bitmap.width * bitmap.height * 4);
    } catch (error) {
      if (!gone.signal.aborted) this.missing.set(path, (error as Error).message);
    }
    this.busy.delete(path);
    this.arrived();
    this.next();
  }
}
