// The page: what is shown follows from the look, the tools' documents, and what has arrived of the footage.

import { Lost } from '../api.ts';
import type { Api } from '../api.ts';
import { askToken } from '../cover.ts';
import { byId, el } from '../dom.ts';
import { Notices } from '../notices.ts';
import { actions } from './actions.ts';
import { Bench } from './bench.ts';
import { epipolar, lookedAt } from './camera.ts';
import type { P2, P3, WorkView } from './camera.ts';
import { History } from './history.ts';
import type { Past, Step } from './history.ts';
import { Images } from './images.ts';
import { Keys } from './keys.ts';
import { Markers } from './markers.ts';
import { Masks } from './masks.ts';
import type { Memory } from './memory.ts';
import { Sketches } from './sketch.ts';
import { TOOLS, clampFrame, fromHash, toHash } from './state.ts';
import type { Look, ToolName } from './state.ts';
import { Strip } from './strip.ts';
import { Timeline } from './timeline.ts';
import { line } from './marks.ts';
import { within } from './tool.ts';
import type { Part, Room, Spot, Tool } from './tool.ts';
import { Saver } from './wire.ts';
import type { Work } from './wire.ts';

/** Width of the small views' images [px]. */
const SMALL = 320;
const REMEMBER_MS = 250;
/** How long it is said what was undone. */
const TOLD_MS = 4000;
/** Coming back sooner than that, nothing is asked anew. */
const REFRESH_MS = 3000;

const describe = ({ what, look }: Step) => `${what}, ${look.view}, frame ${look.frame}`;

export class App implements Room {
  readonly views: WorkView[];
  readonly centre: P3;
  readonly history: History;
  readonly saver: Saver;
  readonly tools: Record<ToolName, Tool>;
  readonly markers: Markers;
  readonly bench: Bench;
  look: Look;
  private readonly notices = new Notices();
  private readonly images: Images;
  private readonly strip: Strip;
  private readonly timeline: Timeline;
  /** Where the pointer or the keyboard points in the large view. */
  private cursor: P2 | null = null;
  /** The cursor was moved by keys: it is shown. */
  private byKeys = false;
  private penIsDown = false;
  private due = 0;
  private rememberDue = 0;
  /** Counted, so that what is as it was is not drawn again. */
  private readonly changes = { all: 0, view: 0, drawn: -1 };
  private isAlive = true;
  /** What was undone or redone last, for a moment. */
  private told = { text: '', at: 0 };
  private toldDue = 0;
  private refreshed = 0;

  constructor(readonly api: Api, readonly work: Work, private readonly memory: Memory | null, past: Past | null) {
    this.views = work.views;
    this.centre = lookedAt(work.views);
    this.look = fromHash(location.hash, work);
    this.history = new History({ open: (step) => this.goTo(step), restore: (step, side) => this.tool.restore(step, side) }, past, memory);
    this.history.onDropped = () => this.say('Something else changed what you had labelled or painted here.', 'What you did to it before cannot be undone any more.');
    this.saver = new Saver(api, this.history, () => this.redraw(), (error) => this.error(error), () => this.renew());
    this.images = new Images(api, () => this.redraw());
    this.markers = new Markers(this);
    this.tools = { markers: this.markers, hair: new Masks(this, 'hair'), subject: new Masks(this, 'subject'), strands: new Sketches(this) };
    this.bench = new Bench({
      look: () => this.look,
      view: () => this.view(this.look.view),
      zoom: (zoom) => this.set({ zoom }),
      down: (spot, event) => this.down(spot, event),
      move: (spot) => this.tool.move(spot),
      up: () => this.tool.up(),
      hover: (spot) => { this.byKeys = false; this.cursor = spot?.at ?? null; this.redraw('cursor'); },
    });
    this.strip = new Strip(this.views, (view) => this.set({ view, sheet: false }), (spot) => this.actIn(spot));
    this.timeline = new Timeline(work, (frame) => this.go(frame));
    this.furnish();
    new Keys(actions(this));
    addEventListener('pagehide', () => this.rememberNow());
    addEventListener('focus', () => this.comeBack());
    addEventListener('resize', () => { this.strip.layout(); this.redraw(); });
    this.arrive();
  }

  private furnish(): void {
    byId('name').textContent = this.work.name;
    document.title = `${this.work.name} · strandflow annotate`;
    for (const button of byId('tools').querySelectorAll('button')) {
      button.addEventListener('click', () => this.set({ tool: button.dataset.value as ToolName }));
    }
    byId('undo').addEventListener('click', () => this.undo());
    byId('redo').addEventListener('click', () => this.redo());
    byId('keys').addEventListener('click', () => byId<HTMLDialogElement>('help').showModal());
    byId('all-views').addEventListener('click', () => this.set({ sheet: !this.look.sheet }));
    for (const note of this.work.notes) this.say(note.fact, note.hint);
  }

  // ---- the room of the tools

  get tool(): Tool {
    return this.tools[this.look.tool];
  }

  view(name: string): WorkView {
    return this.views.find((view) => view.name === name) ?? this.views[0];
  }

  say(text: string, hint = ''): void {
    this.notices.say(text, hint);
  }

  error(error: Error): void {
    if (!(error instanceof Lost)) this.notices.error(error);
  }

  set(change: Partial<Look>): void {
    const before = this.look;
    // A stroke belongs to the frame, the view and the tool in which it began: it ends there.
    if ((['frame', 'view', 'tool', 'sheet'] as const).some((key) => key in change && change[key] !== before[key])) {
      this.penIsDown = false;
      this.tool.up();
    }
    this.look = { ...before, ...change };
    // A view that is as it was seen last time would not be where the hand is.
    if (change.view !== undefined && change.view !== before.view) {
      this.look.zoom = change.zoom ?? this.follow(before);
      this.cursor = null;
    }
    if (['frame', 'tool', 'view', 'sheet'].some((key) => before[key as keyof Look] !== this.look[key as keyof Look])) this.arrive();
    this.remember();
    // Zooming changes the large view alone.
    this.redraw(Object.keys(change).join() === 'zoom' ? 'cursor' : 'all');
  }

  /** Keeps the look in the address. Browsers bear a few such changes a second, not one a movement. */
  private remember(): void {
    if (this.rememberDue === 0) this.rememberDue = window.setTimeout(() => this.rememberNow(), REMEMBER_MS);
  }

  private rememberNow(): void {
    clearTimeout(this.rememberDue);
    this.rememberDue = 0;
    history.replaceState(null, '', `#${toHash(this.look)}`);
  }

  /** A zoomed view hands its zoom on to the next, around what is selected. */
  private follow(before: Look): Look['zoom'] {
    const at = before.zoom && this.tool.focus(this.view(this.look.view));
    return at ? { at, times: before.zoom!.times } : null;
  }

  private arrive(): void {
    const { frame, view, sheet } = this.look;
    document.body.classList.toggle('sheet', sheet);
    this.strip.layout();
    this.tool.enter();
    const small = this.views.map((v) => Images.path(v.name, frame, SMALL));
    const ahead = [frame + 1, frame - 1].filter((f) => f === clampFrame(this.work, f)).map((f) => Images.path(view, f, null));
    this.images.want([Images.path(view, frame, null), ...small, ...ahead]);
  }

  go(frame: number): void {
    this.set({ frame: clampFrame(this.work, frame) });
  }

  // ---- undo

  undo(): void {
    void this.history.undo().then((step) => this.tell('Undone', step));
  }

  redo(): void {
    void this.history.redo().then((step) => this.tell('Done again', step));
  }

  /** Goes to where a step happened; whether its document is there. */
  private async goTo(step: Step): Promise<boolean> {
    this.set({ ...step.look, view: this.view(step.look.view ?? this.look.view).name });
    const isThere = await this.tool.ready();
    if (!isThere) this.say('This cannot be undone now: what it changed could not be read.');
    return isThere;
  }

  private tell(done: string, step: Step | null): void {
    clearTimeout(this.toldDue);
    this.told = { text: step ? `${done}: ${describe(step)}` : '', at: this.history.made };
    this.toldDue = window.setTimeout(() => { this.told.text = ''; this.redraw(); }, TOLD_MS);
    this.redraw();
  }

  /** A run may have been made while the person was elsewhere. */
  private comeBack(): void {
    if (Date.now() - this.refreshed < REFRESH_MS) return;
    this.refreshed = Date.now();
    for (const tool of Object.values(this.tools)) tool.refresh();
  }

  // ---- hands

  /** Works in a small view where it was clicked. */
  private actIn(spot: Spot): void {
    if (this.tool === this.markers) this.markers.act({ ...spot, at: within(spot.view, spot.at) });
    else this.set({ view: spot.view.name, sheet: false });
  }

  private down(spot: Spot, event: PointerEvent): void {
    // Shift chooses what is there instead of drawing over it.
    if (event.shiftKey && this.tool instanceof Sketches) this.tool.choose(spot);
    else this.tool.down(spot);
  }

  /** Moves the cursor by pixels of the screen; with the pen down it paints or draws. */
  nudge(x: number, y: number): void {
    const view = this.view(this.look.view);
    const px = this.bench.px;
    const from = this.cursor ?? this.tool.focus(view) ?? this.look.zoom?.at ?? [view.width / 2, view.height / 2];
    this.cursor = within(view, [from[0] + x * px, from[1] + y * px]);
    this.byKeys = true;
    if (this.penIsDown) this.tool.move(this.spot());
    this.redraw('cursor');
  }

  spot(): Spot {
    const view = this.view(this.look.view);
    return { view, at: this.cursor ?? this.look.zoom?.at ?? [view.width / 2, view.height / 2], px: this.bench.px };
  }

  act(): void {
    this.tool.act(this.spot());
  }

  pen(): void {
    this.penIsDown = !this.penIsDown;
    if (this.penIsDown) this.tool.down(this.spot());
    else this.tool.up();
    this.redraw();
  }

  letGo(): void {
    if (this.penIsDown) this.pen();
    this.set({ marker: null, strand: null });
  }

  brush(by: number): void {
    const now = Math.round(this.look.brush * (by > 0 ? 1.25 : 0.8) + 0.5 * by);
    this.set({ brush: Math.min(200, Math.max(1, now)) });
  }

  fill(): void {
    if (this.tool instanceof Masks) this.tool.fill(this.spot());
  }

  stepView(by: number): void {
    const at = this.views.findIndex((view) => view.name === this.look.view);
    this.set({ view: this.views[(at + by + this.views.length) % this.views.length].name });
  }

  /** The next frame, in a direction, with something of this tool. */
  stepKept(by: number): void {
    const frames = this.tool.frames().filter((f) => (f - this.look.frame) * by > 0);
    if (frames.length) this.go(by > 0 ? Math.min(...frames) : Math.max(...frames));
  }

  // ---- looks

  redraw(what: Part = 'all'): void {
    if (what === 'all') this.changes.all += 1;
    if (what === 'view') this.changes.view += 1;
    if (this.due === 0) this.due = requestAnimationFrame(() => { this.due = 0; this.draw(); });
  }

  private draw(): void {
    const { look, tool } = this;
    if (this.changes.drawn !== this.changes.all) {
      this.bars();
      byId('panel').replaceChildren(el('section', {}, ...tool.panel().filter((node): node is Node => node !== false)));
    }
    this.changes.drawn = this.changes.all;
    const view = this.view(look.view);
    const path = Images.path(view.name, look.frame, null);
    const image = this.images.get(path) ?? this.images.get(Images.path(view.name, look.frame, SMALL));
    byId('missing').textContent = image ? '' : this.images.why(path) ?? 'Loading …';
    if (!look.sheet) this.bench.draw(image, (ink, px) => { if (look.overlay) tool.draw(ink, view, px, true); this.drawCursor(ink, px); });
    const isGuided = look.tool === 'markers' || look.tool === 'strands';
    this.strip.draw((small) => ({
      image: this.images.get(Images.path(small.name, look.frame, SMALL)),
      focus: look.close ? tool.focus(small) : null,
      caption: tool.caption(small),
      tone: tool.tone(small),
      isCurrent: small === view,
      change: `${this.changes.all} ${small === view ? this.changes.view : ''}`,
      draw: (ink, px) => { if (look.overlay) tool.draw(ink, small, px, false); },
      guide: isGuided && this.cursor && small !== view ? epipolar(view, this.cursor, small, this.centre) : [],
    }));
  }

  private drawCursor(ink: CanvasRenderingContext2D, px: number): void {
    if (!this.cursor) return;
    const [x, y] = this.cursor;
    if (this.tool instanceof Masks) {
      for (const [colour, width] of [['rgb(0 0 0 / 60%)', 2.5], [this.look.erase ? '#ff9aa8' : '#fff', 1.2]] as const) {
        ink.beginPath();
        ink.arc(x, y, this.look.brush, 0, 2 * Math.PI);
        ink.strokeStyle = colour;
        ink.lineWidth = width * px;
        ink.stroke();
      }
    }
    if (this.byKeys) {
      for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
        line(ink, [[x + 3 * dx * px, y + 3 * dy * px], [x + 13 * dx * px, y + 13 * dy * px]], '#fff', 1.4 * px);
      }
    }
  }

  private bars(): void {
    const { look } = this;
    for (const button of byId('tools').querySelectorAll('button')) button.setAttribute('aria-pressed', String(button.dataset.value === look.tool));
    const [done, undone] = this.history.depth;
    const ends = this.history.ends;
    for (const [i, [name, count, keys]] of ([['undo', done, 'Ctrl Z, u'], ['redo', undone, 'Ctrl Y, Shift u']] as const).entries()) {
      const [button, step] = [byId<HTMLButtonElement>(name), ends[i]];
      button.disabled = count === 0;
      button.title = step ? `${describe(step)} (${keys})` : keys;
    }
    byId('all-views').setAttribute('aria-pressed', String(look.sheet));
    const { waiting, trouble } = this.saver;
    const saved = byId('saved');
    saved.dataset.state = trouble ? 'trouble' : waiting ? 'busy' : 'saved';
    saved.textContent = trouble ? `Not saved: ${trouble}` : waiting ? 'Saving …' : 'All saved';
    // After the next stroke it is old news.
    const told = this.told.at === this.history.made ? this.told.text : '';
    byId('where').textContent = `${look.view}${this.penIsDown ? ' · pen down' : ''}${look.overlay ? '' : ' · overlays hidden'}${told ? ` · ${told}` : ''}`;
    this.timeline.show(look.frame, this.tool.frames());
  }

  // ---- the program

  alive(alive: boolean): void {
    if (alive === this.isAlive) return;
    this.isAlive = alive;
    const lost = 'The program does not answer.';
    if (alive) {
      this.notices.take(lost);
      this.images.forgetMissing();
    } else this.notices.say(lost, 'What you draw waits here and is saved when it is back. Start `strandflow annotate` again; it asks for the new address then.', true);
  }

  /** The program was started anew, with another token: what waits is sent with that. */
  private renew(): void {
    const dialog = byId<HTMLDialogElement>('renew');
    if (dialog.open) return;
    dialog.replaceChildren(el('h2', {}, 'The program was started anew'), el('p', {}, 'Paste the address that it printed; nothing you drew is lost.'), askToken((token) => {
      this.api.renew(token);
      sessionStorage.setItem(`strandflow ${location.host}`, token);
      dialog.close();
      this.images.forgetMissing();
      this.saver.again();
      this.tool.enter();
    }));
    dialog.showModal();
  }

  // ---- for whoever drives the page

  place(at: P2): P2 {
    return this.bench.place(at);
  }

  get atRest(): boolean {
    return (this.memory?.atRest ?? true) && this.images.atRest && this.tool.atRest && this.saver.waiting === 0 && this.due === 0 && this.rememberDue === 0;
  }

  async settled(): Promise<void> {
    while (!this.atRest) await new Promise((wait) => setTimeout(wait, 20));
  }

  counters(): Record<string, unknown> {
    return {
      ...this.look, atRest: this.atRest, saved: this.saver.saved, waiting: this.saver.waiting, trouble: this.saver.trouble,
      history: this.history.depth, cursor: this.cursor, notices: this.notices.said, tools: TOOLS, ...this.tool.counters(),
    };
  }
}

