"""FreeCAD's Path workbench as a peer: the same operations, timed and proven as camgen's own."""

from __future__ import annotations

import json
import subprocess
import tempfile
from collections.abc import Sequence
from itertools import chain
from pathlib import Path
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

import camgen
from camgen.check.stock import Cut
from camgen.check.time import compute_cycle
from camgen.geometry.nesting import find_nesting
from camgen.geometry.segments import make_contour_segments
from camgen.lang.gcode import interpret
from camgen.model.job import OperationTable, Step
from camgen.model.program import Instruction, MoveC, MoveJ, MoveL, Output, Program, ToolChange
from camgen.order import JobTour
from camgen.plan.drill import find_circles
from camgen.post.plugins import dynamics_of

FREECAD_PYTHON, _FREECAD = Path("/usr/bin/python3"), Path("/usr/lib/freecad/Mod/Path")
#: The reason for which there is no peer; empty if there is one.
LACKING = "" if FREECAD_PYTHON.exists() and _FREECAD.exists() else "FreeCAD is not installed"
_SCRIPT = Path(__file__).with_name("peer_freecad.py")
#: Limit of a run, s.
_LONGEST = 300.0


class Peer(Struct, frozen=True, eq=False):
    """The programs of the peer.

    cuts: a program for each operation.
    minutes: time of the programs.
    seconds: time until they were there.
    why: the reason for which there is no program; empty if there is one.
    """

    cuts: tuple[Cut, ...] = ()
    minutes: float = 0.0
    seconds: float = 0.0
    why: str = ""


def run(result: camgen.Result) -> Peer:
    """The operations of a build by FreeCAD."""
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
        report = json.loads(done.stdout.strip().splitlines()[-1])
        texts = [Path(folder, f"{k}.ngc").read_text() for k in range(len(tour.steps))]
    cuts, bodies = [], []
    for k, (text, step) in enumerate(zip(texts, tour.steps, strict=True)):
        program = interpret(text.splitlines())
        if program.stopped:
            line, reason = program.stopped
            return Peer(why=f"its program cannot be read: line {line}: {reason}")
        cuts.append(Cut(program.body, program.lines, step.tool, f"{k}.ngc"))
        bodies.append(program.body)
    if report["failed"]:
        return Peer(why=f"made no path for operations {', '.join(map(str, report['failed']))}")
    return Peer(tuple(cuts), measure_minutes(bodies, result), report["seconds"])


def measure_minutes(bodies: Sequence[Sequence[Instruction]], result: camgen.Result) -> float:
    """The time of programs by the model of the machine that a build is made for."""
    return sum(_measure_seconds(body, result) for body in bodies) / 60


def list_bodies(result: camgen.Result) -> list[list[Instruction]]:
    """The instructions of a build with each tool, without motions from and to home."""
    bodies: list[list[Instruction]] = [[]]
    for item in result.program.body:
        if isinstance(item, ToolChange):
            bodies.append([])
        elif not (isinstance(item, MoveJ) and item.target == result.cell.home):
            bodies[-1].append(item)
    return [body for body in bodies if any(map(_is_cut, body))]


def _is_cut(item: Instruction) -> bool:
    return isinstance(item, MoveL | MoveC)


def _measure_seconds(body: Sequence[Instruction], result: camgen.Result) -> float:
    # Outputs take no time, and a program of one operation leaves the spindle on.
    motions = [item for item in body if not isinstance(item, Output)]
    if isinstance(motions[-1], MoveL | MoveC | MoveJ):
        motions[-1] = replace(motions[-1], blend=0.0)
    whole = result.program
    frames = whole.base_from_work, whole.flange_from_tool
    program = Program("timed", *frames, tuple(motions), paths=whole.paths)
    return compute_cycle(program, dynamics_of(result.post, result.job)).total


def describe(result: camgen.Result, tour: JobTour) -> dict[str, object]:
    """Tools and operations as plain data: mm, mm/s, rpm."""
    contours = [contour for contour in result.part.contours if contour.closed]
    depths = find_nesting(make_contour_segments(contours), len(contours)).depth.tolist()
    loops: dict[str, dict[str, Any]] = {}
    for contour, depth in zip(contours, depths, strict=True):
        points, bulges = contour.points.tolist(), contour.bulges.tolist()
        loops[contour.id] = {"points": points, "bulges": bulges, "is_hole": depth % 2 == 1}
    centres = {circle.id: (circle.x, circle.y) for circle in find_circles(result.part)}
    operations = []
    for number, (step, paths) in enumerate(zip(tour.steps, tour.tours, strict=True)):
        operation, process = step.operation, step.process
        row = {"kind": operation.kind, "tool": number, "depth": operation.depth}
        row |= {"passes": operation.passes, "approach": process.approach}
        row |= {"clearance": process.clearance, "tabs": operation.tabs}
        row |= {"tab_width": operation.tab_width, "tab_height": operation.tab_height}
        if operation.kind == "drill":
            row["holes"] = [centres[path.contours[0]] for path in paths.paths]
        else:
            worked = set(chain.from_iterable(path.contours for path in paths.paths))
            row["sides"] = _split_sides(
                operation, [loops[name] for name in loops if name in worked]
            )
        operations.append(row)
    tools = [_describe_tool(step) for step in tour.steps]
    return {"tolerance": result.job.tolerance.chord, "tools": tools, "operations": operations}


def _describe_tool(step: Step) -> dict[str, object]:
    tool, process = step.tool, step.process
    plunge = process.plunge or process.feed / 3
    if step.operation.kind == "drill":
        plunge = process.feed
    return {
        "name": tool.name,
        "number": tool.number,
        "diameter": tool.diameter,
        "speed": process.spindle,
        "feed": process.feed,
        "plunge": plunge,
    }


def _split_sides(
    operation: OperationTable, loops: list[dict[str, Any]]
) -> dict[str, list[dict[str, Any]]]:
    """The loops of an operation by the side on which its tool runs."""
    sides: dict[str, list[dict[str, Any]]] = {}
    for loop in loops:
        is_inside = operation.side == "inside"
        if operation.side == "auto":
            is_inside = loop["is_hole"]
        sides.setdefault("Inside" if is_inside else "Outside", []).append(loop)
    return sides
