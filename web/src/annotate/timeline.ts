// The bar at the bottom: the frame, and which frames have something of the tool.

import { byId } from '../dom.ts';
import type { Work } from './wire.ts';

export class Timeline {
  private readonly bar = byId<HTMLInputElement>('frame');
  private readonly ticks = byId<HTMLCanvasElement>('ticks');

  constructor(private readonly work: Work, go: (frame: number) => void) {
    const [lo, hi] = work.frames;
    this.bar.min = String(lo);
    this.bar.max = String(hi - 1);
    this.bar.addEventListener('input', () => go(Number(this.bar.value)));
    byId('back').addEventListener('click', () => go(Number(this.bar.value) - 1));
    byId('forth').addEventListener('click', () => go(Number(this.bar.value) + 1));
  }

  show(frame: number, kept: number[]): void {
    const { frames: [lo, hi], fps } = this.work;
    if (this.bar.value !== String(frame)) this.bar.value = String(frame);
    this.bar.setAttribute('aria-valuetext', `frame ${frame} of ${lo} to ${hi - 1}`);
    byId<HTMLOutputElement>('count').value = String(frame);
    byId('clock').textContent = `of ${lo}–${hi - 1} · ${((frame - lo) / fps).toFixed(3)} s`;
    const width = Math.round(this.ticks.clientWidth * devicePixelRatio);
    if (width === 0) return;
    if (this.ticks.width !== width) this.ticks.width = width;
    this.ticks.height = 6 * devicePixelRatio;
    const ink = this.ticks.getContext('2d')!;
    // The knob's middle runs from half a knob inside to half a knob inside.
    const [inset, span] = [8 * devicePixelRatio, width - 16 * devicePixelRatio];
    ink.fillStyle = getComputedStyle(this.ticks).color;
    for (const f of kept) {
      const x = inset + (span * (f - lo)) / Math.max(1, hi - 1 - lo);
      ink.fillRect(Math.round(x - devicePixelRatio), 0, 2 * devicePixelRatio, this.ticks.height);
    }
  }
}
