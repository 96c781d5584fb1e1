// Stands in for the program: the same protocol, strands made by a formula. Used by the tests, and for scale.
//
//   node test/mock.mjs [--strands 8000] [--frames 200] [--points 32] [--views 7] [--port 0]
//
// prints the address to open. It can be imported as well: `serve(options)`.

import { createServer } from 'node:http';
import { readFile } from 'node:fs/promises';
import { randomBytes } from 'node:crypto';
import { deflateSync, crc32 } from './png.mjs';

const MAGIC = 0x53465331;
const CSP = "default-src 'self'; img-src 'self' blob: data:; style-src 'self'";
const PROVENANCE = ['missing', 'observed', 'diffused', 'simulated', 'completed'];

class Refused extends Error {
  constructor(status, message, hint = '') {
    super(message);
    Object.assign(this, { status, hint });
  }
}

// ---- the take ---------------------------------------------------------------------------------------------------------

/** The same numbers every time. */
function random(seed) {
  let s = seed >>> 0;
  return () => {
    s = (s + 0x6d2b79f5) >>> 0;
    let t = Math.imul(s ^ (s >>> 15), 1 | s);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
  };
}

const HEAD = [78, 98, 110];

/** Head space: z up, face towards +y, the head's middle at the origin. */
function groom(strands, points) {
  const r = random(7);
  const rest = new Float32Array(strands * points * 3);
  const phase = new Float32Array(strands);
  for (let s = 0; s < strands; s++) {
    // A root anywhere on the upper head but the face.
    let n;
    do {
      const [z, a] = [r() * 1.25 - 0.25, r() * 2 * Math.PI];
      const q = Math.sqrt(Math.max(0, 1 - z * z));
      n = [q * Math.cos(a), q * Math.sin(a), z];
    } while (n[1] > 0.35 + 0.45 * n[2]);
    phase[s] = r();
    const length = 190 + 90 * r();
    const wave = 4 + 5 * r();
    const turn = r() * 6.28;
    const p = n.map((c, k) => c * HEAD[k]);
    const way = [...n];
    for (let i = 0; i < points; i++) {
      const t = i / (points - 1);
      const at = (s * points + i) * 3;
      const w = wave * t * Math.sin(5 * 6.28 * t + turn);
      rest[at] = p[0] + w * -n[1];
      rest[at + 1] = p[1] + w * n[0];
      rest[at + 2] = p[2] + w * 0.3;
      const h = length / (points - 1);
      // Leaves along the normal, then falls, and never goes into the head.
      way[2] -= 0.16 * (32 / points) * (1 + t);
      let size = Math.hypot(...way);
      for (let k = 0; k < 3; k++) way[k] /= size;
      for (let k = 0; k < 3; k++) p[k] += way[k] * h;
      size = Math.hypot(p[0] / HEAD[0], p[1] / HEAD[1], p[2] / HEAD[2]);
      const least = 1.03 + 0.12 * phase[s];
      if (size < least && p[2] > -60) for (let k = 0; k < 3; k++) p[k] *= least / size;
    }
  }
  return { rest, phase };
}

function ellipsoid(radii, rings, sectors, lowest = -1) {
  const [vertices, faces] = [[], []];
  for (let i = 0; i <= rings; i++) {
    const z = Math.max(lowest, Math.cos((Math.PI * i) / rings));
    const q = Math.sqrt(Math.max(0, 1 - z * z));
    for (let j = 0; j < sectors; j++) {
      const a = (2 * Math.PI * j) / sectors;
      vertices.push(radii[0] * q * Math.cos(a), radii[1] * q * Math.sin(a), radii[2] * z);
      const k = (j + 1) % sectors;
      if (i < rings) faces.push(i * sectors + j, (i + 1) * sectors + j, (i + 1) * sectors + k, i * sectors + j, (i + 1) * sectors + k, i * sectors + k);
    }
  }
  return { vertices, faces };
}

const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const unit = (a) => a.map((c) => c / Math.hypot(...a));

function camera(name, angle) {
  const center = [900 * Math.sin(angle), -900 * Math.cos(angle), 120];
  const z = unit([-center[0], -center[1], -40 - center[2]]);
  const x = unit(cross(z, [0, 0, 1]));
  const y = cross(z, x);
  const row = (r) => [...r, -dot(r, center)];
  return {
    name, width: 640, height: 480, fx: 760, fy: 760, cx: 320, cy: 240,
    camera_from_world: [...row(x), ...row(y), ...row(z), 0, 0, 0, 1], center, footage: true,
  };
}

function make({ strands, frames, points, views }) {
  const { rest, phase } = groom(strands, points);
  const poses = Array.from({ length: frames }, (_, f) => {
    const a = 0.5 * (Math.sin((2 * Math.PI * f) / 60));
    const [c, s] = [Math.cos(a), Math.sin(a)];
    return [c, -s, 0, 25 * Math.sin(f / 15), s, c, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
  });
  const cameras = Array.from({ length: views }, (_, i) => camera(`cam${i}`, ((i - (views - 1) / 2) / Math.max(1, views)) * 4.4));
  const all = Array.from({ length: frames }, (_, f) => f);
  const attributes = ['provenance', 'confidence', 'speed', 'length_change', 'error'];
  const set = (id, title, done, with_ = attributes) => ({ id, title, strands, points, frames: [0, frames], done, attributes: with_ });
  return {
    rest, phase, strands, points,
    take: {
      name: 'procedural', fps: 30, frames: [0, frames], gravity: [0, 0, -9810],
      world_from_head: { first: 0, poses },
      bounds: { lo: [-190, -190, -300], hi: [190, 150, 175] },
      views: cameras,
      sets: [
        set('grow', 'grown strands', all, attributes.slice(0, 2)),
        set('smooth', 'smoothed strands', all.filter((f) => f % 10 !== 3)),
        set('fit', 'fitted strands', [], [...attributes, 'residual']),
        set('blend', 'blended strands', all),
        set('animate/wind', 'animation wind', all, ['speed']),
        set('truth', 'true strands', all, ['speed']),
      ],
      attributes: [
        { name: 'provenance', per: 'point', unit: '', range: [0, 4], categories: PROVENANCE },
        { name: 'confidence', per: 'point', unit: '', range: [0, 1] },
        { name: 'speed', per: 'point', unit: 'mm/s', range: [0, 1200] },
        { name: 'length_change', per: 'strand', unit: '%', range: [-4, 6] },
        { name: 'error', per: 'point', unit: 'mm', range: [0, 15] },
        { name: 'residual', per: 'strand', unit: 'mm', range: [0, 3] },
      ],
      layers: { hull: true, lines: true, arrows: true, masks: true, orientation: false, head: true },
      stages: [
        { name: 'masks', state: 'done', detail: `${frames} of ${frames} frames` },
        { name: 'grow', state: 'done', detail: `${frames} of ${frames} frames` },
        { name: 'fit', state: 'waiting', detail: '' },
        { name: 'blend', state: 'done', detail: `${frames} of ${frames} frames` },
      ],
    },
  };
}

/** World position of a point; `away` moves a set's strands so that sets differ. */
function place(made, away, s, t, frame, out) {
  const { rest, phase, points } = made;
  const x = t * (points - 1);
  const i = Math.min(points - 2, Math.floor(x));
  const f = x - i;
  const at = (s * points + i) * 3;
  const bend = t * t;
  const sway = 45 * bend * Math.sin((2 * Math.PI * frame) / 60 - 1.2 * t - phase[s]) + away * bend * 12;
  const px = rest[at] + f * (rest[at + 3] - rest[at]) + sway;
  const py = rest[at + 1] + f * (rest[at + 4] - rest[at + 1]) + away * bend * 6 * phase[s];
  const pz = rest[at + 2] + f * (rest[at + 5] - rest[at + 2]);
  const m = made.take.world_from_head.poses[Math.min(frame, made.take.frames[1] - 1)];
  out[0] = m[0] * px + m[1] * py + m[2] * pz + m[3];
  out[1] = m[4] * px + m[5] * py + m[6] * pz + m[7];
  out[2] = m[8] * px + m[9] * py + m[10] * pz + m[11];
}

const AWAY = { grow: 1.4, smooth: 0.8, blend: 0.4, 'animate/wind': 3, truth: 0 };
/** One strand in 50 ends early. */
const last = (s) => (s % 50 === 49 ? 0.6 : 1);

function speed(made, away, s, t, frame) {
  const [a, b] = [[], []];
  place(made, away, s, t, Math.max(0, frame - 1), a);
  place(made, away, s, t, Math.max(1, frame), b);
  return Math.hypot(b[0] - a[0], b[1] - a[1], b[2] - a[2]) * made.take.fps;
}

function value(made, set, name, s, t, frame) {
  const away = AWAY[set];
  switch (name) {
    case 'provenance': return t > last(s) ? 0 : set === 'blend' && s % 7 === 3 ? 4 : t < 0.35 + 0.4 * made.phase[s] ? 1 : t < 0.85 ? 2 : 3;
    case 'confidence': return Math.max(0, 1 - 0.7 * t - 0.2 * made.phase[s]);
    case 'speed': return speed(made, away, s, t, frame);
    case 'length_change': return 5 * Math.sin(frame / 20 + 6 * made.phase[s]) * made.phase[s];
    case 'error': return away * t * t * Math.hypot(12, 6 * made.phase[s]);
    default: throw new Refused(404, `no attribute ${name} in ${set}`);
  }
}

// ---- answers ----------------------------------------------------------------------------------------------------------

function sampled(made, query) {
  const first = Number(query.get('first') ?? 0);
  const stride = Number(query.get('stride') ?? 1);
  const count = Number(query.get('count') ?? Math.ceil((made.strands - first) / stride));
  const points = Number(query.get('points') ?? made.points);
  const numbers = Array.from({ length: count }, (_, i) => first + i * stride).filter((s) => s < made.strands);
  return { numbers, points };
}

function binary(header, ...arrays) {
  const parts = [new Uint32Array([MAGIC, ...header]), ...arrays].map((a) => Buffer.from(a.buffer, a.byteOffset, a.byteLength));
  return { type: 'application/octet-stream', body: Buffer.concat(parts) };
}

function positions(made, set, frame, query) {
  const { numbers, points } = sampled(made, query);
  const lo = [-330, -330, -330];
  const step = 660 / 65534;
  const xyz = new Uint16Array(numbers.length * points * 3);
  const p = [0, 0, 0];
  let at = 0;
  for (const s of numbers) {
    for (let i = 0; i < points; i++, at += 3) {
      const t = i / (points - 1);
      if (t > last(s)) {
        xyz[at] = 65535;
        continue;
      }
      place(made, AWAY[set], s, t, frame, p);
      for (let k = 0; k < 3; k++) xyz[at + k] = Math.min(65534, Math.max(0, Math.round((p[k] - lo[k]) / step)));
    }
  }
  return binary([numbers.length, points, 16], new Float64Array([...lo, step, step, step]), xyz);
}

function attribute(made, set, name, frame, query) {
  const about = made.take.attributes.find((a) => a.name === name);
  if (!about) throw new Refused(404, `no attribute ${name}`);
  const { numbers, points } = sampled(made, query);
  const per = about.per === 'strand' ? 1 : points;
  const values = new Float32Array(numbers.length * per);
  let at = 0;
  for (const s of numbers) for (let i = 0; i < per; i++) values[at++] = value(made, set, name, s, i / Math.max(1, per - 1), frame);
  return binary([numbers.length, per, 32], values);
}

function project(made, set, viewName, frame, query) {
  const view = viewOf(made, viewName);
  const { numbers, points } = sampled(made, query);
  const uv = new Float32Array(numbers.length * points * 2).fill(NaN);
  const m = view.camera_from_world;
  const p = [0, 0, 0];
  let at = 0;
  for (const s of numbers) {
    for (let i = 0; i < points; i++, at += 2) {
      const t = i / (points - 1);
      if (t > last(s)) continue;
      place(made, AWAY[set], s, t, frame, p);
      const [x, y, z] = [0, 4, 8].map((r) => m[r] * p[0] + m[r + 1] * p[1] + m[r + 2] * p[2] + m[r + 3]);
      uv[at] = (view.fx * x) / z + view.cx;
      uv[at + 1] = (view.fy * y) / z + view.cy;
    }
  }
  return binary([numbers.length, points, 32], uv);
}

function viewOf(made, name) {
  const view = made.take.views.find((v) => v.name === name);
  if (!view) throw new Refused(404, `no view ${name}`);
  return view;
}

/** A stand-in for footage: strands as dots on a plain ground. Colours are little-endian RGBA. */
function picture(made, viewName, frame, { ground, dot, size }) {
  const view = viewOf(made, viewName);
  const pixels = new Uint32Array(view.width * view.height).fill(ground);
  const query = new URLSearchParams({ stride: String(Math.max(1, Math.ceil(made.strands / 1000))), points: '50' });
  const { body } = project(made, 'truth', viewName, frame, query);
  const uv = new Float32Array(body.buffer.slice(body.byteOffset + 16, body.byteOffset + body.byteLength));
  for (let i = 0; i < uv.length; i += 2) {
    const [x, y] = [Math.floor(uv[i]), Math.floor(uv[i + 1])];
    for (let k = Math.max(0, x); k < Math.min(view.width, x + size); k++) {
      for (let l = Math.max(0, y); l < Math.min(view.height, y + size); l++) pixels[l * view.width + k] = dot(i);
    }
  }
  return { type: 'image/png', body: png(view.width, view.height, Buffer.from(pixels.buffer)) };
}

function png(width, height, pixels) {
  const raw = Buffer.alloc((width * 4 + 1) * height);
  for (let y = 0; y < height; y++) pixels.copy(raw, y * (width * 4 + 1) + 1, y * width * 4, (y + 1) * width * 4);
  const chunk = (name, data) => {
    const part = Buffer.concat([Buffer.from(name), data]);
    const out = Buffer.alloc(part.length + 8);
    out.writeUInt32BE(data.length, 0);
    part.copy(out, 4);
    out.writeUInt32BE(crc32(part), part.length + 4);
    return out;
  };
  const size = Buffer.alloc(13);
  size.writeUInt32BE(width, 0);
  size.writeUInt32BE(height, 4);
  size.set([8, 6, 0, 0, 0], 8);
  return Buffer.concat([Buffer.from('\x89PNG\r\n\x1a\n', 'latin1'), chunk('IHDR', size), chunk('IDAT', deflateSync(raw, { level: 1 })), chunk('IEND', Buffer.alloc(0))]);
}

function details(made, set, s) {
  if (!(s >= 0 && s < made.strands)) throw new Refused(404, `no strand ${s}`, `it has ${made.strands}`);
  const frames = made.take.sets.find((x) => x.id === set).done;
  const length = 240 * last(s);
  return {
    frames,
    length_mm: frames.map((f) => length * (1 + 0.01 * value(made, set, 'length_change', s, 0, f))),
    speed_mm_s: frames.map((f) => (f === 0 ? null : speed(made, AWAY[set], s, 0.8, f))),
    ...(set === 'truth' ? {} : { error_mm: frames.map(() => value(made, set, 'error', s, 0.6, 0)) }),
    provenance: { observed: 0.5, diffused: 0.35, simulated: 0.15 },
    ...(set === 'blend' ? { parameters: { k_edge: 51234, k_bend: 812.5, k_torsion: 96.1, k_alt: 12, c_edge: 3.2, drag: 1.25 }, residual_mm: 0.8125 } : {}),
    points: Math.round(made.points * last(s)),
  };
}

function mesh({ vertices, faces }) {
  return binary([vertices.length / 3, faces.length / 3, 0], Float32Array.from(vertices), Uint32Array.from(faces));
}

function lines(made, frame) {
  const rows = [];
  const [a, b] = [[], []];
  for (let s = 0; s < made.strands; s += Math.max(1, Math.ceil(made.strands / 1500))) {
    for (let t = 0.05; t < 0.7; t += 0.1) {
      place(made, 0, s, t, frame, a);
      place(made, 0, s, t + 0.02, frame, b);
      rows.push(...a, ...unit(b.map((c, k) => c - a[k])), 1 - t);
    }
  }
  return binary([rows.length / 7, 0, 0], Float32Array.from(rows));
}

function arrows(made, frame, most) {
  const rows = [];
  const [a, b] = [[], []];
  const count = Math.min(most, 1200);
  for (let i = 0; i < count; i++) {
    const s = Math.floor((i * made.strands) / count);
    const t = (i % 10) / 10;
    place(made, 0, s, t, Math.max(0, frame - 1), a);
    place(made, 0, s, t, Math.max(1, frame), b);
    rows.push(...a, ...b.map((c, k) => (c - a[k]) * made.take.fps));
  }
  return binary([count, 0, 0], Float32Array.from(rows));
}

function answer(made, path, query) {
  const json = (value) => ({ type: 'application/json', body: JSON.stringify(value) });
  const setFrame = (id, frame) => {
    const set = made.take.sets.find((s) => s.id === id);
    if (!set) throw new Refused(404, `no strands ${id}`);
    if (!set.done.includes(Number(frame))) throw new Refused(404, `${id} does not have frame ${frame}`, 'run the stage on this frame');
    return [id, Number(frame)];
  };
  let m;
  if (path === '/api/take') return json(made.take);
  if ((m = /^\/api\/strands\/(.+)\/(\d+)$/.exec(path))) return positions(made, ...setFrame(m[1], m[2]), query);
  if ((m = /^\/api\/attribute\/(.+)\/([^/]+)\/(\d+)$/.exec(path))) return attribute(made, setFrame(m[1], m[3])[0], m[2], Number(m[3]), query);
  if ((m = /^\/api\/project\/(.+)\/([^/]+)\/(\d+)$/.exec(path))) return project(made, setFrame(m[1], m[3])[0], m[2], Number(m[3]), query);
  if ((m = /^\/api\/strand\/(.+)\/(\d+)$/.exec(path))) return json(details(made, m[1], Number(m[2])));
  if ((m = /^\/api\/image\/([^/]+)\/(\d+)$/.exec(path))) {
    return picture(made, m[1], Number(m[2]), { ground: 0xffc4bfba, dot: (i) => 0xff1c2840 + ((i * 7) % 40) * 0x101, size: 2 });
  }
  if ((m = /^\/api\/mask\/([^/]+)\/(\d+)$/.exec(path))) return picture(made, m[1], Number(m[2]), { ground: 0, dot: () => 0x788c3ce6, size: 5 });
  if (path === '/api/mesh/head') return mesh(ellipsoid(HEAD, 24, 36));
  if ((m = /^\/api\/mesh\/hull\/(\d+)$/.exec(path))) return mesh(ellipsoid([140, 150, 190], 20, 30));
  if ((m = /^\/api\/lines\/(\d+)$/.exec(path))) return lines(made, Number(m[1]));
  if ((m = /^\/api\/arrows\/(\d+)$/.exec(path))) return arrows(made, Number(m[1]), Number(query.get('most') ?? 2000));
  throw new Refused(404, `no such thing: ${path}`);
}

// ---- serving ----------------------------------------------------------------------------------------------------------

const PAGE = { '/': ['index.html', 'text/html'], '/app.js': ['app.js', 'text/javascript'], '/app.css': ['app.css', 'text/css'] };

export async function serve({ strands = 8000, frames = 200, points = 32, views = 7, port = 0 } = {}) {
  const made = make({ strands, frames, points, views });
  const token = randomBytes(16).toString('hex');
  const server = createServer(async (request, response) => {
    const url = new URL(request.url, 'http://127.0.0.1');
    const head = { 'Content-Security-Policy': CSP, 'Cache-Control': 'no-store', 'X-Content-Type-Options': 'nosniff' };
    try {
      const page = PAGE[url.pathname];
      if (page) {
        const body = await readFile(new URL(`../dist/${page[0]}`, import.meta.url));
        response.writeHead(200, { ...head, 'Content-Type': `${page[1]}; charset=utf-8` }).end(body);
        return;
      }
      if (request.headers.authorization !== `Bearer ${token}`) throw new Refused(401, 'the token is missing or wrong', 'open the printed address');
      const { type, body } = answer(made, url.pathname, url.searchParams);
      response.writeHead(200, { ...head, 'Content-Type': type }).end(body);
    } catch (error) {
      const status = error.status ?? 500;
      response.writeHead(status, { ...head, 'Content-Type': 'application/json' }).end(JSON.stringify({ error: error.message, hint: error.hint ?? '' }));
    }
  });
  await new Promise((done) => server.listen(port, '127.0.0.1', done));
  return { url: `http://127.0.0.1:${server.address().port}/?token=${token}`, close: () => {
    server.close();
    server.closeAllConnections();
  } };
}

if (process.argv[1] === new URL(import.meta.url).pathname) {
  const options = {};
  for (let i = 2; i + 1 < process.argv.length; i += 2) options[process.argv[i].slice(2)] = Number(process.argv[i + 1]);
  console.log((await serve(options)).url);
}
