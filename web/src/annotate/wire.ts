// What goes to the program and comes from it (docs/annotate.md). Each document is saved after each stroke; where the program
// does not answer, what was drawn waits here and is sent again.

import { Api, Lost, Refusal } from '../api.ts';
import type { P2, P3, WorkView } from './camera.ts';
import type { History } from './history.ts';

export interface Work {
  /** Tells takes apart: the same take has the same. */
  id: string;
  name: string;
  fps: number;
  frames: [number, number];
  views: WorkView[];
  hair: Record<string, number[]>;
  subject: Record<string, number[]>;
  sketches: number[];
  marker_radius_px: number;
  notes: { fact: string; hint: string }[];
}

export interface Marker {
  id: number;
  views: Record<string, P2>;
}

export interface LabelDoc {
  frame: number;
  markers: Marker[];
  corrections?: { frame: number; markers: Marker[] }[];
}

export interface Tracks {
  views: Record<string, Record<string, P2>>;
  markers: Record<string, P3>;
  used: number;
  rms_px: number | null;
  interpolated: boolean;
}

export interface SketchDoc {
  strands: { id: number; views: Record<string, P2[]> }[];
}

export type MaskKind = 'hair' | 'subject';
export const ORIGINS = ['none', 'given', 'computed'] as const;
export type Origin = (typeof ORIGINS)[number];

export interface MaskAnswer {
  version: string;
  origin: Origin;
  width: number;
  height: number;
  data: Uint8Array;
}

export async function readMask(api: Api, path: string): Promise<MaskAnswer> {
  const { bytes, version } = await api.versioned(path);
  const [, width, height, origin] = new Uint32Array(bytes, 0, 4);
  return { version, origin: ORIGINS[origin] ?? 'none', width, height, data: new Uint8Array(bytes, 16) };
}

export async function readJson<T>(api: Api, path: string): Promise<{ value: T; version: string }> {
  const { bytes, version } = await api.versioned(path);
  return { value: JSON.parse(new TextDecoder().decode(bytes)) as T, version };
}

type Body = { bytes: Uint8Array<ArrayBuffer> | string; kind: string } | null;

interface Waiting {
  path: string;
  version: string;
  /** Made when it is sent, so that strokes that came meanwhile go along; null takes the document away. */
  body: () => Promise<Body> | Body;
  wanted: boolean;
  busy: boolean;
  changed: () => void;
}

const AGAIN_MS = 1500;

/** Sends documents, one request a document at a time. */
export class Saver {
  private readonly documents = new Map<string, Waiting>();
  private timer = 0;
  /** What the last try said, where it failed. */
  trouble = '';
  saved = 0;

  constructor(
    private readonly api: Api,
    private readonly history: Pick<History, 'opened' | 'saved'>,
    private readonly told: () => void,
    private readonly refused: (error: Refusal) => void,
    /** The token is not known to the program any more: it was started anew. */
    private readonly unknown: () => void,
  ) {
    addEventListener('beforeunload', (event) => { if (this.waiting > 0) event.preventDefault(); });
  }

  /** Makes a document known, with its version. `changed`: someone else changed it, so it has to be read again. */
  open(path: string, version: string, body: Waiting['body'], changed: () => void): void {
    const known = this.documents.get(path);
    if (known?.wanted || known?.busy) return;
    this.documents.set(path, { path, version, body, wanted: false, busy: false, changed });
    this.history.opened(path, version);
  }

  save(path: string): void {
    const document = this.documents.get(path);
    if (!document) return;
    document.wanted = true;
    void this.send(document);
  }

  get waiting(): number {
    return [...this.documents.values()].filter((d) => d.wanted || d.busy).length;
  }

  isSaved(path: string): boolean {
    const document = this.documents.get(path);
    return !document || (!document.wanted && !document.busy);
  }

  again(): void {
    for (const document of this.documents.values()) if (document.wanted) void this.send(document);
  }

  private async send(document: Waiting): Promise<void> {
    if (document.busy) return;
    document.busy = true;
    document.wanted = false;
    this.told();
    try {
      const body = await document.body();
      document.version = await this.api.change(document.path, document.version, body?.bytes ?? null, body?.kind);
      this.trouble = '';
      this.saved += 1;
      this.history.saved(document.path, document.version);
    } catch (error) {
      this.failed(document, error as Error);
    }
    document.busy = false;
    this.told();
    if (document.wanted && this.trouble === '') void this.send(document);
  }

  private failed(document: Waiting, error: Error): void {
    if (error instanceof Refusal && error.status !== 401 && error.status < 500) {
      // What was refused is not sent again; the page shows what the program has.
      this.refused(error);
      document.wanted = false;
      this.documents.delete(document.path);
      document.changed();
      return;
    }
    document.wanted = true;
    this.trouble = error instanceof Lost ? 'the program does not answer' : error.message;
    clearTimeout(this.timer);
    // Without the new token every try would be refused.
    if (error instanceof Refusal && error.status === 401) return this.unknown();
    this.timer = window.setTimeout(() => this.again(), AGAIN_MS);
  }
}
