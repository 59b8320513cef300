"""Finds feeds that the joints of an arm cannot keep, with position, joint, and possible speed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.check.reach import JointTrace, compute_tips
from camgen.geometry.ragged import select_distinct
from camgen.model.errors import NoSafeProgram
from camgen.model.pose import FloatArray, Vec3
from camgen.model.program import MoveJ, Program
from camgen.model.text import join_short, short
from camgen.motion.joint_paths import JointPath
from camgen.motion.pose_paths import Index
from camgen.robots.kinematics.forward import compute_jacobian
from camgen.robots.models import Robot

#: Fraction of a feed from which on it counts as kept.
_KEPT = 0.99
#: mm: a step between two samples on which the TCP travels less has no speed.
_STANDS_MM = 1e-6
#: Maximum number of samples at which the maximum speed of the TCP is computed.
_MAX_SAMPLES = 1000


class SlowPath(Struct, frozen=True):
    """A path whose feed the joints cannot keep.

    path: number of the path in the tour.
    feed: feed of the program at the slowest position, mm/s.
    speed: speed of the TCP there with the joint at its maximum speed, mm/s.
    joint: number of that joint, from 1.
    place: slowest position in the work frame, mm.
    share: fraction of the length of the path that is slower than its feed.
    """

    path: int
    feed: float
    speed: float
    joint: int
    place: Vec3
    share: float


class _Samples(Struct, frozen=True, eq=False):
    """N steps between samples of the lines and arcs at a feed.

    joints: (N, J) joint values at the end of each step, rad or mm.
    place: (N, 3) TCP at the end of each step in the base frame, mm.
    length: (N,) travel of the TCP, mm.
    feed: (N,) feed, mm/s.
    speed: (N,) speed of the TCP with the slowest joint at its maximum speed, mm/s.
    joint: (N,) number of that joint, from 0.
    path: (N,) number of the path.
    """

    joints: FloatArray
    place: FloatArray
    length: FloatArray
    feed: FloatArray
    speed: FloatArray
    joint: Index
    path: Index


def find_slow_paths(
    reach: JointTrace, course: JointPath, robot: Robot, file: str
) -> list[SlowPath]:
    """Find the paths whose feed the joints of `robot` cannot keep, in their order.

    reach: joint values of the program.
    course: joint path of the program.
    file: name of the input, for messages.

    Raises NoSafeProgram for a feed above the maximum speed of the TCP along its path with all
    joints at full speed.
    """
    program = reach.program
    samples = _sample(reach, course, robot)
    slow = samples.speed < _KEPT * samples.feed
    if not slow.any():
        return []
    _check_possible(samples, robot, program, file)
    return [
        _find_slowest(samples, path, program)
        for path in select_distinct(samples.path[slow]).tolist()
    ]


def _sample(reach: JointTrace, course: JointPath, robot: Robot) -> _Samples:
    program, columns = reach.program, reach.program.columns
    motion = reach.rows.motion[np.ceil(course.at[1:] - 1e-9).astype(np.int64)]
    place = compute_tips(robot, course.joints, program.flange_from_tool)
    length = np.linalg.norm(np.diff(place, axis=0), axis=1)
    at_feed = columns.works & ~columns.moves_are(MoveJ) & (columns.path >= 0)
    used = at_feed[motion] & (length > _STANDS_MM)
    moved = np.abs(np.diff(course.joints, axis=0))[used] / robot.fastest
    seconds = moved.max(axis=1, initial=0.0)
    with np.errstate(divide="ignore"):
        speed = length[used] / seconds
    return _Samples(
        course.joints[1:][used],
        place[1:][used],
        length[used],
        columns.speed[motion][used],
        speed,
        moved.argmax(axis=1),
        columns.path[motion][used].astype(np.int64),
    )


def _find_slowest(samples: _Samples, path: int, program: Program) -> SlowPath:
    steps = np.flatnonzero(samples.path == path)
    ratio = samples.speed[steps] / samples.feed[steps]
    slowest = int(steps[ratio.argmin()])
    length = samples.length[steps]
    base = program.base_from_work
    x, y, z = ((samples.place[slowest] - np.asarray(base.origin)) @ base.rotation).tolist()
    return SlowPath(
        path,
        float(samples.feed[slowest]),
        float(samples.speed[slowest]),
        int(samples.joint[slowest]) + 1,
        (x, y, z),
        float(length[ratio < _KEPT].sum() / length.sum()),
    )


def _check_possible(samples: _Samples, robot: Robot, program: Program, file: str) -> None:
    """Raise NoSafeProgram for a feed that the arm cannot run anywhere."""
    order = np.argsort(-samples.feed, kind="stable")
    top = samples.feed[order[0]]
    fast = order[samples.feed[order] == top]
    chosen = fast[np.linspace(0, len(fast) - 1, min(len(fast), _MAX_SAMPLES)).astype(np.int64)]
    limit = float(bound_speed(robot, samples.joints[chosen], program.flange_from_tool.origin).max())
    if top <= limit:
        return
    what = (
        f"asks for a feed of {short(float(top), 1)} mm/s, and {robot.name} moves its tool there at "
        f"{short(limit, 0)} mm/s at most, with all joints at full speed"
    )
    raise NoSafeProgram(file, what, "lower process.feed, or the speed in the program that was read")


def bound_speed(robot: Robot, joints: FloatArray, tip: Vec3) -> FloatArray:
    """Compute upper bounds (R,) of the TCP speed, mm/s: the sum of all joints at full speed.

    joints: (R, J) joint values, rad or mm.
    tip: TCP in the flange frame, mm.
    """
    columns, rotation, _ = compute_jacobian(robot, joints)
    arm = (rotation @ np.asarray(tip))[:, :, None]
    turned = np.cross(columns[:, 3:], arm, axisa=1, axisb=1, axisc=1)
    return np.asarray(np.linalg.norm(columns[:, :3] + turned, axis=1) @ robot.fastest)


def describe_slow_path(slow: SlowPath, name: str) -> str:
    """Describe a slow path `name` for a note."""
    return (
        f"{name}: its feed of {short(slow.feed, 1)} mm/s falls to {short(slow.speed, 1)} "
        f"at {join_short(slow.place, 1)} mm, where axis {slow.joint} is at its maximum speed; "
        f"{100 * slow.share:.0f} % of its length is slower than its feed"
    )


def report_slow_paths(slow: Sequence[SlowPath], names: Sequence[str]) -> list[dict[str, object]]:
    """Make the rows of the report, mm and mm/s.

    names: name of each path of the tour.
    """
    return [_report(row, names[row.path]) for row in slow]


def _report(slow: SlowPath, name: str) -> dict[str, object]:
    x, y, z = slow.place
    return {
        "path": name,
        "feed": slow.feed,
        "speed": round(slow.speed, 3),
        "axis": slow.joint,
        "place": [round(x, 3), round(y, 3), round(z, 3)],
        "share": round(slow.share, 4),
    }
