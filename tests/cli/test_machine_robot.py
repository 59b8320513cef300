"""The command line with a machine of linear axes as the robot, and settings that name no file."""

from pathlib import Path

import pytest

from camgen.cli import main

BRACKET = str(Path(__file__).parents[2] / "fixtures" / "parts" / "bracket.dxf")
MILL = ["--set", "cell.robot=3-axis mill"]


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(("post", "name"), [("gcode", "bracket.ngc"), ("grbl", "bracket.nc")])
def test_the_mill_builds_and_its_travel_is_checked(
    post: str, name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["build", BRACKET, "--post", post, *MILL]) == 0
    summary = capsys.readouterr().err
    assert "3-axis mill reaches all of it within its travel (" in summary
    assert "the work zero is at 400 250 -250 mm of 3-axis mill" in summary
    assert (tmp_path / name).exists()


@pytest.mark.parametrize("post", ["gcode", "grbl"])
def test_a_part_beyond_the_travel_is_one_line_and_exit_code_3(
    post: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The bracket ends at x 80 mm, the tool runs 3 mm beside it, from work zero at 750 mm."""
    offset = ["--set", "cell.base_from_work=[750, 100, -300, 0, 0, 0]"]
    assert main(["build", BRACKET, "--post", post, *MILL, *offset]) == 3
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("camgen: error: bracket.dxf: 3-axis mill cannot run path c1 at 83 ")
    assert "axis X would be at 833 mm, its travel ends at 800 mm" in lines[0]
    assert lines[0].endswith("; move the part in the machine: cell.base_from_work")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("post", ["gcode", "grbl"])
@pytest.mark.parametrize("arm", ["IRB 120", "Cobra s600", "COBOTTA"])
def test_an_arm_on_a_machines_post_is_exit_code_2(
    post: str, arm: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["build", BRACKET, "--post", post, "--set", f"cell.robot={arm}"]) == 2
    assert capsys.readouterr().err == (
        "camgen: error: job: the post is for a machine, not for an arm (cell.robot); leave it out\n"
    )
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("setting", "line"),
    [
        (
            'cell.file="none.toml"',
            "none.toml: cannot be read: No such file or directory (cell.file); "
            "give a file that can be read",
        ),
        (
            'cell.fixtures=["none.stl"]',
            "none.stl: no such file (cell.fixtures); give a file that exists",
        ),
        (
            'image.background="none.png"',
            "none.png: no such file (image.background); give a file that exists",
        ),
        (
            'camera.file="none.yaml"',
            "none.yaml: no such file (camera.file); give a file that exists",
        ),
    ],
)
def test_a_file_that_is_not_there_is_named_with_its_setting(
    setting: str, line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["build", BRACKET, "--post", "gcode", "--set", setting]) == 2
    assert capsys.readouterr().err == f"camgen: error: {line}\n"
