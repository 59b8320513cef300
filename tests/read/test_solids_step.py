"""The edges of a STEP file are as exact as the file, in its units, with both of their faces."""

import math
import re
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from camgen.geometry.arcs import find_circle
from camgen.model.errors import InputError
from camgen.model.part import Edge
from camgen.read.solid import kernel, mesh, step, step_file
from tests.read.test_solids_mesh import kinds
from tests.support.files import source

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
SHARED = Path(__file__).parents[2].parent / "shared" / "data"

occ = kernel.import_ocp
with_kernel = pytest.mark.skipif(
    find_spec("OCP") is None, reason="the extra step (the package OCP) is not installed"
)


def written(path: Path, shape: Any) -> Path:
    message = occ("Message")
    message.Message.DefaultMessenger_s().RemovePrinters(
        message.Message_PrinterOStream.get_type_descriptor_s()
    )
    control = occ("STEPControl")
    writer = control.STEPControl_Writer()
    writer.Transfer(shape, control.STEPControl_StepModelType.STEPControl_AsIs)
    writer.Write(str(path))
    return path


def cylinder(radius: float, height: float) -> Any:
    return occ("BRepPrimAPI").BRepPrimAPI_MakeCylinder(radius, height).Shape()


def box(low: tuple[float, ...], high: tuple[float, ...]) -> Any:
    gp = occ("gp")
    return occ("BRepPrimAPI").BRepPrimAPI_MakeBox(gp.gp_Pnt(*low), gp.gp_Pnt(*high)).Shape()


def sampled(edge: Edge) -> Any:
    """Points along the spans of an edge, 40 on each."""
    parts = []
    for p, via, q in zip(edge.points[:-1], edge.via, edge.points[1:], strict=True):
        circle = find_circle(p, via, q)
        assert circle is not None
        parts.append(circle.at(np.linspace(0, circle.angles(q[None])[0], 40)))
    return np.concatenate(parts)


def test_the_refusal_without_the_cad_kernel_names_the_extra(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def missing(name: str) -> Any:
        raise ModuleNotFoundError(f"No module named OCP.{name}")

    monkeypatch.setattr(kernel, "import_ocp", missing)
    remedy = r"pip install '\.\[step\]' in the folder of camgen"
    with pytest.raises(InputError, match=f"rfa1.step: STEP needs the CAD kernel; {remedy}"):
        step.read(source(PARTS / "rfa1.step"))


@with_kernel
@pytest.mark.parametrize("name", ["rfa1", "rfa2"])
def test_exact_and_meshed_parts_have_the_same_edges(name: str) -> None:
    exact = step.read(source(PARTS / f"{name}.step"))
    meshed = mesh.read(source(PARTS / f"{name}.stl"))
    assert exact.units == "mm"
    assert len(exact.edges) == len(meshed.edges)
    for a, b in zip(exact.edges, meshed.edges, strict=True):
        assert (a.id, a.kind, a.convex) == (b.id, b.kind, b.convex)
        assert a.length == pytest.approx(b.length, abs=1e-4)
        assert a.angle == pytest.approx(b.angle, abs=1e-5)
        if not a.closed:
            assert np.allclose(a.points, b.points, atol=1e-5)
            assert np.allclose(a.via, b.via, atol=1e-5)
            assert np.allclose(a.via_normals, b.via_normals, atol=1e-5)
    assert np.allclose(np.ptp(exact.vertices, axis=0), np.ptp(meshed.vertices, axis=0))


@with_kernel
def test_the_unit_of_the_file_counts(tmp_path: Path) -> None:
    text = (PARTS / "rfa1.step").read_text()
    assert text.count("SI_UNIT(.MILLI.,.METRE.)") == 1
    path = tmp_path / "big.step"
    path.write_text(text.replace("SI_UNIT(.MILLI.,.METRE.)", "SI_UNIT(.CENTI.,.METRE.)"))
    solid = step.read(source(path))
    assert solid.units == "cm"
    assert np.allclose(np.ptp(solid.vertices, axis=0), [1250, 950, 700])
    assert max(edge.radius for edge in solid.edges) == pytest.approx(250)


@with_kernel
def test_an_ellipse_is_a_curve_within_the_tolerance(tmp_path: Path) -> None:
    # The plane z = x + 30 cuts a cylinder of radius 10.
    gp, build = occ("gp"), occ("BRepBuilderAPI")
    corners = [gp.gp_Pnt(*corner) for corner in ((-20, -20, 10), (30, -20, 60), (-20, -20, 60))]
    wire = build.BRepBuilderAPI_MakePolygon(*corners, True).Wire()
    face = build.BRepBuilderAPI_MakeFace(wire, True).Face()
    wedge = occ("BRepPrimAPI").BRepPrimAPI_MakePrism(face, gp.gp_Vec(0, 40, 0)).Shape()
    cut = occ("BRepAlgoAPI").BRepAlgoAPI_Cut(cylinder(10, 60), wedge).Shape()
    solid = step.read(source(written(tmp_path / "cut.step", cut)), tolerance=0.005)
    assert kinds(solid) == {("curve", True): 1, ("circle", True): 1}
    edge = next(edge for edge in solid.edges if edge.kind == "curve")
    points = sampled(edge)
    assert np.abs(np.hypot(points[:, 0], points[:, 1]) - 10).max() < 0.006
    assert np.abs(points[:, 2] - points[:, 0] - 30).max() < 0.006
    t = np.linspace(0, 2 * np.pi, 200_001)
    perimeter = np.hypot(10 * np.cos(t), 10 * math.sqrt(2) * np.sin(t))[:-1].mean() * 2 * np.pi
    assert edge.length == pytest.approx(perimeter, rel=1e-5)
    slope = np.array([-1, 0, 1]) / math.sqrt(2)
    for point, normals in zip(edge.points, edge.normals, strict=True):
        radial = point * [0.1, 0.1, 0]
        # The normals of the two faces may be in either order.
        orders = ((slope, radial), (radial, slope))
        assert min(np.abs(normals - order).max(axis=1).sum() for order in orders) < 1e-6


@with_kernel
def test_splines_that_are_lines_and_circles_are_recognised(tmp_path: Path) -> None:
    block = box((-20, -20, 0), (20, 20, 8))
    ring = occ("BRepAlgoAPI").BRepAlgoAPI_Cut(block, cylinder(9, 8)).Shape()
    splines = occ("BRepBuilderAPI").BRepBuilderAPI_NurbsConvert(ring, True).Shape()
    path = written(tmp_path / "splines.step", splines)
    assert b"=CIRCLE" not in path.read_bytes().replace(b" ", b"")
    solid = step.read(source(path))
    assert kinds(solid) == {("line", True): 12, ("circle", True): 2}
    for edge in solid.edges:
        if edge.kind == "circle":
            assert edge.radius == pytest.approx(9, abs=1e-5)
            assert edge.length == pytest.approx(18 * math.pi, abs=1e-4)


@with_kernel
def test_a_fillet_leaves_no_edge_and_a_step_a_concave_one(tmp_path: Path) -> None:
    lower, upper = box((0, 0, 0), (40, 30, 10)), box((0, 0, 10), (15, 30, 20))
    fuse = occ("BRepAlgoAPI").BRepAlgoAPI_Fuse(lower, upper)
    fuse.SimplifyResult()
    solid = step.read(source(written(tmp_path / "step.step", fuse.Shape())))
    assert kinds(solid) == {("line", True): 17, ("line", False): 1}
    block = box((0, 0, 0), (40, 30, 10))
    edges = [member.edge for member in kernel.list_edges(block)]
    upright = next(edge for edge in edges if abs(kernel.Curve(edge).tangent(0.0)[2]) > 0.5)
    fillet = occ("BRepFilletAPI").BRepFilletAPI_MakeFillet(block)
    fillet.Add(4.0, upright)
    rounded = step.read(source(written(tmp_path / "round.step", fillet.Shape())))
    assert kinds(rounded) == {("line", True): 11, ("arc", True): 2}
    assert "2 below 30.05 deg" in "; ".join(map(str, rounded.notes))
    for edge in (edge for edge in rounded.edges if edge.kind == "arc"):
        assert edge.length == pytest.approx(2 * math.pi)


@with_kernel
def test_an_open_shell_has_borders(tmp_path: Path) -> None:
    sewing = occ("BRepBuilderAPI").BRepBuilderAPI_Sewing()
    sewing.Add(polygon((0, 0, 0), (10, 0, 0), (10, 10, 0), (0, 10, 0)))
    sewing.Add(polygon((0, 0, 0), (0, 0, 10), (10, 0, 10), (10, 0, 0)))
    sewing.Perform()
    solid = step.read(source(written(tmp_path / "shell.step", sewing.SewedShape())))
    assert len(solid.edges) == 1
    assert len(solid.borders) == 6
    assert "6 edges have a face on one side only" in "; ".join(map(str, solid.notes))


@with_kernel
@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "is not a STEP file"),
        (b"solid x\nendsolid x\n", "is not a STEP file"),
        (
            b"ISO-10303-21;\nHEADER;\nENDSEC;\nDATA;\n#1=FOO(;\nENDSEC;\n",
            "is not a STEP file, or damaged",
        ),
        (
            b"ISO-10303-21;\nHEADER;\nENDSEC;\nDATA;\nENDSEC;\nEND-ISO-10303-21;\n",
            "is damaged: entities are missing",
        ),
    ],
)
def test_a_file_that_is_not_a_step_file_is_refused(
    tmp_path: Path, data: bytes, message: str
) -> None:
    (tmp_path / "x.step").write_bytes(data)
    with pytest.raises(InputError, match=message) as caught:
        step.read(source(tmp_path / "x.step"))
    assert "\n" not in str(caught.value)


@with_kernel
@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("", "", "damaged"),
        ("PLANE('',", "PLAIN('',", "damaged"),
        ("VERTEX_POINT('',#", "VERTEX_POINT('',#9", "entities cannot be read"),
        ("LINE('',#", "LINE('',", "entities cannot be read"),
        ("0.,0.,1.)", "0.,0.,nan)", "entities cannot be read|no faces"),
    ],
)
def test_damage_at_which_the_kernel_would_leave_out_entities_is_refused(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    text = (PARTS / "rfa1.step").read_text()
    path = tmp_path / "damaged.step"
    assert old in text
    path.write_text(text.replace(old, new, 1) if old else text[: int(0.6 * len(text))])
    with pytest.raises(InputError, match=message) as caught:
        step.read(source(path))
    assert "\n" not in str(caught.value)


#: Faults of CAD programs in entities that no edge needs: a pattern in the sound text, the faulty
#: text that replaces it, and a part of the note.
HARMLESS_FAULTS = [
    (
        r"ADVANCED_FACE\('[^']*'",
        "ADVANCED_FACE($",
        "10 texts that are not given were read as empty",
    ),
    (r"\bPRODUCT\('[^']*'", "PRODUCT($", "1 text that is not given was read as empty"),
    (
        r"(UNCERTAINTY_MEASURE_WITH_UNIT\(LENGTH_MEASURE\([^)]*\),\s*#\d+),[^)]*\)",
        r"\1,$,$)",
        "2 texts that are not given were read as empty",
    ),
    (
        r"(ENDSEC;\s*END-ISO)",
        r"#9001=CURVE_STYLE('',$,POSITIVE_LENGTH_MEASURE(0.1),#9002);\n"
        r"#9002=COLOUR_RGB('a;b #1=',1.,0.,0.);\n"
        r"#9003=PRESENTATION_STYLE_ASSIGNMENT((#9001));\n#9004=STYLED_ITEM('',(#9003),#15);\n\1",
        "1 entity that cannot be read was left out: 1 CURVE_STYLE",
    ),
    (
        r"(ENDSEC;\s*END-ISO)",
        r"#9004=STYLED_ITEM('',(#9003),#15);\n\1",
        "1 entity that cannot be read was left out: 1 STYLED_ITEM",
    ),
    (
        r"(ADVANCED_BREP_SHAPE_REPRESENTATION\('',\(#\d+,#15)\)(.*?)(ENDSEC;\s*END-ISO)",
        r"\1,#9001)\2#9001=TEXT_LITERAL('','R1',#11,'left',.RIGHT.,#9002);\n"
        r"#9002=COLOUR_RGB('',1.,0.,0.);\n\3",
        "1 TEXT_LITERAL",
    ),
    (
        r"\(\(#662,#663,#664\)\)(.*?)(ENDSEC;\s*END-ISO)",
        r"((#662,#663,#664,#9001))\1#9001=(MASS_UNIT() NAMED_UNIT(7) SI_UNIT(.KILO.,.GRAMM.));\n\2",
        "UNIT",
    ),
]


@with_kernel
@pytest.mark.parametrize(("old", "new", "message"), HARMLESS_FAULTS)
def test_faulty_entities_that_no_edge_needs_are_noted_and_the_part_is_read(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    text = (PARTS / "rfa1.step").read_text()
    damaged_text, count = re.subn(old, new, text, flags=re.DOTALL)
    assert count
    (tmp_path / "rfa1.step").write_text(damaged_text)
    damaged = step.read(source(tmp_path / "rfa1.step"))
    sound = step.read(source(PARTS / "rfa1.step"))
    notes = [str(note) for note in damaged.notes if note.kind in ("repaired", "assumed")]
    assert message in "; ".join(notes)
    assert len(damaged.edges) == len(sound.edges)
    for a, b in zip(damaged.edges, sound.edges, strict=True):
        assert np.array_equal(a.points, b.points)
    assert np.array_equal(damaged.vertices, sound.vertices)


@with_kernel
@pytest.mark.parametrize(
    ("old", "new", "needed"),
    [
        # The face and its parts.
        (r"ADVANCED_FACE\('([^']*)',\(#\d+\)", r"ADVANCED_FACE('\1',(#662)", "ADVANCED_FACE"),
        # A body of a kind that the kernel does not know, besides the body of a known kind.
        (
            r"(ADVANCED_BREP_SHAPE_REPRESENTATION\('',\(#\d+,#15)\)(.*?)(ENDSEC;\s*END-ISO)",
            r"\1,#9001)\2#9001=FOAM_BREP('',#16);\n\3",
            "ADVANCED_BREP_SHAPE_REPRESENTATION",
        ),
        # The unit of all lengths.
        (r"\(\(#662,#663,#664\)\)", "((#15,#663,#664))", "CONTEXT"),
        (
            r"SHAPE_DEFINITION_REPRESENTATION\(#(\d+),#(\d+)\)",
            r"SHAPE_DEFINITION_REPRESENTATION(#\1,#662)",
            "",
        ),
    ],
)
def test_a_faulty_entity_that_the_edges_need_is_refused(
    tmp_path: Path, old: str, new: str, needed: str
) -> None:
    text = (PARTS / "rfa1.step").read_text()
    damaged_text, count = re.subn(old, new, text, count=1, flags=re.DOTALL)
    assert count
    (tmp_path / "rfa1.step").write_text(damaged_text)
    with pytest.raises(
        InputError, match=f"is damaged: .* and the part needs #.*{needed}|holds no shape"
    ) as caught:
        step.read(source(tmp_path / "rfa1.step"))
    assert not needed or needed in str(caught.value)


@with_kernel
def test_a_wireframe_and_parts_in_other_files_are_refused_with_their_reason(tmp_path: Path) -> None:
    gp, build = occ("gp"), occ("BRepBuilderAPI")
    wire = build.BRepBuilderAPI_MakePolygon(
        gp.gp_Pnt(0, 0, 0), gp.gp_Pnt(9, 0, 0), gp.gp_Pnt(9, 9, 0)
    ).Wire()
    path = written(tmp_path / "wire.step", wire)
    with pytest.raises(InputError) as caught:
        step.read(source(path))
    assert str(caught.value) == (
        "wire.step: is a wireframe: 2 curves and no faces "
        "(the edge of a solid lies between two faces); export the part as a solid"
    )
    end = "ENDSEC;\nEND-ISO"
    document = "#9001=DOCUMENT_FILE('a ''left''.stp','','',#9002,'',$);\n"
    document += "#9002=DOCUMENT_TYPE('geometry');\n"
    (tmp_path / "wire.step").write_text(path.read_text().replace(end, document + end))
    with pytest.raises(
        InputError,
        match=r"holds no shape: its parts are in another file \(a _left_\.stp\); build these",
    ):
        step.read(source(path))
    whole = (PARTS / "rfa1.step").read_text()
    (tmp_path / "more.step").write_text(whole.replace(end, document + end))
    solid = step.read(source(tmp_path / "more.step"))
    notes = [str(note) for note in solid.notes if note.kind == "skipped"]
    assert notes == ["skipped: what is in other files: a _left_.stp (build them one by one)"]


@with_kernel
def test_an_implausible_size_is_a_warning(tmp_path: Path) -> None:
    for size, message, unit in (
        (0.17, "0.17 x 0.17 x 0.17 mm, which is small", "m"),
        (9999.0, "which is large", "um"),
        (100.0, "", ""),
    ):
        cube = box((0, 0, 0), (size, size, size))
        solid = step.read(source(written(tmp_path / "cube.step", cube)))
        notes = [note for note in solid.notes if "which is" in note.what]
        assert bool(notes) == bool(message)
        for note in notes:
            assert message in note.what
            remedy = "export it again in another one if that is not meant"
            assert note.why == f"drawn in mm, likely in {unit}; {remedy}"


@with_kernel
def test_a_shared_part_has_the_circles_of_its_mesh() -> None:
    exact = SHARED / "step/trimesh/featuretype.STEP"
    meshed = SHARED / "mesh/trimesh/featuretype.STL"
    if not exact.exists():
        pytest.skip("shared/data/step/trimesh/featuretype.STEP is not beside the repository")
    radii = []
    for solid in (step.read(source(exact)), mesh.read(source(meshed), mm=25.4)):
        radii.append(sorted(edge.radius for edge in solid.edges if edge.kind == "circle"))
    assert len(radii[0]) == 34
    assert np.allclose(*radii, atol=1e-4)


@with_kernel
@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"(200.,45.,100.)", b"(200.,45.100.)", "is damaged: it ends the CAD kernel"),
        (
            b"(200.,45.,100.)",
            b"(200.,1e20,100.)",
            "is damaged: a point at 1e20, no part is so large",
        ),
    ],
)
def test_a_file_that_ends_the_process_of_the_kernel_is_refused(
    old: bytes, new: bytes, message: str, tmp_path: Path
) -> None:
    """Both faults, found by bench.reliability.inputs, end the process that calls OCCT."""
    sound = (PARTS / "rfa2.step").read_bytes()
    assert old in sound
    (tmp_path / "part.step").write_bytes(sound.replace(old, new, 1))
    with pytest.raises(InputError, match=re.escape(message)):
        step_file.read_bodies(source(tmp_path / "part.step"))


def polygon(*corners: tuple[float, float, float]) -> Any:
    """A flat face with these corners."""
    build, gp = occ("BRepBuilderAPI"), occ("gp")
    wire = build.BRepBuilderAPI_MakePolygon()
    for corner in corners:
        wire.Add(gp.gp_Pnt(*corner))
    wire.Close()
    return build.BRepBuilderAPI_MakeFace(wire.Wire(), True).Face()


def enclose(faces: list[Any]) -> Any:
    """A solid of faces that share no edges."""
    builder, topods = occ("BRep").BRep_Builder(), occ("TopoDS")
    shell, solid = topods.TopoDS_Shell(), topods.TopoDS_Solid()
    builder.MakeShell(shell)
    for face in faces:
        builder.Add(shell, face)
    builder.MakeSolid(solid)
    builder.Add(solid, shell)
    return solid


@with_kernel
def test_an_edge_along_two_shorter_ones_is_divided_and_sewn(tmp_path: Path) -> None:
    """The top of a box has a vertex in its front edge, at x = 25. The 13 sewn edges become 12."""
    a, b, c, d = (0, 0, 0), (60, 0, 0), (60, 40, 0), (0, 40, 0)
    e, f, g, h = (0, 0, 20), (60, 0, 20), (60, 40, 20), (0, 40, 20)
    sides = [(a, b, f, e), (b, c, g, f), (c, d, h, g), (d, a, e, h), (a, d, c, b)]
    faces = [polygon(e, (25, 0, 20), f, g, h), *(polygon(*side) for side in sides)]
    solid = step.read(source(written(tmp_path / "box.step", enclose(faces))))
    assert kinds(solid) == {("line", True): 12}
    assert not solid.borders
    assert "13 edges that faces did not share were sewn" in str(solid.notes[0])


@with_kernel
@pytest.mark.parametrize("name", ["cone", "ball"])
def test_a_plug_that_fills_a_block_leaves_no_seam(tmp_path: Path, name: str) -> None:
    """A block with a conical or spherical hollow and its plug have 12 edges and are two bodies."""
    primitive, boolean = occ("BRepPrimAPI"), occ("BRepAlgoAPI")
    block = box((-20, -20, -20), (20, 20, 0))
    if name == "cone":
        plug = primitive.BRepPrimAPI_MakeCone(5.0, 10.0, 20.0).Shape()
        block = box((-20, -20, 0), (20, 20, 20))
    else:
        sphere = primitive.BRepPrimAPI_MakeSphere(12.0).Shape()
        plug = boolean.BRepAlgoAPI_Common(sphere, block).Shape()
    hollow = boolean.BRepAlgoAPI_Cut(block, plug).Shape()
    solid = step.read(source(written(tmp_path / "two.step", kernel.make_compound([hollow, plug]))))
    assert kinds(solid) == {("line", True): 12}
    assert solid.bodies == ("", "")
