"""The rules that every program keeps, looked at by column: a body may hold a hundred thousand motions."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import chain
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from camgen.body import Mask, are, column, moves_of, posed, taken
from camgen.errors import Refused
from camgen.instructions import Comment, Force, Instruction, MoveC, MoveJ, Output, Wait
from camgen.pose import FloatArray, Pose

Indices = NDArray[np.intp]
_STILL = frozenset((Output, Wait, Force))
_BLENDS = "a motion before an output, a wait or a force change must not blend"


def check(body: tuple[Instruction, ...]) -> None:
    """Raises Refused for the first instruction that breaks a rule of ``Program``."""
    moves, moving = moves_of(body)
    at = np.flatnonzero(moving)
    speed, blend = column(moves, "speed"), column(moves, "blend")
    waiting = are(body, Wait)
    waits = np.flatnonzero(waiting)
    broken = [
        *_first(at[:1][~are(moves[:1], MoveJ)], "the first motion must be joint-interpolated"),
        *_not_finite(body, moves),
        *_first(at[~(speed > 0) | (blend < 0)], "a speed must be positive and a blend not negative"),
        *_first(waits[column(taken(body, waiting), "seconds") < 0], "a wait must not be negative"),
        *_blending(moving, np.flatnonzero(~are(body, Comment)), at, blend),
        *_pressing(body, moves, at),
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


def _not_finite(body: Sequence[Any], moves: Sequence[Any]) -> Iterator[tuple[int, str]]:
    """Instructions with a number that is not finite, the first of each kind."""
    others = [item for item in body if type(item) in _STILL]
    targets = posed(moves)
    arcs, straight, jointed = taken(moves, are(moves, MoveC)), taken(moves, targets), taken(moves, ~targets)
    pressing, switches = taken(moves, ~are(moves, MoveJ)), taken(others, are(others, Force))
    known = [move for move in moves if move.joints is not None] if any(map(attrgetter("joints"), moves)) else []
    single: tuple[tuple[Sequence[Any], str], ...] = (
        (moves, "speed"),
        (moves, "blend"),
        (pressing, "force"),
        (taken(others, are(others, Output)), "value"),
        (taken(others, are(others, Wait)), "seconds"),
        (switches, "newtons"),
    )
    several: tuple[tuple[Sequence[Any], str], ...] = (
        (jointed, "target.values"),
        (arcs, "via.origin"),
        (known, "joints.values"),
        (pressing, "press"),
        (switches, "press"),
    )
    columns = [(items, name, column(items, name)) for items, name in single]
    columns += [(items, name, _flat(items, name)) for items, name in (*several, (straight, "target.origin"))]
    columns += [(items, name, _rotations(items, name)) for items, name in ((straight, "target"), (arcs, "via"))]
    for items, name, values in columns:
        if not np.isfinite(values).all():
            bad = next(item for item in items if not _sound(attrgetter(name)(item)))
            yield next(k for k, item in enumerate(body) if item is bad), "a number is not finite"


def _flat(items: Sequence[Any], name: str) -> FloatArray:
    """All numbers of an attribute of the items, some each."""
    return np.fromiter(chain.from_iterable(map(attrgetter(name), items)), np.float64)


def _rotations(items: Sequence[Any], name: str) -> FloatArray:
    """The rotations of poses, each once: a program shares them."""
    rotations = list(map(attrgetter(f"{name}.rotation"), items))
    shared = dict(zip(map(id, rotations), rotations, strict=True))
    return np.concatenate(list(shared.values())) if shared else np.zeros(0)


def _sound(value: float | tuple[float, ...] | Pose) -> bool:
    return bool(np.isfinite(value.rotation if isinstance(value, Pose) else value).all())


def _blending(moving: Mask, spoken: Indices, at: Indices, blend: FloatArray) -> Iterator[tuple[int, str]]:
    """Motions that blend although no motion follows."""
    following = np.append(spoken[1:], len(moving))[np.searchsorted(spoken, at)]
    last = following == len(moving)
    stops = ~np.append(moving, False)[following]
    yield from _first(at[(blend > 0) & stops & ~last], _BLENDS)
    yield from _first(at[(blend > 0) & last], "the last motion must not blend")


def _pressing(body: Sequence[Any], moves: Sequence[Any], at: Indices) -> Iterator[tuple[int, str]]:
    """Motions that press while force control is off, and force control that is left on."""
    switching, forced = are(body, Force), ~are(moves, MoveJ)
    newtons = np.append(0.0, column(taken(body, switching), "newtons"))
    on = newtons[np.searchsorted(np.flatnonzero(switching), at[forced])] > 0
    force = column(taken(moves, forced), "force")
    yield from _first(at[forced][(force > 0) & ~on], "a motion presses while force control is off")
    if newtons[-1] > 0:
        yield len(body) - 1, "force control must be off at the end"
