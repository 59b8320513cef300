"""The cells of the RFA paper: edges reached, times, and every pose again by a plain loop over fcl.

    python -m bench.robots.rfa [RUNS, 3] [PART] [ROBOT]   all parts and robots, or those named
    python -m bench.robots.rfa paper                      figures 16 and 18, IRB 2000, nominal tool

The parts are those of ``fixtures/parts``, in cells of our own: the part stands upright on a table,
rfa1 on its base, and a spindle of 6 mm leans from a holder at the flange. Each robot has the place
and the tool from which the nominal orientation reaches most edges; the paper has no other one. The
program is read back from its text and its joint values are found again. A loop without a filter
asks fcl about every pair of bodies at every row. "Process" is the least time of the processor of
RUNS commands, nan of none. Exits with 1 if a row collides or nothing is built.
"""

from __future__ import annotations

import math
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np

import camgen
from bench.robots.plain_loop import Loop, Setting
from bench.support.runner import PARTS, Cells, Scenario, Table, machine, must_be_none, run
from bench.support.timing import Process, measure_process, python, timed
from camgen.check.reach import check_reach
from camgen.model.pose import Pose, pose_from_values, rotation_about, translation
from camgen.model.toml import format_toml
from camgen.post.plugins import find_readback
from camgen.preview.view import make_view
from camgen.read.files import Files
from camgen.read.solid import mesh
from camgen.robots.catalogue import find_robot
from camgen.robots.models import Box, Link

#: Height of the base under each part, mm.
RAISED = {"rfa1": 40.0, "rfa2": 0.0}
#: For each robot: x and z of the table under the middle of the part, mm, yaw of the part and lean
#: of the tool, deg, length of the shaft, length of the holder and half of its width, mm.
CELLS = {
    "IRB 2000": (1100.0, 750.0, 135.0, 60.0, 80.0, 100.0, 35.0),
    # Cells of `camgen place`: as many edges with the nominal tool as in the paper.
    "IRB 2000, nominal rfa1": (1041.0, 1054.0, 180.0, 30.0, 120.0, 100.0, 35.0),
    "IRB 2000, nominal rfa2": (892.0, 1222.0, 0.0, 30.0, 120.0, 100.0, 35.0),
    "IRB 2400": (1000.0, 600.0, 0.0, 60.0, 120.0, 100.0, 35.0),
    "IRB 1200": (500.0, 0.0, 180.0, 30.0, 80.0, 100.0, 35.0),
}
FREE = {"axis_tilt": 15.0, "symmetric": True}
#: Edges and planning time, s, of the paper.
PAPER = {"rfa1": ("13 of 15", 19), "rfa2": ("16 of 20", 26)}
COLUMNS = (
    "part | robot | edges | nominal | tilt, roll | links, nearest | process, s {:.2f}, {:.2f} "
    "| program, s {:.1f}, {:.1f} | stops {}, {} | rows {:,} | collide"
)
Job = dict[str, dict[str, object]]


def make_job(part: camgen.Solid, name: str) -> Job:
    """The job of a part in the cell of a name."""
    x, z, yaw, lean, shaft, high, wide = CELLS[name]
    low, top, raised = part.vertices.min(axis=0), part.vertices.max(axis=0), RAISED[part.name]
    middle = rotation_about(2, math.radians(yaw)) @ [*((low + top) / 2)[:2], 0.0]
    table = [*(low[:2] - 100), -raised - 20, *(top[:2] + 100), -raised - 0.5]
    base = [*(low[:2] + 15), -raised, *(top[:2] - 15), -0.5]
    fixtures = np.array([table, base] if raised else [table])
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
            "fixtures": fixtures.tolist(),
        },
    }


def _make_box(corners: list[float], frame: Pose) -> Box:
    low, high = np.array(corners[:3]), np.array(corners[3:])
    middle = Pose(frame.rotation, tuple(frame.apply((low + high) / 2)))
    return Box(middle, tuple(((high - low) / 2).tolist()))


def make_loop(result: camgen.Result, solid: camgen.Solid) -> Loop:
    """The cell of a job: its fixtures, the holder, and the shaft from its tip to the holder."""
    job = result.job
    base_from_work = pose_from_values(job.cell.base_from_work)
    standing = []
    for k, corners in enumerate(job.cell.fixtures or [], 1):
        standing.append(Link(f"fixture {k}", (_make_box(corners, base_from_work),)))
    (holder,) = job.tool.holder or []
    tip, half = pose_from_values(job.cell.flange_from_tool), job.tool.diameter / 2
    length = _measure_shaft(tip, holder)
    middle = np.array(tip.origin) - length / 2 * tip.rotation[:, 2]
    shaft = Box(Pose(tip.rotation, tuple(middle)), (half, half, length / 2))
    tool = (Link("tool", (shaft,)), Link("holder", (_make_box(holder, translation(0, 0, 0)),)))
    contact = half * math.sin(math.radians(job.tool.axis_tilt)) + 0.1
    # Boxes of wrist and holder that meet at home are not tested.
    allowed = tuple(pair.bodies for pair in result.where.untested)
    setting = Setting(solid, base_from_work, tuple(standing), tool, contact, allowed)
    return Loop(find_robot(job.cell.robot), setting)


def _measure_shaft(tip: Pose, holder: list[float]) -> float:
    """The length of the axis from the tip to the nearest face of the holder, mm."""
    with np.errstate(divide="ignore"):
        faces = (np.array(tip.origin) - np.reshape(holder, (2, 3))) / tip.rotation[:, 2]
    return float(faces.min(axis=0).max())


def count_hits(result: camgen.Result, solid: camgen.Solid) -> tuple[int, int]:
    """The number of rows of the program's text that collide, and the number of all rows."""
    texts = {file.name: file.text for file in result.files}
    reading = find_readback("rapid")(texts, result.job.post)
    frames = result.cell.base_from_work, result.cell.flange_from_tool
    program = camgen.Program("read", *frames, reading.body)
    joints = check_reach(program, find_robot(result.job.cell.robot), "read").joints
    loop = make_loop(result, solid)
    return sum(loop.find_hit(row) is not None for row in joints), len(joints)


def run_build(path: Path, job: Job) -> Process:
    """A build as a process of its own."""
    words = ["--post", "rapid", "-q", "-o", path.with_suffix(".mod")]
    for table, keys in job.items():
        words += [f"--set={table}.{key}={format_toml(value)}" for key, value in keys.items()]
    return measure_process(python("camgen", "build", path, *words))


def count_whole(result: camgen.Result) -> int:
    """The number of edges that are worked whole."""
    return sum(path.id in path.contours for path in result.tour.paths)


def list_left_out(result: camgen.Result) -> list[camgen.Note]:
    """The notes on edges that are left out."""
    return [note for note in result.notes if note.kind == "skipped"]


def compare_paper() -> None:
    """Prints the edges of both parts in their order, and the seconds of the build."""
    print(f"{machine()}\n")
    for name, (paper_edges, paper_seconds) in PAPER.items():
        file, job = PARTS / f"{name}.stl", PARTS / f"{name}_nominal.toml"
        result, seconds = timed(partial(camgen.build, file, post="rapid", job=job))
        skipped, count = list_left_out(result), count_whole(result)
        edges = f"{count} of {count + len(skipped)} edges whole, paper {paper_edges}"
        times = f"{seconds:.1f} s, paper {paper_seconds} s; program {result.cycle.total:.1f} s"
        print(f"{name}: {edges}; {times}")
        table = Table("order | edge | kind | mm {:.1f} | s {:.1f}")
        for k, line in enumerate(make_view(result).rows, start=1):
            table.add(k, line.id, line.layer, line.length, line.seconds)
        for note in skipped:
            table.add("left out", note.ids[0], note.why)
        print()


def count_stops(result: camgen.Result) -> int:
    """The number of corners of links that end in a stop."""
    (passed,) = [note.what.split() for note in result.notes if "without a stop" in note.what]
    return int(passed[2]) - int(passed[0])


def measure(part: str, name: str, folder: Path, runs: int) -> Iterator[Cells]:
    """The rows of a part and a robot, with the nominal tool and with the freed one."""
    path = folder / f"{part}.stl"
    path.write_bytes((PARTS / path.name).read_bytes())
    solid = mesh.read(Files().read(path))
    # Links as fast as the joints allow, as in the paper.
    job = {**make_job(solid, name), "process": {"travel": 5000.0}}
    results, spent = [], []
    for free in ({}, FREE):
        tables = {**job, "tool": {**job["tool"], **free}}
        results.append(camgen.build(path, post="rapid", job=tables))
        processes = [run_build(path, tables).processor for _ in range(runs)]
        spent.append(min(processes, default=math.nan))
    freed = results[1]
    hits, rows = count_hits(freed, solid)
    links = next(note.what for note in freed.notes if note.what.startswith("links"))
    times = links.rpartition("; ")[2].replace("nearest neighbour ", "")
    counts, lost = [count_whole(result) for result in results], list_left_out(freed)
    programs = tuple(result.cycle.total for result in results)
    stops = tuple(map(count_stops, results))
    figures = times, tuple(spent), programs, stops, rows, must_be_none(hits)
    yield part, name, counts[1] + len(lost), *counts, *figures
    for note in lost:
        yield part, name, f"left out: {note.what}: {note.why}"


def main(arguments: list[str]) -> int:
    """Prints the tables; 1 if a row collides or nothing is built."""
    if arguments[:1] == ["paper"]:
        compare_paper()
        return 0
    runs = int(arguments[0]) if arguments else 3
    parts, names = arguments[1:2] or RAISED, arguments[2:3] or CELLS
    with tempfile.TemporaryDirectory() as folder:
        inputs = []
        for part, name in product(parts, names):
            if "nominal" not in name or name.endswith(part):
                inputs.append((part, name, Path(folder), runs))
        return run(Scenario(COLUMNS, inputs, measure), note="; pairs: nominal, freed")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
