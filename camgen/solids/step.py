"""STEP files (AP203, AP214, AP242) as solids: exact edges, and triangles for collision. Needs the extra ``step``."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from camgen.content import readable
from camgen.errors import InputError, one_line
from camgen.pose import FloatArray, frozen
from camgen.shapes import Note
from camgen.solid import FEATURE_ANGLE, Edge, Solid
from camgen.solids import kernel, welding
from camgen.solids.circles import cross
from camgen.solids.edges import ordered
from camgen.solids.joining import directed, joined
from camgen.solids.pairs import paired
from camgen.solids.sharp import face_normals
from camgen.solids.step_edges import edge

SUFFIXES = (".step", ".stp")

#: Triangles leave the part by at most this part of its size, within these bounds (mm), and turn by this (rad).
_DEFLECTION, _FINEST, _COARSEST, _ANGLE = 2e-4, 0.005, 0.2, 0.35
_CONTEXT = re.compile(rb"GLOBAL_UNIT_ASSIGNED_CONTEXT\s*\(\s*\(([^)]*)\)")
_INSTANCE = re.compile(rb"#(\d+)\s*=\s*\((?=[^;]*\bLENGTH_UNIT\b)([^;]*);")
_CONVERTED = re.compile(rb"CONVERSION_BASED_UNIT\s*\(\s*'([^']*)'")
_SI = re.compile(rb"SI_UNIT\s*\(\s*(\$|\.\w+\.)\s*,\s*\.METRE\.")
_PREFIX = {b"$": "m", b".MILLI.": "mm", b".CENTI.": "cm", b".DECI.": "dm", b".MICRO.": "um", b".KILO.": "km"}


def read(path: Path, tolerance: float = 0.01, feature_angle: float = FEATURE_ANGLE) -> Solid:
    """The solid in the STEP file ``path``. ``InputError`` if there is none, or the extra is not installed.

    tolerance: mm, what arcs and lines may leave the ellipses and splines they stand for. feature_angle: rad, sharp
    edges are those above it.
    """
    units, notes = _units(path)
    shape = kernel.load(path)
    failure = kernel.part("Standard").Standard_Failure
    try:
        edges, borders = _edges(shape, tolerance, feature_angle, notes)
        deflection = float(np.clip(_DEFLECTION * kernel.size(shape), _FINEST, _COARSEST))
        vertices, faces = welding.merged(*kernel.triangles(shape, deflection, _ANGLE))
    except (failure, *kernel.STUMBLES) as error:
        again = "export it again from the CAD program"
        raise InputError(path.name, "the CAD kernel stumbles over its faces", "", again) from error
    faces, _ = welding.welded(vertices, welding.without_degenerate(faces))
    faces = welding.without_duplicates(welding.without_degenerate(faces))
    if not len(faces):
        raise InputError(path.name, "has no faces", "curves or points only", "export the part as a solid")
    vertices, faces = welding.used(vertices, faces)
    normals, _ = face_normals(vertices, faces, paired(faces))
    faces.flags.writeable = False
    return Solid(path.stem, path.name, units, frozen(vertices), faces, frozen(normals), edges, borders, tuple(notes))


def _units(path: Path) -> tuple[str, list[Note]]:
    """The units of length that the shapes of the file are in. The kernel converts them; this is for the user."""
    data = readable(path)
    if not data[:4096].lstrip().startswith(b"ISO-10303-21"):
        raise InputError(path.name, "is no STEP file", "it does not begin with ISO-10303-21")
    lengths = dict(_INSTANCE.findall(data))
    used = {ref.strip(b" \t\r\n#") for refs in _CONTEXT.findall(data) for ref in refs.split(b",")}
    names = sorted({_unit(lengths[ref]) for ref in used if ref in lengths})
    if not names:
        return "mm", [Note("assumed", "1 unit of the file = 1 mm", "the file states no unit of length")]
    return ", ".join(names), []


def _unit(text: bytes) -> str:
    converted, si = _CONVERTED.search(text), _SI.search(text)
    if converted:
        return one_line(converted[1].decode("ascii", "replace")).lower().replace("metre", "m")
    return _PREFIX.get(si[1], "unknown") if si else "unknown"


def _edges(
    shape: Any, tolerance: float, feature_angle: float, notes: list[Note]
) -> tuple[tuple[Edge, ...], tuple[FloatArray, ...]]:
    """Sharp edges with ids, and where faces end."""
    found: list[Edge] = []
    borders: list[FloatArray] = []
    left_out: Counter[str] = Counter()
    for meeting in kernel.meetings(shape):
        what = _kind(meeting)
        if what == "border":
            curve = kernel.Curve(meeting.edge)
            borders.append(frozen(curve.points(np.linspace(curve.low, curve.high, 2 if curve.kind == "Line" else 33))))
        elif what:
            left_out[what] += 1
        else:
            sharp = _sharp(meeting, tolerance, feature_angle)
            left_out["smooth"] += sharp is None
            found += [sharp] if sharp is not None else []
    edges = ordered(directed(e) for e in joined(found))
    _say(notes, left_out, found, len(edges), feature_angle)
    if borders:
        notes.append(Note("warning", f"{len(borders)} edges have a face on one side only", "borders, not edges"))
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
    return "" if kernel.forward(meeting.uses[0][0]) != kernel.forward(meeting.uses[1][0]) else "turned"


def _sharp(meeting: kernel.Meeting, tolerance: float, feature_angle: float) -> Edge | None:
    """The edge if its faces meet at more than ``feature_angle`` in the middle of it.

    A face lies on the left of its edges as they run in it, seen from outside. Convex: see ``sharp.segments``.
    """
    (edge_a, face_a), (edge_b, face_b) = meeting.uses
    left, right = kernel.Beside(edge_a, face_a), kernel.Beside(edge_b, face_b)
    if not kernel.forward(edge_a):
        left, right = right, left
    curve = kernel.Curve(meeting.edge)
    middle = np.array([(curve.low + curve.high) / 2])
    a, b = left.normals(middle)[0], right.normals(middle)[0]
    turn = cross(a, b)
    if float(np.arctan2(np.linalg.norm(turn), a @ b)) <= feature_angle:
        return None
    return edge(curve, left, right, bool(turn @ curve.tangent(float(middle[0])) > 0), tolerance)


def _say(notes: list[Note], left_out: Counter[str], found: list[Edge], whole: int, feature_angle: float) -> None:
    """What became of the edges of the file, in numbers."""
    convex = sum(e.convex for e in found)
    below = f"{left_out['smooth']} below {np.degrees(feature_angle):.3g} deg"
    others = f"{left_out['seam']} seams and {left_out['degenerate']} points"
    what = f"{convex} convex and {len(found) - convex} concave edges of the file are {whole}"
    notes.append(Note("joined", what, f"where one goes on as the same line or circle; {below}, {others} left out"))
    for kind, why in (("crowded", "more than two faces meet"), ("turned", "inside and outside disagree")):
        if left_out[kind]:
            notes.append(Note("skipped", f"{left_out[kind]} edges were left out", f"{why} there"))
