"""Convex edges of twelve parts that an arm works in one set-up.

    python -m bench.robots.coverage [PART ...]

The rule, committed before edges were worked in pieces: six parts of others, which stand beside
the repository, and six that ``drawn_parts`` draws with seed 43. A part whose longest side is not
between 100 and 400 mm is scaled to 200 mm. It stands as its file has it on a table; the middle of
its base is at `PLACE` before an IRB 2400, whose spindle of 6 mm leans by 60 deg. All convex edges
are asked for, 2 mm off, with 15 deg of tilt and any roll.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import trimesh

import camgen
from bench.robots.drawn_parts import write_parts
from bench.robots.rfa import CELLS
from bench.support.runner import SHARED, Cells, Scenario, run
from bench.support.timing import timed

SEED = 43
OTHERS = {
    "fandisk": "mesh/trimesh/fandisk.obj",
    "featuretype": "mesh/trimesh/featuretype.STL",
    "angle_block": "mesh/trimesh/angle_block.STL",
    "plate_holes": "mesh/trimesh/plate_holes.STL",
    "1002_tray_bottom": "mesh/trimesh/1002_tray_bottom.STL",
    "NIST_MBE_PMI_6": "step/brlcad/NIST_MBE_PMI_6.stp",
}
#: Sides, mm, that a part may have, and that which others get.
_LEAST, _MOST, _SCALED = 100.0, 400.0, 200.0
#: mm, base frame: where the middle of the base of each part stands.
PLACE = (1000.0, 0.0, 600.0)
ROBOT = "IRB 2400"
COLUMNS = (
    "part | convex edges | mm {:,.0f} | worked, mm {:,.0f} | of it {:.1f} % | edges worked "
    "| pieces | s {:.1f}"
)


def list_parts(folder: Path, names: Sequence[str]) -> Iterator[tuple[str, camgen.Part]]:
    """The parts of these names, or all without names; parts that are missing are left out."""
    files = {name: SHARED / file for name, file in OTHERS.items()}
    files |= write_parts(folder, SEED)
    for name, file in files.items():
        if file.exists() and (not names or name in names):
            yield name, _read(file)


def _read(file: Path) -> camgen.Part:
    part = camgen.read(file)
    longest = float(np.ptp(part.solid.vertices, axis=0).max())
    if _LEAST <= longest <= _MOST:
        return part
    scaled = trimesh.load_mesh(file)
    scaled.apply_scale(_SCALED / longest)
    return camgen.part(scaled, file.stem)


def make_job(part: camgen.Part) -> dict[str, dict[str, object]]:
    """The job of a part in its set-up."""
    low, high = part.solid.vertices.min(axis=0), part.solid.vertices.max(axis=0)
    middle = [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]]
    *_, lean, shaft, tall, wide = CELLS[ROBOT]
    tip = [-shaft * np.sin(np.radians(lean)), 0.0, tall + shaft * np.cos(np.radians(lean))]
    frame = [float(place - base) for place, base in zip(PLACE, middle, strict=True)]
    # The table that camgen assumes, for judges that read the job.
    table = [*(low[:2] - 200.0), low[2] - 20.5, *(high[:2] + 200.0), low[2] - 0.5]
    return {
        "input": {"select": "convex"},
        "operation": {"offset": 2.0},
        "tool": {
            "holder": [[-wide, -wide, 0.0, wide, wide, tall]],
            "axis_tilt": 15.0,
            "symmetric": True,
        },
        "cell": {
            "robot": ROBOT,
            "base_from_work": [*frame, 0.0, 0.0, 0.0],
            "flange_from_tool": [*map(float, tip), 0.0, -lean, 0.0],
            "fixtures": [[float(corner) for corner in table]],
        },
    }


def _build(part: camgen.Part) -> camgen.Result | None:
    try:
        return camgen.build(part, post="rapid", job=make_job(part))
    except (camgen.NoSafeProgram, camgen.InputError):
        return None


def measure(name: str, part: camgen.Part) -> Iterator[Cells]:
    """The row of a part."""
    edges = [edge for edge in part.solid.edges if edge.convex]
    result, seconds = timed(partial(_build, part))
    paths = () if result is None else result.tour.paths
    worked = {path.contours[0] for path in paths}
    done = 0.0 if result is None else sum(result.tour.lengths)
    length = sum(edge.length for edge in edges)
    counts = len(worked), len(paths), round(seconds, 1)
    yield name, len(edges), length, done, 100 * done / length, *counts


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        sys.exit(run(Scenario(COLUMNS, list_parts(Path(folder), sys.argv[1:]), measure)))
