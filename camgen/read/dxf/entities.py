"""The walk through a drawing: which entities are drawn where, as plain numbers in columns.

Blocks are expanded here and not by ezdxf: every entity keeps its own numbers and gets the index of the matrix that
takes them into the work plane (block references, arrays and extrusion vectors multiplied out, mm). The arithmetic is
then done once for all entities in ``flatten``.
"""

from __future__ import annotations

import math
from array import array
from collections import Counter
from collections.abc import Callable, Iterable
from itertools import groupby
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from msgspec import Struct, field

from camgen.model.errors import InputError
from camgen.model.limits import Limits, format_limit
from camgen.model.pose import FloatArray
from camgen.model.text import harmless
from camgen.read.dxf.colors import Colors, colors_of
from camgen.read.dxf.layers import FROZEN, Layers
from camgen.read.dxf.plain import CIRCLE, KINDS, LINE, PlainEntities, Split

if TYPE_CHECKING:
    from ezdxf.document import Drawing


# Where a block reference puts its block: object coordinates, scales, arrays; and when it cannot be used.


def ocs_matrix(extrusion: tuple[float, float, float]) -> FloatArray:
    """4 x 4 from the object to the world coordinate system, by the arbitrary axis algorithm of the DXF reference."""
    z = np.array(extrusion)
    size = float(np.linalg.norm(z))
    if not 0 < size < math.inf:
        return np.eye(4)
    z /= size
    x = np.cross(
        (0.0, 1.0, 0.0) if abs(z[0]) < 1 / 64 and abs(z[1]) < 1 / 64 else (0.0, 0.0, 1.0), z
    )
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2] = x, np.cross(z, x), z
    return matrix


def unusable(entity: Any, block: Any, a: dict[str, Any], around: tuple[str, ...]) -> str:
    """Why the reference ``entity`` to ``block`` cannot be used, "" if it can. around: blocks it stands in."""
    if block is None:
        return f"its block {harmless(str(a.get('name', '')))!r} is missing"
    if block.block_record.is_xref:
        return "an external reference, not in this file"
    if str(a.get("name")).casefold() in around:
        return "its block contains itself"
    if not (a.get("xscale", 1.0) and a.get("yscale", 1.0)):
        return "scaled to nothing"
    if entity.has_extension_dict and _clip(entity):
        return "clipped (XCLIP), which cannot be honoured; explode it"
    return ""


def _clip(entity: Any) -> bool:
    from ezdxf.xclip import XClip  # noqa: PLC0415 - rare

    clip = XClip(entity)
    return bool(clip.has_clipping_path and clip.is_clipping_enabled)


def array_of(a: dict[str, Any]) -> tuple[int, int]:
    """Columns and rows of a reference with attributes ``a``. Those without a distance lie on each other and are one."""
    columns, rows = max(1, a.get("column_count", 1)), max(1, a.get("row_count", 1))
    return columns if a.get("column_spacing", 0.0) else 1, rows if a.get("row_spacing", 0.0) else 1


def cells(a: dict[str, Any], base: tuple[float, float, float]) -> Iterable[FloatArray]:
    """World from block (4 x 4) for each cell of the array of a reference with attributes ``a``.

    base: base point of the block. The array is turned with the reference but not scaled.
    """
    ocs = ocs_matrix(a["extrusion"].xyz) if "extrusion" in a else np.eye(4)
    turn = math.radians(a.get("rotation", 0.0))
    rotation = np.eye(4)
    rotation[:2, :2] = [[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]]
    # Some writers leave 0 for z in a flat drawing; heights are judged later and must not be hidden by it.
    scale = np.diag([a.get("xscale", 1.0), a.get("yscale", 1.0), a.get("zscale", 1.0) or 1.0, 1.0])
    scale[:3, 3] = scale[:3, :3] @ -np.array(base)
    columns, rows = array_of(a)
    dx, dy = a.get("column_spacing", 0.0), a.get("row_spacing", 0.0)
    at = a["insert"].xyz if "insert" in a else (0.0, 0.0, 0.0)
    for row in range(rows):
        for column in range(columns):
            step = rotation[:3, :3] @ (column * dx, row * dy, 0.0)
            place = np.eye(4)
            place[:3, 3] = step + at
            yield ocs @ place @ rotation @ scale


_NO_CURVE = "not a kind of curve that is machined"
_DAMAGED = "damaged numbers"
_NO_RADIUS = "radius not positive"
#: Reasons for which nothing is lost that could have been machined.
REPAIRED: Final = frozenset({_NO_RADIUS})

_UP = (0.0, 0.0, 1.0)
Attributes = dict[str, Any]


class Smooth(Struct, frozen=True):
    """An ellipse (center, two half axes as control rows; start and end parameter) or a spline, in its own frame."""

    control: FloatArray
    knots: FloatArray
    degree: int
    weights: FloatArray | None


class DrawnEntities(Struct, eq=False):
    """Columns, filled by the walk. Owner numbers count the pieces in drawing order and index ``matrix`` etc.

    lines: x, y, z of start and end. arcs: center x, y, z, radius, start and sweep in degrees. outlines: rows x, y, z,
    bulge. matrices: 4 x 4, from the numbers of an entity to mm in the work frame. left: why -> (kind, layer) -> count.
    """

    matrices: list[FloatArray]
    layers: Layers
    colors: Colors
    matrix: list[int] = field(default_factory=list)
    layer: list[str] = field(default_factory=list)
    color: list[int] = field(default_factory=list)
    kind: list[str] = field(default_factory=list)
    closed: list[bool] = field(default_factory=list)
    handle: list[str] = field(default_factory=list)
    lines: array[float] = field(default_factory=lambda: array("d"))
    line_owner: list[int] = field(default_factory=list)
    arcs: array[float] = field(default_factory=lambda: array("d"))
    arc_owner: list[int] = field(default_factory=list)
    points: array[float] = field(default_factory=lambda: array("d"))
    point_owner: list[int] = field(default_factory=list)
    outlines: list[FloatArray] = field(default_factory=list)
    outline_owner: list[int] = field(default_factory=list)
    smooth: list[Smooth] = field(default_factory=list)
    smooth_owner: list[int] = field(default_factory=list)
    left: dict[str, Counter[tuple[str, str]]] = field(default_factory=dict)
    flattened: Counter[tuple[str, str]] = field(default_factory=Counter)
    widths: Counter[tuple[str, str]] = field(default_factory=Counter)
    met: Counter[tuple[str, str]] = field(default_factory=Counter)
    handles: dict[str, list[str]] = field(default_factory=dict)
    marked_closed: set[int] = field(default_factory=set)

    def leave(self, why: str, kind: str, layer: str, count: int = 1) -> None:
        """Count entities that are not used."""
        self.left.setdefault(why, Counter())[kind, layer] += count

    def name(self, why: str, attributes: Attributes) -> None:
        """Keep the handle of an entity that is not used, for its note."""
        handle = attributes.get("handle")
        if handle:
            self.handles.setdefault(why, []).append(handle)

    def own(
        self, place: _Place, kind: str, layer: str, closed: bool, attributes: Attributes, ocs: bool
    ) -> int:
        """A new piece; returns its owner number."""
        self.matrix.append(place.in_ocs(self, attributes.get("extrusion")) if ocs else place.index)
        self.layer.append(layer)
        self.color.append(self.colors.find(attributes, layer, place.color))
        self.kind.append(kind)
        self.closed.append(closed)
        self.handle.append(attributes.get("handle") or "")
        if attributes.get("thickness"):
            self.flattened[kind, layer] += 1
        return len(self.matrix) - 1


class _Place(Struct, eq=False):
    """Where a block is put: its matrix, what its layer 0 and its color BYBLOCK stand for, and the blocks around it."""

    index: int
    layer: str
    color: int
    blocks: tuple[str, ...] = ()
    by_extrusion: dict[tuple[float, float, float], int] = field(default_factory=dict)

    def in_ocs(self, drawn: DrawnEntities, extrusion: Any) -> int:
        """Index of the matrix for numbers in the object coordinate system of ``extrusion``."""
        if extrusion is None:
            return self.index
        key = extrusion.xyz
        if key == _UP:
            return self.index
        if key not in self.by_extrusion:
            drawn.matrices.append(drawn.matrices[self.index] @ ocs_matrix(key))
            self.by_extrusion[key] = len(drawn.matrices) - 1
        return self.by_extrusion[key]


def walk(
    name: str, document: Drawing, plain: Split | None, scale: float, layers: Layers, limits: Limits
) -> DrawnEntities:
    """All entities of model space with blocks expanded, and what was taken out of them in its place.

    scale: mm per drawing unit. ``InputError`` if too many.
    """
    drawn = DrawnEntities([np.diag([scale, scale, scale, 1.0])], layers, colors_of(document))
    place, space = _Place(0, "", 0), document.modelspace()
    _Sizes(name, document, limits).insist(space, len(plain.plain.kind) if plain else 0)
    if plain is None:
        _entities(name, drawn, space, place)
    else:
        for run, entities in groupby(space, lambda entity: _stands_for(entity, plain)):
            if run is None:
                _entities(name, drawn, entities, place)
            else:
                _run(drawn, plain.plain, run, place)
    for layout in document.layouts:
        if layout.is_any_paperspace:
            for entity in layout:
                if entity.dxftype() != "VIEWPORT":
                    drawn.leave(
                        "in paper space", entity.dxftype(), entity.dxfattribs().get("layer", "0")
                    )
    return drawn


def _stands_for(entity: Any, plain: Split) -> slice | None:
    """The run of plain entities in whose place ``entity`` stands, None if it is one of the drawing."""
    return plain.runs.get(entity.dxf.layer) if entity.dxftype() == "POINT" else None


class _Sizes:
    """How many entities a drawing expands to, counted once for each block and before any of them is drawn: blocks in
    blocks and arrays multiply, so that a few lines of text may stand for more than any memory holds.
    """

    def __init__(self, name: str, document: Drawing, limits: Limits) -> None:
        self.name = name
        self.limits = limits
        self.blocks = document.blocks
        self.known: dict[str, int] = {}

    def insist(self, entities: Iterable[Any], beside: int) -> None:
        """InputError where ``entities`` of model space and so many ``beside`` them expand to too much."""
        self._count(entities, (), beside)

    def _count(self, entities: Iterable[Any], around: tuple[str, ...], total: int = 0) -> int:
        for entity in entities:
            total += 1
            if entity.dxftype() == "INSERT":
                a = entity.dxfattribs()
                block = str(a.get("name"))
                columns, rows = array_of(a)
                total += columns * rows * (1 + self._of(block, around))
            if total > self.limits.dxf_entities:
                what = (
                    f"blocks expand to more than {format_limit(self.limits.dxf_entities)} entities"
                )
                remedy = "explode or thin them, or raise limits.dxf_entities"
                raise InputError(self.name, what, around[-1] if around else "", remedy)
        return total

    def _of(self, block: str, around: tuple[str, ...]) -> int:
        key = block.casefold()
        if key in around or key not in self.blocks:
            return 0  # the walk says so
        if len(around) >= self.limits.dxf_depth:
            depth = format_limit(self.limits.dxf_depth)
            what = f"blocks stand more than {depth} deep within each other"
            raise InputError(
                self.name, what, harmless(block), "explode them, or raise limits.dxf_depth"
            )
        if key not in self.known:
            self.known[key] = self._count(self.blocks.get(block), (*around, key))
        return self.known[key]


def _entities(name: str, drawn: DrawnEntities, entities: Iterable[Any], place: _Place) -> None:
    for entity in entities:
        kind = entity.dxftype()
        attributes = entity.dxfattribs()
        layer = attributes.get("layer", "0")
        if place.layer and layer == "0":
            layer = place.layer
        drawn.met[kind, layer] += 1
        why = drawn.layers.why_not(layer)
        if attributes.get("invisible"):
            drawn.leave("invisible", kind, layer)
        elif kind == "INSERT":
            # An off layer hides only what lies on it, a frozen one the whole reference.
            if why == FROZEN:
                drawn.leave(why, kind, layer)
            else:
                _insert(name, drawn, entity, attributes, layer, place)
        elif kind not in _KINDS:
            drawn.leave(why or _NO_CURVE, kind, layer)
        elif why:
            drawn.leave(why, kind, layer)
        else:
            why = _KINDS[kind](drawn, entity, attributes, layer, place)
            if why:
                drawn.leave(why, kind, layer)
                drawn.name(why, attributes)


def _run(drawn: DrawnEntities, plain: PlainEntities, run: slice, place: _Place) -> None:
    """The entities of ``run`` as ``_entities`` would draw them, by column."""
    kind, numbers = plain.kind[run], plain.numbers[run]
    # What is the same of many is looked at once, where it first comes.
    said = (plain.color[run] * len(plain.layers) + plain.layer[run]) * len(KINDS) + kind
    different, first, which, counts = np.unique(
        said, return_index=True, return_inverse=True, return_counts=True
    )
    color = np.full(len(different), -1)
    for k in np.argsort(first).tolist():
        name, layer = (
            KINDS[different[k] % len(KINDS)],
            plain.layers[different[k] // len(KINDS) % len(plain.layers)],
        )
        drawn.met[name, layer] += int(counts[k])
        why = drawn.layers.why_not(layer)
        if why:
            drawn.leave(why, name, layer, int(counts[k]))
        else:
            true, number = plain.colors[different[k] // len(KINDS) // len(plain.layers)]
            color[k] = drawn.colors.find({"true_color": true, "color": number}, layer, place.color)
    color = color[which]
    used = color >= 0
    kind, numbers = kind[used], numbers[used]
    owner = len(drawn.matrix) + np.arange(len(kind))
    lines = kind == LINE
    drawn.matrix += [place.index] * len(kind)
    drawn.layer += [plain.layers[k] for k in plain.layer[run][used].tolist()]
    drawn.color += color[used].tolist()
    drawn.kind += [KINDS[k] for k in kind.tolist()]
    drawn.closed += (kind == CIRCLE).tolist()
    drawn.handle += [handle.decode() for handle in plain.handles[run][used].tolist()]
    drawn.line_owner += owner[lines].tolist()
    drawn.lines.frombytes(numbers[lines].tobytes())
    drawn.arc_owner += owner[~lines].tolist()
    arcs = numbers[~lines]
    start, end = arcs[:, 4], arcs[:, 5]
    turn = (end - start) % 360.0
    arcs[:, 5] = np.where(start == end, 0.0, np.where(turn == 0, 360.0, turn))
    drawn.arcs.frombytes(arcs.tobytes())


def _line(drawn: DrawnEntities, _: Any, a: Attributes, layer: str, place: _Place) -> str:
    start, end = a.get("start"), a.get("end")
    if start is None or end is None:
        return _DAMAGED
    drawn.line_owner.append(drawn.own(place, "LINE", layer, False, a, ocs=False))
    drawn.lines.extend(start.xyz)
    drawn.lines.extend(end.xyz)
    return ""


def _arc(drawn: DrawnEntities, _: Any, a: Attributes, layer: str, place: _Place) -> str:
    if "start_angle" not in a or "end_angle" not in a:
        return _DAMAGED
    return _round(drawn, "ARC", a, layer, place, (a["start_angle"], a["end_angle"]))


def _circle(drawn: DrawnEntities, _: Any, a: Attributes, layer: str, place: _Place) -> str:
    return _round(drawn, "CIRCLE", a, layer, place, (0.0, 360.0))


def _round(
    drawn: DrawnEntities,
    kind: str,
    a: Attributes,
    layer: str,
    place: _Place,
    angles: tuple[float, float],
) -> str:
    center, radius = a.get("center"), a.get("radius")
    if center is None or radius is None or not all(map(math.isfinite, (radius, *angles))):
        return _DAMAGED
    if radius <= 0:
        return _NO_RADIUS
    drawn.arc_owner.append(drawn.own(place, kind, layer, kind == "CIRCLE", a, ocs=True))
    drawn.arcs.extend(center.xyz)
    drawn.arcs.extend((radius, angles[0], sweep(*angles, 360.0)))
    return ""


def sweep(start: float, end: float, turn: float) -> float:
    """Counter-clockwise from ``start`` to ``end``: a full turn if they differ by whole turns, 0 only if equal."""
    if start == end:
        return 0.0
    return (end - start) % turn or turn


def _lwpolyline(drawn: DrawnEntities, entity: Any, a: Attributes, layer: str, place: _Place) -> str:
    rows = entity.lwpoints.values
    if not len(rows):
        return _DAMAGED
    flags = a.get("flags", 0)
    owner = drawn.own(place, "LWPOLYLINE", layer, bool(flags & 1), a, ocs=True)
    outline = np.empty((len(rows), 4))
    outline[:, :2], outline[:, 2], outline[:, 3] = rows[:, :2], a.get("elevation", 0.0), rows[:, 4]
    drawn.outlines.append(outline)
    drawn.outline_owner.append(owner)
    if a.get("const_width") or rows[:, 2:4].any():
        drawn.widths["LWPOLYLINE", layer] += 1
    return ""


def _polyline(drawn: DrawnEntities, entity: Any, a: Attributes, layer: str, place: _Place) -> str:
    flags = a.get("flags", 0)
    if flags & 0x50:
        return "a mesh"
    # Vertices of a spline's frame (16) are there to edit it; what is drawn are the others.
    rows = [v.dxfattribs() for v in entity.vertices]
    rows = [v for v in rows if not v.get("flags", 0) & 16 and v.get("location") is not None]
    if not rows:
        return _DAMAGED
    outline = np.array([(*v["location"].xyz, v.get("bulge", 0.0)) for v in rows], dtype=np.float64)
    flat = not flags & 8
    if flat:
        elevation = a.get("elevation")
        outline[:, 2] = elevation.z if elevation is not None else outline[0, 2]
    else:
        outline[:, 3] = 0.0
    kind = "POLYLINE" if flat else "3-D POLYLINE"
    drawn.outline_owner.append(drawn.own(place, kind, layer, bool(flags & 1), a, ocs=flat))
    drawn.outlines.append(outline)
    if flat and (a.get("default_start_width") or a.get("default_end_width")):
        drawn.widths[kind, layer] += 1
    return ""


def _ellipse(drawn: DrawnEntities, entity: Any, a: Attributes, layer: str, place: _Place) -> str:
    if not {"center", "major_axis", "ratio"} <= a.keys():
        return _DAMAGED
    major, ratio = entity.dxf.major_axis, entity.dxf.ratio
    start, end = a.get("start_param", 0.0), a.get("end_param", math.tau)
    if not all(map(math.isfinite, (*major.xyz, ratio, start, end))) or not major or not ratio:
        return _DAMAGED
    axes = np.array([entity.dxf.center.xyz, major.xyz, entity.minor_axis.xyz])
    params = np.array([start, start + sweep(start, end, math.tau)])
    drawn.smooth_owner.append(drawn.own(place, "ELLIPSE", layer, False, a, ocs=False))
    drawn.smooth.append(Smooth(axes, params, 0, None))
    return ""


def _spline(drawn: DrawnEntities, entity: Any, a: Attributes, layer: str, place: _Place) -> str:
    # ezdxf raises ValueError for counts that do not fit and for too few points, ZeroDivisionError for equal ones.
    try:
        tool = entity.construction_tool()
    except (ValueError, ArithmeticError, IndexError):
        return "no spline can be made of its points and knots"
    control = np.array([p.xyz for p in tool.control_points])
    weights = np.array(tool.weights()) if tool.is_rational else None
    owner = drawn.own(place, entity.dxftype(), layer, False, a, ocs=False)
    if a.get("flags", 0) & 1:
        drawn.marked_closed.add(owner)
    drawn.smooth_owner.append(owner)
    drawn.smooth.append(Smooth(control, np.array(tool.knots()), tool.degree, weights))
    return ""


def _point(drawn: DrawnEntities, _: Any, a: Attributes, layer: str, place: _Place) -> str:
    location = a.get("location")
    if location is None:
        return _DAMAGED
    drawn.point_owner.append(drawn.own(place, "POINT", layer, False, a, ocs=False))
    drawn.points.extend(location.xyz)
    return ""


_KINDS: dict[str, Callable[[DrawnEntities, Any, Attributes, str, _Place], str]] = {
    "LINE": _line,
    "ARC": _arc,
    "CIRCLE": _circle,
    "LWPOLYLINE": _lwpolyline,
    "POLYLINE": _polyline,
    "ELLIPSE": _ellipse,
    "SPLINE": _spline,
    # A HELIX holds the spline that is drawn beside the numbers that it was made of.
    "HELIX": _spline,
    "POINT": _point,
}


def _insert(
    name: str, drawn: DrawnEntities, entity: Any, a: Attributes, layer: str, place: _Place
) -> None:
    """The block's entities, once per cell of the array."""
    for attrib in entity.attribs:
        drawn.leave(_NO_CURVE, "ATTRIB", attrib.dxfattribs().get("layer", "0"))
    block: Any = entity.block() if "name" in a else None
    why = unusable(entity, block, a, place.blocks)
    if why:
        drawn.leave(why, "INSERT", layer)
        drawn.name(why, a)
        return
    base = block.block.dxf.base_point.xyz
    blocks = (*place.blocks, str(a.get("name")).casefold())
    color = drawn.colors.find(a, layer, place.color)
    for matrix in cells(a, base):
        drawn.matrices.append(drawn.matrices[place.index] @ matrix)
        _entities(name, drawn, block, _Place(len(drawn.matrices) - 1, layer, color, blocks))
