"""What the images allow: how well lines and silhouettes tell the depth of hair, what a small error costs in occupancy, and how
far the directions of neighbouring pixels agree at all.

    python limits.py CAPTURE TAKE [--frames 15]

Nothing here is a method. Each figure takes something from the truth that no program has, so that what is left is the
share of the images (and of the rig).
"""

import cv2
import numpy as np

import common

OFFSETS = np.arange(-14.0, 17.0, 2.0)
"""Places on a pixel's ray, behind the true hair [mm]."""

EVERY = 25
"""One in so many pixels."""


def places(capture, take, frame, points):
    """The seen hair [mm] of every view, the directions of its rays, and where each lies on which strand."""
    where, rays, owners = [], [], []
    for v, camera in enumerate(capture.cameras):
        seen = common.Seen(capture, camera, frame, points)
        kept = np.flatnonzero(take.hair(frame, v, camera)[seen.hair])[::EVERY]
        at = seen.at(capture, points)[kept]
        centre = -camera.r.T @ camera.t
        ray = at - centre
        where.append(at)
        rays.append(ray / np.linalg.norm(ray, axis=1, keepdims=True))
        owners.append((seen, kept))
    return np.concatenate(where), np.concatenate(rays), owners


def first(inside):
    """Percentiles of the first place on each ray that is inside [mm behind the true hair], and the deviation."""
    offset = OFFSETS[inside.argmax(1)[inside.any(1)]]
    return np.percentile(offset, [10, 50, 90]), offset.std()


def lines(take, frame, at, ray):
    """Per offset: share of rays with a line, mean residual of those [degrees]; and the offset of the surest line of a ray."""
    store = take.store[f"lift/{frame:06}"]
    voxel, _ = take.voxels(at[:, None] + ray[:, None] * OFFSETS[None, :, None])
    known = store["voxel"][:].astype(np.int64)
    rank = np.minimum(np.searchsorted(known, voxel), len(known) - 1)
    has = known[rank] == voxel
    residual = np.where(has, np.degrees(store["residual"][:][rank]), np.nan)
    trust = np.where(has, store["confidence"][:][rank], 0)
    surest = OFFSETS[trust.argmax(1)[has.any(1)]]
    return has.mean(0), np.nanmean(residual, 0), surest


def silhouettes(capture, take, frame, at, ray, owners):
    """Whether places lie in the hull of their own frame, and in those of all frames where the true hair would carry them."""
    on_rays = at[:, None] + ray[:, None] * OFFSETS[None, :, None]
    own = take.inside_hull(frame, on_rays)
    everywhere = own.copy()
    for t in capture.frames[:: max(1, len(capture.frames) // 10)]:
        turn = (capture.head_motion[t] @ np.linalg.inv(capture.head_motion[frame]))[:3, :3]
        points = capture.points(t)
        there = np.concatenate([seen.at(capture, points)[kept] for seen, kept in owners])
        everywhere &= take.inside_hull(t, there[:, None] + (ray @ turn.T)[:, None] * OFFSETS[None, :, None])
    return own, everywhere


def occupancy(capture, points, sigma, edge=3.0):
    """F1 of the voxels of `edge` mm that true strands pass through, against the same strands moved by `sigma` mm."""
    moved = np.random.default_rng(1).normal(0, sigma, (len(capture.offsets) - 1, 3))[capture.strand_of_piece]
    a, b = points[capture.pieces], points[capture.pieces + 1]
    steps = np.arange(0, 1, 0.1)[:, None, None]
    along = (a + (b - a) * steps).reshape(-1, 3)

    def voxels(shift):
        at = np.floor((along + shift) / edge).astype(np.int64) + 4096
        return np.unique(at @ (1 << 26, 1 << 13, 1))

    true, found = voxels(0.0), voxels(np.tile(moved, (len(steps), 1)))
    both = len(np.intersect1d(true, found))
    return 2 * both / (len(true) + len(found))


def directions(capture, take, frame, points, sigmas):
    """Per sigma [px]: error [degrees] of the true directions of pixels, averaged by a Gaussian, over all and the most agreeing 60 % of
    the pixels that the take counts as hair: the least that a filter can have whose window is as wide."""
    found = {sigma: [] for sigma in sigmas}
    for v, camera in enumerate(capture.cameras):
        seen = common.Seen(capture, camera, frame, points)
        hair = seen.hair & take.hair(frame, v, camera)
        planes = np.cos(2 * seen.angle) * seen.hair, np.sin(2 * seen.angle) * seen.hair, seen.hair.astype(np.float32)
        for sigma in sigmas:
            cos, sin, count = (cv2.GaussianBlur(plane, (0, 0), sigma)[hair] for plane in planes)
            error = common.undirected(0.5 * np.arctan2(sin, cos), seen.angle[hair])
            found[sigma].append((error, np.hypot(cos, sin) / np.maximum(count, 1e-9)))
    for sigma, views in found.items():
        error, agreement = (np.concatenate(part) for part in zip(*views))
        error = error[np.argsort(-agreement, kind="stable")]
        yield sigma, error.mean(), error[: -(-len(error) * 60 // 100)].mean()


def main():
    given = common.arguments(__doc__).parse_args()
    capture, take = common.Capture(given.capture), common.Take(given.take)
    for frame in given.frames or [capture.frames[len(capture.frames) // 2]]:
        points = capture.points(frame)
        at, ray, owners = places(capture, take, frame, points)
        has, residual, surest = lines(take, frame, at, ray)
        own, everywhere = silhouettes(capture, take, frame, at, ray, owners)
        print(f"frame {frame}, {len(at)} pixels; mm behind the true hair:")
        row = lambda name, values, digits: print(f"{name:>34} " + " ".join(f"{v:5.{digits}f}" for v in values))
        row("", OFFSETS, 0)
        row("inside the hull", own.mean(0), 2)
        row("with a line", has, 2)
        row("residual of the lines, degrees", residual, 2)
        row("in the hulls of all frames", everywhere.mean(0), 2)
        for name, inside in (("its own hull", own), ("the hulls of all frames", everywhere)):
            share, deviation = first(inside)
            print(f"first place in {name}: {share} mm (10, 50, 90 %), deviation {deviation:.1f} mm")
        print(f"surest line of a ray: {np.median(np.abs(surest)):.1f} mm off in the median, deviation {surest.std():.1f} mm")
        for sigma, every, best in directions(capture, take, frame, points, (0.5, 1.0, 2.0, 4.0)):
            print(f"true 2D directions averaged over {sigma} px: {every:.1f}° off, {best:.1f}° over the most agreeing 60 %")
        scores = ", ".join(f"{occupancy(capture, points, s):.3f} ({s} mm)" for s in (1.0, 2.0, 3.0, 4.0))
        print(f"occupancy F1 of the true strands moved by a deviation in every direction: {scores}")


if __name__ == "__main__":
    main()
