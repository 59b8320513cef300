"""Tool paths and tours: planners make paths, a tour orders them, `lower` makes a program of it."""

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

#: Tool axis of a tool that points straight down.
TOOL_AXIS_DOWN: Vec3 = (0.0, 0.0, -1.0)
#: Columns of `ToolPath.table` by their names.
PLACES: dict[str, slice | int] = {
    "position": slice(0, 3),
    "via": slice(3, 6),
    "axis": slice(6, 9),
    "force_direction": slice(9, 15),
    "force": 15,
    "feed": 16,
}
_WIDTH = 17
#: The columns of the segment that ends in a row, except via.
_OF_SEGMENT = slice(9, 17)


def make_waypoints(
    position: FloatArray,
    via: ArrayLike,
    feed: ArrayLike,
    axis: ArrayLike = TOOL_AXIS_DOWN,
    force_direction: ArrayLike = 0.0,
    force: ArrayLike = 0.0,
) -> FloatArray:
    """`ToolPath.table` (N, 17) from its columns.

    A column of which all rows are the same may be one row or number. The rows of many paths may be
    made at once, and then be split.

    position: (N, 3) mm.
    via: (N, 3) mm, NaN for a line.
    feed: (N,) mm/s.
    axis: (N, 3) unit vectors.
    force_direction: (N, 2, 3) unit vectors.
    force: (N,) N.
    """
    count = len(position)
    table = np.empty((count, _WIDTH))
    table[:, 0:3], table[:, 3:6], table[:, 6:9] = position, via, axis
    table[:, 9:15] = np.broadcast_to(force_direction, (count, 2, 3)).reshape(count, 6)
    table[:, 15], table[:, 16] = force, feed
    return frozen(table)


class ToolPath(Struct, frozen=True, eq=False):
    """The waypoints of a path as columns (PIST paper, eq. 1, 12), work frame, mm, mm/s, N.

    Row 0 is the start; row i > 0 is segment i, which ends at `position[i]`. The columns of segments
    (via, force_direction, force, feed) repeat segment 1 in row 0, so that all columns have one
    length; via[0] is NaN.

    table: (N, 17) the columns side by side, made by `waypoints`. So a path is one array: a drawing
        may have a hundred thousand paths.
    closed: whether the last position is the first again.
    reversible: whether the path may be run backwards.
    parent: index of the path that encloses this one in the same plan, or -1.
    depths: depth of each pass below `position`, in order, mm.
    contours: ids of the contours, or of one edge, on which it works.
    operation: kind of the operation.
    floor: (N,) lowest z of a pass at each waypoint, work frame, mm, linear between them: the tops
        of tabs. None without tabs.
    entry_radius: radius around the first point in which the tool centre may enter on a helix, mm;
        0 if there is no space for one.
    pinned: whether the job sets the start point of the closed path.
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
        """(N, 3) positions of the tool centre, mm."""
        return self.table[:, 0:3]

    @property
    def via(self) -> FloatArray:
        """(N, 3) via points, mm: half-way along an arc, at most half a circle; NaN for a line."""
        return self.table[:, 3:6]

    @property
    def axis(self) -> FloatArray:
        """(N, 3) unit tool axes, towards the part."""
        return self.table[:, 6:9]

    @property
    def force_direction(self) -> FloatArray:
        """(N, 2, 3) unit vectors at the start and at the end of each segment.

        They point from the tool towards the surface, and are zero without a surface (traced lines).
        """
        return self.table[:, 9:15].reshape(-1, 2, 3)

    @property
    def force(self) -> FloatArray:
        """(N,) contact force along `force_direction`, N, zero where no contact is expected."""
        return self.table[:, 15]

    @property
    def feed(self) -> FloatArray:
        """(N,) feed of the tool centre, mm/s."""
        return self.table[:, 16]

    def with_columns(self, **columns: FloatArray) -> ToolPath:
        """A copy of the path with the given columns, by name."""
        table = self.table.copy()
        for name, column in columns.items():
            rows = column.reshape(len(table), 6) if name == "force_direction" else column
            table[:, PLACES[name]] = rows
        return replace(self, table=frozen(table))

    def reversed(self) -> ToolPath:
        """A copy of the path that is run backwards."""
        return replace(
            self,
            table=make_waypoints(
                position=self.position[::-1],
                via=np.concatenate([np.full((1, 3), np.nan), self.via[:0:-1]]),
                axis=self.axis[::-1],
                force_direction=_backwards(self.force_direction)[:, ::-1],
                force=_backwards(self.force),
                feed=_backwards(self.feed),
            ),
            floor=None if self.floor is None else frozen(self.floor[::-1]),
        )

    def rows(self, low: int, high: int) -> ToolPath:
        """The part from waypoint `low` to waypoint `high` - 1, as an open path."""
        table = self.table[low:high].copy()
        table[0, _OF_SEGMENT] = self.table[min(low + 1, high - 1), _OF_SEGMENT]
        table[0, PLACES["via"]] = np.nan
        floor = None if self.floor is None else self.floor[low:high]
        return replace(self, table=frozen(table), closed=False, floor=floor)

    def __repr__(self) -> str:
        points = counted(len(self.position), "point")
        return f"ToolPath({self.id!r}, {self.operation or 'path'}, {points})"


#: End of `Tour.method` if the search for many paths was not compiled.
PLAIN = "plain Python"


class Tour(Struct, frozen=True, eq=False):
    """The paths in the order and direction in which they are run, each rotated to its start.

    paths: the paths in order.
    travel: total length of the links, mm, from and to the home position if it is given.
    method: method of the search, for messages.
    bound: lower bound of the travel of these paths, mm; None if it is unknown.
    down: indices of the paths that are reached from the previous one without a lift.
    stopped: whether the search was ended before it was complete.
    timed: whether the clock ended it.
    notes: notes on paths that were left out or changed.
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
        name, paths = type(self).__name__, counted(len(self.paths), "path")
        return f"{name}({paths}, {self.method}, travel {self.travel:.1f} mm)"

    def _repr_svg_(self) -> str | None:
        return draw_svg(self)


def join_paths(paths: Sequence[ToolPath]) -> ToolPath:
    """Paths of which each begins where the previous one ends, as one open path.

    It has the name of the first. Raises ValueError if some of them have a floor and some have none.
    """
    first = paths[0]
    floors = [path.floor for path in paths if path.floor is not None]
    if floors and len(floors) < len(paths):
        raise ValueError(
            f"path {first.id}: pieces with a floor and pieces without one do not make a path"
        )
    return replace(
        first,
        table=_join_columns([path.table for path in paths]),
        closed=False,
        reversible=False,
        floor=_join_columns(floors) if floors else None,
    )


def _join_columns(columns: Sequence[FloatArray]) -> FloatArray:
    """The columns of consecutive paths as one. The first row of each but the first is left out."""
    return frozen(np.concatenate([columns[0], *(column[1:] for column in columns[1:])]))


def _backwards(column: FloatArray) -> FloatArray:
    """A column of segments, reversed: segment i becomes segment N - i, row 0 repeats segment 1."""
    return column if len(column) < 2 else np.concatenate([column[-1:], column[:0:-1]])
