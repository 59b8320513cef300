"""Arms as URDF texts, and the poses of their flanges by the definition of URDF.

The module is independent of camgen, except for the data of its robots.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]
DATA = Path(__file__).parents[2] / "camgen" / "robots" / "data"
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0), "-z": (0.0, 0.0, -1.0)}


class Arm(NamedTuple):
    """The serial chain of an arm.

    steps: frame (4, 4) of each joint in the frame before it, m.
    axes: unit vector of each joint in its frame.
    kinds: revolute or prismatic.
    limits: lowest and highest joint values, rad or m.
    speeds: maximum joint speeds, rad/s or m/s.
    flange: frame (4, 4) of the flange in the frame of the last joint, m.
    """

    steps: tuple[Matrix, ...]
    axes: tuple[Matrix, ...]
    kinds: tuple[str, ...]
    limits: tuple[tuple[float, float], ...]
    speeds: tuple[float, ...]
    flange: Matrix


def turn(axis: Sequence[float] | Matrix, angle: float) -> Matrix:
    """Rotation (3, 3) about an axis by an angle (rad), computed with a quaternion."""
    w, (x, y, z) = math.cos(angle / 2), np.asarray(axis) * math.sin(angle / 2)
    return np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )


def step(xyz: Sequence[float] | Matrix, rotation: Matrix | None = None) -> Matrix:
    """A frame (4, 4) at a position, m. rotation: (3, 3); None is the identity."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = np.eye(3) if rotation is None else rotation, xyz
    return matrix


def rpy(roll: float, pitch: float, yaw: float) -> Matrix:
    """Rotation (3, 3) about the fixed axes x, then y, then z."""
    return turn((0, 0, 1), yaw) @ turn((0, 1, 0), pitch) @ turn((1, 0, 0), roll)


def rpy_of(rotation: Matrix) -> tuple[float, float, float]:
    """Roll, pitch and yaw of a rotation that does not point up or down."""
    pitch = math.atan2(-rotation[2, 0], math.hypot(rotation[0, 0], rotation[1, 0]))
    return (
        math.atan2(rotation[2, 1], rotation[2, 2]),
        pitch,
        math.atan2(rotation[1, 0], rotation[0, 0]),
    )


def built_in(stem: str) -> Arm:
    """The serial chain of a built-in robot. With a rod, joint 3 has the limits of the rod."""
    data = tomllib.loads((DATA / f"{stem}.toml").read_text())
    rows = data["joints"]
    slides = [row.get("sliding", False) for row in rows]
    units = [1e-3 if sliding else math.radians(1) for sliding in slides]
    limits = [row["limits"] for row in rows]
    if rod := data.get("rod"):
        limits[rod["joint"] - 1] = rod["limits"]
    x, y, z, *angles = data["flange"]
    return Arm(
        tuple(step(np.array(row["at"]) / 1000) for row in rows),
        tuple(np.array(_AXES[row["axis"]]) for row in rows),
        tuple("prismatic" if sliding else "revolute" for sliding in slides),
        tuple((low * unit, high * unit) for (low, high), unit in zip(limits, units, strict=True)),
        tuple(row["speed"] * unit for row, unit in zip(rows, units, strict=True)),
        step(np.array([x, y, z]) / 1000, rpy(*np.radians(angles))),
    )


def disguised(arm: Arm, seed: int) -> Arm:
    """An equal arm with random frames, shifted along their axes, and other zeros of its joints."""
    rng = np.random.default_rng(seed)
    steps, axes, limits = [], [], []
    before = np.eye(4)
    for joint_step, axis, kind, (low, high) in zip(
        arm.steps, arm.axes, arm.kinds, arm.limits, strict=True
    ):
        frame = turn(_unit(rng), rng.uniform(0, 3))
        moved = step(axis * rng.uniform(-0.2, 0.2), frame)
        zero = 0.0 if kind == "prismatic" else rng.uniform(-1, 1)
        steps.append(before @ joint_step @ step((0, 0, 0), turn(axis, zero)) @ moved)
        axes.append(frame.T @ axis)
        limits.append((low - zero, high - zero))
        before = np.linalg.inv(moved)
    return arm._replace(
        steps=tuple(steps), axes=tuple(axes), limits=tuple(limits), flange=before @ arm.flange
    )


def _unit(rng: np.random.Generator) -> Matrix:
    vector = rng.normal(size=3)
    return np.asarray(vector / np.linalg.norm(vector))


def tip(arm: Arm, values: Sequence[float] | Matrix) -> Matrix:
    """base_from_flange (4, 4), m, for joint values in rad and m."""
    frame = np.eye(4)
    for joint_step, axis, kind, value in zip(arm.steps, arm.axes, arm.kinds, values, strict=True):
        motion = step(axis * value) if kind == "prismatic" else step((0, 0, 0), turn(axis, value))
        frame = frame @ joint_step @ motion
    return frame @ arm.flange


def origin(frame: Matrix) -> str:
    angles = " ".join(f"{angle:.17g}" for angle in rpy_of(frame[:3, :3]))
    return f'<origin xyz="{" ".join(f"{v:.17g}" for v in frame[:3, 3])}" rpy="{angles}"/>'


def urdf(arm: Arm, name: str = "arm") -> str:
    """The URDF text of an arm with the links base_link, link_1 and so on, and tool0 at the end."""
    lines = [f'<robot name="{name}">', '<link name="base_link"/>']
    before = "base_link"
    rows = zip(arm.steps, arm.axes, arm.kinds, arm.limits, arm.speeds, strict=True)
    for k, (joint_step, axis, kind, (low, high), speed) in enumerate(rows, start=1):
        lines += [
            f'<link name="link_{k}"/>',
            f'<joint name="joint_{k}" type="{kind}">',
            f'<parent link="{before}"/><child link="link_{k}"/>{origin(joint_step)}',
            f'<axis xyz="{" ".join(f"{v:.17g}" for v in axis)}"/>',
            f'<limit lower="{low:.17g}" upper="{high:.17g}" effort="0" velocity="{speed:.17g}"/>',
            "</joint>",
        ]
        before = f"link_{k}"
    lines += [
        '<link name="tool0"/>',
        f'<joint name="flange" type="fixed"><parent link="{before}"/>'
        f'<child link="tool0"/>{origin(arm.flange)}</joint>',
        "</robot>",
    ]
    return "\n".join(lines) + "\n"
