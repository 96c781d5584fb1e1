// How long the program takes to answer, one request at a time, and how much it sends.
//
//   node test/requests.mjs ADDRESS      (the address that `strandflow view TAKE [--truth DIR]` prints)

const address = process.argv[2];
if (!address) {
  console.error('usage: node test/requests.mjs ADDRESS');
  process.exit(2);
}
const { origin, searchParams } = new URL(address);
const headers = { authorization: `Bearer ${searchParams.get('token')}` };

async function ask(path) {
  const began = performance.now();
  const answer = await fetch(`${origin}/api/${path}`, { headers });
  const body = await answer.arrayBuffer();
  if (!answer.ok) throw new Error(`${path}: ${answer.status} ${Buffer.from(body)}`);
  return { body, bytes: body.byteLength, ms: performance.now() - began };
}

const first = await ask('take');
const take = JSON.parse(Buffer.from(first.body));
console.log('take, first', first.bytes, first.ms.toFixed(0));
const set = take.sets.find(({ id }) => id === 'blend') ?? take.sets.at(-1);
const view = encodeURIComponent(take.views[0]?.name ?? '');
const frames = set.done.slice(0, 8);
const coarse = 'stride=4&points=14';

/** Of some frames, each asked for once: bytes of the largest answer, least, median and most milliseconds. */
async function row(what, path, of = frames) {
  const answers = [];
  for (const frame of of) answers.push(await ask(path(frame)));
  const ms = answers.map((answer) => answer.ms).sort((a, b) => a - b);
  const shown = [ms[0], ms[ms.length >> 1], ms.at(-1)].map((v) => v.toFixed(0));
  console.log(`| ${what} | ${Math.max(...answers.map(({ bytes }) => bytes))} | ${shown.join(', ')} |`);
}

console.log('| request | bytes | ms: least, median, most |');
await row('take, again', () => 'take');
await row('every fourth strand with 14 points, 16 bits', (t) => `strands/${set.id}/${t}?${coarse}&bits=16`);
await row('all strands, own points, 16 bits', (t) => `strands/${set.id}/${t}?bits=16`);
await row('speed, every fourth strand with 14 points', (t) => `attribute/${set.id}/speed/${t}?${coarse}`);
if (set.attributes.includes('error')) {
  await row('error, the same', (t) => `attribute/${set.id}/error/${t}?${coarse}`);
  await row('error, all strands, own points', (t) => `attribute/${set.id}/error/${t}`, frames.slice(0, 3));
}
await row('one strand over all frames', (n) => `strand/${set.id}/${n * 100}`);
if (take.layers.masks) await row('mask', (t) => `mask/${view}/${t}`);
if (take.layers.orientation) await row('orientation map', (t) => `orientation/${view}/${t}`);
if (take.views[0]?.footage) await row('footage', (t) => `image/${view}/${t}`);
if (take.layers.hull) await row('hull', (t) => `mesh/hull/${t}`);
