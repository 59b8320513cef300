"""Search for harm: sound programs have no finding, and a slip in them is found at its line.

The program has four square paths of 20 mm with rounded corners, worked at Z 0 with an output on.
Travel is at Z 20. The instruction of number N is in line N + 1.
"""

import csv
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from camgen.check.harm import find_harm
from camgen.lang.programs import Executed, Finding, Frames, RunRequest, find_language
from camgen.model.pose import Pose, rotation_about
from camgen.model.program import Instruction, MoveC, MoveJ, MoveL, Output

FAULTS = Path(__file__).parents[2].parent / "shared" / "data" / "faults"
DOWN = rotation_about(0, np.pi)
TRAVEL, FEED, PLUNGE = 100.0, 20.0, 5.0
#: Index of the first instruction of the second path in the body, and of its motions after it.
SECOND = 15
(LIFTED, ABOVE, PLUNGED, ON, SIDE, ARC, NEXT_SIDE, LAST, OFF, LIFT) = (
    SECOND + k for k in (0, 1, 2, 3, 4, 5, 6, 11, 12, 13)
)


def make_pose(x: float, y: float, z: float = 0.0, rotation: np.ndarray = DOWN) -> Pose:
    return Pose(rotation, (x, y, z))


def make_square(x: float) -> list[Instruction]:
    """14 instructions: a square that starts at (x, 0), whose corners are arcs of 5 mm."""
    half = 5 * np.sqrt(0.5)

    def line(to_x: float, to_y: float) -> MoveL:
        return MoveL(make_pose(x + to_x, to_y), FEED, 1.0)

    def arc(mid: tuple[float, float], to: tuple[float, float], stop: bool = False) -> MoveC:
        via = make_pose(x + mid[0], mid[1])
        return MoveC(via, make_pose(x + to[0], to[1]), FEED, 0.0 if stop else 1.0)

    return [
        MoveL(make_pose(x, 0, 20), TRAVEL, 5.0),
        MoveL(make_pose(x, 0, 2), TRAVEL),
        MoveL(make_pose(x, 0), PLUNGE),
        Output("glue", 1.0),
        line(10, 0),
        arc((10 + half, 5 - half), (15, 5)),
        line(15, 15),
        arc((10 + half, 15 + half), (10, 20)),
        line(0, 20),
        arc((-half, 15 + half), (-5, 15)),
        line(-5, 5),
        arc((-half, 5 - half), (0, 0), stop=True),
        Output("glue", 0.0),
        MoveL(make_pose(x, 0, 20), TRAVEL, 5.0),
    ]


def make_sound_program() -> list[Instruction]:
    """The program with four squares."""
    body: list[Instruction] = [Output("glue", 0.0)]
    for x in (0.0, 40.0, 80.0, 120.0):
        body += make_square(x)
    return body


def list_harm(
    body: Sequence[Instruction], frame: tuple[int, ...] = (), findings: tuple[Finding, ...] = ()
) -> list[tuple[str, int, str]]:
    """Level, line and text of each finding; frame: index of the frame of each instruction."""
    lines = range(1, len(body) + 1)
    frames = (Frames("t1"), Frames("t2"))
    executed = Executed(tuple(body), tuple(lines), frames, frame, findings)
    return [(finding.level, finding.line, finding.what) for finding in find_harm(executed)]


def replace_instruction(index: int, *items: Instruction) -> list[Instruction]:
    """The sound program with other instructions instead of one of them."""
    body = make_sound_program()
    return [*body[:index], *items, *body[index + 1 :]]


def test_a_sound_program_has_no_finding() -> None:
    assert list_harm(make_sound_program()) == []


@pytest.mark.parametrize("body", [[], [Output("glue", 1.0)], [MoveJ(make_pose(0, 0), 1.0)]])
def test_a_program_without_paths_has_no_finding(body: list[Instruction]) -> None:
    assert list_harm(body) == []


SLIPS: dict[str, tuple[Callable[[], list[Instruction]], str, int, str]] = {
    # Each slip has its program, and the level, index and words of the finding.
    "the output stays on": (
        lambda: replace_instruction(OFF),
        "dangerous",
        LIFT - 1,
        "while glue is on",
    ),
    "the output is not switched on": (
        lambda: replace_instruction(ON),
        "unusual",
        SIDE - 1,
        "runs at working height with glue off",
    ),
    "a line is a joint motion": (
        lambda: replace_instruction(NEXT_SIDE, MoveJ(make_pose(55, 15), FEED, 1.0)),
        "dangerous",
        NEXT_SIDE,
        "a joint or rapid motion while glue is on",
    ),
    "a line runs at travel speed": (
        lambda: replace_instruction(NEXT_SIDE, MoveL(make_pose(55, 15), 10 * FEED, 1.0)),
        "dangerous",
        NEXT_SIDE,
        "at travel speed while glue is on",
    ),
    "the plunge is too deep": (
        lambda: replace_instruction(PLUNGED, MoveL(make_pose(40, 0, -5), PLUNGE)),
        "dangerous",
        PLUNGED,
        "5 mm deeper",
    ),
    "the lift goes down": (
        lambda: replace_instruction(LIFT, MoveL(make_pose(40, 0, -20), TRAVEL, 5.0)),
        "dangerous",
        LIFT,
        "20 mm deeper",
    ),
    "the way to the path is at working height": (
        lambda: replace_instruction(LIFTED, MoveL(make_pose(40, 0, 0), TRAVEL, 5.0)),
        "dangerous",
        LIFTED,
        "travels to Z 0",
    ),
    "a stop in the contour": (
        lambda: replace_instruction(NEXT_SIDE, MoveL(make_pose(55, 15), FEED, 0.0)),
        "unusual",
        NEXT_SIDE,
        "a dwell mark",
    ),
    "the sense of an arc": (
        lambda: replace_instruction(
            ARC, MoveC(make_pose(50 - 5 / 2**0.5, 5 + 5 / 2**0.5), make_pose(55, 5), FEED, 1.0)
        ),
        "dangerous",
        ARC,
        "turns back",
    ),
    "another orientation": (
        lambda: replace_instruction(
            NEXT_SIDE, MoveL(make_pose(55, 15, rotation=DOWN @ rotation_about(2, 1.0)), FEED, 1.0)
        ),
        "dangerous",
        NEXT_SIDE,
        "turns by 57.3 deg in this place alone",
    ),
    "a feed a tenth of that beside it": (
        lambda: replace_instruction(NEXT_SIDE, MoveL(make_pose(55, 15), FEED / 20, 1.0)),
        "unusual",
        NEXT_SIDE,
        "runs at 1 mm/s",
    ),
    "a path is run twice": (
        lambda: [*make_sound_program(), *make_square(40.0)],
        "unusual",
        4 * 14 + 1 + 4,
        "is run twice",
    ),
    "the power is ten times as high": (
        lambda: replace_instruction(ON, Output("glue", 10.0)),
        "dangerous",
        ON,
        "set to 10, and to 1 everywhere else",
    ),
    "the output is on at the end": (
        lambda: make_sound_program()[:-2] + make_sound_program()[-1:],
        "dangerous",
        3 * 14 + 1 + 3,
        "still on at the end",
    ),
}


@pytest.mark.parametrize("slip", SLIPS)
def test_a_slip_is_found_at_its_line(slip: str) -> None:
    make, level, index, words = SLIPS[slip]
    findings = list_harm(make())
    assert (level, index + 1) in [(item[0], item[1]) for item in findings if words in item[2]]
    # A slip may cause findings in later lines, but not in earlier ones.
    assert findings[0][1] == index + 1


def test_an_arc_in_the_wrong_direction_is_the_only_finding() -> None:
    assert [line for _, line, _ in list_harm(SLIPS["the sense of an arc"][0]())] == [ARC + 1]


@pytest.mark.parametrize(("index", "level"), [(NEXT_SIDE, "dangerous"), (ABOVE, "unusual")])
def test_a_motion_in_another_frame_is_found(index: int, level: str) -> None:
    """The motion is dangerous while the output is on, otherwise unusual."""
    frame = [0] * len(make_sound_program())
    frame[index] = 1
    ((found_level, line, what),) = list_harm(make_sound_program(), tuple(frame))
    assert (found_level, line) == (level, index + 1)
    assert "another tool or in another frame" in what


def test_a_line_with_a_finding_gets_another_one_only_if_it_is_more_severe() -> None:
    body = replace_instruction(PLUNGED, MoveL(make_pose(40, 0, -5), PLUNGE))
    known = Finding("dangerous", PLUNGED + 1, "known")
    assert list_harm(body, findings=(known,)) == []
    ((level, line, _),) = list_harm(body, findings=(Finding("unusual", PLUNGED + 1, "known"),))
    assert (level, line) == ("dangerous", PLUNGED + 1)


def test_a_rotation_that_a_joint_motion_makes_as_well_is_intended() -> None:
    """A cup is emptied by a straight motion, and another one by a joint motion."""
    rotation = DOWN @ rotation_about(2, 1.0)
    cups = [MoveL(make_pose(0, 90, 20), TRAVEL)]
    cups += [MoveL(make_pose(0, 95, 20, rotation), TRAVEL), MoveL(make_pose(0, 90, 20), TRAVEL)]
    assert [what for _, _, what in list_harm([*make_sound_program(), *cups])] == [
        "the tool turns by 57.3 deg in this place alone"
    ]
    joint_motions = [
        MoveJ(make_pose(50, 95, 20, rotation), TRAVEL),
        MoveJ(make_pose(0, 90, 20), TRAVEL),
    ]
    assert list_harm([*make_sound_program(), *cups, *joint_motions]) == []


def test_an_action_that_a_program_repeats_often_is_intended() -> None:
    """The program travels at working height between all paths, as for a laser."""
    body = []
    for item in make_sound_program():
        is_high = isinstance(item, MoveL) and item.target.origin[2] > 0
        body.append(MoveJ(make_pose(*item.target.origin[:2]), TRAVEL) if is_high else item)
    assert list_harm(body) == []


def test_a_spindle_that_stays_on_during_travel_is_not_a_process() -> None:
    """Two tools, each with the spindle on from its first motion to its last."""
    body: list[Instruction] = []
    for x in (0.0, 40.0):
        body += [Output("spindle", 3000.0)]
        body += [item for item in make_square(x) if not isinstance(item, Output)]
        body += [MoveJ(make_pose(x, 50, 20), TRAVEL), Output("spindle", 0.0)]
        body += [MoveJ(make_pose(0, 0, 100), TRAVEL)]
    assert list_harm(body) == []


def test_heights_of_another_frame_are_not_compared() -> None:
    body = [*make_sound_program(), MoveJ(make_pose(0, 0, -100), TRAVEL)]
    frame = (*(0 for _ in make_sound_program()), 1)
    assert list_harm(body, frame) == []
    ((level, line, _),) = list_harm(body, (0,) * len(body))
    assert (level, line) == ("dangerous", len(body))


def test_motions_next_to_a_loss_are_not_compared() -> None:
    body = tuple(SLIPS["the sense of an arc"][0]())
    lines = tuple(range(1, len(body) + 1))
    lost = ((ARC + 1, "a motion"), (ARC + 2, "a motion"))
    assert find_harm(Executed(body, lines))
    assert not find_harm(Executed(body, lines, lost=lost))


def test_a_cusp_of_a_drawing_is_not_a_slip() -> None:
    """The path reverses where two arcs meet, and is smooth at their other ends."""
    body = make_sound_program()
    body += [Output("glue", 1.0), MoveL(make_pose(170, 0), FEED, 1.0)]
    half = 5 * np.sqrt(0.5)
    body += [MoveC(make_pose(170 + half, 5 - half), make_pose(175, 5), FEED, 1.0)]
    body += [MoveC(make_pose(180 - half, 5 - half), make_pose(180, 0), FEED, 1.0)]
    body += [MoveL(make_pose(190, 0), FEED), Output("glue", 0.0)]
    assert list_harm(body) == []


# Programs of five languages with one fault each.

#: Faults that cannot be found without the plan, by file, with the reason.
UNSEEN = {
    "rapid/08.mod": "camSafe runs after an error alone",
    "rapid/12.mod": "named by the header",
    "rapid/14.mod": "named by the header",
    "pacscript/12.pcs": "the frames are in the controller alone",
    "pacscript/14.pcs": "the frames are in the controller alone",
    "pacscript/20.pcs": "the branch is that of a controller in the other unit",
    "vplus/10.v2": "an acceleration changes no path",
    "vplus/12.v2": "named by the header",
    "vplus/14.v2": "named by the header",
    "vplus/20.v2": "a feed of a quarter may be meant",
    "vplus/30.v2": "joint values may be anywhere",
    "vplus/32.v2": "a longer chord is a line",
    "gcode/04.ngc": "the state before the program is not in it",
    "gcode/14.ngc": "the work offsets are in the controller alone",
    "gcode/16.ngc": "G91.1 is the default of the controller",
    "gcode/30.ngc": "the radius is in the table of tools, which is an assumption",
    "gcode/32.ngc": "a tolerance of 1 mm may be meant",
    "grbl/04.nc": "the state before the program is not in it",
    "grbl/14.nc": "the work offsets are in the controller alone",
    "grbl/16.nc": "G91.1 is the default of the controller",
}
SUFFIXES = {"rapid": "mod", "pacscript": "pcs", "vplus": "v2", "gcode": "ngc", "grbl": "nc"}
shared = pytest.mark.skipif(
    not FAULTS.is_dir(), reason="the developer data set is not beside the repository"
)


def find_all(language: str, name: str) -> list[Finding]:
    """The findings of a language and the harm in a shared program."""
    text = (FAULTS / language / name).read_text(encoding="utf-8")
    options = RunRequest(dialect="grbl" if language == "grbl" else "")
    executed = find_language("gcode" if language == "grbl" else language).run({name: text}, options)
    return [*executed.findings, *find_harm(executed)]


@shared
@pytest.mark.parametrize("language", SUFFIXES)
def test_the_shared_sound_program_has_no_finding(language: str) -> None:
    assert find_all(language, f"sound.{SUFFIXES[language]}") == []


@shared
@pytest.mark.parametrize("language", SUFFIXES)
def test_the_shared_faults_have_findings(language: str) -> None:
    with (FAULTS / "table.tsv").open(encoding="utf-8") as table:
        rows = [row for row in csv.DictReader(table, delimiter="\t") if row["language"] == language]
    unseen = {row["file"] for row in rows if not find_all(language, row["file"])}
    assert {f"{language}/{name}" for name in unseen} == {
        name for name in UNSEEN if name.startswith(f"{language}/")
    }


def test_the_feed_of_the_only_path_is_not_unusual() -> None:
    body = [
        MoveL(make_pose(0, 0, 20), TRAVEL),
        MoveL(make_pose(0, 0), 50.0),
        MoveL(make_pose(10, 0), 1.0),
        MoveL(make_pose(10, 10), 1.0),
        MoveL(make_pose(10, 10, 20), TRAVEL),
        MoveL(make_pose(0, 0, 20), TRAVEL),
    ]
    assert list_harm(body) == []
    # With a second path at another feed, one of the two is odd.
    second = [
        MoveL(make_pose(40, 0), 50.0),
        MoveL(make_pose(50, 0), 20.0),
        MoveL(make_pose(50, 0, 20), TRAVEL),
    ]
    assert [line for _, line, _ in list_harm([*body, *second])] == [3]


def test_the_speed_of_a_motion_without_travel_is_not_unusual() -> None:
    """The first step of a circle in chords starts and ends at the position of the tool."""
    body = make_sound_program()
    step = MoveL(make_pose(55, 5), FEED / 20, 1.0)
    assert list_harm([*body[:NEXT_SIDE], step, *body[NEXT_SIDE:]]) == []
