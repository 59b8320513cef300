"""Lists of points in space are read, or refused with the line of the fault."""

import math
from pathlib import Path

import numpy as np
import pytest

from camgen.cli import main
from camgen.model.errors import InputError, JobError
from camgen.model.files import Source
from camgen.model.job import InputTable, Job
from camgen.model.part import Part
from camgen.read import find_reader, find_suffix, read
from camgen.read.files import Files

MM = Job(input=InputTable(units="mm"))
SEAM = Path(__file__).parents[2] / "fixtures" / "parts" / "seam.xyz"


def points(text: str | bytes, job: Job = MM) -> Part:
    data = text if isinstance(text, bytes) else text.encode()
    source = Source(Path("a.xyz"), data)
    return find_reader(source).read(source, job, Files())


@pytest.mark.parametrize(
    "text",
    [
        "1,2,3\n4,5,6\n",
        "1;2;3\r\n4;5;6",
        "1 2 3\r4 5 6",
        "1\t2\t 3\n4, 5 ,6\n",
        "x,y,z\n1,2,3\n4,5,6",
        "\ufeff# a path\nX; Y; Z\n\n1;2;3 # the first\n+4.;5e0;.6e1\n\n\n",
        "1,2,3\n# in between\n4,5,6",
    ],
)
def test_two_points_in_any_spelling_are_a_line(text: str) -> None:
    (curve,) = points(text).curves
    assert curve.points.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert (curve.closed, curve.rotations, curve.curved.any()) == (False, None, False)
    assert curve.length == pytest.approx(math.sqrt(27))


def test_a_blank_line_ends_a_curve_and_a_curve_that_returns_to_its_start_is_closed() -> None:
    part = points("0,0,0\n9,0,0\n9,9,5\n0,0,0\n\n1,1,1\n2,2,2\n  \n5,5,5\n\n7,7,7\n7,7,7\n8,8,8")
    assert [(c.id, len(c.points), c.closed) for c in part.curves] == [
        ("c1", 4, True),
        ("c2", 2, False),
        ("c3", 2, False),
    ]
    assert [str(note) for note in part.notes] == [
        "skipped: the curve in line 9 (it has no two points that differ)",
        "repaired: dropped: 1 point of c3 (the same as the one before)",
    ]


def test_angles_are_rotations_about_the_fixed_axes_x_y_z_in_deg() -> None:
    (curve,) = points("0 0 0 180 0 0\n10 0 0 20 30 40").curves
    assert curve.rotations is not None
    assert curve.rotations[0] == pytest.approx(np.diag([1.0, -1.0, -1.0]))
    a, b, c = np.radians([20, 30, 40])
    about_x = np.array([[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]])
    about_y = np.array([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
    about_z = np.array([[math.cos(c), -math.sin(c), 0], [math.sin(c), math.cos(c), 0], [0, 0, 1]])
    assert curve.rotations[1] == pytest.approx(about_z @ about_y @ about_x)


def test_a_reorientation_is_kept() -> None:
    (curve,) = points("0 0 0 180 0 0\n9 0 0 180 0 0\n9 0 0 180 20 0\n9 9 0 180 20 0").curves
    assert len(curve.points) == 4


def test_units_come_from_the_job_or_are_assumed() -> None:
    part = points("0,0,0\n1,0,2", Job(input=InputTable(units="inch")))
    assert part.curves[0].points[1].tolist() == [25.4, 0, 50.8]
    assumed = points("0,0,0\n10,0,2", Job())
    assert "1 drawing unit = 1 mm" in str(assumed.notes[0])


@pytest.mark.parametrize(("text", "line"), [
    ("1,2,3\n4,5\n", "has 2 numbers, the lines before it 3 (line 2)"),
    ("1,2\n", "has 2 numbers (line 1)"),
    ("1,2,3\n1,2,3,4,5,6\n", "has 6 numbers, the lines before it 3 (line 2)"),
    ("1,5;2,5;3,5\n", "'1,5' is not a number (line 1)"),
    ("1,5 2,5 3,5\n", "'5 2' is not a number (line 1)"),
    ("1,2,3,\n", "'' is not a number (line 1)"),
    ("1,2,nan\n", "'nan' is not a number (line 1)"),
    ("1,2,3\n\n1_0,2,3\n", "'1_0' is not a number (line 3)"),
    ("1,2,1e400\n", "1e400 is too large (line 1)"),
    ("1,2,\u0663\n", r"'\u0663' is not a number (line 1)"),
    ("G21 G90 G0\n", "'G21' is not a number (line 1)"),
    (b"1,2,3\n\xff\xfe\n", "is not a text (byte 6)"),
])  # fmt: skip
def test_an_invalid_point_is_refused_with_its_line(text: str | bytes, line: str) -> None:
    with pytest.raises(InputError) as caught:
        points(text)
    remedy = "give x,y,z or x,y,z,rx,ry,rz by line, decimals with a point"
    assert str(caught.value) == f"a.xyz: {line}; {remedy}"


@pytest.mark.parametrize("text", ["", "# nothing\n", "1,2,3\n", "1,2,3\n\n4,5,6\n"])
def test_a_list_without_a_curve_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="nothing to machine"):
        points(text)


def test_settings_without_effect_on_a_list_are_refused() -> None:
    for table in (InputTable(layers=["A"]), InputTable(join=1.0)):
        with pytest.raises(JobError, match="has no effect on a list of points"):
            points("0,0,0\n1,1,1", Job(input=table))


def test_each_suffix_is_read_and_a_list_inspected(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for suffix in (".xyz", ".pts", ".csv", ".txt"):
        file = tmp_path / f"a{suffix}"
        file.write_text("0,0,0\n1,1,1\n")
        assert len(read(file).curves) == 1
    assert find_suffix("xyz") == ".xyz"
    assert main(["inspect", str(SEAM)]) == 0
    shown = capsys.readouterr().out.splitlines()
    assert shown[0] == "list of points, units mm, 80 x 80 x 9 mm, with the angles of the tool"
    assert shown[1].startswith("c1: 25 points, ")
    assert shown[1].endswith(" mm, closed")


def test_a_drawing_with_the_suffix_of_a_list_is_read_as_a_drawing(
    tmp_path: Path,
) -> None:
    file = tmp_path / "a.txt"
    file.write_bytes((SEAM.parent / "plate.dxf").read_bytes())
    assert not read(file).curves
