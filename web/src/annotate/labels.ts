// The document of labels: markers of one frame, and corrections in others.

import type { P2 } from './camera.ts';
import { rounded } from './tool.ts';
import type { LabelDoc, Marker } from './wire.ts';

/** The labels of a frame. */
export function labelsAt(doc: LabelDoc, frame: number): Marker[] {
  return frame === doc.frame ? doc.markers : doc.corrections?.find((c) => c.frame === frame)?.markers ?? [];
}

/** Puts a marker's label in a view, or takes it away. */
export function putLabel(doc: LabelDoc, frame: number, id: number, view: string, at: P2 | null): void {
  if (frame !== doc.frame && !doc.corrections?.some((c) => c.frame === frame)) {
    doc.corrections = [...(doc.corrections ?? []), { frame, markers: [] }].sort((a, b) => a.frame - b.frame);
  }
  const markers = labelsAt(doc, frame);
  let marker = markers.find((m) => m.id === id);
  if (!marker) {
    marker = { id, views: {} };
    markers.push(marker);
    markers.sort((a, b) => a.id - b.id);
  }
  if (at) marker.views[view] = rounded(at);
  else delete marker.views[view];
  tidy(doc);
}

/** Takes a marker out of a frame; out of the first frame, out of all. */
export function removeMarker(doc: LabelDoc, frame: number, id: number): void {
  const others = (markers: Marker[]) => markers.filter((m) => m.id !== id);
  if (frame === doc.frame) doc.markers = others(doc.markers);
  else doc.corrections = doc.corrections?.map((c) => (c.frame === frame ? { ...c, markers: others(c.markers) } : c));
  tidy(doc);
}

/** Corrections without a point are none. A marker of the first frame keeps its number until it is removed. */
function tidy(doc: LabelDoc): void {
  const known = new Set(doc.markers.map((m) => m.id));
  const kept = (m: Marker) => known.has(m.id) && Object.keys(m.views).length > 0;
  doc.corrections = (doc.corrections ?? []).map((c) => ({ ...c, markers: c.markers.filter(kept) })).filter((c) => c.markers.length > 0);
}
