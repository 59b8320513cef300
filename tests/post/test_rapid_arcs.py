"""RAPID: arcs keep the angle of the manual for any circle point."""

import math
import re

import pytest
from camgen_posts.rapid import Rapid

from camgen.lang.rapid.strict import read
from camgen.lang.rapid.ways import find_arc_faults
from camgen.model.pose import TOOL_DOWN, Pose, translation
from camgen.model.program import Joints, MoveC, MoveJ, MoveL, Program
from camgen.post.plugins import make_post
from tests.support.whole import whole

Point = tuple[float, float, float]
HOME = MoveJ(Joints((0.0, 0.0, 0.0, 0.0, 0.5, 0.0)), 100.0)
RADIUS = 30.0
TARGET = re.compile(r"\[\[(-?[\d.]+),(-?[\d.]+),(-?[\d.]+)\]")


def point(angle: float) -> Point:
    return (RADIUS * math.cos(angle), RADIUS * math.sin(angle), 0.0)


def print_arc(sweep: float, share: float) -> str:
    """The text of an arc of `sweep`, rad, with its circle point after `share` of it."""
    start, via, end = (Pose(TOOL_DOWN, point(part * sweep)) for part in (0.0, share, 1.0))
    body = (HOME, MoveJ(start, 50.0), MoveC(via, end, 20.0), MoveL(start, 20.0))
    program = Program("part", translation(300, -75, 100), translation(0, 0, 100), whole(body))
    post = make_post(Rapid, {})
    return post.render(post.prepare(program, 0.05))[0].text


def measure_angles(text: str) -> list[float]:
    """The angle between circle point and end of each MoveC, seen from its start, deg."""
    place: Point = (0.0, 0.0, 0.0)
    angles = []
    for statement in text.split(";"):
        points = [(float(x), float(y), float(z)) for x, y, z in TARGET.findall(statement)]
        if " MoveC " in statement:
            bearings = [math.atan2(y - place[1], x - place[0]) for x, y, _ in points]
            angles.append(abs(math.degrees(bearings[1] - bearings[0])))
        if " Move" in statement and points:
            place = points[-1]
    return angles


@pytest.mark.parametrize("share", [0.26, 0.4, 0.5, 0.6, 0.74])
@pytest.mark.parametrize("degrees", [3.0, 4.5, 4.9, 5.2, 6.0, 8.0, 9.5, 11.0, 30.0, 119.0])
def test_circle_point_and_end_keep_an_angle(degrees: float, share: float) -> None:
    angles = measure_angles(print_arc(math.radians(degrees), share))
    assert all(angle >= 1.1 for angle in angles)
    # An angle at a circle is half of the arc between its legs. The manual asks for it at the start,
    # the read-back at both ends.
    smaller = degrees * min(share, 1 - share) / 2
    if smaller > 1.3:
        assert len(angles) == 1
        assert angles[0] == pytest.approx(degrees * (1 - share) / 2, abs=0.05)
    elif smaller < 1.2:
        assert angles == []


@pytest.mark.parametrize(
    ("degrees", "fault", "remark"),
    [(3.4, "nearly on its chord", ""), (3.8, "", "less than 1 deg apart"), (4.2, "", "")],
)
def test_an_arc_below_the_angle_of_the_manual_is_found(
    degrees: float, fault: str, remark: str
) -> None:
    """With the circle point in the middle the angle is a quarter of the sweep."""
    sweep = math.radians(degrees)
    faults, remarks = find_arc_faults(point(0.0), point(sweep / 2), point(sweep))
    assert fault in faults
    assert bool(faults) == bool(fault)
    assert remark in remarks
    assert bool(remarks) == bool(remark)


def test_an_arc_below_the_angle_of_the_manual_is_a_remark_of_the_read_back() -> None:
    text = print_arc(math.radians(5.2), 0.5)
    assert text.count("MoveC") == 1
    assert read({"a": text}, {}).findings == ()
    # The chord is at x = 29.9382 there: atan(0.0228 / 1.361) is 0.96 deg.
    flat = text.replace("[29.969,1.361,", "[29.961,1.361,")
    assert flat != text
    assert [fault.what for fault in read({"a": flat}, {}).findings if fault.level == "unusual"] == [
        "the circle point and the end of an arc are less than 1 deg apart"
    ]
