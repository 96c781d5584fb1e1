// What the page shows; kept behind the `#` of its address, so that a reload goes on where it was.

import type { Work } from './wire.ts';

export const TOOLS = ['markers', 'hair', 'subject', 'strands'] as const;
export type ToolName = (typeof TOOLS)[number];

export interface Look {
  tool: ToolName;
  frame: number;
  view: string;
  marker: number | null;
  strand: number | null;
  /** Radius of the brush [image px]. */
  brush: number;
  erase: boolean;
  overlay: boolean;
  /** All views alike instead of one large. */
  sheet: boolean;
  /** The small views show the surroundings of what is selected. */
  close: boolean;
  /** The large view: image point in its middle, and times its fitted size. */
  zoom: { at: [number, number]; times: number } | null;
}

export function firstLook(work: Work): Look {
  return {
    tool: 'markers', frame: work.frames[0], view: work.views[0]?.name ?? '', marker: null, strand: null,
    brush: 8, erase: false, overlay: true, sheet: false, close: false, zoom: null,
  };
}

export function toHash(look: Look): string {
  const q = new URLSearchParams({ tool: look.tool, frame: String(look.frame), view: look.view });
  if (look.marker !== null) q.set('marker', String(look.marker));
  if (look.strand !== null) q.set('strand', String(look.strand));
  q.set('brush', String(look.brush));
  for (const name of ['erase', 'sheet', 'close'] as const) if (look[name]) q.set(name, '1');
  if (!look.overlay) q.set('overlay', '0');
  if (look.zoom) q.set('zoom', [...look.zoom.at, look.zoom.times].map((v) => Math.round(v * 100) / 100).join(','));
  return q.toString().replaceAll('%2C', ',');
}

/** What it does not know, or the take does not have, stays as in the first look. */
export function fromHash(hash: string, work: Work): Look {
  const q = new URLSearchParams(hash.replace(/^#/, ''));
  const look = firstLook(work);
  const whole = (key: string) => { const n = Number(q.get(key) ?? NaN); return Number.isInteger(n) && n >= 0 ? n : null; };
  const tool = TOOLS.find((name) => name === q.get('tool'));
  if (tool) look.tool = tool;
  look.frame = clampFrame(work, whole('frame') ?? look.frame);
  look.view = work.views.find((view) => view.name === q.get('view'))?.name ?? look.view;
  [look.marker, look.strand] = [whole('marker'), whole('strand')];
  look.brush = Math.min(200, Math.max(1, whole('brush') ?? look.brush));
  [look.erase, look.sheet, look.close] = [q.get('erase') === '1', q.get('sheet') === '1', q.get('close') === '1'];
  look.overlay = q.get('overlay') !== '0';
  const zoom = q.get('zoom')?.split(',').map(Number) ?? [];
  if (zoom.length === 3 && zoom.every(Number.isFinite) && zoom[2] >= 1) look.zoom = { at: [zoom[0], zoom[1]], times: Math.min(64, zoom[2]) };
  return look;
}

export function clampFrame(work: Work, frame: number): number {
  return Math.min(work.frames[1] - 1, Math.max(work.frames[0], Math.round(frame)));
}
