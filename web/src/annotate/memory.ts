// What the browser keeps of a take between two openings of the page: the steps that can be undone.

import type { Keeper, Kept, Past } from './history.ts';

const [NAME, STEPS, ORDERS] = ['strandflow annotate', 'steps', 'orders'];

/** Takes whose steps are kept, the last opened ones. */
const TAKES = 6;

interface Order {
  /** When it was written [ms]. */
  at?: number;
  done: number[];
  undone: number[];
  versions: Map<string, string>;
}

export class Memory implements Keeper {
  private waiting = 0;

  private constructor(private readonly db: IDBDatabase, private readonly take: string) {}

  /** What is kept of a take; nothing where the browser keeps nothing. */
  static async open(take: string): Promise<{ memory: Memory | null; past: Past | null }> {
    try {
      const asked = indexedDB.open(NAME, 1);
      asked.onupgradeneeded = () => { asked.result.createObjectStore(STEPS); asked.result.createObjectStore(ORDERS); };
      const db = await answer(asked);
      const stores = db.transaction([STEPS, ORDERS]);
      const order = (await answer(stores.objectStore(ORDERS).get(take))) as Order | undefined;
      const steps = (await answer(stores.objectStore(STEPS).getAll(ofTake(take)))) as Kept[];
      const byNumber = new Map(steps.map((kept) => [kept.n, kept]));
      // A step without its data, and all before it, cannot be had any more.
      const whole = (numbers: number[]) => {
        const missing = numbers.reduce((last, n, i) => (byNumber.has(n) ? last : i), -1);
        return numbers.slice(missing + 1).map((n) => byNumber.get(n)!);
      };
      await forgetOthers(db, take);
      const past = order ? { done: whole(order.done), undone: whole(order.undone), versions: order.versions } : null;
      return { memory: new Memory(db, take), past };
    } catch {
      return { memory: null, past: null };
    }
  }

  /** Whether all is kept. */
  get atRest(): boolean {
    return this.waiting === 0;
  }

  put(kept: Kept): void {
    this.write(STEPS, (store) => store.put(kept, [this.take, kept.n]));
  }

  drop(numbers: number[]): void {
    this.write(STEPS, (store) => numbers.forEach((n) => store.delete([this.take, n])));
  }

  order(done: number[], undone: number[], versions: Map<string, string>): void {
    const order: Order = { at: Date.now(), done, undone, versions };
    this.write(ORDERS, (store) => store.put(order, this.take));
  }

  private write(name: string, how: (store: IDBObjectStore) => void): void {
    try {
      const change = this.db.transaction(name, 'readwrite');
      this.waiting += 1;
      // A full disk leaves the page with what it holds itself.
      change.oncomplete = change.onabort = () => void (this.waiting -= 1);
      how(change.objectStore(name));
    } catch {
      // The browser took its store away; undoing still reaches back to the opening of the page.
    }
  }
}

/** Takes that were not opened for long give their place to others. */
async function forgetOthers(db: IDBDatabase, take: string): Promise<void> {
  const stores = db.transaction([STEPS, ORDERS], 'readwrite');
  const [takes, orders] = await Promise.all([answer(stores.objectStore(ORDERS).getAllKeys()), answer(stores.objectStore(ORDERS).getAll())]);
  const byAge = takes.map((name, i) => ({ name: String(name), at: (orders[i] as Order).at ?? 0 })).sort((a, b) => b.at - a.at);
  for (const { name } of byAge.slice(TAKES).filter((other) => other.name !== take)) {
    stores.objectStore(ORDERS).delete(name);
    stores.objectStore(STEPS).delete(ofTake(name));
  }
}

const ofTake = (take: string) => IDBKeyRange.bound([take, -Infinity], [take, Infinity]);

function answer<T>(asked: IDBRequest<T>): Promise<T> {
  return new Promise((done, failed) => {
    asked.onsuccess = () => done(asked.result);
    asked.onerror = () => failed(asked.error);
  });
}
