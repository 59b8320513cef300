"""Forward kinematics of arms from data sheets, by textbook matrices. Independent of camgen."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]
SHARED = Path(__file__).parents[2].parent / "shared" / "robots"


def dh(rows: Sequence[tuple[float, float, float, float]]) -> Matrix:
    """The product of Denavit and Hartenberg's matrices for theta (deg), d, a (mm), alpha (deg)."""
    product = np.eye(4)
    for theta, d, a, alpha in rows:
        ct, st = math.cos(math.radians(theta)), math.sin(math.radians(theta))
        ca, sa = math.cos(math.radians(alpha)), math.sin(math.radians(alpha))
        step = [
            [ct, -st * ca, st * sa, a * ct],
            [st, ct * ca, -ct * sa, a * st],
            [0, sa, ca, d],
            [0, 0, 0, 1],
        ]
        product = product @ np.array(step)
    return product


def six(a1: float, d1: float, a2: float, a3: float, d4: float, d6: float) -> Callable[..., Matrix]:
    """The pose of the flange for theta 1 to 6 (deg) of an arm with these lengths, mm.

    If all are 0, the upper arm is upright and the forearm points ahead.
    """

    def forward(t1: float, t2: float, t3: float, t4: float, t5: float, t6: float) -> Matrix:
        base = [(t1, d1, a1, -90), (t2 - 90, 0, a2, 0), (t3, 0, a3, -90)]
        return dh([*base, (t4, d4, 0, 90), (t5, 0, 0, -90), (t6 + 180, d6, 0, 0)])

    return forward


#: For each name: the arm, and the angles of `six` from the joint values of its controller, deg.
ARMS: dict[str, tuple[Callable[..., Matrix], Callable[..., tuple[float, ...]]]] = {
    "IRB 120": (six(0, 290, 270, 70, 302, 72), lambda *q: q),
    "IRB 1200": (six(0, 399.1, 448, 42, 451, 82), lambda *q: q),
    "IRB 2000": (six(0, 780, 710, 125, 850, 150), lambda *q: (q[0], q[1], q[2] - q[1], *q[3:])),
    "IRB 2400": (six(100, 615, 705, 135, 755, 85), lambda *q: (q[0], q[1], q[2] - q[1], *q[3:])),
    "VS-060": (six(0, 345, 305, 10, 300, 70), lambda *q: (q[0], q[1], q[2] - 90, *q[3:])),
    "VS-6556": (six(75, 335, 270, 90, 295, 80), lambda *q: (q[0], q[1], q[2] - 90, *q[3:])),
    "VS-6577": (six(75, 335, 365, 90, 405, 80), lambda *q: (q[0], q[1], q[2] - 90, *q[3:])),
    "Viper s650": (
        six(75, 335, 270, 90, 295, 80),
        lambda *q: (q[0], q[1] + 90, q[2] - 180, *q[3:]),
    ),
}


def by_hand(name: str, degrees: Sequence[float]) -> Matrix:
    """base_from_flange (4, 4) of an arm of `ARMS` for the joint values of its controller."""
    arm, angles = ARMS[name]
    return arm(*angles(*degrees))


def shared_robot(stem: str) -> dict[str, Any]:
    return tomllib.loads((SHARED / f"{stem}.toml").read_text())


def _step(origin: Sequence[float], rpy: Sequence[float]) -> Matrix:
    r, p, y = (math.radians(v) for v in rpy)
    step = np.eye(4)
    rz = np.array([[math.cos(y), -math.sin(y), 0], [math.sin(y), math.cos(y), 0], [0, 0, 1]])
    ry = np.array([[math.cos(p), 0, math.sin(p)], [0, 1, 0], [-math.sin(p), 0, math.cos(p)]])
    rx = np.array([[1, 0, 0], [0, math.cos(r), -math.sin(r)], [0, math.sin(r), math.cos(r)]])
    step[:3, :3], step[:3, 3] = rz @ ry @ rx, origin
    return step


def shared_frames(data: dict[str, Any], values: Sequence[float]) -> list[Matrix]:
    """The frames (4, 4) of base, links and flange of a shared description.

    values: joint values of the controller, deg or mm.
    """
    serial = (
        np.array(data["coupling"]["matrix"]) @ values if "coupling" in data else np.asarray(values)
    )
    frames = [np.eye(4)]
    for joint, value in zip(data["joint"], serial, strict=True):
        axis = np.array(joint["axis"])
        # A rotation by roll, pitch and yaw is exact, as all axes are parallel to x, y or z.
        slides = joint["kind"] == "prismatic"
        motion = _step(axis * value * slides, axis * value * (not slides))
        frames.append(frames[-1] @ _step(joint["origin_mm"], joint["origin_rpy_deg"]) @ motion)
    return [*frames, frames[-1] @ _step(data["flange"]["xyz_mm"], data["flange"]["rpy_deg"])]
