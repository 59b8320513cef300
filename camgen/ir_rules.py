"""The rules that every program keeps, looked at by column: a body may hold a hundred thousand motions."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from operator import attrgetter
from typing import Any

import numpy as np

from camgen.body import Columns, Indices, column, shared, taken
from camgen.errors import Refused
from camgen.instructions import Comment, Force, MoveC, MoveJ, Output, Wait
from camgen.pose import FloatArray, Pose

_BLENDS = "a motion before an output, a wait or a force change must not blend"


def check(columns: Columns) -> None:
    """Raises Refused for the first instruction of a body that breaks a rule of ``Program``."""
    at, speed, blend = columns.at, columns.speed, columns.blend
    waits = np.flatnonzero(columns.are(Wait))
    broken = [
        *_first(at[:1][~columns.moves_are(MoveJ)[:1]], "the first motion must be joint-interpolated"),
        *_not_finite(columns),
        *_first(at[~(speed > 0) | (blend < 0)], "a speed must be positive and a blend not negative"),
        *_first(waits[column(columns.of(Wait), "seconds") < 0], "a wait must not be negative"),
        *_blending(columns),
        *_pressing(columns),
    ]
    if broken:
        index, what = min(broken, key=lambda one: one[0])
        raise Refused("program", index, what)


def check_frame(frame: Pose) -> None:
    """Raises Refused for a frame with a number that is not finite."""
    if not (np.isfinite(frame.rotation).all() and all(map(math.isfinite, frame.origin))):
        raise Refused("program", -1, "a number is not finite")


def _first(indices: Indices, what: str) -> Iterator[tuple[int, str]]:
    for index in indices[:1].tolist():
        yield index, what


def _not_finite(columns: Columns) -> Iterator[tuple[int, str]]:
    """Instructions with a number that is not finite, the first of each kind."""
    moves, posed, arcs = columns.moves, columns.posed, columns.moves_are(MoveC)
    for where, values in (
        (None, columns.speed),
        (None, columns.blend),
        (None, columns.force),
        (posed, columns.ends),
        (arcs, columns.vias),
    ):
        good = np.isfinite(values).reshape(len(moves), -1).all(axis=1)
        yield from _first(columns.at[~good if where is None else ~good & where], "a number is not finite")
    straight, jointed = taken(moves, posed), taken(moves, ~posed)
    known = [move for move in moves if move.joints is not None] if any(map(attrgetter("joints"), moves)) else []
    for items, name in (
        (straight, "target.rotation"),
        (taken(moves, arcs), "via.rotation"),
        (taken(moves, ~columns.moves_are(MoveJ)), "press"),
        (jointed, "target.values"),
        (known, "joints.values"),
        (columns.of(Output), "value"),
        (columns.of(Wait), "seconds"),
        (columns.of(Force), "newtons"),
        (columns.of(Force), "press"),
    ):
        if not all(map(_sound, shared(items, name))):
            bad = next(item for item in items if not _sound(attrgetter(name)(item)))
            yield next(k for k, item in enumerate(columns.body) if item is bad), "a number is not finite"


def _sound(value: float | Sequence[float] | FloatArray) -> bool:
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, tuple):
        return all(map(math.isfinite, value))
    return bool(np.isfinite(value).all())


def _blending(columns: Columns) -> Iterator[tuple[int, str]]:
    """Motions that blend although no motion follows."""
    at, blends = columns.at, columns.blend > 0
    spoken = np.flatnonzero(~columns.are(Comment))
    size = len(columns.body)
    moving = np.zeros(size + 1, np.bool_)
    moving[at] = True
    following = np.append(spoken[1:], size)[np.searchsorted(spoken, at)]
    last = following == size
    yield from _first(at[blends & ~moving[following] & ~last], _BLENDS)
    yield from _first(at[blends & last], "the last motion must not blend")


def _pressing(columns: Columns) -> Iterator[tuple[int, str]]:
    """Motions that press while force control is off, and force control that is left on."""
    switches: list[Any] = columns.of(Force)
    newtons = np.append(0.0, column(switches, "newtons"))
    on = newtons[np.searchsorted(np.flatnonzero(columns.are(Force)), columns.at)] > 0
    yield from _first(columns.at[(columns.force > 0) & ~on], "a motion presses while force control is off")
    if newtons[-1] > 0:
        yield len(columns.body) - 1, "force control must be off at the end"
