"""The motions of a program text by column, with the state of the machine during each of them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from operator import attrgetter

import numpy as np
from msgspec import Struct

from camgen.check.proof.pieces import BoolArray, IntArray, Pieces, arcs_through
from camgen.model.cell import Dynamics
from camgen.model.pose import FloatArray
from camgen.model.program import Columns, Instruction, MoveC, MoveJ, Output

#: A motion whose ends are nearer in the plane, mm, goes up or down only.
UPRIGHT_MM = 2e-3


class Rounding(Struct, frozen=True):
    """Rounding of the numbers of a text.

    mm: largest error of a coordinate.
    speed: largest error of a speed, mm/s.
    """

    mm: float
    speed: float


class Controller(Struct, frozen=True):
    """The controller of a text, as far as the proof has to know it.

    pace: the way in which it passes corners.
    stated: words for what its texts state, such as "orientation" (`camgen.post.verify.COMPARED`).
    """

    pace: Dynamics
    stated: frozenset[str]


class Motions(Struct, frozen=True, eq=False, dict=True):
    """M motions of one text, in order. Positions in the work frame, mm.

    line: (M,) line of the text, counted from 1.
    joint: (M,) whether the motion interpolates the joints.
    start, end: (M, 3) TCP, NaN where only joint values are known.
    via: (M, 3) point of an arc between its ends, NaN for other motions.
    plane: the same seen from above, as pieces; `owner` is the path.
    path: (M,) index of the path in the program, or -1. It is a hint only: nothing is proven by it.
    speed: (M,) mm/s.
    blend: (M,) distance from the end at which rounding may begin, mm; 0 for a stop.
    force: (M,) N.
    force_direction: (M, 3) unit vector towards the surface.
    rotation: (M,) index into `axes` of the rotation at the end, -1 if only joints are known.
    axes: (R, 3, 3) rotations of the tool.
    on: (M,) whether the process output is on.
    spindle: (M,) spindle speed, rpm.
    """

    line: IntArray
    joint: BoolArray
    start: FloatArray
    end: FloatArray
    via: FloatArray
    plane: Pieces
    path: IntArray
    speed: FloatArray
    blend: FloatArray
    force: FloatArray
    force_direction: FloatArray
    rotation: IntArray
    axes: FloatArray
    on: BoolArray
    spindle: FloatArray

    def __len__(self) -> int:
        return len(self.line)

    @cached_property
    def upright(self) -> BoolArray:
        """(M,) whether the TCP moves up or down only, or not at all."""
        x, y = np.abs(self.end[:, 0] - self.start[:, 0]), np.abs(self.end[:, 1] - self.start[:, 1])
        return np.asarray((x <= UPRIGHT_MM) & (y <= UPRIGHT_MM) & (self.plane.turn == 0))


def tabulate(
    body: Sequence[Instruction], lines: Sequence[int], path: IntArray, signal: str
) -> Motions:
    """The motions of `body`, read back from a text.

    lines: the line of each instruction.
    path: (M,) the path to which the program assigns each motion.
    signal: name of the process output, or "".
    """
    columns = Columns(body)
    at, end = columns.at, columns.ends
    start = np.full_like(end, np.nan)
    start[1:] = end[:-1]
    via = np.full_like(end, np.nan)
    arcs = columns.moves_are(MoveC)
    via[arcs] = columns.via
    axes = np.array(columns.table, np.float64).reshape(-1, 3, 3)
    return Motions(
        line=np.asarray(lines, np.intp)[at],
        joint=columns.moves_are(MoveJ),
        start=start,
        end=end,
        via=via,
        plane=arcs_through(start[:, :2], via[:, :2], end[:, :2], path),
        path=path,
        speed=columns.speed,
        blend=columns.blend,
        force=columns.force,
        force_direction=columns.force_direction,
        rotation=columns.rotation.astype(np.intp),
        axes=axes,
        on=_switched(columns, signal) if signal else np.zeros(len(at), np.bool_),
        spindle=_spindle(columns),
    )


def _switched(columns: Columns, signal: str) -> BoolArray:
    """(M,) whether the output `signal` is on during each motion."""
    outputs = columns.of(Output)
    named = np.fromiter(map(signal.__eq__, map(attrgetter("signal"), outputs)), np.bool_)
    value = np.fromiter(map(attrgetter("value"), outputs), np.float64)
    places = np.flatnonzero(columns.are(Output))[named]
    on = np.append(False, value[named] > 0)
    return np.asarray(on[np.searchsorted(places, columns.at)])


def _spindle(columns: Columns) -> FloatArray:
    """(M,) spindle speed during each motion, rpm."""
    if not any(item.signal == "spindle" for item in columns.outputs):
        return np.zeros(len(columns.at))
    setting = columns.alike(Output, lambda item: item.signal == "spindle")
    places = np.flatnonzero(setting)
    values = np.array([0.0, *(item.value for item in columns.pick(places))])
    return np.asarray(values[np.searchsorted(places, columns.at)])
