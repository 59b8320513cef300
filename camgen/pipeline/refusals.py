"""What a controller or an arm refuses, told in the words of the input: its file, line and unit, what can be done."""

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
def tell_by_input(part: Part, program: Program) -> Iterator[None]:
    """What is raised about an instruction of ``program`` is told about the input that it was made of.

    Of a program that was read: with the line, and without a remedy that a replay does not take. Of a part whose
    coordinates no arm reaches: with the unit that it was read in, which is likely the fault.
    """
    try:
        yield
    except Refused as error:
        if isinstance(part, Recorded):
            raise _of_line(error, part, program) from error
        raise _of_unit(error, part, program) from error
    except NoSafeProgram as error:
        doubt = "" if isinstance(part, Recorded) else _doubt_unit(part)
        if not doubt:
            raise
        remedy = "; ".join(filter(None, [error.remedy, doubt]))
        if isinstance(error, Blocked):
            raise Blocked(error.file, error.what, error.where, remedy, error.lost) from error
        raise NoSafeProgram(error.file, error.what, error.where, remedy) from error


def _of_line(error: Refused, part: Recorded, program: Program) -> Refused:
    """``error`` with the line of the program that was read. Force control is in none, hence the index is that of
    ``program``.
    """
    line = _line(part, program, error.index)
    if not line:
        return error
    what, _, remedy = error.what.partition("; ")
    remedy = error.remedy or remedy
    told = remedy if remedy and not is_idle(remedy, "a replay") else "mend this line"
    return Refused(part.source, error.index, f"{error.file} refuses line {line}: {what}", told)


def _line(part: Recorded, program: Program, index: int) -> int:
    """The line of an instruction, 0 where it is none of the program that was read. Of an output that is switched off
    first or last: the first line that uses it.
    """
    if index < 0:
        return 0
    wanted = program.body[index]
    read = list(zip(part.run.body, part.run.lines, strict=True))
    same = (line for item, line in read if _own(item) is _own(wanted))
    used = (
        line for item, line in read if isinstance(wanted, Output) and _is_of(item, wanted.signal)
    )
    return next(same, 0) or next(used, 0)


def _is_of(item: object, signal: str) -> bool:
    return isinstance(item, Output) and item.signal == signal


def _own(item: object) -> object:
    """What lowering passes on as it is: the target of a motion, any other instruction."""
    return item.target if isinstance(item, MoveJ | MoveL | MoveC) else item


def _of_unit(error: Refused, part: Part, program: Program) -> Refused:
    """``error`` with the file and the unit where a coordinate is what is refused, else as it is."""
    item = program.body[error.index] if 0 <= error.index < len(program.body) else None
    target = item.target if isinstance(item, MoveJ | MoveL | MoveC) else None
    doubt = _doubt_unit(part)
    if not (doubt and isinstance(target, Pose) and max(map(abs, target.origin)) > LARGEST):
        return error
    # Posts that press insert instructions before they count.
    place = "" if program.columns.are(Force).any() else f" {program.place_of(error.index)}"
    what, _, remedy = error.what.partition("; ")
    remedy = "; ".join(filter(None, [error.remedy or remedy, doubt]))
    return Refused(part.source, error.index, f"{error.file} refuses{place}: {what}", remedy)


def _doubt_unit(part: Part) -> str:
    """What to do about a part that lies where no arm reaches, empty for any other."""
    points = _points(part)
    if not len(points) or np.abs(points).max() <= LARGEST:
        return ""
    low, high = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    spans = zip("xyz", low, high, strict=False)
    reach = ", ".join(f"{axis} {short(a, 0)} to {short(b, 0)}" for axis, a, b in spans)
    remedies = [choose_remedy(part.source)]
    if np.ptp(points, axis=0).max() <= LARGEST:
        is_flat = part.solid is None and not part.curves
        remedies.append(_MOVE if is_flat else "move it to the origin")
    return f"drawn in {part.units} it lies at {reach} mm: {', or '.join(remedies)}"


def _points(part: Part) -> FloatArray:
    """Where a drawing, a solid or curves are, mm. None of a picture: its scale is no unit."""
    if part.curves:
        return np.concatenate([curve.points for curve in part.curves])
    if part.solid is not None:
        return part.solid.vertices
    if part.raster is not None or not part.contours:
        return np.zeros((0, 2))
    return np.concatenate([contour.points for contour in part.contours])
