"""The motions of a program text by column, with the state of the machine during each of them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import ArrayLike, NDArray

from camgen.check.proof.pieces import BoolArray, IntArray, Pieces, arcs_through
from camgen.model.cell import Dynamics
from camgen.model.pose import FloatArray
from camgen.model.program import Columns, Instruction, Joints, MoveJ, Output

#: A motion whose ends are nearer in the plane, mm, goes up or down only.
UPRIGHT_MM = 2e-3
#: Rounding of binary numbers, and of the points of an arc, mm.
_BINARY_MM = 1e-3


class Rounding(Struct, frozen=True):
    """Rounding of the numbers of a text.

    mm: largest error of a coordinate.
    speed: largest error of a speed, mm/s.
    joint: largest error of a joint value, rad or mm.
    """

    mm: float
    speed: float
    joint: float

    @property
    def slack(self) -> float:
        """Distance of a motion from its place by the digits of the text, mm."""
        return 2 * self.mm + _BINARY_MM


class Controller(Struct, frozen=True):
    """The controller of a text, as far as the proof has to know it.

    pace: the way in which it passes corners.
    stated: words for what its texts state, such as "orientation" (`camgen.post.verify.COMPARED`).
    home: joint values of the rest position, None if it has none.
    """

    pace: Dynamics
    stated: frozenset[str]
    home: Joints | None


class Motions(Struct, frozen=True, eq=False, dict=True):
    """M motions of one text, in order. Positions in the work frame, mm.

    line: (M,) line of the text, counted from 1.
    joint: (M,) whether the motion interpolates the joints.
    end: (M, 3) TCP, NaN where only joint values are known.
    before: (3,) TCP at the start of the first motion, NaN if it is not known.
    arc: (A,) indices of the arcs.
    via: (A, 3) a point of each arc between its ends.
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
    end: FloatArray
    before: FloatArray
    arc: IntArray
    via: FloatArray
    path: IntArray
    speed: FloatArray
    blend: FloatArray
    force: FloatArray
    force_direction: FloatArray
    rotation: NDArray[np.int32]
    axes: FloatArray
    on: BoolArray
    spindle: FloatArray

    def __len__(self) -> int:
        return len(self.line)

    @cached_property
    def start(self) -> FloatArray:
        """(M, 3) TCP at the start, NaN where only joint values are known."""
        return np.vstack([self.before, self.end])[:-1]

    @cached_property
    def plane(self) -> Pieces:
        """The motions seen from above; `owner` is the path."""
        points = np.vstack([self.before[:2], self.end[:, :2]])
        return arcs_through(points[:-1], points[1:], self.path, self.arc, self.via[:, :2])

    def stretch(self, low: int, high: int) -> Motions:
        """The motions from `low` to before `high`."""
        columns = {name: getattr(self, name)[low:high] for name in _BY_MOTION}
        first, last = np.searchsorted(self.arc, (low, high)).tolist()
        before = self.end[low - 1] if low else self.before
        arc, via = self.arc[first:last] - low, self.via[first:last]
        return replace(self, before=before, arc=arc, via=via, **columns)

    @cached_property
    def vias(self) -> FloatArray:
        """(M, 3) the points of `via`, NaN for other motions than arcs."""
        vias = np.full(self.end.shape, np.nan)
        vias[self.arc] = self.via
        return vias

    @cached_property
    def upright(self) -> BoolArray:
        """(M,) whether the TCP moves up or down only, or not at all."""
        x, y = np.abs(self.end[:, 0] - self.start[:, 0]), np.abs(self.end[:, 1] - self.start[:, 1])
        return np.asarray((x <= UPRIGHT_MM) & (y <= UPRIGHT_MM) & (self.plane.turn == 0))


#: The columns with a row for each motion.
_BY_MOTION = (
    "line", "joint", "end", "path", "speed", "blend",
    "force", "force_direction", "rotation", "on", "spindle",
)  # fmt: skip


def tabulate(
    body: Sequence[Instruction], lines: Sequence[int], path: IntArray, signal: str
) -> Motions:
    """The motions of `body`, read back from a text.

    lines: the line of each instruction.
    path: (M,) the path to which the program assigns each motion.
    signal: name of the process output, or "".
    """
    columns = Columns(body)
    at = columns.at
    return Motions(
        line=np.asarray(lines, np.intp)[at],
        joint=columns.moves_are(MoveJ),
        end=columns.ends,
        before=np.full(3, np.nan),
        arc=columns.arcs,
        via=columns.via,
        path=path,
        speed=columns.speed,
        blend=columns.blend,
        force=columns.force,
        force_direction=columns.force_direction,
        rotation=columns.rotation,
        axes=np.array(columns.table, np.float64).reshape(-1, 3, 3),
        on=_switched(columns, signal) if signal else np.zeros(len(at), np.bool_),
        spindle=_spindle(columns),
    )


def _switched(columns: Columns, signal: str) -> BoolArray:
    """(M,) whether the output `signal` is on during each motion."""
    switches = columns.alike(Output, lambda item: item.signal == signal)
    on = columns.alike(Output, lambda item: item.signal == signal and item.value > 0)
    return np.asarray(_during(columns.at, switches, on[switches], False))


def _spindle(columns: Columns) -> FloatArray:
    """(M,) spindle speed during each motion, rpm."""
    setting = columns.alike(Output, lambda item: item.signal == "spindle")
    values = [item.value for item in columns.pick(np.flatnonzero(setting))]
    return np.asarray(_during(columns.at, setting, values, 0.0))


def _during(at: IntArray, settings: BoolArray, values: ArrayLike, before: float) -> NDArray[Any]:
    """(M,) the value of a setting during each motion.

    at: (M,) indices of the motions in a body of N instructions.
    settings: (N,) which instructions set the value.
    values: the values that these instructions set, in order.
    before: the value before the first of them.
    """
    counts = np.diff(np.searchsorted(at, np.flatnonzero(settings)), prepend=0, append=len(at))
    return np.repeat(np.append(before, values), counts)
