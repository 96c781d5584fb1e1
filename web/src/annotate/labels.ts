// The document of labels: markers by frame. One frame of them stands first in the file, the others are its corrections; to whoever
// labels all are alike.

import type { P2 } from './camera.ts';
import { rounded } from './tool.ts';
import type { LabelDoc, Marker } from './wire.ts';

/** Markers, each in two views or more, that the frame must have from which tracks begin. */
export const NEEDED = 5;

/** The labels of a frame. */
export function labelsAt(doc: LabelDoc, frame: number): Marker[] {
  return frame === doc.frame ? doc.markers : doc.corrections?.find((c) => c.frame === frame)?.markers ?? [];
}

/** Frames with labels, in order. */
export function labelledFrames(doc: LabelDoc): number[] {
  const first = doc.markers.some((m) => Object.keys(m.views).length > 0) ? [doc.frame] : [];
  return [...first, ...(doc.corrections ?? []).map((c) => c.frame)].sort((a, b) => a - b);
}

/** Numbers of all markers, whatever frame they begin in. */
export function markersOf(doc: LabelDoc): number[] {
  const all = [doc.markers, ...(doc.corrections ?? []).map((c) => c.markers)].flat();
  return [...new Set(all.map((m) => m.id))].sort((a, b) => a - b);
}

/** Markers of a frame that are labelled in two views or more. */
export function usableAt(doc: LabelDoc, frame: number): number {
  return labelsAt(doc, frame).filter((m) => Object.keys(m.views).length >= 2).length;
}

/** The frame from which tracks begin: the first of the take that has enough. */
export function baseOf(doc: LabelDoc, [start, end]: [number, number]): number | null {
  return labelledFrames(doc).find((frame) => frame >= start && frame < end && usableAt(doc, frame) >= NEEDED) ?? null;
}

/** Frames in which a marker is labelled. */
export function framesOf(doc: LabelDoc, id: number): number[] {
  return labelledFrames(doc).filter((frame) => labelsAt(doc, frame).some((m) => m.id === id && Object.keys(m.views).length > 0));
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

/** Takes a marker out of a frame; out of the frame in which it begins, out of all. */
export function removeMarker(doc: LabelDoc, frame: number, id: number): void {
  const begins = framesOf(doc, id)[0];
  const everywhere = begins === undefined || begins === frame;
  const others = (markers: Marker[]) => markers.filter((m) => m.id !== id);
  if (everywhere) doc.markers = others(doc.markers);
  else if (frame === doc.frame) doc.markers = doc.markers.map((m) => (m.id === id ? { id, views: {} } : m));
  doc.corrections = doc.corrections?.map((c) => (everywhere || c.frame === frame ? { ...c, markers: others(c.markers) } : c));
  tidy(doc);
}

/** Corrections without a point are none. A marker of the file's first list keeps its number until it is removed. */
function tidy(doc: LabelDoc): void {
  const kept = (m: Marker) => Object.keys(m.views).length > 0;
  doc.corrections = (doc.corrections ?? []).map((c) => ({ ...c, markers: c.markers.filter(kept) })).filter((c) => c.markers.length > 0);
}
