// Start: the token, the take, the page.

import { Api, Lost, Refusal, takeToken } from './api.ts';
import { App } from './app.ts';
import { byId, el } from './dom.ts';
import type { Take } from './protocol.ts';

const LOST = 'The program does not answer: it has ended, or the tunnel is closed.';

async function start(): Promise<App> {
  const token = takeToken();
  let app: App | null = null;
  const api = new Api(token, (alive) => app?.alive(alive));
  const take = await api.json<Take>('/api/take');
  app = new App(api, take);
  byId('cover').hidden = true;
  return app;
}

/** What to do when there is nothing to show. */
function cover(error: Error): void {
  const room = byId('cover');
  room.hidden = false;
  if (error instanceof Refusal && error.status === 401) {
    const input = el('input', { name: 'token', 'aria-label': 'Token', autocomplete: 'off', placeholder: 'token' });
    const form = el('form', { onsubmit: (event: Event) => {
      event.preventDefault();
      const here = new URL(location.href);
      // A whole printed address is as good as the token within it.
      here.searchParams.set('token', /[?&]token=([^&#]+)/.exec(input.value)?.[1] ?? input.value.trim());
      location.href = here.href;
    } }, input, el('button', { className: 'quiet' }, 'Open'));
    room.replaceChildren(el('p', {}, 'This page needs the token of the address that `strandflow view` printed.'), form);
    return;
  }
  const [text, hint] = error instanceof Lost ? [LOST, 'Start `strandflow view` again and open the address that it prints.']
    : error instanceof Refusal ? [error.message, error.hint] : ['The page could not start.', error.message];
  room.replaceChildren(el('p', {}, text), el('p', {}, hint));
}

const ready = start();
ready.catch((error: Error) => cover(error));

/** For whoever drives the page: what is shown, in numbers. */
const hook = {
  ready: ready.then((app) => app.settled()),
  app: ready,
  state: () => null as unknown,
  set: (_: object) => {},
};
void ready.then((app) => {
  hook.state = () => app.counters();
  hook.set = (change) => app.store.set(change);
}, () => {});
hook.ready.catch(() => {});
Object.assign(window, { strandflow: hook });
