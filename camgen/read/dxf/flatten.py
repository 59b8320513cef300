"""From the columns of the walk to flat pieces in the work plane, mm: one pass of numpy for all entities.

A curve is used if it lies flat in a plane parallel to the work plane, at whatever height. A curve that leaves its
plane is never projected but reported. Under a matrix that keeps angles arcs stay arcs; under any other they become
elliptical ones, which are fitted by arcs and lines.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry import curves
from camgen.geometry.ragged import offsets, owners, ramp
from camgen.model.pose import FloatArray
from camgen.read.dxf.entities import DrawnEntities, Smooth
from camgen.read.pieces import FARTHEST, BoolArray, IntArray, Soup, credible, next_row

#: A curve may leave its plane by this much (mm), or by this part of its size.
FLAT_MM, FLAT_SHARE = 1e-3, 1e-6
#: How far the axes of a matrix may be from equal and square to count as keeping angles.
_SIMILAR = 1e-9


class Flat(Struct, frozen=True, eq=False):
    """The pieces in drawing order and what was left out, by owner number.

    tilted: owner -> mm by which the curve leaves its plane. damaged: owners. heights: (P,) mm, one per piece.
    gaps: distance between the ends of each spline that is marked closed, mm, by owner.
    """

    soup: Soup
    tilted: dict[int, float]
    damaged: tuple[int, ...]
    heights: FloatArray
    gaps: dict[int, float]


class EntityRows(Struct, frozen=True, eq=False):
    """Pieces of lines and arcs: owner (P,), counts (P,), rows of x, y, z, bulge (V, 4)."""

    owner: IntArray
    counts: IntArray
    rows: FloatArray


class _Chain(Struct, frozen=True, eq=False):
    """One piece made of runs: a run of Bezier segments to fit, or points and bulges as they are."""

    owner: int
    runs: tuple[FloatArray | curves.Outline, ...]
    height: float


def flatten(drawn: DrawnEntities, chord: float) -> Flat:
    """Pieces of all that was drawn. chord: mm, the deviation allowed for ellipses and splines."""
    matrices = np.array(drawn.matrices)
    matrix = np.array(drawn.matrix, dtype=np.intp)
    similar, mirrored = _similar(matrices)
    given = gather(drawn)
    which = matrix[given.owner]
    named = _name(drawn)
    world, low, high = _place(named, given, matrices, which)
    level = ~(high - low > _allow(world))
    oval = _has_arcs(given) & ~similar[which]
    world.bulges[:] *= np.repeat(np.where(mirrored[which], -1.0, 1.0), given.counts)
    sound = credible(world)
    level |= ~sound
    ovals = np.flatnonzero(level & oval & sound)
    chains = [_oval(drawn, given, int(i), matrices[which[i]], float(low[i])) for i in ovals]
    tilted = dict(zip(given.owner[~level].tolist(), (high - low)[~level].tolist(), strict=True))
    damaged: list[int] = given.owner[~sound].tolist()
    gaps: dict[int, float] = {}
    for number, curve in zip(drawn.smooth_owner, drawn.smooth, strict=True):
        made = _smooth(number, curve, matrices[matrix[number]])
        if isinstance(made, _Chain):
            chains.append(made)
            if number in drawn.marked_closed:
                gaps[number] = _measure_gap(made)
        elif made is None:
            damaged.append(number)
        else:
            tilted[number] = made
    fitted = _soup(named, _stitch(chains, chord))
    plain = level & sound & ~oval
    owner = np.concatenate([given.owner[plain], np.array([c.owner for c in chains], dtype=np.intp)])
    heights = np.concatenate([low[plain], [c.height for c in chains]])
    soup = _together(world.take(plain), fitted).take(np.argsort(owner, kind="stable"))
    return Flat(soup, tilted, tuple(sorted(damaged)), heights, gaps)


def _measure_gap(chain: _Chain) -> float:
    """Distance between the ends of a spline of Bezier segments, mm."""
    (curve,) = chain.runs
    if not isinstance(curve, np.ndarray):
        return 0.0
    start, end = curve[0, 0], curve[-1, -1]
    return float(np.hypot(*(end[:2] / end[2] - start[:2] / start[2])))


# --- lines and arcs --------------------------------------------------------------------------------------------------


def gather(drawn: DrawnEntities) -> EntityRows:
    """Lines, arcs and outlines, each in its own frame, arcs in parts of at most a half circle."""
    return _concatenate([_lines(drawn), _arcs(drawn), _outlines(drawn)])


def _lines(drawn: DrawnEntities) -> EntityRows:
    ends = np.array(drawn.lines).reshape(-1, 3)
    owner = np.array(drawn.line_owner, dtype=np.intp)
    return EntityRows(owner, np.full(len(owner), 2), np.column_stack([ends, np.zeros(len(ends))]))


def _arcs(drawn: DrawnEntities) -> EntityRows:
    """Arcs and circles as polylines with a bulge, in parts of at most a half circle."""
    x, y, z, radius, start, sweep = np.array(drawn.arcs).reshape(-1, 6).T
    owner = np.array(drawn.arc_owner, dtype=np.intp)
    parts = np.maximum(np.ceil(sweep / 180 - 1e-12), 1).astype(np.intp)
    closed = np.array(drawn.closed, dtype=np.bool_)[owner]
    counts = parts + ~closed
    of = owners(counts)
    angle = np.radians(start[of] + (sweep / parts)[of] * ramp(counts))
    bulge = np.tan(np.radians(sweep / parts) / 4)
    points = [
        x[of] + radius[of] * np.cos(angle),
        y[of] + radius[of] * np.sin(angle),
        z[of],
        bulge[of],
    ]
    rows = np.column_stack(points)
    rows[(np.cumsum(counts) - 1)[~closed], 3] = 0.0
    # Half circles exactly, so that circles are known again.
    rows[np.abs(rows[:, 3] - 1) < 1e-12, 3] = 1.0
    return EntityRows(owner, counts, rows)


def _outlines(drawn: DrawnEntities) -> EntityRows:
    owner = np.array(drawn.outline_owner, dtype=np.intp)
    counts = np.array([len(o) for o in drawn.outlines], dtype=np.intp)
    rows = np.concatenate(drawn.outlines) if drawn.outlines else np.zeros((0, 4))
    closed = np.array(drawn.closed, dtype=np.bool_)[owner]
    rows[(np.cumsum(counts) - 1)[~closed], 3] = 0.0
    return EntityRows(owner, counts, rows)


def _concatenate(parts: list[EntityRows]) -> EntityRows:
    return EntityRows(
        *(np.concatenate([getattr(p, name) for p in parts]) for name in ("owner", "counts", "rows"))
    )


def _has_arcs(given: EntityRows) -> BoolArray:
    of = np.repeat(np.arange(len(given.counts)), given.counts)
    return np.asarray(np.bincount(of, given.rows[:, 3] != 0, minlength=len(given.counts)) > 0)


def _similar(matrices: FloatArray) -> tuple[BoolArray, BoolArray]:
    """Which matrices keep angles in the plane, and which mirror it (M,)."""
    u, v = matrices[:, :2, 0], matrices[:, :2, 1]
    uu, vv, uv = (np.einsum("md,md->m", a, b) for a, b in ((u, u), (v, v), (u, v)))
    size = np.maximum(uu, vv)
    similar = (np.abs(uu - vv) <= _SIMILAR * size) & (np.abs(uv) <= _SIMILAR * size)
    return similar, np.linalg.det(matrices[:, :2, :2]) < 0


def _place(
    named: _Named, given: EntityRows, matrices: FloatArray, which: IntArray
) -> tuple[Soup, FloatArray, FloatArray]:
    """The pieces in the work frame and the least and greatest height (P,) of each, arcs included."""
    rows = given.rows
    local = _soup(named, (given.owner, given.counts, rows[:, :2], rows[:, 3]))
    of_row = np.repeat(which, given.counts)
    world = _map(matrices, of_row, rows[:, :3])
    # The middle of an arc may be the only point of it that is out of the plane.
    chord = local.points[next_row(local)] - local.points
    right = np.column_stack([chord[:, 1], -chord[:, 0]])
    middle = np.column_stack([rows[:, :2] + chord / 2 + right * rows[:, 3:] / 2, rows[:, 2]])
    z = np.stack(
        [world[:, 2], np.where(rows[:, 3] != 0, _map(matrices, of_row, middle)[:, 2], world[:, 2])]
    )
    starts = local.first[:-1]
    low, high = (
        np.minimum.reduceat(z.min(axis=0), starts),
        np.maximum.reduceat(z.max(axis=0), starts),
    )
    # A height that is no number must not pass as flat: it is told as damage together with x and y.
    world[~np.isfinite(world[:, 2]), 0] = np.nan
    return replace(local, points=world[:, :2].copy(), bulges=rows[:, 3].copy()), low, high


def _map(matrices: FloatArray, which: IntArray, points: FloatArray) -> FloatArray:
    """Points (V, 3) under their matrices."""
    if len(which) and (which == which[0]).all():
        matrix = matrices[which[0]]
        return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])
    return np.asarray(
        np.einsum("vij,vj->vi", matrices[which, :3, :3], points) + matrices[which, :3, 3]
    )


def _allow(soup: Soup) -> FloatArray:
    """How far (P,) each piece may leave its plane, mm."""
    starts = soup.first[:-1]
    size = np.maximum.reduceat(soup.points, starts) - np.minimum.reduceat(soup.points, starts)
    return np.asarray(np.maximum(FLAT_MM, FLAT_SHARE * size.max(axis=1)))


# --- ellipses and splines --------------------------------------------------------------------------------------------


def _oval(
    drawn: DrawnEntities, given: EntityRows, piece: int, matrix: FloatArray, height: float
) -> _Chain:
    """A piece with arcs under a matrix that makes them elliptical."""
    first = int(given.counts[:piece].sum())
    rows = given.rows[first : first + given.counts[piece]]
    owner = int(given.owner[piece])
    ends = np.concatenate([rows[1:], rows[:1]])
    if not drawn.closed[owner]:
        rows, ends = rows[:-1], ends[:-1]
    b = matrix[:2, :2]
    runs: list[FloatArray | curves.Outline] = []
    for a, e in zip(rows, ends, strict=True):
        chord, bulge = e[:2] - a[:2], a[3]
        if bulge == 0 or not chord.any():
            runs.append((_flat_points(matrix, np.array([a[:3], e[:3]])), np.zeros(2)))
            continue
        center = (
            a[:2] + chord / 2 + np.array([-chord[1], chord[0]]) * (1 - bulge * bulge) / (4 * bulge)
        )
        out = a[:2] - center
        middle = _flat_points(matrix, np.array([[*center, a[2]]]))[0]
        turned = np.array([-out[1], out[0]])
        runs.append(curves.make_ellipse(middle, b @ out, b @ turned, 0.0, 4 * math.atan(bulge)))
    return _Chain(owner, tuple(runs), height)


def _flat_points(matrix: FloatArray, points: FloatArray) -> FloatArray:
    return np.asarray(points @ matrix[:2, :3].T + matrix[:2, 3])


def _smooth(owner: int, curve: Smooth, matrix: FloatArray) -> _Chain | float | None:
    """An ellipse or a spline in the work frame; the height by which it leaves its plane; or None if damaged."""
    world = curve.control @ matrix[:3, :3].T
    world[: len(world) if curve.degree else 1] += matrix[:3, 3]
    if not (np.isfinite(curve.knots).all() and (np.abs(world) <= FARTHEST).all()):
        return None
    if curve.degree:
        height = float(np.ptp(world[:, 2]))
        size = float(np.ptp(world[:, :2], axis=0).max())
    else:
        height = 2 * math.hypot(world[1, 2], world[2, 2])
        size = 2 * float(np.abs(world[1:, :2]).max())
    if height > max(FLAT_MM, FLAT_SHARE * size):
        return height
    flat = world[:, :2]
    if not curve.degree:
        return _Chain(owner, (_ellipse(flat, *curve.knots.tolist()),), float(world[0, 2]))
    try:
        run = curves.make_bspline(flat, curve.knots, curve.degree, curve.weights)
    except ValueError:
        return None
    return _Chain(owner, (run,), float(world[0, 2]))


def _ellipse(flat: FloatArray, start: float, end: float) -> FloatArray | curves.Outline:
    """The arc of an ellipse given by center and half axes; of a circle if they are equal and square."""
    center, u, v = flat
    size = max(float(u @ u), float(v @ v))
    if abs(float(u @ u - v @ v)) > _SIMILAR * size or abs(float(u @ v)) > _SIMILAR * size:
        return curves.make_ellipse(center, u, v, start, end)
    count = max(1, math.ceil(abs(end - start) / math.pi - 1e-12))
    t = np.linspace(start, end, count + 1)
    bulges = np.full(
        count + 1,
        math.tan((end - start) / count / 4) * math.copysign(1.0, u[0] * v[1] - u[1] * v[0]),
    )
    return center + np.cos(t)[:, None] * u + np.sin(t)[:, None] * v, bulges


def _stitch(
    chains: list[_Chain], chord: float
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Owner and counts (P,), points and bulges of the chains, their runs fitted and put end to end."""
    fitted = iter(
        curves.fit([run for c in chains for run in c.runs if isinstance(run, np.ndarray)], chord)
    )
    points, bulges, counts = [np.zeros((0, 2))], [np.zeros(0)], []
    for chain in chains:
        runs = [next(fitted) if isinstance(run, np.ndarray) else run for run in chain.runs]
        p = (
            np.concatenate([*(run[0][:-1] for run in runs), runs[-1][0][-1:]])
            if runs
            else np.zeros((1, 2))
        )
        b = np.concatenate([*(run[1][:-1] for run in runs), [0.0]])
        points.append(p)
        bulges.append(b)
        counts.append(len(p))
    owner = np.array([c.owner for c in chains], dtype=np.intp)
    return owner, np.array(counts, dtype=np.intp), np.concatenate(points), np.concatenate(bulges)


# --- soup ------------------------------------------------------------------------------------------------------------


class _Named(Struct, frozen=True, eq=False):
    """What a soup says of its pieces, by owner number."""

    closed: BoolArray
    layer: IntArray
    kind: IntArray
    color: IntArray
    layers: tuple[str, ...]
    kinds: tuple[str, ...]
    colors: tuple[str, ...]


def _name(drawn: DrawnEntities) -> _Named:
    layers, kinds = sorted(set(drawn.layer)), sorted(set(drawn.kind))
    layer_index, kind_index = ({n: i for i, n in enumerate(names)} for names in (layers, kinds))
    return _Named(
        closed=np.array(drawn.closed, dtype=np.bool_),
        layer=np.array([layer_index[n] for n in drawn.layer], dtype=np.intp),
        kind=np.array([kind_index[n] for n in drawn.kind], dtype=np.intp),
        color=np.array(drawn.color, dtype=np.intp),
        layers=tuple(layers),
        kinds=tuple(kinds),
        colors=tuple(drawn.colors.names),
    )


def _soup(named: _Named, pieces: tuple[IntArray, IntArray, FloatArray, FloatArray]) -> Soup:
    """A soup of owner and counts (P,), points and bulges."""
    owner, counts, points, bulges = pieces
    return Soup(
        points=points,
        bulges=bulges,
        first=offsets(counts),
        closed=named.closed[owner],
        layer=named.layer[owner],
        kind=named.kind[owner],
        color=named.color[owner],
        layers=named.layers,
        kinds=named.kinds,
        colors=named.colors,
    )


def _together(a: Soup, b: Soup) -> Soup:
    """Both soups (of the same names) end to end."""
    return Soup(
        points=np.concatenate([a.points, b.points]),
        bulges=np.concatenate([a.bulges, b.bulges]),
        first=np.concatenate([a.first, b.first[1:] + a.first[-1]]),
        closed=np.concatenate([a.closed, b.closed]),
        layer=np.concatenate([a.layer, b.layer]),
        kind=np.concatenate([a.kind, b.kind]),
        color=np.concatenate([a.color, b.color]),
        layers=a.layers,
        kinds=a.kinds,
        colors=a.colors,
    )
