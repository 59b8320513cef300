"""Drawn clamps are read besides the part, and have the height that the job gives them."""

import math
from pathlib import Path
from typing import Any

import ezdxf
import numpy as np
import pytest
import trimesh

import camgen
from camgen.model.errors import InputError, JobError
from camgen.model.job import CellTable, DrawnFixture, InputTable, Job, PageTable
from camgen.model.part import Part, Solid
from camgen.pipeline.inputs import read_parts
from camgen.read import read
from camgen.read.clamps import make_prism
from camgen.read.files import Files

#: A plate of lines. Clamps touch two of its sides.
PLATE = [(0, 0), (60, 0), (60, 40), (0, 40)]
#: A clamp inside the plate, with a side on the lower side of the plate.
ON_SIDE = [(10, 0), (30, 0), (30, 8), (10, 8)]
#: An L of two rectangles, 10 x 20 and 8 x 6 mm.
ANGLE = [(70, 0), (80, 0), (80, 14), (88, 14), (88, 20), (70, 20)]
#: Two triangles of 50 mm2 together, which meet in one point.
EIGHT = [(100, 0), (110, 10), (110, 0), (100, 10)]


def make_job(layer: str = "CLAMPS", top: float = 9.0, bottom: float = 0.0, **tables: Any) -> Job:
    drawn = DrawnFixture(layer, top, bottom)
    return Job(cell=CellTable(fixtures=[drawn]), **tables)


def draw(folder: Path, *clamps: Any, unit: int = 4, layer: str = "Clamps") -> Path:
    """A drawing of the plate with a hole, and of clamps.

    clamps: the corners of a closed chain of lines, or x, y and radius of a circle.
    """
    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = unit
    space = document.modelspace()
    draw_lines(space, PLATE, "PLATE")
    space.add_circle((45, 25), 5, {"layer": "HOLES"})
    for clamp in clamps:
        if isinstance(clamp, list):
            draw_lines(space, clamp, layer)
        else:
            space.add_circle(clamp[:2], clamp[2], {"layer": layer})
    path = folder / "plate.dxf"
    document.saveas(path)
    return path


def draw_lines(space: Any, points: list[tuple[float, float]], layer: str) -> None:
    for start, end in zip(points, [*points[1:], points[0]], strict=True):
        space.add_line(start, end, {"layer": layer})


def make_mesh(solid: Solid) -> trimesh.Trimesh:
    return trimesh.Trimesh(solid.vertices, solid.faces, process=False)


def list_shapes(part: Part) -> list[tuple[str, str, bool, list[list[float]]]]:
    return [(c.id, c.layer, c.closed, c.points.tolist()) for c in part.contours]


def test_the_part_is_the_same_as_without_clamps(tmp_path: Path) -> None:
    alone = read(draw(tmp_path))
    part = read(draw(tmp_path, ON_SIDE, (58, 40, 6)), make_job())
    assert list_shapes(part) == list_shapes(alone)
    assert [(clamp.layer, clamp.closed) for clamp in part.clamps] == [("Clamps", True)] * 2
    assert [note.what for note in part.notes] == [
        "2 contours on layer Clamps: clamps, not machined"
    ]
    assert part.notes[0].ids == ("c3", "c4")


def test_input_layers_need_not_name_the_clamps(tmp_path: Path) -> None:
    drawing = draw(tmp_path, ON_SIDE)
    for layers in (["PLATE"], ["PLATE", "!clamps"]):
        part = read(drawing, make_job(input=InputTable(layers=layers)))
        assert ([c.id for c in part.contours], len(part.clamps)) == (["c1"], 1)


def test_clamps_are_scaled_and_moved_with_the_part(tmp_path: Path) -> None:
    """The drawing is in inches. A corner of the plate, not of a clamp, is moved to the origin."""
    drawing = draw(tmp_path, [(-4, -2), (1, -2), (1, 3), (-4, 3)], unit=1)
    part = read(drawing, make_job(input=InputTable(origin="lower-right")))
    (clamp,) = part.clamps
    low, high = clamp.points.min(axis=0), clamp.points.max(axis=0)
    assert np.allclose([low, high], 25.4 * np.array([[-64, -2], [-59, 3]]))


@pytest.mark.parametrize(
    ("clamps", "area"),
    [
        ([ANGLE], 10 * 20 + 8 * 6),
        ([(130, 0, 12)], math.pi * 12**2),
        ([EIGHT], 2 * 10 * 5 / 2),
        ([ANGLE, (130, 0, 12)], 248 + math.pi * 144),
        ([[(70, 0), (90, 0), (90, 20), (70, 20)], (80, 10, 3)], 400),
    ],
    ids=["angle", "circle", "crosses itself", "two", "with a screw hole"],
)
def test_the_outline_of_a_clamp_becomes_a_prism(
    tmp_path: Path, clamps: list[Any], area: float
) -> None:
    part = read(draw(tmp_path, *clamps), make_job())
    solid = make_prism(DrawnFixture("clamps", 9.0, -2.5), part)
    mesh = make_mesh(solid)
    assert mesh.volume == pytest.approx(11.5 * area, rel=2e-4)
    assert mesh.bounds[:, 2].tolist() == [-2.5, 9.0]
    assert np.allclose(mesh.face_normals, solid.normals)
    top = mesh.area_faces[mesh.face_normals[:, 2] > 0.5].sum()
    assert top == pytest.approx(area, rel=2e-4)


def test_clamps_that_form_a_frame_leave_its_middle(tmp_path: Path) -> None:
    bars = [
        [(70, 0), (100, 0), (100, 5), (70, 5)],
        [(70, 25), (100, 25), (100, 30), (70, 30)],
        [(70, 0), (75, 0), (75, 30), (70, 30)],
        [(95, 0), (100, 0), (100, 30), (95, 30)],
    ]
    part = read(draw(tmp_path, *bars), make_job())
    mesh = make_mesh(make_prism(DrawnFixture("CLAMPS", 1.0), part))
    assert mesh.volume == pytest.approx(30 * 30 - 20 * 20)


@pytest.mark.parametrize(
    ("clamp", "job", "message"),
    [
        (ANGLE, make_job("CLAMP"), "plate.dxf: no closed outline on layer 'CLAMP' (cell.fixtures)"),
        (ANGLE, make_job(top=0.0), "the clamps on layer CLAMPS have no height (cell.fixtures)"),
        ([(70, 0), (90, 0)], make_job(), "the outline of a clamp is open by 20 mm at 90 0"),
        (ANGLE, make_job(page=PageTable(size="A4")), "laid on a page has no clamps"),
    ],
    ids=["unknown layer", "no height", "open", "page"],
)
def test_clamps_that_cannot_be_used_are_refused(
    tmp_path: Path, clamp: Any, job: Job, message: str
) -> None:
    drawing = draw(tmp_path, clamp)
    with pytest.raises((InputError, JobError)) as error:
        camgen.build(drawing, post="gcode", job=job)
    assert message in str(error.value)
    assert error.value.exit_code == 2


def test_a_drawing_of_clamps_alone_is_refused(tmp_path: Path) -> None:
    job = make_job(input=InputTable(layers=["clamps"]))
    with pytest.raises(InputError, match="all contours are clamps"):
        read(draw(tmp_path, ANGLE), job)


def test_one_of_several_drawings_has_the_clamps(tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    plates = [draw(tmp_path), draw(tmp_path / "other", ANGLE)]
    part = read_parts(plates, make_job(), Files())
    assert [contour.id for contour in part.contours] == ["1/c1", "1/c2", "2/c1", "2/c2"]
    assert [clamp.id for clamp in part.clamps] == ["2/c3"]


def test_layers_of_an_svg_are_clamps_too(tmp_path: Path) -> None:
    drawing = tmp_path / "plate.svg"
    inkscape = "http://www.inkscape.org/namespaces/inkscape"
    head = f'xmlns="http://www.w3.org/2000/svg" xmlns:i="{inkscape}"'
    group = '<g i:groupmode="layer" i:label="clamps"><rect x="5" y="5" width="20" height="10"/></g>'
    plate = '<rect x="40" y="40" width="40" height="30"/>'
    size = 'width="100mm" height="100mm" viewBox="0 0 100 100"'
    drawing.write_text(f"<svg {head} {size}>{plate}{group}</svg>")
    part = read(drawing, make_job())
    assert len(part.contours) == 1
    solid = make_prism(DrawnFixture("Clamps", 2.0), part)
    assert make_mesh(solid).bounds.tolist() == [[5, 85, 0], [25, 95, 2]]


def test_a_part_made_in_code_has_clamps_by_layer() -> None:
    plate, clamp = camgen.part(PLATE + PLATE[:1]), camgen.part(ANGLE + ANGLE[:1], layer="CLAMPS")
    both = camgen.part([*plate.contours, *clamp.contours])
    result = camgen.build(both, post="gcode", job=make_job())
    assert result.cell.fixtures is not None
    (fixture,) = result.cell.fixtures.listed
    assert (fixture.top, fixture.bottom) == (9.0, 0.0)
    assert fixture.outline.area == pytest.approx(248)


def test_an_arm_has_drawn_clamps_among_its_meshes(tmp_path: Path) -> None:
    part = read(draw(tmp_path, ANGLE), make_job())
    cell = camgen.cell("rapid", make_job(), part)
    ((name, solid),) = cell.meshes
    assert name == "fixture 1"
    assert make_mesh(solid).volume == pytest.approx(9 * 248)
