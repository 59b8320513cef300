"""The cells of the RFA paper: edges reached, time, and every pose of the program again by a plain loop over fcl.

    python -m bench.robots.rfa [RUNS, 5] [PART] [ROBOT]   all parts and robots, or those named
    python -m bench.robots.rfa paper                      figures 16 and 18: the edges in their order, IRB 2000, nominal

The parts are those of ``fixtures/parts``, in cells of our own: the part stands upright on a table, rfa1 on its base,
and a spindle of 6 mm leans from a holder at the flange. Of some places and tools each robot has the one from which the
nominal orientation, which is all the paper has, reaches most edges. The program is read back from its text, its joints
are found again, and a loop without prefilter asks fcl about every pair of bodies at every one of its rows. Exits with 1
where a verdict differs or the program is not what was planned.
"""

from __future__ import annotations

import math
import sys
import tempfile
from functools import partial
from pathlib import Path

import numpy as np

import camgen
from bench.robots.plain_loop import Loop
from bench.support.runner import PARTS, Table, machine
from bench.support.timing import Process, measure_process, median_seconds, python, timed
from camgen.check.reach import check_reach
from camgen.model.pose import Pose, pose_from_values, rotation_about
from camgen.model.toml import format_toml
from camgen.post.plugins import find_readback
from camgen.preview.view import make_view
from camgen.read.files import Files
from camgen.read.solid import mesh
from camgen.robots.catalogue import find_robot
from camgen.robots.models import Box, Link

RAISED = {"rfa1": 40.0, "rfa2": 0.0}
#: By robot: x and z of the table under the part's middle, the part's yaw and the tool's lean (deg), the lengths of
#: shaft and holder, half the holder's width (mm).
CELLS = {
    "IRB 2000": (1100.0, 750.0, 135.0, 60.0, 80.0, 100.0, 35.0),
    # By camgen place: as many edges with the nominal tool as in the paper.
    "IRB 2000, nominal rfa1": (1041.0, 1054.0, 180.0, 30.0, 120.0, 100.0, 35.0),
    "IRB 2000, nominal rfa2": (892.0, 1222.0, 0.0, 30.0, 120.0, 100.0, 35.0),
    "IRB 2400": (1000.0, 600.0, 0.0, 60.0, 120.0, 100.0, 35.0),
    "IRB 1200": (500.0, 0.0, 180.0, 30.0, 80.0, 100.0, 35.0),
}
FREE = {"axis_tilt": 15.0, "symmetric": True}


def cell(part: camgen.Solid, name: str) -> dict[str, dict[str, object]]:
    """The job."""
    x, z, yaw, lean, shaft, high, wide = CELLS[name]
    low, top, raised = part.vertices.min(axis=0), part.vertices.max(axis=0), RAISED[part.name]
    middle = rotation_about(2, math.radians(yaw)) @ [*((low + top) / 2)[:2], 0.0]
    fixtures = [
        [low[0] - 100, low[1] - 100, -raised - 20, top[0] + 100, top[1] + 100, -raised - 0.5]
    ]
    if raised:
        fixtures.append([low[0] + 15, low[1] + 15, -raised, top[0] - 15, top[1] - 15, -0.5])
    angle = math.radians(lean)
    tip = [-shaft * math.sin(angle), 0.0, high + shaft * math.cos(angle), 0.0, -lean, 0.0]
    return {
        "input": {"select": "convex, not bottom"},
        "operation": {"offset": 2.0},
        "tool": {"holder": [[-wide, -wide, 0.0, wide, wide, high]]},
        "cell": {
            "robot": name.partition(",")[0],
            "base_from_work": [float(x - middle[0]), float(-middle[1]), z + raised, 0.0, 0.0, yaw],
            "flange_from_tool": tip,
            "fixtures": [[float(v) for v in box] for box in fixtures],
        },
    }


def box(low: list[float], high: list[float], frame: Pose) -> Box:
    a, b = np.array(low), np.array(high)
    return Box(Pose(frame.rotation, tuple(frame.apply((a + b) / 2))), tuple(((b - a) / 2).tolist()))


def loop(result: camgen.Result, solid: camgen.Solid) -> Loop:
    """The cell again, straight from the job: what stands, the holder, and the shaft from its tip to the holder."""
    job, of = result.job, find_robot(result.job.cell.robot)
    base_from_work = pose_from_values(job.cell.base_from_work)
    here = pose_from_values([0.0] * 6)
    fixtures = job.cell.fixtures or []
    standing = tuple(
        Link(f"fixture {k}", (box(b[:3], b[3:], base_from_work),))
        for k, b in enumerate(fixtures, 1)
    )
    (holder,) = job.tool.holder or []
    tip = pose_from_values(job.cell.flange_from_tool)
    back = tip.rotation[:, 2]
    # The shaft begins where its axis leaves the holder: the nearest of its faces on the way up from the tip.
    ways = [
        (tip.origin[k] - end) / back[k]
        for k in range(3)
        for end in holder[k::3]
        if abs(back[k]) > 1e-9
    ]
    inside = [s for s in ways if s > 0 and all(
        low - 1e-6 <= v <= high + 1e-6
        for v, low, high in zip(np.array(tip.origin) - s * back, holder[:3], holder[3:], strict=True))]  # fmt: skip
    length, half = min(inside), job.tool.diameter / 2
    shaft = Box(
        Pose(tip.rotation, tuple(np.array(tip.origin) - length / 2 * back)),
        (half, half, length / 2),
    )
    tool = (Link("tool", (shaft,)), Link("holder", (box(holder[:3], holder[3:], here),)))
    contact = half * math.sin(math.radians(job.tool.axis_tilt)) + 0.1
    # Boxes of wrist and holder that meet at home are not tested.
    assert result.where is not None
    allowed = tuple(pair.bodies for pair in result.where.untested)
    return Loop(of, solid, base_from_work, standing, tool, contact, allowed)


def differ(result: camgen.Result, solid: camgen.Solid) -> tuple[int, int]:
    """How many rows of the program, as its text says it, the plain loop finds to collide; and of how many."""
    reading = find_readback("rapid")(
        {file.name: file.text for file in result.files}, result.job.post
    )
    cell_ = result.cell
    program = camgen.Program("read", cell_.base_from_work, cell_.flange_from_tool, reading.body)
    joints = check_reach(program, find_robot(result.job.cell.robot), "read").joints
    judge = loop(result, solid)
    return sum(judge.first(row) is not None for row in joints), len(joints)


def whole(path: Path, job: dict[str, dict[str, object]]) -> Process:
    """A build as a process of its own."""
    words = ["--post", "rapid", "-q", "-o", path.with_suffix(".mod")]
    for table, keys in job.items():
        words += [f"--set={table}.{key}={format_toml(value)}" for key, value in keys.items()]
    return measure_process(python("camgen", "build", path, *words))


def alone(runs: int) -> float:
    """Seconds of a process that loads the libraries and the mesh and does nothing."""
    read = f"import numpy, fcl, trimesh; trimesh.load_mesh({str(PARTS / 'rfa1.stl')!r})"
    return median_seconds(lambda: measure_process([sys.executable, "-c", read]), runs)


def count_whole(result: camgen.Result) -> int:
    """The number of edges that are run whole."""
    return sum(path.id in path.contours for path in result.tour.paths)


def paper() -> int:
    """The edges of both parts in their order, as figures 16 and 18 have them, and seconds of the command."""
    print(f"{machine()}\n")
    for name, paper_edges, paper_seconds in (("rfa1", "13 of 15", 19), ("rfa2", "16 of 20", 26)):
        job = PARTS / f"{name}_nominal.toml"
        file = PARTS / f"{name}.stl"
        result, spent = timed(partial(camgen.build, file, post="rapid", job=job))
        skipped = [note for note in result.notes if note.kind == "skipped"]
        count = count_whole(result)
        print(
            f"{name}: {count} of {count + len(skipped)} edges whole, paper {paper_edges};", end=" "
        )
        print(f"{spent:.1f} s, paper {paper_seconds} s; program {result.cycle.total:.1f} s")
        table = Table("order | edge | kind | mm {:.1f} | s {:.1f}")
        for k, line in enumerate(make_view(result).rows, start=1):
            table.add(k, line.id, line.layer, line.length, line.seconds)
        for note in skipped:
            table.add("left out", note.ids[0], note.why)
        print()
    return 0


def main(arguments: list[str]) -> int:
    if arguments[:1] == ["paper"]:
        return paper()
    runs = int(arguments[0]) if arguments else 5  # processes, of which the median counts
    parts, names = arguments[1:2] or RAISED, arguments[2:3] or CELLS
    print(f"{machine()}\n")
    print(
        f"A process that imports numpy, trimesh and fcl, reads rfa1 and does nothing: {alone(runs):.2f} s."
    )
    print("Seconds of a build: nominal, freed.")
    table = Table(
        "part | robot | edges | nominal | tilt, roll | links, nearest | build, s {:.2f}, {:.2f} "
        "| process, s {:.2f}, {:.2f} | rows {:,} | collide"
    )
    bad = 0
    with tempfile.TemporaryDirectory() as folder:
        for part in parts:
            path = Path(folder) / f"{part}.stl"
            path.write_bytes((PARTS / path.name).read_bytes())
            solid = mesh.read(Files().read(path))
            for name in names:
                if "nominal" not in name or name.endswith(part):
                    bad += row(table, path, solid, name, runs)
    return 1 if bad else 0


def row(table: Table, path: Path, solid: camgen.Solid, name: str, runs: int) -> int:
    """The rows of a part and a robot; 1 if the plain loop finds a hit or nothing is built."""
    # Links as fast as the joints allow, as in the paper.
    job = {**cell(solid, name), "process": {"travel": 5000.0}}
    counts, built, spent = [], [], []
    lost: list[str] = []
    for free in ({}, FREE):
        tables = {**job, "tool": {**job["tool"], **free}}
        try:
            result, seconds = timed(partial(camgen.build, path, post="rapid", job=tables))
        except camgen.NoSafeProgram as error:
            table.add(solid.name, name, str(error))
            return 1
        built.append(seconds)
        counts.append(count_whole(result))
        lost = [f"{note.what}: {note.why}" for note in result.notes if note.kind == "skipped"]
        spent.append(median_seconds(partial(whole, path, tables), runs))
    collide, rows = differ(result, solid)
    links = next(note.what for note in result.notes if note.what.startswith("links"))
    times = links.rpartition("; ")[2].replace("nearest neighbour ", "")
    total = counts[1] + len(lost)
    seconds = tuple(built), tuple(spent)
    table.add(solid.name, name, total, *counts, times, *seconds, rows, collide)
    for text in lost:
        table.add(solid.name, name, f"left out: {text}")
    return int(collide > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
