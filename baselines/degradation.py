"""How results fall as the rig and the footage get worse: synthetic takes that differ in one thing at a time.

    python degradation.py FOLDER [--program strandflow] [--style wavy] [--only views,noise] [--svg OUT.svg]

Makes, runs (images to smoothed strands, default settings) and scores one small take a point. FOLDER keeps the scores; a point
that has them is not run again. Prints a table; --svg also draws the curves. Needs nothing beyond Python.
"""

import argparse
import json
import shutil
import subprocess
import sys
from pathlib import Path

import picture

# What is varied: title, table and key of the specification, values; the middle of the road is that of BASE.
CURVES = {
    "views": ("views", "rig", "views", [4, 5, 6, 7, 10, 13, 16]),
    "noise": ("image noise, 8-bit levels", "noise", "image_sigma", [0.0, 2.5, 5.0, 10.0]),
    "blur": ("blur, px", "noise", "blur_px", [0.45, 1.0, 2.0, 3.0]),
    "mask": ("error of the given hair masks, px", "noise", "mask_px", [0.0, 1.0, 2.0, 3.0]),
    "calibration": ("error of the calibration, px", "noise", "calibration_px", [0.0, 0.5, 1.0, 2.0]),
    "sync": ("views early or late by up to, ms", "noise", "sync_ms", [0.0, 1.0, 2.5, 5.0]),
}
BASE = {
    "rig": {"frames": 12, "views": 7, "width": 480, "height": 360},
    "groom": {"style": "wavy", "length_mm": 260.0, "cut_below_mm": 160.0, "part": True, "wave_mm": 5.0, "wave_length_mm": 60.0},
    "motion": {"quiet_frames": 2},
    "noise": {"image_sigma": 2.5, "blur_px": 0.45},
}
STYLES = {"straight": {"wave_mm": 0.0, "part": False}, "wavy": {}, "curly": {"wave_mm": 5.0, "wave_length_mm": 35.0, "wave_from": 0.2}}
# What is scored: title, how it is found in what `evaluate --json` writes, colour.
SCORES = [
    ("2D orientation, °", lambda s: mean(frame["all"]["mean"] for _, frame in s["orient"]), "#4c78a8"),
    ("lifted lines, °", lambda s: mean(frame["degrees"]["mean"] for _, frame in s["lift"]), "#4f9d69"),
    ("true hair with a lifted line, %", lambda s: 100 * mean(frame["coverage"] for _, frame in s["lift"]), "#9c6ade"),
    ("F1 of seen strands, 3 mm/30°, %", lambda s: 100 * f1(s, "visible"), "#d1495b"),
    ("F1 of all strands, %", lambda s: 100 * f1(s, "all"), "#e08e45"),
]
WIDTH, HEIGHT, LEFT, TOP, ACROSS = 250, 190, 44, 34, 3


def mean(values):
    values = list(values)
    return sum(values) / len(values)


def f1(scores, which):
    smooth = dict(scores["strands"])["smooth"]
    return next(t[which]["f1"] for t in smooth["thresholds"] if t["distance_mm"] == 3.0)


def toml(spec):
    lines = ["seed = 5"]
    for table, keys in spec.items():
        lines += [f"[{table}]", *(f"{key} = {json.dumps(value)}" for key, value in keys.items())]
    return "\n".join(lines) + "\n"


def point(program, folder, style, table, key, value):
    """The scores of one take, which is made and run where they are not there yet."""
    spec = {t: dict(keys) for t, keys in BASE.items()}
    spec["groom"] |= {"style": style} | STYLES[style]
    is_base = value == BASE.get(table, {}).get(key, 0.0)
    spec[table][key] = value
    file = folder / (f"{style}.json" if is_base else f"{style}-{key}-{value}.json")
    if not file.is_file():
        (folder / "spec.toml").write_text(toml(spec))
        capture, take = folder / "capture", folder / "take"
        for old in (capture, take):
            shutil.rmtree(old, ignore_errors=True)
        scored = folder / "scored.json"
        for command in (
            ["synth", "--spec", folder / "spec.toml", capture],
            ["new", take, "--capture", capture],
            ["run", take, "--to", "smooth"],
            ["evaluate", take, "--truth", capture / "gt", "--json", scored],
        ):
            done = subprocess.run([program, *map(str, command)], capture_output=True, text=True)
            if done.returncode:
                sys.exit(f"{file.stem}: strandflow {command[0]}: {done.stderr.strip()}")
        scored.rename(file)
        for old in (capture, take):
            shutil.rmtree(old, ignore_errors=True)
    scores = json.loads(file.read_text())
    return [score(scores) for _, score, _ in SCORES]


def panel(title, values, rows, x0, y0):
    """The curves over one thing that is varied."""

    def at(value, score):
        share = (value - values[0]) / (values[-1] - values[0])
        return x0 + LEFT + share * WIDTH, y0 + TOP + HEIGHT * (1 - score / 100)

    parts = [f'<text x="{x0 + LEFT}" y="{y0 + 20}" font-weight="bold">{title}</text>']
    parts += picture.levels(x0 + LEFT, lambda score: at(values[0], score)[1], WIDTH, range(0, 101, 20))
    for value in values:
        x, y = at(value, 0)
        parts.append(f'<text x="{x:.1f}" y="{y + 16:.1f}" text-anchor="middle">{value:g}</text>')
    for k, (_, _, colour) in enumerate(SCORES):
        line = [at(value, row[k]) for value, row in zip(values, rows)]
        places = " ".join(f"{x:.1f},{y:.1f}" for x, y in line)
        parts.append(f'<polyline points="{places}" fill="none" stroke="{colour}" stroke-width="2"/>')
        parts += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2.5" fill="{colour}"/>' for x, y in line]
    return parts


def svg(found):
    """A panel a curve, and a legend."""
    step = (LEFT + WIDTH + 24, TOP + HEIGHT + 32)
    parts = []
    for i, (title, values, rows) in enumerate(found):
        parts += panel(title, values, rows, i % ACROSS * step[0], i // ACROSS * step[1])
    below = -(-len(found) // ACROSS) * step[1] + 16
    for i, (title, _, colour) in enumerate(SCORES):
        x, y = LEFT + i % ACROSS * step[0], below + i // ACROSS * 20
        parts += picture.named(x, y, title, colour)
    size = (ACROSS * step[0], below + 36)
    return picture.page(size, "Scores over what gets worse", parts)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--program", default="strandflow")
    parser.add_argument("--style", choices=STYLES, default="wavy")
    parser.add_argument("--only", default=",".join(CURVES), help="some of " + ", ".join(CURVES))
    parser.add_argument("--svg", type=Path)
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    curves = []
    for name in given.only.split(","):
        if name not in CURVES:
            parser.error(f"there is no curve `{name}`; there are {', '.join(CURVES)}")
        title, table, key, values = CURVES[name]
        print(f"\n| {title} | " + " | ".join(score for score, _, _ in SCORES) + " |\n|---:" + "|---:" * len(SCORES) + "|", flush=True)
        rows = []
        for value in values:
            rows.append(point(given.program, given.folder, given.style, table, key, value))
            print(f"| {value:g} | " + " | ".join(f"{score:.1f}" for score in rows[-1]) + " |", flush=True)
        curves.append((title, values, rows))
    if given.svg:
        given.svg.write_text(svg(curves))
