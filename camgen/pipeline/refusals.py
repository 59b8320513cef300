"""Adds the file, line and unit of the input to errors about the instructions of its program."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from camgen.lang.recorded import Recorded
from camgen.model.errors import Blocked, NoSafeProgram, Refused
from camgen.model.part import Part
from camgen.model.pose import FloatArray, Pose
from camgen.model.program import Force, MoveC, MoveJ, MoveL, Output, Program
from camgen.model.text import short
from camgen.plan.unused import is_idle
from camgen.read.units import LARGEST, choose_remedy

#: Remedy for a drawing that is far from the origin.
_MOVE = 'set input.origin = "lower-left", which moves it to x 0, y 0'


@contextmanager
def convert_refusals(part: Part, program: Program) -> Iterator[None]:
    """Convert an error about an instruction of `program` to an error about the input `part`.

    If the input is a program, its line is added, and a remedy without effect on a replay is
    dropped. If the part is out of reach of any arm, the unit in which it was read is added: it is
    probably wrong.
    """
    try:
        yield
    except Refused as error:
        if isinstance(part, Recorded):
            raise _name_line(error, part, program) from error
        raise _name_unit(error, part, program) from error
    except NoSafeProgram as error:
        hint = "" if isinstance(part, Recorded) else _suggest_unit(part)
        if not hint:
            raise
        remedy = "; ".join(filter(None, [error.remedy, hint]))
        if isinstance(error, Blocked):
            raise Blocked(error.file, error.what, error.where, remedy, error.lost) from error
        raise NoSafeProgram(error.file, error.what, error.where, remedy) from error


def _name_line(error: Refused, part: Recorded, program: Program) -> Refused:
    """`error` with the line of the program that was read.

    Posts insert instructions for force control alone, which no replay has. So the index of the
    error is an index of `program`.
    """
    line = _find_line(part, program, error.index)
    if not line:
        return error
    what, _, remedy = error.what.partition("; ")
    remedy = error.remedy or remedy
    if not remedy or is_idle(remedy, "a replay"):
        remedy = "correct this line"
    return Refused(part.source, error.index, f"{error.file} refuses line {line}: {what}", remedy)


def _find_line(part: Recorded, program: Program, index: int) -> int:
    """The line of an instruction; 0 for one that is not in the program that was read.

    The line of an output that lowering has added at the start or the end is the first line that
    sets its signal.
    """
    if index < 0:
        return 0
    refused = program.body[index]
    signal = refused.signal if isinstance(refused, Output) else None
    signal_line = 0
    for instruction, line in zip(part.run.body, part.run.lines, strict=True):
        if _get_target(instruction) is _get_target(refused):
            return line
        if isinstance(instruction, Output) and instruction.signal == signal:
            signal_line = signal_line or line
    return signal_line


def _get_target(instruction: object) -> object:
    """The object that lowering does not copy: the target of a motion, any other instruction."""
    return instruction.target if isinstance(instruction, MoveJ | MoveL | MoveC) else instruction


def _name_unit(error: Refused, part: Part, program: Program) -> Refused:
    """`error` with the file and its unit if a coordinate is refused, otherwise `error` itself."""
    target = (
        _get_target(program.body[error.index]) if 0 <= error.index < len(program.body) else None
    )
    hint = _suggest_unit(part)
    if not (hint and isinstance(target, Pose) and max(map(abs, target.origin)) > LARGEST):
        return error
    # With force control a post has inserted instructions, so the index is not that of `program`.
    place = "" if program.columns.are(Force).any() else f" {program.place_of(error.index)}"
    what, _, remedy = error.what.partition("; ")
    remedy = "; ".join(filter(None, [error.remedy or remedy, hint]))
    return Refused(part.source, error.index, f"{error.file} refuses{place}: {what}", remedy)


def _suggest_unit(part: Part) -> str:
    """The remedy for a part that is beyond the reach of any arm, empty for other parts."""
    points = _list_points(part)
    if not len(points) or np.abs(points).max() <= LARGEST:
        return ""
    lower, upper = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    spans = zip("xyz", lower, upper, strict=False)
    reach = ", ".join(f"{axis} {short(a, 0)} to {short(b, 0)}" for axis, a, b in spans)
    remedies = [choose_remedy(part.source)]
    if np.ptp(points, axis=0).max() <= LARGEST:
        is_flat = part.solid is None and not part.curves
        remedies.append(_MOVE if is_flat else "move it to the origin")
    return f"drawn in {part.units} it lies at {reach} mm: {', or '.join(remedies)}"


def _list_points(part: Part) -> FloatArray:
    """The points of a drawing, a solid or curves, mm; empty for a picture, which has no unit."""
    if part.curves:
        return np.concatenate([curve.points for curve in part.curves])
    if part.solid is not None:
        return part.solid.vertices
    if part.raster is not None or not part.contours:
        return np.zeros((0, 2))
    return np.concatenate([contour.points for contour in part.contours])
