"""How hair moved between frames, in the image: OpenCV's flows against a take's measured 3D motion, on the same pixels.

    python flow.py CAPTURE TAKE [--frames 1,5,9]

Every displacement is that from a frame to the frame before, since that is what a take holds.
"""

import time

import cv2
import numpy as np

import common

FARNEBACK = {"pyr_scale": 0.5, "levels": 5, "iterations": 3, "flags": cv2.OPTFLOW_FARNEBACK_GAUSSIAN}
# Window and neighbourhood [px]: a usual one, and the best of 15 to 61 px, scored on the truth of a capture.
WINDOWS = {"Farneback, window 15": (15, 5, 1.2), "Farneback, tuned": (61, 7, 1.5)}
DIS = "DIS, medium"
OURS = "ours (3D motion, projected)"
HEAD, STILL = "the true head's motion", "no motion"


def farneback(image, before, window):
    winsize, poly_n, poly_sigma = window
    options = {"winsize": winsize, "poly_n": poly_n, "poly_sigma": poly_sigma}
    return cv2.calcOpticalFlowFarneback(image, before, None, **FARNEBACK, **options)


def dis(image, before):
    return cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM).calc(image, before, None)


def projected_motion(camera, centres, motion, voxel_mm):
    """The projected displacement to the frame before at the nearest voxel of each pixel; NaN where there is none."""
    pixel, z = camera.project(centres)
    # A voxel as the square that its cube covers, as in crates/volume/src/visibility.rs.
    reach = 0.6 * voxel_mm * camera.k[0, 0] / z
    low, high = (np.floor(pixel + 0.5 + sign * reach[:, None]).astype(int) for sign in (-1, 1))
    keys = common.as_key(z.astype(np.float32), np.arange(1, len(z) + 1))
    buffer = np.full(camera.width * camera.height, common.as_key(np.array([np.inf], np.float32), 0)[0])
    size = np.maximum(high - low, 1)
    for dy in range(size[:, 1].max()):
        for dx in range(size[:, 0].max()):
            some = (dx < size[:, 0]) & (dy < size[:, 1])
            common.put(buffer, camera, (low + (dx, dy))[some], keys[some])
    nearest = (buffer & 0xFFFFFFFF).astype(np.int64) - 1
    shift = camera.project(centres - motion)[0] - pixel
    flow = np.where(nearest[:, None] >= 0, shift[nearest], np.nan)
    return flow.reshape(camera.height, camera.width, 2)


def measure(capture, take, frames=None):
    """Per method: mean end-point error, its part across the strand [px], share of the true motion across the strand that is
    found, CPU seconds a view; and the pixels."""
    frames = frames or common.evenly(capture.frames[1:])
    errors, seconds, pixels = {}, {}, 0
    films = [capture.video(v, sorted({*frames, *(t - 1 for t in frames)})) for v in range(len(capture.cameras))]
    for t in frames:
        points, points_before = capture.points(t), capture.points(t - 1)
        back = capture.head_motion[t - 1] @ np.linalg.inv(capture.head_motion[t])
        centres, motion = take.motion(t)
        for v, camera in enumerate(capture.cameras):
            seen = common.Seen(capture, camera, t, points)
            at = camera.project(seen.at(capture, points))[0]
            truth = camera.project(seen.at(capture, points_before))[0] - at
            head = camera.project(common.move(back, seen.at(capture, points)))[0] - at
            image, before = films[v][t], films[v][t - 1]
            flows = {}
            for name, window in WINDOWS.items():
                flows[name] = timed(seconds, name, farneback, image, before, window)[seen.hair]
            flows[DIS] = timed(seconds, DIS, dis, image, before)[seen.hair]
            flows[OURS] = projected_motion(camera, centres, motion, take.voxel_mm())[seen.hair]
            flows |= {HEAD: head, STILL: np.zeros_like(truth)}
            stable = capture.stable[capture.strand_of_piece[seen.piece[seen.hair]]]
            used = stable & take.hair(t, v, camera)[seen.hair] & np.isfinite(flows[OURS][:, 0])
            angle = seen.angle[seen.hair][used]
            pixels += len(angle)
            across = np.stack([-np.sin(angle), np.cos(angle)], -1)
            true_across = (truth[used] * across).sum(-1)
            for name, flow in flows.items():
                off = (flow - truth)[used]
                off_across = (off * across).sum(-1)
                found = (true_across + off_across) * true_across
                errors.setdefault(name, []).append((np.hypot(off[:, 0], off[:, 1]), np.abs(off_across), found, true_across**2))
    rows = {}
    for name, parts in errors.items():
        end, across, found, true = (np.concatenate(p) for p in zip(*parts))
        rows[name] = {"end": end.mean(), "half": np.median(end), "across": across.mean(), "share": found.sum() / true.sum()}
        rows[name]["seconds"] = np.mean(seconds[name]) if name in seconds else None
    return {"frames": frames, "pixels": pixels, "rows": rows}


def timed(seconds, name, method, *given):
    start = time.process_time()
    result = method(*given)
    seconds.setdefault(name, []).append(time.process_time() - start)
    return result


def table(found):
    lines = ["| flow to the frame before | end-point error, mean, px | median | across the strand, px | motion found across | seconds a view |"]
    lines += ["|---|---:|---:|---:|---:|---:|"]
    for name, row in found["rows"].items():
        secs = "–" if row["seconds"] is None else f"{row['seconds']:.3f}"
        lines.append(f"| {name} | {row['end']:.2f} | {row['half']:.2f} | {row['across']:.2f} | {100 * row['share']:.0f} % | {secs} |")
    return "\n".join(lines) + f"\n\n{found['pixels']} pixels of frames {', '.join(map(str, found['frames']))}.\n"


if __name__ == "__main__":
    given = common.arguments(__doc__).parse_args()
    print(table(measure(common.Capture(given.capture), common.Take(given.take), given.frames)))
