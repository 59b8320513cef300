"""Positions of an old program that are closer than the controller of an arm likes."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from camgen.geometry.ragged import mark_run_ends, mark_run_starts
from camgen.lang.recorded import Recorded
from camgen.model.part import BoolArray, Note
from camgen.model.pose import FloatArray
from camgen.model.program import Columns, MoveL, select_items
from camgen.model.text import counted, short
from camgen.model.tolerance import NONZERO

#: Positions that are nearer lie in each other's zone, mm: the smallest zone of RAPID, z0, has this
#: radius (ABB, technical reference manual of RAPID instructions, zonedata).
CLOSE_MM = 0.3
#: Digits of distances that count, mm: far fewer than those of a processor, far more than of a text.
_SAME_DIGITS = 9
#: A run of fewer short lines is passed at once.
_MANY = 10


def thin_positions(part: Recorded, tolerance: float) -> Recorded:
    """The program without positions near the line between their neighbours.

    A position is left out if both lines at it are shorter than `CLOSE_MM`, run at one feed with
    nothing between them, and may be rounded.

    part: the program.
    tolerance: maximum distance of a position from the new path, mm.
    """
    columns = Columns(part.run.body)
    kept = np.ones(len(part.run.body), dtype=bool)
    for first, last in _find_runs(columns, columns.moves_are(MoveL) & (columns.blend > 0)):
        # The way begins at the end of the motion before the run.
        kept[columns.at[first:last]] = keep_points(columns.ends[first - 1 : last], tolerance)[1:]
    left_out = int(np.count_nonzero(~kept))
    if not left_out:
        return part
    body, lines = select_items(part.run.body, kept), select_items(part.run.lines, kept)
    run = replace(part.run, body=tuple(body), lines=tuple(lines))
    positions = counted(left_out, "position is", "positions are")
    line = part.run.lines[int(np.flatnonzero(~kept)[0])]
    return replace(
        part,
        run=run,
        notes=(
            *part.notes,
            Note(
                "assumed",
                f"line {line}: {positions} left out, "
                f"which changes the path by {short(tolerance, 4)} mm",
                f"tolerance.chord; they are less than {CLOSE_MM} mm apart, "
                "where arms slow down or stop",
            ),
        ),
    )


def _find_runs(columns: Columns, chosen: BoolArray) -> list[tuple[int, int]]:
    """Runs of short motions at one feed: the first of each, and the one after its last.

    chosen: (M,) motions that a run may have.
    """
    steps = np.append(np.inf, np.linalg.norm(np.diff(columns.ends, axis=0), axis=1))
    is_short: BoolArray = chosen & (steps < CLOSE_MM)
    goes_on = np.append(False, (np.diff(columns.at) == 1) & (np.diff(columns.speed) == 0))
    number = np.cumsum(~goes_on | ~is_short)
    rows = np.flatnonzero(is_short)
    first, last = rows[mark_run_starts(number[rows])], rows[mark_run_ends(number[rows])]
    runs = zip(first.tolist(), (last + 1).tolist(), strict=True)
    return [(begin, end) for begin, end in runs if end - begin > 1 and begin > 0]


def count_close_positions(columns: Columns) -> int:
    """The number of positions in runs of `_MANY` or more motions shorter than `CLOSE_MM`."""
    return sum(
        last - first for first, last in _find_runs(columns, columns.works) if last - first >= _MANY
    )


def keep_points(points: FloatArray, tolerance: float) -> BoolArray:
    """(N,) the points of a chain that its simplification keeps, by Douglas and Peucker.

    points: (N, 3) mm.
    tolerance: maximum distance of the other points from the chain, mm.
    """
    kept = np.zeros(len(points), dtype=bool)
    kept[[0, -1]] = True
    open_: list[tuple[int, int]] = [(0, len(points) - 1)]
    while open_:
        low, high = open_.pop()
        if high - low < 2:
            continue
        distance = _distance(points[low + 1 : high], points[low], points[high])
        # The first of places that are equally far counts, whatever their last bits are.
        farthest = int(np.round(distance, _SAME_DIGITS).argmax())
        if distance[farthest] > tolerance:
            middle = low + 1 + farthest
            kept[middle] = True
            open_ += [(low, middle), (middle, high)]
    return kept


def _distance(points: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    chord = end - start
    # BLAS rounds a product by its processor. Sums along an axis are the same everywhere.
    square = max(float((chord * chord).sum()), NONZERO)
    share = np.clip(((points - start) * chord).sum(axis=1) / square, 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - start - share[:, None] * chord, axis=1))
