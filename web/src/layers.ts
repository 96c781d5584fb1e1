// What stands around the strands: head, cameras, hull, lines, arrows, roots and floor. All in world space, mm.

import * as THREE from 'three';
import { MAPS, tableColour } from './colour.ts';
import { MISSING } from './protocol.ts';
import type { Mesh, Rows, Strands, Take, View } from './protocol.ts';

export interface Inks {
  background: string;
  line: string;
  faint: string;
  head: string;
  hull: string;
  accent: string;
}

export const matrix = (rowMajor: number[]) => new THREE.Matrix4().fromArray(rowMajor).transpose();

function surface(mesh: Mesh): THREE.BufferGeometry {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute('position', new THREE.BufferAttribute(mesh.vertices, 3));
  geometry.setIndex(new THREE.BufferAttribute(mesh.faces, 1));
  geometry.computeVertexNormals();
  return geometry;
}

export class Head {
  readonly object = new THREE.Mesh(new THREE.BufferGeometry(), new THREE.MeshStandardMaterial({ roughness: 0.85, side: THREE.DoubleSide }));
  private shown: Mesh | null = null;
  /** How many things it has shown so far. */
  shows = 0;

  constructor() {
    this.object.matrixAutoUpdate = false;
    // Roots lie on the surface: it steps back a little so as not to cut them off.
    this.object.material.polygonOffset = true;
    this.object.material.polygonOffsetFactor = 2;
    this.object.material.polygonOffsetUnits = 2;
  }

  show(mesh: Mesh | undefined): void {
    if (!mesh || mesh === this.shown) return;
    this.shown = mesh;
    this.shows += 1;
    this.object.geometry.dispose();
    this.object.geometry = surface(mesh);
  }

  get known(): boolean {
    return this.shown !== null;
  }
}

export class Hull {
  readonly object: THREE.Group;
  private readonly material = new THREE.MeshLambertMaterial({ transparent: true, opacity: 0.2, depthWrite: false, side: THREE.FrontSide });
  private readonly mesh = new THREE.Mesh(new THREE.BufferGeometry(), this.material);
  private shown: Mesh | null = null;
  /** How many things it has shown so far. */
  shows = 0;

  constructor() {
    this.object = new THREE.Group().add(this.mesh);
    this.mesh.renderOrder = 5;
  }

  show(mesh: Mesh | undefined): void {
    if (!mesh || mesh === this.shown) return;
    this.shown = mesh;
    this.shows += 1;
    this.mesh.geometry.dispose();
    this.mesh.geometry = surface(mesh);
  }

  ink(colour: string): void {
    this.material.color.set(colour);
  }
}

/** Short strokes along lifted lines, by their confidence. */
export class Lines {
  readonly object = new THREE.LineSegments(new THREE.BufferGeometry(), new THREE.LineBasicMaterial({ vertexColors: true }));
  private shown: Rows | null = null;
  /** How many things it has shown so far. */
  shows = 0;

  show(rows: Rows | undefined): void {
    if (!rows || rows === this.shown) return;
    this.shown = rows;
    this.shows += 1;
    const half = 2;
    const places = new Float32Array(rows.count * 6);
    const colours = new Uint8Array(rows.count * 6);
    for (let i = 0; i < rows.count; i++) {
      const r = rows.rows.subarray(i * 7, i * 7 + 7);
      for (let k = 0; k < 3; k++) {
        places[i * 6 + k] = r[k] - half * r[k + 3];
        places[i * 6 + 3 + k] = r[k] + half * r[k + 3];
      }
      const colour = tableColour(MAPS.viridis, Math.round(255 * Math.min(1, Math.max(0, r[6]))));
      colours.set(colour, i * 6);
      colours.set(colour, i * 6 + 3);
    }
    this.object.geometry.dispose();
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(places, 3));
    // Normalised colours count as linear; the strokes are small, and lighter is easier to see.
    geometry.setAttribute('color', new THREE.BufferAttribute(colours, 3, true));
    this.object.geometry = geometry;
  }
}

/** Velocities as slender arrows: their length is the way of `seconds`, their colour the speed. */
export class Arrows {
  readonly object = new THREE.Group();
  private mesh: THREE.InstancedMesh | null = null;
  private readonly shape = arrow();
  private readonly material = new THREE.MeshBasicMaterial();
  private shown: Rows | null = null;
  /** How many things it has shown so far. */
  shows = 0;
  fastest = 0;
  /** A round number, such that fast arrows are about as long as a finger is wide. */
  seconds = 0.1;

  show(rows: Rows | undefined): void {
    if (!rows || rows === this.shown) return;
    this.shown = rows;
    this.shows += 1;
    if (this.mesh) {
      this.object.remove(this.mesh);
      this.mesh.dispose();
    }
    this.mesh = new THREE.InstancedMesh(this.shape, this.material, rows.count);
    this.mesh.frustumCulled = false;
    const speeds = Array.from({ length: rows.count }, (_, i) => Math.hypot(...rows.rows.subarray(i * 6 + 3, i * 6 + 6)));
    this.fastest = [...speeds].sort((a, b) => a - b)[Math.floor(speeds.length * 0.98)] || 1;
    this.seconds = [0.2, 0.1, 0.05, 0.02, 0.01, 0.005].find((t) => this.fastest * t < 40) ?? 0.002;
    const [at, along, up] = [new THREE.Vector3(), new THREE.Vector3(), new THREE.Vector3(0, 1, 0)];
    const [turn, size, all, colour] = [new THREE.Quaternion(), new THREE.Vector3(), new THREE.Matrix4(), new THREE.Color()];
    for (let i = 0; i < rows.count; i++) {
      at.fromArray(rows.rows, i * 6);
      along.fromArray(rows.rows, i * 6 + 3);
      const length = Math.max(0.5, speeds[i] * this.seconds);
      turn.setFromUnitVectors(up, along.normalize());
      const thick = Math.min(2.6, 0.7 + length * 0.06);
      size.set(thick, length, thick);
      this.mesh.setMatrixAt(i, all.compose(at, turn, size));
      const [r, g, b] = tableColour(MAPS.viridis, Math.round(255 * Math.min(1, speeds[i] / this.fastest)));
      this.mesh.setColorAt(i, colour.setRGB(r / 255, g / 255, b / 255, THREE.SRGBColorSpace));
    }
    this.object.add(this.mesh);
  }
}

/** An arrow of length 1 along y: a thin shaft and a head, five-sided. */
function arrow(): THREE.BufferGeometry {
  const rings: [number, number][] = [[0.22, 0], [0.22, 0.68], [0.8, 0.68], [0, 1]];
  return new THREE.LatheGeometry(rings.map(([r, y]) => new THREE.Vector2(r, y)), 5);
}

export class Roots {
  readonly object: THREE.Points<THREE.BufferGeometry, THREE.PointsMaterial>;
  private shown: Strands | null = null;
  /** How many things it has shown so far. */
  shows = 0;

  constructor() {
    this.object = new THREE.Points(new THREE.BufferGeometry(), new THREE.PointsMaterial({ size: 3, sizeAttenuation: false }));
  }

  show(s: Strands | undefined): void {
    if (!s || s === this.shown) return;
    this.shown = s;
    this.shows += 1;
    const places: number[] = [];
    for (let i = 0; i < s.strands; i++) {
      const at = i * s.points * 3;
      if (s.xyz[at] !== MISSING) for (let k = 0; k < 3; k++) places.push(s.lo[k] + s.xyz[at + k] * s.step[k]);
    }
    this.object.geometry.dispose();
    this.object.geometry = new THREE.BufferGeometry().setAttribute('position', new THREE.Float32BufferAttribute(places, 3));
  }

  ink(colour: string): void {
    this.object.material.color.set(colour);
  }
}

/** A camera's pyramid, with its picture at the far end on demand. */
export class Frustum {
  readonly object = new THREE.Group();
  readonly apex: THREE.Vector3;
  private readonly edges: THREE.LineSegments<THREE.BufferGeometry, THREE.LineBasicMaterial>;
  private readonly plane: THREE.Mesh<THREE.BufferGeometry, THREE.MeshBasicMaterial>;
  private shown: ImageBitmap | null = null;

  constructor(readonly view: View, depth: number) {
    this.object.matrixAutoUpdate = false;
    this.object.matrix.copy(matrix(view.camera_from_world)).invert();
    this.apex = new THREE.Vector3(...view.center);
    const corner = (u: number, v: number) => [((u - view.cx) / view.fx) * depth, ((v - view.cy) / view.fy) * depth, depth];
    const [a, b, c, d] = [corner(0, 0), corner(view.width, 0), corner(view.width, view.height), corner(0, view.height)];
    // The tick shows which side is up.
    const [t1, t2, t3] = [corner(view.width * 0.4, -view.height * 0.04), corner(view.width * 0.5, -view.height * 0.16), corner(view.width * 0.6, -view.height * 0.04)];
    const o = [0, 0, 0];
    const pairs = [o, a, o, b, o, c, o, d, a, b, b, c, c, d, d, a, t1, t2, t2, t3, t3, t1];
    const lines = new THREE.BufferGeometry().setAttribute('position', new THREE.Float32BufferAttribute(pairs.flat(), 3));
    this.edges = new THREE.LineSegments(lines, new THREE.LineBasicMaterial({ transparent: true, opacity: 0.8 }));
    const quad = new THREE.BufferGeometry();
    quad.setAttribute('position', new THREE.Float32BufferAttribute([...a, ...b, ...c, ...d], 3));
    // An ImageBitmap's first row is its top one.
    quad.setAttribute('uv', new THREE.Float32BufferAttribute([0, 0, 1, 0, 1, 1, 0, 1], 2));
    quad.setIndex([0, 1, 2, 0, 2, 3]);
    this.plane = new THREE.Mesh(quad, new THREE.MeshBasicMaterial({ side: THREE.DoubleSide }));
    this.plane.visible = false;
    this.object.add(this.edges, this.plane);
  }

  ink(colour: string): void {
    this.edges.material.color.set(colour);
  }

  /** A camera that one looks along would stand before what it films. */
  stepAside(eye: THREE.Vector3, target: THREE.Vector3): void {
    const [to, from] = [this.apex.clone().sub(target).normalize(), eye.clone().sub(target).normalize()];
    this.aside = to.dot(from) > 0.955;
    for (const child of this.object.children) child.layers.set(this.aside ? 1 : 0);
  }

  aside = false;

  picture(bitmap: ImageBitmap | undefined | null): void {
    this.plane.visible = bitmap !== null && (bitmap !== undefined || this.shown !== null);
    if (!bitmap || bitmap === this.shown) return;
    this.shown = bitmap;
    const material = this.plane.material;
    material.map?.dispose();
    material.map = new THREE.Texture(bitmap);
    material.map.colorSpace = THREE.SRGBColorSpace;
    material.map.flipY = false;
    material.map.generateMipmaps = false;
    material.map.minFilter = THREE.LinearFilter;
    material.map.needsUpdate = true;
    material.needsUpdate = true;
  }
}

/** A grid below the hair, across gravity, with 100 mm squares. */
export class Floor {
  readonly object: THREE.LineSegments<THREE.BufferGeometry, THREE.LineBasicMaterial>;

  constructor(take: Take) {
    const down = downwards(take);
    const [lo, hi] = [new THREE.Vector3(...take.bounds.lo), new THREE.Vector3(...take.bounds.hi)];
    const middle = lo.clone().add(hi).multiplyScalar(0.5);
    const size = hi.clone().sub(lo);
    const below = (Math.abs(size.x * down.x) + Math.abs(size.y * down.y) + Math.abs(size.z * down.z)) * 0.5 + 90;
    const half = 5;
    const places: number[] = [];
    for (let i = -half; i <= half; i++) {
      places.push(i * 100, 0, -half * 100, i * 100, 0, half * 100, -half * 100, 0, i * 100, half * 100, 0, i * 100);
    }
    this.object = new THREE.LineSegments(
      new THREE.BufferGeometry().setAttribute('position', new THREE.Float32BufferAttribute(places, 3)),
      new THREE.LineBasicMaterial({ transparent: true, opacity: 0.5 }),
    );
    this.object.position.copy(middle).addScaledVector(down, below);
    this.object.quaternion.setFromUnitVectors(new THREE.Vector3(0, -1, 0), down);
  }

  ink(colour: string): void {
    this.object.material.color.set(colour);
  }
}

const downwards = (take: Take) => {
  const down = new THREE.Vector3(...take.gravity).normalize();
  return down.lengthSq() > 0 ? down : down.set(0, -1, 0);
};

/** A small picture in the corner: the world's axes (x red, y green, z blue), and an arrow that falls. */
export class Compass {
  static readonly SIZE = 76;
  private readonly scene = new THREE.Scene();
  private readonly camera = new THREE.OrthographicCamera(-1.15, 1.15, 1.15, -1.15, 0, 10);
  private readonly fall: THREE.ArrowHelper;
  private readonly turned = new THREE.Group();

  constructor(take: Take) {
    const axes = new THREE.AxesHelper(0.8);
    axes.setColors('#e0524d', '#5aa832', '#4a86e0');
    this.fall = new THREE.ArrowHelper(downwards(take), new THREE.Vector3(), 1, 0xffffff, 0.3, 0.18);
    this.scene.add(this.turned.add(axes, this.fall));
  }

  ink(colour: string): void {
    this.fall.setColor(colour);
  }

  draw(renderer: THREE.WebGLRenderer, eye: THREE.Camera, world: THREE.Matrix4): void {
    this.turned.quaternion.setFromRotationMatrix(world);
    this.camera.quaternion.copy(eye.quaternion);
    this.camera.position.set(0, 0, 5).applyQuaternion(eye.quaternion);
    renderer.clearDepth();
    renderer.render(this.scene, this.camera);
  }
}
