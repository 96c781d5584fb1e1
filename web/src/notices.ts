// Quiet notices in a corner: what could not be had, and what can be done. The same one is not shown twice.

import { Lost, Refusal } from './api.ts';
import { byId, el } from './dom.ts';

const SHOWN_MS = 12000;

export class Notices {
  private readonly open = new Map<string, HTMLElement>();
  readonly said: string[] = [];

  say(text: string, hint = '', lasting = false): void {
    if (this.open.has(text)) return;
    this.said.push(text);
    const gone = () => this.take(text);
    const node = el(
      'div', { className: 'card notice' },
      el('div', {}, el('p', {}, text), hint !== '' && el('p', {}, hint)),
      el('button', { type: 'button', 'aria-label': 'Dismiss', onclick: gone }, '✕'),
    );
    this.open.set(text, node);
    byId('notices').append(node);
    if (!lasting) setTimeout(gone, SHOWN_MS);
  }

  take(text: string): void {
    this.open.get(text)?.remove();
    this.open.delete(text);
  }

  error(error: Error): void {
    if (error instanceof Lost) return;
    if (error instanceof Refusal) this.say(error.message, error.hint);
    else this.say('An answer could not be read.', error.message);
  }
}
