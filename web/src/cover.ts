// What to do when there is nothing to show.

import { Lost, Refusal } from './api.ts';
import { byId, el } from './dom.ts';

const LOST = 'The program does not answer: it has ended, or the tunnel is closed.';

/** Asks for a token; `given` gets it, out of a whole printed address too. */
export function askToken(given: (token: string) => void): HTMLFormElement {
  const input = el('input', { name: 'token', 'aria-label': 'Token', autocomplete: 'off', placeholder: 'token' });
  return el('form', { onsubmit: (event: Event) => {
    event.preventDefault();
    // A whole printed address is as good as the token within it.
    given(/[?&]token=([^&#]+)/.exec(input.value)?.[1] ?? input.value.trim());
  } }, input, el('button', { className: 'quiet' }, 'Open'));
}

/** Covers the page with what went wrong; `command` is the one that serves it. */
export function cover(error: Error, command: string): void {
  const room = byId('cover');
  room.hidden = false;
  if (error instanceof Refusal && error.status === 401) {
    const form = askToken((token) => {
      const here = new URL(location.href);
      here.searchParams.set('token', token);
      location.href = here.href;
    });
    room.replaceChildren(el('p', {}, `This page needs the token of the address that \`${command}\` printed.`), form);
    return;
  }
  const [text, hint] = error instanceof Lost ? [LOST, `Start \`${command}\` again and open the address that it prints.`]
    : error instanceof Refusal ? [error.message, error.hint] : ['The page could not start.', error.message];
  room.replaceChildren(el('p', {}, text), el('p', {}, hint));
}
