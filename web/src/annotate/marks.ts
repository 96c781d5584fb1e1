// What is drawn over footage: seen on light and on dark ground.

import { el } from '../dom.ts';
import type { P2 } from './camera.ts';

/** Colours of things with numbers: neighbours differ. */
export function colourOf(id: number, strength = 1): string {
  return `hsl(${(id * 137.5 + 20) % 360} ${85 * strength}% 62%)`;
}

/** A line that is seen on light and on dark ground. */
export function line(ink: CanvasRenderingContext2D, points: P2[], colour: string, width: number, dash: number[] = []): void {
  if (points.length < 2) return;
  ink.beginPath();
  points.forEach(([x, y], i) => (i === 0 ? ink.moveTo(x, y) : ink.lineTo(x, y)));
  ink.lineJoin = ink.lineCap = 'round';
  ink.setLineDash([]);
  ink.strokeStyle = 'rgb(0 0 0 / 45%)';
  ink.lineWidth = width * 1.8;
  if (dash.length === 0) ink.stroke();
  ink.setLineDash(dash);
  ink.strokeStyle = colour;
  ink.lineWidth = width;
  ink.stroke();
  ink.setLineDash([]);
}

/** A square of a colour: styles of elements are set here, the page's policy allows none in markup. */
export function swatch(colour: string): HTMLElement {
  const node = el('i', { className: 'swatch' });
  node.style.background = colour;
  return node;
}

export function ring(ink: CanvasRenderingContext2D, [x, y]: P2, radius: number, colour: string, width: number, dash: number[] = []): void {
  ink.beginPath();
  ink.arc(x, y, radius, 0, 2 * Math.PI);
  ink.setLineDash(dash);
  ink.strokeStyle = 'rgb(0 0 0 / 60%)';
  ink.lineWidth = width * 2;
  ink.stroke();
  ink.strokeStyle = colour;
  ink.lineWidth = width;
  ink.stroke();
  ink.setLineDash([]);
}

export function cross(ink: CanvasRenderingContext2D, [x, y]: P2, half: number, colour: string, width: number): void {
  line(ink, [[x - half, y], [x + half, y]], colour, width);
  line(ink, [[x, y - half], [x, y + half]], colour, width);
}

export function name(ink: CanvasRenderingContext2D, text: string, [x, y]: P2, size: number, colour: string, bold: boolean): void {
  ink.font = `${bold ? 700 : 500} ${size}px system-ui, sans-serif`;
  ink.lineWidth = size / 4;
  ink.lineJoin = 'round';
  ink.strokeStyle = 'rgb(0 0 0 / 70%)';
  ink.strokeText(text, x, y);
  ink.fillStyle = colour;
  ink.fillText(text, x, y);
}
