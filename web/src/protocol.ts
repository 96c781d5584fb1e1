// What the program sends (docs/view.md): the JSON of a take, and the binary bodies, which are read in place.

export type Vec3 = [number, number, number];

export interface View {
  name: string;
  width: number;
  height: number;
  fx: number;
  fy: number;
  cx: number;
  cy: number;
  /** Row-major 4×4, OpenCV axes. */
  camera_from_world: number[];
  center: Vec3;
  footage: boolean;
  held_out?: boolean;
}

export interface StrandSet {
  id: string;
  title: string;
  strands: number;
  points: number;
  /** Half open. */
  frames: [number, number];
  done: number[];
  attributes: string[];
}

export interface Attribute {
  name: string;
  /** What it is, in words. */
  title?: string;
  per: 'point' | 'strand';
  unit: string;
  range: [number, number];
  categories?: string[];
}

export interface Take {
  name: string;
  fps: number;
  frames: [number, number];
  gravity: Vec3;
  /** Row-major 4×4; null where a number is not finite. */
  world_from_head: { first: number; poses: (number | null)[][] };
  bounds: { lo: Vec3; hi: Vec3 };
  views: View[];
  sets: StrandSet[];
  attributes: Attribute[];
  layers: Record<string, boolean | undefined>;
  stages: { name: string; state: string; detail?: string }[];
  /** What is missing, and what to do about it. */
  notes?: { fact: string; hint: string }[];
}

export interface StrandDetails {
  frames: number[];
  length_mm: (number | null)[];
  speed_mm_s: (number | null)[];
  relative_speed_mm_s?: (number | null)[];
  error_mm?: (number | null)[];
  confidence?: number | null;
  provenance: Record<string, number>;
  parameters?: Record<string, number | null>;
  residual_mm?: number | null;
  points: number;
}

/** Positions of some strands of a frame, quantised: a position is `lo + xyz * step`; 65535 in x says that there is none. */
export interface Strands {
  strands: number;
  points: number;
  lo: Vec3;
  step: Vec3;
  xyz: Uint16Array;
}

/** One number a point, or one a strand where `points` is 1. */
export interface Values {
  strands: number;
  points: number;
  values: Float32Array;
}

/** Pixels of a view's image; NaN where there is none. */
export interface Projected {
  strands: number;
  points: number;
  uv: Float32Array;
}

export interface Mesh {
  vertices: Float32Array;
  faces: Uint32Array;
}

/** Rows of equally many numbers. */
export interface Rows {
  count: number;
  width: number;
  rows: Float32Array;
}

export const MISSING = 65535;

const MAGIC = 0x53465331;
const HEADER = 16;

function header(body: ArrayBuffer): [number, number, number] {
  if (body.byteLength < HEADER) throw new Error(`an answer of ${body.byteLength} bytes has no header`);
  const [magic, a, b, c] = new Uint32Array(body, 0, 4);
  if (magic !== MAGIC) throw new Error('the answer is not binary data of strandflow');
  return [a, b, c];
}

function sized(body: ArrayBuffer, bytes: number): void {
  if (body.byteLength !== bytes) throw new Error(`the answer has ${body.byteLength} bytes, its header promises ${bytes}`);
}

export function decodeStrands(body: ArrayBuffer): Strands {
  const [strands, points, bits] = header(body);
  if (bits !== 16) throw new Error(`positions of ${bits} bits, asked for 16`);
  sized(body, HEADER + 48 + strands * points * 6);
  const scale = new Float64Array(body, HEADER, 6);
  return {
    strands,
    points,
    lo: [scale[0], scale[1], scale[2]],
    step: [scale[3], scale[4], scale[5]],
    xyz: new Uint16Array(body, HEADER + 48),
  };
}

export function decodeValues(body: ArrayBuffer): Values {
  const [strands, points] = header(body);
  sized(body, HEADER + strands * points * 4);
  return { strands, points, values: new Float32Array(body, HEADER) };
}

export function decodeProjected(body: ArrayBuffer): Projected {
  const [strands, points] = header(body);
  sized(body, HEADER + strands * points * 8);
  return { strands, points, uv: new Float32Array(body, HEADER) };
}

export function decodeMesh(body: ArrayBuffer): Mesh {
  const [vertices, faces] = header(body);
  sized(body, HEADER + vertices * 12 + faces * 12);
  return {
    vertices: new Float32Array(body, HEADER, vertices * 3),
    faces: new Uint32Array(body, HEADER + vertices * 12, faces * 3),
  };
}

export const decodeRows = (width: number) => (body: ArrayBuffer): Rows => {
  const [count] = header(body);
  sized(body, HEADER + count * width * 4);
  return { count, width, rows: new Float32Array(body, HEADER) };
};

/** The position of a point, or null where it is missing. */
export function position(s: Strands, strand: number, point: number): Vec3 | null {
  const at = (strand * s.points + point) * 3;
  if (s.xyz[at] === MISSING) return null;
  return [s.lo[0] + s.xyz[at] * s.step[0], s.lo[1] + s.xyz[at + 1] * s.step[1], s.lo[2] + s.xyz[at + 2] * s.step[2]];
}

/** The head's pose in a frame, row-major; beyond the frames that have one, the nearest one's. */
export function poseAt({ first, poses }: Take['world_from_head'], frame: number): number[] | undefined {
  const at = Math.min(poses.length - 1, Math.max(0, frame - first));
  const known = (pose: (number | null)[] | undefined): pose is number[] => pose?.length === 16 && pose.every((v) => v !== null);
  for (let off = 0; off < poses.length; off++) {
    for (const pose of [poses[at - off], poses[at + off]]) if (known(pose)) return pose;
  }
  return undefined;
}
