"""Lists all entities of a drawing, with blocks expanded, as plain numbers in columns.

Blocks are expanded here and not by ezdxf. Each entity keeps its own numbers and gets the index of a
matrix that maps them to the work frame: the product of block references, arrays and extrusions.
`flatten` then computes all entities at once.
"""

from __future__ import annotations

import math
from array import array
from collections import Counter
from collections.abc import Callable, Iterable
from itertools import groupby
from typing import Any, Final

import numpy as np
from ezdxf.document import Drawing
from ezdxf.xclip import XClip
from msgspec import Struct, field

from camgen.model.errors import InputError
from camgen.model.limits import Limits, format_limit
from camgen.model.pose import FloatArray
from camgen.model.sequences import take_rows
from camgen.model.text import harmless
from camgen.read.dxf.layers import Colors, read_colors
from camgen.read.dxf.plain import CIRCLE, KINDS, LINE, PlainEntities, Split
from camgen.read.layers import FROZEN, Layers

Attributes = dict[str, Any]


# Block references: object coordinates, scales, arrays, and reasons not to use one.


def _make_ocs_matrix(extrusion: tuple[float, float, float]) -> FloatArray:
    """4 x 4 matrix from object to world coordinates.

    It is made by the arbitrary axis algorithm of the DXF reference. An extrusion that is zero or
    not finite gives the identity.
    """
    z = np.array(extrusion)
    size = float(np.linalg.norm(z))
    if not 0 < size < math.inf:
        return np.eye(4)
    z /= size
    is_near_z = abs(z[0]) < 1 / 64 and abs(z[1]) < 1 / 64
    x = np.cross((0.0, 1.0, 0.0) if is_near_z else (0.0, 0.0, 1.0), z)
    x /= np.linalg.norm(x)
    matrix = np.eye(4)
    matrix[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    return matrix


def _find_fault(entity: Any, block: Any, attributes: Attributes, enclosing: tuple[str, ...]) -> str:
    """The reason why a reference to `block` cannot be used, "" if it can.

    enclosing: folded names of the blocks around the reference.
    """
    if block is None:
        return f"its block {harmless(str(attributes.get('name', '')))!r} is missing"
    if block.block_record.is_xref:
        return "an external reference, not in this file"
    if str(attributes.get("name")).casefold() in enclosing:
        return "its block contains itself"
    if not (attributes.get("xscale", 1.0) and attributes.get("yscale", 1.0)):
        return "scaled to nothing"
    if entity.has_extension_dict:
        clip = XClip(entity)
        if clip.has_clipping_path and clip.is_clipping_enabled:
            return "clipped (XCLIP), which is not supported; explode it"
    return ""


def _read_array(attributes: Attributes) -> tuple[int, int]:
    """Columns and rows of the array of a reference.

    Columns without a spacing lie on each other and count as one, and so do rows.
    """
    columns = max(1, attributes.get("column_count", 1))
    rows = max(1, attributes.get("row_count", 1))
    has_columns = attributes.get("column_spacing", 0.0)
    has_rows = attributes.get("row_spacing", 0.0)
    return columns if has_columns else 1, rows if has_rows else 1


def _list_cells(attributes: Attributes, base: tuple[float, float, float]) -> Iterable[FloatArray]:
    """Matrix (4, 4) from the block to its surroundings for each cell of the array of a reference.

    The array is rotated with the reference but not scaled.

    base: base point of the block.
    """
    get = attributes.get
    ocs = np.eye(4)
    if "extrusion" in attributes:
        ocs = _make_ocs_matrix(attributes["extrusion"].xyz)
    angle = math.radians(get("rotation", 0.0))
    rotation = np.eye(4)
    rotation[:2, :2] = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
    # Some programs write 0 for z in a flat drawing. It would hide heights, which are checked later.
    scale = np.diag([get("xscale", 1.0), get("yscale", 1.0), get("zscale", 1.0) or 1.0, 1.0])
    scale[:3, 3] = scale[:3, :3] @ -np.array(base)
    columns, rows = _read_array(attributes)
    dx, dy = get("column_spacing", 0.0), get("row_spacing", 0.0)
    insertion = attributes["insert"].xyz if "insert" in attributes else (0.0, 0.0, 0.0)
    for row in range(rows):
        for column in range(columns):
            translation = np.eye(4)
            translation[:3, 3] = rotation[:3, :3] @ (column * dx, row * dy, 0.0) + insertion
            yield ocs @ translation @ rotation @ scale


# Columns of entities.

_NOT_MACHINED = "not a kind of curve that is machined"
_DAMAGED = "damaged numbers"
_NO_RADIUS = "radius not positive"
#: Reasons of entities that could not have been machined, so that nothing is lost.
REPAIRED: Final = frozenset({_NO_RADIUS})


class Unusable(Exception):
    """The error for an entity that cannot be used; its text is the reason."""


#: Kinds whose numbers are object coordinates.
_OCS_KINDS: Final = ("ARC", "CIRCLE", "LWPOLYLINE", "POLYLINE")
#: Extrusion of an entity whose object coordinates are world coordinates.
_UP = (0.0, 0.0, 1.0)


class Smooth(Struct, frozen=True):
    """An ellipse or a spline in its own frame.

    control: (N, 3) control points of a spline; center and half axes of an ellipse.
    knots: knots of a spline; start and end parameter of an ellipse, rad.
    degree: degree of a spline, 0 for an ellipse.
    weights: weights of the control points, None if they are all 1.
    """

    control: FloatArray
    knots: FloatArray
    degree: int
    weights: FloatArray | None

    def transform(self, matrix: FloatArray) -> FloatArray:
        """(N, 3) `control` under a (4, 4) matrix. Half axes are not moved by its translation."""
        control = self.control @ matrix[:3, :3].T
        control[: len(control) if self.degree else 1] += matrix[:3, 3]
        return np.asarray(control)


class DrawnEntities(Struct, eq=False):
    """Columns of the entities of a drawing.

    An entity that is used is a piece. Its number, in drawing order, is the owner of its numbers.

    matrices: (4, 4) each, from the numbers of an entity to mm in the work frame.
    layers: layers of the drawing.
    colors: colors of the drawing.
    matrix: index in `matrices`, by owner.
    layer: name of the layer, by owner.
    color: index in `colors.names`, by owner.
    kind: kind, by owner.
    closed: whether the piece is marked closed, by owner.
    handle: handle, by owner; "" if the entity has none.
    lines: x, y, z of the start and the end of each line.
    arcs: x, y, z of the center, radius, start angle and sweep in degrees of each arc.
    line_owner, arc_owner: owner of each line and of each arc.
    points: x, y, z of each point, by owner.
    outlines: rows x, y, z, bulge of each polyline, by owner.
    smooth: ellipses and splines, by owner.
    unused: number of unused entities by reason, and by kind and layer.
    handles: handles of unused entities that a note names, by reason.
    with_thickness, with_width: number of pieces by kind and layer.
    met: number of all entities of model space by kind and layer, with blocks expanded.
    marked_closed: owners of the splines that are marked closed.
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
    points: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    outlines: dict[int, FloatArray] = field(default_factory=dict)
    smooth: dict[int, Smooth] = field(default_factory=dict)
    unused: dict[str, Counter[tuple[str, str]]] = field(default_factory=dict)
    handles: dict[str, list[str]] = field(default_factory=dict)
    with_thickness: Counter[tuple[str, str]] = field(default_factory=Counter)
    with_width: Counter[tuple[str, str]] = field(default_factory=Counter)
    met: Counter[tuple[str, str]] = field(default_factory=Counter)
    marked_closed: set[int] = field(default_factory=set)

    def count_unused(
        self, why: str, kind: str, layer: str, count: int = 1, handle: str | None = None
    ) -> None:
        """Count entities that are not used. The note names the one with the handle."""
        self.unused.setdefault(why, Counter())[kind, layer] += count
        if handle:
            self.handles.setdefault(why, []).append(handle)

    def add_piece(
        self,
        reference: _Reference,
        kind: str,
        layer: str,
        closed: bool,
        attributes: Attributes,
    ) -> int:
        """Add a piece to the columns by owner. Returns its number."""
        extrusion = attributes.get("extrusion") if kind in _OCS_KINDS else None
        self.matrix.append(reference.find_matrix(self, extrusion))
        self.layer.append(layer)
        self.color.append(self.colors.find(attributes, layer, reference.color))
        self.kind.append(kind)
        self.closed.append(closed)
        self.handle.append(attributes.get("handle") or "")
        if attributes.get("thickness"):
            self.with_thickness[kind, layer] += 1
        return len(self.matrix) - 1


class _Reference(Struct, eq=False):
    """A block reference in which entities are drawn, or model space itself.

    matrix: index in `DrawnEntities.matrices`.
    layer: name of its layer, which layer 0 of the block stands for; "" for model space.
    color: index of its color, which the color BYBLOCK stands for.
    blocks: folded names of its block and of all blocks around it.
    by_extrusion: cache: index of the matrix for an extrusion.
    """

    matrix: int
    layer: str
    color: int
    blocks: tuple[str, ...] = ()
    by_extrusion: dict[tuple[float, float, float], int] = field(default_factory=dict)

    def find_matrix(self, drawn: DrawnEntities, extrusion: Any) -> int:
        """Index of the matrix for numbers in the object coordinates of `extrusion`."""
        if extrusion is None or extrusion.xyz == _UP:
            return self.matrix
        key = extrusion.xyz
        if key not in self.by_extrusion:
            drawn.matrices.append(drawn.matrices[self.matrix] @ _make_ocs_matrix(key))
            self.by_extrusion[key] = len(drawn.matrices) - 1
        return self.by_extrusion[key]


def walk(
    name: str, document: Drawing, plain: Split | None, scale: float, layers: Layers, limits: Limits
) -> DrawnEntities:
    """All entities of model space, with blocks expanded, in drawing order.

    plain: entities that were taken out of the document, with their stand-ins.
    scale: mm per drawing unit.

    Raises InputError if there are more entities than `limits` allow.
    """
    drawn = DrawnEntities([np.diag([scale, scale, scale, 1.0])], layers, read_colors(document))
    model_space = _Reference(0, "", 0)
    entities = document.modelspace()
    counter = _EntityCount(name, document.blocks, limits)
    counter.count(entities, (), len(plain.plain.kind) if plain else 0)
    if plain is None:
        _add_entities(drawn, entities, model_space)
    else:
        for run, group in groupby(entities, lambda entity: _find_run(entity, plain)):
            if run is None:
                _add_entities(drawn, group, model_space)
            else:
                _add_run(drawn, plain.plain, run, model_space)
    for layout in document.layouts:
        if layout.is_any_paperspace:
            for entity in layout:
                kind = entity.dxftype()
                if kind != "VIEWPORT":
                    layer = entity.dxfattribs().get("layer", "0")
                    drawn.count_unused("in paper space", kind, layer)
    return drawn


def _find_run(entity: Any, plain: Split) -> slice | None:
    """The run of plain entities that `entity` is a stand-in for; None for any other entity."""
    return plain.runs.get(entity.dxf.layer) if entity.dxftype() == "POINT" else None


class _EntityCount(Struct):
    """Number of entities to which a drawing expands, computed before any of them is drawn.

    Blocks in blocks and arrays multiply, so that a few lines of text may stand for more entities
    than any memory holds. Each block is counted once.

    name: name of the file.
    blocks: blocks of the document.
    cache: numbers of blocks, by folded name.
    """

    name: str
    blocks: Any
    limits: Limits
    cache: dict[str, int] = field(default_factory=dict)

    def count(self, entities: Iterable[Any], enclosing: tuple[str, ...], total: int = 0) -> int:
        """`total` and the number of entities to which `entities` expand.

        enclosing: folded names of the blocks around them.

        Raises InputError if it is above the limit, or if blocks are nested too deeply.
        """
        for entity in entities:
            total += 1
            if entity.dxftype() == "INSERT":
                attributes = entity.dxfattribs()
                columns, rows = _read_array(attributes)
                total += columns * rows * (1 + self._count_block(attributes, enclosing))
            if total > self.limits.dxf_entities:
                raise InputError(
                    self.name,
                    f"blocks expand to more than {format_limit(self.limits.dxf_entities)} entities",
                    enclosing[-1] if enclosing else "",
                    "explode or thin them, or raise limits.dxf_entities",
                )
        return total

    def _count_block(self, attributes: Attributes, enclosing: tuple[str, ...]) -> int:
        block = str(attributes.get("name"))
        key = block.casefold()
        if key in enclosing or key not in self.blocks:
            return 0  # `_find_fault` reports it
        if len(enclosing) >= self.limits.dxf_depth:
            depth = format_limit(self.limits.dxf_depth)
            raise InputError(
                self.name,
                f"blocks stand more than {depth} deep within each other",
                harmless(block),
                "explode them, or raise limits.dxf_depth",
            )
        if key not in self.cache:
            self.cache[key] = self.count(self.blocks.get(block), (*enclosing, key))
        return self.cache[key]


def _add_entities(drawn: DrawnEntities, entities: Iterable[Any], reference: _Reference) -> None:
    for entity in entities:
        kind = entity.dxftype()
        attributes = entity.dxfattribs()
        layer = attributes.get("layer", "0")
        if reference.layer and layer == "0":
            layer = reference.layer
        drawn.met[kind, layer] += 1
        why = drawn.layers.why_not(layer)
        if attributes.get("invisible"):
            drawn.count_unused("invisible", kind, layer)
        elif kind == "INSERT" and why != FROZEN:
            # A layer that is off hides its own entities only, a frozen one the whole reference.
            _add_block(drawn, entity, attributes, layer, reference)
        elif why:
            drawn.count_unused(why, kind, layer)
        elif kind not in _ADDERS:
            drawn.count_unused(_NOT_MACHINED, kind, layer)
        else:
            try:
                _ADDERS[kind](drawn, entity, attributes, layer, reference)
            except Unusable as error:
                drawn.count_unused(str(error), kind, layer, handle=attributes.get("handle"))


def _add_run(drawn: DrawnEntities, plain: PlainEntities, run: slice, reference: _Reference) -> None:
    """Add plain entities by column, with the same result as by `_add_entities`."""
    kind, numbers, layer = plain.kind[run], plain.numbers[run], plain.layer[run]
    # Entities with the same kind, layer and color are decided together, in order of their firsts.
    key = (plain.color[run] * len(plain.layers) + layer) * len(KINDS) + kind
    keys, first, which, counts = np.unique(
        key, return_index=True, return_inverse=True, return_counts=True
    )
    color_of_key = np.full(len(keys), -1)
    for k in np.argsort(first).tolist():
        row = first[k]
        kind_name, layer_name = KINDS[kind[row]], plain.layers[layer[row]]
        drawn.met[kind_name, layer_name] += int(counts[k])
        why = drawn.layers.why_not(layer_name)
        if why:
            drawn.count_unused(why, kind_name, layer_name, int(counts[k]))
        else:
            true_color, number = plain.colors[plain.color[run][row]]
            attributes = {"true_color": true_color, "color": number}
            color_of_key[k] = drawn.colors.find(attributes, layer_name, reference.color)
    color = color_of_key[which]
    is_used = color >= 0
    kind, numbers = kind[is_used], numbers[is_used]
    owner = len(drawn.matrix) + np.arange(len(kind))
    is_line = kind == LINE
    drawn.matrix += [reference.matrix] * len(kind)
    drawn.layer += take_rows(plain.layers, layer[is_used].tolist())
    drawn.color += color[is_used].tolist()
    drawn.kind += take_rows(KINDS, kind.tolist())
    drawn.closed += (kind == CIRCLE).tolist()
    drawn.handle += [handle.decode() for handle in plain.handles[run][is_used].tolist()]
    drawn.line_owner += owner[is_line].tolist()
    drawn.lines.frombytes(numbers[is_line].tobytes())
    drawn.arc_owner += owner[~is_line].tolist()
    arcs = numbers[~is_line]
    start, end = arcs[:, 4], arcs[:, 5]
    sweep = (end - start) % 360.0
    arcs[:, 5] = np.where(start == end, 0.0, np.where(sweep == 0, 360.0, sweep))
    drawn.arcs.frombytes(arcs.tobytes())


# Functions that add an entity, by kind. They raise Unusable for one that cannot be used.


def _add_line(
    drawn: DrawnEntities, _: Any, attributes: Attributes, layer: str, reference: _Reference
) -> None:
    start, end = attributes.get("start"), attributes.get("end")
    if start is None or end is None:
        raise Unusable(_DAMAGED)
    drawn.line_owner.append(drawn.add_piece(reference, "LINE", layer, False, attributes))
    drawn.lines.extend((*start.xyz, *end.xyz))


def _add_arc(
    drawn: DrawnEntities, entity: Any, attributes: Attributes, layer: str, reference: _Reference
) -> None:
    kind = entity.dxftype()
    if kind == "CIRCLE":
        start, end = 0.0, 360.0
    elif "start_angle" in attributes and "end_angle" in attributes:
        start, end = attributes["start_angle"], attributes["end_angle"]
    else:
        raise Unusable(_DAMAGED)
    center, radius = attributes.get("center"), attributes.get("radius")
    if center is None or radius is None or not all(map(math.isfinite, (radius, start, end))):
        raise Unusable(_DAMAGED)
    if radius <= 0:
        raise Unusable(_NO_RADIUS)
    drawn.arc_owner.append(drawn.add_piece(reference, kind, layer, kind == "CIRCLE", attributes))
    drawn.arcs.extend((*center.xyz, radius, start, _compute_sweep(start, end, 360.0)))


def _compute_sweep(start: float, end: float, turn: float) -> float:
    """Counter-clockwise angle from `start` to `end`, in the unit of `turn`, which is a full turn.

    It is a full turn if they differ by whole turns, and 0 only if they are equal.
    """
    if start == end:
        return 0.0
    return (end - start) % turn or turn


def _add_lwpolyline(
    drawn: DrawnEntities, entity: Any, attributes: Attributes, layer: str, reference: _Reference
) -> None:
    rows = entity.lwpoints.values
    if not len(rows):
        raise Unusable(_DAMAGED)
    closed = bool(attributes.get("flags", 0) & 1)
    owner = drawn.add_piece(reference, "LWPOLYLINE", layer, closed, attributes)
    elevation = np.full(len(rows), attributes.get("elevation", 0.0))
    drawn.outlines[owner] = np.column_stack([rows[:, :2], elevation, rows[:, 4]])
    if attributes.get("const_width") or rows[:, 2:4].any():
        drawn.with_width["LWPOLYLINE", layer] += 1


def _add_polyline(
    drawn: DrawnEntities, entity: Any, attributes: Attributes, layer: str, reference: _Reference
) -> None:
    flags = attributes.get("flags", 0)
    if flags & 0x50:
        raise Unusable("a mesh")
    # Vertices with flag 16 are the control points of a spline, of which the others are points.
    rows = []
    for vertex in entity.vertices:
        row = vertex.dxfattribs()
        if not row.get("flags", 0) & 16 and row.get("location") is not None:
            rows.append((*row["location"].xyz, row.get("bulge", 0.0)))
    if not rows:
        raise Unusable(_DAMAGED)
    outline = np.array(rows, np.float64)
    is_flat = not flags & 8
    if is_flat:
        elevation = attributes.get("elevation")
        outline[:, 2] = elevation.z if elevation is not None else outline[0, 2]
    else:
        outline[:, 3] = 0.0
    kind = "POLYLINE" if is_flat else "3-D POLYLINE"
    drawn.outlines[drawn.add_piece(reference, kind, layer, bool(flags & 1), attributes)] = outline
    if is_flat and (attributes.get("default_start_width") or attributes.get("default_end_width")):
        drawn.with_width[kind, layer] += 1


def _add_ellipse(
    drawn: DrawnEntities, entity: Any, attributes: Attributes, layer: str, reference: _Reference
) -> None:
    if not {"center", "major_axis", "ratio"} <= attributes.keys():
        raise Unusable(_DAMAGED)
    major, ratio = entity.dxf.major_axis, entity.dxf.ratio
    start, end = attributes.get("start_param", 0.0), attributes.get("end_param", math.tau)
    if not all(map(math.isfinite, (*major.xyz, ratio, start, end))) or not major or not ratio:
        raise Unusable(_DAMAGED)
    axes = np.array([entity.dxf.center.xyz, major.xyz, entity.minor_axis.xyz])
    parameters = np.array([start, start + _compute_sweep(start, end, math.tau)])
    owner = drawn.add_piece(reference, "ELLIPSE", layer, False, attributes)
    drawn.smooth[owner] = Smooth(axes, parameters, 0, None)


def _add_spline(
    drawn: DrawnEntities, entity: Any, attributes: Attributes, layer: str, reference: _Reference
) -> None:
    # ezdxf raises ValueError for too few points or knots, ZeroDivisionError for equal ones.
    try:
        spline = entity.construction_tool()
    except (ValueError, ArithmeticError, IndexError) as error:
        raise Unusable("no spline can be made of its points and knots") from error
    control = np.array([point.xyz for point in spline.control_points])
    weights = np.array(spline.weights()) if spline.is_rational else None
    owner = drawn.add_piece(reference, entity.dxftype(), layer, False, attributes)
    if attributes.get("flags", 0) & 1:
        drawn.marked_closed.add(owner)
    drawn.smooth[owner] = Smooth(control, np.array(spline.knots()), spline.degree, weights)


def _add_point(
    drawn: DrawnEntities, _: Any, attributes: Attributes, layer: str, reference: _Reference
) -> None:
    location = attributes.get("location")
    if location is None:
        raise Unusable(_DAMAGED)
    drawn.points[drawn.add_piece(reference, "POINT", layer, False, attributes)] = location.xyz


_ADDERS: dict[str, Callable[[DrawnEntities, Any, Attributes, str, _Reference], None]] = {
    "LINE": _add_line,
    "ARC": _add_arc,
    "CIRCLE": _add_arc,
    "LWPOLYLINE": _add_lwpolyline,
    "POLYLINE": _add_polyline,
    "ELLIPSE": _add_ellipse,
    "SPLINE": _add_spline,
    # A HELIX has the spline that is drawn besides the numbers of the helix.
    "HELIX": _add_spline,
    "POINT": _add_point,
}


def _add_block(
    drawn: DrawnEntities, entity: Any, attributes: Attributes, layer: str, reference: _Reference
) -> None:
    for attribute in entity.attribs:
        drawn.count_unused(_NOT_MACHINED, "ATTRIB", attribute.dxfattribs().get("layer", "0"))
    block: Any = entity.block() if "name" in attributes else None
    why = _find_fault(entity, block, attributes, reference.blocks)
    if why:
        drawn.count_unused(why, "INSERT", layer, handle=attributes.get("handle"))
        return
    blocks = (*reference.blocks, str(attributes.get("name")).casefold())
    color = drawn.colors.find(attributes, layer, reference.color)
    for matrix in _list_cells(attributes, block.block.dxf.base_point.xyz):
        drawn.matrices.append(drawn.matrices[reference.matrix] @ matrix)
        _add_entities(drawn, block, _Reference(len(drawn.matrices) - 1, layer, color, blocks))
