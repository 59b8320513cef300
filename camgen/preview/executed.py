"""The path that the controller runs, with rounded corners, as chains of points to be drawn."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from camgen.check.executed import find_transitions, pick_shapes, pick_transitions
from camgen.geometry.arcs import Spans
from camgen.geometry.ragged import concatenate_columns, list_owners, number_rows
from camgen.model.cell import Dynamics
from camgen.model.part import IntArray
from camgen.model.pose import FloatArray
from camgen.model.program import Columns, MoveJ
from camgen.model.tolerance import NONZERO
from camgen.motion.rounding import trace_corners
from camgen.post.plugins import dynamics_of, states_rounding
from camgen.preview import Built
from camgen.preview.curves import SpaceChains

#: Corners that are traced together.
_BLOCK = 4096


class _Points(NamedTuple):
    """Points of motions or corners.

    points: (N, 3) mm.
    motion: (N,) row of the motion, or of the motion before the corner.
    """

    points: FloatArray
    motion: IntArray


def trace_executed(result: Built, sag: float) -> SpaceChains | None:
    """The executed path along the paths of a program, a chain for each run of motions.

    None if no corner is rounded by a modelled curve.

    sag: distance, mm, by which a chain may leave the path.
    """
    dynamics = dynamics_of(result.post, result.job)
    if not states_rounding(result.post) or dynamics.corner not in ("zone", "overlap"):
        return None
    columns = result.program.columns
    rows = find_transitions(columns, columns.works, dynamics)
    if not len(rows):
        return None
    before, after = np.zeros(len(columns.at)), np.zeros(len(columns.at))
    corners = [
        _trace_block(columns, rows[low : low + _BLOCK], dynamics, (before, after, sag))
        for low in range(0, len(rows), _BLOCK)
    ]
    linear = np.flatnonzero(columns.works & ~columns.moves_are(MoveJ))
    linear = linear[linear > 0]
    linear = linear[~np.isnan(columns.ends[linear - 1, 0])]
    motions = _draw_motions(pick_shapes(columns, linear), after[linear], before[linear], sag)
    motions = _Points(motions.points, linear[motions.motion])
    # A corner follows the motion before it.
    points, motion = concatenate_columns([motions, *corners])
    order = np.argsort(motion, kind="stable")
    points, motion = points[order], motion[order]
    first = np.flatnonzero(np.diff(motion, prepend=-2) > 1)
    return SpaceChains(points, np.diff(np.append(first, len(points))))


def _trace_block(
    columns: Columns,
    rows: IntArray,
    dynamics: Dynamics,
    trimmed: tuple[FloatArray, FloatArray, float],
) -> _Points:
    """The points inside the corners at the ends of the motions `rows`.

    trimmed: (M,) lengths, mm, that are not run at the end and at the start of each motion, which
        are filled in, and the distance by which chains may leave the path.
    """
    before, after, sag = trimmed
    corners = trace_corners(pick_transitions(columns, rows), dynamics)
    before[rows], after[rows + 1] = corners.before, corners.after
    # A curve that leaves its chord by d leaves the chords of its n parts by d / n^2.
    last = corners.path.shape[1] - 1
    parts = np.clip(np.ceil(np.sqrt(corners.deviation / sag)), 1, last).astype(np.int64)
    owner = list_owners(parts - 1)
    place = np.round((number_rows(parts - 1) + 1) * last / parts[owner]).astype(np.int64)
    return _Points(corners.path[owner, place], rows[owner])


def _draw_motions(spans: Spans, low: FloatArray, high: FloatArray, sag: float) -> _Points:
    """The points of motions without pieces of lengths `low` and `high`, mm, at their ends."""
    length = np.maximum(spans.length, NONZERO)
    share = np.column_stack([low / length, 1 - high / length])
    with np.errstate(divide="ignore"):
        step = 2 * np.arccos(np.clip(1 - sag / spans.radius, -1.0, 1.0))
    turn = spans.sweep * np.maximum(share[:, 1] - share[:, 0], 0.0)
    parts = np.ceil(turn / np.maximum(step, 1e-2) - 1e-9).clip(1).astype(np.int64)
    owner = list_owners(parts + 1)
    place = number_rows(parts + 1) / parts[owner]
    along = share[owner, 0] + place * (share[owner, 1] - share[owner, 0])
    return _Points(spans.point(along, owner), owner)
