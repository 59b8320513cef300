"""FreeCAD's Path workbench as a peer: the same operations by it, its programs timed and proven as ours."""

from __future__ import annotations

import json
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from msgspec import Struct
from msgspec.structs import replace

import camgen
from camgen.check.stock import Cut
from camgen.check.time import compute_cycle
from camgen.geometry.nesting import find_nesting
from camgen.geometry.segments import make_contour_segments
from camgen.lang.gcode.replayed import interpret
from camgen.lang.recorded import ProgramRun
from camgen.model.job import OperationTable, Step
from camgen.model.program import Instruction, MoveC, MoveJ, MoveL, Output, Program, ToolChange
from camgen.order import JobTour
from camgen.plan.drill import find_circles
from camgen.post.plugins import dynamics_of

FREECAD_PYTHON, _FREECAD = Path("/usr/bin/python3"), Path("/usr/lib/freecad/Mod/Path")
#: Why there is no peer, "" where there is one.
LACKING = "" if FREECAD_PYTHON.exists() and _FREECAD.exists() else "FreeCAD is not installed"
_SCRIPT = Path(__file__).with_name("peer_freecad.py")
_LONGEST = 300.0


class Peer(Struct, frozen=True, eq=False):
    """What the peer made. cuts: by operation. seconds: that took. minutes: of its programs. why: it made none, "" where
    they are there.
    """

    cuts: tuple[Cut, ...] = ()
    minutes: float = 0.0
    seconds: float = 0.0
    why: str = ""


def run(result: camgen.Result) -> Peer:
    """The operations of ``result`` by FreeCAD."""
    if LACKING:
        return Peer(why=LACKING)
    tour = result.tour
    assert isinstance(tour, JobTour)
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder, "operations.json")
        work.write_text(json.dumps(describe(result, tour)), encoding="utf-8")
        command = [str(FREECAD_PYTHON), str(_SCRIPT), str(work), folder]
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, timeout=_LONGEST, check=False
            )
        except subprocess.TimeoutExpired:
            return Peer(why=f"took more than {_LONGEST:g} s")
        if done.returncode:
            return Peer(why=f"fails: {(done.stderr or done.stdout).strip().splitlines()[-1]}")
        told = json.loads(done.stdout.strip().splitlines()[-1])
        texts = [
            Path(folder, f"{k}.ngc").read_text(encoding="utf-8") for k in range(len(tour.steps))
        ]
    runs = [interpret(text.splitlines()) for text in texts]
    for found in runs:
        if found.stopped:
            return Peer(
                why=f"its program cannot be read: line {found.stopped[0]}: {found.stopped[1]}"
            )
    if told["failed"]:
        return Peer(why=f"made no path for operations {', '.join(map(str, told['failed']))}")
    cuts = tuple(_cuts(runs, tour))
    return Peer(cuts, minutes([one.body for one in runs], result), told["seconds"])


def _cuts(runs: list[ProgramRun], tour: JobTour) -> Iterator[Cut]:
    for k, (found, step) in enumerate(zip(runs, tour.steps, strict=True)):
        yield Cut(found.body, found.lines, step.tool, f"{k}.ngc")


def minutes(runs: Sequence[Sequence[Instruction]], result: camgen.Result) -> float:
    """How long programs take by the model of the machine that ``result`` is made for."""
    return sum(_seconds(body, result) for body in runs) / 60


def at_the_part(result: camgen.Result) -> list[list[Instruction]]:
    """What the program of ``result`` does with each tool, without the ways from and to home: a peer's has none."""
    runs: list[list[Instruction]] = [[]]
    for item in result.program.body:
        if isinstance(item, ToolChange):
            runs.append([])
        elif not (isinstance(item, MoveJ) and item.target == result.cell.home):
            runs[-1].append(item)
    return [body for body in runs if any(isinstance(item, MoveL | MoveC) for item in body)]


def _seconds(body: Sequence[Instruction], result: camgen.Result) -> float:
    # Outputs take no time, and a program of one operation leaves the spindle on.
    motions = [item for item in body if not isinstance(item, Output)]
    if isinstance(motions[-1], MoveL | MoveC | MoveJ):
        motions[-1] = replace(motions[-1], blend=0.0)
    whole = result.program
    program = Program(
        "timed", whole.base_from_work, whole.flange_from_tool, tuple(motions), paths=whole.paths
    )
    return compute_cycle(program, dynamics_of(result.post, result.job)).total


# What is asked of it.


def describe(result: camgen.Result, tour: JobTour) -> dict[str, object]:
    """Tools and operations as plain data: mm, mm/s, rpm."""
    contours = [contour for contour in result.part.contours if contour.closed]
    inside = find_nesting(make_contour_segments(contours), len(contours)).depth % 2 == 1
    hole = {contour.id: bool(one) for contour, one in zip(contours, inside.tolist(), strict=True)}
    place = {one.id: (one.x, one.y) for one in find_circles(result.part)}
    steps = list(zip(tour.steps, tour.tours, strict=True))
    return {
        "tolerance": result.job.tolerance.chord,
        "tools": [_tool(step) for step in tour.steps],
        "operations": [_operation(k, *both, contours, hole, place) for k, both in enumerate(steps)],
    }


def _tool(step: Step) -> dict[str, object]:
    tool, process = step.tool, step.process
    found = {
        "name": tool.name,
        "number": tool.number,
        "diameter": tool.diameter,
        "speed": process.spindle,
    }
    drills = step.operation.kind == "drill"  # which goes down with the feed
    return found | {
        "feed": process.feed,
        "plunge": process.feed if drills else process.plunge or process.feed / 3,
    }


def _operation(
    number: int,
    step: Step,
    tour: camgen.Tour,
    contours: list[camgen.Contour],
    hole: dict[str, bool],
    place: dict[str, tuple[float, float]],
) -> dict[str, object]:
    """sides: of what is followed, the loops by the side on which the tool runs."""
    operation, process = step.operation, step.process
    worked = {name for path in tour.paths for name in path.contours}
    found: dict[str, object] = {"kind": operation.kind, "tool": number, "depth": operation.depth}
    found |= {
        "passes": operation.passes,
        "approach": process.approach,
        "clearance": process.clearance,
    }
    if operation.kind == "drill":
        return found | {"holes": [place[path.contours[0]] for path in tour.paths]}
    sides: dict[str, list[object]] = {}
    for contour in contours:
        if contour.id in worked:
            loop = {"points": contour.points.tolist(), "bulges": contour.bulges.tolist()}
            sides.setdefault(_side(operation, hole[contour.id]), []).append(loop)
    tabs = {
        "tabs": operation.tabs,
        "tab_width": operation.tab_width,
        "tab_height": operation.tab_height,
    }
    return found | {"sides": sides} | tabs


def _side(operation: OperationTable, hole: bool) -> str:
    inside = hole if operation.side == "auto" else operation.side == "inside"
    return "Inside" if inside else "Outside"
