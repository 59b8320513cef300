"""Maps the entities of a drawing to flat pieces in the work frame, mm, all at once by numpy.

A curve is used if it is flat and parallel to the work plane, at any height. A curve that leaves its
plane is never projected, it is reported. Under a matrix that keeps angles arcs stay arcs. Under
another one they become elliptical and are approximated by arcs and lines.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry import curves
from camgen.geometry.ragged import (
    compute_first_rows,
    compute_offsets,
    find_following_rows,
    list_owners,
    number_rows,
)
from camgen.model.pose import FloatArray
from camgen.read.dxf.entities import DrawnEntities, Smooth
from camgen.read.pieces import FARTHEST, BoolArray, DrawnPieces, IntArray, are_credible, index_names

#: mm: rounding of coordinates. A flat curve may leave its plane by this,
FLAT_MM = 1e-3
#: or by this fraction of its size.
_FLAT_FRACTION = 1e-6
#: Two axes are equally long and perpendicular if their squared lengths differ by at most this
#: fraction, and if their scalar product is at most this fraction of the longer one.
_SIMILAR = 1e-9


class Flat(Struct, frozen=True, eq=False):
    """A drawing as flat pieces. An owner is the number of an entity in the drawing.

    soup: the P pieces in drawing order.
    tilted: distance by which a curve leaves its plane, mm, by owner. It is not used.
    damaged: owners of curves whose numbers are invalid. They are not used.
    heights: (P,) heights of the pieces above the work plane, mm, in another order.
    gaps: distance between the ends of each spline that is marked closed, mm, by owner.
    """

    soup: DrawnPieces
    tilted: dict[int, float]
    damaged: tuple[int, ...]
    heights: FloatArray
    gaps: dict[int, float]


class EntityRows(NamedTuple):
    """P pieces of lines and arcs.

    owner: (P,) number of the entity of each piece.
    counts: (P,) number of rows of each piece.
    rows: (V, 4) x, y, z and bulge of the points of all pieces.
    """

    owner: IntArray
    counts: IntArray
    rows: FloatArray


class _Chain(Struct, frozen=True, eq=False):
    """A piece with curves that arcs approximate.

    owner: number of its entity.
    runs: its parts, end to end. A part is an array of Bezier segments, or points with bulges.
    height: its height above the work plane, mm.
    """

    owner: int
    runs: tuple[FloatArray | curves.Outline, ...]
    height: float


def flatten(drawn: DrawnEntities, chord: float) -> Flat:
    """The flat pieces of a drawing, and the owners of curves that are not used.

    chord: largest deviation of ellipses and splines, mm.
    """
    matrices = np.array(drawn.matrices)
    matrix = np.array(drawn.matrix, dtype=np.intp)
    entities = gather(drawn)
    which = matrix[entities.owner]
    keeps_angles = _keep_angles(matrices)[which]
    empty = _list_empty_pieces(drawn)
    world, low, high = _place(entities, matrices, which)
    soup = _make_soup(empty, world)
    is_valid = are_credible(soup)
    is_flat = ~(high - low > _compute_tolerances(soup)) | ~is_valid
    arc_count = np.bincount(
        list_owners(entities.counts), entities.rows[:, 3] != 0, minlength=len(entities.counts)
    )
    becomes_elliptical = (arc_count > 0) & ~keeps_angles
    chains = [
        _make_chain(drawn, entities, piece, matrices[which[piece]], float(low[piece]))
        for piece in np.flatnonzero(is_flat & is_valid & becomes_elliptical).tolist()
    ]
    height = (high - low)[~is_flat].tolist()
    tilted = dict(zip(entities.owner[~is_flat].tolist(), height, strict=True))
    damaged: list[int] = entities.owner[~is_valid].tolist()
    gaps: dict[int, float] = {}
    for owner, curve in drawn.smooth.items():
        result = _make_smooth(owner, curve, matrices[matrix[owner]])
        if isinstance(result, _Chain):
            chains.append(result)
            (run,) = result.runs
            if owner in drawn.marked_closed and isinstance(run, np.ndarray):
                start, end = run[0, 0], run[-1, -1]
                gaps[owner] = float(np.hypot(*(end[:2] / end[2] - start[:2] / start[2])))
        elif result is None:
            damaged.append(owner)
        else:
            tilted[owner] = result
    is_used = is_flat & is_valid & ~becomes_elliptical
    used = EntityRows(
        world.owner[is_used], world.counts[is_used], world.rows[np.repeat(is_used, world.counts)]
    )
    pieces = _concatenate([used, _fit(chains, chord)])
    soup = _make_soup(empty, pieces).take(np.argsort(pieces.owner, kind="stable"))
    heights = np.concatenate([low[is_used], [chain.height for chain in chains]])
    return Flat(soup, tilted, tuple(sorted(damaged)), heights, gaps)


# Lines and arcs.


def gather(drawn: DrawnEntities) -> EntityRows:
    """Lines, arcs and polylines in the coordinates of each entity, arcs as half circles at most."""
    return _concatenate([_list_lines(drawn), _list_arcs(drawn), _list_outlines(drawn)])


def _list_lines(drawn: DrawnEntities) -> EntityRows:
    ends = np.array(drawn.lines).reshape(-1, 3)
    owner = np.array(drawn.line_owner, dtype=np.intp)
    return EntityRows(owner, np.full(len(owner), 2), np.column_stack([ends, np.zeros(len(ends))]))


def _list_arcs(drawn: DrawnEntities) -> EntityRows:
    x, y, z, radius, start, sweep = np.array(drawn.arcs).reshape(-1, 6).T
    owner = np.array(drawn.arc_owner, dtype=np.intp)
    parts = np.maximum(np.ceil(sweep / 180 - 1e-12), 1).astype(np.intp)
    is_closed = np.array(drawn.closed, dtype=np.bool_)[owner]
    counts = parts + ~is_closed
    arc = list_owners(counts)
    angle = np.radians(start[arc] + (sweep / parts)[arc] * number_rows(counts))
    bulge = np.tan(np.radians(sweep / parts) / 4)
    points = (x[arc] + radius[arc] * np.cos(angle), y[arc] + radius[arc] * np.sin(angle), z[arc])
    rows = np.column_stack([*points, bulge[arc]])
    _clear_last_bulges(rows, counts, is_closed)
    # Half circles have a bulge of exactly 1, by which circles are recognised later.
    rows[np.abs(rows[:, 3] - 1) < 1e-12, 3] = 1.0
    return EntityRows(owner, counts, rows)


def _list_outlines(drawn: DrawnEntities) -> EntityRows:
    owner = np.array(list(drawn.outlines), dtype=np.intp)
    counts = np.array(list(map(len, drawn.outlines.values())), dtype=np.intp)
    rows = np.concatenate([np.zeros((0, 4)), *drawn.outlines.values()])
    _clear_last_bulges(rows, counts, np.array(drawn.closed, dtype=np.bool_)[owner])
    return EntityRows(owner, counts, rows)


def _clear_last_bulges(rows: FloatArray, counts: IntArray, is_closed: BoolArray) -> None:
    rows[(np.cumsum(counts) - 1)[~is_closed], 3] = 0.0


def _concatenate(parts: list[EntityRows]) -> EntityRows:
    return EntityRows(*map(np.concatenate, zip(*parts, strict=True)))


def _keep_angles(matrices: FloatArray) -> BoolArray:
    u, v = matrices[:, :2, 0], matrices[:, :2, 1]
    uu, vv = np.einsum("md,md->m", u, u), np.einsum("md,md->m", v, v)
    uv = np.einsum("md,md->m", u, v)
    size = np.maximum(uu, vv)
    return np.asarray((np.abs(uu - vv) <= _SIMILAR * size) & (np.abs(uv) <= _SIMILAR * size))


def _place(
    entities: EntityRows, matrices: FloatArray, which: IntArray
) -> tuple[EntityRows, FloatArray, FloatArray]:
    """The pieces in the work frame, and (P,) the lowest and the highest z of each, mm.

    Arcs count with their middles.

    which: (P,) index of the matrix of each piece.
    """
    rows = entities.rows
    matrix_of_row = np.repeat(which, entities.counts)
    world = rows.copy()
    world[:, :3] = _transform(matrices, matrix_of_row, rows[:, :3])
    # The middle of an arc may be its only point out of the plane.
    chord = rows[find_following_rows(entities.counts), :2] - rows[:, :2]
    right = np.column_stack([chord[:, 1], -chord[:, 0]])
    middle = np.column_stack([rows[:, :2] + chord / 2 + right * rows[:, 3:] / 2, rows[:, 2]])
    middle_z = _transform(matrices, matrix_of_row, middle)[:, 2]
    z = np.stack([world[:, 2], np.where(rows[:, 3] != 0, middle_z, world[:, 2])])
    first = compute_first_rows(entities.counts)
    low = np.minimum.reduceat(z.min(axis=0), first)
    high = np.maximum.reduceat(z.max(axis=0), first)
    # A piece with an invalid height is not flat but damaged, so its x is made invalid, too.
    world[~np.isfinite(world[:, 2]), 0] = np.nan
    is_mirrored = np.linalg.det(matrices[:, :2, :2]) < 0
    world[:, 3] *= np.where(is_mirrored[matrix_of_row], -1.0, 1.0)
    return EntityRows(entities.owner, entities.counts, world), low, high


def _transform(matrices: FloatArray, which: IntArray, points: FloatArray) -> FloatArray:
    if len(which) and (which == which[0]).all():
        matrix = matrices[which[0]]
        return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])
    rotated = np.einsum("vij,vj->vi", matrices[which, :3, :3], points)
    return np.asarray(rotated + matrices[which, :3, 3])


def _compute_tolerances(soup: DrawnPieces) -> FloatArray:
    """(P,) distance by which each piece may leave its plane, mm."""
    first = soup.first[:-1]
    size = np.maximum.reduceat(soup.points, first) - np.minimum.reduceat(soup.points, first)
    return np.asarray(np.maximum(FLAT_MM, _FLAT_FRACTION * size.max(axis=1)))


# Ellipses and splines.


def find_arc_center(start: FloatArray, end: FloatArray, bulge: float) -> FloatArray:
    """(2,) centre of an arc from `start` to `end`, which differ, with a bulge that is not 0."""
    chord = end - start
    left = np.array([-chord[1], chord[0]])
    return np.asarray(start + chord / 2 + left * (1 - bulge * bulge) / (4 * bulge))


def _make_chain(
    drawn: DrawnEntities, entities: EntityRows, piece: int, matrix: FloatArray, height: float
) -> _Chain:
    """A piece with arcs under a matrix that makes them elliptical."""
    first = int(entities.counts[:piece].sum())
    starts = entities.rows[first : first + entities.counts[piece]]
    owner = int(entities.owner[piece])
    ends = np.concatenate([starts[1:], starts[:1]])
    if not drawn.closed[owner]:
        starts, ends = starts[:-1], ends[:-1]
    axes = matrix[:2, :2]
    runs: list[FloatArray | curves.Outline] = []
    for start, end in zip(starts, ends, strict=True):
        bulge = start[3]
        if bulge == 0 or not (end[:2] - start[:2]).any():
            runs.append((_transform_to_plane(matrix, np.array([start[:3], end[:3]])), np.zeros(2)))
            continue
        center = find_arc_center(start[:2], end[:2], bulge)
        radius = start[:2] - center
        middle = _transform_to_plane(matrix, np.array([[*center, start[2]]]))[0]
        turned = np.array([-radius[1], radius[0]])
        runs.append(
            curves.make_ellipse(middle, axes @ radius, axes @ turned, 0.0, 4 * math.atan(bulge))
        )
    return _Chain(owner, tuple(runs), height)


def _transform_to_plane(matrix: FloatArray, points: FloatArray) -> FloatArray:
    return np.asarray(points @ matrix[:2, :3].T + matrix[:2, 3])


def _make_smooth(owner: int, curve: Smooth, matrix: FloatArray) -> _Chain | float | None:
    """An ellipse or a spline in the work frame.

    Returns the distance by which it leaves its plane, mm, if it is not flat; None if it is damaged.
    """
    world = curve.transform(matrix)
    if not (np.isfinite(curve.knots).all() and (np.abs(world) <= FARTHEST).all()):
        return None
    if curve.degree:
        height = float(np.ptp(world[:, 2]))
        size = float(np.ptp(world[:, :2], axis=0).max())
    else:
        height = 2 * math.hypot(world[1, 2], world[2, 2])
        size = 2 * float(np.abs(world[1:, :2]).max())
    if height > max(FLAT_MM, _FLAT_FRACTION * size):
        return height
    if not curve.degree:
        return _Chain(owner, (_make_ellipse(world, *curve.knots.tolist()),), float(world[0, 2]))
    try:
        run = curves.make_bspline(world[:, :2], curve.knots, curve.degree, curve.weights)
    except ValueError:
        return None
    return _Chain(owner, (run,), float(world[0, 2]))


def _make_ellipse(axes: FloatArray, start: float, end: float) -> FloatArray | curves.Outline:
    """Bezier segments of an arc of an ellipse; points with bulges if it is a circle.

    axes: (3, 3) center and half axes, mm.
    start, end: parameters, rad.
    """
    center, u, v = axes[:, :2]
    size = max(float(u @ u), float(v @ v))
    if abs(float(u @ u - v @ v)) > _SIMILAR * size or abs(float(u @ v)) > _SIMILAR * size:
        return curves.make_ellipse(center, u, v, start, end)
    count = max(1, math.ceil(abs(end - start) / math.pi - 1e-12))
    angle = np.linspace(start, end, count + 1)
    bulge = math.tan((end - start) / count / 4) * math.copysign(1.0, u[0] * v[1] - u[1] * v[0])
    points = center + np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * v
    return points, np.full(count + 1, bulge)


def _fit(chains: list[_Chain], chord: float) -> EntityRows:
    """The chains as lines and arcs that deviate by `chord` mm at most."""
    segments: list[FloatArray] = []
    for chain in chains:
        segments += [run for run in chain.runs if isinstance(run, np.ndarray)]
    fitted = iter(curves.fit(segments, chord))
    rows, counts = [np.zeros((0, 4))], []
    for chain in chains:
        parts = []
        for run in chain.runs:
            points, bulges = next(fitted) if isinstance(run, np.ndarray) else run
            part = np.column_stack([points, np.full(len(points), chain.height), bulges])
            # The last point of a part is the first one of the next.
            parts.append(part[:-1])
        part[-1, 3] = 0.0
        rows.append(np.concatenate([*parts, part[-1:]]))
        counts.append(len(rows[-1]))
    owner = np.array([chain.owner for chain in chains], dtype=np.intp)
    return EntityRows(owner, np.array(counts, dtype=np.intp), np.concatenate(rows))


# The soup.


def _list_empty_pieces(drawn: DrawnEntities) -> DrawnPieces:
    """A piece without points for each entity, with its layer and so on."""
    layers, layer = index_names(drawn.layer)
    kinds, kind = index_names(drawn.kind)
    return DrawnPieces(
        points=np.zeros((0, 2)),
        bulges=np.zeros(0),
        first=np.zeros(len(layer) + 1, dtype=np.intp),
        closed=np.array(drawn.closed, dtype=np.bool_),
        layer=layer,
        kind=kind,
        color=np.array(drawn.color, dtype=np.intp),
        layers=layers,
        kinds=kinds,
        colors=tuple(drawn.colors.names),
    )


def _make_soup(empty: DrawnPieces, pieces: EntityRows) -> DrawnPieces:
    """The soup of `pieces`. empty: the pieces of all entities, without points."""
    return replace(
        empty,
        points=pieces.rows[:, :2],
        bulges=pieces.rows[:, 3],
        first=compute_offsets(pieces.counts),
        closed=empty.closed[pieces.owner],
        layer=empty.layer[pieces.owner],
        kind=empty.kind[pieces.owner],
        color=empty.color[pieces.owner],
    )
