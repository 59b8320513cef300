"""Tangents, blends and tool orientations by column, over the rows of all paths at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.geometry.arcs import Spans, make_spans
from camgen.geometry.ragged import count_rows, mark_run_starts
from camgen.geometry.rotations import (
    SURE_TURN,
    find_sideways,
    make_rotations_about_z,
    make_rotations_from_axes,
    measure_angles_between,
)
from camgen.geometry.vectors import measure_angles, multiply_rows, normalize
from camgen.model.cell import Dynamics
from camgen.model.path import PLACES, ToolPath
from camgen.model.pose import TOOL_DOWN, FloatArray, frozen
from camgen.motion.corners import JUMP, blend_corners

Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]
Places = NDArray[np.int32]
#: Gives the directions of tool x half-way along arcs of these indices.
MidpointAxes = Callable[[Indices], FloatArray]

#: Rows that are processed at a time: small enough for their columns to stay in the cache.
_BLOCK = 16384


class Rows(Struct, frozen=True, eq=False):
    """The columns of `ToolPath`, one path after the other.

    first, last: row indices of each path.
    force_direction: empty if no path has a force and the tool does not turn with the contour.
    """

    position: FloatArray
    via: FloatArray
    axis: FloatArray
    force_direction: FloatArray
    force: FloatArray
    feed: FloatArray
    first: Indices
    last: Indices

    @property
    def arc(self) -> Mask:
        """(N,) whether the segment that ends in the row is an arc."""
        return ~np.isnan(self.via[:, 0])

    @property
    def spans(self) -> Spans:
        """The N segments that end in the rows; a path's first one comes from the path before."""
        return make_spans(np.roll(self.position, 1, axis=0), self.via, self.position)

    def stretch(self, within: slice) -> Rows:
        """Some rows, as if they belonged to one path."""
        columns = {name: getattr(self, name)[within] for name in _COLUMNS}
        return Rows(**columns, first=np.array([0]), last=np.array([len(columns["position"]) - 1]))


_COLUMNS = ("position", "via", "axis", "force_direction", "force", "feed")


class Orientations(Struct, frozen=True, eq=False):
    """Rotations work_from_tool by row, as indices (N,) into a table.

    Equal neighbours are one object.

    table: the rotations (3, 3).
    begins, ends: rotations at the start and the end of the segment that ends in the row; for the
        first row of a path both at its start.
    vias: rotations half-way along an arc.
    turns: (N,) whether the tool turns at a fixed TCP before the segment.
    """

    table: list[FloatArray]
    begins: Places
    ends: Places
    vias: Places
    turns: Mask


def gather_rows(paths: Sequence[ToolPath], depths: FloatArray, follow: bool = False) -> Rows:
    """The rows of all paths, each `depths` mm below its planned height.

    follow: whether the tool turns with the surface beside the paths.
    """
    counts = count_rows(paths)
    last = np.cumsum(counts) - 1
    table = np.concatenate([path.table for path in paths])
    columns = {}
    for name, place in PLACES.items():
        if name != "force_direction":
            columns[name] = table[:, place].copy()
    below = np.repeat(depths, counts)
    columns["position"][:, 2] -= below
    columns["via"][:, 2] -= below
    direction = np.empty((0, 6))
    if follow or columns["force"].any():
        direction = table[:, PLACES["force_direction"]].copy()
    first = last - counts + 1
    return Rows(**columns, force_direction=direction.reshape(-1, 2, 3), first=first, last=last)


def compute_blends(rows: Rows, tolerance: FloatArray, pace: Dynamics) -> FloatArray:
    """Blend radius (N,) at the end of each segment, mm.

    The corner path stays within `tolerance` (N,) mm of the corner. The radius is 0 at the ends of a
    path, along the tool, and where force begins or ends.

    pace: dynamics with which the machine rounds corners.
    """
    blend = np.zeros(len(rows.position))
    # A row needs its neighbours. The row before the first one of a path does not matter.
    for low in range(0, len(blend), _BLOCK):
        within = slice(max(low - 1, 0), low + _BLOCK + 1)
        of_block = _compute_block(rows.stretch(within), tolerance[within], pace)
        blend[low : low + _BLOCK] = of_block[low - within.start :][:_BLOCK]
    blend[rows.first] = blend[rows.last] = 0.0
    return blend


def _compute_block(rows: Rows, tolerance: FloatArray, pace: Dynamics) -> FloatArray:
    """The blends as if all rows were of one path, 0 at the last one."""
    blend = np.zeros(len(rows.position))
    blend[:-1] = blend_corners(rows.spans, rows.feed, tolerance[:-1], pace)
    pressing = rows.force > 0
    blend[:-1][pressing[:-1] != pressing[1:]] = 0.0
    # The approach into the part is not rounded: where a peck begins, the material is 0.25 mm below.
    step = np.diff(rows.position, axis=0, prepend=rows.position[:1])
    plunge = np.abs(multiply_rows(step, rows.axis)) > (1 - 1e-9) * np.sqrt(
        multiply_rows(step, step)
    )
    blend[:-1][plunge[:-1] | plunge[1:]] = 0.0
    return blend


def orient_fixed(rows: Rows) -> Orientations:
    """Tool z along the axis, tool x along the work x, or the work y for an axis parallel to x."""
    axis = rows.axis
    if (axis == axis[0]).all():
        rotation = TOOL_DOWN
        if axis[0].tolist() != [0.0, 0.0, -1.0]:
            rotation = frozen(make_rotations_from_axes(axis[:1], find_sideways(axis[:1]))[0])
        same = np.zeros(len(axis), np.int32)
        return Orientations([rotation], same, same, same, np.zeros(len(axis), dtype=bool))
    x = find_sideways(axis)
    return _make_orientations(rows, np.roll(x, 1, axis=0), x, lambda arc: find_sideways(axis[arc]))


def orient_turned(rows: Rows, rolls: FloatArray) -> Orientations:
    """Tool z along the axis, tool x rolled from `orient_fixed`, evenly along segments.

    rolls: (N,) rad.
    """
    before, roll_before = np.roll(rows.axis, 1, axis=0), np.roll(rolls, 1)
    before[rows.first], roll_before[rows.first] = rows.axis[rows.first], rolls[rows.first]
    middle = normalize(before + rows.axis)
    table: list[FloatArray] = []

    def add(axis: FloatArray, roll: FloatArray) -> Places:
        rotations = make_rotations_from_axes(axis, find_sideways(axis)) @ make_rotations_about_z(
            roll
        )
        return _add_to_table(rotations, table)

    begins, ends = add(before, roll_before), add(rows.axis, rolls)
    vias = add(middle, (roll_before + rolls) / 2)
    return Orientations(table, begins, ends, vias, np.zeros(len(rolls), dtype=bool))


def orient_along(rows: Rows) -> Orientations:
    """Tool z along the axis, tool x along the press direction, which every row needs.

    See `find_unfollowed` for rows without one.
    """
    end = rows.force_direction[:, 1].copy()
    end[rows.first] = rows.force_direction[rows.first, 0]
    return _make_orientations(
        rows,
        rows.force_direction[:, 0],
        end,
        lambda arc: rows.spans.pick(arc).to_middle(rows.force_direction[arc, 0]),
    )


def find_unfollowed(rows: Rows) -> Indices:
    """Rows whose press direction cannot be tool x: it is missing or along the axis."""
    sides = np.cross(rows.force_direction, rows.axis[:, None, :])
    return np.flatnonzero((np.einsum("nij,nij->ni", sides, sides) < 1e-6).any(axis=1))


def halve_arcs(rows: Rows) -> Rows:
    """The rows with every arc whose press direction turns by more than 120 deg as two arcs."""
    wide = rows.arc & (
        measure_angles(rows.force_direction[:, 0], rows.force_direction[:, 1]) > SURE_TURN
    )
    if not wide.any():
        return rows
    arcs = rows.spans.pick(np.flatnonzero(wide))
    middle = arcs.to_middle(rows.force_direction[wide, 0])
    counts = 1 + wide.astype(np.intp)
    index = np.repeat(np.arange(len(wide)), counts)
    second = np.flatnonzero(~mark_run_starts(index))
    out = replace(
        rows,
        **{name: getattr(rows, name)[index] for name in _COLUMNS},
        first=rows.first + np.cumsum(counts - 1)[rows.first],
        last=rows.last + np.cumsum(counts - 1)[rows.last],
    )
    out.position[second - 1] = arcs.via
    out.axis[second - 1] = normalize(np.roll(rows.axis, 1, axis=0)[wide] + rows.axis[wide])
    out.via[second - 1] = arcs.point(np.full(len(second), 0.25))
    out.via[second] = arcs.point(np.full(len(second), 0.75))
    out.force_direction[second - 1, 1] = out.force_direction[second, 0] = middle
    return out


def _make_orientations(
    rows: Rows, begin: FloatArray, end: FloatArray, middle: MidpointAxes
) -> Orientations:
    """Orientations with tool x along `begin`, `end` (N, 3) and `middle` (of the arcs)."""
    before = np.roll(rows.axis, 1, axis=0)
    before[rows.first] = rows.axis[rows.first]
    starts, stops = (
        make_rotations_from_axes(before, begin),
        make_rotations_from_axes(rows.axis, end),
    )
    starts[rows.first] = stops[rows.first]
    turns = measure_angles_between(np.roll(stops, 1, axis=0), starts) > JUMP
    turns[rows.first] = False
    table: list[FloatArray] = []
    ends = _add_to_table(stops, table)
    vias = ends.copy()
    arc = np.flatnonzero(rows.arc)
    if len(arc):
        vias[arc] = _add_to_table(
            make_rotations_from_axes(normalize(before[arc] + rows.axis[arc]), middle(arc)), table
        )
    return Orientations(table, _add_to_table(starts, table), ends, vias, turns)


def _add_to_table(matrices: FloatArray, table: list[FloatArray]) -> Places:
    """Add rotations (N, 3, 3) to a table, equal neighbours as one object; returns their indices."""
    is_new = mark_run_starts(matrices)
    places = np.cumsum(is_new, dtype=np.int32) - 1 + np.int32(len(table))
    table.extend(frozen(matrices[is_new]))
    return places
