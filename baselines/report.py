"""Both comparisons on one or more captures, printed as Markdown; and the reliability curves as a picture.

    python report.py CAPTURE TAKE [CAPTURE TAKE …] [--ours-seconds S …] [--svg OUT.svg]
"""

import argparse
from pathlib import Path

import common
import flow
import orientation
import picture

COLOURS = ["#d1495b", "#4c78a8", "#4c78a8", "#4f9d69", "#4f9d69"]
WIDTH, HEIGHT, LEFT, TOP, MOST = 330, 240, 46, 34, 50.0


def panel(title, rows, x0):
    """One capture's curves: mean error by tenth of confidence."""

    def at(k, degrees):
        return x0 + LEFT + k * WIDTH / (common.DECILES - 1), TOP + HEIGHT * (1 - degrees / MOST)

    parts = [f'<text x="{x0 + LEFT}" y="20" font-weight="bold">{title}</text>']
    parts += picture.levels(x0 + LEFT, lambda degrees: at(0, degrees)[1], WIDTH, range(0, int(MOST) + 1, 10), "°")
    y = TOP + HEIGHT + 18
    parts.append(f'<text x="{x0 + LEFT}" y="{y}">most confident tenth</text>')
    parts.append(f'<text x="{x0 + LEFT + WIDTH}" y="{y}" text-anchor="end">least confident tenth</text>')
    for (name, row), colour in zip(rows.items(), COLOURS):
        points = [at(k, degrees) for k, degrees in enumerate(row["deciles"])]
        line = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        width = 3 if name == orientation.OURS else 1.8
        dashes = ' stroke-dasharray="5 4"' if name.endswith(("published", "px")) else ""
        parts.append(f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="{width}"{dashes}/>')
    return parts


def svg(found):
    """A panel a capture, and a legend."""
    step = LEFT + WIDTH + 24
    parts = [part for i, (title, rows) in enumerate(found) for part in panel(title, rows, i * step)]
    legend = TOP + HEIGHT + 44
    for i, (name, colour) in enumerate(zip(found[0][1], COLOURS)):
        x, y = LEFT + i % 3 * 230, legend + i // 3 * 20
        dashes = ' stroke-dasharray="5 4"' if name.endswith(("published", "px")) else ""
        parts += picture.named(x, y, name, colour, dashes)
    size = (max(step * len(found), LEFT + 3 * 230), legend + 34)
    return picture.page(size, "Mean error of 2D hair orientation by tenths of confidence", parts)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", metavar="CAPTURE TAKE")
    parser.add_argument("--frames", type=common.numbers, help="frames, 1,5,9 (default: ten)")
    parser.add_argument("--ours-seconds", type=float, nargs="*", default=[], help="seconds a view of ours, one a take")
    parser.add_argument("--svg", type=Path)
    given = parser.parse_args()
    if len(given.folders) % 2:
        parser.error("a take belongs to every capture")
    pairs = [(common.Capture(c), common.Take(t)) for c, t in zip(given.folders[::2], given.folders[1::2])]
    curves = []
    for i, (capture, take) in enumerate(pairs):
        ours_seconds = given.ours_seconds[i] if i < len(given.ours_seconds) else None
        lines = orientation.measure(capture, take, given.frames, ours_seconds)
        title = capture.folder.resolve().name
        print(f"{title}\n\n{orientation.table(lines)}", flush=True)
        moved = flow.measure(capture, take, given.frames and [t for t in given.frames if t > 0])
        print(flow.table(moved), flush=True)
        curves.append((title, lines["rows"]))
    if given.svg:
        given.svg.write_text(svg(curves))
