// Every action has a key. The overlay of keys is written from the same list that is obeyed.

import { byId, el } from '../dom.ts';

export interface Action {
  /** As `nameOf` tells them. */
  keys: string[];
  /** As the overlay shows them; those of `keys` otherwise. */
  show?: string[];
  text: string;
  group: string;
  run: () => void;
}

/** `shift+ArrowLeft`, `ctrl+z`, `?`: Shift counts where it does not make another character. */
export function nameOf(event: KeyboardEvent): string {
  const ctrl = event.ctrlKey || event.metaKey ? 'ctrl+' : '';
  const alt = event.altKey ? 'alt+' : '';
  const isLetter = /^[a-z]$/i.test(event.key);
  const key = isLetter ? event.key.toLowerCase() : event.key;
  const shift = event.shiftKey && (isLetter || event.key.length > 1) ? 'shift+' : '';
  return `${ctrl}${alt}${shift}${key}`;
}

const SHOWN: Record<string, string> = { ArrowLeft: '←', ArrowRight: '→', ' ': 'Space', PageUp: 'Page↑', PageDown: 'Page↓', Delete: 'Del', Escape: 'Esc', '=': '+' };

function shown(key: string): string {
  return key.split('+').filter((part) => part !== '').map((part) => SHOWN[part] ?? (part === 'shift' ? 'Shift' : part === 'ctrl' ? 'Ctrl' : part === 'alt' ? 'Alt' : part)).join(' ');
}

export class Keys {
  private readonly byKey = new Map<string, Action>();

  constructor(actions: Action[]) {
    for (const action of actions) for (const key of action.keys) this.byKey.set(key, action);
    const groups = [...new Set(actions.map((action) => action.group))].filter((group) => group !== '');
    byId('help-keys').append(...groups.map((group) => el(
      'section', {}, el('h3', {}, group),
      el('dl', {}, ...actions.filter((action) => action.group === group).map((action) => {
        const keys = (action.show ?? action.keys.map(shown)).flatMap((key) => [el('kbd', {}, key), ' ']);
        return el('div', {}, el('dt', {}, ...keys), el('dd', {}, action.text));
      })),
    )));
    addEventListener('keydown', (event) => {
      const target = event.target as HTMLElement;
      const typing = target instanceof HTMLSelectElement || (target instanceof HTMLInputElement && target.type !== 'range');
      if (typing || document.querySelector('dialog[open]')) return;
      // Enter and Space press a button that was reached by the keyboard, not one that was clicked before.
      if (['Enter', ' '].includes(event.key) && target instanceof HTMLButtonElement && target.matches(':focus-visible')) return;
      const action = this.byKey.get(nameOf(event));
      if (!action) return;
      event.preventDefault();
      action.run();
    });
  }
}
