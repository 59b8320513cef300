"""Point clouds in text: heads, units, decimal commas, counts, and files with two meanings."""

from pathlib import Path

import numpy as np
import pytest

from camgen.localize.scans import Scan, read_scan
from camgen.model.errors import CamgenError, InputError, JobError
from camgen.model.files import Source

#: 120 points with x = 0.25 k, y = 100 - k, z = 3.5, so that the axes differ.
POINTS = [(0.25 * k, 100.0 - k, 3.5) for k in range(120)]


def scan_of(text: str, unit: str = "", name: str = "scan.csv") -> Scan:
    return read_scan(Source(Path(name), text.encode()), unit)


def rows(form: str) -> str:
    """A line per point. `form` has fields for x, y, z and k, the number of the point."""
    lines = [form.format(x=x, y=y, z=z, k=k + 1) for k, (x, y, z) in enumerate(POINTS)]
    return "".join(line + "\n" for line in lines)


HEADS = {
    "with a number": ("id,x,y,z", "{k},{x},{y},{z}"),
    "in another order": ("y,x,z", "{y},{x},{z}"),
    "in capital letters": ("Z;Y;X", "{z};{y};{x}"),
    "in quotes": ('"Name","Z","X","Y"', "p{k},{z},{x},{y}"),
    "of CloudCompare": ("//X Y Z R G B", "{x} {y} {z} 1 2 3"),
    "of CloudCompare with a count": ("//X Y Z\n120", "{x} {y} {z}"),
    "of CloudCompare below a count": ("120\n//Y;X;Z", "{y};{x};{z}"),
    "of CloudCompare with commas": ("//Z,X,Y,Scalar_field", "{z},{x},{y},0.5"),
    "as a comment": ("# k x y z", "{k} {x} {y} {z}"),
    "of ParaView": (
        '"Normals:0","Points:0","Points:1","Points:2"',
        "0.1,{x},{y},{z}",
    ),
    "of ParaView with underscores": ("Points_2,Points_1,Points_0", "{z},{y},{x}"),
    "of the wiki of ParaView": ("k, x coord, y coord, z coord", "{k}, {x}, {y}, {z}"),
    "with words": ("no\tPos_X\tPos_Y\tPos_Z", "{k}\t{x}\t{y}\t{z}"),
    "with names before the points": ("Point X Y Z I J K", "A{k} {x} {y} {z} 0 0 1"),
    "with normals": ("nx,ny,nz,x,y,z", "1,0,0,{x},{y},{z}"),
    "with a longer end": ("x y z Scalar field", "{x} {y} {z} 0.5"),
    "with an empty last column": ("x;y;z;", "{x};{y};{z};"),
    "below a title": ("Scan of 12 March\n\nn;x;y;z", "{k};{x};{y};{z}"),
}


@pytest.mark.parametrize("kind", HEADS)
def test_columns_are_found_by_their_names(kind: str) -> None:
    head, form = HEADS[kind]
    scan = scan_of(f"{head}\n{rows(form)}")
    assert scan.points.tolist() == [list(point) for point in POINTS]
    assert (scan.notes, scan.unit) == ((), "mm")


def test_columns_may_have_names_of_directions() -> None:
    scan = scan_of("Northing,Easting,Elevation\n" + rows("{y},{x},{z}"))
    assert scan.points.tolist() == [list(point) for point in POINTS]
    note = "assumed: the columns Easting, Northing, Elevation are x, y and z"
    assert [str(note) for note in scan.notes] == [f"{note} (so its head names them)"]


@pytest.mark.parametrize(
    ("head", "unit"),
    [
        ("X [mm];Y [mm];Z [mm]", "mm"),
        ("X [m];Y [m];Z [m]", "m"),
        ('"x (inch)";"y (inch)";"z (inch)"', "inch"),
        ("x_cm;y_cm;z_cm", "cm"),
        ("X in m;Y in m;Z in m", "m"),
        ("X;Y;Z\n[m];[m];[m]", "m"),
        ("X;Y;Z\nmm;mm;mm", "mm"),
    ],
)
def test_a_unit_in_the_head_is_used(head: str, unit: str) -> None:
    mm = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "inch": 25.4}[unit]
    text = f"{head}\n{rows('{x};{y};{z}')}"
    for option in ("", unit):
        scan = scan_of(text, option)
        assert scan.points == pytest.approx(mm * np.array(POINTS))
        assert [str(note) for note in scan.notes] == [
            f"assumed: 1 unit of the scan = 1 {unit} (its head)"
        ]
    other = "m" if unit == "mm" else "mm"
    with pytest.raises(JobError) as error:
        scan_of(text, other)
    message = f"says {other}, and scan.csv is in {unit}: its head says so"
    assert str(error.value) == f"--units: {message}; leave it out, or correct the file"


def test_a_unit_may_follow_blanks() -> None:
    scan = scan_of("X [m]  Y [m]  Z [m]\n" + rows("{x} {y} {z}"), name="scan.txt")
    assert scan.points[1].tolist() == [250.0, 99_000.0, 3500.0]


COMMAS = {
    "semicolons": "{x};{y};{z}",
    "tabs": "{x}\t{y}\t{z}",
    "blanks": "{x} {y}  {z}",
    "semicolons and blanks": "{x} ; {y} ; {z}",
}


@pytest.mark.parametrize("kind", COMMAS)
def test_decimal_commas_are_read(kind: str) -> None:
    text = rows(COMMAS[kind]).replace(".", ",")
    scan = scan_of(text)
    assert scan.points.tolist() == [list(point) for point in POINTS]
    assert [str(note) for note in scan.notes] == [
        "assumed: decimal commas in 360 numbers (no number of the coordinates has a point)"
    ]


REFUSED = {
    "points and commas": (
        rows("{x};{y};{z}") + "1,5;2;3\n",
        "has decimal points (line 1) and decimal commas (line 121); write all numbers with a point",
    ),
    "both in one number": (rows("{x};{y};{z}") + "1.234,5;2;3\n", "is not a point (line 121)"),
    "six whole numbers": (
        "1,2,3,4,5,6\n" * 120,
        "the commas of '1,2,3,4,5,6' may be decimal ones (line 1); put semicolons between",
    ),
    "whole numbers in lines of two widths": (
        "1,2,3,4,5\n" * 60 + "1,2,3,4\n" * 60,
        "the commas of '1,2,3,4,5' may be decimal ones",
    ),
    "three names for six numbers": (
        "x,y,z\n" + "1,2,3,4,5,6\n" * 120,
        "its head names 3 columns, and the line below it has 6 words (line 1, 'x,y,z')",
    ),
    "a running number": (
        rows("{k} {x} {y} {z}"),
        "the first column may be a number of the point, and not x (line 1, '1 0.0 100.0 3.5'); "
        "name the columns in a first line, as in: id x y z",
    ),
    "a running number of whole points": (
        "".join(f"{k} {7 * k % 50} {k % 9} 4\n" for k in range(120)),
        "the first column may be a number of the point, and not x",
    ),
    "row and column of the scan": (
        "".join(f"{k // 9} {k % 9} {x} {y} {z}\n" for k, (x, y, z) in enumerate(POINTS)),
        "the first column may be a number of the point, and not x",
    ),
    "names without x": (
        "theta,phi,r\n" + rows("{x},{y},{z}"),
        "its head names no columns x, y and z (line 1, 'theta,phi,r'); name them x, y, z",
    ),
    "names without z": ("x y\tr q\n" + rows("{x} {y} {z} 1"), "its head names no columns"),
    "x twice": ("x,y,z,X\n" + rows("{x},{y},{z},1"), "the column 'X' is there twice (line 1"),
    "two units": (
        "x [m],y [m],z [mm]\n" + rows("{x},{y},{z}"),
        "the columns x [m], y [m], z [mm] have different units (line 1",
    ),
    "a unit for some": ("x [m],y,z\n" + rows("{x},{y},{z}"), "have different units"),
    "a unit below and another above": (
        "x [m];y [m];z [m]\nmm;mm;mm\n" + rows("{x};{y};{z}"),
        "its columns are in m, and in mm by the line below",
    ),
    "a word that is missing": (
        "id x y z\n" + rows("{k} {x} {y} {z}") + "9 1.5 2.5\n",
        "has 3 words, the first line of points 4 (line 122)",
    ),
    "an empty cell": ("i;x;y;z\n" + rows("{k};{x};{y};{z}") + "9;;2.5;1\n", "is not a point"),
    "a name without head": (rows("A{k} {x} {y} {z}"), "'A1 0.0 100.0 3.5' is not a point (line 1)"),
    "fewer points than the count": (
        "121\n" + rows("{x} {y} {z}"),
        "says that 121 points follow, and 120 do (line 1)",
    ),
    "fewer points than the count below the head": (
        "//X,Y,Z\n121\n" + rows("{x},{y},{z}"),
        "says that 121 points follow, and 120 do (line 2)",
    ),
    "a count in the middle": (
        "120\n" + rows("{x} {y} {z}") + "7\n" + rows("{x} {y} {z}"),
        "says that 7 points follow, and 120 do (line 122)",
    ),
    "an underscore": (rows("{x} {y} {z}") + "1_0 2 3\n", "'1_0 2 3' is not a point (line 121)"),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_a_text_with_two_meanings_or_none_is_refused(kind: str) -> None:
    text, message = REFUSED[kind]
    with pytest.raises(InputError) as error:
        scan_of(text)
    assert message in str(error.value)
    assert error.value.exit_code == 2


def test_without_a_head_the_first_three_columns_are_read() -> None:
    wanted = [list(point) for point in POINTS]
    plain = scan_of(rows("{x},{y},{z},0.5,200"))
    assert (plain.points.tolist(), plain.notes) == (wanted, ())
    titled = scan_of("Exported on 12 March\n" + rows("{x},{y},{z},0.5"))
    assert titled.points.tolist() == wanted
    assert [str(note) for note in titled.notes] == [
        "assumed: the first three columns are x, y and z "
        "(line 1, 'Exported on 12 March' names no columns)"
    ]
    whole = scan_of("3 66 -1063 0.5\n7 34 -1090 0.5\n" * 60, name="scan.xyz")
    assert whole.points[:2].tolist() == [[3, 66, -1063], [7, 34, -1090]]


def test_the_counts_of_a_pts_file_are_checked() -> None:
    block = rows("{x} {y} {z} -900 10 20 30")
    scan = scan_of(f"120\n{block}", name="scan.pts")
    assert scan.points.tolist() == [list(point) for point in POINTS]
    twice = scan_of(f"120\r\n{block}120\r\n{block}", name="scan.pts")
    assert len(twice.points) == 240
    assert (scan.notes, twice.notes) == ((), ())


def test_an_error_is_a_single_line(tmp_path: Path) -> None:
    for text, _ in REFUSED.values():
        path = tmp_path / "scan.txt"
        path.write_text(text)
        with pytest.raises(CamgenError) as error:
            read_scan(Source(path, path.read_bytes()))
        assert "\n" not in str(error.value)
