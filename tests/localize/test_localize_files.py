"""camgen localize from files to a job file, unusable scans, and formats of point clouds."""

import struct
import tomllib
from pathlib import Path

import numpy as np
import pytest
import trimesh

import camgen
from camgen import cli
from camgen.localize.scans import read_scan
from camgen.model.errors import InputError
from camgen.model.pose import pose_from_values
from tests.support.clouds import ROUND, scan
from tests.support.files import source

pytestmark = pytest.mark.usefixtures("localize_once")
PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
SHARED = Path(__file__).parents[2].parent / "shared" / "data" / "cloud"
PART = trimesh.load_mesh(PARTS / "rfa1.stl")
#: Angles whose rotation differs clearly if the order is not R = Rz Ry Rx. A small turn is found
#: soon.
TRUTH = (120.0, -40.0, 25.0, 10.0, -20.0, 30.0)


@pytest.fixture(scope="module")
def cloud():
    rx, ry, rz = np.radians(TRUTH[3:])
    turn = trimesh.transformations.euler_matrix(rx, ry, rz, "sxyz")[:3, :3]
    return scan(PART, 6000, 1, ROUND, 0.05, 0.1) @ turn.T + np.array(TRUTH[:3])


def run_localize(*words):
    return cli.main(["localize", *map(str, words)])


def test_the_job_file_of_a_scan_is_accepted_by_a_build(cloud, tmp_path, capsys):
    np.savetxt(tmp_path / "bench.xyz", cloud, fmt="%.5f")
    target = tmp_path / "frame.toml"
    assert run_localize(PARTS / "rfa1.stl", tmp_path / "bench.xyz", "-o", target) == 0
    captured = capsys.readouterr()
    text = target.read_text()
    values = tomllib.loads(text)["cell"]["base_from_work"]
    assert values == pytest.approx(TRUTH, abs=0.05)
    assert captured.out.strip() == text.splitlines()[-1]
    for word in (
        "# overlap: 100.0 % of the scan without the bench",
        "# residual: 0.0",
        "# seen: ",
        "# next best: ",
        "where rfa1.stl stands in bench.xyz",
    ):
        assert word in text
    assert "model     rfa1.stl: 125 x 95 x 70 mm, 396 triangles" in captured.err
    assert "scan      bench.xyz: 6 000 points" in captured.err
    assert (
        run_localize(
            "-q", PARTS / "rfa1.stl", tmp_path / "bench.xyz", "-o", tmp_path / "again.toml"
        )
        == 0
    )
    assert capsys.readouterr() == ("", "")
    assert (tmp_path / "again.toml").read_bytes() == target.read_bytes()
    job = tomllib.loads(text)
    result = camgen.build(PARTS / "bracket.dxf", post="rapid", job=job)
    frame = result.program.base_from_work
    assert np.allclose(frame.rotation, pose_from_values(TRUTH).rotation, atol=1e-3)
    assert np.allclose(frame.origin, TRUTH[:3], atol=0.05)


def test_a_unit_is_advised_and_a_start_chooses_among_symmetric_poses(tmp_path, capsys):
    box = trimesh.creation.box((80, 80, 30))
    box.export(tmp_path / "box.stl")
    np.savetxt(
        tmp_path / "box.csv", scan(box, 4000, 2) / 1000, fmt="%.8f", delimiter=",", header="x,y,z"
    )
    words = (tmp_path / "box.stl", tmp_path / "box.csv", "-o", tmp_path / "frame.toml")
    assert run_localize(*words) == 2
    assert "it is found with --units m (a part of 80 x 80 x 30 mm)\n" in capsys.readouterr().err
    assert not (tmp_path / "frame.toml").exists()
    assert run_localize(*words, "--units", "m", "--start=0,0,0,0,0,180") == 0
    text = (tmp_path / "frame.toml").read_text()
    assert "# ambiguous: other poses that fit as well: 7" in text
    assert "# units: 1 unit = 1 mm in the model, 1 unit = 1000 mm in the scan\n" in text
    assert abs(tomllib.loads(text)["cell"]["base_from_work"][5]) == pytest.approx(180, abs=0.1)


def test_a_step_model_is_located(cloud, tmp_path):
    pytest.importorskip("OCP", reason="the extra step is not installed")
    np.savetxt(tmp_path / "bench.xyz", cloud, fmt="%.5f")
    assert (
        run_localize(
            "-q", PARTS / "rfa1.step", tmp_path / "bench.xyz", "-o", tmp_path / "frame.toml"
        )
        == 0
    )
    values = tomllib.loads((tmp_path / "frame.toml").read_text())["cell"]["base_from_work"]
    assert values == pytest.approx(TRUTH, abs=0.05)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--units", "furlong"), "--units: unknown unit 'furlong'; give mm, cm, m, inch"),
        (("--start", "1,2,3"), "--start: '1,2,3' is not a pose; give x,y,z,rx,ry,rz"),
        (("--start", "1,2,3,4,5,nan"), "--start: '1,2,3,4,5,nan' is not a pose"),
    ],
)
def test_an_invalid_option_is_refused(words, message, tmp_path, capsys):
    assert (
        run_localize(PARTS / "rfa1.stl", tmp_path / "none.xyz", "-o", tmp_path / "f.toml", *words)
        == 2
    )
    assert message in capsys.readouterr().err


def test_neither_model_nor_scan_is_overwritten(tmp_path, capsys):
    (tmp_path / "a.xyz").write_text("0 0 0\n")
    assert run_localize(PARTS / "rfa1.stl", tmp_path / "a.xyz", "-o", tmp_path / "a.xyz") == 2
    assert "would overwrite" in capsys.readouterr().err


# -- formats


def make_cloud():
    return np.random.default_rng(0).uniform(-100, 100, (200, 3)).astype(np.float32)


def make_pcd(points, encoding, body):
    head = (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS intensity x y z\nSIZE 2 4 4 4\nTYPE U F F F\n"
        "COUNT 1 1 1 1\n"
    )
    head += (
        f"WIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points)}\n"
        f"DATA {encoding}\n"
    )
    return head.encode() + body


def make_ply(points, encoding, body):
    head = (
        f"ply\nformat {encoding} 1.0\ncomment x\nelement vertex {len(points)}\nproperty uchar q\n"
    )
    head += (
        "property double x\nproperty float y\nproperty float z\nelement face 0\n"
        "property list uchar int i\n"
    )
    return head.encode() + b"end_header\n" + body


def make_rows(points, separator=" ", first="9"):
    """A text line for each point, which begins with `first` unless it is empty."""
    lines = []
    for point in points:
        words = ([first] if first else []) + [f"{value:.9g}" for value in point]
        lines.append(separator.join(words) + "\n")
    return "".join(lines)


def compress_by_copying(data):
    """LZF without back references, in runs of up to 32 bytes."""
    parts = (data[i : i + 32] for i in range(0, len(data), 32))
    return b"".join(bytes([len(part) - 1]) + part for part in parts)


def make_file(kind, points):
    rows = points.tolist()
    columns = struct.pack(f"<{len(rows)}H", *[9] * len(rows)) + points.T.astype("<f4").tobytes()
    packed = compress_by_copying(columns)
    return {
        "a.xyz": make_rows(points, first="").encode(),
        "b.csv": b"x;y;z;i\n" + "".join(f"{x};{y};{z};7\n" for x, y, z in rows).encode(),
        "c.txt": b"# head\r\n" + make_rows(points, "\t", "").replace("\n", "\t1\t2\r\n").encode(),
        "d.pcd": make_pcd(points, "ascii", make_rows(points).encode()),
        "e.pcd": make_pcd(
            points, "binary", b"".join(struct.pack("<H3f", 9, *point) for point in rows)
        ),
        "f.pcd": make_pcd(
            points, "binary_compressed", struct.pack("<II", len(packed), len(columns)) + packed
        ),
        "g.ply": make_ply(points, "ascii", make_rows(points).encode()),
        "h.ply": make_ply(
            points,
            "binary_little_endian",
            b"".join(struct.pack("<Bdff", 9, *point) for point in rows),
        ),
        "i.ply": make_ply(
            points, "binary_big_endian", b"".join(struct.pack(">Bdff", 9, *point) for point in rows)
        ),
        "j.obj": b"# points\n" + "".join(f"v {x} {y} {z}\n" for x, y, z in rows).encode(),
    }[kind]


FORMATS = ["a.xyz", "b.csv", "c.txt", "d.pcd", "e.pcd", "f.pcd", "g.ply", "h.ply", "i.ply", "j.obj"]


@pytest.mark.parametrize("kind", FORMATS)
def test_each_format_gives_the_same_points(kind, tmp_path):
    (tmp_path / kind).write_bytes(make_file(kind, make_cloud()))
    read_cloud = read_scan(source(tmp_path / kind), "cm")
    assert read_cloud.points == pytest.approx(make_cloud() * 10.0, rel=1e-6)
    assert read_cloud.notes == ()


@pytest.mark.parametrize("kind", ["d.pcd", "e.pcd"])
def test_points_beyond_the_count_of_a_pcd_are_named(kind, tmp_path):
    data = make_file(kind, make_cloud()).replace(b"POINTS 200", b"POINTS 150")
    (tmp_path / kind).write_bytes(data)
    cloud = read_scan(source(tmp_path / kind))
    assert cloud.points == pytest.approx(make_cloud()[:150], rel=1e-6)
    assert [str(note) for note in cloud.notes] == [
        "repaired: 50 points were left out (POINTS of the head says 150)"
    ]


@pytest.mark.parametrize(
    ("fields", "fault"),
    [("intensity X Y Z", ""), ("x X y z", "more than one is x"), ("a b y z", "none is x")],
)
def test_fields_may_have_upper_case_letters_but_not_twice_the_same_name(fields, fault, tmp_path):
    data = make_file("e.pcd", make_cloud()).replace(b"intensity x y z", fields.encode())
    (tmp_path / "a.pcd").write_bytes(data)
    if fault:
        with pytest.raises(
            InputError, match=f"of its fields '{fields.replace(' ', ', ')}' {fault}"
        ):
            read_scan(source(tmp_path / "a.pcd"))
    else:
        assert read_scan(source(tmp_path / "a.pcd")).points == pytest.approx(make_cloud(), rel=1e-6)


@pytest.mark.parametrize("suffix", [".stl", ".ply", ".obj"])
def test_a_mesh_becomes_points_spread_over_its_faces(suffix, tmp_path):
    trimesh.creation.box((10, 20, 30)).export(tmp_path / f"box{suffix}")
    read_cloud = read_scan(source(tmp_path / f"box{suffix}"))
    assert np.abs(np.abs(read_cloud.points) / [5, 10, 15]).max(axis=1) == pytest.approx(
        np.ones(len(read_cloud.points))
    )
    assert "were spread over the 12 faces" in str(read_cloud.notes[-1])


def test_points_without_a_measurement_are_left_out_and_counted(tmp_path):
    points = make_cloud()
    points[3] = np.nan
    points[5, 1] = np.inf
    points[10:14] = 0
    (tmp_path / "a.ply").write_bytes(make_file("h.ply", points))
    read_cloud = read_scan(source(tmp_path / "a.ply"))
    assert len(read_cloud.points) == 194
    assert [note.what.split()[0] for note in read_cloud.notes] == ["2", "4"]


@pytest.mark.parametrize("kind", FORMATS[3:9])
def test_a_truncated_cloud_is_damaged(kind, tmp_path):
    data = make_file(kind, make_cloud())
    (tmp_path / kind).write_bytes(data[: len(data) - 900])
    with pytest.raises(InputError, match=f"{kind}: is damaged or no "):
        read_scan(source(tmp_path / kind))


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("none.xyz", None, "there is no such file"),
        ("a.xyz", b"", "the file is empty"),
        (
            "a.dxf",
            b"LASF",
            "is not a kind of point cloud that camgen reads; give one of .ply, .pcd",
        ),
        ("a.xyz", b"1 2 3\n" * 99, "has 99 usable points; a scan needs 100 or more"),
        ("a.xyz", b"nan nan nan\n" * 500, "has 0 usable points"),
        ("a.txt", b"Dear all,\nthe scan follows.\n", "has no line of three numbers"),
        ("a.txt", b"\x00\x01\x02" * 50, "is not a text"),
        ("a.xyz", b"1 2 3\n" * 99 + b"1 2\n", "'1 2' is not a point (line 100)"),
        (
            "a.ply",
            b"solid\n",
            "is damaged or no PLY point cloud: its head has no beginning or no end",
        ),
        ("a.pcd", b"VERSION 0.7\n", "is damaged or no PCD point cloud: its head has no DATA"),
        ("a.stl", b"solid x\nendsolid x\n", "a.stl: "),
    ],
)
def test_a_file_that_is_not_a_scan_is_refused_in_one_line(name, data, message, tmp_path, capsys):
    if data is not None:
        (tmp_path / name).write_bytes(data)
    assert run_localize(PARTS / "rfa1.stl", tmp_path / name, "-o", tmp_path / "frame.toml") == 2
    errors = capsys.readouterr().err
    assert message in errors
    assert errors.count("\n") == 1
    assert not (tmp_path / "frame.toml").exists()


def test_a_model_without_faces_is_refused(tmp_path, capsys):
    (tmp_path / "points.ply").write_bytes(make_file("g.ply", make_cloud()))
    (tmp_path / "a.xyz").write_bytes(make_file("a.xyz", make_cloud()))
    assert (
        run_localize(tmp_path / "points.ply", tmp_path / "a.xyz", "-o", tmp_path / "frame.toml")
        == 2
    )
    assert "has no faces" in capsys.readouterr().err


@pytest.mark.skipif(not SHARED.is_dir(), reason="the shared data is not beside the repository")
def test_real_clouds_are_read():
    """The expected bounds and counts were measured with other software."""
    milk = read_scan(source(SHARED / "data" / "milk.pcd")).points
    assert milk.shape == (12575, 3)
    assert milk.min(axis=0) == pytest.approx([0.17866, -0.21077, -0.82682], abs=1e-5)
    assert milk.max(axis=0) == pytest.approx([0.32538, 9e-05, -0.63615], abs=1e-5)
    assert read_scan(source(SHARED / "data" / "samp24-utm.pcd")).points.shape == (7492, 3)
    assert read_scan(source(SHARED / "data" / "lamppost.pcd")).points.shape == (1771, 3)
    with pytest.raises(InputError, match="has 5 usable points"):
        read_scan(source(SHARED / "trimesh" / "points_ascii_with_lists.ply"))
