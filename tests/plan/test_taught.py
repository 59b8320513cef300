"""Robot programs for other arms: one frame and one tool, joint values, stops and outputs."""

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
FRAMES = (
    Frames("t0", "w0", TOOLS[0], WORKS[0]),
    Frames("t1", "w0", TOOLS[1], WORKS[0]),
    Frames("t0", "w1", TOOLS[0], WORKS[1]),
    Frames("t1", "w1", TOOLS[1], WORKS[1]),
)


def make_pose(x, y, z, turn=0.0):
    return Pose(DOWN @ rotation_about(1, turn), (float(x), float(y), float(z)))


#: Most motions are with the first tool in the first work object.
FIRST_MOTIONS = [MoveJ(make_pose(0, 0, 90 - k), 100.0) for k in range(3)]


def find_flange(target, frames):
    """base_from_flange for the tool of `frames` at `target`, without the code under test."""
    return frames.base_from_work @ target @ frames.flange_from_tool.inverse()


def is_close(a, b, mm=1e-6, rad=1e-6):
    return math.dist(a.origin, b.origin) < mm and angle_between(a.rotation, b.rotation) < rad


def test_targets_keep_the_flange_where_it_was():
    body = [
        *FIRST_MOTIONS,
        MoveJ(make_pose(10, 20, 30, 0.5), 100.0),
        MoveL(make_pose(10, 80, 30, 0.5), 50.0),
    ]
    frame_indices = (0, 0, 0, 3, 3)
    converted = in_one_frame(Executed(body, (1, 2, 3, 4, 5), FRAMES, frame_indices), "a.mod", 0.02)
    assert converted.frames is FRAMES[0]
    assert len(converted.body) == 5  # the tool does not turn along the line
    for before, after, index in zip(body, converted.body, frame_indices, strict=True):
        assert is_close(
            find_flange(before.target, FRAMES[index]), find_flange(after.target, FRAMES[0])
        )
    assert (
        "motions with t1 are given with t0; motions in w1 are given in w0"
        in converted.notes[0].what
    )


def test_another_tool_that_rotates_keeps_to_its_line():
    start, end = make_pose(0, 0, 50), make_pose(100, 0, 50, 0.8)
    body = [*FIRST_MOTIONS, MoveJ(start, 50.0), MoveL(end, 50.0)]
    converted = in_one_frame(
        Executed(body, (1, 2, 3, 4, 5), FRAMES, (0, 0, 0, 1, 1)), "a.mod", 0.02
    )
    pieces = converted.body[4:]
    assert len(pieces) > 5
    start_pose = converted.body[3].target
    back = TOOLS[0].inverse() @ TOOLS[1]  # tool 0 from tool 1
    for piece in pieces:
        for share in (0.25, 0.5, 0.75, 1.0):
            x, y, z = (
                np.array(start_pose.origin) * (1 - share) + np.array(piece.target.origin) * share
            )
            between = Pose(
                rotation_between(start_pose.rotation, piece.target.rotation, share), (x, y, z)
            )
            tip = (between @ back).origin
            assert math.hypot(tip[1], tip[2] - 50) < 0.02
        start_pose = piece.target
    assert is_close(start_pose @ back, end)
    # The motion takes the same time: 100 mm at 50 mm/s.
    length = [
        math.dist(a.target.origin, b.target.origin)
        for a, b in zip(converted.body[3:], pieces, strict=False)
    ]
    assert sum(s / p.speed for s, p in zip(length, pieces, strict=True)) == pytest.approx(
        2.0, rel=1e-3
    )


def test_another_tool_that_rotates_keeps_to_its_arc():
    via, end = make_pose(50, 50, 50, 0.3), make_pose(100, 0, 50, 0.6)
    body = [*FIRST_MOTIONS, MoveJ(make_pose(0, 0, 50), 50.0), MoveC(via, end, 50.0)]
    converted = in_one_frame(
        Executed(body, (1, 2, 3, 4, 5), FRAMES, (0, 0, 0, 1, 1)), "a.mod", 0.02
    )
    back = TOOLS[0].inverse() @ TOOLS[1]
    tips = [(piece.target @ back).origin for piece in converted.body[4:]]
    assert all(math.dist(tip, (50.0, 0.0, 50.0)) == pytest.approx(50, abs=1e-6) for tip in tips)
    assert is_close(converted.body[-1].target @ back, end)
    assert any(math.dist(tip, via.origin) < 5 for tip in tips)


def test_an_undefined_tool_is_refused_by_name():
    frames = (Frames("t0", "w0", TOOLS[0], WORKS[0]), Frames("t9", "w0", None, WORKS[0]))
    body = [MoveJ(make_pose(0, 0, 50), 100.0), MoveL(make_pose(9, 0, 50), 100.0)]
    with pytest.raises(InputError, match=r"tool t9.*line 7"):
        in_one_frame(Executed(body, (3, 7), frames, (0, 1)), "a.mod", 0.02)


# Whole builds of a program that a language of this test returns.


def make_language(body, frames=FRAMES[:1]):
    def run(_files, _ask):
        return Executed(body, tuple(range(1, len(body) + 1)), frames, (0,) * len(body))

    return Language("mine", "mine", (), lambda _text: False, run)


HIGH, LOW = (300.0, 0.0, 400.0), (300.0, 60.0, 400.0)
BUILD_FRAMES = (Frames("t0", "w0", translation(0, 0, 100), translation(0, 0, 0)),)


def build_program(tmp_path, monkeypatch, body, post="rapid", job=None):
    monkeypatch.setattr(taught, "find_language", lambda _name: make_language(body, BUILD_FRAMES))
    file = tmp_path / "old.mod"
    file.write_text("MODULE\n")
    return camgen.build(file, post=post, job=job or {})


def list_motions(result):
    return [item for item in result.program.body if isinstance(item, MoveJ | MoveL | MoveC)]


def point_down(origin):
    return Pose(DOWN, origin)


def test_joint_values_at_both_ends_become_home(tmp_path, monkeypatch):
    zero = Joints((0.0,) * 6)
    body = [
        MoveJ(zero, 200.0),
        MoveJ(point_down(HIGH), 200.0),
        MoveL(point_down(LOW), 50.0),
        MoveJ(zero, 200.0),
    ]
    result = build_program(tmp_path, monkeypatch, body)
    motions = list_motions(result)
    assert [motions[0].target.values, motions[-1].target.values] == [result.cell.home.values] * 2
    assert motions[1].target.origin == HIGH
    assert motions[2].target.origin == LOW
    assert len(motions) == 4
    assert any("the home of this cell" in note.what for note in result.notes)
    assert result.reach.robot == "IRB 120"


def test_joint_values_between_other_motions_need_the_setting_of_their_arm(tmp_path, monkeypatch):
    zero = Joints((0.0, 0.0, 0.0, 0.0, math.pi / 4, 0.0))
    body = [MoveJ(point_down(HIGH), 200.0), MoveJ(zero, 200.0), MoveL(point_down(LOW), 50.0)]
    with pytest.raises(InputError, match=r"line 2.*operation.taught_on"):
        build_program(tmp_path, monkeypatch, body)


def test_a_second_motion_to_joint_values_is_not_home(tmp_path, monkeypatch):
    """Only the first joint values are home. The second are the start of the approach to a path."""
    zero, high = Joints((0.0,) * 6), Joints((0.1, 0.0, 0.0, 0.0, math.pi / 4, 0.0))
    body = [
        MoveJ(zero, 200.0),
        MoveJ(high, 200.0),
        MoveL(point_down(LOW), 50.0),
        MoveJ(zero, 200.0),
    ]
    with pytest.raises(InputError, match=r"line 2.*operation.taught_on"):
        build_program(tmp_path, monkeypatch, body)


def test_joint_values_become_the_pose_of_their_arm(tmp_path, monkeypatch):
    # All axes of the IRB 120 are at zero, except axis 5 at 90 deg, so the flange points down.
    # Its data sheet puts the wrist 302 mm out and 630 mm up, and the flange 72 mm below it.
    down = Joints((0.0, 0.0, 0.0, 0.0, math.pi / 2, 0.0))
    body = [MoveJ(point_down(HIGH), 200.0), MoveJ(down, 200.0), MoveL(point_down(LOW), 50.0)]
    job = {"operation": {"taught_on": "abb_irb120"}}
    result = build_program(tmp_path, monkeypatch, body, "pacscript", job)
    target = list_motions(result)[2].target
    assert np.allclose(target.origin, (302, 0, 630 - 72 - 100), atol=1e-6)
    assert np.allclose(target.rotation[:, 2], (0, 0, -1), atol=1e-9)


def test_the_same_arm_keeps_its_joint_values(tmp_path, monkeypatch):
    down = Joints((0.0, 0.0, 0.0, 0.0, math.pi / 2, 0.0))
    body = [MoveJ(point_down(HIGH), 200.0), MoveJ(down, 200.0), MoveJ(point_down(LOW), 50.0)]
    result = build_program(
        tmp_path, monkeypatch, body, "rapid", {"operation": {"taught_on": "IRB 120"}}
    )
    assert list_motions(result)[2].target.values == down.values


def test_outputs_are_off_at_both_ends_and_motions_before_them_stop(tmp_path, monkeypatch):
    body = [
        MoveJ(point_down(HIGH), 200.0),
        MoveL(point_down(LOW), 50.0, 5.0),
        Output("process", 1.0),
        MoveL(point_down(HIGH), 50.0),
    ]
    result = build_program(tmp_path, monkeypatch, body)
    outputs = [item.value for item in result.program.body if isinstance(item, Output)]
    assert outputs == [0.0, 1.0, 0.0]
    assert list_motions(result)[2].blend == 0
    assert any("stops at the end instead of blending" in note.what for note in result.notes)


@pytest.mark.parametrize(("value", "stops"), [(1.0, True), (0.0, False)])
def test_the_first_motion_stops_if_an_output_waits_for_it(tmp_path, monkeypatch, value, stops):
    body = [
        Output("process", value),
        MoveL(point_down(HIGH), 200.0, 5.0),
        MoveL(point_down(LOW), 50.0),
        Output("process", 1.0),
        MoveL(point_down(HIGH), 50.0),
    ]
    result = build_program(tmp_path, monkeypatch, body)
    assert (list_motions(result)[1].blend == 0) == stops
    notes = [note for note in result.notes if "stops at the end instead of blending" in note.what]
    assert len(notes) == stops


def test_a_setting_without_effect_on_a_robot_program_is_an_error(tmp_path, monkeypatch):
    body = [MoveJ(point_down(HIGH), 200.0), MoveL(point_down(LOW), 50.0)]
    for table in (
        {"operation": {"depth": 3}},
        {"process": {"feed": 9}},
        {"process": {"max_feed": 9}},
    ):
        with pytest.raises(camgen.CamgenError, match=r"robot program|taught program"):
            build_program(tmp_path, monkeypatch, body, job=table)
    assert Job().operation.taught_on == ""
