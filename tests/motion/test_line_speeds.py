"""Speeds of straight links: no joint exceeds its speed, also between samples."""

import math

import numpy as np
import pytest

from camgen.geometry.ragged import compute_offsets
from camgen.model.pose import FloatArray, frozen
from camgen.motion.limits import LinkSpeeds, compute_line_speeds
from camgen.motion.pose_paths import PosePath, divide
from camgen.motion.setup import JUMP, compute_flange_poses, count_samples
from camgen.robots.kinematics.continuity import Choice, follow
from tests.motion.test_reach import CELL

#: Limits so large that the joints alone limit the speed of a link.
FAST = LinkSpeeds(part=1e6, free=1e6, share=1.0, acceleration=1e9)


def follow_path(path: PosePath) -> FloatArray:
    """The joint values at the rows of a path."""
    poses = compute_flange_poses(CELL, path.position, path.rotation)
    followed = follow(CELL.robot, poses, CELL.robot.home, 0.0, JUMP)
    assert isinstance(followed, Choice)
    return followed.joints


#: Start, end and tilt, deg, of links on which a joint was up to 20 % too fast between two samples.
FAST_LINKS = [
    ((-63, 487, 310), (35, -448, 34), 30),
    ((32, 443, 20), (139, -147, 136), 0),
    ((268, 297, 336), (192, 439, 11), 0),
    ((-37, -374, 3), (157, 411, 36), 0),
]
DRAW = np.random.default_rng(7)
RANDOM_LINKS = [
    (tuple(start), tuple(end), lean)
    for start, end, lean in zip(
        DRAW.uniform([-100, -200, 20], [100, 200, 250], (12, 3)).tolist(),
        DRAW.uniform([-100, -200, 20], [100, 200, 250], (12, 3)).tolist(),
        [0, 15, 30] * 4,
        strict=True,
    )
]


@pytest.mark.parametrize(("start", "end", "tilt"), [*FAST_LINKS, *RANDOM_LINKS])
def test_no_joint_is_too_fast_between_two_samples(
    start: tuple[float, ...], end: tuple[float, ...], tilt: float
) -> None:
    """The rates of the joints are computed by differences over 0.5 mm."""
    angle = math.radians(tilt)
    cos, sin = math.cos(angle), math.sin(angle)
    down = np.array([[cos, 0, sin], [0, -1, 0], [sin, 0, -cos]])
    rotation = frozen(np.stack([down, down]))
    path = PosePath(np.array([start, end], dtype=float), np.full((2, 3), np.nan), rotation)
    parts = count_samples(path)
    samples = divide(path, parts)
    (speed,) = compute_line_speeds(
        CELL, FAST, samples, follow_path(samples), compute_offsets(parts)
    )
    fine = divide(path, np.array([math.ceil(2 * float(path.length.sum()))]))
    rates = np.abs(np.diff(follow_path(fine), axis=0)) / fine.length[:, None]
    fraction = float((rates * speed / CELL.robot.fastest).max())
    assert 0.9 < fraction <= 1.0 + 1e-6


def test_a_corner_of_a_link_does_not_slow_its_segments() -> None:
    """Each segment has the same speed as alone, though the rates of joints jump at the corner."""
    corners = np.array([(100.0, -150.0, 60.0), (-40.0, 60.0, 200.0), (80.0, 180.0, 60.0)])
    down = frozen(np.stack([np.diag([1.0, -1.0, -1.0])] * 3))
    path = PosePath(corners, np.full((3, 3), np.nan), down)
    parts = count_samples(path)
    samples, offsets = divide(path, parts), compute_offsets(parts)
    joints = follow_path(samples)
    together = compute_line_speeds(CELL, FAST, samples, joints, offsets)
    for k in range(2):
        low, high = int(offsets[k]), int(offsets[k + 1])
        alone = PosePath(corners[k : k + 2], path.via[k : k + 2], down[:2])
        (speed,) = compute_line_speeds(
            CELL,
            FAST,
            divide(alone, parts[k : k + 1]),
            joints[low : high + 1],
            np.array([0, high - low]),
        )
        assert together[k] == speed
    jump = np.abs(np.diff(joints, axis=0) / samples.length[:, None])[
        int(offsets[1]) - 1 : int(offsets[1]) + 1
    ]
    assert float(np.abs(np.diff(jump, axis=0)).max()) > 1e-3
