"""`camgen place`: the search for the place of a part, and the programs of the written files."""

import contextlib
import tomllib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import camgen
from camgen.cli import main
from camgen.model.pose import pose_from_values
from camgen.pipeline import make_job_post
from camgen.pipeline.inputs import read_inputs
from camgen.pipeline.place import Case, Request, Spot, examine, list_spots, make_case, reach_joints
from camgen.read.files import Files
from tests.support.plate import write_plate

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


#: The edges of both large faces, with any roll of the tool.
BOTH_SIDES = JOB.replace("e1-e4", "e1-e4 e9-e12").replace(
    "[cell]", "[tool]\nsymmetric = true\n[cell]"
)
COMMAND = ["place", "plate.obj", "--post", "rapid", "--height", "150"]


def write_job(folder: Path, text: str = JOB) -> Path:
    """The plate with its job beside it."""
    plate = write_plate(folder)
    plate.with_suffix(".toml").write_text(text)
    return plate


@pytest.fixture(scope="module", autouse=True)
def short_search() -> Iterator[None]:
    """A search on fewer faces and with fewer builds, which is as good for a comparison."""
    with pytest.MonkeyPatch.context() as patch:
        for name in ("_BUILT", "_SECOND_BUILT", "_IMPROVED", "_ROUNDS"):
            patch.setattr(f"camgen.pipeline.place.{name}", 1)
        for name in ("_FACES", "_EXAMINED"):
            patch.setattr(f"camgen.pipeline.place.{name}", 2)
        yield


@pytest.fixture
def plate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return write_job(tmp_path)


@pytest.fixture(scope="module")
def placed(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The file that the search writes: it takes seconds."""
    folder = tmp_path_factory.mktemp("placed")
    write_job(folder)
    with contextlib.chdir(folder):
        assert main([*COMMAND, "-q", "-o", "found.toml"]) == 0
    return (folder / "found.toml").read_bytes()


def test_the_written_place_reaches_all_edges_and_a_second_search_finds_it_again(
    plate: Path, placed: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(camgen.NoSafeProgram):
        camgen.build(plate, post="rapid", job=plate.with_suffix(".toml"))
    assert main([*COMMAND, "-o", "a.toml"]) == 0
    output = capsys.readouterr()
    assert plate.with_name("a.toml").read_bytes() == placed
    cell = tomllib.loads(placed.decode())["cell"]
    assert cell["robot"] == "IRB 120"
    assert output.out == f"base_from_work = {cell['base_from_work']}\n"
    assert "4 of 4 edges" in output.err.splitlines()[0]
    # The part is level, straight ahead of the robot, at the height of --height.
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


def test_the_place_of_the_job_is_kept_if_the_search_finds_no_better_one(
    plate: Path, placed: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    plate.with_suffix(".toml").write_text(JOB.partition("[cell]")[0] + placed.decode())
    assert main([*COMMAND, "-o", "b.toml"]) == 0
    first, *others = (line.split() for line in capsys.readouterr().err.splitlines())
    rows = [row for row in (first, *others) if row[0] in ("place", "next", "the")]
    edges = [int(row[row.index("of") - 1]) for row in rows]
    assert edges[0] == max(edges) == 4
    assert plate.with_name("b.toml").read_text().count("[cell]") == 1


def read_case(plate: Path) -> Case:
    job = camgen.job(str(plate.with_suffix(".toml")))
    read = read_inputs([plate], job, make_job_post("rapid", job, "job").cell(), Files())
    return make_case(read.part, job, read.cell, Request(plate, "rapid"))


def test_collisions_add_no_edge_to_those_that_the_joints_reach(plate: Path) -> None:
    case = read_case(plate)
    spots = [spot for spot in list_spots(case, 150.0) if spot.resting_pose == 0][::3]
    by_joints = reach_joints(case, spots, case.resting_poses[0].samples).shares
    with_collisions = np.concatenate([examine(case, spot).shares for spot in spots])
    assert (with_collisions <= by_joints + 1e-9).all()
    assert with_collisions.max() == pytest.approx(1)
    assert by_joints.min() == 0


def test_a_spot_is_the_position_of_the_middle_of_the_bottom(plate: Path) -> None:
    case = read_case(plate)
    frame = case.base_from_work(Spot(400.0, 90.0, 90.0))
    assert np.allclose(frame.apply([30, 20, 0]), [400, 0, 90])
    assert np.allclose(frame.rotation @ [1, 0, 0], [0, 1, 0])


def test_a_part_that_is_turned_over_stands_on_the_face(plate: Path) -> None:
    case = read_case(plate)
    assert [resting.is_own for resting in case.resting_poses] == [True, False, False]
    for index, resting in enumerate(case.resting_poses):
        assert resting.face is not None
        frame = case.base_from_work(Spot(400.0, 90.0, 30.0, index))
        assert np.allclose(frame.rotation @ resting.face.normal, [0, 0, -1])
        heights = [frame.apply(vertex)[2] for vertex in case.solid.vertices.tolist()]
        assert min(heights) == pytest.approx(90)
        assert sum(abs(height - 90) < 1e-6 for height in heights) == 4


@pytest.fixture(scope="module")
def two_set_ups(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a plate with the two set-ups that together work all selected edges."""
    folder = tmp_path_factory.mktemp("two")
    write_job(folder, BOTH_SIDES)
    with contextlib.chdir(folder):
        assert main([*COMMAND, "-q", "-o", "place.toml"]) == 0
    return folder


def test_two_set_ups_work_all_edges_and_each_edge_once(two_set_ups: Path) -> None:
    assert {path.name for path in two_set_ups.iterdir()} == {
        *("plate.obj", "plate.toml", "place.toml"),
        *("place-1.toml", "place-1.mod", "place-1.svg"),
        *("place-2.toml", "place-2.mod", "place-2.svg"),
    }
    cells, edges = [], []
    for number in (1, 2):
        tables = tomllib.loads((two_set_ups / f"place-{number}.toml").read_text())
        assert tables["operation"] == {"offset": 2}
        job = two_set_ups / f"place-{number}.toml"
        result = camgen.build(two_set_ups / "plate.obj", post="rapid", job=job)
        cells.append(tables["cell"])
        edges += [path.id for path in result.tour.paths]
    assert sorted(edges) == sorted(f"e{number}" for number in (1, 2, 3, 4, 9, 10, 11, 12))
    # The part is turned over between the two set-ups.
    up = [pose_from_values(cell["base_from_work"]).rotation[2] for cell in cells]
    assert float(up[0] @ up[1]) < 0.1
    alone = tomllib.loads((two_set_ups / "place.toml").read_text())
    assert list(alone) == ["cell"]
    assert alone["cell"] == cells[0]


@pytest.mark.parametrize("number", [1, 2])
def test_the_program_of_a_set_up_is_that_of_its_job_file(two_set_ups: Path, number: int) -> None:
    program = two_set_ups / f"place-{number}.mod"
    before = program.read_bytes()
    with contextlib.chdir(two_set_ups):
        words = ["build", "plate.obj", "--post", "rapid", "--job", f"place-{number}.toml"]
        assert main([*words, "-q", "-o", program.name]) == 0
    assert program.read_bytes() == before


def test_a_job_file_states_the_resting_face_and_the_set_up_of_each_edge(
    two_set_ups: Path,
) -> None:
    texts = [(two_set_ups / f"place-{number}.toml").read_text() for number in (1, 2)]
    turned = next(text for text in texts if "rests_on" in text)
    cell = tomllib.loads(turned)["cell"]
    assert "fixtures" not in cell
    normal = ", ".join(f"{value:g}" for value in cell["rests_on"])
    assert f"the normal [{normal}]" in turned
    assert "# turned from how the file has it by " in turned
    for text in texts:
        lines = [line for line in text.splitlines() if line.startswith("# e")]
        assert [line.split(":")[0] for line in lines] == [
            f"# e{k}" for k in (1, 2, 3, 4, 9, 10, 11, 12)
        ]
        assert all(" in set-up " in line for line in lines)


@pytest.mark.parametrize("number", [1, 2])
def test_a_job_file_has_the_proof_and_the_notes_of_its_program(
    two_set_ups: Path, number: int
) -> None:
    job = two_set_ups / f"place-{number}.toml"
    result = camgen.build(two_set_ups / "plate.obj", post="rapid", job=job)
    comments = [line for line in job.read_text().splitlines() if line.startswith("# ")]
    assert result.where is not None
    untested = ", ".join(map(str, result.where.untested))
    assert any(line.startswith(f"# collision: not proven: {untested};") for line in comments)
    notes = [note for note in result.notes if note.kind != "skipped"]
    assert notes
    for note in notes:
        assert any(line.startswith(f"# {note.kind}: {note.what}") for line in comments)


def test_the_result_does_not_advise_to_run_the_command_again(
    plate: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A block stands where the tool would have to be along one of the edges."""
    block = "fixtures = [[-20, 41, -20, 80, 51, 40]]\n"
    plate.with_suffix(".toml").write_text(JOB + block)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("camgen.pipeline.place._FACES", 0)
        assert main([*COMMAND, "-o", "a.toml"]) == 0
    output = capsys.readouterr().err + plate.with_name("a.toml").read_text()
    assert "mm not worked" in output
    assert "no roll and no tilt up to 30 deg helps" in output
    assert "another place" not in output


def test_an_edited_program_is_not_replaced_and_nothing_is_written(
    two_set_ups: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_job(tmp_path, BOTH_SIDES)
    text = (two_set_ups / "place-2.mod").read_text()
    edited = text.replace("MoveL", "MoveL ", 1)
    assert edited != text
    (tmp_path / "place-2.mod").write_text(edited)
    with contextlib.chdir(tmp_path):
        assert main([*COMMAND, "-o", "place.toml"]) == 2
    assert "was edited" in capsys.readouterr().err.splitlines()[-1]
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"plate.obj", "plate.toml", "place-2.mod"}


def test_a_name_that_is_read_is_not_written(
    plate: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    job = plate.with_name("part-2.toml")
    plate.with_suffix(".toml").rename(job)
    assert main([*COMMAND, "--job", "part-2.toml", "-o", "part.toml"]) == 2
    assert "would overwrite part-2.toml" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--post", "gcode"], "needs an arm"),
        (["--post", "rapid", "--height", "nan"], "is not a height"),
        (["--post", "rapid", "--set", "cell.robot=COBOTTA"], "closed form"),
        (["--post", "rapid", "--height", "9000"], "no place was found"),
    ],
)
def test_a_part_without_a_place_is_refused_and_nothing_written(
    plate: Path, capsys: pytest.CaptureFixture[str], words: list[str], message: str
) -> None:
    if "gcode" in words:
        plate.with_suffix(".toml").write_text('[input]\nselect = "all"\n')
    assert main(["place", "plate.obj", *words, "-o", "found.toml"]) in (2, 3)
    output = capsys.readouterr().err
    assert message in output.splitlines()[-1]
    assert not plate.with_name("found.toml").exists()


def test_a_part_without_a_resting_face_is_refused(
    plate: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two cones of 80 sides at one rim: each of their faces is 3 deg from the next."""
    turns = np.arange(80) * np.pi / 40
    rim = np.column_stack([30 * np.cos(turns), 30 * np.sin(turns), np.zeros(80)])
    lines = [f"v {x} {y} {z}" for x, y, z in [*rim.tolist(), (0, 0, 30), (0, 0, -30)]]
    for number in range(80):
        first, second = number + 1, (number + 1) % 80 + 1
        lines += [f"f {first} {second} 81", f"f {second} {first} 82"]
    plate.write_text("\n".join(lines))
    plate.with_suffix(".toml").write_text(JOB.replace("e1-e4", "all"))
    assert main([*COMMAND, "-o", "found.toml"]) == 2
    assert "plate.obj: has no face on which it rests" in capsys.readouterr().err
    assert not plate.with_name("found.toml").exists()
