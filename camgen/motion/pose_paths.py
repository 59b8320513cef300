"""Poses along an edge as a table: lines and arcs with an orientation at each end, and what lies between."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.geometry.arcs import Spans, chain, span_lengths
from camgen.geometry.ragged import offsets, owners, ramp
from camgen.geometry.rotations import angles_between, between, from_vectors, vectors_of
from camgen.model.pose import FloatArray, frozen
from camgen.model.tolerance import NONZERO

Index = NDArray[np.int64]


class PosePath(Struct, frozen=True, eq=False):
    """Poses of the tool in order, work frame, mm. Row i > 0 ends the segment from row i - 1.

    position: (N, 3) of the TCP. via: (N, 3), half-way along an arc of at most half a circle, NaN for a straight segment
    and in row 0. rotation: (N, 3, 3) work_from_tool; within a segment it turns from row to row by the shortest turn in
    proportion to the way, as controllers do.
    """

    position: FloatArray
    via: FloatArray
    rotation: FloatArray

    def __len__(self) -> int:
        return len(self.position)

    def reversed(self) -> PosePath:
        """The same poses the other way round."""
        return PosePath(
            frozen(self.position[::-1]), backwards(self.via), frozen(self.rotation[::-1])
        )

    def slice(self, first: int, stop: int) -> PosePath:
        """Poses of the rows from ``first`` up to ``stop``, which is left out."""
        via = self.via[first:stop].copy()
        via[:1] = np.nan
        return PosePath(self.position[first:stop], frozen(via), self.rotation[first:stop])

    @property
    def head(self) -> PosePath:
        """The poses without the last one."""
        return PosePath(self.position[:-1], self.via[:-1], self.rotation[:-1])

    @property
    def spans(self) -> Spans:
        """The N - 1 segments as lines and arcs."""
        return chain(self.position, self.via[1:])

    @property
    def length(self) -> FloatArray:
        """(N - 1,) mm of each segment."""
        return span_lengths(self.position, self.via[1:])

    @property
    def turn(self) -> FloatArray:
        """(N - 1,) rad by which the tool turns in each segment."""
        return angles_between(self.rotation[:-1], self.rotation[1:])


def backwards(via: FloatArray) -> FloatArray:
    """``PosePath.via`` of the reversed way."""
    return frozen(np.concatenate([np.full((1, 3), np.nan), via[:0:-1]]))


def counts(way: PosePath, length: float, turn: float) -> Index:
    """(N - 1,) into how many equal parts of at most ``length`` mm and ``turn`` rad each segment is to be cut."""
    most = np.maximum(way.length / length, way.turn / turn)
    return np.asarray(np.maximum(np.ceil(most - 1e-9), 1), dtype=np.int64)


def divide(way: PosePath, parts: Index) -> PosePath:
    """The same motion with segment i cut into ``parts[i - 1]`` equal ones; old row i is new row ``rows(parts)[i]``."""
    segment, after = owners(parts), ramp(parts) + 1
    share = 1.0 / parts[segment]
    spans, kept = way.spans, rows(parts)
    position = np.concatenate([way.position[:1], spans.point(after * share, segment)])
    position[kept] = way.position
    via = np.concatenate([np.full((1, 3), np.nan), spans.point((after - 0.5) * share, segment)])
    via[1:][np.isnan(way.via[1:, 0])[segment]] = np.nan
    whole = parts[segment] == 1
    via[1:][whole] = way.via[1:][segment[whole]]
    rotation = np.concatenate(
        [way.rotation[:1], between(way.rotation[:-1], way.rotation[1:], segment, after * share)]
    )
    rotation[kept] = way.rotation
    return PosePath(frozen(position), frozen(via), frozen(rotation))


class PoseSampler(Struct, frozen=True, eq=False):
    """A way, of which poses are asked for more than once. spans: its segments. turn: (N - 1, 3) by which the tool turns
    in each, axis times rad, as it stands at its start.
    """

    way: PosePath
    spans: Spans
    turn: FloatArray

    @classmethod
    def of(cls, way: PosePath) -> PoseSampler:
        """All along ``way``."""
        return cls(
            way, way.spans, vectors_of(np.swapaxes(way.rotation[:-1], 1, 2) @ way.rotation[1:])
        )

    def poses(self, at: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The TCP (K, 3) and its rotation (K, 3, 3) at places (K,), in rows: 2.25 is a quarter of the way from row 2 to
        row 3.
        """
        segment = np.minimum(at.astype(np.int64), len(self.turn) - 1)
        share = at - segment
        turned = from_vectors(self.turn[segment] * share[:, None])
        return self.spans.point(share, segment), self.way.rotation[segment] @ turned


def cut(way: PosePath, low: float, high: float) -> PosePath:
    """The same motion from ``low`` to ``high`` mm along it, where it has a length in between."""
    ends = np.concatenate([[0.0], np.cumsum(way.length)])
    before, after = np.clip(ends[:-1], low, high), np.clip(ends[1:], low, high)
    segment = np.flatnonzero(after - before > 0)
    span = np.maximum(way.length[segment], NONZERO)
    start, stop = (before[segment] - ends[segment]) / span, (after[segment] - ends[segment]) / span
    spans = way.spans
    own, first = np.concatenate([segment[:1], segment]), np.concatenate([start[:1], stop])
    via = np.concatenate([np.full((1, 3), np.nan), spans.point((start + stop) / 2, segment)])
    via[1:][np.isnan(way.via[1:, 0])[segment]] = np.nan
    rotation = between(way.rotation[:-1], way.rotation[1:], own, first)
    return PosePath(frozen(spans.point(first, own)), frozen(via), frozen(rotation))


def measure_to(path: PosePath, row: float) -> float:
    """Length of a pose path up to a place in rows: 2.25 is a quarter of the way from row 2."""
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


def rows(parts: Index) -> Index:
    """(N,) where the rows of a way are after ``divide``."""
    return offsets(parts)
