"""What the comparisons share: a capture with its truth, a take's results, and what a view truly sees.

Millimetres and pixels as in docs/conventions.md: the image's corner is (0, 0), the first pixel's centre (0.5, 0.5).
"""

import argparse
import json
import subprocess
import sys
import tomllib
from pathlib import Path

import cv2
import numpy as np
import zarr

cv2.setNumThreads(1)

FRAMES = 10
DECILES = 10


class Camera:
    """A pinhole camera."""

    def __init__(self, entry, metres):
        self.name, self.width, self.height = entry["name"], entry["width"], entry["height"]
        self.k, self.r = np.array(entry["K"]), np.array(entry["R"])
        self.t = np.array(entry["t"]) * metres
        if np.any(entry.get("distortion", [0])):
            stop(f"{self.name}: lens distortion is not read by these scripts; undistort the videos first")

    def project(self, points):
        """Image points (…, 2) and depths (…) of world points (…, 3)."""
        p = points @ self.r.T + self.t
        z = p[..., 2]
        return np.stack([self.k[i, i] * p[..., i] / z + self.k[i, 2] for i in (0, 1)], -1), z


class Capture:
    """Cameras, videos and truth."""

    def __init__(self, folder):
        self.folder = Path(folder)
        gt = self.folder / "gt"
        if not (gt / "strands_000000.npz").is_file():
            stop(f"{gt}: no strands_000000.npz; this capture has no truth, so there is nothing to score against")
        self.cameras = cameras(self.folder)
        self.frames = sorted(int(file.stem.split("_")[1]) for file in gt.glob("strands_*.npz"))
        first = np.load(gt / "strands_000000.npz")
        self.offsets = first["offsets"].astype(int)
        stable = gt / "stable.npz"
        self.stable = np.load(stable)["stable"].astype(bool) if stable.is_file() else np.ones(len(self.offsets) - 1, bool)
        poses = np.load(gt / "head_pose.npz")
        self.head_motion = scaled(poses["relative_to_frame0"])
        vertices, self.faces = read_obj(gt / "head.obj")
        self.head = move(scaled(poses["head_to_world"])[0], vertices * 1000.0)
        # The pieces of all strands: a piece runs from point i to point i + 1.
        ends = np.zeros(self.offsets[-1], bool)
        ends[self.offsets[1:] - 1] = True
        self.pieces = np.flatnonzero(~ends)
        self.strand_of_piece = np.searchsorted(self.offsets, self.pieces, side="right") - 1

    def points(self, frame):
        """Points of all strands in a frame [mm]."""
        return np.load(self.folder / f"gt/strands_{frame:06}.npz")["points"].astype(np.float64) * 1000.0

    def video(self, view, frames):
        """The luma images, by number, of some frames of a view."""
        camera, last = self.cameras[view], max(frames)
        folder = self.folder / "images" / camera.name
        if folder.is_dir():
            return {frame: grey(folder / f"{frame:06}.png") for frame in frames}
        command = ["ffmpeg", "-nostdin", "-v", "error", "-i", str(self.folder / f"video/{camera.name}.mp4")]
        command += ["-frames:v", str(last + 1), "-sws_flags", "bicubic+accurate_rnd+full_chroma_int+bitexact"]
        command += ["-pix_fmt", "rgb24", "-f", "rawvideo", "pipe:1"]
        data = subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout
        images = np.frombuffer(data, np.uint8).reshape(-1, camera.height, camera.width, 3)
        return {frame: cv2.cvtColor(images[frame], cv2.COLOR_RGB2GRAY) for frame in frames}


def cameras(folder):
    """The cameras of `calibration.json`, or of a `calibration.toml` as `strandflow synth` writes it."""
    if (folder / "calibration.json").is_file():
        calibration = json.loads((folder / "calibration.json").read_text())
        entries = calibration["cameras"]
    elif (folder / "calibration.toml").is_file():
        calibration = tomllib.loads((folder / "calibration.toml").read_text())
        entries = [as_json(entry) for entry in calibration["cameras"]]
    else:
        stop(f"{folder}: no calibration.json and no calibration.toml")
    metres = 1000.0 if calibration.get("units", "metres") == "metres" else 1.0
    return [Camera(entry, metres) for entry in entries]


def as_json(entry):
    """A camera of a `calibration.toml`, with the names of `calibration.json`."""
    (fx, fy), (cx, cy) = entry["focal"], entry["principal"]
    return entry | {"K": [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], "R": entry["rotation"], "t": entry["translation"]}


def grey(file):
    """The luma image of a file."""
    image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
    return stop(f"{file}: no image that can be read") if image is None else image


class Take:
    """Results of the program; `mode` as Zarr has it, `r+` to change them."""

    def __init__(self, folder, mode="r"):
        store = Path(folder) / "results.zarr"
        if not store.is_dir():
            stop(f"{store}: there is no such folder; make it with `strandflow run`")
        self.store = zarr.open(store, mode=mode)

    def hair(self, frame, view, camera):
        """Pixels inside the hair mask."""
        return self.store["masks/hair"][frame, view][: camera.height, : camera.width] >= 128

    def orientation(self, frame, view, camera):
        """Angle [rad] and confidence 0 to 1."""
        angle, trust = (self.store[f"orient/{name}"][frame, view] for name in ("angle", "confidence"))
        cut = np.s_[: camera.height, : camera.width]
        return angle[cut].astype(np.float32) * np.float32(np.pi / 65536), trust[cut].astype(np.float32) / 255

    def motion(self, frame):
        """Centres [mm] of the field's voxels and their displacements since the frame before."""
        index = self.store[f"field/{frame:06}/voxel"][:].astype(np.int64)
        dims, voxel = self.store["hull/grid/dims"][:].astype(np.int64), self.voxel_mm()
        at = np.stack([index % dims[0], index // dims[0] % dims[1], index // (dims[0] * dims[1])], -1)
        centres = self.store["hull/grid/origin"][:] + (at + 0.5) * voxel
        return centres, self.store[f"field/{frame:06}/motion"][:].astype(np.float64)

    def voxel_mm(self):
        return float(np.ravel(self.store["hull/grid/voxel_mm"][:])[0])

    def voxels(self, points):
        """Linear indices of the voxels that hold world points [mm], and which points lie in the grid."""
        dims = self.store["hull/grid/dims"][:].astype(np.int64)
        at = np.floor((points - self.store["hull/grid/origin"][:]) / self.voxel_mm()).astype(np.int64)
        inside = ((at >= 0) & (at < dims)).all(-1)
        x, y, z = np.moveaxis(np.clip(at, 0, dims - 1), -1, 0)
        return (z * dims[1] + y) * dims[0] + x, inside

    def inside_hull(self, frame, points):
        """Whether world points [mm] lie in the visual hull of a frame."""
        voxel, inside = self.voxels(points)
        return inside & (self.store["hull/occupancy"][frame].ravel()[voxel] > 0)


class Seen:
    """What a view truly sees: per pixel the nearest strand, as `StrandView::draw` of crates/eval draws it."""

    def __init__(self, capture, camera, frame, points):
        pixel, z = camera.project(points)
        a, b = pixel[capture.pieces], pixel[capture.pieces + 1]
        za, zb = z[capture.pieces], z[capture.pieces + 1]
        along = b - a
        length = np.hypot(along[:, 0], along[:, 1])
        steps = np.clip(np.ceil(length / 0.5), 1, 4000).astype(int)
        # Samples twice a pixel along every piece, each put down three times: two pixels wide.
        piece = np.repeat(np.arange(len(steps)), steps + 1)
        step = np.arange(len(piece)) - np.repeat(np.cumsum(steps + 1) - steps - 1, steps + 1)
        share = step / steps[piece]
        centre = a[piece] + along[piece] * share[:, None]
        depth = (za[piece] + (zb - za)[piece] * share).astype(np.float32)
        across = np.stack([-along[:, 1], along[:, 0]], -1) / np.maximum(length, 1e-12)[:, None] * 0.5
        buffer = as_key(head_depth(capture, camera, frame), 0)
        for side in (0.0, 1.0, -1.0):
            put(buffer, camera, centre + side * across[piece], as_key(depth, np.arange(1, len(piece) + 1)))
        sample = (buffer & 0xFFFFFFFF).astype(np.int64) - 1
        self.hair = (sample >= 0).reshape(camera.height, camera.width)
        sample = sample.reshape(camera.height, camera.width)
        self.piece = np.where(self.hair, piece[sample], -1)
        self.share = share[sample]
        angle = np.arctan2(along[:, 1], along[:, 0]) % np.pi
        self.angle = angle.astype(np.float32)[self.piece]

    def at(self, capture, points):
        """World points [mm] of the strands' pixels, in any frame's `points`: same strand, same place on it."""
        start = capture.pieces[self.piece[self.hair]]
        share = self.share[self.hair][:, None]
        return points[start] * (1 - share) + points[start + 1] * share


def head_depth(capture, camera, frame):
    """Depth of the head's surface, infinite beside it, by barycentric filling at pixel centres."""
    pixel, z = camera.project(move(capture.head_motion[frame], capture.head))
    a, b, c = (pixel[capture.faces[:, k]] for k in range(3))
    ia, ib, ic = (1.0 / z[capture.faces[:, k]] for k in range(3))
    area = cross(b - a, c - a)
    limit = (camera.width, camera.height)
    low = np.clip(np.min([a, b, c], 0), 0, limit).astype(int)
    size = np.clip(np.max([a, b, c], 0) + 1, 0, limit).astype(int) - low
    count = np.where(np.abs(area) < 1e-9, 0, size[:, 0] * size[:, 1])
    face = np.repeat(np.arange(len(count)), count)
    inner = np.arange(len(face)) - np.repeat(np.cumsum(count) - count, count)
    x, y = low[face, 0] + inner % size[face, 0], low[face, 1] + inner // size[face, 0]
    p = np.stack([x, y], -1) + 0.5
    u, v = cross(p - a[face], (c - a)[face]) / area[face], cross((b - a)[face], p - a[face]) / area[face]
    inside = (u >= 0) & (v >= 0) & (u + v <= 1)
    depth = 1.0 / (ia[face] * (1 - u - v) + ib[face] * u + ic[face] * v)
    plane = np.full(camera.width * camera.height, np.inf, np.float32)
    np.minimum.at(plane, (y * camera.width + x)[inside], depth[inside].astype(np.float32))
    return plane


def as_key(depth, number):
    """Depth and number as one integer that sorts by depth first."""
    return depth.view(np.uint32).astype(np.uint64) << np.uint64(32) | np.asarray(number, np.uint64)


def put(buffer, camera, pixels, keys):
    """The smallest key of each pixel."""
    x, y = np.floor(pixels).astype(int).T
    inside = (x >= 0) & (y >= 0) & (x < camera.width) & (y < camera.height)
    np.minimum.at(buffer, (y * camera.width + x)[inside], keys[inside])


def cross(a, b):
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def move(pose, points):
    """Points moved by a rigid transform (4, 4)."""
    return points @ pose[:3, :3].T + pose[:3, 3]


def scaled(poses):
    """Poses (T, 4, 4) with their translations in millimetres."""
    poses = poses.astype(np.float64)
    poses[:, :3, 3] *= 1000.0
    return poses


def read_obj(file):
    """Vertices and triangles (polygons as fans) of a Wavefront file."""
    vertices, faces = [], []
    for line in file.read_text().splitlines():
        word, *rest = line.split() or [""]
        if word == "v":
            vertices.append([float(x) for x in rest[:3]])
        elif word == "f":
            corner = [int(x.split("/")[0]) - 1 for x in rest]
            faces += [[corner[0], p, q] for p, q in zip(corner[1:], corner[2:])]
    return np.array(vertices), np.array(faces)


def box(mask, margin):
    """The slices of the mask's bounding box and a margin."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return tuple(slice(max(0, s[0] - margin), s[-1] + 1 + margin) for s in (rows, columns))


def undirected(a, b):
    """Angle between undirected image directions [degrees, 0 to 90]."""
    off = np.degrees(a - b) % 180.0
    return np.minimum(off, 180.0 - off)


def stop(fact):
    print(f"error: {fact}", file=sys.stderr)
    sys.exit(2)


def numbers(text):
    return [int(x) for x in text.split(",")]


def arguments(text):
    """CAPTURE, TAKE and what all scripts share."""
    parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("capture", help="folder of a capture with truth (gt/)")
    parser.add_argument("take", help="folder of a take of it, run")
    parser.add_argument("--frames", type=numbers, help="frames, 1,5,9 (default: ten)")
    return parser


def evenly(frames, count=FRAMES):
    """Some of the frames, evenly spaced, first and last among them; those that `strandflow evaluate` takes."""
    return sorted({frames[i * (len(frames) - 1) // (count - 1)] for i in range(count)})
