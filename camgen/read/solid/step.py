"""STEP files (AP203, AP214, AP242) as solids: exact edges, and triangles for collision. Needs the extra ``step``."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence

import numpy as np
from msgspec.structs import replace

from camgen.geometry.arcs import Circle, find_circle, fit_circle, make_spans_through, measure_spans
from camgen.geometry.vectors import angles, cross
from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.model.part import FEATURE_ANGLE, Edge, EdgeKind, Note, Solid
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted
from camgen.read.solid import kernel
from camgen.read.solid import topology as welding
from camgen.read.solid.edges import STEADY_COSINE, order
from camgen.read.solid.kernel import Curve, FacesBeside
from camgen.read.solid.part21 import list_other_files
from camgen.read.solid.sharp import face_normals
from camgen.read.solid.step_file import StepBodies, load
from camgen.read.solid.step_units import read_units
from camgen.read.solid.topology import pair
from camgen.read.units import doubts

# Edges that go on smoothly as the same line or circle become one: CAD programs halve circles and cut lines.

#: Ends are one place if they agree to this (mm).
_MEET = 1e-4
#: Tangents and normals agree to this (cosine).
_SMOOTH_COSINE = float(np.cos(np.radians(1.0)))


def backwards(edge: Edge) -> Edge:
    """The same edge run the other way: what was on the left is on the right."""
    return replace(
        edge, points=frozen(edge.points[::-1]), via=frozen(edge.via[::-1]),
        normals=frozen(edge.normals[::-1, ::-1]), via_normals=frozen(edge.via_normals[::-1, ::-1]),
    )  # fmt: skip


def direct(edge: Edge) -> Edge:
    """The edge from the end with the smaller x, then y, then z; a closed one sets out towards the smaller."""
    a, b = (edge.via[0], edge.via[-1]) if edge.closed else (edge.points[0], edge.points[-1])
    return edge if np.round(a, 6).tolist() <= np.round(b, 6).tolist() else backwards(edge)


def join_smooth(edges: list[Edge], meet: float = _MEET) -> list[Edge]:
    """The edges, those that continue each other joined into one.

    meet: ends are one place if they are so near, mm.
    """
    chains = dict(enumerate(edges))
    ends = {k: pair for k, pair in enumerate(_number_ends(edges, meet)) if not edges[k].closed}
    at: dict[int, list[int]] = defaultdict(list)
    for k, places in ends.items():
        for place in places:
            at[place].append(k)
    owner = {k: k for k in chains}
    for place, (first, *rest) in at.items():
        if len(rest) != 1:
            continue
        a, b = _owner(owner, first), _owner(owner, rest[0])
        if a == b:
            chains[a] = _close_circle(chains[a])
            continue
        is_last, is_first = ends[a][1] == place, ends[b][0] == place
        before = chains[a] if is_last else backwards(chains[a])
        after = chains[b] if is_first else backwards(chains[b])
        joined = _join(before, after, meet)
        if joined is not None:
            chains.pop(b)
            chains[a], owner[b] = joined, a
            ends[a] = ends[a][not is_last], ends[b][is_first]
    return list(chains.values())


def _number_ends(edges: list[Edge], meet: float) -> list[tuple[int, int]]:
    """The numbers of the places where each edge begins and ends."""
    if not edges:
        return []
    points = np.array([(edge.points[0], edge.points[-1]) for edge in edges]).reshape(-1, 3)
    places = welding.components(len(points), *welding.find_close(points, meet))
    return [(int(first), int(last)) for first, last in places.reshape(-1, 2)]


def _owner(owner: dict[int, int], k: int) -> int:
    while owner[k] != k:
        k = owner[k]
    return k


def _close_circle(edge: Edge) -> Edge:
    """An arc whose ends meet smoothly as a circle; other edges unchanged."""
    if edge.kind != "arc" or not _smooth(edge, edge):
        return edge
    return replace(edge, kind="circle", closed=True)


def _join(a: Edge, b: Edge, meet: float) -> Edge | None:
    """Two edges as one where the first ends and the second begins, None if they stay two."""
    if a.kind not in ("line", "arc") or a.kind != b.kind or a.convex != b.convex:
        return None
    if abs(a.radius - b.radius) > meet or not _smooth(a, b):
        return None
    if a.kind == "arc" and _apart(a, b) > 2 * meet:
        return None
    columns = {
        n: frozen(np.concatenate([getattr(a, n), getattr(b, n)])) for n in ("via", "via_normals")
    }
    columns |= {
        n: frozen(np.concatenate([getattr(a, n), getattr(b, n)[1:]])) for n in ("points", "normals")
    }
    share = a.length / (a.length + b.length)
    angle = share * a.angle + (1 - share) * b.angle
    return replace(a, **columns, angle=angle, length=a.length + b.length)


def _smooth(a: Edge, b: Edge) -> bool:
    """Whether b goes on where a ends with the same tangent and the same two normals."""
    if (np.einsum("si,si->s", a.normals[-1], b.normals[0]) < _SMOOTH_COSINE).any():
        return False
    return (
        float(
            _tangent(a.points[-1], a.via[-1], a.points[-2])
            @ _tangent(b.points[0], b.via[0], b.points[1])
        )
        < -_SMOOTH_COSINE
    )


def _tangent(p: FloatArray, via: FloatArray, q: FloatArray) -> FloatArray:
    """(3,) unit, the way in which the span from ``p`` over ``via`` to ``q`` leaves p."""
    return np.asarray(make_spans_through(p[None], via[None], q[None]).tangents()[0][0])


def _apart(a: Edge, b: Edge) -> float:
    """How far the centres of two arcs are apart, mm."""
    first, second = (
        find_circle(a.points[0], a.via[0], a.points[1]),
        find_circle(b.points[0], b.via[0], b.points[1]),
    )
    if first is None or second is None:
        return np.inf
    return float(np.linalg.norm(first.center - second.center))


# Edges of exact CAD as spans: lines and circles as they are, all else as arcs through three of its points.

#: Samples that tell a line or a circle that is written as a spline.
_SPLINE_SAMPLES = 33
#: How near a spline must be to a line or a circle to be one, as a part of the tolerance.
_EXACT_SHARE = 0.1
#: Samples within each half of a span that is compared with its arc.
_WITHIN = 4
#: Divisions at most: a cusp ends in an interval far below any tolerance.
_MOST_DIVISIONS = 20


def edge(
    curve: Curve, left: FacesBeside, right: FacesBeside, convex: bool, tolerance: float
) -> Edge:
    """The edge along ``curve``, without id; ``left`` and ``right`` of growing parameters, seen from outside."""
    at = np.linspace(curve.low, curve.high, _SPLINE_SAMPLES)
    points = curve.points(at)
    kind, circle = _is_line_or_arc(curve, points, tolerance)
    if kind == "line":
        ends = _line_parameters(at, left, right)
        places = curve.points(ends)
        middles, via = (ends[1:] + ends[:-1]) / 2, (places[1:] + places[:-1]) / 2
    elif circle is not None:
        ends, middles, places, via = _round(circle, at, points)
    else:
        ends = np.array(_divide(curve, curve.low, curve.high, tolerance, _MOST_DIVISIONS))
        places, middles = curve.points(ends), (ends[1:] + ends[:-1]) / 2
        via = _arc_middles(places, curve.points(middles))
    normals, via_normals = (
        np.stack([left.normals(t), right.normals(t)], axis=1) for t in (ends, middles)
    )
    closed = bool(np.linalg.norm(places[0] - places[-1]) < 1e-6)
    if closed:
        places[-1] = places[0]
    return Edge(
        "", "circle" if closed and kind == "arc" else kind, frozen(places), frozen(via), frozen(normals),
        frozen(via_normals), _mean_angle(via_normals), convex, closed, circle.radius if circle else 0.0,
        float(measure_spans(places, via).sum()),
    )  # fmt: skip


def _is_line_or_arc(
    curve: Curve, points: FloatArray, tolerance: float
) -> tuple[EdgeKind, Circle | None]:
    """Whether the curve is a line or an arc, by its kind or, within a part of ``tolerance``, by its points."""
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
        aside = np.linalg.norm(points - points[0] - along[:, None] * (chord / length), axis=1)
        if aside.max() <= limit and (np.diff(along) > 0).all():
            return "line", None
    circle = fit_circle(points[:-1] if length <= limit else points)
    if circle is None or circle.distances(points).max(initial=0.0) > limit:
        return "curve", None
    return ("arc", circle) if (np.diff(circle.angles(points[:-1])) > 0).all() else ("curve", None)


def _line_parameters(at: FloatArray, left: FacesBeside, right: FacesBeside) -> FloatArray:
    """Where a line is divided: at its ends, and on the way if the normals turn."""
    at = at[:: (_SPLINE_SAMPLES - 1) // 4]
    normals = np.stack([left.normals(at), right.normals(at)])
    steady = (np.einsum("ski,sli->skl", normals, normals) > STEADY_COSINE).all()
    return at[[0, -1]] if steady else at


def _round(
    circle: Circle, at: FloatArray, points: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Parameters of the ends and the middles of spans of at most half circles, and their places."""
    angles = circle.angles(points)
    angles[0], angles[-1] = 0.0, angles[-1] if angles[-1] > 1e-6 else 2 * np.pi
    count = max(1, int(np.ceil(angles[-1] / np.pi - 1e-6)))
    wanted = np.linspace(0.0, angles[-1], 2 * count + 1)
    parameters, places = np.interp(wanted, angles, at), circle.at(wanted)
    places[0], places[-1] = points[0], points[-1]
    return parameters[::2], parameters[1::2], places[::2], places[1::2]


def _divide(curve: Curve, low: float, high: float, tolerance: float, depth: int) -> list[float]:
    """Parameters from ``low`` to ``high`` between which the curve keeps to the arc through ends and middle."""
    points = curve.points(np.linspace(low, high, 2 * _WITHIN + 1))
    if depth == 0 or _fits(points, tolerance):
        return [low, high]
    middle = (low + high) / 2
    return [
        *_divide(curve, low, middle, tolerance, depth - 1)[:-1],
        *_divide(curve, middle, high, tolerance, depth - 1),
    ]


def _fits(points: FloatArray, tolerance: float) -> bool:
    circle = find_circle(points[0], points[_WITHIN], points[-1])
    if circle is None:
        chord = points[-1] - points[0]
        length = float(np.linalg.norm(chord))
        return length > 0 and bool(
            (np.linalg.norm(cross(points - points[0], chord), axis=1) <= tolerance * length).all()
        )
    angles = circle.angles(points)
    even = bool((np.diff(angles) > 0).all() and angles[-1] < np.pi / 2)
    return even and bool(np.abs(circle.distances(points)).max() <= tolerance)


def _arc_middles(places: FloatArray, middles: FloatArray) -> FloatArray:
    """The middles of the arcs from one of ``places`` (N, 3) to the next through ``middles`` (N - 1, 3)."""
    via = (places[1:] + places[:-1]) / 2
    for k, middle in enumerate(middles):
        circle = find_circle(places[k], middle, places[k + 1])
        if circle is not None:
            via[k] = circle.at(circle.angles(places[k + 1][None]) / 2)[0]
    return via


def _mean_angle(normals: FloatArray) -> float:
    """The angle between the two normals (N, 2, 3), rad, on the average."""
    return float(angles(normals[:, 0], normals[:, 1]).mean())


#: Triangles leave the part by at most this part of its size, within these bounds (mm), and turn by this (rad).
_DEFLECTION, _FINEST, _COARSEST, _ANGLE = 2e-4, 0.005, 0.2, 0.35


def read(source: Source, tolerance: float = 0.01, feature_angle: float = FEATURE_ANGLE) -> Solid:
    """The solid in a STEP file. ``InputError`` if there is none, or the extra is not installed.

    tolerance: mm, what arcs and lines may leave the ellipses and splines they stand for. feature_angle: rad, sharp
    edges are those above it.
    """
    units, notes = read_units(source)
    loaded = load(source)
    shape, wires = loaded.shape, loaded.curves
    others = list_other_files(source.data)
    if shape is None:
        raise _no_faces(source.name, others, wires)
    notes += loaded.notes
    failure = kernel.part("Standard").Standard_Failure
    try:
        edges, borders = _edges(loaded, tolerance, feature_angle, notes)
        deflection = float(np.clip(_DEFLECTION * kernel.size(shape), _FINEST, _COARSEST))
        vertices, faces = welding.merge(*kernel.triangles(shape, deflection, _ANGLE))
    except (failure, *kernel.STUMBLES) as error:
        again = "export it again from the CAD program"
        raise InputError(
            source.name, "the CAD kernel stumbles over its faces", "", again
        ) from error
    faces, _ = welding.weld(vertices, welding.without_degenerate(faces))
    faces = welding.without_duplicates(welding.without_degenerate(faces))
    if not len(faces):
        raise _no_faces(source.name, others, wires)
    if wires:
        notes.append(
            Note(
                "skipped",
                counted(wires, "curve beside the faces", "curves beside the faces"),
                "no edges",
            )
        )
    if others:
        notes.append(
            Note("skipped", f"what is in other files: {', '.join(others)}", "build them one by one")
        )
    vertices, faces = welding.drop_unused(vertices, faces)
    normals, _ = face_normals(vertices, faces, pair(faces))
    faces.flags.writeable = False
    notes += doubts(np.ptp(vertices, axis=0).tolist(), units, source.name)
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


def _no_faces(name: str, others: Sequence[str], curves: int) -> InputError:
    """Why there is nothing to work on. others: files that the text names. curves: of the shape."""
    if others:
        them = "in another file" if len(others) == 1 else "in other files"
        remedy = "build these, or export the assembly as one file"
        return InputError(name, f"holds no shape: its parts are {them}", ", ".join(others), remedy)
    if curves:
        what = f"is a wireframe: {counted(curves, 'curve')} and no faces"
        return InputError(
            name, what, "the edge of a solid lies between two faces", "export the part as a solid"
        )
    return InputError(
        name, "holds no shape", "neither faces nor curves", "export the part as a solid"
    )


def _edges(
    loaded: StepBodies, tolerance: float, feature_angle: float, notes: list[Note]
) -> tuple[tuple[Edge, ...], tuple[FloatArray, ...]]:
    """Sharp edges with ids, and where faces end."""
    found: list[Edge] = []
    borders: list[FloatArray] = []
    left_out: Counter[str] = Counter()
    for meeting in kernel.meetings(loaded.shape):
        what = _kind(meeting)
        if what == "border":
            curve = kernel.Curve(meeting.edge)
            borders.append(
                frozen(
                    curve.points(
                        np.linspace(curve.low, curve.high, 2 if curve.kind == "Line" else 33)
                    )
                )
            )
        elif what:
            left_out[what] += 1
        else:
            sharp = _sharp(meeting, tolerance, feature_angle)
            left_out["smooth"] += sharp is None
            found += [sharp] if sharp is not None else []
    meet = max(_MEET, 2 * kernel.measure_tolerance(loaded.shape))
    edges = order(direct(e) for e in join_smooth(found, meet))
    _say(notes, left_out, found, len(edges), feature_angle)
    if borders:
        what = f"{counted(len(borders), 'edge has', 'edges have')} a face on one side only"
        notes.append(
            Note(
                "warning",
                what,
                f"borders, not edges; faces {loaded.tolerance:.4g} mm apart are sewn",
            )
        )
    return edges, tuple(borders)


def _kind(meeting: kernel.Meeting) -> str:
    """Why an edge is none between two faces, "" if it is."""
    if kernel.degenerate(meeting.edge):
        return "degenerate"
    if len(meeting.uses) == 2 and meeting.uses[0][1].IsSame(meeting.uses[1][1]):
        return "seam"
    if len(meeting.uses) == 1:
        return "border"
    if len(meeting.uses) > 2:
        return "crowded"
    return (
        "" if kernel.forward(meeting.uses[0][0]) != kernel.forward(meeting.uses[1][0]) else "turned"
    )


def _sharp(meeting: kernel.Meeting, tolerance: float, feature_angle: float) -> Edge | None:
    """The edge if its faces meet at more than ``feature_angle`` in the middle of it.

    A face lies on the left of its edges as they run in it, seen from outside. Convex: see ``sharp.segments``.
    """
    (edge_a, face_a), (edge_b, face_b) = meeting.uses
    left, right = kernel.FacesBeside(edge_a, face_a), kernel.FacesBeside(edge_b, face_b)
    if not kernel.forward(edge_a):
        left, right = right, left
    curve = kernel.Curve(meeting.edge)
    middle = np.array([(curve.low + curve.high) / 2])
    a, b = left.normals(middle)[0], right.normals(middle)[0]
    turn = cross(a, b)
    if float(np.arctan2(np.linalg.norm(turn), a @ b)) <= feature_angle:
        return None
    return edge(curve, left, right, bool(turn @ curve.tangent(float(middle[0])) > 0), tolerance)


def _say(
    notes: list[Note], left_out: Counter[str], found: list[Edge], whole: int, feature_angle: float
) -> None:
    """What became of the edges of the file, in numbers."""
    convex = sum(e.convex for e in found)
    below = f"{left_out['smooth']} below {np.degrees(feature_angle):.4g} deg"
    others = f"{counted(left_out['seam'], 'seam')} and {counted(left_out['degenerate'], 'point')}"
    what = f"{convex} convex and {len(found) - convex} concave edges of the file are {whole}"
    notes.append(
        Note(
            "joined",
            what,
            f"where one goes on as the same line or circle; {below}, {others} left out",
        )
    )
    for kind, why in (
        ("crowded", "more than two faces meet"),
        ("turned", "inside and outside disagree"),
    ):
        if left_out[kind]:
            what = f"{counted(left_out[kind], 'edge was', 'edges were')} left out"
            notes.append(Note("skipped", what, f"{why} there"))
