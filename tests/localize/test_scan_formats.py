"""PTX, E57 and LAS: poses of scans, points that were not measured, units, and damaged files."""

import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from camgen import cli
from camgen.localize.clouds.e57 import read_e57
from camgen.localize.clouds.ptx import read_ptx
from camgen.localize.scans import read_scan
from camgen.model.errors import InputError, JobError
from camgen.model.files import Source
from camgen.model.pose import FloatArray

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
#: 120 points with x = k / 100, y = 1 - k / 200, z = 0.5, m.
POINTS = [(k / 100, 1 - k / 200, 0.5) for k in range(120)]
#: A quarter turn about z takes x, y, z to -y, x, z; then 10, 20, 30 is added.
TURNED = [(10 - y, 20 + x, 30 + z) for x, y, z in POINTS]


def open_scan(name: str, data: bytes, unit: str = "") -> Any:
    return read_scan(Source(Path(name), data), unit)


def read_refusal(folder: Path, name: str, data: bytes, capsys: pytest.CaptureFixture[str]) -> str:
    """The line in which `localize` refuses a scan."""
    (folder / name).write_bytes(data)
    model = str(PARTS / "rfa1.stl")
    target = str(folder / "frame.toml")
    assert cli.main(["localize", model, str(folder / name), "-o", target]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    return printed.err


# PTX

NO_TURN = "1 0 0\n0 1 0\n0 0 1\n"
IDENTITY = "0 0 0\n" + NO_TURN + "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
#: A row times this matrix: x goes to y, y to -x, then 10, 20, 30 is added.
QUARTER = "10 20 30\n0 1 0\n-1 0 0\n0 0 1\n0 1 0 0\n-1 0 0 0\n0 0 1 0\n10 20 30 1\n"


def ptx(head: str, points: list[tuple[float, float, float]] = POINTS) -> str:
    return f"{len(points) // 10}\n10\n{head}" + "".join(
        f"{x} {y} {z} 0.5 10 20 30\n" for x, y, z in points
    )


def test_a_ptx_has_the_points_of_a_published_example() -> None:
    """The file and the points of https://rapidlasso.de/matrix-transformation-in-lastools/."""
    head = """3\n3\n0 0 0\n1 0 0\n0 1 0\n0 0 1
-0.955179 0.296021 -0.002106 0.000000
-0.296023 -0.955180 0.001152 0.000000
-0.001670 0.001724 0.999997 0.000000
3.847211 12.235314 -0.425777 1.000000\n"""
    body = """1.111111 2.111111 3.111 0.111\n1.222222 2.222222 3.222 0.212\n0 0 0 0\n0 0 0 0
1.333333 2.333333 3.333 0.312\n1.444444 2.444444 3.444 0.423\n0 0 0 0
1.555555 2.555555 3.555 0.534\n1.666666 2.666666 3.666 0.678\n"""
    cloud = read_ptx("sample.ptx", (head + body).encode())
    assert cloud.points[:5] == pytest.approx(
        np.array(
            [
                [2.156, 10.553, 2.685],
                [2.017, 10.480, 2.796],
                [1.877, 10.407, 2.907],
                [1.738, 10.334, 3.018],
                [1.599, 10.261, 3.129],
            ]
        ),
        abs=6e-4,
    )
    assert len(cloud.points) == 6
    wanted = "repaired: 3 rows without a point were left out (the scanner saw nothing there)"
    assert [str(note) for note in cloud.notes] == [wanted]
    # The head has default values for the scanner, which differ from the position in the matrix.
    assert cloud.viewpoint is None


def test_a_ptx_has_a_frame_and_a_unit() -> None:
    scan = open_scan("a.ptx", ptx(QUARTER).encode())
    assert scan.points == pytest.approx(1000 * np.array(TURNED))
    assert scan.viewpoint.tolist() == [10_000, 20_000, 30_000]
    assert [str(note) for note in scan.notes] == [
        "assumed: 1 unit of the scan = 1 m "
        "(Leica Cyclone writes PTX in m; give --units if it is in another unit)"
    ]
    millimetres = open_scan("a.ptx", ptx(QUARTER).encode(), "mm")
    assert millimetres.points == pytest.approx(np.array(TURNED))
    assert [str(note) for note in millimetres.notes] == [
        "warning: 1 unit of the scan = 1 mm, as --units says (Leica Cyclone writes PTX in m)"
    ]
    assert open_scan("a.ptx", ptx(QUARTER).encode(), "m").notes == ()


def test_scans_of_a_ptx_are_joined() -> None:
    text = ptx(IDENTITY) + ptx(QUARTER)
    scan = open_scan("a.ptx", text.encode(), "m")
    assert scan.points == pytest.approx(1000 * np.array(POINTS + TURNED))
    assert scan.viewpoint is None
    assert [str(n) for n in scan.notes] == ["joined: 2 scans were joined (each by its own matrix)"]
    assert open_scan("a.ptx", ptx(IDENTITY).encode(), "m").viewpoint is None


DAMAGED_PTX = {
    "cut off": (
        "".join(ptx(IDENTITY).splitlines(keepends=True)[:-7]),
        "the file is cut off, 113 of 120 points are there (the scan from line 1 on)",
    ),
    "cut off in the head": ("12\n10\n0 0 0\n", "'' is not in the head of a scan: that has 3"),
    "no head": ("".join(f"{x} {y} {z}\n" for x, y, z in POINTS), "is not in the head of a scan"),
    "a word": (ptx(IDENTITY).replace("0.03 0.985", "x 0.985"), "(line 14); a line is x y z"),
    "half a point": (ptx(IDENTITY).replace("0.03 0.985 0.5 0.5 10 20 30", "7"), "'7' is not"),
    "a half row": (ptx(IDENTITY).replace("12\n10\n", "12.5\n10\n", 1), "are not whole numbers"),
    "huge": (ptx(IDENTITY).replace("12\n10\n", "1e10\n1e10\n", 1), "the file is cut off"),
    "negative": (ptx(IDENTITY).replace("12\n10\n", "-12\n10\n", 1), "are not whole numbers"),
    "a matrix that scales": (
        ptx(QUARTER).replace("0 0 1 0\n", "0 0 2 0\n"),
        "its matrix does more than turn and move (lines 7 to 10)",
    ),
    "a matrix of nan": (ptx(QUARTER).replace("0 0 1 0\n", "0 0 nan 0\n"), "in the head of a scan"),
    "another line at the end": (ptx(IDENTITY) + "1 2 3\n", "'1 2 3' is not in the head of a scan"),
    "bytes": ("12\n\x00\xff\n10\n", "is not in the head of a scan"),
}


@pytest.mark.parametrize("kind", DAMAGED_PTX)
def test_a_damaged_ptx_is_refused(
    kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text, message = DAMAGED_PTX[kind]
    assert message in read_refusal(tmp_path, "a.ptx", text.encode("latin-1"), capsys)


# E57, written by pye57

#: cos and sin of 45 deg: the quaternion w, x, y, z of a quarter turn about z.
HALF = float(np.sqrt(0.5))


def e57(folder: Path, *scans: dict[str, Any]) -> bytes:
    """A file of scans of POINTS, each with more fields and a pose."""
    pye57 = pytest.importorskip("pye57", reason="the extra scan is not installed")
    path = folder / "made.e57"
    with pye57.E57(str(path), mode="w") as file:
        for scan in scans:
            x, y, z = np.array(POINTS).T
            fields = {"cartesianX": x, "cartesianY": y, "cartesianZ": z, **scan.get("fields", {})}
            file.write_scan_raw(fields, rotation=scan.get("q"), translation=scan.get("t"))
    return path.read_bytes()


POSE = {"q": np.array([HALF, 0, 0, HALF]), "t": np.array([10.0, 20.0, 30.0])}
COLOUR = {f"color{name}": np.full(120, 7, np.uint8) for name in ("Red", "Green", "Blue")}
METRES = "E57 is in m by its standard (ASTM E2807)"


def test_an_e57_has_a_frame_and_a_unit(tmp_path: Path) -> None:
    data = e57(tmp_path, {**POSE, "fields": COLOUR})
    scan = open_scan("a.e57", data)
    assert scan.points == pytest.approx(1000 * np.array(TURNED))
    assert scan.viewpoint == pytest.approx([10_000, 20_000, 30_000])
    assert [str(note) for note in scan.notes] == [
        f"assumed: 1 unit of the scan = 1 m ({METRES}; give --units if it is in another unit)"
    ]
    millimetres = open_scan("a.e57", data, "mm")
    assert millimetres.points == pytest.approx(np.array(TURNED))
    assert [str(note) for note in millimetres.notes] == [
        f"warning: 1 unit of the scan = 1 mm, as --units says ({METRES})"
    ]
    assert open_scan("a.e57", data, "m").notes == ()
    assert open_scan("a.e57", e57(tmp_path, {})).viewpoint is None


def test_scans_of_an_e57_are_joined_without_invalid_points(tmp_path: Path) -> None:
    state = np.zeros(120, np.int8)
    state[:3] = [1, 2, 2]
    fields = {"cartesianInvalidState": state}
    scan = open_scan("a.e57", e57(tmp_path, {}, {**POSE, "fields": fields}), "m")
    assert scan.points == pytest.approx(1000 * np.array(POINTS + TURNED[3:]))
    assert scan.viewpoint is None
    assert [str(note) for note in scan.notes] == [
        "repaired: 3 points were left out (the scanner marks them as invalid)",
        "joined: 2 scans were joined (each by its own pose)",
    ]


def test_a_damaged_e57_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = e57(tmp_path, POSE)
    flipped = data[:200] + bytes([data[200] ^ 1]) + data[201:]
    for damaged in (data[:1500], data[:40], b"ASTM-E57" + bytes(100), flipped, b"<xml/>"):
        printed = read_refusal(tmp_path, "a.e57", damaged, capsys)
        assert "a.e57: is damaged or not an E57 file: " in printed
    with pytest.raises(InputError, match="has no scan"):
        read_e57("a.e57", e57(tmp_path))
    with pytest.raises(InputError, match="the rotation of scan 1 is not a unit quaternion"):
        read_e57("a.e57", e57(tmp_path, {**POSE, "q": np.array([2.0, 0, 0, 0])}))


# LAS, written by laspy


def las(folder: Path, change: Callable[[Any, Any], None] = lambda _laspy, _file: None) -> bytes:
    """A file of POINTS."""
    laspy = pytest.importorskip("laspy", reason="the extra scan is not installed")
    header = laspy.LasHeader(point_format=3, version="1.2")
    header.scales = [1e-4] * 3
    file = laspy.LasData(header)
    file.x, file.y, file.z = np.array(POINTS).T
    change(laspy, file)
    file.write(str(folder / "made.las"))
    return (folder / "made.las").read_bytes()


def with_keys(**keys: int) -> Callable[[Any, Any], None]:
    """A change that adds a directory of GeoTIFF keys, `k3076=9001`."""

    def change(laspy: Any, file: Any) -> None:
        rows = [(1, 1, 0, len(keys)), *((int(k[1:]), 0, 1, v) for k, v in keys.items())]
        record = np.array(rows, "<u2").tobytes()
        file.header.vlrs.append(laspy.VLR("LASF_Projection", 34735, "keys", record))

    return change


def with_wkt(text: str) -> Callable[[Any, Any], None]:
    def change(laspy: Any, file: Any) -> None:
        file.header.vlrs.append(laspy.VLR("LASF_Projection", 2112, "WKT", text.encode() + b"\0"))

    return change


DEGREE = 'GEOGCS["WGS 84",DATUM["WGS_1984"],UNIT["degree",0.0174532925199433]]'


def projected(unit: str, height: str = "") -> str:
    plane = f'PROJCS["UTM",{DEGREE},UNIT[{unit}]]'
    return f'COMPD_CS["both",{plane},VERT_CS["up",UNIT[{height}]]]' if height else plane


UNITS = {
    "no system": (lambda _laspy, _file: None, "m", False),
    "metre by keys": (with_keys(k1024=1, k3076=9001), "m", True),
    "foot by keys": (with_keys(k1024=1, k3076=9002, k4099=9002), "ft", True),
    "metre by WKT": (with_wkt(projected('"metre",1')), "m", True),
    "US foot by WKT": (with_wkt(projected('"US survey foot",0.3048006096012192')), "us-ft", True),
    "metre and metre": (with_wkt(projected('"metre",1', '"metre",1.0')), "m", True),
    "WKT 2": (with_wkt('PROJCRS["UTM",LENGTHUNIT["foot",0.3048]]'), "ft", True),
}
FEET = {"m": 1000.0, "ft": 304.8, "us-ft": 1200 / 3937 * 1000}


@pytest.mark.parametrize("kind", UNITS)
def test_a_las_has_the_unit_of_its_coordinate_system(kind: str, tmp_path: Path) -> None:
    change, unit, stated = UNITS[kind]
    data = las(tmp_path, change)
    scan = open_scan("a.las", data)
    assert scan.points == pytest.approx(FEET[unit] * np.array(POINTS), abs=0.06)
    assert (scan.unit, scan.stated) == (unit, stated)
    why = (
        "its coordinate system"
        if stated
        else (
            "LAS without a coordinate system is mostly in m; give --units if it is in another unit"
        )
    )
    assert [str(note) for note in scan.notes] == [f"assumed: 1 unit of the scan = 1 {unit} ({why})"]
    if stated:
        with pytest.raises(JobError, match="its coordinate system says so; leave it out"):
            open_scan("a.las", data, "mm")
    else:
        assert open_scan("a.las", data, "mm").points == pytest.approx(np.array(POINTS), abs=6e-5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (with_keys(k1024=2), "its coordinates are longitude and latitude"),
        (with_wkt(DEGREE), "its coordinates are longitude and latitude"),
        (with_keys(k1024=1, k3076=9002, k4099=9001), "in different units: ft and m; export it"),
        (with_wkt(projected('"metre",1', '"foot",0.3048')), "in different units: ft and m"),
    ],
)
def test_a_coordinate_system_in_degrees_or_mixed_units_is_refused(
    change: Callable[[Any, Any], None], message: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=message):
        open_scan("a.las", las(tmp_path, change))


def test_withheld_points_are_left_out(tmp_path: Path) -> None:
    def withhold(_laspy: Any, file: Any) -> None:
        file.withheld[:4] = 1

    scan = open_scan("a.las", las(tmp_path, withhold), "m")
    assert scan.points == pytest.approx(1000 * np.array(POINTS[4:]), abs=0.06)
    assert [str(note) for note in scan.notes] == [
        "repaired: 4 points were left out (the file marks them as withheld)"
    ]


def test_a_damaged_las_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = las(tmp_path)
    count = data[:107] + b"\xff\xff\xff\x7f" + data[111:]
    # laspy makes up records that are missing, which took all memory.
    records = data[:100] + b"\xff\xff\xff\x7f" + data[104:]
    for damaged in (data[:2000], data[:100], b"LASF", b"LASX" + data[4:], records, count):
        printed = read_refusal(tmp_path, "a.las", damaged, capsys)
        assert "a.las: is damaged or not a LAS file: " in printed
    assert "claims 2,147,483,647 points" in printed
    packed = data[:104] + bytes([data[104] | 0x80]) + data[105:]
    printed = read_refusal(tmp_path, "a.laz", packed, capsys)
    assert printed == "camgen: error: a.laz: is packed (LAZ); export it as LAS\n"


@pytest.mark.parametrize(("suffix", "package"), [("e57", "pye57"), ("las", "laspy")])
def test_a_missing_package_is_an_error_in_one_line(
    suffix: str,
    package: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    printed = read_refusal(tmp_path, f"a.{suffix}", b"LASF", capsys)
    remedy = "pip install '.[scan]' in the folder of camgen, or export it as PLY"
    assert f"{suffix.upper()} needs the package {package}; {remedy}" in printed


def test_an_e57_in_metres_is_located_without_options(tmp_path: Path) -> None:
    """The true position of the part is 500, 0, 0 mm."""
    trimesh = pytest.importorskip("trimesh")
    pye57 = pytest.importorskip("pye57", reason="the extra scan is not installed")
    corners = trimesh.load_mesh(PARTS / "rfa1.stl")
    cloud: FloatArray = trimesh.sample.sample_surface(corners, 4000, seed=3)[0]
    x, y, z = (np.asarray(cloud) / 1000).T
    with pye57.E57(str(tmp_path / "a.e57"), mode="w") as file:
        fields = {"cartesianX": x, "cartesianY": y, "cartesianZ": z}
        file.write_scan_raw(fields, translation=np.array([0.5, 0, 0]))
    target = tmp_path / "frame.toml"
    words = [str(PARTS / "rfa1.stl"), str(tmp_path / "a.e57"), "-o", str(target)]
    assert cli.main(["localize", "-q", *words, "--viewpoint", "unknown"]) == 0
    values = tomllib.loads(target.read_text())["cell"]["base_from_work"]
    assert values == pytest.approx([500, 0, 0, 0, 0, 0], abs=0.05)
