// The 3D picture: one scene, one camera, one or two panes. It draws when something changed, and only then.

import * as THREE from 'three';
import { OrbitControls } from 'three/examples/jsm/controls/OrbitControls.js';
import { Arrows, Compass, Floor, Frustum, Head, Hull, Lines, Roots, matrix } from './layers.ts';
import type { Inks } from './layers.ts';
import type { Camera } from './state.ts';
import type { Take, Vec3, View } from './protocol.ts';
import { StrandCloud } from './strands.ts';

export interface Pane {
  x: number;
  y: number;
  width: number;
  height: number;
}

const FOV = 32;

export class Space {
  readonly renderer: THREE.WebGLRenderer;
  readonly camera = new THREE.PerspectiveCamera(FOV, 1, 5, 50000);
  readonly orbit: OrbitControls;
  readonly a: StrandCloud;
  readonly b: StrandCloud;
  readonly mark: StrandCloud;
  readonly head = new Head();
  readonly hull = new Hull();
  readonly lines = new Lines();
  readonly arrows = new Arrows();
  readonly roots = new Roots();
  readonly floor: Floor;
  private readonly compass: Compass;
  readonly frusta: Frustum[];
  /** Holds all that is in world space; turned back by the head's motion, the head stands still. */
  private readonly world = new THREE.Group();
  private readonly scene = new THREE.Scene();
  private readonly middle = new THREE.Vector3();
  private dirty = true;
  split = false;
  width = 0.5;
  renders = 0;

  constructor(private readonly canvas: HTMLCanvasElement, private readonly take: Take, private readonly drawn: () => void, private readonly took: (ms: number) => void) {
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, powerPreference: 'high-performance' });
    this.renderer.autoClear = false;
    const down = new THREE.Vector3(...take.gravity);
    if (down.lengthSq() > 0) this.camera.up.copy(down).normalize().negate();
    this.orbit = new OrbitControls(this.camera, canvas);
    this.orbit.zoomToCursor = true;
    this.orbit.zoomSpeed = 1.4;
    this.orbit.addEventListener('change', () => this.touch());
    const [a, b, mark] = Array.from({ length: 3 }, () => new StrandCloud(this.size() * 0.6));
    [this.a, this.b, this.mark] = [a, b, mark.mark()];
    this.floor = new Floor(take);
    this.compass = new Compass(take);
    const reach = this.size() * 0.2;
    this.frusta = take.views.map((view) => new Frustum(view, reach));
    this.head.object.matrixAutoUpdate = false;
    this.world.matrixAutoUpdate = false;
    this.world.add(
      this.a.mesh, this.b.mesh, this.mark.mesh, this.head.object, this.hull.object, this.lines.object, this.arrows.object,
      this.roots.object, this.floor.object, ...this.frusta.map((f) => f.object),
    );
    const key = new THREE.DirectionalLight(0xffffff, 2.1);
    key.position.set(-0.45, 0.75, 0.6);
    // Lights go with the camera: hair is lit from the same side whatever side is looked at.
    this.camera.add(key, key.target, new THREE.HemisphereLight(0xffffff, 0x8d8478, 0.9));
    this.scene.add(this.world, this.camera);
    new ResizeObserver(() => this.resize()).observe(canvas);
    canvas.addEventListener('webglcontextrestored', () => this.touch());
    const loop = () => {
      requestAnimationFrame(loop);
      if (this.done() && this.dirty) this.draw();
    };
    requestAnimationFrame(loop);
  }

  /**
   * Whether the card has finished the last picture. None is begun before: pictures that queue up there are late when they
   * appear, and all else on the page waits for them.
   */
  private done(): boolean {
    if (!this.pending) return true;
    const gl = this.renderer.getContext() as WebGL2RenderingContext;
    if (!gl.isContextLost() && gl.getSyncParameter(this.pending.sync, gl.SYNC_STATUS) !== gl.SIGNALED) return false;
    gl.deleteSync(this.pending.sync);
    this.took(performance.now() - this.pending.since);
    this.pending = null;
    return true;
  }

  private pending: { sync: WebGLSync; since: number } | null = null;

  get busy(): boolean {
    return this.pending !== null || this.dirty;
  }

  touch(): void {
    this.dirty = true;
  }

  private size(): number {
    return new THREE.Vector3(...this.take.bounds.hi).distanceTo(new THREE.Vector3(...this.take.bounds.lo)) || 500;
  }

  private center(): THREE.Vector3 {
    return new THREE.Vector3(...this.take.bounds.hi).add(new THREE.Vector3(...this.take.bounds.lo)).multiplyScalar(0.5);
  }

  /**
   * The first look: from the side of the capture camera that has most of the hair before it. Hair hangs beside and behind
   * the head, so that is the camera towards which the middle of the hair lies off the middle of the head.
   */
  home(head: THREE.Vector3 | null): Camera {
    const center = this.center();
    const lean = head ? center.clone().sub(head) : new THREE.Vector3();
    lean.addScaledVector(this.camera.up, -lean.dot(this.camera.up));
    let [best, score] = [new THREE.Vector3(), -Infinity];
    for (const view of this.take.views) {
      const towards = new THREE.Vector3(...view.center).sub(center).normalize();
      const s = towards.dot(lean) - 0.3 * Math.abs(towards.dot(this.camera.up)) * lean.length();
      if (s > score) [best, score] = [towards, s];
    }
    if (this.take.views.length === 0) best.set(0.4, 0.2, 1).normalize();
    const distance = (this.size() * 0.52) / Math.tan((FOV * Math.PI) / 360);
    return { position: center.clone().addScaledVector(best, distance).toArray(), target: center.toArray() };
  }

  /** Where a capture camera stands and what it looks at. */
  through(view: View): Camera {
    const eye = new THREE.Vector3(...view.center);
    const axis = new THREE.Vector3(...(view.camera_from_world.slice(8, 11) as Vec3)).normalize();
    const distance = this.center().sub(eye).dot(axis);
    return { position: view.center, target: eye.clone().addScaledVector(axis, Math.max(50, distance)).toArray() };
  }

  look({ position, target }: Camera): void {
    this.camera.position.fromArray(position);
    this.orbit.target.fromArray(target);
    this.orbit.update();
    this.touch();
  }

  get looking(): Camera {
    return { position: this.camera.position.toArray(), target: this.orbit.target.toArray() };
  }

  /** Places the head; `follow`: the head stands still and the world moves. */
  pose(worldFromHead: number[] | undefined, follow: boolean): void {
    const head = worldFromHead ? matrix(worldFromHead) : new THREE.Matrix4();
    this.head.object.matrix.copy(head);
    this.world.matrix.copy(head).invert();
    if (!follow) this.world.matrix.identity();
    this.head.object.visible &&= this.head.known;
    const box = this.head.known ? this.headMiddle() : null;
    this.middle.copy(box ? box.applyMatrix4(head) : this.center()).applyMatrix4(this.world.matrix);
  }

  /** Changes whenever one of the layers got something else to show. */
  seen(): number {
    return [this.head, this.hull, this.lines, this.arrows, this.roots].reduce((sum, layer) => sum + layer.shows, 0);
  }

  /** In head space. */
  headMiddle(): THREE.Vector3 | null {
    if (!this.head.known) return null;
    const geometry = this.head.object.geometry;
    if (!geometry.boundingBox) geometry.computeBoundingBox();
    return geometry.boundingBox!.getCenter(new THREE.Vector3());
  }

  inks(inks: Inks): void {
    this.renderer.setClearColor(inks.background);
    this.head.object.material.color.set(inks.head);
    this.hull.ink(inks.hull);
    this.roots.ink(inks.accent);
    this.floor.ink(inks.faint);
    this.compass.ink(inks.line);
    for (const frustum of this.frusta) frustum.ink(inks.line);
    this.touch();
  }

  panes(): Pane[] {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!this.split) return [{ x: 0, y: 0, width, height }];
    const half = Math.floor(width / 2);
    return [{ x: 0, y: 0, width: half, height }, { x: half, y: 0, width: width - half, height }];
  }

  /** Column-major matrix from the strands' space to a pane's clip space. */
  clip(pane: Pane): number[] {
    this.aim(pane);
    this.scene.updateMatrixWorld();
    return new THREE.Matrix4().multiplyMatrices(this.camera.projectionMatrix, this.camera.matrixWorldInverse).multiply(this.world.matrixWorld).elements;
  }

  /** Where a place of the world lies in the first pane, CSS pixels; null behind the camera. */
  onScreen(place: THREE.Vector3): { x: number; y: number } | null {
    const p = place.clone().applyMatrix4(this.world.matrix).applyMatrix4(this.camera.matrixWorldInverse);
    if (p.z > -1) return null;
    p.applyMatrix4(this.camera.projectionMatrix);
    const pane = this.panes()[0];
    return { x: pane.x + (p.x * 0.5 + 0.5) * pane.width, y: (0.5 - p.y * 0.5) * pane.height };
  }

  private aim(pane: Pane): void {
    this.camera.aspect = pane.width / Math.max(1, pane.height);
    // A narrow pane shows the same width of the world, not the same height.
    const base = Math.tan((FOV * Math.PI) / 360);
    this.camera.fov = (360 / Math.PI) * Math.atan(base * Math.max(1, 0.95 / this.camera.aspect));
    this.camera.updateProjectionMatrix();
  }

  private resize(): void {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (width === 0 || height === 0) return;
    this.renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    this.renderer.setSize(width, height, false);
    this.touch();
  }

  private draw(): void {
    if (this.canvas.clientWidth === 0 || this.canvas.clientHeight === 0) return;
    this.dirty = false;
    const since = performance.now();
    const panes = this.panes();
    const [eye, target] = [this.camera.position, this.orbit.target].map((p) => p.clone().applyMatrix4(this.world.matrix.clone().invert()));
    for (const frustum of this.frusta) frustum.stepAside(eye, target);
    const ratio = this.renderer.getPixelRatio();
    const [a, b] = [this.a.mesh.visible, this.b.mesh.visible];
    this.renderer.setScissorTest(true);
    for (const [i, pane] of panes.entries()) {
      this.aim(pane);
      const pixel = (2 * Math.tan((this.camera.fov * Math.PI) / 360)) / Math.max(1, pane.height * ratio);
      for (const cloud of [this.a, this.b, this.mark]) cloud.prepare(cloud === this.mark ? this.width * 3 : this.width, pixel, this.middle);
      if (this.split) [this.a.mesh.visible, this.b.mesh.visible] = [a && i === 0, b && i === 1];
      this.renderer.setViewport(pane.x, pane.y, pane.width, pane.height);
      this.renderer.setScissor(pane.x, pane.y, pane.width, pane.height);
      this.renderer.clear();
      this.renderer.render(this.scene, this.camera);
    }
    [this.a.mesh.visible, this.b.mesh.visible] = [a, b];
    if (this.floor.object.visible) {
      const { x, width } = panes[panes.length - 1];
      const place = [x + width - Compass.SIZE - 10, 10, Compass.SIZE, Compass.SIZE] as const;
      this.renderer.setViewport(...place);
      this.renderer.setScissor(...place);
      this.compass.draw(this.renderer, this.camera, this.world.matrix);
    }
    this.renders += 1;
    const gl = this.renderer.getContext() as WebGL2RenderingContext;
    const sync = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    this.pending = sync && { sync, since };
    this.drawn();
  }
}
