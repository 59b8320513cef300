"""STEP files (AP203, AP214, AP242) as solids: exact edges, and triangles for collision tests.

Needs the extra `step`.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence

import numpy as np
from msgspec.structs import replace

from camgen.geometry.arcs import Circle, find_circle, fit_circle, make_spans_through, measure_spans
from camgen.geometry.ragged import find_root
from camgen.geometry.vectors import cross, measure_angles
from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.model.part import FEATURE_ANGLE, Edge, EdgeKind, Note, Solid
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted
from camgen.read.solid import kernel, topology
from camgen.read.solid.edges import STEADY_COSINE, divide_arc, sort_edges
from camgen.read.solid.part21 import list_other_files
from camgen.read.solid.sharp import compute_normals
from camgen.read.solid.step_file import StepBodies, read_bodies, read_units
from camgen.read.units import note_doubtful_size

# Joining: CAD programs halve circles and cut lines. Edges that continue each other smoothly as the
# same line or circle become one.

#: mm: smallest distance below which ends of edges are one point.
_SAME_END_MM = 1e-4
#: Tangents and normals of edges that continue each other agree to this (cosine).
_SMOOTH_COSINE = float(np.cos(np.radians(1.0)))


def reverse_edge(edge: Edge) -> Edge:
    """The edge in the opposite direction, with left and right face swapped."""
    return replace(
        edge,
        points=frozen(edge.points[::-1]),
        via=frozen(edge.via[::-1]),
        normals=frozen(edge.normals[::-1, ::-1]),
        via_normals=frozen(edge.via_normals[::-1, ::-1]),
    )


def direct_edge(edge: Edge) -> Edge:
    """The edge from the end with the lower x, then y, then z.

    A closed edge leaves its start towards the lower of the two neighbouring span middles.
    """
    a, b = (edge.via[0], edge.via[-1]) if edge.closed else (edge.points[0], edge.points[-1])
    return edge if np.round(a, 6).tolist() <= np.round(b, 6).tolist() else reverse_edge(edge)


def join_smooth(edges: list[Edge], tolerance: float = _SAME_END_MM) -> list[Edge]:
    """The edges, with those joined to one that continue each other.

    tolerance: largest distance between two ends that meet, mm.
    """
    chains = dict(enumerate(edges))
    ends = {k: pair for k, pair in enumerate(_number_ends(edges, tolerance)) if not edges[k].closed}
    edges_at: dict[int, list[int]] = defaultdict(list)
    for k, places in ends.items():
        for place in places:
            edges_at[place].append(k)
    owner = list(range(len(edges)))
    for place, (first, *rest) in edges_at.items():
        if len(rest) != 1:
            continue
        a, b = find_root(owner, first), find_root(owner, rest[0])
        if a == b:
            if chains[a].kind == "arc" and _is_smooth(chains[a], chains[a]):
                chains[a] = replace(chains[a], kind="circle", closed=True)
            continue
        is_last, is_first = ends[a][1] == place, ends[b][0] == place
        before = chains[a] if is_last else reverse_edge(chains[a])
        after = chains[b] if is_first else reverse_edge(chains[b])
        joined = _join(before, after, tolerance)
        if joined is not None:
            chains.pop(b)
            chains[a], owner[b] = joined, a
            ends[a] = ends[a][not is_last], ends[b][is_first]
    return list(chains.values())


def _number_ends(edges: list[Edge], tolerance: float) -> list[tuple[int, int]]:
    """The numbers of the places where each edge starts and ends. Ends that meet have one number."""
    if not edges:
        return []
    points = np.array([(edge.points[0], edge.points[-1]) for edge in edges]).reshape(-1, 3)
    places = topology.label_components(len(points), *topology.find_close_pairs(points, tolerance))
    return list(zip(places[::2].tolist(), places[1::2].tolist(), strict=True))


def _join(a: Edge, b: Edge, tolerance: float) -> Edge | None:
    """Edge `a` followed by `b` as one edge, None if they do not continue each other."""
    if a.kind not in ("line", "arc") or a.kind != b.kind or a.convex != b.convex:
        return None
    if abs(a.radius - b.radius) > tolerance or not _is_smooth(a, b):
        return None
    if a.kind == "arc" and _measure_offset(a, b) > 2 * tolerance:
        return None
    share = a.length / (a.length + b.length)
    return replace(
        a,
        points=frozen(np.concatenate([a.points, b.points[1:]])),
        via=frozen(np.concatenate([a.via, b.via])),
        normals=frozen(np.concatenate([a.normals, b.normals[1:]])),
        via_normals=frozen(np.concatenate([a.via_normals, b.via_normals])),
        angle=share * a.angle + (1 - share) * b.angle,
        length=a.length + b.length,
    )


def _is_smooth(a: Edge, b: Edge) -> bool:
    """Whether `b` starts with the tangent and the two normals with which `a` ends."""
    if (np.einsum("si,si->s", a.normals[-1], b.normals[0]) < _SMOOTH_COSINE).any():
        return False
    backward = _compute_tangent(a.points[-1], a.via[-1], a.points[-2])
    forward = _compute_tangent(b.points[0], b.via[0], b.points[1])
    return float(backward @ forward) < -_SMOOTH_COSINE


def _compute_tangent(p: FloatArray, via: FloatArray, q: FloatArray) -> FloatArray:
    """(3,) unit vector in which the span from `p` over `via` to `q` leaves `p`."""
    return np.asarray(make_spans_through(p[None], via[None], q[None]).tangents()[0][0])


def _measure_offset(a: Edge, b: Edge) -> float:
    """The distance between the centres of two arcs, mm; infinite if one of them is straight."""
    first = find_circle(a.points[0], a.via[0], a.points[1])
    second = find_circle(b.points[0], b.via[0], b.points[1])
    if first is None or second is None:
        return np.inf
    return float(np.linalg.norm(first.center - second.center))


# Spans: lines and circles as they are. All other curves become arcs through three of their points.

#: Samples by which a spline is recognised as a line or a circle.
_SPLINE_SAMPLES = 33
#: Largest distance of these samples from the line or circle, as a fraction of the tolerance.
_EXACT_SHARE = 0.1
#: Intervals in each half of a span at whose ends it is compared with its arc.
_HALF_INTERVALS = 4
#: Largest number of times that a curve is halved. A cusp ends in an interval far below any
#: tolerance.
_MAX_HALVINGS = 20


def make_edge(
    curve: kernel.Curve,
    left: kernel.FaceAlongEdge,
    right: kernel.FaceAlongEdge,
    convex: bool,
    tolerance: float,
) -> Edge:
    """The edge along a curve, without id.

    left, right: faces on both sides in the direction of growing parameters, seen from outside.
    tolerance: largest distance of the spans from the curve, mm.
    """
    at = np.linspace(curve.low, curve.high, _SPLINE_SAMPLES)
    points = curve.points(at)
    kind, circle = _recognise(curve, points, tolerance)
    if kind == "line":
        ends = _divide_line(at, left, right)
        places = curve.points(ends)
        middles, via = (ends[1:] + ends[:-1]) / 2, (places[1:] + places[:-1]) / 2
    elif circle is not None:
        angles, wanted, on_circle = divide_arc(circle, points)
        parameters = np.interp(wanted, angles, at)
        ends, places = parameters[::2], on_circle[::2]
        middles, via = parameters[1::2], on_circle[1::2]
    else:
        ends = np.array(_divide_curve(curve, curve.low, curve.high, tolerance, _MAX_HALVINGS))
        places, middles = curve.points(ends), (ends[1:] + ends[:-1]) / 2
        via = _find_arc_middles(places, curve.points(middles))
    normals = np.stack([left.normals(ends), right.normals(ends)], axis=1)
    via_normals = np.stack([left.normals(middles), right.normals(middles)], axis=1)
    closed = bool(np.linalg.norm(places[0] - places[-1]) < 1e-6)
    if closed:
        places[-1] = places[0]
    return Edge(
        "",
        "circle" if closed and kind == "arc" else kind,
        frozen(places),
        frozen(via),
        frozen(normals),
        frozen(via_normals),
        float(measure_angles(via_normals[:, 0], via_normals[:, 1]).mean()),
        convex,
        closed,
        circle.radius if circle else 0.0,
        float(measure_spans(places, via).sum()),
    )


def _recognise(
    curve: kernel.Curve, points: FloatArray, tolerance: float
) -> tuple[EdgeKind, Circle | None]:
    """The kind of a curve, and the circle of an arc.

    A curve of another type counts as a line or an arc if its `points` are on one in even order.
    """
    if curve.kind == "Line":
        return "line", None
    if curve.kind == "Circle":
        center, axis, radius = curve.circle()
        first = points[0] - center
        return "arc", Circle(center, axis, first / np.linalg.norm(first), radius)
    limit = _EXACT_SHARE * tolerance
    chord = points[-1] - points[0]
    length = float(np.linalg.norm(chord))
    if length > 0:
        along = (points - points[0]) @ (chord / length)
        rest = points - points[0] - along[:, None] * (chord / length)
        if np.linalg.norm(rest, axis=1).max() <= limit and (np.diff(along) > 0).all():
            return "line", None
    circle = fit_circle(points[:-1] if length <= limit else points)
    if circle is None or circle.distances(points).max(initial=0.0) > limit:
        return "curve", None
    return ("arc", circle) if (np.diff(circle.angles(points[:-1])) > 0).all() else ("curve", None)


def _divide_line(
    at: FloatArray, left: kernel.FaceAlongEdge, right: kernel.FaceAlongEdge
) -> FloatArray:
    """Parameters of the ends of the spans of a line: one span, or four if the normals turn.

    at: parameters of samples along the line.
    """
    at = at[:: (_SPLINE_SAMPLES - 1) // 4]
    normals = np.stack([left.normals(at), right.normals(at)])
    is_steady = (np.einsum("ski,sli->skl", normals, normals) > STEADY_COSINE).all()
    return at[[0, -1]] if is_steady else at


def _divide_curve(
    curve: kernel.Curve, low: float, high: float, tolerance: float, halvings: int
) -> list[float]:
    """Parameters from `low` to `high` between which arcs fit the curve within the tolerance.

    halvings: number of times that the range may still be halved.
    """
    points = curve.points(np.linspace(low, high, 2 * _HALF_INTERVALS + 1))
    if halvings == 0 or _fits_arc(points, tolerance):
        return [low, high]
    middle = (low + high) / 2
    lower = _divide_curve(curve, low, middle, tolerance, halvings - 1)
    return [*lower[:-1], *_divide_curve(curve, middle, high, tolerance, halvings - 1)]


def _fits_arc(points: FloatArray, tolerance: float) -> bool:
    """Whether samples of a span are near the arc through its ends and its middle sample.

    An arc may turn by at most a quarter circle. Three points on a line make a line.
    """
    circle = find_circle(points[0], points[_HALF_INTERVALS], points[-1])
    if circle is None:
        chord = points[-1] - points[0]
        length = float(np.linalg.norm(chord))
        areas = np.linalg.norm(cross(points - points[0], chord), axis=1)
        return length > 0 and bool((areas <= tolerance * length).all())
    angles = circle.angles(points)
    is_even = bool((np.diff(angles) > 0).all() and angles[-1] < np.pi / 2)
    return is_even and bool(circle.distances(points).max() <= tolerance)


def _find_arc_middles(ends: FloatArray, middles: FloatArray) -> FloatArray:
    """(N - 1, 3) middles of the arcs between neighbouring `ends` (N, 3).

    middles: (N - 1, 3) a point of each arc.
    """
    via = (ends[1:] + ends[:-1]) / 2
    for k, middle in enumerate(middles):
        circle = find_circle(ends[k], middle, ends[k + 1])
        if circle is not None:
            via[k] = circle.at(circle.angles(ends[k + 1][None]) / 2)[0]
    return via


#: Largest distance of the triangles from the part, as a fraction of its diagonal.
_DEFLECTION = 2e-4
#: mm: lower and upper limit of this distance.
_FINEST_MM, _COARSEST_MM = 0.005, 0.2
#: rad: largest angle between neighbouring triangles along a curve.
_TRIANGLE_ANGLE = 0.35


def read(source: Source, tolerance: float = 0.01, feature_angle: float = FEATURE_ANGLE) -> Solid:
    """The solid in a STEP file.

    tolerance: largest distance of arcs and lines from the ellipses and splines that they replace,
        mm.
    feature_angle: angle between face normals above which an edge is sharp, rad.

    Raises InputError for a file without a shape, and if the extra is not installed.
    """
    units, notes = read_units(source)
    loaded = read_bodies(source)
    shape, wires = loaded.shape, loaded.curves
    others = list_other_files(source.data)
    if shape is None:
        raise _make_error(source.name, others, wires)
    notes += loaded.notes
    try:
        edges, borders = _find_edges(loaded, tolerance, feature_angle, notes)
        deflection = float(
            np.clip(_DEFLECTION * kernel.measure_diagonal(shape), _FINEST_MM, _COARSEST_MM)
        )
        vertices, faces = topology.merge_equal_vertices(
            *kernel.triangulate(shape, deflection, _TRIANGLE_ANGLE)
        )
    except kernel.list_errors() as error:
        raise InputError(
            source.name,
            "the CAD kernel fails on its faces",
            "",
            "export it again from the CAD program",
        ) from error
    faces, _ = topology.weld_rims(vertices, topology.drop_degenerate(faces))
    faces = topology.drop_duplicates(topology.drop_degenerate(faces))
    if not len(faces):
        raise _make_error(source.name, others, wires)
    if wires:
        what = counted(wires, "curve beside the faces", "curves beside the faces")
        notes.append(Note("skipped", what, "no edges"))
    if others:
        notes.append(
            Note("skipped", f"what is in other files: {', '.join(others)}", "build them one by one")
        )
    vertices, faces = topology.drop_unused(vertices, faces)
    normals, _ = compute_normals(vertices, faces, topology.pair_half_edges(faces))
    faces.flags.writeable = False
    notes += note_doubtful_size(np.ptp(vertices, axis=0).tolist(), units, source.name)
    return Solid(
        source.stem,
        source.name,
        units,
        frozen(vertices),
        faces,
        frozen(normals),
        edges,
        borders,
        tuple(notes),
        loaded.names,
    )


def _make_error(name: str, others: Sequence[str], curves: int) -> InputError:
    """The error for a file without faces.

    others: names of other files that contain the parts, according to the text.
    curves: number of curves in the file.
    """
    if others:
        them = "in another file" if len(others) == 1 else "in other files"
        return InputError(
            name,
            f"holds no shape: its parts are {them}",
            ", ".join(others),
            "build these, or export the assembly as one file",
        )
    what, where = "holds no shape", "neither faces nor curves"
    if curves:
        what = f"is a wireframe: {counted(curves, 'curve')} and no faces"
        where = "the edge of a solid lies between two faces"
    return InputError(name, what, where, "export the part as a solid")


def _find_edges(
    loaded: StepBodies, tolerance: float, feature_angle: float, notes: list[Note]
) -> tuple[tuple[Edge, ...], tuple[FloatArray, ...]]:
    """The sharp edges with ids, and the lines (N, 3) along which the surface ends, mm."""
    sharp: list[Edge] = []
    borders: list[FloatArray] = []
    left_out: Counter[str] = Counter()
    for edge_uses in kernel.list_edges(loaded.shape):
        reason = _find_reason(edge_uses)
        if reason == "border":
            curve = kernel.Curve(edge_uses.edge)
            count = 2 if curve.kind == "Line" else _SPLINE_SAMPLES
            borders.append(frozen(curve.points(np.linspace(curve.low, curve.high, count))))
        elif reason:
            left_out[reason] += 1
        else:
            edge = _make_sharp_edge(edge_uses, tolerance, feature_angle)
            if edge is None:
                left_out["smooth"] += 1
            else:
                sharp.append(edge)
    distance = max(_SAME_END_MM, 2 * kernel.measure_tolerance(loaded.shape))
    edges = sort_edges(map(direct_edge, join_smooth(sharp, distance)))
    notes += _note_edges(left_out, sharp, len(edges), feature_angle)
    if borders:
        notes.append(
            Note(
                "warning",
                f"{counted(len(borders), 'edge has', 'edges have')} a face on one side only",
                f"borders, not edges; faces {loaded.tolerance:.4g} mm apart are sewn",
            )
        )
    return edges, tuple(borders)


def _find_reason(edge_uses: kernel.EdgeUses) -> str:
    """Why an edge of the file does not lie between two faces, "" if it does."""
    uses = edge_uses.uses
    if kernel.is_degenerate(edge_uses.edge):
        return "degenerate"
    if len(uses) == 2 and uses[0][1].IsSame(uses[1][1]):
        return "seam"
    if len(uses) == 1:
        return "border"
    if len(uses) > 2:
        return "crowded"
    return "" if kernel.is_forward(uses[0][0]) != kernel.is_forward(uses[1][0]) else "turned"


def _make_sharp_edge(
    edge_uses: kernel.EdgeUses, tolerance: float, feature_angle: float
) -> Edge | None:
    """The edge if its faces meet at more than `feature_angle` in the middle of it, else None.

    A face lies on the left of its edges as they run in it, seen from outside. An edge is convex as
    in `sharp.find_sharp_sides`.
    """
    (edge_a, face_a), (edge_b, face_b) = edge_uses.uses
    left, right = kernel.FaceAlongEdge(edge_a, face_a), kernel.FaceAlongEdge(edge_b, face_b)
    if not kernel.is_forward(edge_a):
        left, right = right, left
    curve = kernel.Curve(edge_uses.edge)
    middle = np.array([(curve.low + curve.high) / 2])
    a, b = left.normals(middle)[0], right.normals(middle)[0]
    turn = cross(a, b)
    if float(np.arctan2(np.linalg.norm(turn), a @ b)) <= feature_angle:
        return None
    convex = bool(turn @ curve.tangent(float(middle[0])) > 0)
    return make_edge(curve, left, right, convex, tolerance)


def _note_edges(
    left_out: Counter[str], sharp: Sequence[Edge], joined: int, feature_angle: float
) -> Iterator[Note]:
    """Notes on the edges of the file.

    left_out: number of edges that were left out, by reason.
    sharp: edges between two faces.
    joined: number of edges after joining.
    """
    convex = sum(edge.convex for edge in sharp)
    below = f"{left_out['smooth']} below {np.degrees(feature_angle):.4g} deg"
    others = f"{counted(left_out['seam'], 'seam')} and {counted(left_out['degenerate'], 'point')}"
    what = f"{convex} convex and {len(sharp) - convex} concave edges of the file are {joined}"
    why = f"where one continues another on the same line or circle; {below}, {others} left out"
    yield Note("joined", what, why)
    reasons = {"crowded": "more than two faces meet", "turned": "inside and outside disagree"}
    for kind, reason in reasons.items():
        if left_out[kind]:
            edges = counted(left_out[kind], "edge was", "edges were")
            yield Note("skipped", f"{edges} left out", f"{reason} there")
