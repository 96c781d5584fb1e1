// All that can be done, with its keys.

import { byId } from '../dom.ts';
import type { App } from './app.ts';
import type { Action } from './keys.ts';
import { TOOLS } from './state.ts';
import type { ToolName } from './state.ts';

const TOOL_WORDS: Record<ToolName, string> = { markers: 'markers', hair: 'hair mask', subject: 'subject mask', strands: 'sketched strands' };

/** Pixels of the screen by which keys move the cursor. */
const [NEAR, FAR] = [2, 20];

export function actions(app: App): Action[] {
  const at = () => app.look;
  const go = (by: number) => () => app.go(at().frame + by);
  const moves = ([['w', 0, -1], ['a', -1, 0], ['s', 0, 1], ['d', 1, 0]] as const).flatMap(([key, x, y]) => [
    { key, run: () => app.nudge(NEAR * x, NEAR * y) },
    { key: `shift+${key}`, run: () => app.nudge(FAR * x, FAR * y) },
  ]);
  const quiet = (keys: string[], run: () => void): Action => ({ keys, show: [], text: '', group: '', run });
  const listed: Action[] = [
    ...TOOLS.map((tool, i): Action => ({ keys: [String(i + 1)], text: TOOL_WORDS[tool], group: 'Tools', run: () => app.set({ tool }) })),
    { keys: ['ctrl+z', 'u'], show: ['Ctrl Z', 'u'], text: 'undo', group: 'Tools', run: () => app.undo() },
    { keys: ['ctrl+shift+z', 'ctrl+y', 'shift+u'], show: ['Ctrl Y', 'Shift u'], text: 'redo', group: 'Tools', run: () => app.redo() },
    { keys: ['Escape'], text: 'let go of what is selected', group: 'Tools', run: () => app.letGo() },
    { keys: ['?'], text: 'these keys', group: 'Tools', run: () => byId<HTMLDialogElement>('help').showModal() },

    { keys: ['e'], text: 'paint or erase', group: 'Masks', run: () => app.set({ erase: !at().erase }) },
    { keys: [','], show: [',', '.'], text: 'smaller, larger brush', group: 'Masks', run: () => app.brush(-1) },
    { keys: ['f'], text: 'fill the hole (erase the piece) at the cursor', group: 'Masks', run: () => app.fill() },

    { keys: ['ArrowLeft'], show: ['←', '→'], text: 'a frame back or on; with Shift ten', group: 'Frames and views', run: go(-1) },
    { keys: ['Home'], show: ['Home', 'End'], text: 'first, last frame', group: 'Frames and views', run: () => app.go(app.work.frames[0]) },
    { keys: ['PageUp'], show: ['Page↑', 'Page↓'], text: 'the frame before or after that you labelled', group: 'Frames and views', run: () => app.stepKept(-1) },
    { keys: ['['], show: ['[', ']'], text: 'the view before or after; Alt 1 … 9 one of them', group: 'Frames and views', run: () => app.stepView(-1) },
    { keys: ['g'], text: 'all views alike, or one large', group: 'Frames and views', run: () => app.set({ sheet: !at().sheet }) },
    { keys: ['c'], text: 'small views close up, around what is selected', group: 'Frames and views', run: () => app.set({ close: !at().close }) },
    { keys: ['+'], show: ['+', '−', '0'], text: 'zoom in, out, whole view', group: 'Frames and views', run: () => app.bench.zoomBy(1.5, app.spot().at) },
    { keys: ['x'], text: 'zoom to what is selected', group: 'Frames and views', run: () => { const to = app.tool.focus(app.view(at().view)); if (to) app.bench.centre(to); } },
    { keys: ['o'], text: 'hide or show what is drawn over the footage', group: 'Frames and views', run: () => app.set({ overlay: !at().overlay }) },

    { keys: moves.map((m) => m.key), show: ['w', 'a', 's', 'd'], text: 'move the cursor; with Shift further', group: 'Without the mouse', run: () => {} },
    { keys: ['Enter'], text: 'label, paint or set a point at the cursor', group: 'Without the mouse', run: () => app.act() },
    { keys: ['b'], text: 'pen down or up: moving the cursor paints', group: 'Without the mouse', run: () => app.pen() },

    { keys: ['n'], text: 'new marker, new strand; take a carried mask for yours', group: 'Markers and strands', run: () => app.tool.fresh() },
    { keys: ['j'], show: ['j', 'k'], text: 'the next, the one before', group: 'Markers and strands', run: () => app.tool.step(1) },
    { keys: ['m'], show: ['m'], text: 'take what is predicted in this view for the label; with Shift, and go on to the next view without one', group: 'Markers and strands', run: () => { if (at().tool === 'markers') app.markers.accept(); } },
    { keys: ['v'], show: ['v'], text: 'the next view that predicts it and has no label; with Shift back', group: 'Markers and strands', run: () => { if (at().tool === 'markers') app.markers.goOn(1); } },
    { keys: ['Delete', 'Backspace'], show: ['Del'], text: 'remove it in this view; take a mask back', group: 'Markers and strands', run: () => app.tool.remove(false) },
    { keys: ['shift+Delete', 'shift+Backspace'], show: ['Shift Del'], text: 'remove it in all views (a marker where it begins: for good); clear a mask', group: 'Markers and strands', run: () => app.tool.remove(true) },
  ];
  return [
    ...listed,
    ...moves.map((move) => quiet([move.key], move.run)),
    quiet(['ArrowRight'], go(1)), quiet(['shift+ArrowLeft'], go(-10)), quiet(['shift+ArrowRight'], go(10)),
    quiet(['End'], () => app.go(app.work.frames[1] - 1)), quiet(['PageDown'], () => app.stepKept(1)), quiet([']'], () => app.stepView(1)),
    quiet(['='], () => app.bench.zoomBy(1.5, app.spot().at)), quiet(['-'], () => app.bench.zoomBy(1 / 1.5, app.spot().at)), quiet(['0'], () => app.set({ zoom: null })),
    quiet(['shift+m'], () => { if (at().tool === 'markers' && app.markers.accept()) app.markers.goOn(1); }),
    quiet(['shift+v'], () => { if (at().tool === 'markers') app.markers.goOn(-1); }),
    quiet(['k'], () => app.tool.step(-1)), quiet(['.'], () => app.brush(1)),
    ...app.views.slice(0, 9).map((view, i) => quiet([`alt+${i + 1}`], () => app.set({ view: view.name }))),
  ];
}
