"""STEP solids of known formulas, as CAD kernels and other programs write them.

python -m bench.read.step_solids [FIRST, 0] [COUNT, 30] [FILE ...]

The rule: solid number n has arrangement n mod 5 of `ARRANGEMENTS`, and edges as n // 5 mod 3 of
`SHARINGS` says. The seed n chooses the rest: shapes and sizes (`make_shape`), the unit of the file,
its uncertainty, the gap between faces that do not share their edges, and how names are written.

A shape is a prism over an outline of lines and arcs, with round holes. The formula counts sharp
edges: the rims of both caps, one edge for each segment and each hole, and the upright edges at the
corners of the outline. Neither seams of cylinders count, nor upright lines where an arc is tangent.
Solids that touch count as one part: no edge where they are flush, a concave one around the foot of
the smaller one. They stay two bodies.

A file is

- right: size, number of bodies, edges and concave edges are those of the formula;
- reported: they differ, and a note of the kind skipped or a warning says so;
- refused: one line;
- silent: they differ and no note says so.

No file is damaged, so each must be right. The size may differ by the deflection of the triangles.

With FILEs the table has a line for each of them: size, bodies, edges and notes.
"""

from __future__ import annotations

import random
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from itertools import chain, product
from pathlib import Path
from typing import NamedTuple

import numpy as np

import camgen
from bench.read.step_shapes import ARRANGEMENTS, Arrangement, Body, Segment, Shape
from bench.support.runner import Cells, Scenario, must_be_none, read_words, run
from camgen.model.pose import FloatArray

COLUMNS = (
    "arrangement | edges | files {} | right {} | reported | silent | refused | of the last one"
)
FILE_COLUMNS = "file | size | bodies | edges | notes"

#: Edges are shared by faces, or each face has its own, or one face alone has.
SHARINGS = ("shared", "unshared", "one face apart")


class Spelling(NamedTuple):
    """Properties of a file that do not change its solids.

    sharing: a member of `SHARINGS`.
    unit: name of the unit of length.
    uncertainty: uncertainty of lengths, mm.
    gap: largest distance of faces that do not share their edges, mm.
    name: name of all entities in the file.
    """

    sharing: str
    unit: str
    uncertainty: float
    gap: float
    name: str


NAMES = ("''", "$", "'A 1'")
#: mm, and the entity of the unit.
UNITS = {
    "mm": (1.0, "(LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.))"),
    "m": (1000.0, "(LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT($,.METRE.))"),
    "inch": (25.4, "(CONVERSION_BASED_UNIT('INCH',{}) LENGTH_UNIT() NAMED_UNIT({}))"),
}


def make_spelling(rng: random.Random, sharing: str) -> Spelling:
    uncertainty = rng.choice((1e-5, 1e-3, 5e-3))
    gap = rng.choice((0.0, 0.5, 0.99)) * uncertainty
    return Spelling(sharing, rng.choice(list(UNITS)), uncertainty, gap, rng.choice(NAMES))


# The text (ISO 10303-21, AP214).


class Sheet:
    """Points, edges and vertices that faces share, shifted by (3,) mm."""

    def __init__(self, shift: FloatArray) -> None:
        self.shift = shift
        self.known: dict[tuple[object, ...], int] = {}


class Text:
    """The entities of a file in the order in which they are written."""

    def __init__(self, spelling: Spelling, rng: random.Random) -> None:
        self.spelling, self.rng = spelling, rng
        self.mm = UNITS[spelling.unit][0]
        self.rows: list[str] = []

    def add(self, text: str) -> int:
        """The number of a new entity. `~` in the text is its name."""
        self.rows.append(text.replace("~", self.spelling.name))
        return len(self.rows)

    def add_triple(self, kind: str, values: FloatArray) -> int:
        """A point or a direction in units of the file."""
        return self.add(f"{kind}(~,({','.join(f'{value:.13E}' for value in values)}))")

    def add_point(self, point: FloatArray) -> int:
        """A point, mm."""
        return self.add_triple("CARTESIAN_POINT", point / self.mm)

    def add_axes(self, origin: FloatArray, z: FloatArray, x: FloatArray) -> int:
        """Axes of a surface or a curve; the origin in mm."""
        place = self.add_point(origin)
        both = self.add_triple("DIRECTION", z), self.add_triple("DIRECTION", x)
        return self.add(f"AXIS2_PLACEMENT_3D(~,#{place},#{both[0]},#{both[1]})")

    def make_sheet(self, gap: float) -> Sheet:
        """A sheet that is shifted by half the gap in a random direction."""
        direction = np.array([self.rng.gauss(0, 1) for _ in range(3)])
        return Sheet(direction / np.linalg.norm(direction) * gap / 2)

    def add_solid(self, placed: Body) -> int:
        """A body, its faces on sheets as the spelling says."""
        faces = list_faces(placed.shape)
        common = Sheet(np.zeros(3))
        lone_face = self.rng.randrange(len(faces))
        numbers = []
        for k, face in enumerate(faces):
            is_apart = self.spelling.sharing == "unshared" or (
                self.spelling.sharing == "one face apart" and k == lone_face
            )
            sheet = self.make_sheet(self.spelling.gap) if is_apart else common
            numbers.append(self.add_face(placed, face, sheet))
        shell = self.add(f"CLOSED_SHELL(~,({','.join(f'#{n}' for n in numbers)}))")
        return self.add(f"MANIFOLD_SOLID_BREP(~,#{shell})")

    def add_face(self, placed: Body, face: Face, sheet: Sheet) -> int:
        """A face with its own bounds and surface."""
        bounds = []
        for k, loop in enumerate(face.loops):
            ends = []
            for edge, is_forward in loop:
                number = self.add_edge(placed, edge, sheet)
                ends.append(self.add(f"ORIENTED_EDGE(~,*,*,#{number},.{'FT'[is_forward]}.)"))
            listed = self.add(f"EDGE_LOOP(~,({','.join(f'#{n}' for n in ends)}))")
            kind = "FACE_BOUND" if k else "FACE_OUTER_BOUND"
            bounds.append(self.add(f"{kind}(~,#{listed},.T.)"))
        axes = self.add_axes(
            self.turn(placed, face.origin, sheet),
            placed.rotation @ face.z,
            placed.rotation @ face.x,
        )
        if face.radius:
            size = f"{face.radius / self.mm:.13E}"
            surface = self.add(f"CYLINDRICAL_SURFACE(~,#{axes},{size})")
        else:
            surface = self.add(f"PLANE(~,#{axes})")
        listed_bounds = ",".join(f"#{n}" for n in bounds)
        return self.add(f"ADVANCED_FACE(~,({listed_bounds}),#{surface},.{'FT'[face.is_along]}.)")

    @staticmethod
    def turn(placed: Body, point: FloatArray, sheet: Sheet) -> FloatArray:
        """A point of the body in the frame of the file, mm."""
        return placed.rotation @ point + placed.offset + sheet.shift

    def add_vertex(self, placed: Body, point: FloatArray, sheet: Sheet) -> int:
        """A vertex, once for each sheet."""
        key = ("vertex", *np.round(point, 9).tolist())
        if key not in sheet.known:
            number = self.add_point(self.turn(placed, point, sheet))
            sheet.known[key] = self.add(f"VERTEX_POINT(~,#{number})")
        return sheet.known[key]

    def add_edge(self, placed: Body, edge: Edge, sheet: Sheet) -> int:
        """An edge, once for each sheet."""
        key = ("edge", *np.round([*edge.start, *edge.end], 9).tolist(), edge.turns_left)
        if key in sheet.known:
            return sheet.known[key]
        start, end = (self.add_vertex(placed, p, sheet) for p in (edge.start, edge.end))
        if edge.center is None:
            along = edge.end - edge.start
            length = float(np.linalg.norm(along))
            origin = self.add_point(self.turn(placed, edge.start, sheet))
            direction = self.add_triple("DIRECTION", placed.rotation @ along / length)
            vector = self.add(f"VECTOR(~,#{direction},1.)")
            curve = self.add(f"LINE(~,#{origin},#{vector})")
        else:
            z = np.array([0.0, 0.0, 1.0 if edge.turns_left else -1.0])
            first = edge.start - edge.center
            radius = float(np.linalg.norm(first))
            axes = self.add_axes(
                self.turn(placed, edge.center, sheet),
                placed.rotation @ z,
                placed.rotation @ first / radius,
            )
            curve = self.add(f"CIRCLE(~,#{axes},{radius / self.mm:.13E})")
        sheet.known[key] = self.add(f"EDGE_CURVE(~,#{start},#{end},#{curve},.T.)")
        return sheet.known[key]


class Edge(NamedTuple):
    """An edge of a face, local frame, mm. center: (3,) of an arc, None for a line."""

    start: FloatArray
    end: FloatArray
    center: FloatArray | None = None
    turns_left: bool = True


class Face(NamedTuple):
    """A face, local frame.

    loops: edges, and whether each is run forward; counter-clockwise seen from outside.
    origin, z, x: axes of its surface.
    radius: radius of a cylinder, mm, 0 for a plane.
    is_along: whether the face looks where the normal of its surface does.
    """

    loops: list[list[tuple[Edge, bool]]]
    origin: FloatArray
    z: FloatArray
    x: FloatArray
    radius: float = 0.0
    is_along: bool = True


def raise_edge(segment: Segment, height: float) -> Edge:
    start, end = (np.array([*point, height]) for point in (segment.start, segment.end))
    center = None if segment.center is None else np.array([*segment.center, height])
    return Edge(start, end, center, segment.turns_left)


def list_faces(shape: Shape) -> list[Face]:
    """Both caps, then the walls."""
    up, along = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
    top = [list_rim(loop, shape.height, True) for loop in shape.loops]
    bottom = [list_rim(loop[::-1], 0.0, False) for loop in shape.loops]
    faces = [Face(bottom, 0 * up, -up, along), Face(top, shape.height * up, up, along)]
    return faces + [make_wall(segment, shape.height) for segment in chain(*shape.loops)]


def list_rim(loop: list[Segment], height: float, is_forward: bool) -> list[tuple[Edge, bool]]:
    return [(raise_edge(segment, height), is_forward) for segment in loop]


def make_wall(segment: Segment, height: float) -> Face:
    low, high = raise_edge(segment, 0.0), raise_edge(segment, height)
    first, last = Edge(low.start, high.start), Edge(low.end, high.end)
    loop = [(low, True), (last, True), (high, False), (first, False)]
    up = np.array([0.0, 0.0, 1.0])
    if low.center is None:
        along = (low.end - low.start) / np.linalg.norm(low.end - low.start)
        return Face([loop], low.start, np.cross(along, up), along)
    first_way = (low.start - low.center) / segment.radius
    return Face([loop], low.center, up, first_way, segment.radius, segment.turns_left)


def write(arrangement: Arrangement, spelling: Spelling, rng: random.Random) -> str:
    """The file."""
    text = Text(spelling, rng)
    context = add_context(text)
    solids = [text.add_solid(placed) for placed in arrangement.solids]
    origin = text.add_axes(np.zeros(3), np.eye(3)[2], np.eye(3)[0])
    items = ",".join(f"#{number}" for number in (origin, *solids))
    brep = text.add(f"ADVANCED_BREP_SHAPE_REPRESENTATION(~,({items}),#{context})")
    application = text.add("APPLICATION_CONTEXT('automotive design')")
    part = add_product(text, application, brep)
    if arrangement.instances:
        axes = [
            text.add_axes(body.offset, body.rotation[:, 2], body.rotation[:, 0])
            for body in arrangement.instances
        ]
        items = ",".join(f"#{number}" for number in (origin, *axes))
        whole = text.add(f"SHAPE_REPRESENTATION(~,({items}),#{context})")
        assembly = add_product(text, application, whole)
        for k, number in enumerate(axes):
            add_instance(text, (assembly, part), (whole, brep), (origin, number), k)
    body = "\n".join(f"#{k}={row};" for k, row in enumerate(text.rows, start=1))
    return (
        "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\n"
        "FILE_NAME('','',(''),(''),'','','');\n"
        "FILE_SCHEMA(('AUTOMOTIVE_DESIGN { 1 0 10303 214 1 1 1 1 }'));\nENDSEC;\nDATA;\n"
        f"{body}\nENDSEC;\nEND-ISO-10303-21;\n"
    )


def add_context(text: Text) -> int:
    """The context of the shapes, with units and uncertainty."""
    mm, unit = UNITS[text.spelling.unit]
    if text.spelling.unit == "inch":
        base = text.add(UNITS["mm"][1])
        size = text.add(f"LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),#{base})")
        none = text.add("DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.)")
        unit = unit.format(f"#{size}", f"#{none}")
    length = text.add(unit)
    angle = text.add("(NAMED_UNIT(*) PLANE_ANGLE_UNIT() SI_UNIT($,.RADIAN.))")
    solid = text.add("(NAMED_UNIT(*) SI_UNIT($,.STERADIAN.) SOLID_ANGLE_UNIT())")
    measure = f"LENGTH_MEASURE({text.spelling.uncertainty / mm:.7E})"
    accuracy = f"{measure},#{length},'distance_accuracy_value',''"
    uncertainty = text.add(f"UNCERTAINTY_MEASURE_WITH_UNIT({accuracy})")
    return text.add(
        "(GEOMETRIC_REPRESENTATION_CONTEXT(3) "
        f"GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT((#{uncertainty})) "
        f"GLOBAL_UNIT_ASSIGNED_CONTEXT((#{length},#{angle},#{solid})) "
        "REPRESENTATION_CONTEXT('',''))"
    )


def add_product(text: Text, application: int, representation: int) -> int:
    """A product with a shape; the number of its definition."""
    context = text.add(f"PRODUCT_CONTEXT(~,#{application},'mechanical')")
    product = text.add(f"PRODUCT('part',~,~,(#{context}))")
    formation = text.add(f"PRODUCT_DEFINITION_FORMATION('',~,#{product})")
    stage = text.add(f"PRODUCT_DEFINITION_CONTEXT('part definition',#{application},'design')")
    definition = text.add(f"PRODUCT_DEFINITION('design',~,#{formation},#{stage})")
    shape = text.add(f"PRODUCT_DEFINITION_SHAPE(~,~,#{definition})")
    text.add(f"SHAPE_DEFINITION_REPRESENTATION(#{shape},#{representation})")
    return definition


def add_instance(
    text: Text,
    definitions: tuple[int, int],
    representations: tuple[int, int],
    axes: tuple[int, int],
    number: int,
) -> None:
    """Puts the second definition into the first one, its first axes on the second ones."""
    whole, part = definitions
    usage = text.add(f"NEXT_ASSEMBLY_USAGE_OCCURRENCE('{number + 1}',~,~,#{whole},#{part},$)")
    shape = text.add(f"PRODUCT_DEFINITION_SHAPE(~,~,#{usage})")
    move = text.add(f"ITEM_DEFINED_TRANSFORMATION(~,~,#{axes[0]},#{axes[1]})")
    relation = text.add(
        f"(REPRESENTATION_RELATIONSHIP(~,~,#{representations[1]},#{representations[0]}) "
        f"REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION(#{move}) "
        "SHAPE_REPRESENTATION_RELATIONSHIP())"
    )
    text.add(f"CONTEXT_DEPENDENT_SHAPE_REPRESENTATION(#{relation},#{shape})")


# The judge.


def make(seed: int) -> tuple[Arrangement, str, str]:
    """The content of a file, its text, and its spelling in a few words."""
    rng = random.Random(seed)
    arrangement = list(ARRANGEMENTS.values())[seed % len(ARRANGEMENTS)](rng)
    spelling = make_spelling(rng, SHARINGS[seed // len(ARRANGEMENTS) % len(SHARINGS)])
    words = f"{spelling.unit}, {spelling.uncertainty:g} mm, gap {spelling.gap:g}, {spelling.name}"
    return arrangement, write(arrangement, spelling, rng), words


def assess(seed: int, folder: Path) -> tuple[str, str]:
    """The name of a column, and all differences from the formula."""
    arrangement, text, words = make(seed)
    path = folder / f"part{seed}.step"
    path.write_text(text)
    try:
        solid = camgen.read(path).solid
    except camgen.CamgenError as error:
        return "refused", f"{seed} ({words}): {str(error).partition(': ')[2][:60]}"
    concave = sum(not edge.convex for edge in solid.edges)
    size = np.ptp(solid.vertices, axis=0)
    wrong = []
    if not np.allclose(size, arrangement.measure_size(), atol=0.4):
        wrong.append(f"size {size.round(2).tolist()}")
    if (len(solid.edges), concave) != (arrangement.edges, arrangement.concave):
        wrong.append(
            f"edges {len(solid.edges)}, {concave} concave; "
            f"{arrangement.edges}, {arrangement.concave} by the formula"
        )
    if len(solid.bodies) != len(arrangement.bodies):
        wrong.append(f"bodies {len(solid.bodies)}; {len(arrangement.bodies)} by the formula")
    if not wrong:
        return "right", ""
    is_reported = any(note.kind in ("skipped", "warning") for note in solid.notes)
    return "reported" if is_reported else "silent", f"{seed} ({words}): {'; '.join(wrong)}"


def assess_group(number: int, sharing: str, seeds: range) -> Iterator[Cells]:
    """The row of an arrangement whose edges are shared or not."""
    counts = dict.fromkeys(("right", "reported", "silent", "refused"), 0)
    last = ""
    with tempfile.TemporaryDirectory() as folder:
        for seed in seeds:
            if seed % len(ARRANGEMENTS) != number:
                continue
            if SHARINGS[seed // len(ARRANGEMENTS) % len(SHARINGS)] != sharing:
                continue
            kind, text = assess(seed, Path(folder))
            counts[kind] += 1
            last = text or last
    missed = map(must_be_none, list(counts.values())[1:])
    name = list(ARRANGEMENTS)[number]
    yield name, sharing, sum(counts.values()), counts["right"], *missed, last


def describe(path: Path) -> Iterator[Cells]:
    """The row of a file."""
    solid = camgen.read(path).solid
    size = " x ".join(f"{v:.3f}" for v in np.ptp(solid.vertices, axis=0))
    kinds = Counter(f"{'convex' if e.convex else 'concave'} {e.kind}" for e in solid.edges)
    edges = ", ".join(f"{n} {kind}" for kind, n in sorted(kinds.items())) or "none"
    yield path.name, size, str(len(solid.bodies)), edges, "; ".join(map(str, solid.notes))


if __name__ == "__main__":
    first, count, *files = read_words(0, 30)
    seeds = range(first, first + count)
    groups = [(n, sharing, seeds) for sharing, n in product(SHARINGS, range(len(ARRANGEMENTS)))]
    scenario = Scenario(COLUMNS, groups, assess_group)
    if files:
        scenario = Scenario(FILE_COLUMNS, [(Path(f),) for f in files], describe, may_refuse=True)
    sys.exit(run(scenario))
