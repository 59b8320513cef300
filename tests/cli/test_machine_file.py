"""The command line with `cell.machine`: travel, contradictions and faults."""

import json
import shutil
from pathlib import Path

import pytest

from camgen.cli import main

FIXTURES = Path(__file__).parents[2] / "fixtures"
BRACKET = str(FIXTURES / "parts" / "bracket.dxf")
#: The file of each post and the name of its program.
MACHINES = {"grbl": ("router.txt", "bracket.nc"), "gcode": ("mill.ini", "bracket.ngc")}
#: Work offsets with which the bracket and the links to it are within the travel.
INSIDE = {"grbl": "[-200, -150, -60, 0, 0, 0]", "gcode": "[50, 50, -100, 0, 0, 0]"}


@pytest.fixture(autouse=True)
def _in_a_folder_with_both_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name, _ in MACHINES.values():
        shutil.copy(FIXTURES / "machines" / name, tmp_path)


def build(post: str, *settings: str, file: str = "") -> int:
    sets = [f"--set=cell.machine={file or MACHINES[post][0]}"]
    sets += [f"--set={setting}" for setting in settings]
    return main(["build", BRACKET, "--post", post, *sets])


def read_error(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> str:
    """The message of the only line printed; no program may be written."""
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    written = {path.name for path in tmp_path.iterdir()}
    assert not written & {program for _, program in MACHINES.values()}
    return lines[0].removeprefix("camgen: error: ")


@pytest.mark.parametrize("post", MACHINES)
def test_the_program_is_that_of_a_job_without_machine(post: str, tmp_path: Path) -> None:
    program = tmp_path / MACHINES[post][1]
    assert main(["build", BRACKET, "--post", post]) == 0
    plain = program.read_text().splitlines()
    assert build(post) == 0
    named = program.read_text().splitlines()
    # The digest of the job is that of its settings.
    different = [a for a, b in zip(plain, named, strict=True) if a != b]
    assert len(different) == 1
    assert different[0].startswith("(camgen ")


@pytest.mark.parametrize("post", MACHINES)
def test_without_a_work_offset_the_extent_is_compared_with_the_travel(
    post: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert build(post) == 0
    summary = capsys.readouterr().err
    travel = {"grbl": "400 x 300 x 90", "gcode": "317.5 x 203.2 x 152.4"}[post]
    file = MACHINES[post][0]
    assert f"86 x 56 x 50 mm within the travel of {travel} mm of {file}; not proven" in summary
    assert "the time is that of a machine" not in summary


@pytest.mark.parametrize("post", MACHINES)
def test_the_report_states_that_a_program_is_within_the_travel(
    post: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report = tmp_path / "report.json"
    sets = ["--set", f"cell.machine={MACHINES[post][0]}"]
    sets += ["--set", f"cell.base_from_work={INSIDE[post]}"]
    assert main(["build", BRACKET, "--post", post, *sets, "--report", str(report)]) == 0
    assert "states no work offset" not in capsys.readouterr().err
    table = json.loads(report.read_text())["machine"]
    assert table["file"] == MACHINES[post][0]
    assert table["placed"] is True
    checks = json.loads(report.read_text())["checks"]
    assert checks == {"reach": "not checked", "collision": "not checked", "limits": "ok"}
    # The bracket is 80 x 50 mm, the tool of 6 mm runs outside of it.
    x, y, z = json.loads(INSIDE[post])[:3]
    assert table["extent_mm"] == [[x - 3, y - 3, z], [x + 83, y + 53, z + 50]]


@pytest.mark.parametrize(
    ("post", "offset", "excess"),
    [
        ("grbl", "[-70, -150, -60, 0, 0, 0]", "axis X would be at 13 mm, its travel ends at 0 mm"),
        ("grbl", "[-200, -299, -60, 0, 0, 0]", "axis Y would be at -302 mm, its travel begins at"),
        ("grbl", "[-200, -150, -40, 0, 0, 0]", "axis Z would be at 10 mm, its travel ends at 0 mm"),
        ("gcode", "[50, 2, -100, 0, 0, 0]", "axis Y would be at -1 mm, its travel begins at 0 mm"),
    ],
)
def test_a_program_beyond_the_travel_is_exit_code_3(
    post: str, offset: str, excess: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert build(post, f"cell.base_from_work={offset}") == 3
    file, program = MACHINES[post]
    line = read_error(capsys, tmp_path)
    assert line.startswith(f"{program}: the program leaves the travel of {file}: {excess}")
    assert " (line " in line
    assert line.endswith("; move the part: cell.base_from_work")


def test_the_line_of_a_refusal_is_the_one_that_leaves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert build("grbl") == 0
    text = (tmp_path / "bracket.nc").read_text().splitlines()
    assert build("grbl", "cell.base_from_work=[-70, -150, -60, 0, 0, 0]") == 3
    error = capsys.readouterr().err
    number = int(error.partition(" (line ")[2].partition(")")[0])
    assert "X83" in text[number - 1]


def test_a_program_longer_than_the_travel_is_exit_code_3(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    listing = (tmp_path / "router.txt").read_text().replace("$130=400.000", "$130=85.000")
    (tmp_path / "small.txt").write_text(listing)
    assert build("grbl", file="small.txt") == 3
    line = read_error(capsys, tmp_path)
    what = "axis X runs from -3 to 83 mm, 86 mm; its travel is 85 mm"
    assert line.startswith(f"bracket.nc: the program leaves the travel of small.txt: {what}")


def test_a_feed_above_the_rates_is_a_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The job asks for 20 mm/s in X and Y and 5 mm/s in Z; an axis does 500 mm/min, 8.333 mm/s."""
    assert build("grbl") == 0
    assert "ask for more than" not in capsys.readouterr().err
    listing = (tmp_path / "router.txt").read_text()
    for setting in ("$110=5000", "$111=3500", "$112=600"):
        listing = listing.replace(setting, setting.partition("=")[0] + "=500")
    (tmp_path / "slow.txt").write_text(listing)
    assert build("grbl", file="slow.txt") == 0
    summary = capsys.readouterr().err
    assert "ask for more than slow.txt allows, down to 8.333 mm/s" in summary
    assert "the controller runs them slower, and the time counts that" in summary


def test_a_tool_length_of_the_program_counts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With G43 the machine stands higher by the length of the tool, here 60 mm."""
    sets = (f"cell.base_from_work={INSIDE['gcode']}", "tool.length=60")
    assert build("gcode", *sets, "post.tool=1") == 3
    assert "axis Z would be at 10 mm, its travel ends at 0 mm" in read_error(capsys, tmp_path)
    assert build("gcode", *sets) == 0


def build_plate(*settings: str) -> int:
    """A plate that three tools mill on LinuxCNC, each 80 mm long."""
    job = str(FIXTURES / "cases" / "motor-plate" / "job.toml")
    part = str(FIXTURES / "parts" / "motor.dxf")
    sets = [f"--set={setting}" for setting in ("cell.machine=mill.ini", *settings)]
    return main(["build", part, "--post", "gcode", "--job", job, *sets])


def test_each_tool_counts_with_its_length(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The home is 50 mm above the work zero, the travel of Z is 152.4 mm."""
    assert build_plate("cell.base_from_work=[50, 50, -130, 0, 0, 0]") == 0
    capsys.readouterr()
    (tmp_path / "motor.ngc").unlink()
    assert build_plate("cell.base_from_work=[50, 50, -100, 0, 0, 0]") == 3
    assert "axis Z would be at 30 mm, its travel ends at 0 mm" in read_error(capsys, tmp_path)
    # A tool that is 100 mm longer than another one needs as much more travel: 61 and 100 mm.
    assert build_plate("tools.2.length=180") == 3
    assert "161 mm; its travel is 152.4 mm" in read_error(capsys, tmp_path)
    assert not (tmp_path / "motor.ngc").exists()


@pytest.mark.parametrize(
    ("post", "file", "settings", "message"),
    [
        ("gcode", "router.txt", (), "job: router.txt is for GRBL, the post for another controller"),
        ("grbl", "mill.ini", (), "job: mill.ini is for LinuxCNC, the post for another controller"),
        ("rapid", "router.txt", (), "job: router.txt is for GRBL, the post for another controller"),
        ("vplus", "mill.ini", (), "job: mill.ini is for LinuxCNC, the post for another controller"),
        ("grbl", "none.txt", (), "none.txt: no such file (cell.machine); "),
        ("grbl", ".", (), ".: is a folder (cell.machine); "),
        (
            "grbl",
            "router.txt",
            ("process.acceleration=500",),
            "job: router.txt states the acceleration of each axis (process.acceleration); ",
        ),
        (
            "grbl",
            "router.txt",
            ("cell.robot=3-axis mill",),
            "job: cell.robot and cell.machine both describe the machine (cell.machine); ",
        ),
    ],
)
def test_a_contradiction_is_exit_code_2(
    post: str,
    file: str,
    settings: tuple[str, ...],
    message: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert build(post, *settings, file=file) == 2
    assert read_error(capsys, tmp_path).startswith(message)


def test_a_damaged_file_is_exit_code_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "bad.txt").write_text("$120=-1\n$110=1\n")
    assert build("grbl", file="bad.txt") == 2
    assert read_error(capsys, tmp_path).startswith("bad.txt: has no $130 (cell.machine); save all")


def test_the_machine_file_is_relative_to_its_job_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "jobs"
    folder.mkdir()
    (tmp_path / "router.txt").rename(folder / "own.txt")
    (folder / "job.toml").write_text('[cell]\nmachine = "own.txt"\n')
    assert main(["build", BRACKET, "--post", "grbl", "--job", "jobs/job.toml"]) == 0
    assert "of own.txt" in capsys.readouterr().err
    # A build does not overwrite the files that it reads.
    sets = ["--job", "jobs/job.toml", "-o", "jobs/own.txt"]
    assert main(["build", BRACKET, "--post", "grbl", *sets]) == 2
    assert (folder / "own.txt").read_text() == (FIXTURES / "machines/router.txt").read_text()


@pytest.mark.parametrize("post", MACHINES)
def test_without_a_machine_the_acceleration_is_named(
    post: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["build", BRACKET, "--post", post]) == 0
    assert "the time is that of a machine with 500 mm/s2" in capsys.readouterr().err
    assert main(["build", BRACKET, "--post", post, "--set", "process.acceleration=900"]) == 0
    assert "the time is that of a machine" not in capsys.readouterr().err
