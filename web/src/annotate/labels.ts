// The document of labels: markers of one frame, and in others corrections and markers that are first labelled there.

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

/** All markers, in whatever frame they are labelled. */
export function markerIds(doc: LabelDoc): number[] {
  const of = [doc.markers, ...(doc.corrections ?? []).map((c) => c.markers)];
  return [...new Set(of.flatMap((markers) => markers.map((m) => m.id)))].sort((a, b) => a - b);
}

/** A new marker; the first one of all makes its frame that of the labels. */
export function addMarker(doc: LabelDoc, frame: number, id: number): void {
  if (!doc.markers.length && !doc.corrections?.length) doc.frame = frame;
  if (frame === doc.frame) doc.markers.push({ id, views: {} });
}

/** Takes a marker out of a frame; out of that of the labels, out of all. */
export function removeMarker(doc: LabelDoc, frame: number, id: number): void {
  const others = (markers: Marker[]) => markers.filter((m) => m.id !== id);
  if (frame === doc.frame) {
    doc.markers = others(doc.markers);
    doc.corrections = doc.corrections?.map((c) => ({ ...c, markers: others(c.markers) }));
  } else doc.corrections = doc.corrections?.map((c) => (c.frame === frame ? { ...c, markers: others(c.markers) } : c));
  tidy(doc);
}

/** Markers of other frames without a point are none. One of the labels' frame keeps its number until it is removed. */
function tidy(doc: LabelDoc): void {
  const kept = (m: Marker) => Object.keys(m.views).length > 0;
  doc.corrections = (doc.corrections ?? []).map((c) => ({ ...c, markers: c.markers.filter(kept) })).filter((c) => c.markers.length > 0);
}
