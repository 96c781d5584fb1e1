// The controls: they show the state and change it. What cannot be chosen says why.

import { categoryColour, css, number, words } from './colour.ts';
import type { Scale } from './colour.ts';
import { byId, el } from './dom.ts';
import { plot } from './plots.ts';
import type { Plot } from './plots.ts';
import type { StrandDetails, Take } from './protocol.ts';
import { setOf } from './wants.ts';
import type { Layer, State, Store } from './state.ts';

/** `mode`: the one in which the layer is shown; absent: in both. */
const LAYER_ROWS: { layer: Layer; title: string; mode?: State['mode']; needs?: string }[] = [
  { layer: 'strands', title: 'Strands' },
  { layer: 'head', title: 'Head', mode: 'space', needs: 'head' },
  { layer: 'cameras', title: 'Cameras', mode: 'space' },
  { layer: 'images', title: 'Footage in the cameras', mode: 'space', needs: 'footage' },
  { layer: 'hull', title: 'Visual hull', mode: 'space', needs: 'hull' },
  { layer: 'lines', title: 'Lifted lines', mode: 'space', needs: 'lines' },
  { layer: 'arrows', title: 'Velocities', mode: 'space', needs: 'arrows' },
  { layer: 'roots', title: 'Roots', mode: 'space' },
  { layer: 'floor', title: 'Floor, axes, gravity', mode: 'space' },
  { layer: 'footage', title: 'Footage', mode: 'footage', needs: 'footage' },
  { layer: 'masks', title: 'Masks', mode: 'footage', needs: 'masks' },
  { layer: 'orientation', title: 'Orientations', mode: 'footage', needs: 'orientation' },
];

const WHY: Record<string, string> = {
  head: 'no scalp yet',
  hull: 'no hull yet',
  lines: 'not lifted yet',
  arrows: 'no velocities yet',
  masks: 'no masks yet',
  orientation: 'not computed yet',
  footage: 'no footage at hand',
};

/** A group of buttons of which one is pressed. */
function choice(id: string, pick: (value: string) => void): (value: string) => void {
  const buttons = [...byId(id).querySelectorAll('button')];
  for (const button of buttons) button.addEventListener('click', () => pick(button.dataset.value!));
  return (value) => {
    for (const button of buttons) button.setAttribute('aria-pressed', String(button.dataset.value === value));
  };
}

/** The set that `c` compares with: the one before, or the one after where there is none. */
export function comparison(take: Take, id: string): string {
  const usable = take.sets.filter((set) => set.done.length > 0);
  const at = usable.findIndex((set) => set.id === id);
  return (usable.find((set) => set.id === 'truth' && set.id !== id) ?? usable[at - 1] ?? usable[at + 1])?.id ?? '';
}

export interface Deeds {
  home: () => void;
  through: (view: string) => void;
  isolate: (on: boolean) => void;
  go: (frame: number) => void;
}

export class Panels {
  private readonly setButtons = new Map<string, HTMLButtonElement>();
  private readonly boxes = new Map<Layer, HTMLInputElement>();
  private readonly by = byId<HTMLSelectElement>('by');
  private readonly other = byId<HTMLSelectElement>('other');
  private readonly mode: (value: string) => void;
  private readonly layout: (value: string) => void;

  constructor(private readonly take: Take, private readonly store: Store, deeds: Deeds) {
    byId('name').textContent = take.name;
    document.title = `${take.name} · strandflow view`;
    this.mode = choice('mode', (value) => store.set({ mode: value as State['mode'] }));
    this.layout = choice('layout', (value) => store.set({ layout: value as State['layout'] }));
    this.sets();
    this.colours();
    this.layerRows();
    this.slides(deeds);
    byId('stages').append(
      ...take.stages.map((stage) => el('li', { 'data-state': stage.state, title: stage.state }, stage.name, el('span', {}, stage.detail || stage.state))),
    );
  }

  private sets(): void {
    const { take, store } = this;
    for (const [i, set] of take.sets.entries()) {
      const empty = set.done.length === 0;
      const key = i < 9 ? ` (${i + 1})` : '';
      const button = el('button', {
        type: 'button',
        disabled: empty,
        title: empty ? `${words(set.title)}: no frames yet` : `${words(set.title)}: ${set.strands.toLocaleString('en')} strands, ${set.done.length} frames${key}`,
        onclick: () => store.set({ set: set.id, other: store.state.other === set.id ? '' : store.state.other }),
      }, set.id.replace(/^animate\//, ''));
      this.setButtons.set(set.id, button);
      byId('sets').append(button);
    }
    this.other.append(
      el('option', { value: '' }, 'nothing'),
      ...take.sets.map((set) => el('option', { value: set.id, disabled: set.done.length === 0 }, set.id)),
    );
    this.other.addEventListener('change', () => store.set({ other: this.other.value }));
  }

  private colours(): void {
    const { take, store } = this;
    this.by.append(
      el('option', { value: 'hair' }, 'Hair'),
      el('option', { value: 'strand' }, 'Strand number'),
      el('option', { value: 'root' }, 'Root direction'),
      ...take.attributes.map((a) => el('option', { value: a.name, title: a.title ?? '' }, a.unit ? `${words(a.name)} (${a.unit})` : words(a.name))),
    );
    this.by.addEventListener('change', () => store.set({ by: this.by.value, range: null }));
    const [lo, hi] = [byId<HTMLInputElement>('range-lo'), byId<HTMLInputElement>('range-hi')];
    const given = () => {
      const [a, b] = [Number(lo.value), Number(hi.value)];
      if (lo.value !== '' && hi.value !== '' && b > a) store.set({ range: [a, b] });
    };
    lo.addEventListener('change', given);
    hi.addEventListener('change', given);
    byId('range-reset').addEventListener('click', () => store.set({ range: null }));
  }

  private layerRows(): void {
    const { take, store } = this;
    const footage = take.views.some((view) => view.footage);
    for (const row of LAYER_ROWS) {
      const can = !row.needs || (row.needs === 'footage' ? footage : take.layers[row.needs] === true);
      const box = el('input', {
        type: 'checkbox',
        disabled: !can,
        onchange: () => store.set({ layers: { ...store.state.layers, [row.layer]: box.checked } }),
      });
      this.boxes.set(row.layer, box);
      const label = el('label', { className: can ? 'check' : 'check off', 'data-mode': row.mode ?? '' }, box, row.title, !can && el('span', { className: 'why' }, WHY[row.needs!]));
      byId('layers').append(label);
    }
  }

  private slides(deeds: Deeds): void {
    const { take, store } = this;
    const bind = (id: string, read: (input: HTMLInputElement) => Partial<State>) => {
      const input = byId<HTMLInputElement>(id);
      input.addEventListener('input', () => store.set(read(input)));
    };
    bind('opacity', (input) => ({ opacity: Number(input.value) }));
    bind('width', (input) => ({ width: Number(input.value) }));
    bind('detail', (input) => ({ detail: input.value as State['detail'] }));
    bind('follow', (input) => ({ follow: input.checked }));
    byId('home').addEventListener('click', deeds.home);
    const through = byId<HTMLSelectElement>('through');
    through.append(el('option', { value: '' }, 'Look through …'), ...take.views.map((view) => el('option', { value: view.name }, view.name)));
    through.addEventListener('change', () => {
      if (through.value) deeds.through(through.value);
      through.value = '';
    });
    byId('fold').addEventListener('click', () => this.fold());
    byId('keys').addEventListener('click', () => byId<HTMLDialogElement>('help').showModal());
    byId('sheet').addEventListener('click', () => store.set({ view: '' }));
    byId('share').addEventListener('click', async () => {
      const button = byId('share');
      const done = await navigator.clipboard.writeText(location.href).then(() => true, () => false);
      button.textContent = done ? 'Copied' : 'Copy the address bar';
      setTimeout(() => (button.textContent = 'Copy link'), 1600);
    });
  }

  fold(): void {
    const folded = document.body.classList.toggle('folded');
    byId('fold').setAttribute('aria-expanded', String(!folded));
  }

  show(state: State): void {
    const { take } = this;
    const set = setOf(take, state.set);
    for (const [id, button] of this.setButtons) {
      button.setAttribute('aria-pressed', String(id === state.set));
      button.toggleAttribute('data-second', id === state.other);
    }
    this.other.value = state.other;
    for (const option of this.other.options) option.disabled = option.value === state.set || setOf(take, option.value)?.done.length === 0;
    byId('layout').hidden = !state.other || state.mode !== 'space';
    this.layout(state.layout);
    this.mode(state.mode);
    this.by.value = state.by;
    for (const option of this.by.options) {
      const known = ['hair', 'strand', 'root'].includes(option.value) || set?.attributes.includes(option.value) === true;
      option.disabled = !known;
      if (!known) option.title = `${state.set} does not have it`;
    }
    for (const [layer, box] of this.boxes) box.checked = state.layers[layer] && !box.disabled;
    for (const label of byId('layers').children as HTMLCollectionOf<HTMLElement>) label.hidden = !['', state.mode].includes(label.dataset.mode!);
    byId('opacity-row').hidden = state.mode !== 'footage';
    byId('drawing').hidden = state.mode !== 'space';
    byId<HTMLInputElement>('opacity').value = String(state.opacity);
    byId<HTMLInputElement>('width').value = String(state.width);
    byId<HTMLSelectElement>('detail').value = state.detail;
    byId<HTMLInputElement>('follow').checked = state.follow;
    byId('space').hidden = state.mode !== 'space';
    byId('footage').hidden = state.mode !== 'footage';
    byId('sheet').hidden = state.view === '';
    byId('hint').hidden = state.selected !== null;
  }
}

let legendSaid = '';

/** What the colours mean. */
export function legend(scale: Scale | null, notes: string[]): void {
  const said = JSON.stringify([scale && [scale.title, scale.about, scale.unit, scale.range, scale.categories], notes]);
  if (said === legendSaid) return;
  legendSaid = said;
  const card = byId('legend');
  card.hidden = !scale && notes.length === 0;
  const range = byId('range');
  range.hidden = !scale || scale.categories !== undefined || scale.range[1] - scale.range[0] === 1 && scale.unit === '' && /number|direction/.test(scale.title);
  const parts: (Node | string)[] = [];
  if (scale) {
    parts.push(el('b', {}, scale.unit ? `${scale.title}, ${scale.unit}` : scale.title));
    if (scale.about && scale.about.toLowerCase() !== scale.title.toLowerCase()) parts.push(el('p', {}, scale.about));
    if (scale.categories) {
      const items = scale.categories.map((name, i) => {
        const swatch = el('span', { className: 'swatch' });
        swatch.style.background = css(categoryColour(name, i));
        return el('li', {}, swatch, name);
      });
      parts.push(el('ul', {}, ...items));
    } else {
      const ramp = el('canvas', { className: 'ramp', width: 256, height: 1 });
      const ink = ramp.getContext('2d')!;
      const pixels = ink.createImageData(256, 1);
      pixels.data.set(scale.table);
      ink.putImageData(pixels, 0, 0);
      parts.push(ramp);
      if (!range.hidden) {
        const [lo, hi] = scale.range;
        const middle = (lo + hi) / 2;
        parts.push(el('div', { className: 'ends' }, ...[lo, middle, hi].map((v) => el('span', {}, number(v)))));
        const [from, to] = [byId<HTMLInputElement>('range-lo'), byId<HTMLInputElement>('range-hi')];
        if (document.activeElement !== from) from.value = String(+lo.toPrecision(4));
        if (document.activeElement !== to) to.value = String(+hi.toPrecision(4));
      }
    }
  }
  card.replaceChildren(...parts, ...notes.map((note) => el('p', {}, note)));
}

/** The picked strand: what is known of it, over all frames. */
export class PickedPanel {
  private plots: Plot[] = [];
  private shown: StrandDetails | null = null;
  private readonly now = new Map<string, HTMLElement>();

  constructor(private readonly room: HTMLElement, private readonly take: Take, private readonly store: Store, private readonly deeds: Deeds) {}

  show(state: State, details: StrandDetails | undefined): void {
    this.room.hidden = state.selected === null;
    if (state.selected === null) {
      this.shown = null;
      return;
    }
    if (!details) {
      this.shown = null;
      this.plots = [];
      this.room.replaceChildren(this.title(state.selected), el('p', {}, 'Reading …'));
      return;
    }
    if (details !== this.shown) this.build(state, details);
    this.shown = details;
    for (const p of this.plots) p.at(state.frame);
    const at = details.frames.indexOf(state.frame);
    const put = (name: string, text: string) => {
      const node = this.now.get(name);
      if (node) node.textContent = text;
    };
    put('length', `${number(details.length_mm[at])} mm`);
    put('speed', `${number(details.speed_mm_s[at])} mm/s`);
    put('error', `${number(details.error_mm?.[at])} mm`);
    this.room.querySelector('#isolate')?.setAttribute('aria-pressed', String(state.isolated));
    const button = this.room.querySelector('#isolate');
    if (button) button.firstChild!.textContent = state.isolated ? 'Show all strands ' : 'Isolate neighbours ';
  }

  private title(index: number): HTMLElement {
    return el('h2', {}, `Strand ${index}`, el('button', { type: 'button', title: 'Let go (Esc)', 'aria-label': 'Let go of the strand', onclick: () => this.store.set({ selected: null, isolated: false }) }, '✕'));
  }

  private build(state: State, details: StrandDetails): void {
    this.now.clear();
    const facts = el('dl', { className: 'facts' });
    const fact = (term: string, text: string, name = '') => {
      const dd = el('dd', {}, text);
      if (name) this.now.set(name, dd);
      facts.append(el('dt', {}, term), dd);
    };
    fact('Length now', '', 'length');
    fact('Speed now', '', 'speed');
    if (details.error_mm) fact('Error to truth now', '', 'error');
    if (details.residual_mm !== undefined && details.residual_mm !== null) fact('Residual of the fit', `${number(details.residual_mm)} mm`);
    if (details.confidence !== undefined && details.confidence !== null) fact('Confidence', number(details.confidence));
    fact('Points', String(details.points));
    fact('Frames', String(details.length_mm.filter((v) => v !== null && Number.isFinite(v)).length));

    const order = this.take.attributes.find((a) => a.name === 'provenance')?.categories ?? [];
    const shares = Object.entries(details.provenance).filter(([, share]) => share > 0).sort((a, b) => order.indexOf(a[0]) - order.indexOf(b[0]));
    const bar = el('div', { className: 'share', role: 'img', 'aria-label': shares.map(([name, s]) => `${name} ${Math.round(s * 100)} %`).join(', ') });
    const list = el('ul', { className: 'shares' });
    for (const [i, [name, share]] of shares.entries()) {
      const colour = css(categoryColour(name, i));
      const part = el('span');
      part.style.background = colour;
      part.style.flex = String(share);
      bar.append(part);
      const swatch = el('span', { className: 'swatch' });
      swatch.style.background = colour;
      list.append(el('li', {}, swatch, `${name} ${share < 0.01 ? '< 1' : Math.round(share * 100)} %`));
    }

    const made = [
      plot('Length', 'mm', details.frames, details.length_mm, this.deeds.go),
      plot('Speed', 'mm/s', details.frames, details.speed_mm_s, this.deeds.go),
      details.relative_speed_mm_s ? plot('Speed relative to the head', 'mm/s', details.frames, details.relative_speed_mm_s, this.deeds.go) : null,
      details.error_mm ? plot('Error to truth', 'mm', details.frames, details.error_mm, this.deeds.go) : null,
    ];
    this.plots = made.filter((p): p is Plot => p !== null);

    const parameters = Object.entries(details.parameters ?? {});
    const table = el('dl', { className: 'facts' });
    for (const [name, value] of parameters) table.append(el('dt', {}, name.replaceAll('_', ' ')), el('dd', {}, number(value)));

    const isolate = el('button', { type: 'button', id: 'isolate', className: 'quiet', onclick: () => this.deeds.isolate(!this.store.state.isolated) }, 'Isolate neighbours ', el('kbd', {}, 'i'));
    this.room.replaceChildren(
      this.title(state.selected!),
      facts,
      ...this.plots.map((p) => p.node),
      ...(shares.length ? [el('h3', {}, 'Provenance of its points'), bar, list] : []),
      ...(parameters.length ? [el('h3', {}, 'Fitted parameters, per unit mass'), table] : []),
      el('div', { className: 'row' }, isolate),
    );
  }
}
