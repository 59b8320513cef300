"""Contours have the positions, arcs, layers and units of a DXF drawing. A note names the rest."""

import importlib.util
import io
import math
from itertools import product
from pathlib import Path
from types import ModuleType
from typing import Any

import ezdxf
import numpy as np
import pytest
from ezdxf.document import Drawing
from ezdxf.xclip import XClip

from camgen.model.errors import InputError, JobError
from camgen.model.files import Source
from camgen.model.job import InputTable, Job, ToleranceTable
from camgen.model.part import Contour, Part
from camgen.read import dxf
from camgen.read.files import Files
from tests.support.files import source

FIXTURES = Path(__file__).parents[2] / "fixtures"
REFUSED = sorted(FIXTURES.glob("refused/*.dxf"))


def load_maker() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_dxf", FIXTURES / "make_dxf.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def new(units: int = 4, version: str = "R2010") -> tuple[Drawing, Any]:
    document = ezdxf.new(version)
    document.header["$INSUNITS"] = units
    return document, document.modelspace()


def read_bytes(name: str, data: bytes, settings: InputTable, chord: float) -> Part:
    job = Job(input=settings, tolerance=ToleranceTable(chord=chord))
    return dxf.read(Source(Path(name), data), job, Files())


def read(document: Drawing, **settings: Any) -> Part:
    return read_bytes("test.dxf", written(document).encode(), InputTable(**settings), 0.01)


def written(document: Drawing) -> str:
    text = io.StringIO()
    document.write(text)
    return text.getvalue()


def notes(part: Part) -> list[str]:
    return [str(note) for note in part.notes]


def length(contour: Contour) -> float:
    """Length of the lines and arcs of a contour, mm."""
    chords, sweeps = measure_segments(contour)
    # The chord of an arc is its length times sin(sweep / 2) / (sweep / 2).
    lengths = chords / np.sinc(sweeps / (2 * math.pi))
    return float(lengths.sum() if contour.closed else lengths[:-1].sum())


def area(contour: Contour) -> float:
    """Signed area, mm2, by the shoelace formula plus the segments of the arcs."""
    chords, sweeps = measure_segments(contour)
    x, y = contour.points.T
    with np.errstate(divide="ignore", invalid="ignore"):
        segments = (chords / (2 * np.sin(sweeps / 2))) ** 2 * (sweeps - np.sin(sweeps))
    twice = x @ np.roll(y, -1) - y @ np.roll(x, -1) + np.where(sweeps == 0, 0, segments).sum()
    return float(twice / 2)


def measure_segments(contour: Contour) -> tuple[np.ndarray, np.ndarray]:
    """Chords, mm, and signed sweeps, rad, of the lines and arcs, and from the last point back."""
    chords = np.hypot(*(np.roll(contour.points, -1, axis=0) - contour.points).T)
    return chords, 4 * np.arctan(contour.bulges)


# -- drawings of the fixtures


@pytest.mark.parametrize("name", ["bracket", "bracket_binary"])
def test_a_bracket_of_arcs_and_lines_is_read_from_text_and_binary(name: str) -> None:
    part = dxf.read(source(FIXTURES / "parts" / f"{name}.dxf"), Job(), Files())
    outline, hole, other_hole, slot = part.contours
    assert [c.layer for c in part.contours] == ["OUTLINE", "HOLES", "HOLES", "HOLES"]
    assert all(c.closed for c in part.contours)
    assert (part.units, part.source, part.notes) == ("mm", f"{name}.dxf", ())
    assert length(outline) == pytest.approx(2 * 60 + 2 * 30 + 20 * math.pi)
    assert area(outline) == pytest.approx(80 * 50 - (4 - math.pi) * 100)
    assert length(hole) == length(other_hole) == pytest.approx(8 * math.pi)
    assert abs(area(slot)) == pytest.approx(20 * 10 + 25 * math.pi)


def test_gaps_are_closed_and_duplicates_dropped_with_notes() -> None:
    part = dxf.read(source(FIXTURES / "parts" / "gaps.dxf"), Job(), Files())
    assert [(c.closed, len(c.points)) for c in part.contours] == [(True, 4)]
    assert notes(part) == [
        "repaired: dropped: 1 LINE on layer 0 (without length)",
        "repaired: dropped: 1 LINE on layer 0 (drawn twice; each is used once)",
        "joined: gaps closed: 1, largest 0.03 mm (ends closer than input.join = 0.05 mm meet)",
    ]


def test_an_ellipse_and_a_spline_keep_their_length_and_area() -> None:
    part = dxf.read(source(FIXTURES / "parts" / "smooth.dxf"), Job(), Files())
    t = np.linspace(0, 2 * math.pi, 200001)
    oval, drop = part.contours
    assert oval.closed
    assert drop.closed
    ellipse = np.column_stack([50 * np.cos(t), 20 * np.sin(t)])
    assert length(oval) == pytest.approx(_polygon_length(ellipse), rel=1e-4)
    assert area(oval) == pytest.approx(math.pi * 50 * 20, rel=1e-4)
    u = np.linspace(0, 1, 200001)[:, None]
    c = np.array([(100, 0), (140, 60), (60, 60), (100, 0.0)])
    bezier = (
        (1 - u) ** 3 * c[0] + 3 * u * (1 - u) ** 2 * c[1] + 3 * u * u * (1 - u) * c[2] + u**3 * c[3]
    )
    assert length(drop) == pytest.approx(_polygon_length(bezier), rel=1e-4)


def test_references_of_blocks_are_mirrored_stretched_and_repeated() -> None:
    """In inches: a tab, a mirrored tab, a tab of twice the width, and an array of six tabs."""
    part = dxf.read(source(FIXTURES / "parts" / "blocks.dxf"), Job(), Files())
    assert len(part.contours) == 18
    assert {c.layer for c in part.contours} == {"CUT"}
    tab = (0.5 + math.pi * 0.25**2 / 2) * 25.4**2
    hole = math.pi * 0.125**2 * 25.4**2
    areas = sorted(abs(area(c)) for c in part.contours)
    # The arcs of the stretched tab, about 80 mm long, are fitted to 0.01 mm.
    assert areas == pytest.approx(sorted([tab] * 8 + [hole] * 8 + [2 * tab, 2 * hole]), rel=5e-4)
    mirrored = part.contours[2]
    assert mirrored.points / 25.4 == pytest.approx(np.array([(4, 0), (3, 0), (3, 0.5), (4, 0.5)]))
    assert mirrored.bulges.tolist() == pytest.approx([0, -1, 0, 0])
    last = part.contours[-2]
    assert last.points[0] / 25.4 == pytest.approx([10, 1])


def test_layers_that_are_off_or_frozen_are_skipped_and_listed() -> None:
    path = FIXTURES / "parts" / "layers.dxf"
    part = dxf.read(source(path), Job(), Files())
    assert [c.layer for c in part.contours] == ["CUT"]
    assert notes(part) == [
        "skipped: 1 CIRCLE on layer HIDDEN (the layer is off)",
        "skipped: 1 CIRCLE on layer ICE (the layer is frozen)",
        "skipped: 1 TEXT on layer 0 (not a kind of curve that is machined)",
    ]
    facts = dxf.inspect(source(path), Job(), Files())
    assert facts.counts == (("CIRCLE", 2), ("LWPOLYLINE", 1), ("TEXT", 1))
    assert [(layer.name, layer.state) for layer in facts.layers] == [
        ("0", "used"),
        ("CUT", "used"),
        ("HIDDEN", "the layer is off"),
        ("ICE", "the layer is frozen"),
    ]
    assert (facts.version, facts.units) == ("AC1015 (R2000)", "mm")
    assert (facts.closed, facts.open, facts.size) == (1, 0, (20, 20))
    assert "contours: 1 closed, 0 open" in str(facts).splitlines()


@pytest.mark.parametrize("path", REFUSED, ids=lambda path: path.stem)
def test_a_drawing_that_cannot_be_used_is_refused(path: Path) -> None:
    expected = path.with_suffix(".txt").read_text().splitlines()[0]
    with pytest.raises(InputError) as caught:
        dxf.read(source(path), Job(), Files())
    assert str(caught.value) == expected


def test_the_drawings_of_the_fixtures_are_those_of_their_maker(tmp_path: Path) -> None:
    load_maker().main(tmp_path)
    paths = sorted(path.relative_to(tmp_path) for path in tmp_path.rglob("*.*"))
    assert len(paths) > 20
    for path in paths:
        assert (FIXTURES / path).read_bytes() == (tmp_path / path).read_bytes()


# -- entities


def test_an_extrusion_downwards_mirrors_x() -> None:
    """An arc from 0 to 90 deg around (10, 0) runs from (-15, 0) to (-10, 5)."""
    document, space = new()
    space.add_arc((10, 0), 5, 0, 90, dxfattribs={"extrusion": (0, 0, -1)})
    space.add_lwpolyline(
        [(0, 20, 1), (10, 20, 0)], format="xyb", dxfattribs={"extrusion": (0, 0, -1)}
    )
    arc, bow = read(document).contours
    assert arc.points == pytest.approx(np.array([(-15, 0), (-10, 5)]), abs=1e-12)
    assert arc.bulges[0] == pytest.approx(-math.tan(math.pi / 8))
    assert bow.points == pytest.approx(np.array([(0, 20), (-10, 20)]))
    assert bow.bulges[0] == pytest.approx(-1)


def test_a_circle_in_a_stretched_block_is_an_ellipse() -> None:
    document, space = new()
    block = document.blocks.new("HOLE", base_point=(1, 1))
    block.add_circle((1, 1), 10)
    space.add_blockref("HOLE", (100, 50), dxfattribs={"xscale": 3, "yscale": 1, "rotation": 90})
    (oval,) = read(document).contours
    assert oval.closed
    # With half axes of 10 and 30 mm, each point satisfies the equation within the tolerance.
    x, y = ((oval.points - (100, 50)) / (10, 30)).T
    assert np.hypot(x, y) == pytest.approx(1, abs=0.01 / 10)
    assert area(oval) == pytest.approx(math.pi * 300, rel=1e-4)


def test_an_arc_in_a_stretched_block_is_an_elliptic_arc() -> None:
    """A half disc of radius 5, twice as wide in x, is half an ellipse."""
    document, space = new()
    document.blocks.new("D").add_lwpolyline([(5, 0, 1), (-5, 0, 0)], format="xyb", close=True)
    space.add_blockref("D", (0, 0), dxfattribs={"xscale": 2})
    (shape,) = read(document).contours
    assert area(shape) == pytest.approx(math.pi * 10 * 5 / 2, rel=5e-4)


def test_an_array_is_rotated_and_its_spacing_is_not_scaled() -> None:
    document, space = new()
    document.blocks.new("P").add_circle((1, 0), 1)
    scales = {"rotation": 90, "xscale": 2, "yscale": 2}
    grid = {"row_count": 2, "column_count": 3, "row_spacing": 20, "column_spacing": 10}
    space.add_blockref("P", (0, 0), dxfattribs=scales | grid)
    contours = read(document).contours
    centres = {tuple(np.round(contour.points.mean(axis=0), 9).tolist()) for contour in contours}
    # Columns run along the rotated x, which is up, and rows along the rotated y, which is left.
    # Each circle is 2 mm above the corner of its cell.
    assert len(contours) == 6
    assert centres == set(product((-20.0, 0.0), (2.0, 12.0, 22.0)))


def test_layer_0_in_a_block_is_the_layer_of_the_reference() -> None:
    document, space = new()
    for name in ("GONE", "CUT", "OWN"):
        document.layers.add(name)
    document.layers.get("GONE").off()
    block = document.blocks.new("B")
    block.add_circle((0, 0), 5)
    block.add_circle((0, 0), 8, dxfattribs={"layer": "OWN"})
    space.add_blockref("B", (0, 0), dxfattribs={"layer": "CUT"})
    space.add_blockref("B", (50, 0), dxfattribs={"layer": "GONE"})
    part = read(document)
    assert [(c.layer, round(float(c.points[0][0]))) for c in part.contours] == [
        ("CUT", 5),
        ("OWN", 8),
        ("OWN", 58),
    ]
    document.layers.get("GONE").on()
    document.layers.get("GONE").freeze()
    part = read(document)
    assert len(part.contours) == 2
    assert notes(part) == ["skipped: 1 INSERT on layer GONE (the layer is frozen)"]


def test_references_that_cannot_be_used_are_skipped_with_a_note() -> None:
    document, space = new()
    space.add_circle((0, 0), 5)
    loop = document.blocks.new("LOOP")
    loop.add_circle((0, 0), 7)
    loop.add_blockref("LOOP", (1, 1))
    space.add_blockref("LOOP", (0, 0))
    space.add_blockref("MISSING", (0, 0))
    space.add_blockref("NAMELESS", (0, 0))
    space.add_blockref("LOOP", (0, 0), dxfattribs={"xscale": 0.125})
    document.add_xref_def("other.dxf", "OTHER")
    space.add_blockref("OTHER", (0, 0))
    # ezdxf reads a scale of 0 and a reference without a name, but does not write them.
    text = written(document).replace(" 41\n0.125\n", " 41\n0.0\n").replace("  2\nNAMELESS\n", "")
    part = read_bytes("test.dxf", text.encode(), InputTable(), 0.01)
    line = text.splitlines().index("3A") - 1
    assert len(part.contours) == 2
    assert notes(part) == [
        f"skipped: INSERT #3A on layer 0 (line {line}: group 2 is missing; open it in the CAD "
        "program and save it again as DXF)",
        "skipped: 1 INSERT on layer 0: #34 (its block contains itself)",
        "skipped: 1 INSERT on layer 0: #38 (its block 'MISSING' is missing)",
        "skipped: 1 INSERT on layer 0: #3C (scaled to nothing)",
        "skipped: 1 INSERT on layer 0: #41 (an external reference, not in this file)",
    ]


def test_a_clipped_reference_is_skipped() -> None:
    document, space = new()
    document.blocks.new("B").add_circle((0, 0), 5)
    space.add_blockref("B", (50, 0))
    XClip(space.add_blockref("B", (0, 0))).set_block_clipping_path([(0, 0), (4, 4)])
    part = read(document)
    assert len(part.contours) == 1
    assert notes(part) == [
        "skipped: 1 INSERT on layer 0: #35 (clipped (XCLIP), which is not supported; explode it)"
    ]


def test_blocks_that_expand_to_too_many_entities_are_refused() -> None:
    document, space = new()
    document.blocks.new("B0").add_circle((0, 0), 5)
    for i in range(1, 4):
        grid = {"row_count": 2000, "column_count": 2000, "row_spacing": 1, "column_spacing": 1}
        document.blocks.new(f"B{i}").add_blockref(f"B{i - 1}", (0, 0), dxfattribs=grid)
    space.add_blockref("B3", (0, 0))
    with pytest.raises(InputError, match="blocks expand to more than 1,000,000 entities"):
        read(document)


def test_flat_curves_at_any_height_are_used_and_others_skipped() -> None:
    document, space = new()
    space.add_circle((0, 0, 5), 10)
    space.add_polyline3d([(0, 0, 2), (10, 0, 2), (10, 10, 2)], close=True)
    space.add_line((0, 0, 0), (10, 0, 3), dxfattribs={"layer": "STEEP"})
    space.add_circle((0, 0), 10, dxfattribs={"extrusion": (0, 1, 0)})
    space.add_ellipse((0, 0), (10, 0, 1), 0.5)
    space.add_spline([(0, 0, 0), (5, 5, 0), (10, 0, 1)])
    part = read(document)
    assert len(part.contours) == 2
    skipped, height = notes(part)
    assert skipped.startswith("skipped: LINE #")
    assert "on layer STEEP leaves the plane by 3 mm; CIRCLE #" in skipped
    assert "on layer 0 leaves the plane by 20 mm; ELLIPSE #" in skipped
    assert skipped.count("leaves the plane") == 4
    assert height == "assumed: curves drawn at z = 2 to 5 mm (taken as lying in the work plane)"


def test_polylines_of_r12_are_read_and_meshes_skipped() -> None:
    document, space = new(version="R12")
    space.add_polyline2d([(0, 0, 0, 0, 1), (10, 0, 0, 0, 0)], format="xyseb", close=True)
    fitted = space.add_polyline2d([(20, 0), (25, 5), (30, 0)], dxfattribs={"flags": 4})
    fitted.vertices[1].dxf.flags = 16
    space.add_polymesh((3, 3))
    part = read(document, units="mm")
    assert [c.points.tolist() for c in part.contours] == [[[0, 0], [10, 0]], [[20, 0], [30, 0]]]
    assert part.contours[0].bulges.tolist() == [1, 0]
    assert notes(part)[0] == "skipped: 1 POLYLINE on layer 0: #36 (a mesh)"


def test_thickness_and_width_are_ignored_with_a_note() -> None:
    document, space = new()
    space.add_circle((0, 0), 10, dxfattribs={"thickness": 3})
    space.add_lwpolyline([(20, 0), (30, 0)], dxfattribs={"const_width": 2})
    assert notes(read(document))[:2] == [
        "assumed: with thickness: 1 CIRCLE on layer 0 (the curve itself is used)",
        "assumed: with width: 1 LWPOLYLINE on layer 0 (the centre line is used)",
    ]


def test_a_spline_by_fit_points_runs_through_them() -> None:
    document, space = new()
    through = [(0, 0), (10, 8), (25, -3), (40, 5)]
    space.add_spline(through)
    (curve,) = read(document).contours
    for p in through:
        assert np.hypot(*(curve.points - p).T).min() < 5
    assert curve.points[0] == pytest.approx(through[0])
    assert curve.points[-1] == pytest.approx(through[-1])
    assert length(curve) == pytest.approx(_dense_length(space[0]), rel=1e-4)


def _dense_length(spline: Any) -> float:
    points = np.array([point.xyz for point in spline.construction_tool().approximate(20000)])
    return _polygon_length(points[:, :2])


def _polygon_length(points: np.ndarray) -> float:
    return float(np.hypot(*np.diff(points, axis=0).T).sum())


def test_an_arc_of_a_full_turn_is_closed_and_one_of_no_turn_dropped() -> None:
    document, space = new()
    space.add_arc((0, 0), 10, 0, 360)
    space.add_arc((50, 0), 10, 30, 30)
    space.add_ellipse((100, 0), (10, 0), 1.0)
    space.add_arc((150, 0), 10, 350, 300)
    part = read(document)
    assert [c.closed for c in part.contours] == [True, True, False]
    assert [length(c) for c in part.contours] == pytest.approx(
        [20 * math.pi, 20 * math.pi, 20 * math.pi * 310 / 360]
    )
    assert len(part.contours[1].points) == 2
    assert "repaired: dropped: 1 ARC on layer 0 (without length)" in notes(part)


def test_a_nearly_straight_arc_keeps_its_height() -> None:
    """With a chord of 100 and a radius r of 1e7, the arc is 100^2 / (8 r) = 0.000125 high."""
    document, space = new()
    space.add_lwpolyline([(0, 0, 2 * 0.000125 / 100), (100, 0, 0)], format="xyb")
    (arc,) = read(document).contours
    assert arc.bulges[0] * 100 / 2 == pytest.approx(0.000125)


def test_each_entity_that_is_not_used_has_a_note() -> None:
    document, space = new()
    space.add_circle((0, 0), 5)
    space.add_circle((0, 0), 6, dxfattribs={"invisible": 1})
    space.add_text("A")
    space.add_point((0, 0))
    space.add_hatch().paths.add_polyline_path([(0, 0), (1, 0), (1, 1)])
    document.layout("Layout1").add_circle((0, 0), 7)
    part = read(document)
    assert len(part.contours) == 1
    assert notes(part) == [
        "skipped: 1 CIRCLE on layer 0 (invisible)",
        "skipped: 1 HATCH, 1 TEXT on layer 0 (not a kind of curve that is machined)",
        "skipped: 1 CIRCLE on layer 0 (in paper space)",
        'skipped: 1 POINT on layer 0 (a place to drill, by operation.kind = "drill" without '
        "operation.holes)",
    ]


# -- settings


@pytest.mark.parametrize(
    ("code", "units", "mm"),
    [
        (1, "auto", 25.4),
        (6, "auto", 1000),
        (5, "auto", 10),
        (0, "auto", 1),
        (6, "mm", 1),
        (4, "Inch", 25.4),
        (4, "ft", 304.8),
    ],
)
def test_units_come_from_the_file_or_the_job(code: int, units: str, mm: float) -> None:
    document, space = new(code)
    space.add_circle((0, 0), 2)
    part = read(document, units=units)
    assert length(part.contours[0]) == pytest.approx(4 * math.pi * mm)
    assert any(note.kind == "assumed" for note in part.notes) == (code == 0)
    is_large = any("is large" in note.what and "input.units" in note.why for note in part.notes)
    assert is_large == (units == "auto" and 4 * mm > 3000)


def test_a_file_without_header_has_no_unit() -> None:
    data = b"0\nSECTION\n2\nENTITIES\n0\nCIRCLE\n8\n0\n10\n0\n20\n0\n40\n10\n0\nENDSEC\n0\nEOF\n"
    part = read_bytes("bare.dxf", data, InputTable(), 0.01)
    assert length(part.contours[0]) == pytest.approx(20 * math.pi)
    assert notes(part) == [
        "assumed: 1 drawing unit = 1 mm "
        "(the file states no unit; set input.units if that is not meant)"
    ]


def test_an_unknown_unit_is_refused_with_a_suggestion() -> None:
    document, space = new()
    space.add_circle((0, 0), 2)
    with pytest.raises(
        JobError, match=r"test.dxf: unknown unit 'inchs' \(input.units\); did you mean inch"
    ):
        read(document, units="inchs")


@pytest.mark.parametrize(
    ("globs", "radii"),
    [
        (["*"], [1, 2, 3]),
        (["hole*"], [2, 3]),
        (["!HOLES_B"], [1, 2]),
        (["hole*", "!*_b"], [2]),
        (["outline", "HOLES_B"], [1, 3]),
    ],
)
def test_patterns_of_layers_select_contours(globs: list[str], radii: list[int]) -> None:
    document, space = new()
    for i, name in enumerate(("Outline", "Holes_A", "Holes_B"), start=1):
        space.add_circle((10 * i, 0), i, dxfattribs={"layer": name})
    part = read(document, layers=globs)
    assert [round(length(c) / (2 * math.pi)) for c in part.contours] == radii
    reasons = [note.why for note in part.notes if note.kind == "assumed"]
    assert sum("left out by input.layers" in why for why in reasons) == (len(radii) < 3)


@pytest.mark.parametrize("glob", ["holse*", "!holse*"])
def test_a_pattern_that_fits_no_layer_is_refused(glob: str) -> None:
    document, space = new()
    space.add_circle((0, 0), 2, dxfattribs={"layer": "HOLES"})
    with pytest.raises(
        JobError, match=r"no layer fits .*holse.*; nearest is HOLES; camgen inspect lists them"
    ):
        read(document, layers=[glob])


def test_names_from_the_file_stay_on_one_line() -> None:
    data = "0\nSECTION\n2\nENTITIES\n0\nTEXT\n8\nA) M3;\u2028x\n1\nt\n"
    data += "0\nCIRCLE\n8\n0\n10\n0\n20\n0\n40\n10\n0\nENDSEC\n0\nEOF\n"
    part = read_bytes("x.dxf", data.encode(), InputTable(), 0.01)
    assert all(str(note).isprintable() for note in part.notes)
    assert any("A_ M3_" in note.what for note in part.notes)


# -- damage


def test_a_file_cut_short_is_read_as_far_as_it_goes() -> None:
    data = (FIXTURES / "parts" / "bracket.dxf").read_bytes()
    part = read_bytes("cut.dxf", data[:1500], InputTable(), 0.01)
    assert (
        notes(part)[0] == "skipped: the file ends before its end mark (what would follow is lost)"
    )
    assert [c.closed for c in part.contours] == [True, True, True]


def outcome(data: bytes) -> Part | str:
    """The part, or the message of a refusal."""
    try:
        return read_bytes("bad.dxf", data, InputTable(), 0.01)
    except (InputError, JobError) as error:
        return str(error)


@pytest.mark.parametrize("name", ["bracket", "bracket_binary", "blocks", "smooth"])
def test_a_file_cut_at_any_place_is_read_with_a_note_or_refused(name: str) -> None:
    data = (FIXTURES / "parts" / f"{name}.dxf").read_bytes()
    for end in range(0, len(data) - 6, 41):
        result = outcome(data[:end])
        if isinstance(result, str):
            assert result.isprintable()
        else:
            assert any("end mark" in note.what for note in result.notes)


@pytest.mark.parametrize(
    "value", [b"nan", b"inf", b"-1e308", b"1e300", b"", b"xyz", b"1e9", b"99999999999", b"-1"]
)
@pytest.mark.parametrize("name", ["bracket", "blocks", "smooth", "layers"])
def test_a_wrong_value_at_any_place_gives_finite_contours_or_a_refusal(
    name: str, value: bytes
) -> None:
    lines = (FIXTURES / "parts" / f"{name}.dxf").read_bytes().split(b"\n")
    for i in range(1, len(lines), 12):
        result = outcome(b"\n".join([*lines[:i], value, *lines[i + 1 :]]))
        if isinstance(result, str):
            assert result.isprintable()
            continue
        for contour in result.contours:
            assert np.isfinite(contour.points).all()
            assert (np.abs(contour.bulges) <= 1).all()


def test_a_document_without_model_space_is_refused() -> None:
    document, space = new()
    space.add_circle((0, 0), 5)
    text = written(document).replace("\nModel\n", "\nModal\n")
    assert outcome(text.encode()) == (
        "bad.dxf: damaged beyond repair: no entry 'MODEL'; "
        "open it in the CAD program and save it again as DXF"
    )


def test_a_folder_and_a_missing_file_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is a folder"):
        dxf.read(source(tmp_path), Job(), Files())
    with pytest.raises(InputError, match="no such file"):
        dxf.read(source(tmp_path / "none.dxf"), Job(), Files())


def test_a_file_with_carriage_returns_alone_is_read() -> None:
    text = (FIXTURES / "parts" / "bracket.dxf").read_bytes().replace(b"\r\n", b"\n")
    plain, old = (
        read_bytes("old.dxf", data, InputTable(), 0.01)
        for data in (text, text.replace(b"\n", b"\r"))
    )
    assert len(plain.contours) > 1
    assert old.units == plain.units
    assert old.notes == plain.notes
    for a, b in zip(old.contours, plain.contours, strict=True):
        assert np.array_equal(a.points, b.points)
        assert np.array_equal(a.bulges, b.bulges)


# -- sizes, blocks, and splines that are marked closed


def test_the_size_counts_arcs() -> None:
    """Two circles of 20 mm whose centres have a distance of 30 mm take 50 x 20 mm."""
    document, space = new()
    for x in (0, 30):
        space.add_circle((x, 0), 10)
    facts = inspect(document)
    assert "used part 50 x 20 mm" in str(facts)
    document, space = new()
    space.add_circle((0, 0), 1600)
    assert "the part is 3200 x 3200 mm, which is large" in notes(read(document))[0]


def inspect(document: Drawing) -> dxf.DxfFacts:
    return dxf.inspect(Source(Path("test.dxf"), written(document).encode()), Job(), Files())


def test_blocks_that_are_not_placed_are_named() -> None:
    document, _ = new()
    document.blocks.new("PART").add_circle((0, 0), 5)
    document.blocks.new("EMPTY")
    with pytest.raises(InputError) as caught:
        read(document)
    assert str(caught.value) == (
        "test.dxf: nothing to machine (the drawing is empty: block 'PART' is nowhere placed); "
        "insert its block in model space"
    )
    document.blocks.new("LID").add_circle((0, 0), 5)
    with pytest.raises(InputError, match="blocks 'PART', 'LID' are nowhere placed"):
        read(document)


@pytest.mark.parametrize(("closed", "end", "gap"), [(1, 0.0, 0), (1, 12.0, 12), (0, 12.0, 0)])
def test_a_spline_marked_closed_that_is_open_is_named(closed: int, end: float, gap: float) -> None:
    document, space = new()
    spline = space.add_open_spline([(0, 0), (30, 0), (30, 40), (0, 40), (0, end)], degree=3)
    spline.dxf.flags |= closed
    listed = [note for note in notes(read(document)) if "marked closed" in note]
    assert listed == [
        f"warning: marked closed but open: SPLINE #{spline.dxf.handle} on layer 0 by {gap} mm "
        "(used as its points say; close it in the CAD program)"
    ] * (gap > 0)
