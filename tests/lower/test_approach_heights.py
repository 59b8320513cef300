"""Height at which the feed begins, above passes that start below the top face."""

from __future__ import annotations

import pytest

from camgen.lower.runs import plunge
from camgen.model.job import ProcessTable
from camgen.model.program import MoveJ
from camgen.pipeline import build
from tests.support.drawn import contour, part, rectangle

APPROACH, CLEARANCE = 1.5, 12.0


@pytest.mark.parametrize("entry", ["plunge", "ramp"])
@pytest.mark.parametrize("shape", ["closed", "open"])
def test_every_pass_is_approached_above_the_top_of_the_material(entry: str, shape: str) -> None:
    """A ramp begins at the previous pass. The rapid motion still ends above the top face."""
    drawn = rectangle(0, 0, 60, 40)
    side = "auto"
    if shape == "open":
        drawn, side = contour([(0, 0), (60, 0)], closed=False), "left"
    operation = {
        "kind": "follow",
        "side": side,
        "depth": 6.0,
        "passes": 3,
        "entry": entry,
        "lead_in": 4.0,
    }
    process = {"spindle": 9000, "approach": APPROACH, "clearance": CLEARANCE, "plunge": 5}
    result = build(part(drawn), post="gcode", job={"operation": operation, "process": process})
    heights = []
    for motion in result.program.body:
        if isinstance(motion, MoveJ):
            heights.append(motion.target.origin[2])
    assert heights.count(pytest.approx(APPROACH)) >= 1
    assert all(height >= APPROACH - 1e-9 for height in heights)
    assert set(heights) <= {APPROACH, CLEARANCE, 50.0}


def test_the_plunge_is_a_third_of_the_feed_unless_it_is_set() -> None:
    assert plunge(ProcessTable(feed=9.0)) == pytest.approx(3.0)
    assert plunge(ProcessTable(feed=9.0, plunge=2.0)) == 2.0
