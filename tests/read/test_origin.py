"""The setting `input.origin` moves a drawing with its notes and programs."""

import math
from pathlib import Path
from typing import Any

import ezdxf
import numpy as np
import pytest

import camgen
from camgen.cli import main
from camgen.model.errors import JobError
from camgen.model.job import InputTable, Job, PageTable
from camgen.read import read
from camgen.read.extent import measure_box
from camgen.read.move import move_part

X, Y = 500000.0, -5400000.0


@pytest.fixture
def drawing(tmp_path: Path) -> Path:
    """A plate of 60 x 40 mm far from the origin, with a half circle of 10 mm on its right side."""
    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = 4
    rows = [(0, 0, 0), (60, 0, 0), (60, 10, 1.0), (60, 30, 0), (60, 40, 0), (0, 40, 0)]
    outline = [(X + x, Y + y, bulge) for x, y, bulge in rows]
    document.modelspace().add_lwpolyline(outline, format="xyb", close=True)
    document.modelspace().add_circle((X + 20, Y + 20), 5)
    path = tmp_path / "far.dxf"
    document.saveas(path)
    return path


@pytest.mark.parametrize(
    ("origin", "corner"),
    [
        ("lower-left", (0, 0)),
        ("lower-right", (-70, 0)),
        ("upper-left", (0, -40)),
        ("upper-right", (-70, -40)),
        ("center", (-35, -20)),
        ([X + 1.5, Y + 2.5], (-1.5, -2.5)),
    ],
)
def test_a_corner_is_moved_to_the_origin(drawing: Path, origin: Any, corner: Any) -> None:
    """With its arc, the drawing is 70 mm wide."""
    part = read(drawing, Job(input=InputTable(origin=origin)))
    low, high = measure_box(part.contours)
    assert low.tolist() == pytest.approx(corner, abs=1e-8)
    assert (high - low).tolist() == pytest.approx([70, 40], abs=1e-8)
    assert part.moved == pytest.approx((corner[0] - X, corner[1] - Y))
    assert [contour.id for contour in part.contours] == ["c1", "c2"]
    note = part.notes[-1]
    assert (note.kind, note.what.split(" by ")[0], note.fails_strict) == ("assumed", "moved", False)
    table = part.contours.columns  # type: ignore[attr-defined]
    assert np.array_equal(table.points[: len(part.contours[0].points)], part.contours[0].points)


def test_a_drawing_without_the_setting_is_not_moved(drawing: Path) -> None:
    part = read(drawing)
    assert part.moved is None
    assert part.contours[0].points[0].tolist() == [X, Y]


def test_layers_that_are_not_used_do_not_count_for_the_origin(tmp_path: Path) -> None:
    document = ezdxf.new(units=4)
    document.modelspace().add_circle((10, 10), 5, dxfattribs={"layer": "CUT"})
    document.modelspace().add_circle((-90, -90), 5, dxfattribs={"layer": "FRAME"})
    path = tmp_path / "two.dxf"
    document.saveas(path)
    part = read(path, Job(input=InputTable(origin="lower-left", layers=["CUT"])))
    assert part.moved == (-5.0, -5.0)


def test_an_svg_and_curves_in_space_are_moved(tmp_path: Path) -> None:
    path = tmp_path / "a.svg"
    path.write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="100mm" height="80mm" viewBox="0 0 100 80">'
        '<rect x="20" y="30" width="40" height="10" fill="none" stroke="black"/></svg>'
    )
    moved = read(path, Job(input=InputTable(origin="lower-left")))
    assert [side.tolist() for side in measure_box(moved.contours)] == [[0, 0], [40, 10]]
    points = tmp_path / "line.xyz"
    points.write_text("10 20 5\n30 20 5\n30 60 9\n")
    curve = read(points, Job(input=InputTable(origin="lower-left"))).curves[0]
    assert curve.points.tolist() == [[0, 0, 5], [20, 0, 5], [20, 40, 9]]


def test_several_drawings_are_moved_together(drawing: Path, tmp_path: Path) -> None:
    document = ezdxf.new()
    document.header["$INSUNITS"] = 4
    document.modelspace().add_circle((X - 20, Y), 5)
    other = tmp_path / "other.dxf"
    document.saveas(other)
    part = camgen.read([drawing, other], {"input": {"origin": "lower-left"}})
    assert part.moved == pytest.approx((25 - X, 5 - Y))
    assert measure_box(part.contours)[1].tolist() == pytest.approx([95, 45])


def test_places_of_notes_are_moved(tmp_path: Path) -> None:
    document = ezdxf.new(units=4)
    document.modelspace().add_line((100, 200), (140, 200))
    document.modelspace().add_line((120, 200), (160, 200))
    path = tmp_path / "twice.dxf"
    document.saveas(path)
    part = read(path, Job(input=InputTable(origin="lower-left")))
    assert [note.places for note in part.notes if note.places] == [((30.0, 0.0),)]


@pytest.mark.parametrize("origin", [[1.0], [1.0, 2.0, 3.0], [math.inf, 0.0]])
def test_an_origin_that_is_not_two_finite_numbers_is_refused(drawing: Path, origin: Any) -> None:
    with pytest.raises(JobError, match="is not a point"):
        read(drawing, Job(input=InputTable(origin=origin)))


def test_an_origin_on_a_page_is_refused(drawing: Path) -> None:
    job = Job(page=PageTable(size="A4"), input=InputTable(origin="center"))
    with pytest.raises(JobError, match="no effect on a page"):
        move_part(read(drawing), job)


@pytest.mark.parametrize(
    ("name", "post", "kind"),
    [("rfa1.stl", "rapid", "3-D part"), ("gear.png", "gcode", "picture")],
)
def test_an_origin_for_a_3_d_part_or_a_picture_is_refused(
    name: str, post: str, kind: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    file = Path(__file__).parents[2] / "fixtures" / "parts" / name
    scale = ["--set", "image.mm_per_px=0.1"] if kind == "picture" else []
    command = ["build", str(file), "--post", post, "-o", str(tmp_path / "x"), *scale]
    assert main([*command, "--set", 'input.origin="center"']) == 2
    assert f"has no effect on a {kind} (input.origin)" in capsys.readouterr().err


BUILD = ["--post", "gcode", "--set", "operation.depth=2", "--set", "process.spindle=9000"]
MOVE = ["--set", 'input.origin="upper-right"']


def test_the_program_states_its_move_and_is_verified_with_it(
    drawing: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(drawing.parent)
    assert main(["build", "far.dxf", *BUILD, *MOVE]) == 0
    text = (drawing.parent / "far.ngc").read_text()
    assert "(drawing moved by x -500070 y 5399960 mm)" in text
    capsys.readouterr()
    assert main(["verify", "far.ngc", "--part", "far.dxf", *BUILD, *MOVE]) == 0
    assert "2 contours in" in capsys.readouterr().out
    main(["verify", "far.ngc", "--part", "far.dxf", *BUILD])
    assert "the motion works where nothing is drawn" in capsys.readouterr().out
    (drawing.parent / "far.toml").write_text(
        '[input]\norigin = "upper-right"\n[operation]\ndepth = 2\n[process]\nspindle = 9000\n'
    )
    assert main(["build", "far.dxf", "--post", "gcode", "--force"]) == 0
    capsys.readouterr()
    assert main(["verify", "far.ngc"]) == 0
    assert "equal to what its job and far.dxf make" in capsys.readouterr().out


def test_the_refusal_of_a_far_drawing_suggests_a_setting_that_works(
    drawing: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(drawing.parent)
    command = ["build", "far.dxf", "--post", "rapid", "--set", "operation.kind=trace"]
    assert main(command) == 3
    error = capsys.readouterr().err
    assert 'set input.origin = "lower-left", which moves it to x 0, y 0' in error
    assert main([*command, "--set", 'input.origin="lower-left"']) == 0


def test_inspect_states_the_move(drawing: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["inspect", str(drawing), "--set", 'input.origin="center"']) == 0
    assert "moved by x -500035, y 5399980 mm" in capsys.readouterr().out
    assert main(["inspect", str(drawing), "--json", "--set", 'input.origin="center"']) == 0
    text = "".join(capsys.readouterr().out.split())
    assert '"moved":[-500035.0,5399980.0]' in text
