"""TCP poses along an edge at an offset: z against the offset, y along the edge (RFA, III.A)."""

from __future__ import annotations

import numpy as np
from msgspec.structs import replace

from camgen.geometry.arcs import are_bent, make_span_chain, measure_spans
from camgen.geometry.rotations import SURE_TURN
from camgen.geometry.vectors import cross
from camgen.model.part import BoolArray, Edge, Line
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import short
from camgen.motion.pose_paths import PosePath, divide
from camgen.motion.setup import FoldedEdge, UnreachableEdge
from camgen.plan.edges.last_face import Offset

#: Below this the sum of two unit normals has no direction.
_OPPOSED = 1e-3
#: An offset that leaves less than this part of an arc has closed it.
_CLOSED = 1e-3


def make_poses(edge: Edge, offset: float, direction: Offset = "mean") -> PosePath | UnreachableEdge:
    """The TCP poses along `edge`, `offset` mm away from it, in the direction of the edge.

    FoldedEdge if the offset folds a part of the edge, UnreachableEdge if there are no poses.

    work_from_tool is right-handed. Its z points against the offset. Its y points along the edge or
    against it, so that x = y cross z points downwards on the whole. If x is level all along, y
    points upwards at the start. If that is level too, x points along the x of the work, or else
    its y. The direction of travel does not change the poses, see `PosePath.reversed`.
    """
    outward, middle = _directions(edge, direction)
    if not (np.isfinite(outward).all() and np.isfinite(middle).all()):
        return UnreachableEdge(
            edge.id, "shape", "its two faces are back to back: there is no direction between them"
        )
    position, via = edge.points + offset * outward, edge.via + offset * middle
    before, after = np.diff(edge.points, axis=0), np.diff(position, axis=0)
    arc = are_bent(edge.points[:-1], edge.via, edge.points[1:])
    folded = (before * after).sum(axis=1) < _CLOSED * (before * before).sum(axis=1)
    # The second half of an arc does not run back: no arc turns by more than half a circle.
    halves = via - position[:-1], position[1:] - via
    folded |= arc & (np.multiply(*halves).sum(axis=1) < -_CLOSED * (after * after).sum(axis=1))
    leaves = f"an offset of {short(offset, 3)} mm leaves nothing of its inner radius"
    if folded.all():
        return UnreachableEdge(edge.id, "shape", leaves)
    begins, ends = _tangents(edge, arc)
    tangent = _at_rows(edge, begins, ends)
    wide = _are_wide(arc, begins, ends)
    at = np.flatnonzero(wide)
    outward = np.insert(outward, at + 1, middle[at], axis=0)
    tangent = np.insert(tangent, at + 1, _chords(edge)[at], axis=0)
    rotation = _frames(outward, tangent, edge.closed)
    if not np.isfinite(rotation).all():
        return UnreachableEdge(edge.id, "shape", "it turns back on itself")
    middles = np.full_like(position, np.nan)
    middles[1:][arc] = via[arc]
    whole = PosePath(position, middles, np.broadcast_to(np.eye(3), (len(position), 3, 3)))
    path = replace(divide(whole, 1 + wide), rotation=frozen(rotation))
    if not folded.any():
        return path
    lengths = measure_spans(edge.points, np.where(arc[:, None], edge.via, np.nan))
    first = short(float(lengths[: int(folded.argmax())].sum()), 1)
    text = f"{leaves} {first} mm along it; beside that only pieces are run, if any"
    return FoldedEdge(edge.id, "shape", text, path=path, folded=np.repeat(folded, 1 + wide))


def measure_line(line: Line, path: PosePath) -> FloatArray:
    """Length of `line` along each segment of its pose path, mm."""
    if not isinstance(line, Edge):
        return path.length
    arc = are_bent(line.points[:-1], line.via, line.points[1:])
    halves = 1 + _are_wide(arc, *_tangents(line, arc))
    lengths = measure_spans(line.points, np.where(arc[:, None], line.via, np.nan))
    return np.repeat(lengths / halves, halves)


def _tangents(edge: Edge, arc: BoolArray) -> tuple[FloatArray, FloatArray]:
    return make_span_chain(edge.points, np.where(arc[:, None], edge.via, np.nan)).tangents()


def _are_wide(arc: BoolArray, begins: FloatArray, ends: FloatArray) -> BoolArray:
    """Spans that turn too far for one segment of a pose path: they become two."""
    return np.asarray(arc & ((begins * ends).sum(axis=1) < np.cos(SURE_TURN)))


def _directions(edge: Edge, direction: Offset) -> tuple[FloatArray, FloatArray]:
    """Unit offset directions at the rows (N, 3) and in the middles (N - 1, 3); NaN if undefined."""
    if direction == "mean":
        return _mean(edge.normals), _mean(edge.via_normals)
    face = direction.choose(edge)
    return edge.normals[:, face], edge.via_normals[:, face]


def _mean(normals: FloatArray) -> FloatArray:
    total = normals.sum(axis=1)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.asarray(
        np.divide(total, length, out=np.full_like(total, np.nan), where=length > _OPPOSED)
    )


def _chords(edge: Edge) -> FloatArray:
    chord = np.diff(edge.points, axis=0)
    return np.asarray(chord / np.linalg.norm(chord, axis=1, keepdims=True))


def _at_rows(edge: Edge, begins: FloatArray, ends: FloatArray) -> FloatArray:
    """(N, 3) along the edge at its points: between the spans that meet there."""
    before = np.concatenate([ends[-1:] if edge.closed else begins[:1], ends])
    after = np.concatenate([begins, begins[:1] if edge.closed else ends[-1:]])
    return np.asarray(before + after)


def _frames(outward: FloatArray, tangent: FloatArray, closed: bool) -> FloatArray:
    """Frames (N, 3, 3) with z against `outward`, NaN where it is parallel to the tangent.

    The y of all of them points along the tangent, or of all of them against it.
    """
    z = -outward
    y = tangent - z * (z * tangent).sum(axis=1)[:, None]
    length = np.linalg.norm(y, axis=1, keepdims=True)
    y = np.divide(y, length, out=np.full_like(y, np.nan), where=length > _OPPOSED)
    x = cross(y, z)
    once = x[:-1] if closed else x
    scores = np.array([-once[:, 2].mean(), y[0, 2], x[0, 0], x[0, 1]])
    clear = scores[np.abs(scores) > 1e-6]
    sign = -1.0 if len(clear) and clear[0] < 0 else 1.0
    return np.stack([sign * x, sign * y, z], axis=2)
