"""Fixtures of a mill on the command line: summaries, refusals and exit codes."""

import json
import re
from pathlib import Path

import ezdxf
import numpy as np
import pytest
import trimesh
from ezdxf import recover

from camgen.cli import main

MOTOR = Path(__file__).parents[2] / "fixtures" / "parts" / "motor.dxf"
JOB = """
[operation]
depth = 3.0
[process]
spindle = 9000.0
[stock]
thickness = 3.0
held = "tape"
[cell]
fixtures = [[10, -10, -5, 30, 20, 30], [100, 60, -5, 140, 80, 12]]
"""
Captured = pytest.CaptureFixture[str]


@pytest.fixture
def job(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "mill.toml"
    file.write_text(JOB)
    return file


def build(*more: str) -> int:
    return main(["build", str(MOTOR), "--post", "gcode", "--job", "mill.toml", *more])


def verify(*more: str) -> int:
    return main(["verify", "motor.ngc", "--post", "gcode", "--job", "mill.toml", *more])


def list_motions(name: str) -> list[str]:
    """The lines of a program without its remarks."""
    return [line for line in Path(name).read_text().splitlines() if line[:1] in "GMS"]


def move_clamp(job: Path) -> None:
    """The first clamp stands 10 mm farther to the right than the program was built for."""
    job.write_text(JOB.replace("[10, -10, -5, 30,", "[20, -10, -5, 40,"))


@pytest.mark.usefixtures("job")
def test_the_summary_has_skipped_paths_and_the_distance_from_the_fixtures(
    capsys: Captured,
) -> None:
    assert build("--report", "report.json") == 0
    output = capsys.readouterr().err
    assert (
        "mm of path c1 (fixtures 1, 2: the tool would come nearer than 2 mm, cell.margin)" in output
    )
    row = re.search(
        r"^fixtures +2 fixtures: the tool keeps (\S+) mm beside and (\S+) mm above them",
        output,
        re.M,
    )
    assert row is not None
    assert 2 <= float(row[1]) < 2.1
    assert float(row[2]) == 10
    assert "its holder is not judged, tool.holder is not set" in output
    table = json.loads(Path("report.json").read_text())["fixtures"]
    assert table == {
        "examined": 2,
        "margin_mm": 2.0,
        "aside_mm": pytest.approx(float(row[1]), abs=0.01),
        "above_mm": 10.0,
    }
    holder = ["--set", "tool.holder=[[-10, -10, 0, 10, 10, 40]]", "--force"]
    assert build(*holder) == 0
    output = capsys.readouterr().err
    assert re.search(r"^fixtures +2 fixtures: the tool with its holder keeps", output, re.M)


@pytest.mark.parametrize("part", [["--part", str(MOTOR)], []], ids=["drawing", "no drawing"])
def test_a_clamp_that_was_moved_is_found_without_the_plan(
    job: Path, part: list[str], capsys: Captured
) -> None:
    assert build("-q") == 0
    assert verify(*part) == 0
    assert re.search(r"^fixtures +2 fixtures: the tool keeps", capsys.readouterr().out, re.M)
    move_clamp(job)
    assert verify(*part) == 3
    output = capsys.readouterr()
    assert "beside the fixtures, first: the tool runs" in output.err
    assert re.search(
        r"^motor\.ngc line \d+: the tool runs [\d.]+ mm deep into fixture 1, at ", output.out, re.M
    )
    assert re.search(r"^fixtures +2 fixtures, \d+ motions too near", output.out, re.M)


def test_a_replayed_program_is_judged_and_not_changed(job: Path, capsys: Captured) -> None:
    assert build("-q") == 0
    job.write_text(JOB[JOB.index("[cell]") :])
    words = ["build", "motor.ngc", "--post", "gcode", "--job", "mill.toml", "-o", "again.ngc"]
    assert main(words) == 0
    output = capsys.readouterr().err
    assert re.search(r"^fixtures +2 fixtures: the tool keeps", output, re.M)
    job.write_text("[cell]\nfixtures = [[20, -10, -5, 40, 20, 30]]\n")
    assert main([*words, "--force"]) == 3
    assert "into fixture 1" in capsys.readouterr().err


def test_a_mesh_is_a_fixture_like_its_box(job: Path, capsys: Captured) -> None:
    box = trimesh.creation.box(bounds=[[10, -10, -5], [30, 20, 30]])
    box.export("clamp.stl")
    assert build("-q", "-o", "box.ngc") == 0
    capsys.readouterr()
    job.write_text(JOB.replace("[10, -10, -5, 30, 20, 30]", '"clamp.stl"'))
    assert build("-o", "mesh.ngc") == 0
    assert list_motions("box.ngc") == list_motions("mesh.ngc")
    assert "2 fixtures: the tool keeps" in capsys.readouterr().err


def draw_clamp() -> None:
    """A copy of the drawing with the outline of the first clamp on a layer."""
    document, _ = recover.readfile(MOTOR)
    corners = [(10, -10), (30, -10), (30, 20), (10, 20)]
    document.modelspace().add_lwpolyline(corners, close=True, dxfattribs={"layer": "CLAMPS"})
    document.saveas("clamped.dxf")


DRAWN = JOB.replace("[10, -10, -5, 30, 20, 30]", '{ layer = "Clamps", bottom = -5, top = 30 }')


def test_a_drawn_clamp_is_a_fixture_like_its_box(job: Path, capsys: Captured) -> None:
    draw_clamp()
    assert build("-q", "-o", "motor.ngc") == 0
    job.write_text(DRAWN)
    words = ["--post", "gcode", "--job", "mill.toml"]
    assert main(["build", "clamped.dxf", *words, "--preview", "look.svg"]) == 0
    assert list_motions("clamped.ngc") == list_motions("motor.ngc")
    output = capsys.readouterr().err
    assert "1 contour on layer CLAMPS: clamps, not machined (cell.fixtures)" in output
    assert "fixture 1, top at z 30 mm" in Path("look.svg").read_text()
    # The drawing is the one of the user, else the one that stands unchanged beside the program.
    assert main(["verify", "clamped.ngc", *words, "--part", "clamped.dxf"]) == 0
    assert "2 fixtures: the tool keeps" in capsys.readouterr().out
    assert main(["verify", "clamped.ngc", "--job", "mill.toml"]) == 0
    assert "2 fixtures: the tool keeps" in capsys.readouterr().out
    assert main(["verify", "clamped.ngc", *words]) == 2
    output = capsys.readouterr().err
    assert "the clamps on layer Clamps are drawn, and no drawing is given" in output
    assert output.count("\n") == 1


def test_a_drawn_clamp_that_was_moved_is_found(job: Path, capsys: Captured) -> None:
    draw_clamp()
    job.write_text(DRAWN)
    words = ["--post", "gcode", "--job", "mill.toml"]
    assert main(["build", "clamped.dxf", *words, "-q"]) == 0
    document = ezdxf.readfile("clamped.dxf")
    for outline in document.modelspace().query('LWPOLYLINE[layer=="CLAMPS"]'):
        outline.translate(10, 0, 0)
    document.saveas("clamped.dxf")
    assert main(["verify", "clamped.ngc", *words, "--part", "clamped.dxf"]) == 3
    assert "mm deep into fixture 1" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("fixtures", "message"),
    [
        ("[[1, 2, 3]]", "a box has 3 values (cell.fixtures); give two corners: [x, y, z, x, y, z]"),
        ("[[0, 0, 0, 1, 1, 0]]", "a box has no size (cell.fixtures)"),
        ('["none.stl"]', "none.stl"),
        ("[5]", "fixtures must be"),
        ('[{ layer = "CLAMPS" }]', "fixtures must be"),
        ('[{ layer = "CLAMPS", top = 5 }]', "no closed outline on layer 'CLAMPS' (cell.fixtures)"),
    ],
)
@pytest.mark.usefixtures("job")
def test_bad_values_are_refused_in_one_line(fixtures: str, message: str, capsys: Captured) -> None:
    assert build("--set", f"cell.fixtures={fixtures}") == 2
    output = capsys.readouterr()
    assert (output.out, output.err.count("\n")) == ("", 1)
    assert message in output.err


@pytest.mark.usefixtures("job")
def test_a_fixture_over_the_whole_part_and_strict_are_refused(capsys: Captured) -> None:
    assert build("--set", "cell.fixtures=[[-50, -50, -5, 200, 200, 20]]") == 3
    assert "no path is left" in capsys.readouterr().err
    assert build("--strict", "--set", "input.layers=['OUTLINE']") == 3
    assert "--strict and 1 left out" in capsys.readouterr().err


@pytest.mark.usefixtures("job")
@pytest.mark.parametrize("name", ["look.svg", "look.png", "look.html"])
def test_a_preview_shows_the_fixtures(name: str) -> None:
    assert build("-q", "--preview", name) == 0
    with_fixtures = Path(name).read_bytes()
    assert build("-q", "--force", "--preview", name, "--set", "cell.fixtures=[]") == 0
    without_fixtures = Path(name).read_bytes()
    assert with_fixtures != without_fixtures
    if name.endswith(".svg"):
        assert with_fixtures.count(b'class="fixture"') == 3  # two, and one in the legend
        assert b"fixture 2, top at z 12 mm" in with_fixtures
        assert b'class="blocked" d="M' in with_fixtures
        assert b'class="fixture"' not in without_fixtures
    if name.endswith(".html"):
        assert b"fixture 2" in with_fixtures


@pytest.mark.usefixtures("job")
def test_the_picture_is_yellow_at_clamps() -> None:
    import cv2  # noqa: PLC0415 (as camgen loads it)

    assert build("-q", "--preview", "look.png") == 0
    image = cv2.imread("look.png").astype(np.int64)
    blue, _, red = np.moveaxis(image, -1, 0)
    assert ((red - blue) > 80).mean() > 0.02
