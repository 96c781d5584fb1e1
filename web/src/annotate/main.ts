// Start: the token, the take, the page.

import { Api, takeToken } from '../api.ts';
import { cover } from '../cover.ts';
import { byId } from '../dom.ts';
import { App } from './app.ts';
import { Memory } from './memory.ts';
import type { Work } from './wire.ts';

async function start(): Promise<App> {
  let app: App | null = null;
  const api = new Api(takeToken(), (alive) => app?.alive(alive));
  const work = await api.json<Work>('/api/work');
  const { memory, past } = await Memory.open(work.id);
  app = new App(api, work, memory, past);
  byId('cover').hidden = true;
  return app;
}

const ready = start();
ready.catch((error: Error) => cover(error, 'strandflow annotate'));

/** For whoever drives the page: what is shown, in numbers. */
const hook = {
  ready: ready.then((app) => app.settled()),
  state: () => null as unknown,
  set: (_: object) => {},
  place: (_: [number, number]) => [0, 0] as [number, number],
};
void ready.then((app) => {
  hook.state = () => app.counters();
  hook.set = (change) => app.set(change);
  hook.place = (at) => app.place(at);
}, () => {});
hook.ready.catch(() => {});
Object.assign(window, { strandflow: hook });
