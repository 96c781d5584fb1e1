// Start: the token, the take, the page.

import { Api, takeToken } from './api.ts';
import { App } from './app.ts';
import { cover } from './cover.ts';
import { byId } from './dom.ts';
import type { Take } from './protocol.ts';

async function start(): Promise<App> {
  const token = takeToken();
  let app: App | null = null;
  const api = new Api(token, (alive) => app?.alive(alive));
  const take = await api.json<Take>('/api/take');
  app = new App(api, take);
  byId('cover').hidden = true;
  return app;
}

const ready = start();
ready.catch((error: Error) => cover(error, 'strandflow view'));

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
