"""Where a part should stand: found by search, and what is written is what was built."""

import contextlib
import tomllib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import camgen
from camgen.cli import main
from camgen.model.pose import pose_from_values
from camgen.pipeline import poster_of
from camgen.pipeline.inputs import read_inputs
from camgen.pipeline.place import Spot, _case, _far, _grid, _nominal
from camgen.read.files import Files

#: A plate of 60 x 40 x 10 mm in front of an IRB 120, too far away for some of its upper edges.
JOB = """
[input]
select = "e1-e4"
[operation]
offset = 2
[cell]
robot = "IRB 120"
base_from_work = [760, -20, 150, 0, 0, 0]
"""


COMMAND = ["place", "plate.obj", "--post", "rapid", "--height", "150"]


def write_plate(folder: Path) -> Path:
    corners = np.array([(x, y, z) for x in (0, 60) for y in (0, 40) for z in (0, 10)], dtype=float)
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners]
    lines += [f"f {a + 1} {c + 1} {b + 1}\nf {a + 1} {d + 1} {c + 1}" for a, b, c, d in faces]
    (folder / "plate.obj").write_text("\n".join(lines))
    (folder / "plate.toml").write_text(JOB)
    return folder / "plate.obj"


@pytest.fixture(scope="module", autouse=True)
def two_built() -> Iterator[None]:
    """The best two places are built instead of three, which is as good for a comparison."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("camgen.pipeline.place._BUILT", 2)
        yield


@pytest.fixture
def plate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return write_plate(tmp_path)


@pytest.fixture(scope="module")
def placed(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """What the search writes: it takes seconds."""
    folder = tmp_path_factory.mktemp("placed")
    write_plate(folder)
    with contextlib.chdir(folder):
        assert main([*COMMAND, "-q", "-o", "found.toml"]) == 0
    return (folder / "found.toml").read_bytes()


def test_the_place_that_is_written_reaches_more_and_is_the_same_again(
    plate: Path, placed: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(camgen.NoSafeProgram):
        camgen.build(plate, post="rapid", job=plate.with_suffix(".toml"))
    assert main([*COMMAND, "-o", "a.toml"]) == 0
    said = capsys.readouterr()
    assert plate.with_name("a.toml").read_bytes() == placed
    cell = tomllib.loads(placed.decode())["cell"]
    assert cell["robot"] == "IRB 120"
    assert said.out == f"base_from_work = {cell['base_from_work']}\n"
    assert "4 of 4 edges" in said.err.splitlines()[0]
    # The part stands at the height that was asked for, level, straight ahead.
    frame = pose_from_values(cell["base_from_work"])
    assert np.allclose(frame.rotation[2], [0, 0, 1])
    middle = frame.apply([30, 20, 0])
    assert middle[2] == pytest.approx(150)
    assert middle[1] == pytest.approx(0, abs=0.01)
    tables = {
        "input": {"select": "e1-e4"},
        "operation": {"offset": 2},
        "cell": {"file": str(plate.with_name("a.toml"))},
    }
    assert len(camgen.build(plate, post="rapid", job=tables).tour.paths) == 4


def test_the_job_s_own_place_is_kept_where_none_is_better(
    plate: Path, placed: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    plate.with_suffix(".toml").write_text(JOB.partition("[cell]")[0] + placed.decode())
    assert main([*COMMAND, "-o", "b.toml"]) == 0
    first, *others = (line.split() for line in capsys.readouterr().err.splitlines())
    rows = [row for row in (first, *others) if row[0] in ("place", "next", "the")]
    edges = [int(row[row.index("of") - 1]) for row in rows]
    assert edges[0] == max(edges) == 4
    assert plate.with_name("b.toml").read_text().count("[cell]") == 1


def test_no_place_has_more_edges_than_its_joints_reach(plate: Path) -> None:
    """What the grid says is a bound: with collisions and all looks it is never more."""
    job = camgen.job(str(plate.with_suffix(".toml")))
    read = read_inputs([plate], job, poster_of("rapid", job, "job").cell(), Files())
    case = _case(read.part, job, read.cell)
    spots = list(_grid(case, 150.0))[::11]
    bounds = [most for most, _ in _far(case, spots)]
    counts = [_nominal(case, spot) for spot in spots]
    assert all(count <= most for count, most in zip(counts, bounds, strict=True))
    assert max(counts) == 4
    assert min(bounds) == 0


def test_a_spot_is_where_the_middle_of_the_bottom_is(plate: Path) -> None:
    job = camgen.job(str(plate.with_suffix(".toml")))
    read = read_inputs([plate], job, poster_of("rapid", job, "job").cell(), Files())
    case = _case(read.part, job, read.cell)
    frame = case.base_from_work(Spot(400.0, 90.0, 90.0))
    assert np.allclose(frame.apply([30, 20, 0]), [400, 0, 90])
    assert np.allclose(frame.rotation @ [1, 0, 0], [0, 1, 0])


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--post", "gcode"], "needs an arm"),
        (["--post", "rapid", "--height", "nan"], "is no height"),
        (["--post", "rapid", "--set", "cell.robot=COBOTTA"], "closed form"),
        (["--post", "rapid", "--height", "9000"], "no place was found"),
    ],
)
def test_what_cannot_be_placed_is_told_and_nothing_written(
    plate: Path, capsys: pytest.CaptureFixture[str], words: list[str], message: str
) -> None:
    if "gcode" in words:
        plate.with_suffix(".toml").write_text('[input]\nselect = "all"\n')
    assert main(["place", "plate.obj", *words, "-o", "found.toml"]) in (2, 3)
    said = capsys.readouterr().err
    assert message in said.splitlines()[-1]
    assert not plate.with_name("found.toml").exists()
