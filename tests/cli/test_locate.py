"""`camgen build --locate` on files: the settings of the photo, refusals, and `camgen verify`."""

import json
import shutil
from pathlib import Path

import pytest

from bench.render.shapes import circle, rounded
from camgen.check.photo import registration
from camgen.cli import main
from tests.support.part_photos import PIXEL, PLATE, photo, write_dxf

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"


@pytest.fixture(scope="module")
def files_of_desk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("desk")
    photo(folder / "photo.png", PLATE, 0.3)
    write_dxf(folder / "plate.dxf", PLATE)
    write_dxf(folder / "other.dxf", [rounded([(0, 0, 0), (30, 0, 0), (0, 50, 0)]), circle(9, 9, 4)])
    (folder / "photo.toml").write_text(f"[image]\nmm_per_px = {PIXEL}\n")
    (folder / "open.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" width="60mm" height="40mm" viewBox="0 0 60 40">'
        '<path d="M0 0L60 0L60 40" fill="none" stroke="#000"/></svg>'
    )
    (folder / "old.nc").write_text("G21 G90\nG0 X0 Y0 Z10\nG1 Z0 F300\nG1 X10\nG0 Z10\nM2\n")
    (folder / "curve.xyz").write_text("0,0,0\n10,0,2\n20,5,4\n")
    (folder / "empty.png").touch()
    for name in ("rfa1.stl", "gear.png"):
        shutil.copy(PARTS / name, folder)
    return folder


@pytest.fixture
def desk(files_of_desk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for file in files_of_desk.iterdir():
        shutil.copy(file, tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(registration, "_TURNS", 12)
    return tmp_path


BUILD = ["build", "plate.dxf", "--post", "rapid", "--locate", "photo.png"]


def test_the_summary_states_the_pose_of_the_part(
    desk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--preview", "plate.png", "--report", "plate.json", "-o", "made.mod"]
    assert main([*BUILD, *words]) == 0
    printed = capsys.readouterr()
    assert printed.out == ""
    lines = printed.err.splitlines()
    assert "photo     [camera] and [image] of photo.toml" in lines
    (row,) = [line for line in lines if line.startswith("located")]
    assert row.startswith("located   by photo.png: x ")
    assert "% of the outline fits, 0.00" in row
    assert "largest deviation 0.0" in row
    assert any(line.startswith("motion    verified: 2 contours") for line in lines)
    assert json.loads((desk / "plate.json").read_text())["located"]["photo"] == "photo.png"
    assert (desk / "plate.png").read_bytes().startswith(b"\x89PNG")


def test_the_settings_of_the_photo_may_be_in_the_job(
    desk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (desk / "plate.toml").write_text(f"[image]\nmm_per_px = {PIXEL}\n")
    assert main(BUILD) == 0
    summary = capsys.readouterr().err
    assert "warning   photo.toml is not used: [camera] and [image] are those of the job" in summary
    first = (desk / "plate.mod").read_text()
    (desk / "photo.toml").unlink()
    assert main(BUILD) == 0
    assert "photo.toml" not in capsys.readouterr().err
    assert (desk / "plate.mod").read_text() == first
    # Drawing and photo may have one job file.
    (desk / "photo.png").rename(desk / "plate.png")
    assert main([*BUILD[:-1], "plate.png"]) == 0
    assert "is not used" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["other.dxf"], 3, "photo.png: does not show other.dxf"),
        (["rfa1.stl"], 2, "rfa1.stl: is a 3-D part, and --locate places drawings; give a DXF"),
        (["gear.png", "--set", "image.mm_per_px=0.1"], 2, "gear.png: is a picture, and --locate"),
        (["old.nc"], 2, "old.nc: is a program, and --locate places drawings"),
        (["curve.xyz"], 2, "curve.xyz: is a curve in space, and --locate places drawings"),
        (["open.svg"], 2, "open.svg: no closed contour"),
        (["plate.dxf", "--locate", "none.png"], 2, "none.png: no such file"),
        (["plate.dxf", "--locate", "plate.dxf"], 2, "plate.dxf: is not a PNG"),
        (["plate.dxf", "--locate", "open.svg"], 2, "open.svg: is not a PNG"),
        (["plate.dxf", "--locate", ""], 2, ".: "),
        (["plate.dxf", "--locate", "empty.png"], 2, "empty.png: is empty"),
        (["plate.dxf", "--set", "input.origin=center"], 2, "input.origin and --locate both place"),
        (["plate.dxf", "--set", "page.size=A4"], 2, "page.size and --locate both place"),
        (["plate.dxf", "--start=1,2"], 2, "--start: [1.0, 2.0] is not a pose; give X,Y,TURN in mm"),
        (["plate.dxf", "--start=1,2,nan"], 2, "--start: [1.0, 2.0, nan] is not a pose"),
        (["plate.dxf", "--start=left"], 2, "--start: 'left' is not a pose"),
        (["plate.dxf", "--preview", "photo.png"], 2, "photo.png"),
    ],
)  # fmt: skip
def test_an_input_that_cannot_be_placed_is_refused_in_one_line(
    desk: Path, capsys: pytest.CaptureFixture[str], words: list[str], code: int, message: str
) -> None:
    before = sorted(desk.iterdir())
    assert main(["build", "--post", "gcode", "--locate", "photo.png", *words]) == code
    printed = capsys.readouterr()
    assert printed.out == ""
    (line,) = printed.err.splitlines()
    assert message in line
    assert sorted(desk.iterdir()) == before


@pytest.mark.usefixtures("desk")
def test_start_and_locate_are_refused_where_they_have_no_effect(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main([*BUILD[:-2], "--start=1,2,3"]) == 2
    assert "--start: has no effect without --locate" in capsys.readouterr().err
    assert main(["batch", "plate.dxf", "--post", "rapid", "--locate", "photo.png"]) == 2
    assert "batch: unknown argument '--locate'" in capsys.readouterr().err


@pytest.mark.usefixtures("desk")
def test_verify_does_not_compare_a_located_program_with_the_drawing_as_drawn(
    desk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*BUILD, "-q"]) == 0
    (desk / "plate.toml").write_text("")
    assert main(["verify", "plate.mod", "--post", "rapid"]) == 0
    assert "extents" in capsys.readouterr().out
    assert main(["verify", "plate.mod"]) == 2
    message = (
        "--post: is not given, and the place of the part comes from a photo; name the controller"
    )
    assert message in capsys.readouterr().err
    assert main(["verify", "plate.mod", "--post", "rapid", "--part", "plate.dxf"]) == 2
    assert "--part: lies as drawn" in capsys.readouterr().err
