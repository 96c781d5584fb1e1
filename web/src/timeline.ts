// The bar at the bottom: play, frame, speed, and what has arrived.

import { byId, el } from './dom.ts';
import type { Take } from './protocol.ts';
import type { State, Store } from './state.ts';

const RATES = [0.05, 0.1, 0.25, 0.5, 1, 2];

export const ICONS = {
  play: 'M7 4.5v15l12-7.5z',
  pause: 'M6 4.5h4v15H6zM14 4.5h4v15h-4z',
};

export class Timeline {
  private readonly play = byId<HTMLButtonElement>('play');
  private readonly bar = byId<HTMLInputElement>('frame');
  private readonly count = byId<HTMLOutputElement>('count');
  private readonly clock = byId<HTMLElement>('clock');
  private readonly have = byId<HTMLCanvasElement>('have');
  private readonly rate = byId<HTMLSelectElement>('rate');
  private readonly loop = byId<HTMLInputElement>('loop');
  private drawn = '';

  constructor(private readonly take: Take, store: Store, go: (frame: number) => void) {
    const [lo, hi] = take.frames;
    this.bar.min = String(lo);
    this.bar.max = String(hi - 1);
    this.bar.addEventListener('input', () => go(Number(this.bar.value)));
    byId('first').addEventListener('click', () => go(lo));
    byId('back').addEventListener('click', () => go(store.state.frame - 1));
    byId('forth').addEventListener('click', () => go(store.state.frame + 1));
    this.play.addEventListener('click', () => store.set({ playing: !store.state.playing }));
    this.rate.append(...RATES.map((r) => el('option', { value: String(r) }, `${r}× · ${+(take.fps * r).toFixed(1)} fps`)));
    this.rate.addEventListener('change', () => store.set({ rate: Number(this.rate.value) }));
    this.loop.addEventListener('change', () => store.set({ loop: this.loop.checked }));
  }

  show(state: State): void {
    const { frames: [lo, hi], fps } = this.take;
    if (this.bar.value !== String(state.frame)) this.bar.value = String(state.frame);
    this.bar.setAttribute('aria-valuetext', `frame ${state.frame} of ${lo} to ${hi - 1}`);
    this.count.value = `${state.frame}`;
    this.clock.textContent = `of ${lo}–${hi - 1} · ${((state.frame - lo) / fps).toFixed(3)} s`;
    this.play.setAttribute('aria-label', state.playing ? 'Pause' : 'Play');
    this.play.querySelector('path')!.setAttribute('d', state.playing ? ICONS.pause : ICONS.play);
    this.rate.value = String(state.rate);
    this.loop.checked = state.loop;
  }

  /** `at`: 0 no such frame in the store, 1 not here, 2 here in coarse, 3 here with all detail. */
  buffered(at: (frame: number) => number, inks: string[]): void {
    const { frames: [lo, hi] } = this.take;
    const width = Math.round(this.have.clientWidth * devicePixelRatio);
    if (width === 0) return;
    const kinds = Array.from({ length: hi - lo }, (_, i) => at(lo + i));
    const drawn = `${width} ${inks.join()} ${kinds.join('')}`;
    if (drawn === this.drawn) return;
    this.drawn = drawn;
    if (this.have.width !== width) this.have.width = width;
    this.have.height = 4;
    const ink = this.have.getContext('2d')!;
    // The knob's middle runs from half a knob inside to half a knob inside.
    const [inset, span] = [8 * devicePixelRatio, width - 16 * devicePixelRatio];
    const wide = span / Math.max(1, hi - 1 - lo);
    for (let frame = lo; frame < hi; frame++) {
      ink.fillStyle = inks[kinds[frame - lo]];
      // Whole pixels: else the ground shines through between one frame and the next.
      const [from, to] = [-0.5, 0.5].map((off) => Math.round(inset + Math.min(span, Math.max(0, (frame - lo + off) * wide))));
      ink.fillRect(from, 0, to - from, 4);
    }
  }
}
