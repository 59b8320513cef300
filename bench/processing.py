"""Which edges of the RFA parts three robots reach: with the nominal pose, and with tilt and roll freed.

    python bench/processing.py [TILT]

The cell is one of our own, like the paper's: the part stands upright in front of the robot, turned by 45 deg, its
middle over ``CENTRES`` (mm, base frame; z is the table), rfa1 on its base of 40 mm, rfa2 on the table. The tool is a
spindle that leans by 45 deg from the flange's axis, its tip 240 mm beyond the flange and 60 mm beside it; offset 2 mm.
Of some places and tools these were the ones from which the nominal pose reaches most. TILT: deg (default 15).

Collisions are not looked at but for one: the flange has to stay 60 mm above the bottom of the part, which stands for
the table and the base, so that edges are lost and won by ``clear`` too. Times: mean and greatest per edge.
"""

from __future__ import annotations

import math
import sys
import time
from pathlib import Path

import numpy as np
from machine import machine
from numpy.typing import NDArray

from camgen.edges.picked import select
from camgen.edges.reach import reach
from camgen.edges.results import Freedom, Reached, Setup, Unreached
from camgen.pose import FloatArray, pose_from_values, rotation_about
from camgen.robots.forward import flange
from camgen.robots.models import robot
from camgen.solid import Edge, Solid
from camgen.solids import mesh

PARTS = Path(__file__).parents[1] / "fixtures" / "parts"
CENTRES = {"IRB 2000": (900.0, 0.0, 800.0), "IRB 2400": (900.0, 0.0, 600.0), "IRB 1200": (400.0, 0.0, 300.0)}
RAISED = {"rfa1": 40.0, "rfa2": 0.0}
TOOL = (-60.0, 0.0, 240.0, 0.0, -45.0, 0.0)
OFFSET, ROOM, TURN = 2.0, 60.0, 45.0


def setup(name: str, solid: Solid) -> Setup:
    of = robot(name)
    x, y, z = CENTRES[name]
    middle = (solid.vertices.min(axis=0) + solid.vertices.max(axis=0)) / 2
    across = rotation_about(2, math.radians(TURN)) @ [middle[0], middle[1], 0.0]
    bottom = z + RAISED[solid.name]
    base_from_work = pose_from_values((x - across[0], y - across[1], bottom, 0, 0, TURN))

    def clear(joints: FloatArray) -> NDArray[np.bool_]:
        return np.asarray(flange(of, joints)[1][:, 2] > bottom + ROOM)

    return Setup(of, base_from_work, pose_from_values(TOOL), clear, lambda _: "the flange with the table")


def timed(edges: list[Edge], cell: Setup, freedom: Freedom) -> tuple[list[Reached | Unreached], str]:
    results: list[Reached | Unreached] = []
    each = []
    for edge in edges:
        begun = time.perf_counter()
        results += reach([edge], cell, OFFSET, "mean", freedom)
        each.append(1e3 * (time.perf_counter() - begun))
    good = sum(isinstance(r, Reached) for r in results)
    return results, f"{good} ({np.mean(each):.0f}, {max(each):.0f} ms)"


def said(result: Reached | Unreached) -> str:
    if isinstance(result, Unreached):
        return f"not reached: {result.text}"
    if result.freed is None:
        return ""
    tilt, roll = result.freed
    return f"{tilt:.1f} deg of tilt, {roll:.0f} deg of roll, {len(result.way)} rows"


def main(degrees: float) -> None:
    tilt = math.radians(degrees)
    freedoms = (Freedom(), Freedom(roll=True), Freedom(tilt), Freedom(tilt, roll=True))
    solids = {part: mesh.read(PARTS / f"{part}.stl") for part in RAISED}
    reach(solids["rfa1"].edges, setup("IRB 2400", solids["rfa1"]), OFFSET, "mean", freedoms[-1])
    lines = []
    print(f"\n| part | robot | edges | nominal | any roll | {degrees:g} deg of tilt | both |")
    print("|---|---|---|---|---|---|---|")
    for part, solid in solids.items():
        chosen = set(select(solid, ["convex", "not bottom"]))
        edges = [edge for edge in solid.edges if edge.id in chosen]
        for name in CENTRES:
            cell = setup(name, solid)
            found = [timed(edges, cell, freedom) for freedom in freedoms]
            print(f"| {part} | {name} | {len(edges)} | " + " | ".join(text for _, text in found) + " |")
            lines += [f"{part}, {name}, {r.id}: {said(r)}" for r in found[-1][0] if said(r)]
    print("\nWith both:\n", *lines, sep="\n- ")


if __name__ == "__main__":
    print(machine())
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 15.0)
