"""``camgen init`` with settings of the user: ``--set``, ``--material`` and a library of tools."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Any

import ezdxf
import pytest

from camgen.cli import main
from camgen.model.materials import MATERIALS

QUESTION = (
    "plate.dxf: the outline c1 has a gap of 0.5 mm, so inside and outside of c2-c3, which it "
    "encloses, would be swapped (near x 0, y 0.25); input.join = 0.501 closes it; if it is meant "
    "to be open, leave its layer out with input.layers\n"
)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a plate whose outline lacks 0.5 mm, with a window and a hole of 5 mm in it."""
    monkeypatch.chdir(tmp_path)
    document = ezdxf.new("R2010", units=4)
    space = document.modelspace()
    space.add_lwpolyline([(0, 0), (100, 0), (100, 60), (0, 60), (0, 0.5)])
    space.add_lwpolyline([(30, 20), (70, 20), (70, 40), (30, 40)], close=True)
    space.add_circle((10, 10), 2.5)
    document.saveas("plate.dxf")
    return tmp_path


def read_job(folder: Path) -> dict[str, Any]:
    return tomllib.loads((folder / "plate.toml").read_text(encoding="utf-8"))


def test_operations_are_not_proposed_for_an_outline_with_a_gap(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["init", "plate.dxf", "--operations"]) == 2
    assert capsys.readouterr().err == f"camgen: error: {QUESTION}"
    assert not (folder / "plate.toml").exists()


def test_a_job_without_operations_states_the_question(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["init", "plate.dxf"]) == 0
    assert f"proposed  no operations: {QUESTION}" in capsys.readouterr().err
    assert "# Proposed" not in (folder / "plate.toml").read_text(encoding="utf-8")


def test_the_value_of_the_question_answers_it(folder: Path) -> None:
    assert main(["init", "plate.dxf", "--operations", "--set", "input.join=0.501"]) == 0
    job = read_job(folder)
    assert job["input"]["join"] == 0.501
    assert [row["kind"] for row in job["operations"]] == ["drill", "follow", "follow"]
    assert job["operations"][1]["ids"] == ["c2"]
    assert job["operations"][2]["nesting"] == "outer"
    assert main(["build", "plate.dxf", "--post", "gcode"]) == 0


def test_depths_follow_from_the_thickness_that_is_set(folder: Path) -> None:
    sets = ["--set", "input.join=0.501", "--set", "stock.thickness=5", "--set", "post.work=G55"]
    assert main(["init", "plate.dxf", "--operations", *sets]) == 0
    job = read_job(folder)
    assert (job["stock"]["thickness"], job["post"]) == (5, {"work": "G55"})
    # 0.5 mm below the material, and 2.5 mm / tan(59 deg) = 1.51 mm for the tip of the drill.
    assert [row["depth"] for row in job["operations"]] == [7.0, 5.5, 5.5]


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("input.joint=1", '--set input.joint=1: unknown key "joint" ([input]); nearest is join'),
        ("tools.0.feed=1", "--set tools.0.feed=1: there is no tools.0: the job has 0 rows of"),
    ],
)
def test_an_unknown_setting_is_refused(
    folder: Path, capsys: pytest.CaptureFixture[str], setting: str, message: str
) -> None:
    assert main(["init", "plate.dxf", "--set", setting]) == 2
    assert message in capsys.readouterr().err
    assert not (folder / "plate.toml").exists()


CLOSED = ["init", "plate.dxf", "--set", "input.join=0.501"]


def test_feeds_of_a_material_are_written_with_their_source(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*CLOSED, "--operations", "--material", "aluminium"]) == 0
    job, text = read_job(folder), (folder / "plate.toml").read_text(encoding="utf-8")
    assert job["stock"]["material"] == "aluminium"
    drill, mill = job["tools"]
    # HIT, HSS drills: 300 feet a minute around 5 mm, and 0.0052 inch a turn there, between
    # 3/16 inch (0.005) and 1/4 inch (0.006).
    turns = 300 * 304.8 / (math.pi * 5)
    assert drill["speed"] == pytest.approx(turns, rel=0.01)
    feed = 0.005 + 0.001 * (5 / 25.4 - 3 / 16) / (1 / 16)
    assert drill["feed"] == pytest.approx(feed * 25.4 * drill["speed"] / 60, rel=0.01)
    assert f"feed = {drill['feed']}  # HIT Tooling Parameter Sheet" in text
    assert f"plunge = {mill['plunge']}  # HIT Tooling Parameter Sheet" in text
    assert "placeholder:" not in text
    assert "2 tools: depths are placeholders" in capsys.readouterr().err
    assert main(["build", "plate.dxf", "--post", "gcode"]) == 0
    assert "set-up    no limit exceeded: passes, plunges, depth, feed of a tooth and" in (
        capsys.readouterr().err
    )


def test_a_material_without_charts_is_refused(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*CLOSED, "--material", "cheese"]) == 2
    assert capsys.readouterr().err == (
        "camgen: error: --material cheese: there are no charts for this material; one of "
        f"{', '.join(MATERIALS)}\n"
    )
    assert not (folder / "plate.toml").exists()


def test_a_material_is_for_a_flat_drawing(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    part = Path(__file__).parents[2] / "fixtures" / "parts" / "rfa1.stl"
    assert main(["init", str(part), "--material", "steel"]) == 2
    assert "drawing (--material); leave it out" in capsys.readouterr().err
    assert not list(folder.glob("*.toml"))


def test_the_library_is_named_in_the_job_and_its_tools_are_used(folder: Path) -> None:
    library = """\
[[tools]]
name = "HSS 5"
number = 7
kind = "drill"
diameter = 5.0
feed = 3.0
speed = 2000.0
"""
    (folder / "shop.toml").write_text(library, encoding="utf-8")
    assert main([*CLOSED, "--operations", "--set", "tool.file=shop.toml"]) == 0
    job = read_job(folder)
    assert job["tool"]["file"] == "shop.toml"
    named = [(tool["name"], tool["number"]) for tool in job["tools"]]
    assert named == [("mill 8", 8)]
    assert [row["tool"] for row in job["operations"]] == ["HSS 5", "mill 8", "mill 8"]
    assert main(["build", "plate.dxf", "--post", "gcode"]) == 0
    assert "T7 M6" in (folder / "plate.ngc").read_text(encoding="utf-8")
