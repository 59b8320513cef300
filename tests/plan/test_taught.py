"""Robot programs for other arms: one frame and one tool, joint values, stops, what is left on."""

import importlib
import math

import numpy as np
import pytest

import camgen
from camgen.lang.programs import Executed, Frames, Language
from camgen.lang.taught import in_one_frame
from camgen.model.errors import InputError
from camgen.model.job import Job
from camgen.model.pose import Pose, angle_between, rotation_about, rotation_between, translation
from camgen.model.program import Joints, MoveC, MoveJ, MoveL, Output

taught = importlib.import_module("camgen.lang.taught")

DOWN = rotation_about(0, math.pi)
WORKS = translation(500, 0, 100), Pose(rotation_about(2, math.pi / 2), (600.0, -100.0, 120.0))
TOOLS = translation(0, 0, 150), Pose(rotation_about(1, 0.4), (30.0, 0.0, 120.0))
FRAMES = tuple(
    Frames(f"t{t}", f"w{w}", TOOLS[t], WORKS[w]) for w in (0, 1) for t in (0, 1)
)  # w0 t0, w0 t1, w1 t0, w1 t1


def pose(x, y, z, turn=0.0):
    return Pose(DOWN @ rotation_about(1, turn), (float(x), float(y), float(z)))


#: Most motions are with the first tool in the first work object.
OWN = [MoveJ(pose(0, 0, 90 - k), 100.0) for k in range(3)]


def flange_of(target, frames):
    """base_from_flange where the tool of ``frames`` is at ``target``: independent of what is tested."""
    return frames.base_from_work @ target @ frames.flange_from_tool.inverse()


def close(a, b, mm=1e-6, rad=1e-6):
    return math.dist(a.origin, b.origin) < mm and angle_between(a.rotation, b.rotation) < rad


def test_targets_keep_the_flange_where_it_was():
    body = [*OWN, MoveJ(pose(10, 20, 30, 0.5), 100.0), MoveL(pose(10, 80, 30, 0.5), 50.0)]
    places = (0, 0, 0, 3, 3)
    told = in_one_frame(Executed(body, (1, 2, 3, 4, 5), FRAMES, places), "a.mod", 0.02)
    assert told.frames is FRAMES[0]
    assert len(told.body) == 5  # the tool does not turn along the line
    for before, after, place in zip(body, told.body, places, strict=True):
        assert close(flange_of(before.target, FRAMES[place]), flange_of(after.target, FRAMES[0]))
    assert "motions with t1 are told with t0; motions in w1 are told in w0" in told.notes[0].what


def test_another_tool_that_turns_keeps_to_its_line():
    start, end = pose(0, 0, 50), pose(100, 0, 50, 0.8)
    own = [*OWN, MoveJ(start, 50.0), MoveL(end, 50.0)]
    told = in_one_frame(Executed(own, (1, 2, 3, 4, 5), FRAMES, (0, 0, 0, 1, 1)), "a.mod", 0.02)
    pieces = told.body[4:]
    assert len(pieces) > 5
    at = told.body[3].target
    back = TOOLS[0].inverse() @ TOOLS[1]  # tool 0 from tool 1
    for piece in pieces:
        for share in (0.25, 0.5, 0.75, 1.0):
            x, y, z = (
                a + share * (b - a) for a, b in zip(at.origin, piece.target.origin, strict=True)
            )
            here = Pose(rotation_between(at.rotation, piece.target.rotation, share), (x, y, z))
            tip = (here @ back).origin
            assert math.hypot(tip[1], tip[2] - 50) < 0.02
        at = piece.target
    assert close(at @ back, end)
    # The same time: 100 mm at 50 mm/s.
    length = [
        math.dist(a.target.origin, b.target.origin)
        for a, b in zip(told.body[3:], pieces, strict=False)
    ]
    assert sum(s / p.speed for s, p in zip(length, pieces, strict=True)) == pytest.approx(
        2.0, rel=1e-3
    )


def test_another_tool_that_turns_keeps_to_its_arc():
    via, end = pose(50, 50, 50, 0.3), pose(100, 0, 50, 0.6)
    own = [*OWN, MoveJ(pose(0, 0, 50), 50.0), MoveC(via, end, 50.0)]
    told = in_one_frame(Executed(own, (1, 2, 3, 4, 5), FRAMES, (0, 0, 0, 1, 1)), "a.mod", 0.02)
    back = TOOLS[0].inverse() @ TOOLS[1]
    tips = [(piece.target @ back).origin for piece in told.body[4:]]
    assert all(math.dist(tip, (50.0, 0.0, 50.0)) == pytest.approx(50, abs=1e-6) for tip in tips)
    assert close(told.body[-1].target @ back, end)
    assert any(math.dist(tip, via.origin) < 5 for tip in tips)


def test_a_tool_that_no_text_defines_is_named():
    frames = (Frames("t0", "w0", TOOLS[0], WORKS[0]), Frames("t9", "w0", None, WORKS[0]))
    body = [MoveJ(pose(0, 0, 50), 100.0), MoveL(pose(9, 0, 50), 100.0)]
    with pytest.raises(InputError, match=r"tool t9.*line 7"):
        in_one_frame(Executed(body, (3, 7), frames, (0, 1)), "a.mod", 0.02)


# Whole builds, of a program that a language of our own makes.


def language(body, frames=FRAMES[:1]):
    def run(_files, _ask):
        return Executed(body, tuple(range(1, len(body) + 1)), frames, (0,) * len(body))

    return Language("mine", "mine", (), lambda _text: False, run)


HIGH, LOW = (300.0, 0.0, 400.0), (300.0, 60.0, 400.0)
HERE = (Frames("t0", "w0", translation(0, 0, 100), translation(0, 0, 0)),)


def build(tmp_path, monkeypatch, body, post="rapid", job=None):
    monkeypatch.setattr(taught, "find_language", lambda _name: language(body, HERE))
    file = tmp_path / "old.mod"
    file.write_text("MODULE\n")
    return camgen.build(file, post=post, job=job or {})


def moves(result):
    return [item for item in result.program.body if isinstance(item, MoveJ | MoveL | MoveC)]


def at(origin):
    return Pose(DOWN, origin)


def test_joint_values_at_both_ends_are_home(tmp_path, monkeypatch):
    zero = Joints((0.0,) * 6)
    body = [MoveJ(zero, 200.0), MoveJ(at(HIGH), 200.0), MoveL(at(LOW), 50.0), MoveJ(zero, 200.0)]
    result = build(tmp_path, monkeypatch, body)
    made = moves(result)
    assert [made[0].target.values, made[-1].target.values] == [result.cell.home.values] * 2
    assert made[1].target.origin == HIGH
    assert made[2].target.origin == LOW
    assert len(made) == 4
    assert any("the home of this cell" in note.what for note in result.notes)
    assert result.reach.robot == "IRB 120"


def test_joint_values_between_need_their_arm(tmp_path, monkeypatch):
    zero = Joints((0.0, 0.0, 0.0, 0.0, math.pi / 4, 0.0))
    body = [MoveJ(at(HIGH), 200.0), MoveJ(zero, 200.0), MoveL(at(LOW), 50.0)]
    with pytest.raises(InputError, match=r"line 2.*operation.taught_on"):
        build(tmp_path, monkeypatch, body)


def test_a_second_motion_to_joint_values_is_not_home(tmp_path, monkeypatch):
    """The way down to a path begins where it leads, not at home."""
    zero, high = Joints((0.0,) * 6), Joints((0.1, 0.0, 0.0, 0.0, math.pi / 4, 0.0))
    body = [MoveJ(zero, 200.0), MoveJ(high, 200.0), MoveL(at(LOW), 50.0), MoveJ(zero, 200.0)]
    with pytest.raises(InputError, match=r"line 2.*operation.taught_on"):
        build(tmp_path, monkeypatch, body)


def test_joint_values_are_where_their_arm_puts_the_tool(tmp_path, monkeypatch):
    # IRB 120 at zero but axis 5 at 90 deg: its flange looks down, 374 mm out and 630 mm up less 72 (its data sheet).
    down = Joints((0.0, 0.0, 0.0, 0.0, math.pi / 2, 0.0))
    body = [MoveJ(at(HIGH), 200.0), MoveJ(down, 200.0), MoveL(at(LOW), 50.0)]
    job = {"operation": {"taught_on": "abb_irb120"}}
    result = build(tmp_path, monkeypatch, body, "pacscript", job)
    target = moves(result)[2].target
    assert np.allclose(target.origin, (302, 0, 630 - 72 - 100), atol=1e-6)
    assert np.allclose(target.rotation[:, 2], (0, 0, -1), atol=1e-9)


def test_the_same_arm_keeps_its_joint_values(tmp_path, monkeypatch):
    down = Joints((0.0, 0.0, 0.0, 0.0, math.pi / 2, 0.0))
    body = [MoveJ(at(HIGH), 200.0), MoveJ(down, 200.0), MoveJ(at(LOW), 50.0)]
    result = build(tmp_path, monkeypatch, body, "rapid", {"operation": {"taught_on": "IRB 120"}})
    assert moves(result)[2].target.values == down.values


def test_outputs_are_off_at_both_ends_and_corners_before_them_stop(tmp_path, monkeypatch):
    body = [
        MoveJ(at(HIGH), 200.0),
        MoveL(at(LOW), 50.0, 5.0),
        Output("process", 1.0),
        MoveL(at(HIGH), 50.0),
    ]
    result = build(tmp_path, monkeypatch, body)
    outputs = [item.value for item in result.program.body if isinstance(item, Output)]
    assert outputs == [0.0, 1.0, 0.0]
    assert moves(result)[2].blend == 0
    assert any("stops at the end instead of blending" in note.what for note in result.notes)


@pytest.mark.parametrize(("value", "stops"), [(1.0, True), (0.0, False)])
def test_the_first_motion_stops_if_an_output_waits_for_it(tmp_path, monkeypatch, value, stops):
    body = [
        Output("process", value),
        MoveL(at(HIGH), 200.0, 5.0),
        MoveL(at(LOW), 50.0),
        Output("process", 1.0),
        MoveL(at(HIGH), 50.0),
    ]
    result = build(tmp_path, monkeypatch, body)
    assert (moves(result)[1].blend == 0) == stops
    notes = [note for note in result.notes if "stops at the end instead of blending" in note.what]
    assert len(notes) == stops


def test_what_has_no_effect_is_an_error(tmp_path, monkeypatch):
    body = [MoveJ(at(HIGH), 200.0), MoveL(at(LOW), 50.0)]
    for table in (
        {"operation": {"depth": 3}},
        {"process": {"feed": 9}},
        {"process": {"max_feed": 9}},
    ):
        with pytest.raises(camgen.CamgenError, match=r"robot program|taught program"):
            build(tmp_path, monkeypatch, body, job=table)
    assert Job().operation.taught_on == ""
