"""Travel passes over the fixtures of a mill, and only there it is raised."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import camgen
from camgen.model.errors import JobError, NoSafeProgram
from camgen.model.program import MoveJ
from camgen.pipeline import Result

PLATE = Path(__file__).parents[2] / "fixtures" / "parts" / "motor.dxf"
#: A bar across the middle of the plate, lower than the slots are apart.
BAR = [30.0, 66.0, -5.0, 95.0, 70.0, 34.0]


def build(*fixtures: object, post: str = "gcode", **tables: Any) -> Result:
    job: dict[str, Any] = {
        "input": {"layers": ["SLOTS"]},
        "operation": {"depth": 3.0},
        "tool": {"diameter": 4.0},
        "process": {"spindle": 9000.0},
        "cell": {"fixtures": list(fixtures)},
    }
    for name, table in tables.items():
        job[name] = {**job.get(name, {}), **table} if isinstance(table, dict) else table
    return camgen.build(PLATE, post=post, job=job)


def least_height(result: Result, box: list[float], radius: float) -> float:
    """Lowest z of a rapid motion while a tool of this radius is over a box, by sampling."""
    columns = result.program.columns
    least = np.inf
    for k in np.flatnonzero(columns.moves_are(MoveJ))[1:].tolist():
        start, end = columns.ends[k - 1 : k + 1]
        places = start + np.linspace(0, 1, 500)[:, None] * (end - start)
        dx = np.maximum(np.maximum(box[0] - places[:, 0], places[:, 0] - box[3]), 0)
        dy = np.maximum(np.maximum(box[1] - places[:, 1], places[:, 1] - box[4]), 0)
        over = np.hypot(dx, dy) < radius
        least = min(least, float(places[over, 2].min(initial=np.inf)))
    return least


@pytest.mark.parametrize("post", ["gcode", "grbl"])
def test_travel_over_a_bar_is_its_top_and_the_safety_high(post: str) -> None:
    result = build(BAR, post=post)
    assert least_height(result, BAR, 2 + 2 - 1e-6) == pytest.approx(44.0)
    assert len(result.tour.paths) == 2
    free = build(post=post)
    assert least_height(free, BAR, 2.0) == pytest.approx(20.0)


def test_no_safety_is_the_margin() -> None:
    result = build(BAR, cell={"safety": 0.0})
    assert least_height(result, BAR, 2 + 2 - 1e-6) == pytest.approx(36.0)
    assert len(result.tour.paths) == 2


def test_only_the_links_over_it_are_raised() -> None:
    """A post beside the plate is crossed by none: the program is that without it."""
    free, raised = (
        result.program.columns.ends for result in (build(), build([-30, 40, -5, -20, 50, 34]))
    )
    assert np.array_equal(free[1:], raised[1:])


def test_up_across_and_down_are_three_motions() -> None:
    """Lifts that meet in one line are one motion."""
    result = build(BAR)
    text = result.text.splitlines()
    up = text.index("G0 Z44")
    assert text[up - 1].startswith(("G1", "G2", "G3"))
    assert text[up + 1].startswith("(path")
    assert text[up + 2].startswith("G0 X")
    assert " Z" not in text[up + 2]
    assert text[up + 3] == "G0 Z2"


def test_a_low_fixture_raises_nothing() -> None:
    assert least_height(build([*BAR[:5], 9.0]), BAR, 2.0) == pytest.approx(20.0)


def test_a_holder_is_lifted_over_what_the_tool_passes() -> None:
    """The holder's end is 5 mm above the tip and 25 mm wide: the bar 6 mm aside is below it."""
    aside = [75.0, 40.0, -5.0, 95.0, 50.0, 34.0]
    tool = {"length": 65.0, "holder": [[-25, -25, 0, 25, 25, 60]]}
    bare = build(aside)
    assert least_height(bare, aside, 10.0) == np.inf
    held = build(aside, tool=tool)
    assert least_height(held, aside, 25.0) >= 34 + 10 - 5 - 1e-6


def test_home_is_above_all_fixtures() -> None:
    """Also where no travel crosses them: the tool comes from anywhere."""
    result = build([200, 200, -5, 210, 210, 90])
    assert result.program.columns.ends[0, 2] == pytest.approx(100)
    with pytest.raises(JobError, match="a home at z 60 mm is not 10 mm above all fixtures"):
        build([200, 200, -5, 210, 210, 90], cell={"home": [0, 0, 60]})


def test_tool_changes_and_the_way_home_pass_over_it_too() -> None:
    corner = [-8.0, -8.0, -5.0, 12.0, 8.0, 34.0]
    tools = [
        {"name": "a", "number": 1, "diameter": 4.0},
        {"name": "b", "number": 2, "diameter": 3.0},
    ]
    rows = [{"kind": "follow", "tool": name, "layers": ["SLOTS"]} for name in ("a", "b")]
    result = build(corner, input={}, tools=tools, operations=rows)
    assert least_height(result, corner, 4.0) >= 44
    assert result.fixtures is not None
    assert result.fixtures.above >= 10


def test_a_machine_that_is_too_low_is_named(tmp_path: Path) -> None:
    listing = "$11=0.01\n$12=0.002\n$100=250\n$101=250\n$102=250\n$110=2000\n$111=2000\n$112=1000\n"
    listing += "$120=200\n$121=200\n$122=100\n$130=300\n$131=300\n$132=40\n"
    (tmp_path / "mill.txt").write_text(listing)
    machine = {"machine": str(tmp_path / "mill.txt"), "home": [0, 0, 44]}
    with pytest.raises(NoSafeProgram, match="axis Z"):
        build(BAR, post="grbl", cell=machine)
