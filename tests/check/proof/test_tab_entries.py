"""A ramp may end over a tab: its lap begins there, and still covers its contour."""

from __future__ import annotations

from pathlib import Path

import ezdxf
import pytest

from camgen.cli import main

JOB = """\
[stock]
thickness = 5.0
held = "tape"
[process]
spindle = 9000
[tool]
diameter = 1.5
[operation]
depth = 5.5
passes = 8
tabs = 4
entry = "ramp"
"""
#: The tab is 5 mm long, with 1.5 mm for the mill and a flank of 1 mm on each side: from x 17.84 to
#: x 9.33 in the middle of the lower side. The ramp to 4.8125 mm ends over it, and the lap comes
#: down from it at x 9.33.
ENTRY = "G1 X9.335 Z-4.812\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def build(folder: Path, width: float) -> str:
    """The program that cuts a rectangle of this width, mm, out of its stock."""
    document = ezdxf.new("R2010", units=4)
    document.modelspace().add_lwpolyline([(0, 0), (width, 0), (width, 20), (0, 20)], close=True)
    document.saveas("part.dxf")
    (folder / "part.toml").write_text(JOB, encoding="utf-8")
    assert main(["build", "part.dxf", "--post", "gcode", "-q"]) == 0
    return (folder / "part.ngc").read_text(encoding="utf-8")


@pytest.mark.parametrize("width", [32.0, 44.0])
def test_a_ramp_that_ends_over_a_tab_or_on_its_flank_is_proven(folder: Path, width: float) -> None:
    assert "Z-4.5" in build(folder, width)  # the height of the tabs


@pytest.mark.parametrize(
    "lines",
    [
        "G1 X2 Z-4.5\n",  # it stays up
        "G1 X5 Z-4.5\nG1 X4 Z-4.812\n",  # it comes down 5 mm behind the tab
    ],
)
def test_a_lap_that_begins_with_a_longer_tab_is_not_proven(
    folder: Path, capsys: pytest.CaptureFixture[str], lines: str
) -> None:
    text = build(folder, 32.0)
    assert text.count(ENTRY) == 1
    (folder / "edited.ngc").write_text(text.replace(ENTRY, lines), encoding="utf-8")
    capsys.readouterr()
    command = [
        "verify",
        "edited.ngc",
        "--post",
        "gcode",
        "--part",
        "part.dxf",
        "--job",
        "part.toml",
    ]
    main(command)
    assert "contour c1 is not worked at" in capsys.readouterr().out
