"""Tools that must turn to cut: whether a text turns the spindle wherever they are in material."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from msgspec import Struct

from camgen.check.stock.moves import TOLERANCE_MM, Cut, find_depths, find_rapid
from camgen.check.stock.profile import BEAMS
from camgen.geometry.ragged import find_run_starts
from camgen.model.part import BoolArray
from camgen.model.pose import FloatArray, Vec3, to_vec3
from camgen.model.program import Columns, Output

#: The signal of a spindle, whose value is its speed, rpm; negative for a turn to the left.
_SPINDLE = "spindle"
#: Tools that cut without a spindle.
_STANDING = (*BEAMS, "pen")
#: A speed is printed in digits.
_NEARLY = 1.0001

State = Literal["at rest", "to the left", "too fast"]


class WrongSpindle(Struct, frozen=True):
    """A run of motions in material with a spindle that must not run so.

    cut: number of their `Cut`.
    line: line of the first motion in the text, from 1.
    place: end of the first motion, mm.
    depth: depth of that motion below the top face, mm.
    speed: speed of the spindle there, rpm.
    state: fault of the spindle.
    """

    cut: int
    line: int
    place: Vec3
    depth: float
    speed: float
    state: State


class Spindles(Struct, frozen=True):
    """The spindles of all cuts.

    wrong: motions in material with a spindle at rest, to the left, or too fast, in order.
    is_judged: whether the text states the speed of the spindle in each cut. If not, the cell may
        switch it.
    """

    wrong: tuple[WrongSpindle, ...]
    is_judged: bool


class Running(Struct, frozen=True, eq=False):
    """The motions of a cut with the spindle.

    columns: motions of the cut, M.
    cutting: (M,) whether motions are in material; those straight up are not.
    speed: (M,) speed of the spindle during each motion, rpm; NaN before it is switched.
    """

    columns: Columns
    cutting: BoolArray
    speed: FloatArray


def follow_spindles(cuts: Sequence[Cut]) -> list[Running]:
    """The motions of each cut with the spindle, whose speed holds from cut to cut of one file."""
    running: list[Running] = []
    speed, file = np.nan, ""
    for cut in cuts:
        columns = Columns(cut.body)
        if cut.file != file:
            speed, file = np.nan, cut.file
        speeds, speed = _follow_spindle(columns, speed)
        running.append(Running(columns, _find_cutting(cut, columns), speeds))
    return running


def turns(cut: Cut) -> bool:
    """Whether the tool of a cut must turn to cut."""
    return cut.tool.kind not in _STANDING


def check_spindles(cuts: Sequence[Cut], running: Sequence[Running]) -> Spindles:
    """Whether the spindle turns as it must wherever a tool is in material."""
    wrong: list[WrongSpindle] = []
    is_judged = True
    for number, (cut, motions) in enumerate(zip(cuts, running, strict=True)):
        if turns(cut):
            speeds = np.where(motions.cutting, motions.speed, np.nan)
            is_judged &= not np.isnan(speeds[motions.cutting]).any()
            wrong += _find_faults(cut, number, motions.columns, speeds)
    return Spindles(tuple(wrong), is_judged)


def _find_faults(cut: Cut, number: int, columns: Columns, speeds: FloatArray) -> list[WrongSpindle]:
    """The runs of motions with one fault.

    speeds: (M,) speed of the spindle during each motion in material, rpm, else NaN.
    """
    faults = [speeds == 0, speeds < 0, speeds > (cut.tool.max_speed or np.inf) * _NEARLY]
    kinds = np.select(faults, [1, 2, 3], 0)
    states: tuple[State, ...] = ("at rest", "to the left", "too fast")
    ends, wrong = columns.ends, []
    for row in find_run_starts(kinds).tolist():
        if kinds[row]:
            line, place = int(cut.lines[columns.at[row]]), to_vec3(ends[row])
            state, speed = states[kinds[row] - 1], abs(float(speeds[row]))
            wrong.append(WrongSpindle(number, line, place, -place[2], speed, state))
    return wrong


def _find_cutting(cut: Cut, columns: Columns) -> BoolArray:
    if not len(columns.at):
        return np.zeros(0, dtype=np.bool_)
    rapid = find_rapid(columns, cut.travel)
    start = np.roll(columns.ends, 1, axis=0)
    depth = find_depths(cut, columns, start, columns.ends, rapid)
    step = columns.ends - start
    rising = (np.hypot(step[:, 0], step[:, 1]) < TOLERANCE_MM) & (step[:, 2] > 0)
    return np.asarray((depth[:, 1] > TOLERANCE_MM) & ~rapid & ~rising)


def _follow_spindle(columns: Columns, speed: float) -> tuple[FloatArray, float]:
    """(M,) speed of the spindle during each motion, rpm, and its speed after the last one.

    speed: speed before the first motion; NaN before the spindle is switched.
    """
    at, speeds = [-1], [speed]
    for index in np.flatnonzero(columns.are(Output)).tolist():
        item = columns.body[index]
        if isinstance(item, Output) and item.signal == _SPINDLE:
            at.append(index)
            speeds.append(item.value)
    return np.array(speeds)[np.searchsorted(at, columns.at) - 1], speeds[-1]
