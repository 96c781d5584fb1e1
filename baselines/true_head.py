"""Feeds the true head to the stages after `scalp`: what strands would be if the head under the hair were known.

    strandflow run TAKE --to scalp
    python true_head.py CAPTURE TAKE [--part nape]
    strandflow run TAKE --from orient

Rewrites the scalp of the take: surface and roots go along their ray from the middle of the head to the true head, as they
would be if the fit were exact; which part of it bears hair stays as found. Says how far that moves the roots, at the nape and
above it. Heights are along z. `run --verify` puts back what the program makes.
"""

import argparse

import numpy as np

import common

FADE_MM = (100.0, 130.0)
"""Below the vertex, where the nape begins: not yet, and wholly [mm]."""

LEAST_MM = 30.0
"""A ray on which the true head ends nearer than that has left it by the open neck: it keeps what was found."""


def reach(middle, ways, vertices, faces):
    """Distance from the middle along each way (unit, N×3) to the mesh, the farthest one; NaN where there is none [mm]."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    ab, ac, am = b - a, c - a, middle - a
    normal = np.cross(am, ab)
    height = np.einsum("ij,ij->i", ac, normal)
    found = np.full(len(ways), np.nan)
    with np.errstate(divide="ignore", invalid="ignore"):
        for i, way in enumerate(ways):
            across = np.cross(way, ac)
            scale = 1.0 / np.einsum("ij,ij->i", ab, across)
            u, v = np.einsum("ij,ij->i", am, across) * scale, normal @ way * scale
            far = (height * scale)[(u >= -1e-6) & (v >= -1e-6) & (u + v <= 1 + 1e-6)]
            far = far[np.isfinite(far) & (far >= LEAST_MM)]
            if len(far):
                found[i] = far.max()
    return found


def nearest(ways, to):
    """Number of the way (N×3, unit) that is nearest to each of `to` (M×3, unit)."""
    return np.concatenate([np.argmax(part @ ways.T, 1) for part in np.array_split(to, len(to) // 500 + 1)])


def split(points, middle):
    """Distances from the middle, and directions."""
    offset = points - middle
    far = np.linalg.norm(offset, axis=1)
    return far, offset / far[:, None]


def normals(vertices, faces):
    """Outward unit normals of the vertices."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    out = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(out, faces[:, k], np.cross(b - a, c - a))
    return out / np.linalg.norm(out, axis=1, keepdims=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("capture")
    parser.add_argument("take")
    parser.add_argument("--part", choices=["all", "nape", "above"], default="all", help="what of it becomes true")
    arguments = parser.parse_args()
    capture = common.Capture(arguments.capture)
    store = common.Take(arguments.take, "r+").store
    if "scalp/vertices" not in store:
        common.stop(f"{arguments.take}: it has no scalp yet; run it with --to scalp")
    vertices, faces, roots = (store[f"scalp/{name}"][:] for name in ("vertices", "faces", "roots"))
    middle = vertices.mean(0)
    far, ways = split(vertices, middle)
    true = reach(middle, ways, capture.head, np.asarray(capture.faces))
    below = vertices[:, 2].max() - vertices[:, 2]
    nape = np.clip((below - FADE_MM[0]) / (FADE_MM[1] - FADE_MM[0]), 0, 1)
    share = {"all": 1.0, "nape": nape, "above": 1.0 - nape}[arguments.part]
    moved = np.where(np.isnan(true), 0.0, true - far) * share
    root_far, root_ways = split(roots, middle)
    near = nearest(ways, root_ways)
    placed = middle + ways * (far + moved)[:, None]
    store["scalp/vertices"][:] = placed
    store["scalp/roots"][:] = middle + root_ways * (root_far + moved[near])[:, None]
    store["scalp/normals"][:] = normals(placed, faces)[near]
    for place, at in (("at the nape", nape[near] > 0.5), ("above it", nape[near] <= 0.5)):
        way = moved[near][at]
        print(f"{at.sum()} roots {place}: moved outwards by {way.mean():.1f} mm, in size {np.abs(way).mean():.1f} mm")


if __name__ == "__main__":
    main()
