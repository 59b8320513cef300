"""`camgen verify --part`: gouges and rest material compared with a drawing, and exit codes."""

import math
import re
from pathlib import Path

import pytest

from camgen.cli import main

PLATE = Path(__file__).parents[2] / "fixtures" / "parts" / "plate.dxf"
JOB = """
[operation]
depth = 5.0
passes = 2
[tool]
diameter = 3.0
[process]
spindle = 9000.0
[stock]
thickness = 5.0
held = "tape"
"""


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mill.toml").write_text(JOB)
    assert main(["build", str(PLATE), "--post", "gcode", "--job", "mill.toml", "-q"]) == 0
    return "plate.ngc"


def verify(program: str, *more: str) -> int:
    return main(["verify", program, "--post", "gcode", "--part", str(PLATE), *more])


def test_a_built_program_cuts_what_it_may(program: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert verify(program, "--job", "mill.toml") == 0
    printed = capsys.readouterr().out
    assert "end mill of 3 mm, 5 mm deep: no gouge, no rapid motion in material" in printed
    assert re.search(r"removed +3\.8 cm3", printed)
    excess = re.search(r"excess +at z -2\.5 -5: ([0-9.]+) mm2 in inner corners", printed)
    assert excess
    # Two contours bound the ring between the circles of 3.3 and 6 mm, too narrow for a 3 mm tool.
    assert float(excess[1]) == pytest.approx(math.pi * (3.0**2 - 1.65**2), abs=0.02)
    assert "remark: the part within c1 is cut free" in printed


def test_without_a_job_the_drawing_is_the_part(
    program: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert verify(program, "--set", "tool.diameter=3.0") == 0
    assert "stock.thickness is not set" in capsys.readouterr().out


def test_a_wider_tool_gouges_with_its_line(
    program: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert verify(program, "--set", "tool.diameter=3.1") == 3
    printed = capsys.readouterr()
    assert "plate.ngc line 21: cuts 0.05 mm into material that must stay" in printed.out
    assert re.search(
        r"plate\.ngc: \d+ faults in the material, first: cuts 0\.05 mm .*\(plate\.ngc line 21\)",
        printed.err,
    )


def test_a_rapid_motion_that_was_lowered_is_found(
    program: str, capsys: pytest.CaptureFixture[str]
) -> None:
    text = Path(program).read_text()
    lines = text.splitlines()
    # The link from the first hole to the second one loses the lift before it.
    lift = next(k for k, line in enumerate(lines) if line.startswith("G0 Z") and k > 20)
    del lines[lift]
    Path(program).write_text("\n".join(lines) + "\n")
    assert verify(program, "--job", "mill.toml") == 3
    # There is a comment before the rapid motion to the second hole.
    assert f"plate.ngc line {lift + 2}: rapid motion through material" in capsys.readouterr().out


def test_a_solid_part_is_refused(program: str) -> None:
    assert (
        main(["verify", program, "--post", "gcode", "--part", str(PLATE.with_name("rfa1.stl"))])
        == 2
    )
