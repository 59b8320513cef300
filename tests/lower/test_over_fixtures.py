"""Links of a mill over its fixtures are raised, and no others."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import camgen
from camgen.model.errors import JobError, NoSafeProgram
from camgen.model.program import MoveJ
from camgen.pipeline import Result

PLATE = Path(__file__).parents[2] / "fixtures" / "parts" / "motor.dxf"
#: A bar across the middle of the plate, between the slots.
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


def lowest_link(result: Result, box: list[float], radius: float) -> float:
    """Lowest z of a rapid motion, mm, while a tool of `radius` is over a box, by sampling.

    Infinite if no rapid motion crosses the box.
    """
    columns = result.program.columns
    least = np.inf
    for k in np.flatnonzero(columns.moves_are(MoveJ))[1:].tolist():
        start, end = columns.ends[k - 1 : k + 1]
        points = start + np.linspace(0, 1, 500)[:, None] * (end - start)
        dx = np.maximum(np.maximum(box[0] - points[:, 0], points[:, 0] - box[3]), 0)
        dy = np.maximum(np.maximum(box[1] - points[:, 1], points[:, 1] - box[4]), 0)
        above_box = np.hypot(dx, dy) < radius
        least = min(least, float(points[above_box, 2].min(initial=np.inf)))
    return least


@pytest.mark.parametrize("post", ["gcode", "grbl"])
def test_a_link_over_a_bar_keeps_the_safety_height_above_it(post: str) -> None:
    result = build(BAR, post=post)
    assert lowest_link(result, BAR, 2 + 2 - 1e-6) == pytest.approx(44.0)
    assert len(result.tour.paths) == 2
    free = build(post=post)
    assert lowest_link(free, BAR, 2.0) == pytest.approx(20.0)


def test_without_safety_a_link_keeps_the_margin() -> None:
    result = build(BAR, cell={"safety": 0.0})
    assert lowest_link(result, BAR, 2 + 2 - 1e-6) == pytest.approx(36.0)
    assert len(result.tour.paths) == 2


def test_a_fixture_that_no_link_crosses_changes_nothing() -> None:
    """The fixture is a post beside the plate."""
    free, raised = (
        result.program.columns.ends for result in (build(), build([-30, 40, -5, -20, 50, 34]))
    )
    assert np.array_equal(free[1:], raised[1:])


def test_a_raised_link_is_up_across_and_down() -> None:
    """Lifts on one vertical line are one motion."""
    result = build(BAR)
    text = result.text.splitlines()
    up = text.index("G0 Z44")
    assert text[up - 1].startswith(("G1", "G2", "G3"))
    assert text[up + 1].startswith("(path")
    assert text[up + 2].startswith("G0 X")
    assert " Z" not in text[up + 2]
    assert text[up + 3] == "G0 Z2"


def test_a_low_fixture_raises_nothing() -> None:
    assert lowest_link(build([*BAR[:5], 9.0]), BAR, 2.0) == pytest.approx(20.0)


def test_a_holder_is_lifted_over_a_bar_beside_the_tool() -> None:
    """The holder ends 5 mm above the tip and is 25 mm wide, so it is above a bar 6 mm aside."""
    aside = [75.0, 40.0, -5.0, 95.0, 50.0, 34.0]
    tool = {"length": 65.0, "holder": [[-25, -25, 0, 25, 25, 60]]}
    bare = build(aside)
    assert lowest_link(bare, aside, 10.0) == np.inf
    held = build(aside, tool=tool)
    assert lowest_link(held, aside, 25.0) >= 34 + 10 - 5 - 1e-6


def test_home_is_above_all_fixtures() -> None:
    """Fixtures that no link crosses count too: the tool may come from anywhere."""
    result = build([200, 200, -5, 210, 210, 90])
    assert result.program.columns.ends[0, 2] == pytest.approx(100)
    with pytest.raises(JobError, match="a home at z 60 mm is not 10 mm above all fixtures"):
        build([200, 200, -5, 210, 210, 90], cell={"home": [0, 0, 60]})


def test_tool_changes_and_the_route_home_are_raised_too() -> None:
    corner = [-8.0, -8.0, -5.0, 12.0, 8.0, 34.0]
    tools = [
        {"name": "a", "number": 1, "diameter": 4.0},
        {"name": "b", "number": 2, "diameter": 3.0},
    ]
    rows = [{"kind": "follow", "tool": name, "layers": ["SLOTS"]} for name in ("a", "b")]
    result = build(corner, input={}, tools=tools, operations=rows)
    assert lowest_link(result, corner, 4.0) >= 44
    assert result.fixtures is not None
    assert result.fixtures.above >= 10


def test_a_machine_without_room_for_a_raised_link_is_refused(tmp_path: Path) -> None:
    listing = "$11=0.01\n$12=0.002\n$100=250\n$101=250\n$102=250\n$110=2000\n$111=2000\n$112=1000\n"
    listing += "$120=200\n$121=200\n$122=100\n$130=300\n$131=300\n$132=40\n"
    (tmp_path / "mill.txt").write_text(listing)
    machine = {"machine": str(tmp_path / "mill.txt"), "home": [0, 0, 44]}
    with pytest.raises(NoSafeProgram, match="axis Z"):
        build(BAR, post="grbl", cell=machine)
