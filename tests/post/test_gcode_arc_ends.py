"""LinuxCNC leaves some arcs at their ends by more than `G64 P`: no such end is in a text.

The planner of LinuxCNC 2.9 executed 15 arcs with radii of 2, 7.2 and 20 mm, each followed by a line
that turns by 0.24 to 3 degrees towards its centre: 96 um off without the chords, within P of 10 um
with chords of 0.1 to 0.4 degrees.
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
WORD = re.compile(r"([XYZIJ])(-?[\d.]+)")


def list_bad_ends(text: str) -> list[int]:
    """Lines with an arc after which a line turns by 0.2 to 3.5 degrees towards the arc's centre."""
    place, tangent, bad = [0.0, 0.0], None, []
    for number, line in enumerate(text.splitlines(), 1):
        words = {letter: float(value) for letter, value in WORD.findall(line)}
        goal = [words.get("X", place[0]), words.get("Y", place[1])]
        step = complex(goal[0] - place[0], goal[1] - place[1])
        if re.match(r"G1 [XY]", line) and tangent and step:
            direction, left = tangent
            turn = math.degrees(cmath.phase(step / direction))
            if 0.2 < (turn if left else -turn) < 3.5:
                bad.append(number - 1)
        tangent = None
        if re.match(r"G[23] ", line):
            arm = complex(
                goal[0] - place[0] - words.get("I", 0.0), goal[1] - place[1] - words.get("J", 0.0)
            )
            left = line.startswith("G3")
            tangent = (arm * (1j if left else -1j), left)
        place = goal
    return bad


@pytest.mark.parametrize(
    "file", sorted(CASES.glob("*/expected/part.ngc")), ids=lambda f: f.parts[-3]
)
def test_no_golden_has_such_an_end(file: Path) -> None:
    assert list_bad_ends(file.read_text()) == []


def text_of(radius: float, degrees: float, tolerance: float = 0.01) -> str:
    """The program of a quarter of a circle, followed by a line that turns towards its centre."""
    turn = math.radians(degrees)

    def at(x: float, y: float) -> Pose:
        return Pose(TOOL_DOWN, (x, y, 0.0))

    half = radius * math.sqrt(0.5)
    body = (
        MoveJ(at(0, -radius), 50.0),
        MoveC(at(half, -half), at(radius, 0), 20.0, 1.0, work=True),
        MoveL(at(radius - 20 * math.sin(turn), 20 * math.cos(turn)), 20.0, work=True),
    )
    program = Program("part", translation(0, 0, 0), translation(0, 0, 0), whole(body))
    post = make_post(find_post("gcode"), {"path_tolerance": tolerance})
    return render_program(post, prepare_program(post, program, 0.01))[0].text


@pytest.mark.parametrize("radius", [0.5, 2.0, 7.2, 20.0, 200.0])
@pytest.mark.parametrize("degrees", [0.3, 1.0, 3.0])
def test_the_end_of_such_an_arc_is_a_chord(radius: float, degrees: float) -> None:
    plain = text_of(radius, degrees, 0.0)
    assert len(list_bad_ends(plain)) == 1
    text = text_of(radius, degrees)
    assert list_bad_ends(text) == []
    assert text.count("\nG1 ") == plain.count("\nG1 ") + 1
    assert text.count("\nG3 ") == 1


@pytest.mark.parametrize("degrees", [-1.0, 0.0, 0.05, 5.0, 90.0])
def test_other_ends_stay_arcs(degrees: float) -> None:
    assert text_of(7.2, degrees).count("\nG1 ") == text_of(7.2, degrees, 0.0).count("\nG1 ")


@pytest.mark.skipif(not SHARED.is_dir(), reason="shared/controllers is not beside the repository")
@pytest.mark.parametrize("name", ["arcline.ngc", "arcsmall.ngc"])
def test_programs_with_such_ends_get_chords(name: str) -> None:
    source = SHARED / name
    assert len(list_bad_ends(source.read_text())) > 2
    assert list_bad_ends(camgen.build(source, post="gcode").text) == []
