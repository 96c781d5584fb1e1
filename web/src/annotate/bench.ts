// The large view: zoomed by the wheel, moved with the right button, worked on with the left one.

import { byId } from '../dom.ts';
import type { P2, WorkView } from './camera.ts';
import type { Look } from './state.ts';
import type { Spot } from './tool.ts';

const MOST_TIMES = 64;

interface Hands {
  look: () => Look;
  view: () => WorkView;
  zoom: (zoom: Look['zoom']) => void;
  down: (spot: Spot, event: PointerEvent) => void;
  move: (spot: Spot) => void;
  up: () => void;
  /** The pointer is over the view, or has left it. */
  hover: (spot: Spot | null) => void;
}

export class Bench {
  readonly canvas = byId<HTMLCanvasElement>('bench');
  private works = false;
  private pan: { from: P2; at: P2 } | null = null;
  private spaceIsDown = false;

  constructor(private readonly hands: Hands) {
    const { canvas } = this;
    canvas.addEventListener('contextmenu', (event) => event.preventDefault());
    canvas.addEventListener('pointerdown', (event) => {
      canvas.setPointerCapture(event.pointerId);
      const spot = this.spot(event);
      if (event.button === 0 && !this.spaceIsDown) {
        this.works = true;
        hands.down(spot, event);
      } else this.pan = { from: [event.clientX, event.clientY], at: this.frame().at };
    });
    canvas.addEventListener('pointermove', (event) => {
      if (this.pan) {
        const { scale, times } = this.frame();
        const [dx, dy] = [event.clientX - this.pan.from[0], event.clientY - this.pan.from[1]];
        hands.zoom({ at: [this.pan.at[0] - dx / scale, this.pan.at[1] - dy / scale], times });
        return;
      }
      // What the browser gathered since the last event: a quick stroke keeps its corners.
      if (this.works) for (const each of event.getCoalescedEvents?.() ?? [event]) hands.move(this.spot(each));
      hands.hover(this.spot(event));
    });
    const up = () => {
      if (this.works) hands.up();
      this.works = false;
      this.pan = null;
    };
    canvas.addEventListener('pointerup', up);
    canvas.addEventListener('pointercancel', up);
    canvas.addEventListener('pointerleave', () => { if (!this.works) hands.hover(null); });
    canvas.addEventListener('wheel', (event) => {
      event.preventDefault();
      this.zoomBy(Math.exp(-event.deltaY * 0.0015), this.spot(event).at);
    }, { passive: false });
    addEventListener('keydown', (event) => { if (event.key === ' ') this.spaceIsDown = true; });
    addEventListener('keyup', (event) => { if (event.key === ' ') this.spaceIsDown = false; });
  }

  /** Screen pixels an image pixel, the image point in the middle, and times the fitted size. */
  private frame(): { scale: number; at: P2; times: number } {
    const { canvas } = this;
    const view = this.hands.view();
    const fit = Math.min(canvas.clientWidth / view.width, canvas.clientHeight / view.height) || 1;
    const { zoom } = this.hands.look();
    return zoom ? { scale: fit * zoom.times, at: zoom.at, times: zoom.times } : { scale: fit, at: [view.width / 2, view.height / 2], times: 1 };
  }

  private spot(event: MouseEvent): Spot {
    const box = this.canvas.getBoundingClientRect();
    const { scale, at } = this.frame();
    const x = at[0] + (event.clientX - box.left - box.width / 2) / scale;
    const y = at[1] + (event.clientY - box.top - box.height / 2) / scale;
    return { view: this.hands.view(), at: [x, y], px: 1 / scale };
  }

  /** Image pixels a pixel of the screen. */
  get px(): number {
    return 1 / this.frame().scale;
  }

  /** Where an image point is on the page. */
  place([x, y]: P2): P2 {
    const box = this.canvas.getBoundingClientRect();
    const { scale, at } = this.frame();
    return [box.left + box.width / 2 + (x - at[0]) * scale, box.top + box.height / 2 + (y - at[1]) * scale];
  }

  /** Zooms; the image point `about` stays where it is. */
  zoomBy(factor: number, about?: P2): void {
    const { at, times } = this.frame();
    const now = Math.min(MOST_TIMES, times * factor);
    if (now <= 1) return this.hands.zoom(null);
    const to = about ?? at;
    const share = times / now;
    this.hands.zoom({ at: [to[0] + (at[0] - to[0]) * share, to[1] + (at[1] - to[1]) * share], times: now });
  }

  centre(at: P2): void {
    this.hands.zoom({ at, times: Math.max(4, this.frame().times) });
  }

  draw(image: ImageBitmap | undefined, more: (ink: CanvasRenderingContext2D, px: number) => void): void {
    const { canvas } = this;
    const ratio = Math.min(2, devicePixelRatio);
    const [width, height] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
    if (width === 0 || height === 0) return;
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    const ink = canvas.getContext('2d')!;
    const { scale, at } = this.frame();
    const view = this.hands.view();
    ink.setTransform(1, 0, 0, 1, 0, 0);
    ink.clearRect(0, 0, width, height);
    ink.setTransform(scale * ratio, 0, 0, scale * ratio, width / 2 - at[0] * scale * ratio, height / 2 - at[1] * scale * ratio);
    // Pixels are squares as soon as they can be told apart.
    ink.imageSmoothingEnabled = scale < 3;
    if (image) ink.drawImage(image, 0, 0, view.width, view.height);
    ink.save();
    ink.beginPath();
    ink.rect(0, 0, view.width, view.height);
    ink.clip();
    more(ink, 1 / scale);
    ink.restore();
  }
}
