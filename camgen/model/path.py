"""Tool paths and their order: what planners make, what the tour arranges and ``lower`` turns into a program."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.model.drawing import draw_svg
from camgen.model.part import Note
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted


class ToolPath(Struct, frozen=True, eq=False):
    """The waypoints of the PIST paper (eq. 1, 12) as columns, work frame, mm, mm/s, N.

    Row 0 is the start; row i > 0 is segment i, which ends at ``position[i]``. What speaks of segments (via, press,
    force, feed) repeats segment 1 in row 0, so that columns have one length; via[0] is NaN.

    position: (N, 3) of the tool centre. axis: (N, 3) unit, tool z, towards the part. via: (N, 3), the point half-way
    along an arc segment (at most half a circle), NaN for a straight one. force_direction: (N, 2, 3) unit vectors from
    the tool towards the surface at the start and at the end of the segment, zero where there is no surface (traced
    lines). force: (N,) N along press, zero where contact is not expected. feed: (N,) of the tool centre. closed: the
    last position is the first again. reversible: may be run backwards. parent: index of the path that encloses this one
    in the same plan, -1 if none. depths: mm below ``position`` of each pass, in order. contours: ids of the contours
    that it works on, or of one edge. operation: what it does there. floor: (N,) z, work frame, mm, below which no pass
    goes at each waypoint, over the tabs, straight from one to the next; None: nothing holds it up. entry_radius: mm,
    so far around the first point the tool's centre may go on its way down, on a helix; 0: there is no room for one.
    pinned: the job says where the closed path begins, and it does there.
    """

    id: str
    layer: str
    position: FloatArray
    via: FloatArray
    axis: FloatArray
    force_direction: FloatArray
    force: FloatArray
    feed: FloatArray
    closed: bool
    reversible: bool = True
    parent: int = -1
    depths: tuple[float, ...] = (0.0,)
    contours: tuple[str, ...] = ()
    operation: str = ""
    floor: FloatArray | None = None
    entry_radius: float = 0.0
    pinned: bool = False

    def reversed(self) -> ToolPath:
        """The same path run backwards."""
        return replace(
            self,
            position=frozen(self.position[::-1]),
            via=_no_via(_backwards(self.via)),
            axis=frozen(self.axis[::-1]),
            force_direction=frozen(_backwards(self.force_direction)[:, ::-1]),
            force=_backwards(self.force),
            feed=_backwards(self.feed),
            floor=None if self.floor is None else frozen(self.floor[::-1]),
        )

    def rows(self, low: int, high: int) -> ToolPath:
        """The stretch from vertex ``low`` to vertex ``high`` - 1, as an open path."""
        chosen = slice(low, high)
        speaking = np.arange(low, high)
        speaking[0] = min(low + 1, high - 1)
        via = self.via[chosen].copy()
        via[0] = np.nan
        return replace(
            self,
            position=self.position[chosen],
            via=frozen(via),
            axis=self.axis[chosen],
            force_direction=frozen(self.force_direction[speaking]),
            force=frozen(self.force[speaking]),
            feed=frozen(self.feed[speaking]),
            closed=False,
            floor=None if self.floor is None else self.floor[chosen],
        )

    def __repr__(self) -> str:
        return f"ToolPath({self.id!r}, {self.operation or 'path'}, {counted(len(self.position), 'point')})"


#: What ``Tour.method`` ends with where the search for many paths was not compiled.
PLAIN = "plain Python"


class Tour(Struct, frozen=True, eq=False):
    """The paths in the order and direction in which they are run, each rotated to its start.

    travel: mm between the end of each path and the start of the next, from and back to the home position if given.
    bound: mm, no order, directions and starts of these paths travel less; None where it is not known.
    down: indices of the paths that are reached from the one before without a lift. stopped: the search for it was ended
    before it was done; timed: it was ended by the clock. notes: on what was left out or done otherwise on the way.
    """

    paths: tuple[ToolPath, ...]
    travel: float
    method: str
    bound: float | None = None
    down: frozenset[int] = frozenset()
    stopped: bool = False
    timed: bool = False
    notes: tuple[Note, ...] = ()

    def __repr__(self) -> str:
        name = type(self).__name__
        return f"{name}({counted(len(self.paths), 'path')}, {self.method}, travel {self.travel:.1f} mm)"

    def _repr_svg_(self) -> str | None:
        return draw_svg(self)


def join_paths(paths: Sequence[ToolPath]) -> ToolPath:
    """Paths that begin where the one before ends, as one open path with the name of the first.

    ValueError where some of them have a floor and some none.
    """
    first = paths[0]
    held = {path.floor is not None for path in paths}
    if len(held) > 1:
        raise ValueError(f"path {first.id}: pieces with a floor and pieces without one do not make a path")

    def column(name: str) -> FloatArray:
        parts = [getattr(path, name)[1 if k else 0 :] for k, path in enumerate(paths)]
        return frozen(np.concatenate(parts))

    return replace(
        first,
        position=column("position"),
        via=column("via"),
        axis=column("axis"),
        force_direction=column("force_direction"),
        force=column("force"),
        feed=column("feed"),
        closed=False,
        reversible=False,
        floor=column("floor") if held == {True} else None,
    )


def _backwards(column: FloatArray) -> FloatArray:
    """A per-segment column of the reversed path: segment i becomes segment N - i, row 0 repeats segment 1."""
    if len(column) < 2:
        return column
    turned = np.concatenate([column[-1:], column[:0:-1]])
    return frozen(turned)


def _no_via(via: FloatArray) -> FloatArray:
    """``via`` with its row 0 cleared, since no segment ends at the start."""
    cleared = via.copy()
    cleared[0] = np.nan
    return frozen(cleared)
