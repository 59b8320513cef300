"""Rules for a preparation: allowed changes pass, and each rule has a program that breaks it."""

import math
from pathlib import Path

import pytest
from msgspec.structs import replace

from camgen.cli import main
from camgen.model.errors import VerifyError
from camgen.model.pose import TOOL_DOWN, Pose, rotation_about, translation
from camgen.model.program import (
    Comment,
    Force,
    Joints,
    MoveC,
    MoveJ,
    MoveL,
    Origin,
    Output,
    Posture,
    Program,
    Stop,
    ToolChange,
    Wait,
)
from camgen.pipeline import build
from camgen.post.passes import PASSES, chords, halves
from camgen.post.plugins import find_post, make_post
from camgen.post.preparation import CHANGES, check_preparation
from camgen.post.verify import list_uncompared

BRACKET = Path(__file__).parents[2] / "fixtures" / "parts" / "bracket.dxf"
HOME = MoveJ(Joints((0.1, 0.2, 0.3)), 100.0)
CHORD = 0.01


def at(x, y, z=0.0, rotation=TOOL_DOWN):
    return Pose(rotation, (float(x), float(y), float(z)))


ON, OFF = Output("process", 1.0), Output("process", 0.0)
PRESS = (0.0, 0.0, -1.0)
#: A quarter of a circle of 10 mm about the origin, from (10, 0).
QUARTER = MoveC(
    at(10 * math.sqrt(0.5), 10 * math.sqrt(0.5)), at(0, 10), 15.0, 0.3, path=0, work=True
)
BODY = (
    OFF,
    Output("spindle", 0.0),
    Force(0.0),
    HOME,
    MoveJ(at(10, 0, 20), 90.0, 0.0, Joints((0.3, 0.2, 0.1)), Posture(figure=5), path=0, share=0.5),
    MoveL(at(10, 0), 20.0, path=0),
    ON,
    Output("spindle", 9000.0),
    Wait(0.25),
    Force(5.0, PRESS),
    QUARTER,
    MoveL(at(-30, 10), 20.0, 0.0, 5.0, PRESS, path=0, work=True),
    Force(0.0),
    MoveL(at(-30, 10, 20), 20.0, path=0),
    Output("spindle", 0.0),
    OFF,
    Stop(),
    MoveL(at(-30, 10, 20, rotation_about(0, 3.0)), 20.0, turn=0.5),
    HOME,
    ToolChange(2, "mill", 6.0, 50.0),
    HOME,
)
PRESSED = replace(QUARTER, force=5.0, force_direction=PRESS)
ARC = BODY.index(QUARTER)
BODY = (*BODY[:ARC], PRESSED, *BODY[ARC + 1 :])
ORIGINS = (Origin("p1"), Origin("p2"))


def program(body=BODY, **more):
    work, tool = more.pop("work", translation(1, 2, 3)), more.pop("tool", translation(0, 0, 100))
    return Program(more.pop("name", "p"), work, tool, tuple(body), (), more.pop("paths", ORIGINS))


def check(body=BODY, allowed=(), before=BODY, **more):
    check_preparation(program(before), program(body, **more), CHORD, frozenset(allowed))


def changed(index, **fields):
    return (*BODY[:index], replace(BODY[index], **fields), *BODY[index + 1 :])


def replaced(index, *items):
    """The body with other instructions instead of the one at `index`."""
    return (*BODY[:index], *items, *BODY[index + 1 :])


def start_of(body, index):
    return next(item.target for item in reversed(body[:index]) if hasattr(item, "target"))


ARC_START = start_of(BODY, ARC)


def test_the_same_instructions_are_the_same_program():
    check(BODY)
    check([replace(item) for item in BODY])


@pytest.mark.parametrize("name", PASSES)
def test_each_pass_is_allowed(name):
    check(replaced(ARC, *PASSES[name](ARC_START, PRESSED, CHORD)))


def test_a_pass_that_turns_the_tool_with_the_arc_is_allowed():
    turned = rotation_about(2, 1.0) @ TOOL_DOWN
    half = rotation_about(2, 0.5) @ TOOL_DOWN
    arc = MoveC(at(10 * math.sqrt(0.5), 10 * math.sqrt(0.5), 0, half), at(0, 10, 0, turned), 15.0)
    before = (HOME, MoveL(at(10, 0), 20.0), arc, HOME)
    for replacement in (chords, halves):
        pieces = replacement(at(10, 0), arc, CHORD)
        check((*before[:2], *pieces, HOME), before=before)
    wrong = [replace(pieces[0], target=at(*pieces[0].target.origin[:2])), *pieces[1:]]
    astray = rotation_about(0, 1.0) @ TOOL_DOWN
    wrong[0] = replace(wrong[0], target=Pose(astray, wrong[0].target.origin))
    with pytest.raises(
        VerifyError, match="instruction 2: the preparation changes the orientation inside"
    ):
        check((*before[:2], *wrong, HOME), before=before)


def test_comments_and_smaller_blends_are_allowed():
    check([Comment("x"), *changed(ARC, blend=0.0), Comment("y")])


def test_a_line_may_become_several_on_it():
    line = BODY[ARC + 1]
    first = replace(line, target=at(-10, 10))
    check(replaced(ARC + 1, first, line))
    for target in (at(-10, 10.001), at(5, 10), at(-31, 10)):
        with pytest.raises(
            VerifyError, match=f"instruction {ARC + 1}: the preparation leaves a line"
        ):
            check(replaced(ARC + 1, replace(line, target=target), line))


POSTURE = Posture(figure=1)
TURNED = Pose(rotation_about(0, 3.1), (10.0, 0.0, 0.0))
KINDS = [type(item) for item in BODY]
INDEX = {kind: KINDS.index(kind) for kind in (Wait, Stop, ToolChange)}
FORCE = BODY.index(Force(5.0, PRESS))
CHORD_OF_ARC = MoveL(at(0, 10), 15.0, 0.3, 5.0, PRESS, path=0, work=True)
LOST = "changes, moves or loses"


@pytest.mark.parametrize(
    ("body", "index", "message"),
    [
        (changed(4, target=at(10, 0, 21)), 4, "loses this motion"),
        (changed(5, target=TURNED), 5, "changes the orientation"),
        (changed(5, speed=600.0), 5, "changes the speed"),
        (changed(ARC, blend=0.5), ARC, "blends wider"),
        (changed(5, path=1), 5, "changes the path"),
        (changed(5, work=True), 5, "changes whether the motion works"),
        (replaced(5, MoveJ(at(10, 0), 20.0, path=0)), 5, "changes the kind"),
        (changed(4, share=0.6), 4, "changes the share"),
        (changed(4, rate=0.6), 4, "changes the speed of a joint"),
        (changed(4, joints=None), 4, "changes joint values or the posture"),
        (changed(4, posture=POSTURE), 4, "changes joint values or the posture"),
        (changed(3, target=Joints((0.1, 0.2, 0.4))), 3, "changes joint values or the posture"),
        (changed(17, turn=0.6), 17, "changes the speed of turning"),
        (changed(ARC + 1, force=4.0), ARC + 1, "changes the force"),
        (changed(ARC + 1, force_direction=(0.0, 1.0, 0.0)), ARC + 1, "changes the direction"),
        (changed(ARC, via=at(6, 8)), None, ""),
        (changed(ARC, via=at(6, 8.1)), ARC, "leaves an arc by more"),
        (changed(ARC, via=at(-6, -8)), ARC, "leaves an arc by more"),
        (replaced(ARC, CHORD_OF_ARC), ARC, "leaves an arc by more"),
        (replaced(5), 5, "loses this motion"),
        (replaced(4, BODY[4], replace(BODY[4], target=at(50, 0, 20))), 5, "changes the kind"),
        ((*BODY, HOME), 20, "adds motions after this one"),
        (replaced(6), 6, f"{LOST} the output process = 1"),
        (changed(6, value=0.5), 6, f"{LOST} the output process = 1"),
        ((*BODY[:5], ON, BODY[5], *BODY[7:]), 6, f"{LOST} the output process = 1"),
        ((*BODY[:6], BODY[7], BODY[6], *BODY[8:]), 6, f"{LOST} the output process = 1"),
        (replaced(7), 7, f"{LOST} the output spindle = 9000"),
        (replaced(INDEX[Wait]), INDEX[Wait], f"{LOST} a Wait"),
        (changed(INDEX[Wait], seconds=0.5), INDEX[Wait], f"{LOST} a Wait"),
        (replaced(INDEX[Stop]), INDEX[Stop], f"{LOST} a Stop"),
        (changed(INDEX[Stop], optional=True), INDEX[Stop], f"{LOST} a Stop"),
        (changed(INDEX[ToolChange], number=3), INDEX[ToolChange], f"{LOST} a ToolChange"),
        (changed(FORCE, newtons=6.0), ARC, "changes the force control of this motion"),
        ((*BODY, Wait(1.0)), len(BODY), "adds a Wait"),
    ],
)
def test_a_change_is_found_at_the_first_instruction(body, index, message):
    if index is None:
        check(body)
        return
    with pytest.raises(
        VerifyError, match=rf"instruction {index}: the preparation {message}"
    ) as caught:
        check(body)
    assert caught.value.exit_code == 4


def test_a_force_change_may_move_to_its_motion():
    """A force takes effect with the next motion, so it may pass an output and a wait."""
    check((*BODY[:6], BODY[FORCE], *BODY[6:FORCE], *BODY[FORCE + 1 :]))


@pytest.mark.parametrize("name", ["work", "tool"])
def test_a_frame_is_kept(name):
    with pytest.raises(VerifyError, match=f"changes the {name} frame"):
        check(BODY, **{name: translation(1, 2, 4)})


@pytest.mark.parametrize("more", [{"name": "q"}, {"paths": (*ORIGINS, Origin("p3"))}])
def test_name_and_paths_are_kept(more):
    with pytest.raises(VerifyError, match="changes the name or the paths"):
        check(BODY, **more)


def test_the_pieces_of_an_arc_run_forward_along_it():
    pieces = chords(ARC_START, PRESSED, CHORD)
    back = [*pieces[:3], pieces[1], *pieces[2:]]
    with pytest.raises(VerifyError, match=f"instruction {ARC}: the preparation runs back"):
        check(replaced(ARC, *back))
    outside = replace(pieces[2], target=at(*(1.002 * x for x in pieces[2].target.origin)))
    with pytest.raises(VerifyError, match="leaves an arc by more"):
        check(replaced(ARC, *pieces[:2], outside, *pieces[3:]))
    other = replace(pieces[2], force_direction=(0.0, 1.0, 0.0))
    with pytest.raises(VerifyError, match="direction of the force inside an arc"):
        check(replaced(ARC, *pieces[:2], other, *pieces[3:]))
    stated = replace(pieces[2], joints=Joints((0.1, 0.2, 0.3)))
    with pytest.raises(VerifyError, match="states joint values"):
        check(replaced(ARC, *pieces[:2], stated, *pieces[3:]))


@pytest.mark.parametrize("share", [1.0, 4.0])
def test_the_chord_error_has_the_limit_of_the_job(share):
    """Chords of n equal pieces leave a circle of radius R by R (1 - cos(sweep / 2 n))."""
    pieces = chords(ARC_START, PRESSED, share * CHORD)
    count = len(pieces)
    assert 10 * (1 - math.cos(math.pi / 4 / count)) == pytest.approx(share * CHORD, rel=0.2)
    if share <= 1:
        check(replaced(ARC, *pieces))
        return
    with pytest.raises(VerifyError, match="leaves an arc by more than tolerance"):
        check(replaced(ARC, *pieces))


# Changes that an option allows


def without_forces(body=BODY):
    items = [item for item in body if not isinstance(item, Force)]
    for k, item in enumerate(items):
        if getattr(item, "force", 0):
            items[k] = replace(item, force=0.0, force_direction=(0.0, 0.0, 0.0))
    return items


def test_forces_may_be_left_out_only_if_the_post_declares_it():
    check(without_forces(), {"force"})
    with pytest.raises(
        VerifyError, match="instruction 3: the preparation changes the force control"
    ):
        check(without_forces())


def test_a_spindle_speed_may_become_on_only_if_the_post_declares_it():
    check(changed(7, value=1.0), {"spindle"})
    with pytest.raises(VerifyError, match="the output spindle"):
        check(changed(7, value=0.0), {"spindle"})
    with pytest.raises(VerifyError, match="the output spindle"):
        check(changed(7, value=1.0))


ABOVE = MoveJ(at(5, 5, 20), 90.0, path=0)
STROKES = (
    ABOVE,
    MoveL(at(5, 5, 2), 90.0, path=0),
    MoveL(at(5, 5, 1), 3.0, path=0),
    MoveL(at(5, 5, -4), 3.0, path=0, work=True),
    MoveL(at(5, 5, 2), 90.0, path=0),
    MoveL(at(5, 5, 20), 90.0, path=0),
)
CYCLE = (
    ABOVE,
    MoveJ(at(5, 5, 2), 90.0, path=0),
    MoveL(at(5, 5, -4), 3.0, path=0, work=True),
    MoveJ(at(5, 5, 20), 90.0, path=0),
)


def test_strokes_may_be_joined_only_if_the_post_declares_cycles():
    before, after = (HOME, *STROKES, HOME), (HOME, *CYCLE, HOME)
    check(after, {"cycles"}, before)
    with pytest.raises(VerifyError, match="instruction 2: the preparation changes the kind"):
        check(after, (), before)
    shallow = replace(CYCLE[2], target=at(5, 5, -3))
    fast = replace(CYCLE[2], speed=6.0)
    for wrong in (shallow, fast):
        with pytest.raises(VerifyError, match="instruction 4: "):
            check((HOME, *CYCLE[:2], wrong, CYCLE[3], HOME), {"cycles"}, before)


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("gcode", {}, {"cycles"}),
        ("gcode", {"cycles": False, "force": "ignore"}, {"force"}),
        ("grbl", {"force": "ignore"}, {"force"}),
        ("rapid", {"force": "ignore"}, {"force"}),
        ("pacscript", {"force": "ignore", "spindle": "on-off"}, {"force", "spindle"}),
        ("vplus", {"force": "signal", "spindle": "on-off"}, {"force", "spindle"}),
        ("vplus", {}, set()),
    ],
)
def test_a_change_by_an_option_is_listed_as_not_compared(name, options, words):
    post = make_post(find_post(name), options)
    assert post.list_changed() == words
    texts = {CHANGES[word] for word in words} - {""}
    assert texts <= set(list_uncompared(post))


# Builds with a preparation that breaks the program

BREAKS = {
    "drops half of the body": """program.with_body(tuple(
        x for x in program.body if getattr(x, "path", -1) < len(program.paths) // 2))""",
    "multiplies the feeds": """program.with_body(tuple(
        replace(x, speed=x.speed * 30) if isinstance(x, (MoveL, MoveC)) else x
        for x in program.body))""",
    "switches nothing on": """program.with_body(tuple(
        x for x in program.body if not (isinstance(x, Output) and x.value)))""",
    "lines for arcs": """program.with_body(tuple(
        MoveL(x.target, x.speed, x.blend, path=x.path, work=x.work) if isinstance(x, MoveC) else x
        for x in program.body))""",
}
MODULE = """
from dataclasses import dataclass
from msgspec.structs import replace
from camgen.model.program import MoveC, MoveL, Output
from camgen_posts.{name} import {post}
from camgen.lang.{name}.language import {run} as run

@dataclass
class Broken({post}):
    def prepare(self, program, chord):
        program = super().prepare(program, chord)
        return {what}
"""
POSTS = {"gcode": "GCode", "rapid": "Rapid", "pacscript": "PacScript"}


@pytest.mark.parametrize("what", BREAKS)
@pytest.mark.parametrize("name", POSTS)
def test_a_build_is_refused_if_its_post_changes_the_program(
    tmp_path, monkeypatch, capsys, name, what
):
    post = tmp_path / "broken.py"
    post.write_text(
        MODULE.format(
            name=name,
            post=POSTS[name],
            run="run_gcode" if name == "gcode" else "run",
            what=BREAKS[what],
        )
    )
    monkeypatch.chdir(tmp_path)
    assert main(["build", str(BRACKET), "--post", str(post), "-q"]) == 4
    error = capsys.readouterr().err
    assert "the preparation" in error
    assert "instruction" in error
    assert error.count("\n") == 1
    assert {file.name for file in tmp_path.iterdir()} <= {"broken.py", "__pycache__"}


def straight(_start, arc, _chord):
    """A pass that replaces an arc by one line."""
    return [MoveL(arc.target, arc.speed, arc.blend, path=arc.path, work=arc.work)]


@pytest.mark.parametrize(
    ("post", "options"),
    [("vplus", {}), ("gcode", {"arcs": False}), ("grbl", {"arcs": False})],
)
def test_a_pass_that_cuts_arcs_short_is_found(monkeypatch, post, options):
    monkeypatch.setitem(PASSES, "chords", straight)
    with pytest.raises(VerifyError, match="leaves an arc by more than tolerance"):
        build(BRACKET, post=post, job={"post": options})
