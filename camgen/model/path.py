"""Tool paths and their order: what planners make, what the tour arranges and ``lower`` turns into a program."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import ArrayLike

from camgen.model.drawing import draw_svg
from camgen.model.part import Note
from camgen.model.pose import FloatArray, Vec3, frozen
from camgen.model.text import counted

#: Tool z of one that points straight down.
TOOL_AXIS_DOWN: Vec3 = (0.0, 0.0, -1.0)
#: Where the columns of a path stand in the rows of its table.
PLACES: dict[str, slice | int] = {
    "position": slice(0, 3), "via": slice(3, 6), "axis": slice(6, 9), "force_direction": slice(9, 15), "force": 15,
    "feed": 16,
}  # fmt: skip
_WIDTH = 17
#: What speaks of the segment that ends in a row, but for via.
_OF_SEGMENT = slice(9, 17)


def waypoints(
    position: FloatArray,
    via: ArrayLike,
    feed: ArrayLike,
    axis: ArrayLike = TOOL_AXIS_DOWN,
    force_direction: ArrayLike = 0.0,
    force: ArrayLike = 0.0,
) -> FloatArray:
    """``ToolPath.table`` of its columns, of which one row stands for all that are the same. Rows of many paths may be
    made at once, and cut into theirs.
    """
    count = len(position)
    table = np.empty((count, _WIDTH))
    table[:, 0:3], table[:, 3:6], table[:, 6:9] = position, via, axis
    table[:, 9:15] = np.broadcast_to(force_direction, (count, 2, 3)).reshape(count, 6)
    table[:, 15], table[:, 16] = force, feed
    return frozen(table)


class ToolPath(Struct, frozen=True, eq=False):
    """The waypoints of the PIST paper (eq. 1, 12) as columns, work frame, mm, mm/s, N.

    Row 0 is the start; row i > 0 is segment i, which ends at ``position[i]``. What speaks of segments (via, press,
    force, feed) repeats segment 1 in row 0, so that columns have one length; via[0] is NaN.

    table: (N, 17), the columns side by side, which makes a path one array: a drawing may have a hundred thousand of
    them. ``waypoints`` makes it. closed: the last position is the first again. reversible: may be run backwards.
    parent: index of the path that encloses this one in the same plan, -1 if none. depths: mm below ``position`` of each
    pass, in order. contours: ids of the contours that it works on, or of one edge. operation: what it does there.
    floor: (N,) z, work frame, mm, below which no pass goes at each waypoint, over the tabs, straight from one to the
    next; None: nothing holds it up. entry_radius: mm, so far around the first point the tool's centre may go on its way
    down, on a helix; 0: there is no room for one. pinned: the job says where the closed path begins, and it does there.
    """

    id: str
    layer: str
    table: FloatArray
    closed: bool
    reversible: bool = True
    parent: int = -1
    depths: tuple[float, ...] = (0.0,)
    contours: tuple[str, ...] = ()
    operation: str = ""
    floor: FloatArray | None = None
    entry_radius: float = 0.0
    pinned: bool = False

    def __len__(self) -> int:
        return len(self.table)

    @property
    def position(self) -> FloatArray:
        """(N, 3) of the tool centre."""
        return self.table[:, 0:3]

    @property
    def via(self) -> FloatArray:
        """(N, 3), the point half-way along an arc segment (at most half a circle), NaN for a straight one."""
        return self.table[:, 3:6]

    @property
    def axis(self) -> FloatArray:
        """(N, 3) unit, tool z, towards the part."""
        return self.table[:, 6:9]

    @property
    def force_direction(self) -> FloatArray:
        """(N, 2, 3) unit vectors from the tool towards the surface at the start and at the end of the segment, zero
        where there is no surface (traced lines).
        """
        return self.table[:, 9:15].reshape(-1, 2, 3)

    @property
    def force(self) -> FloatArray:
        """(N,) N along press, zero where contact is not expected."""
        return self.table[:, 15]

    @property
    def feed(self) -> FloatArray:
        """(N,) of the tool centre."""
        return self.table[:, 16]

    def with_columns(self, **columns: FloatArray) -> ToolPath:
        """The path with other columns, by name, in the place of its own."""
        table = self.table.copy()
        for name, column in columns.items():
            table[:, PLACES[name]] = (
                column.reshape(len(table), 6) if name == "force_direction" else column
            )
        return replace(self, table=frozen(table))

    def reversed(self) -> ToolPath:
        """The same path run backwards."""
        return replace(
            self,
            table=waypoints(
                position=self.position[::-1],
                via=_no_via(_backwards(self.via)),
                axis=self.axis[::-1],
                force_direction=_backwards(self.force_direction)[:, ::-1],
                force=_backwards(self.force),
                feed=_backwards(self.feed),
            ),
            floor=None if self.floor is None else frozen(self.floor[::-1]),
        )

    def rows(self, low: int, high: int) -> ToolPath:
        """The stretch from vertex ``low`` to vertex ``high`` - 1, as an open path."""
        table = self.table[low:high].copy()
        table[0, _OF_SEGMENT] = self.table[min(low + 1, high - 1), _OF_SEGMENT]
        table[0, PLACES["via"]] = np.nan
        floor = None if self.floor is None else self.floor[low:high]
        return replace(self, table=frozen(table), closed=False, floor=floor)

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
        raise ValueError(
            f"path {first.id}: pieces with a floor and pieces without one do not make a path"
        )

    def end_to_end(columns: Sequence[FloatArray]) -> FloatArray:
        return frozen(np.concatenate([column[1 if k else 0 :] for k, column in enumerate(columns)]))

    return replace(
        first,
        table=end_to_end([path.table for path in paths]),
        closed=False,
        reversible=False,
        floor=end_to_end([path.floor for path in paths if path.floor is not None])
        if held == {True}
        else None,
    )


def _backwards(column: FloatArray) -> FloatArray:
    """A per-segment column of the reversed path: segment i becomes segment N - i, row 0 repeats segment 1."""
    return column if len(column) < 2 else np.concatenate([column[-1:], column[:0:-1]])


def _no_via(via: FloatArray) -> FloatArray:
    """``via`` with its row 0 cleared, since no segment ends at the start."""
    cleared = via.copy()
    cleared[0] = np.nan
    return cleared
