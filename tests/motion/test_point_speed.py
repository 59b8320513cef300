"""In free space no point of an arm is faster than 250 mm/s without `process.travel`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from camgen_posts.rapid import Rapid

import camgen
from camgen.check.reach import check_reach
from camgen.check.shares import share_joints
from camgen.model.cell import Dynamics
from camgen.model.errors import VerifyError
from camgen.model.pose import FloatArray, translation
from camgen.model.program import Joints, MoveJ, Program
from camgen.post.plugins import find_readback
from camgen.post.verify import compare
from camgen.robots.catalogue import find_robot
from camgen.robots.kinematics.forward import compute_flange, compute_link_frames
from camgen.robots.models import Robot
from camgen.robots.workcell import Workcell

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
#: Corners of the holder in the flange frame, mm.
LOW, HIGH = (-60.0, -60.0, 0.0), (60.0, 60.0, 120.0)
LIMIT = 250.0
#: Speed, mm/s, speed fraction, and joint values at the start and the end of a joint motion.
JointMotion = tuple[float, float, FloatArray, FloatArray]


def build(post: str, tool: Mapping[str, object], **process: object) -> camgen.Result:
    job = {
        "process": process,
        "operation": {"kind": "trace"},
        "cell": {
            "robot": "IRB 2400",
            "base_from_work": [1000, 100, 700, 0, 0, 0],
            "flange_from_tool": [0, 0, 150, 0, 0, 0],
        },
        "tool": {"holder": [[*LOW, *HIGH]], **tool},
    }
    return camgen.build(PARTS / "bracket.dxf", post=post, job=job)


def list_joint_motions(result: camgen.Result) -> Iterator[JointMotion]:
    """The joint motions of a program between known joint values."""
    motions = [instruction for instruction in result.program.body if hasattr(instruction, "target")]
    for before, motion in pairwise(motions):
        ends = [instruction.joints or instruction.target for instruction in (before, motion)]
        if isinstance(motion, MoveJ):
            start, end = (np.array(joints.values) for joints in ends)
            yield motion.speed, motion.share, start, end


def place_points(arm: Robot, joints: FloatArray) -> FloatArray:
    """Positions (R, P, 3), mm, of the joints, the flange, the TCP and the corners of the holder."""
    rotation, origin = compute_flange(arm, joints)
    tip = np.array([0.0, 0.0, 150.0])
    corners = np.array(np.meshgrid(*zip(LOW, HIGH, strict=True))).reshape(3, -1).T
    on_tool = np.vstack([np.zeros(3), tip, corners])
    tool = origin[:, None] + on_tool @ rotation.transpose(0, 2, 1)
    return np.concatenate([compute_link_frames(arm, joints)[1], tool], axis=1)


def measure_fastest_point(arm: Robot, motion: JointMotion, post: str = "") -> float:
    """Speed of the fastest point of the arm, mm/s, from speed fraction and TCP speed of a motion.

    RAPID has no speed fraction: its joints may run at their full speeds.
    """
    speed, fraction, start, end = motion
    joints = start + np.linspace(0, 1, 2001)[:, None] * (end - start)
    positions = place_points(arm, joints)
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=2)
    joint_seconds = float((np.abs(end - start) / arm.speeds).max()) / (
        1.0 if post == "rapid" else fraction
    )
    # The TCP, the second point of the tool, has the speed of the motion on average.
    tcp_seconds = float(steps[:, -9].sum()) / speed
    return float(steps.max()) * len(steps) / max(joint_seconds, tcp_seconds)


def test_a_reorientation_is_limited_by_the_speed_of_the_holder() -> None:
    """Axis 6 rotates by 170 deg with the TCP on it, so only a rotation speed limits the holder."""
    arm = find_robot("IRB 2400")
    start = np.radians([0.0, 20.0, 10.0, 0.0, 60.0, -80.0])
    end = start + np.radians([0.0, 0.0, 0.0, 0.0, 0.0, 170.0])
    tool = translation(0, 0, 150)
    pace = Dynamics(turns=True)
    cell = Workcell("cell", translation(0, 0, 0), tool, Joints(tuple(start)), arm=arm, pace=pace)
    body = (MoveJ(Joints(tuple(start)), 100.0), MoveJ(Joints(tuple(end)), 100.0))
    program = Program("part", translation(0, 0, 0), tool, body)

    def distance(before: FloatArray, after: FloatArray) -> FloatArray:
        shift = place_points(arm, after) - place_points(arm, before)
        return np.linalg.norm(shift, axis=2).max(axis=1)

    reach = check_reach(program, arm, "part")
    limited = share_joints(reach, cell, distance, LIMIT)
    motion = limited.body[1]
    # The corners of the holder are sqrt(2) 60 mm from the axis.
    assert motion.turn == pytest.approx(LIMIT / (60 * math.sqrt(2)), rel=0.02)
    assert motion.turn * 60 * math.sqrt(2) <= 1.001 * LIMIT
    unlimited = share_joints(reach, cell, distance, math.inf).body[1]
    assert unlimited.turn == 0.0
    # The text states it, and the comparison with the plan finds another value.
    post, options = Rapid(), {}
    files = post.render(post.prepare(limited, 0.01))
    text = files[0].text
    reading = find_readback("rapid")({files[0].name: text}, options)
    same = compare(limited, reading, post.tolerance(), post.list_verified(), "part.mod")
    assert same.instructions == 2
    degrees = f",{math.degrees(motion.turn):.3f}".rstrip("0")
    assert text.count(degrees) == 1
    changed = find_readback("rapid")({"a": text.replace(degrees, ",500")}, options)
    with pytest.raises(VerifyError, match="speed of turning"):
        compare(limited, changed, post.tolerance(), post.list_verified(), "part.mod")


@pytest.mark.parametrize("post", ["rapid", "pacscript", "vplus"])
@pytest.mark.parametrize("tool", [{}, {"symmetric": True}, {"turn": [-90.0, 90.0, 30.0]}])
def test_no_point_of_the_arm_exceeds_the_limit(post: str, tool: dict[str, object]) -> None:
    arm = find_robot("IRB 2400")
    speeds = [
        measure_fastest_point(arm, motion, post) for motion in list_joint_motions(build(post, tool))
    ]
    assert speeds
    # Speeds are rounded, and a motion that exceeds the limit by up to 0.1 % is not changed.
    assert max(speeds) <= 1.001 * LIMIT


def test_a_given_travel_speed_replaces_the_limit() -> None:
    arm, tool = find_robot("IRB 2400"), {"symmetric": True}
    slow = list_joint_motions(build("pacscript", tool))
    fast = list_joint_motions(build("pacscript", tool, travel=700.0))
    assert max(measure_fastest_point(arm, motion) for motion in slow) > 0.8 * LIMIT
    assert max(measure_fastest_point(arm, motion) for motion in fast) > 1.5 * LIMIT
