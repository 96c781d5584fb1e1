"""Time and memory over a long take: whether the last items of a stage cost more than its first.

    python long_take.py TAKE/run.log [--svg OUT.svg]

Prints a table of the phases with a thousand items or more; --svg also draws each over its items, in the order in which they were
finished. Memory is the most that the process has held since the phase began. Needs nothing beyond Python.
"""

import argparse
import json
from pathlib import Path

import picture

LEAST_ITEMS, PARTS = 1000, 50
LEFT, TOP, WIDTH, HEIGHT, ACROSS = 56, 40, 190, 110, 4
CURVES = (("ms an item", "#1f6fb4"), ("most memory so far, MB", "#c0392b"))


def phases(log):
    """Seconds and megabytes of the items that were done, by phase, in the order in which they were finished."""
    found = {}
    for line in log.open():
        try:
            event = json.loads(line)
        except ValueError:
            continue  # a line that a killed run left half written
        if event.get("event") == "item" and event["outcome"] == "done":
            found.setdefault(event["phase"], []).append((event["unix_secs"], event["secs"], event["peak_mb"] or 0.0))
    return {phase: sorted(items) for phase, items in found.items() if len(items) >= LEAST_ITEMS}


def parts(items):
    """Mean milliseconds and most megabytes of each fiftieth of the items."""
    cuts = [round(i * len(items) / PARTS) for i in range(PARTS + 1)]
    pieces = [items[a:b] for a, b in zip(cuts, cuts[1:])]
    ms = [1000.0 * sum(secs for _, secs, _ in piece) / len(piece) for piece in pieces]
    return ms, [max(mb for _, _, mb in piece) for piece in pieces]


def panel(phase, items, x, y):
    """One phase: both curves from zero, each to its own height."""
    drawn = picture.levels(x, lambda _: y + HEIGHT, WIDTH, [0])
    drawn.append(f'<text x="{x}" y="{y - 18}" font-weight="bold">{phase}, {len(items)} items</text>')
    for (name, colour), values, at in zip(CURVES, parts(items), (0, 1)):
        most = max(values) or 1.0
        line = [(x + WIDTH * (i + 0.5) / PARTS, y + HEIGHT * (1.0 - value / most)) for i, value in enumerate(values)]
        places = " ".join(f"{a:.1f},{b:.1f}" for a, b in line)
        drawn.append(f'<polyline points="{places}" fill="none" stroke="{colour}" stroke-width="2"/>')
        unit = "ms" if at == 0 else "MB"
        drawn.append(f'<text x="{x + at * 80}" y="{y - 4}" fill="{colour}">to {most:.0f} {unit}</text>')
    return drawn


def svg(found):
    """A panel a phase, and a legend."""
    step = (LEFT + WIDTH, TOP + HEIGHT + 24)
    drawn = []
    for i, (phase, items) in enumerate(found.items()):
        drawn += panel(phase, items, LEFT + i % ACROSS * step[0], TOP + i // ACROSS * step[1])
    below = -(-len(found) // ACROSS) * step[1] + 24
    for i, (name, colour) in enumerate(CURVES):
        drawn += picture.named(LEFT + i * step[0], below, name, colour)
    return picture.page((ACROSS * step[0] + 16, below + 16), "Time and memory over a long take", drawn)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("log", type=Path)
    parser.add_argument("--svg", type=Path)
    given = parser.parse_args()
    found = phases(given.log)
    print("| phase | items | ms an item, first tenth | last tenth | most MB, first tenth | all |\n|---|---:|---:|---:|---:|---:|")
    for phase, items in found.items():
        ms, mb = parts(items)
        tenth = PARTS // 10
        mean = lambda values: sum(values) / len(values)
        print(f"| `{phase}` | {len(items)} | {mean(ms[:tenth]):.1f} | {mean(ms[-tenth:]):.1f} | {max(mb[:tenth]):.0f} | {max(mb):.0f} |")
    if given.svg:
        given.svg.write_text(svg(found))
