"""The judge of harm: sound programs have no finding, and one slip in them has its line.

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


def pose(x: float, y: float, z: float = 0.0, rotation: np.ndarray = DOWN) -> Pose:
    return Pose(rotation, (x, y, z))


def square(x: float) -> list[Instruction]:
    """14 instructions: a square from (x, 0) on, whose corners are arcs of 5 mm."""
    half = 5 * np.sqrt(0.5)

    def line(to_x: float, to_y: float) -> MoveL:
        return MoveL(pose(x + to_x, to_y), FEED, 1.0)

    def arc(mid: tuple[float, float], to: tuple[float, float], stop: bool = False) -> MoveC:
        via = pose(x + mid[0], mid[1])
        return MoveC(via, pose(x + to[0], to[1]), FEED, 0.0 if stop else 1.0)

    return [
        MoveL(pose(x, 0, 20), TRAVEL, 5.0),
        MoveL(pose(x, 0, 2), TRAVEL),
        MoveL(pose(x, 0), PLUNGE),
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
        MoveL(pose(x, 0, 20), TRAVEL, 5.0),
    ]


def sound() -> list[Instruction]:
    body: list[Instruction] = [Output("glue", 0.0)]
    for x in (0.0, 40.0, 80.0, 120.0):
        body += square(x)
    return body


def harm_of(
    body: Sequence[Instruction], frame: tuple[int, ...] = (), findings: tuple[Finding, ...] = ()
) -> list[tuple[str, int, str]]:
    lines = range(1, len(body) + 1)
    frames = (Frames("t1"), Frames("t2"))
    executed = Executed(tuple(body), tuple(lines), frames, frame, findings)
    return [(finding.level, finding.line, finding.what) for finding in find_harm(executed)]


def change(at: int, *items: Instruction) -> list[Instruction]:
    """The sound program with other instructions in the place of one."""
    body = sound()
    return [*body[:at], *items, *body[at + 1 :]]


def test_a_sound_program_has_no_finding() -> None:
    assert harm_of(sound()) == []


@pytest.mark.parametrize("body", [[], [Output("glue", 1.0)], [MoveJ(pose(0, 0), 1.0)]])
def test_a_program_without_paths_has_no_finding(body: list[Instruction]) -> None:
    assert harm_of(body) == []


SLIPS: dict[str, tuple[Callable[[], list[Instruction]], str, int, str]] = {
    # slip: program, level, index of the instruction that is named, words of the finding
    "the output stays on": (lambda: change(OFF), "dangerous", LIFT - 1, "while glue is on"),
    "the output is not switched on": (
        lambda: change(ON),
        "unusual",
        SIDE - 1,
        "runs at working height with glue off",
    ),
    "a line is a joint motion": (
        lambda: change(NEXT_SIDE, MoveJ(pose(55, 15), FEED, 1.0)),
        "dangerous",
        NEXT_SIDE,
        "a joint or rapid motion while glue is on",
    ),
    "a line runs at travel speed": (
        lambda: change(NEXT_SIDE, MoveL(pose(55, 15), 10 * FEED, 1.0)),
        "dangerous",
        NEXT_SIDE,
        "at travel speed while glue is on",
    ),
    "the plunge is too deep": (
        lambda: change(PLUNGED, MoveL(pose(40, 0, -5), PLUNGE)),
        "dangerous",
        PLUNGED,
        "5 mm deeper",
    ),
    "the lift goes down": (
        lambda: change(LIFT, MoveL(pose(40, 0, -20), TRAVEL, 5.0)),
        "dangerous",
        LIFT,
        "20 mm deeper",
    ),
    "the way to the path is at working height": (
        lambda: change(LIFTED, MoveL(pose(40, 0, 0), TRAVEL, 5.0)),
        "dangerous",
        LIFTED,
        "travels to Z 0",
    ),
    "a stop in the contour": (
        lambda: change(NEXT_SIDE, MoveL(pose(55, 15), FEED, 0.0)),
        "unusual",
        NEXT_SIDE,
        "a dwell mark",
    ),
    "the sense of an arc": (
        lambda: change(ARC, MoveC(pose(50 - 5 / 2**0.5, 5 + 5 / 2**0.5), pose(55, 5), FEED, 1.0)),
        "dangerous",
        ARC,
        "turns back",
    ),
    "another orientation": (
        lambda: change(
            NEXT_SIDE, MoveL(pose(55, 15, rotation=DOWN @ rotation_about(2, 1.0)), FEED, 1.0)
        ),
        "dangerous",
        NEXT_SIDE,
        "turns by 57.3 deg in this place alone",
    ),
    "a feed a tenth of that beside it": (
        lambda: change(NEXT_SIDE, MoveL(pose(55, 15), FEED / 20, 1.0)),
        "unusual",
        NEXT_SIDE,
        "runs at 1 mm/s",
    ),
    "a path is run twice": (
        lambda: [*sound(), *square(40.0)],
        "unusual",
        4 * 14 + 1 + 4,
        "is run twice",
    ),
    "the power is ten times as high": (
        lambda: change(ON, Output("glue", 10.0)),
        "dangerous",
        ON,
        "set to 10, and to 1 everywhere else",
    ),
    "the output is on at the end": (
        lambda: sound()[:-2] + sound()[-1:],
        "dangerous",
        3 * 14 + 1 + 3,
        "still on at the end",
    ),
}


@pytest.mark.parametrize("slip", SLIPS)
def test_a_slip_has_its_line(slip: str) -> None:
    make, level, place, words = SLIPS[slip]
    findings = harm_of(make())
    assert (level, place + 1) in [(item[0], item[1]) for item in findings if words in item[2]]
    # A slip of one line may show in the lines after it, in none before.
    assert findings[0][1] == place + 1


def test_the_sense_of_an_arc_alone_is_named() -> None:
    assert [line for _, line, _ in harm_of(SLIPS["the sense of an arc"][0]())] == [ARC + 1]


@pytest.mark.parametrize(("place", "level"), [(NEXT_SIDE, "dangerous"), (ABOVE, "unusual")])
def test_a_motion_in_another_frame(place: int, level: str) -> None:
    """It is dangerous while the output is on."""
    frame = [0] * len(sound())
    frame[place] = 1
    ((found_level, line, what),) = harm_of(sound(), tuple(frame))
    assert (found_level, line) == (level, place + 1)
    assert "another tool or in another frame" in what


def test_a_line_with_a_finding_of_its_language_has_another_one_only_if_it_is_worse() -> None:
    body = change(PLUNGED, MoveL(pose(40, 0, -5), PLUNGE))
    known = Finding("dangerous", PLUNGED + 1, "known")
    assert harm_of(body, findings=(known,)) == []
    ((level, line, _),) = harm_of(body, findings=(Finding("unusual", PLUNGED + 1, "known"),))
    assert (level, line) == ("dangerous", PLUNGED + 1)


def test_a_turn_that_a_joint_motion_makes_too_is_meant() -> None:
    """A cup is emptied by a straight motion, and another one by a joint motion."""
    turned = DOWN @ rotation_about(2, 1.0)
    cups = [MoveL(pose(0, 90, 20), TRAVEL)]
    cups += [MoveL(pose(0, 95, 20, turned), TRAVEL), MoveL(pose(0, 90, 20), TRAVEL)]
    assert [what for _, _, what in harm_of([*sound(), *cups])] == [
        "the tool turns by 57.3 deg in this place alone"
    ]
    other = [MoveJ(pose(50, 95, 20, turned), TRAVEL), MoveJ(pose(0, 90, 20), TRAVEL)]
    assert harm_of([*sound(), *cups, *other]) == []


def test_what_a_program_does_often_is_meant() -> None:
    """A program that travels at working height between all paths, as a laser does."""
    body = []
    for item in sound():
        is_high = isinstance(item, MoveL) and item.target.origin[2] > 0
        body.append(MoveJ(pose(*item.target.origin[:2]), TRAVEL) if is_high else item)
    assert harm_of(body) == []


def test_a_spindle_that_stays_on_in_travel_is_no_process() -> None:
    """Two tools, each with the spindle on from its first motion to its last."""
    body: list[Instruction] = []
    for x in (0.0, 40.0):
        body += [Output("spindle", 3000.0)]
        body += [item for item in square(x) if not isinstance(item, Output)]
        body += [MoveJ(pose(x, 50, 20), TRAVEL), Output("spindle", 0.0)]
        body += [MoveJ(pose(0, 0, 100), TRAVEL)]
    assert harm_of(body) == []


def test_heights_of_another_frame_are_not_compared() -> None:
    body = [*sound(), MoveJ(pose(0, 0, -100), TRAVEL)]
    frame = (*(0 for _ in sound()), 1)
    assert harm_of(body, frame) == []
    ((level, line, _),) = harm_of(body, (0,) * len(body))
    assert (level, line) == ("dangerous", len(body))


def test_beside_what_a_run_leaves_out_nothing_is_compared() -> None:
    body = tuple(SLIPS["the sense of an arc"][0]())
    lines = tuple(range(1, len(body) + 1))
    around = ((ARC + 1, "a motion"), (ARC + 2, "a motion"))
    assert find_harm(Executed(body, lines))
    assert not find_harm(Executed(body, lines, lost=around))


def test_a_cusp_of_a_drawing_is_no_slip() -> None:
    """The path turns back where two arcs meet, and goes on smoothly at their other ends."""
    body = sound()
    body += [Output("glue", 1.0), MoveL(pose(170, 0), FEED, 1.0)]
    half = 5 * np.sqrt(0.5)
    body += [MoveC(pose(170 + half, 5 - half), pose(175, 5), FEED, 1.0)]
    body += [MoveC(pose(180 - half, 5 - half), pose(180, 0), FEED, 1.0)]
    body += [MoveL(pose(190, 0), FEED), Output("glue", 0.0)]
    assert harm_of(body) == []


# -- programs of five languages with one fault each ------------------------------------------------

#: Faults that no text shows without its plan, by file, with the reason.
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


def read_and_judge(language: str, name: str) -> list[Finding]:
    text = (FAULTS / language / name).read_text(encoding="utf-8")
    request = RunRequest(dialect="grbl" if language == "grbl" else "")
    executed = find_language("gcode" if language == "grbl" else language).run({name: text}, request)
    return [*executed.findings, *find_harm(executed)]


@shared
@pytest.mark.parametrize("language", SUFFIXES)
def test_the_shared_sound_program_has_no_finding(language: str) -> None:
    assert read_and_judge(language, f"sound.{SUFFIXES[language]}") == []


@shared
@pytest.mark.parametrize("language", SUFFIXES)
def test_the_shared_faults_have_findings(language: str) -> None:
    with (FAULTS / "table.tsv").open(encoding="utf-8") as table:
        rows = [row for row in csv.DictReader(table, delimiter="\t") if row["language"] == language]
    unseen = {row["file"] for row in rows if not read_and_judge(language, row["file"])}
    assert {f"{language}/{name}" for name in unseen} == {
        name for name in UNSEEN if name.startswith(f"{language}/")
    }


def test_the_feed_of_the_only_path_is_no_odd_speed() -> None:
    body = [
        MoveL(pose(0, 0, 20), TRAVEL),
        MoveL(pose(0, 0), 50.0),
        MoveL(pose(10, 0), 1.0),
        MoveL(pose(10, 10), 1.0),
        MoveL(pose(10, 10, 20), TRAVEL),
        MoveL(pose(0, 0, 20), TRAVEL),
    ]
    assert harm_of(body) == []
    # With a second path at another feed, one of the two is odd.
    second = [MoveL(pose(40, 0), 50.0), MoveL(pose(50, 0), 20.0), MoveL(pose(50, 0, 20), TRAVEL)]
    assert [line for _, line, _ in harm_of([*body, *second])] == [3]


def test_a_motion_without_a_way_has_no_odd_speed() -> None:
    """The first step of a circle that is worked out begins where the tool is."""
    body = sound()
    step = MoveL(pose(55, 5), FEED / 20, 1.0)
    assert harm_of([*body[:NEXT_SIDE], step, *body[NEXT_SIDE:]]) == []
