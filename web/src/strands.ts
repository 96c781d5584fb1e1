// Strands as ribbons that face the camera. What the program sends is what the graphics card gets: positions stay 16 bit
// integers in a texture, and each vertex looks up its point and those beside it. (Instanced segments would do without an index,
// but many graphics drivers, and all software ones, are slow at instances of four vertices.)

import * as THREE from 'three';
import { MISSING } from './protocol.ts';
import type { Strands } from './protocol.ts';
import type { Rgb, Table } from './colour.ts';

/** Stands for "no value": safer to test for in a shader than NaN. */
const NO_VALUE = -3e38;

/** Texels in a row of the textures. */
const ROW = 1024;

const VERTEX = /* glsl */ `
precision highp usampler2D;
uniform usampler2D places;
uniform sampler2D values, table, drawn;
uniform vec3 lo, cell;
uniform int points, first, stride;
uniform float width, widening, pixel, leastPixels, reach;
uniform bool filtered, perStrand;
uniform vec3 middle;
uniform int colouring;          // 0 hair, 1 by value, 2 one colour
uniform vec2 range;
uniform vec3 flatColour, hairRoot, hairTip, noValue;

// Light is reckoned at the points, a few millimetres apart. Nothing but the colour goes on to the pixels: whatever is
// interpolated is paid for by each of half a million small triangles.
#ifdef STEPPED
flat
#endif
varying vec3 vColour;

ivec2 texel(int i) { return ivec2(i % ${ROW}, i / ${ROW}); }
bool missing(uvec3 p) { return p.x == ${MISSING}u; }
vec3 place(uvec3 p) { return (modelViewMatrix * vec4(lo + vec3(p) * cell, 1.0)).xyz; }

float random(int n) {
  uint h = uint(n) * 2654435769u;
  h ^= h >> 16; h *= 2246822519u; h ^= h >> 13;
  return float(h & 65535u) / 65535.0;
}

// Kajiya and Kay: a thin cylinder is lit by the sine of the angle between tangent and light.
float sine(vec3 t, vec3 l) { float c = dot(t, l); return sqrt(max(0.0, 1.0 - c * c)); }

// Tangent, direction to the eye, way out of the head, share of the way to the tip.
vec3 lit(vec3 t, vec3 v, vec3 n, float toTip, int strand, vec3 base) {
  vec3 light = normalize(vec3(-0.45, 0.75, 0.6));
  vec3 fill = normalize(vec3(0.8, 0.1, 0.5));
  // The head of hair as a whole is round: strands on its side away from the light get less.
  float facing = 0.5 + 0.5 * dot(n, light);
  float diffuse = sine(t, light) * mix(0.25, 1.0, facing);
  float second = sine(t, fill) * (0.5 + 0.5 * dot(n, fill));
  float depth = mix(0.62, 1.0, smoothstep(0.0, 0.3, toTip));
  // Light enough that a colour stays the one of the legend.
  if (colouring != 0) return base * (0.6 + 0.34 * diffuse + 0.14 * second) * mix(0.85, 1.0, depth);
  float seed = random(strand);
  vec3 h = normalize(light + v);
  float shine = pow(sine(normalize(t + n * (0.10 + 0.06 * seed)), h), 90.0);
  float glow = pow(sine(normalize(t - n * 0.12), h), 18.0);
  vec3 colour = base * (0.82 + 0.36 * seed) * (0.16 + 1.05 * diffuse + 0.35 * second);
  return (colour + (mix(hairTip, vec3(1.0), 0.35) * 0.42 * shine + hairTip * 0.8 * glow) * facing * facing) * depth;
}

vec3 baseColour(int row, int index, float toTip) {
  if (colouring == 0) return mix(hairRoot, hairTip, smoothstep(0.0, 0.75, toTip));
  if (colouring == 2) return flatColour;
  float value = texelFetch(values, texel(perStrand ? row : index), 0).r;
  if (value < -1e38) return noValue;
  float at = clamp((value - range.x) / (range.y - range.x), 0.0, 1.0);
  return texelFetch(table, ivec2(int(at * 255.0 + 0.5), 0), 0).rgb;
}

void main() {
  int index = gl_VertexID >> 1;
  float across = float(gl_VertexID & 1) * 2.0 - 1.0;
  int row = index / points;
  int point = index - row * points;
  int strand = first + row * stride;

  uvec3 here = texelFetch(places, texel(index), 0).xyz;
  uvec3 before = point > 0 ? texelFetch(places, texel(index - 1), 0).xyz : uvec3(${MISSING}u);
  uvec3 after = point < points - 1 ? texelFetch(places, texel(index + 1), 0).xyz : uvec3(${MISSING}u);

  // A missing point falls onto one beside it, and its colour says that no pixel of its segments is to be kept.
  vColour = vec3(-1e4);
  gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  if (filtered && texelFetch(drawn, ivec2(strand & 255, strand >> 8), 0).r < 0.5) return;
  bool gap = missing(here);
  if (gap) here = missing(before) ? after : before;
  if (missing(here)) return;

  vec3 p = place(here);
  vec3 along = (missing(after) ? p : place(after)) - (missing(before) ? p : place(before));
  vec3 tangent = dot(along, along) < 1e-10 ? vec3(0.0, 1.0, 0.0) : normalize(along);
  vec3 eye = normalize(-p);

  // By distance, not by number: a strand looks the same with few points as with many, and has its own length.
  uvec3 root = texelFetch(places, texel(row * points), 0).xyz;
  float toTip = missing(root) ? 0.5 : min(1.0, distance(p, place(root)) / reach);
  // Hair thins towards its tip. Thinner than about a pixel it would fall between the samples and break up into dashes.
  float millimetres = width * widening * (1.0 - 0.55 * toTip * toTip);
  float wide = max(millimetres, leastPixels * pixel * -p.z);
  vec3 side = cross(eye, tangent);
  side = dot(side, side) < 1e-8 ? vec3(1.0, 0.0, 0.0) : normalize(side);
  gl_Position = projectionMatrix * vec4(p + side * across * 0.5 * wide, 1.0);
  if (gap) return;

  vec3 outwards = normalize(p - (viewMatrix * vec4(middle, 1.0)).xyz);
  vColour = lit(tangent, eye, outwards, toTip, strand, baseColour(row, index, toTip));
}`;

const FRAGMENT = /* glsl */ `
#ifdef STEPPED
flat
#endif
varying vec3 vColour;

void main() {
  if (vColour.r < 0.0) discard;
  gl_FragColor = vec4(vColour, 1.0);
  #include <colorspace_fragment>
}`;

type Texels<T> = THREE.DataTexture & { image: { data: T; width: number; height: number } };

function integers(rows: number): Texels<Uint16Array> {
  // three passes on WebGL's own name for a format; its constant for this one is not known to its WebGL renderer.
  const format = 'RGB_INTEGER' as unknown as THREE.PixelFormat;
  const texture = new THREE.DataTexture(new Uint16Array(ROW * rows * 3), ROW, rows, format, THREE.UnsignedShortType);
  texture.internalFormat = 'RGB16UI';
  return texture as Texels<Uint16Array>;
}

const floats = (rows: number) =>
  new THREE.DataTexture(new Float32Array(ROW * rows), ROW, rows, THREE.RedFormat, THREE.FloatType) as Texels<Float32Array>;

/** The same texture where it has the right number of rows, else another in its stead. */
function sized<T extends THREE.DataTexture>(texture: T, texels: number, make: (rows: number) => T): T {
  const rows = Math.max(1, Math.ceil(texels / ROW));
  if (texture.image.height === rows) return texture;
  texture.dispose();
  return make(rows);
}

/** Two triangles a segment; their last vertex is of the segment's start, which is the one that flat values come from. */
function ribbons(strands: number, points: number): THREE.BufferGeometry {
  const index = new Uint32Array(strands * (points - 1) * 6);
  let at = 0;
  for (let strand = 0; strand < strands; strand++) {
    for (let point = 0; point < points - 1; point++) {
      const a = (strand * points + point) * 2;
      index[at++] = a + 2;
      index[at++] = a + 1;
      index[at++] = a;
      index[at++] = a + 2;
      index[at++] = a + 3;
      index[at++] = a + 1;
    }
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setIndex(new THREE.BufferAttribute(index, 1));
  return geometry;
}

/** Ribbons of the shapes that were shown lately: coarse and full take turns. */
const SHAPES_KEPT = 3;

export class StrandCloud {
  readonly mesh: THREE.Mesh<THREE.BufferGeometry, THREE.ShaderMaterial>;
  strands = 0;
  points = 0;
  private readonly shapes = new Map<string, THREE.BufferGeometry>();
  private readonly uniforms;
  private shown: Strands | null = null;
  private shownValues: Float32Array | null = null;

  /** `reach`: mm from the root over which hair takes on the look of its tips. */
  constructor(reach: number) {
    const byte = () => new THREE.DataTexture(new Uint8Array(4), 1, 1);
    this.uniforms = {
      places: { value: integers(1) },
      values: { value: floats(1) },
      lo: { value: new THREE.Vector3() },
      cell: { value: new THREE.Vector3() },
      points: { value: 2 },
      first: { value: 0 },
      stride: { value: 1 },
      width: { value: 0.5 },
      widening: { value: 1 },
      pixel: { value: 0.001 },
      reach: { value: reach },
      leastPixels: { value: 0.8 },
      filtered: { value: false },
      perStrand: { value: false },
      drawn: { value: byte() },
      middle: { value: new THREE.Vector3() },
      colouring: { value: 0 },
      table: { value: byte() },
      range: { value: new THREE.Vector2(0, 1) },
      flatColour: { value: new THREE.Color() },
      hairRoot: { value: new THREE.Color('#3a2418') },
      hairTip: { value: new THREE.Color('#9a6a3c') },
      noValue: { value: new THREE.Color('#8a8a8a') },
    };
    const material = new THREE.ShaderMaterial({ vertexShader: VERTEX, fragmentShader: FRAGMENT, uniforms: this.uniforms, side: THREE.DoubleSide });
    this.mesh = new THREE.Mesh(new THREE.BufferGeometry(), material);
    this.mesh.frustumCulled = false;
    this.mesh.visible = false;
  }

  private shape(strands: number, points: number): THREE.BufferGeometry {
    const key = `${strands} ${points}`;
    const geometry = this.shapes.get(key) ?? ribbons(strands, points);
    this.shapes.delete(key);
    this.shapes.set(key, geometry);
    for (const [old, unused] of this.shapes) {
      if (this.shapes.size <= SHAPES_KEPT) break;
      unused.dispose();
      this.shapes.delete(old);
    }
    return geometry;
  }

  /** Shows strands `first`, `first + stride`, ...; the card is sent only what is new. */
  show(s: Strands, first: number, stride: number): void {
    this.mesh.visible = s.strands > 0 && s.points > 1;
    if (s === this.shown) return;
    this.shown = s;
    this.shownValues = null;
    this.strands = s.strands;
    this.points = s.points;
    this.mesh.geometry = this.shape(s.strands, s.points);
    const u = this.uniforms;
    u.places.value = sized(u.places.value, s.strands * s.points, integers);
    u.places.value.image.data.set(s.xyz);
    u.places.value.needsUpdate = true;
    u.lo.value.fromArray(s.lo);
    u.cell.value.fromArray(s.step);
    u.points.value = s.points;
    u.first.value = first;
    u.stride.value = stride;
    // Fewer strands are drawn wider, so that the hair stays about as dense.
    u.widening.value = Math.sqrt(stride);
  }

  hide(): void {
    this.mesh.visible = false;
  }

  /** Categories do not blend into one another along a segment: it has the one of its start. */
  private stepped(on: boolean): void {
    const { material } = this.mesh;
    if (on === 'STEPPED' in material.defines) return;
    material.defines = on ? { STEPPED: '' } : {};
    material.needsUpdate = true;
  }

  hair(): void {
    this.stepped(false);
    this.uniforms.colouring.value = 0;
  }

  flat([r, g, b]: Rgb): void {
    this.stepped(false);
    this.uniforms.colouring.value = 2;
    this.uniforms.flatColour.value.setRGB(r / 255, g / 255, b / 255, THREE.SRGBColorSpace);
  }

  /** `values`: one a point, or one a strand. */
  coloured(values: Float32Array, table: Table, range: [number, number], stepped: boolean): void {
    const u = this.uniforms;
    u.colouring.value = 1;
    u.range.value.fromArray(range);
    this.stepped(stepped);
    if (u.table.value.image.data !== table) {
      u.table.value.dispose();
      u.table.value = new THREE.DataTexture(table, 256, 1);
      u.table.value.colorSpace = THREE.SRGBColorSpace;
      u.table.value.needsUpdate = true;
    }
    if (values === this.shownValues) return;
    this.shownValues = values;
    u.perStrand.value = values.length === this.strands;
    u.values.value = sized(u.values.value, values.length, floats);
    const out = u.values.value.image.data;
    for (let i = 0; i < values.length; i++) out[i] = values[i] > -Infinity && values[i] < Infinity ? values[i] : NO_VALUE;
    u.values.value.needsUpdate = true;
  }

  /** Draws only the strands of these numbers; null: all. */
  only(numbers: Iterable<number> | null, total: number): void {
    const u = this.uniforms;
    u.filtered.value = numbers !== null;
    if (!numbers) return;
    const rows = Math.ceil(total / 256);
    const data = new Uint8Array(256 * rows);
    for (const n of numbers) data[n] = 255;
    u.drawn.value.dispose();
    u.drawn.value = new THREE.DataTexture(data, 256, rows, THREE.RedFormat);
    u.drawn.value.needsUpdate = true;
  }

  /** Everything that depends on the camera and the window: `pixel` is the size of a pixel at distance 1. */
  prepare(width: number, pixel: number, middle: THREE.Vector3): void {
    const u = this.uniforms;
    u.width.value = width;
    u.pixel.value = pixel;
    u.middle.value.copy(middle);
  }

  /** As a mark on top of everything else. */
  mark(): this {
    this.mesh.renderOrder = 10;
    this.mesh.material.depthTest = false;
    this.uniforms.leastPixels.value = 3;
    return this;
  }
}
