"""2D orientation of hair: Gabor banks and structure tensor (OpenCV) against a take's, on the same pixels.

    python orientation.py CAPTURE TAKE [--frames 0,10,20] [--ours-seconds S]
"""

import time

import cv2
import numpy as np

import common

ORIENTATIONS = 180
# Sigmas of the difference of Gaussians before the bank [px].
DOG = (0.4, 10.0)
# Envelope across and along the strand, wavelength [px]: as Neural Haircut's preprocessing has them (2023; the sigmas are
# those of Chai et al. 2012), and the best of a grid, scored on the truth of these captures.
PUBLISHED = (1.8, 2.4, 1 / 0.23)
TUNED = (5.0, 16.0, 7.0)
# Sigma of the averaging [px]: a usual one, and the best of 6, 8, 10, 12, 16, scored likewise.
USUAL_PX, BEST_PX = 4.0, 16.0


def band_pass(image):
    low, high = (cv2.GaussianBlur(image.astype(np.float32), (0, 0), sigma) for sigma in DOG)
    return low - high


def gabor(image, parameters):
    """Angle with the strongest response, and minus the variance of the angles around it (Paris 2004)."""
    sigma_x, sigma_y, wavelength = parameters
    size = 2 * int(np.ceil(3 * max(sigma_x, sigma_y))) + 1
    texture = band_pass(image)
    response = np.empty((ORIENTATIONS, *image.shape), np.float32)
    for k in range(ORIENTATIONS):
        # OpenCV's theta is that of the normal; lines run across it.
        normal = np.pi * k / ORIENTATIONS - np.pi / 2
        kernel = cv2.getGaborKernel((size, size), sigma_x, normal, wavelength, sigma_x / sigma_y, 0, cv2.CV_32F)
        response[k] = np.abs(cv2.filter2D(texture, cv2.CV_32F, kernel))
    best = response.argmax(0)
    off = np.minimum(np.arange(ORIENTATIONS), ORIENTATIONS - np.arange(ORIENTATIONS)) * np.pi / ORIENTATIONS
    squares = (off**2).astype(np.float32)
    variance = sum(squares[(k - best) % ORIENTATIONS] * response[k] for k in range(ORIENTATIONS))
    return best * np.pi / ORIENTATIONS, -variance / np.maximum(response.sum(0), 1e-12)


def structure_tensor(image, sigma):
    """Angle across the mean gradient, and coherence."""
    gx, gy = cv2.Sobel(image, cv2.CV_32F, 1, 0), cv2.Sobel(image, cv2.CV_32F, 0, 1)
    xx, xy, yy = (cv2.GaussianBlur(p, (0, 0), sigma) for p in (gx * gx, gx * gy, gy * gy))
    angle = (0.5 * np.arctan2(2 * xy, xx - yy) + np.pi / 2) % np.pi
    return angle, np.hypot(2 * xy, xx - yy) / np.maximum(xx + yy, 1e-12)


METHODS = {
    "Gabor bank, published": (gabor, PUBLISHED),
    "Gabor bank, tuned": (gabor, TUNED),
    "structure tensor, 4 px": (structure_tensor, USUAL_PX),
    "structure tensor, tuned": (structure_tensor, BEST_PX),
}
OURS = "ours"


def measure(capture, take, frames=None, ours_seconds=None):
    """Per method: errors [degrees], errors by decile of confidence, CPU seconds a view."""
    frames = frames or common.evenly(capture.frames)
    pixels, seconds = {}, {}
    for v, camera in enumerate(capture.cameras):
        film = capture.video(v, frames)
        for t in frames:
            hair = take.hair(t, v, camera)
            seen = common.Seen(capture, camera, t, capture.points(t))
            ours, trust = take.orientation(t, v, camera)
            used = hair & seen.hair & (trust > 0)
            # The bank is run on the bounding box of the hair, as ours is.
            region = common.box(hair, 24)
            maps = {OURS: (ours[region], trust[region])}
            for name, (method, parameters) in METHODS.items():
                start = time.process_time()
                maps[name] = method(film[t][region], parameters)
                seconds.setdefault(name, []).append(time.process_time() - start)
            for name, (angle, confidence) in maps.items():
                error = common.undirected(angle.astype(np.float64), seen.angle[region])[used[region]]
                pixels.setdefault(name, {}).setdefault(t, []).append((error, confidence[used[region]]))
    rows = {name: scores(of_frames.values()) for name, of_frames in pixels.items()}
    for name, row in rows.items():
        row["seconds"] = np.mean(seconds[name]) if name in seconds else ours_seconds
    count = sum(len(error) for views in pixels[OURS].values() for error, _ in views)
    return {"frames": frames, "pixels": count, "rows": rows}


def scores(frames):
    """Means over frames of the errors over all views' pixels: all, the most confident 60 and 50 %, and deciles."""
    means = []
    for views in frames:
        error, confidence = (np.concatenate(part) for part in zip(*views))
        error = error[np.argsort(-confidence, kind="stable")]
        best = [error[: -(-len(error) * share // 100)].mean() for share in (100, 60, 50)]
        means.append(best + [part.mean() for part in np.array_split(error, common.DECILES)])
    means = np.mean(means, 0)
    return {"all": means[0], "60": means[1], "50": means[2], "deciles": means[3:].tolist()}


def table(found):
    lines = ["| 2D orientation, mean error, degrees | all | best 60 % | best 50 % | seconds a view |", "|---|---:|---:|---:|---:|"]
    for name, row in found["rows"].items():
        secs = "see README" if row["seconds"] is None else f"{row['seconds']:.2f}"
        lines.append(f"| {name} | {row['all']:.1f} | {row['60']:.1f} | {row['50']:.1f} | {secs} |")
    deciles = " | ".join(["most confident", *(str(k + 1) for k in range(1, common.DECILES - 1)), "least"])
    lines += ["", f"| mean error by tenths of confidence | {deciles} |", "|---" + "|---:" * common.DECILES + "|"]
    for name, row in found["rows"].items():
        lines.append(f"| {name} | " + " | ".join(f"{x:.1f}" for x in row["deciles"]) + " |")
    return "\n".join(lines) + f"\n\n{found['pixels']} pixels of frames {', '.join(map(str, found['frames']))}.\n"


if __name__ == "__main__":
    parser = common.arguments(__doc__)
    parser.add_argument("--ours-seconds", type=float, help="seconds a view of ours, see README.md")
    given = parser.parse_args()
    found = measure(common.Capture(given.capture), common.Take(given.take), given.frames, given.ours_seconds)
    print(table(found))
