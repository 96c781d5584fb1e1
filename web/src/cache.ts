// What was fetched, bounded by bytes: the least recently used goes first.

interface Entry<T> {
  value: T;
  bytes: number;
}

export class ByteCache<T> {
  /** A map keeps the order of insertion, so its first key is the one that was not used for the longest time. */
  private readonly entries = new Map<string, Entry<T>>();
  bytes = 0;

  constructor(readonly limit: number, private readonly dropped: (value: T) => void = () => {}) {}

  has(key: string): boolean {
    return this.entries.has(key);
  }

  get(key: string): T | undefined {
    const entry = this.entries.get(key);
    if (!entry) return undefined;
    this.entries.delete(key);
    this.entries.set(key, entry);
    return entry.value;
  }

  set(key: string, value: T, bytes: number): void {
    this.delete(key);
    this.entries.set(key, { value, bytes });
    this.bytes += bytes;
    for (const old of this.entries.keys()) {
      // The newest entry stays even where it alone is over the limit: it is what was asked for.
      if (this.bytes <= this.limit || old === key) break;
      this.delete(old);
    }
  }

  delete(key: string): void {
    const entry = this.entries.get(key);
    if (!entry) return;
    this.entries.delete(key);
    this.bytes -= entry.bytes;
    this.dropped(entry.value);
  }

  get size(): number {
    return this.entries.size;
  }
}
