"""G-code: LinuxCNC deviates by at most `G64 P` at the ends of arcs.

The planner of LinuxCNC 2.9 executed 3,000 joints of arcs and lines (docs/posts/gcode.md). The rule
is computed here from the text, independently of the post.
"""

from __future__ import annotations

import cmath
import math
import re
from pathlib import Path

import pytest

import camgen
from camgen.model.pose import TOOL_DOWN, Pose, translation
from camgen.model.program import MoveC, MoveJ, MoveL, Program
from camgen.post.contract import prepare_program, render_program
from camgen.post.plugins import find_post, make_post
from tests.support.whole import whole

CASES = Path(__file__).parents[2] / "fixtures" / "cases"
SHARED = Path(__file__).parents[3] / "shared" / "controllers" / "linuxcnc"
WORD = re.compile(r"([XYZIJF])(-?[\d.]+)")


def rate_overlap(arc: float, line: float, feed: float) -> float:
    """The maximum at which LinuxCNC may rate the overlap of an arc and a line, mm/s.

    Each has half of 500 mm/s2, the arc half of that along its path. From rest to rest over its
    length a motion reaches sqrt(a s). The rate is half of the mean of both.
    """
    speeds = min(feed, math.sqrt(125 * arc)), min(feed, math.sqrt(250 * line))
    seconds = min(arc / speeds[0], line / speeds[1])
    return (min(speeds[0], 125 * seconds) + min(speeds[1], 250 * seconds)) / 4


def list_bad_ends(text: str) -> list[int]:
    """Lines with an arc after which LinuxCNC lets motions overlap, by its printed numbers.

    A turn by `t` rad is run straight on at 0.1 x 500 mm/s2 x 1 ms / 2 t = 0.025 / t mm/s.
    """
    place, feed, bad = [0.0, 0.0, 0.0], 0.0, []
    arc: tuple[complex, bool, float] | None = None
    for number, line in enumerate(text.splitlines(), 1):
        words = {letter: float(value) for letter, value in WORD.findall(line)}
        feed = words.get("F", feed * 60) / 60
        goal = [words.get(letter, value) for letter, value in zip("XYZ", place, strict=True)]
        step, rise = complex(goal[0] - place[0], goal[1] - place[1]), goal[2] - place[2]
        if line.startswith("G1 ") and arc:
            tangent, left, length = arc
            level = cmath.phase(step / tangent) if step else 0.0
            across = abs(step) * cmath.exp(1j * level)
            turn = math.atan2(math.hypot(across.imag, rise), across.real)
            rate = rate_overlap(length, math.hypot(abs(step), rise), feed)
            is_fast = rate * turn > 0.025
            is_inward = (level if left else -level) > 0 and turn < math.radians(5.5)
            if is_fast and (rise or is_inward):
                bad.append(number - 1)
        if not line.startswith("("):
            arc = None
        if re.match(r"G[23] ", line):
            spoke = step - complex(words.get("I", 0.0), words.get("J", 0.0))
            left = line.startswith("G3")
            tangent = spoke * (1j if left else -1j)
            start = -complex(words.get("I", 0.0), words.get("J", 0.0))
            sweep = cmath.phase(spoke / start) % math.tau
            length = abs(spoke) * (sweep if left else math.tau - sweep)
            arc = tangent / abs(tangent), left, length
        place = goal
    return bad


@pytest.mark.parametrize(
    "file", sorted(CASES.glob("*/expected/part.ngc")), ids=lambda f: f.parts[-3]
)
def test_no_golden_has_a_bad_arc_end(file: Path) -> None:
    assert list_bad_ends(file.read_text()) == []


def text_of(
    body: tuple[MoveC | MoveL, ...], start: Pose, tolerance: float = 0.01, decimals: int = 3
) -> str:
    program = Program(
        "part", translation(0, 0, 0), translation(0, 0, 0), whole((MoveJ(start, 50.0), *body))
    )
    options = {"path_tolerance": tolerance, "decimals": decimals}
    post = make_post(find_post("gcode"), options)
    return render_program(post, prepare_program(post, program, 0.01))[0].text


def place_at(x: float, y: float, z: float = 0.0) -> Pose:
    return Pose(TOOL_DOWN, (x, y, z))


def turn_inward(radius: float, degrees: float, tolerance: float = 0.01, feed: float = 20.0) -> str:
    """The program of a quarter of a circle, followed by a line of 20 mm towards its centre."""
    turn, half = math.radians(degrees), radius * math.sqrt(0.5)
    end = place_at(radius - 20 * math.sin(turn), 20 * math.cos(turn))
    body = (
        MoveC(place_at(half, -half), place_at(radius, 0), feed, 1.0, work=True),
        MoveL(end, feed, work=True),
    )
    return text_of(body, place_at(0, -radius), tolerance)


@pytest.mark.parametrize("radius", [0.5, 2.0, 7.2, 20.0, 200.0])
@pytest.mark.parametrize("degrees", [0.3, 1.0, 3.0])
def test_an_arc_before_an_inward_line_ends_in_a_chord(radius: float, degrees: float) -> None:
    plain, text = turn_inward(radius, degrees, 0.0), turn_inward(radius, degrees)
    assert list_bad_ends(text) == []
    assert text.count("\nG1 ") == plain.count("\nG1 ") + 1
    assert text.count("\nG3 ") == 1


def test_a_motion_of_length_0_is_not_the_line_after_the_arc() -> None:
    end = place_at(20 - 20 * math.sin(0.01), 20 * math.cos(0.01))
    half = 20 * math.sqrt(0.5)
    body = (
        MoveC(place_at(half, -half), place_at(20, 0), 20.0, 1.0, work=True),
        MoveL(place_at(20, 0), 20.0, 1.0, work=True),
        MoveL(end, 20.0, work=True),
    )
    # These are the chord and both lines.
    assert text_of(body, place_at(0, -20)).count("\nG1 ") == 3


def test_an_arc_that_is_too_flat_without_its_end_becomes_lines() -> None:
    """Its sagitta is 200 x 0.0065^2 / 8 = 1.06 um, and less than a digit without its end."""
    turns = -0.0065, -0.00325, 0.0
    start, via, end = (place_at(200 * math.cos(turn) - 200, 200 * math.sin(turn)) for turn in turns)
    line = MoveL(place_at(-0.35, 20.0), 20.0, work=True)
    body = MoveC(via, end, 20.0, 1.0, work=True), line
    assert text_of(body, start, 0.0).count("\nG3 ") == 1
    text = text_of(body, start)
    assert (text.count("\nG3 "), text.count("\nG1 ")) == (0, 3)


@pytest.mark.parametrize("degrees", [-1.0, 0.0, 0.02, 9.0, 90.0])
def test_another_arc_end_stays_an_arc(degrees: float) -> None:
    assert turn_inward(7.2, degrees).count("\nG1 ") == turn_inward(7.2, degrees, 0.0).count("\nG1 ")


def test_a_fast_motion_gets_a_chord_at_a_smaller_angle() -> None:
    """In 0.283 s the line reaches 70.7 mm/s and the arc 35.4 mm/s: the rate is 26.5 mm/s."""
    assert rate_overlap(20 * math.pi / 2, 20.0, 100.0) == pytest.approx(26.5, abs=0.1)
    assert math.degrees(0.025 / 26.5) < 0.07
    assert list_bad_ends(turn_inward(20.0, 0.07, 0.0, 100.0)) != []
    assert list_bad_ends(turn_inward(20.0, 0.07, 0.01, 100.0)) == []
    assert list_bad_ends(turn_inward(20.0, 0.07, 0.0, 20.0)) == []


@pytest.mark.parametrize("slope", [1.0, 30.0, 90.0])
def test_an_arc_before_a_line_up_or_down_ends_in_a_chord(slope: float) -> None:
    rise = math.radians(slope)
    half = 7.2 * math.sqrt(0.5)
    body = (
        MoveC(place_at(half, -half), place_at(7.2, 0), 20.0, 1.0, work=True),
        MoveL(place_at(7.2, 5 * math.cos(rise), 5 * math.sin(rise)), 20.0, work=True),
    )
    start = place_at(0, -7.2)
    assert len(list_bad_ends(text_of(body, start, 0.0))) == 1
    text = text_of(body, start)
    assert list_bad_ends(text) == []
    assert text.count("\nG1 ") == 2


def run_on_tangent(degrees: float, tolerance: float) -> str:
    """The program of an arc of R 5 mm about zero and a tangent line of 2 mm, with two digits."""
    angle = math.radians(degrees)
    turns = angle - 1.5, angle - 0.75, angle
    start, via, end = (place_at(5 * math.cos(turn), 5 * math.sin(turn)) for turn in turns)
    x, y, _ = end.origin
    beyond = place_at(x - 2 * math.sin(angle), y + 2 * math.cos(angle))
    body = MoveC(via, end, 100.0, 1.0, work=True), MoveL(beyond, 100.0, work=True)
    return text_of(body, start, tolerance, 2)


def test_an_arc_end_that_is_turned_by_rounding_ends_in_a_chord() -> None:
    """Half a digit turns a line of 2 mm by 0.14 deg. At a rate of 8 mm/s the limit is 0.17 deg."""
    plain = [run_on_tangent(degrees, 0.0) for degrees in range(0, 90, 5)]
    assert any(list_bad_ends(text) for text in plain)
    texts = [run_on_tangent(degrees, 0.01) for degrees in range(0, 90, 5)]
    assert [text for text in texts if list_bad_ends(text)] == []


@pytest.mark.skipif(not SHARED.is_dir(), reason="shared/controllers is not beside the repository")
@pytest.mark.parametrize("name", ["arcline.ngc", "arcsmall.ngc"])
def test_a_program_with_bad_arc_ends_gets_chords(name: str) -> None:
    source = SHARED / name
    assert len(list_bad_ends(source.read_text())) > 2
    assert list_bad_ends(camgen.build(source, post="gcode").text) == []
