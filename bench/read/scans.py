"""Scans of a part, and of parts that differ from it: what ``localize`` finds, refuses, accepts.

python -m bench.read.scans [FIRST, 0] [COUNT, 120] [PROCESSES, 1]

The rule: scan number n shows a plate, a bent sheet, a block or a flange, in turns of four. In each
eight groups of four, four show the model itself. The others show its mirror image, another length,
a moved hole and a larger hole. A group is seen from four places or from one. The turns of that
begin with the other number in each second eight. The first place sees the hole that is changed.
Half of the scans from one place come with the scanner's place. The seed n draws all else from the
ranges in `tests/support/scenes.py`: sizes, noise, spacing, bench, strays, flying pixels, pose.

Outcomes for the model itself:

- right: no corner is more than 0.5 mm from its true place;
- wrong: exit code 0 with another pose;
- undecided: exit code 3;
- not found: exit code 2.

Another part is accepted (exit code 0) or refused. The bench prints a table for docs/benchmarks.md.
It exits with 1 if a pose is wrong, if another part is accepted, or if fewer than nine in ten of the
right ones are found. Seconds are processor time.
"""

from __future__ import annotations

import sys
import time
from collections import Counter

import numpy as np

from bench.support.children import map_inputs
from bench.support.runner import open_table, read_words
from camgen.localize import localize
from camgen.model.errors import CamgenError
from tests.support import scenes

OFF = 0.5
GOAL = 0.9
VARIANTS = (
    *(scenes.RIGHT, scenes.HAND, scenes.RIGHT, scenes.LONGER),
    *(scenes.RIGHT, scenes.MOVED, scenes.RIGHT, scenes.LARGER),
)
OUTCOMES = ("right", "undecided", "not found", "wrong", "accepted")


def assess(number: int) -> tuple[str, str, str, float]:
    """The kind of part, what the scan shows, the outcome and the seconds of one scan."""
    kind, group = scenes.KINDS[number % 4], number // 4
    variant, views = VARIANTS[group % 8], 1 if (group + group // 2 + group // 8) % 2 else 4
    rng = np.random.default_rng([2026, number])
    shape = scenes.draw_shape(kind, rng)
    model = scenes.build(shape)
    shown = scenes.rings(shape)[: 32 if variant in (scenes.MOVED, scenes.LARGER) else 0]
    scene = scenes.scan(scenes.change(shape, variant, rng), shape, views, rng, shown)
    eye = scene.eye if rng.random() < 0.5 else None
    begin = time.process_time()
    outcome, detail = look(model, scene, eye)
    spent = time.process_time() - begin
    if variant != scenes.RIGHT and outcome in ("right", "wrong"):
        outcome = "accepted"
    label = f"{number} {kind} {variant}, {views} views{'' if eye is None else ', viewpoint'}"
    print(f"{label}: {outcome}, {spent:.1f} s, {detail}", file=sys.stderr, flush=True)
    return kind, variant, outcome, spent


def look(model, scene: scenes.Scene, eye) -> tuple[str, str]:
    """The outcome of ``localize`` for a scan, and its distance or its message."""
    try:
        location = localize("scan", (model.vertices, model.faces), scene.points, viewpoint=eye)
    except CamgenError as error:
        return "undecided" if error.exit_code == 3 else "not found", str(error)
    pose = location.base_from_work
    placed = model.vertices @ np.array(pose.rotation).T + np.array(pose.origin)
    truth = model.vertices @ scene.turn.T + scene.place
    error = float(np.linalg.norm(placed - truth, axis=1).max())
    return "right" if error < OFF else "wrong", f"{error:.3f} mm off"


def main(first: int, count: int, processes: int) -> int:
    numbers = range(first, first + count)
    rows = map_inputs(assess, numbers, processes)
    table = open_table(
        f"part | scan of | scans | {' | '.join(OUTCOMES)} | s, median {{:.1f}} | s, most {{:.1f}}"
    )
    for kind, variant in sorted({row[:2] for row in rows}):
        group = [row for row in rows if row[:2] == (kind, variant)]
        counts = Counter(row[2] for row in group)
        seconds = [row[3] for row in group]
        shown = [counts[outcome] for outcome in OUTCOMES]
        table.add(kind, variant, len(group), *shown, np.median(seconds), max(seconds))
    total = Counter((row[1] == scenes.RIGHT, row[2]) for row in rows)
    rights = sum(number for (sound, _), number in total.items() if sound)
    print(f"{total[True, 'right']} of {rights} right ones found")
    bad = total[True, "wrong"] + total[False, "accepted"]
    return int(bad > 0 or total[True, "right"] < GOAL * rights)


if __name__ == "__main__":
    raise SystemExit(main(*read_words(0, 120, 1)))
