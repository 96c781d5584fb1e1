// Lenses: normalised image coordinates through the lens and back, by the formulas of the program's geometry::lens.

import type { P2 } from './camera.ts';

/** As the program writes it. */
export type Lens =
  | 'none'
  /** k1, k2, p1, p2, k3 … k6 in OpenCV's order. */
  | { brown_conrady: number[] }
  /** The eight, thin prism s1 … s4, tilt of the sensor [rad]. */
  | { tilted: number[] }
  | { polynomial: PolynomialLens }
  /** The angle of the field-of-view model [rad]. */
  | { fov: number };

interface PolynomialLens {
  fisheye: boolean;
  radial: number[];
  tangential: number[];
  prism: number[];
  skew: number;
}

/** Beyond this angle to the axis a fisheye's ray has no place in the plane of normalised coordinates [rad]. */
const WIDEST = Math.PI / 2 - 1e-4;

const scaled = ([x, y]: P2, s: number): P2 => [x * s, y * s];

export function distort(lens: Lens, n: P2): P2 {
  if (lens === 'none') return n;
  if ('brown_conrady' in lens) return rational(lens.brown_conrady, n);
  if ('tilted' in lens) return tilted(lens.tilted, n);
  if ('fov' in lens) return scaled(n, fovScale(lens.fov, Math.hypot(...n)));
  return polynomial(lens.polynomial, lens.polynomial.fisheye ? bent(n) : n);
}

export function undistort(lens: Lens, seen: P2): P2 {
  if (lens === 'none') return seen;
  if ('fov' in lens) {
    const r = Math.hypot(...seen);
    const scale = 2 * Math.tan(lens.fov / 2);
    if (r * Math.abs(scale) < 1e-9 || lens.fov === 0) return seen;
    return scaled(seen, Math.tan(Math.min(r * lens.fov, WIDEST)) / scale / r);
  }
  // In the plane of angles, where the steps are even: tangents grow without bound.
  if ('polynomial' in lens && lens.polynomial.fisheye) return unbent(solve((at) => polynomial(lens.polynomial, at), seen));
  return solve((at) => distort(lens, at), seen);
}

/** Newton steps. */
function solve(through: (n: P2) => P2, [u, v]: P2): P2 {
  let [x, y] = [u, v];
  const h = 1e-6;
  for (let step = 0; step < 20; step++) {
    const at = through([x, y]);
    const [ex, ey] = [at[0] - u, at[1] - v];
    if (ex * ex + ey * ey < 1e-26) break;
    const [xp, xm, yp, ym] = [through([x + h, y]), through([x - h, y]), through([x, y + h]), through([x, y - h])];
    const [a, b, c, d] = [xp[0] - xm[0], yp[0] - ym[0], xp[1] - xm[1], yp[1] - ym[1]].map((e) => e / (2 * h));
    const det = a * d - b * c;
    if (!(Math.abs(det) > 1e-12)) break;
    x -= (d * ex - b * ey) / det;
    y -= (a * ey - c * ex) / det;
  }
  return [x, y];
}

function rational([k1, k2, p1, p2, k3, k4, k5, k6]: number[], [x, y]: P2): P2 {
  const r2 = x * x + y * y;
  const radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)));
  const [tx, ty] = tangential([p1, p2], [x, y]);
  return [x * radial + tx, y * radial + ty];
}

function tangential([p1, p2]: number[], [x, y]: P2): P2 {
  const r2 = x * x + y * y;
  return [2 * p1 * x * y + p2 * (r2 + 2 * x * x), p1 * (r2 + 2 * y * y) + 2 * p2 * x * y];
}

function tilted(terms: number[], [x, y]: P2): P2 {
  const [s1, s2, s3, s4, tiltX, tiltY] = terms.slice(8);
  const r2 = x * x + y * y;
  const [fx, fy] = rational(terms.slice(0, 8), [x, y]);
  const flat = [fx + r2 * (s1 + r2 * s2), fy + r2 * (s3 + r2 * s4), 1];
  // The plane of the sensor, turned about x and then about y, seen along the axis.
  const [sx, cx, sy, cy] = [Math.sin(-tiltX), Math.cos(-tiltX), Math.sin(-tiltY), Math.cos(-tiltY)];
  const turn = [[cy, sy * sx, sy * cx], [0, cx, -sx], [-sy, cy * sx, cy * cx]];
  const [px, py, pz] = turn.map((row) => row[0] * flat[0] + row[1] * flat[1] + row[2] * flat[2]);
  const [ax, ay, az] = turn.map((row) => row[2]);
  return [(az * px - ax * pz) / pz, (az * py - ay * pz) / pz];
}

function polynomial(lens: PolynomialLens, [x, y]: P2): P2 {
  const [k1, k2, k3, k4] = lens.radial;
  const r2 = x * x + y * y;
  const radial = 1 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)));
  const [tx, ty] = tangential(lens.tangential, [x, y]);
  const [u, v] = [x * radial + tx + lens.prism[0] * r2, y * radial + ty + lens.prism[1] * r2];
  return [u + lens.skew * v, v];
}

/** The point at the angle of the ray rather than its tangent. */
function bent(n: P2): P2 {
  const r = Math.hypot(...n);
  return r < 1e-9 ? n : scaled(n, Math.atan(r) / r);
}

function unbent(n: P2): P2 {
  const angle = Math.hypot(...n);
  return angle < 1e-9 ? n : scaled(n, Math.tan(Math.min(angle, WIDEST)) / angle);
}

function fovScale(angle: number, r: number): number {
  const scale = 2 * Math.tan(angle / 2);
  if (angle === 0) return 1;
  return r * Math.abs(scale) < 1e-9 ? scale / angle : Math.atan(r * scale) / (r * angle);
}
