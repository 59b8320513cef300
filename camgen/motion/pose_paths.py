"""Pose paths: tables of tool poses with lines and arcs between them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.arcs import Spans, make_span_chain, measure_spans
from camgen.geometry.ragged import compute_offsets, list_owners, number_rows
from camgen.geometry.rotations import (
    compute_rotation_vectors,
    interpolate_rotations,
    make_rotations_from_vectors,
    measure_angles_between,
)
from camgen.model.pose import FloatArray, frozen
from camgen.model.tolerance import NONZERO

Index = NDArray[np.int64]

#: `PosePath.via` of a straight segment.
_STRAIGHT = np.full((1, 3), np.nan)


class PosePath(Struct, frozen=True, eq=False, dict=True):
    """Poses of the tool in order, in the work frame. Row i > 0 ends the segment from row i - 1.

    position: (N, 3) TCP, mm.
    via: (N, 3) point half-way along an arc of at most half a circle, mm; NaN for a straight segment
        and in row 0.
    rotation: (N, 3, 3) work_from_tool. Within a segment it changes by the shortest rotation, in
        proportion to the length, as controllers do.
    """

    position: FloatArray
    via: FloatArray
    rotation: FloatArray

    def __len__(self) -> int:
        return len(self.position)

    def reversed(self) -> PosePath:
        """The poses in opposite order."""
        via = np.concatenate([_STRAIGHT, self.via[:0:-1]])
        return PosePath(frozen(self.position[::-1]), frozen(via), frozen(self.rotation[::-1]))

    def slice(self, first: int, stop: int) -> PosePath:
        """The rows from `first` up to the one before `stop`."""
        via = self.via[first:stop].copy()
        via[:1] = np.nan
        return PosePath(self.position[first:stop], frozen(via), self.rotation[first:stop])

    @cached_property
    def spans(self) -> Spans:
        """The N - 1 segments as lines and arcs."""
        return make_span_chain(self.position, self.via[1:])

    @cached_property
    def length(self) -> FloatArray:
        """(N - 1,) length of each segment, mm."""
        return frozen(measure_spans(self.position, self.via[1:]))

    @cached_property
    def turn_vectors(self) -> FloatArray:
        """(N - 1, 3) rotation vector of each segment in the tool frame at its start, rad."""
        turns = np.swapaxes(self.rotation[:-1], 1, 2) @ self.rotation[1:]
        return frozen(compute_rotation_vectors(turns))

    @cached_property
    def turn(self) -> FloatArray:
        """(N - 1,) angle by which the tool rotates in each segment, rad."""
        return frozen(measure_angles_between(self.rotation[:-1], self.rotation[1:]))


def count_parts(path: PosePath, length: float, turn: float) -> Index:
    """(N - 1,) numbers of equal parts of at most `length` mm and `turn` rad of each segment."""
    parts = np.maximum(path.length / length, path.turn / turn)
    return np.asarray(np.maximum(np.ceil(parts - 1e-9), 1), dtype=np.int64)


def divide(path: PosePath, parts: Index) -> PosePath:
    """The pose path with segment i divided into `parts[i - 1]` equal ones.

    Row i becomes row `offsets(parts)[i]`.
    """
    segment, after = list_owners(parts), number_rows(parts) + 1
    fraction = 1.0 / parts[segment]
    spans, kept = path.spans, compute_offsets(parts)
    position = np.concatenate([path.position[:1], spans.point(after * fraction, segment)])
    position[kept] = path.position
    via = np.concatenate([_STRAIGHT, spans.point((after - 0.5) * fraction, segment)])
    via[1:][np.isnan(path.via[1:, 0])[segment]] = np.nan
    is_whole = parts[segment] == 1
    via[1:][is_whole] = path.via[1:][segment[is_whole]]
    turned = interpolate_rotations(path.rotation[:-1], path.rotation[1:], segment, after * fraction)
    rotation = np.concatenate([path.rotation[:1], turned])
    rotation[kept] = path.rotation
    return PosePath(frozen(position), frozen(via), frozen(rotation))


def sample_poses(path: PosePath, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Positions (K, 3) and rotations (K, 3, 3) of the tool at places `at` (K,) in rows.

    2.25 is a quarter of the way from row 2 to row 3.
    """
    turns = path.turn_vectors
    segment = np.minimum(at.astype(np.int64), len(turns) - 1)
    fraction = at - segment
    turned = make_rotations_from_vectors(turns[segment] * fraction[:, None])
    return path.spans.point(fraction, segment), path.rotation[segment] @ turned


def cut(path: PosePath, low: float, high: float) -> PosePath:
    """The part of a pose path from `low` to `high` mm along it, which must have a length."""
    ends = np.concatenate([[0.0], np.cumsum(path.length)])
    before, after = np.clip(ends[:-1], low, high), np.clip(ends[1:], low, high)
    segment = np.flatnonzero(after - before > 0)
    length = np.maximum(path.length[segment], NONZERO)
    start = (before[segment] - ends[segment]) / length
    stop = (after[segment] - ends[segment]) / length
    spans = path.spans
    via = np.concatenate([_STRAIGHT, spans.point((start + stop) / 2, segment)])
    via[1:][np.isnan(path.via[1:, 0])[segment]] = np.nan
    row_segment, at = np.concatenate([segment[:1], segment]), np.concatenate([start[:1], stop])
    rotation = interpolate_rotations(path.rotation[:-1], path.rotation[1:], row_segment, at)
    return PosePath(frozen(spans.point(at, row_segment)), frozen(via), frozen(rotation))


def measure_to(path: PosePath, row: float) -> float:
    """Length of a pose path up to a place in rows, mm: 2.25 is a quarter of the way from row 2."""
    along = np.concatenate([[0.0], np.cumsum(path.length)])
    return float(np.interp(row, np.arange(len(along)), along))


def join(paths: Sequence[PosePath]) -> PosePath:
    """Pose paths one after the other; each begins where the path before it ends."""
    rest = paths[1:]
    return PosePath(
        np.concatenate([paths[0].position, *(path.position[1:] for path in rest)]),
        np.concatenate([paths[0].via, *(path.via[1:] for path in rest)]),
        np.concatenate([paths[0].rotation, *(path.rotation[1:] for path in rest)]),
    )
