// Keys. They do what the controls do, and stay out of the way of text fields.

import { byId } from './dom.ts';
import type { Take } from './protocol.ts';
import type { Store } from './state.ts';

interface Hands {
  store: Store;
  take: Take;
  go: (frame: number) => void;
  home: () => void;
  fold: () => void;
  compare: () => void;
}

export class Keys {
  constructor(private readonly hands: Hands) {
    addEventListener('keydown', (event) => {
      const target = event.target as HTMLElement;
      const typing = target instanceof HTMLSelectElement || (target instanceof HTMLInputElement && target.type !== 'checkbox' && target.id !== 'frame');
      if (event.ctrlKey || event.metaKey || event.altKey || typing || byId<HTMLDialogElement>('help').open) return;
      if (this.press(event)) event.preventDefault();
    });
  }

  private press(event: KeyboardEvent): boolean {
    const { store, take, go, home, fold, compare } = this.hands;
    const { state } = store;
    const [lo, hi] = take.frames;
    const far = event.shiftKey ? 10 : 1;
    const set = /^[1-9]$/.test(event.key) ? take.sets[Number(event.key) - 1] : undefined;
    if (set) {
      if (set.done.length > 0) store.set({ set: set.id, other: state.other === set.id ? '' : state.other });
      return true;
    }
    switch (event.key) {
      case ' ':
        // The space bar presses a button that was reached by the keyboard, not one that was clicked before.
        if (event.target instanceof HTMLButtonElement && event.target.matches(':focus-visible')) return false;
        store.set({ playing: !state.playing });
        return true;
      case 'ArrowLeft': go(state.frame - far); return true;
      case 'ArrowRight': go(state.frame + far); return true;
      case 'Home': go(lo); return true;
      case 'End': go(hi - 1); return true;
      case 'c': compare(); return true;
      case 'v': store.set({ mode: state.mode === 'space' ? 'footage' : 'space' }); return true;
      case 'f': store.set({ follow: !state.follow }); return true;
      case 'h': home(); return true;
      case 'p': fold(); return true;
      case 'i': if (state.selected !== null) store.set({ isolated: !state.isolated }); return true;
      case '?': byId<HTMLDialogElement>('help').showModal(); return true;
      case 'Escape':
        if (state.selected !== null) store.set({ selected: null, isolated: false });
        else if (state.view) store.set({ view: '' });
        else return false;
        return true;
      default: return false;
    }
  }
}
