"""Which links of an arm overlap whatever its joints do: there is no sense in testing those against each other."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from camgen.pose import FloatArray
from camgen.robots.forward import frames
from camgen.robots.models import Box, Robot

#: Configurations in which two links have to overlap, every time.
_SAMPLES = 48
#: Keeps the cross product of two edges that are parallel from separating anything.
_PARALLEL = 1e-9

_Boxes = tuple[FloatArray, FloatArray, FloatArray]


def touching(robot: Robot) -> tuple[tuple[int, int], ...]:
    """Pairs of links, the base being 0, that are neighbours or whose boxes, grown by the robot's pad, overlap at home
    and in all of an even sample of configurations.
    """
    rng = np.random.default_rng(1)
    spread = rng.uniform(robot.limits[:, 0], robot.limits[:, 1], (_SAMPLES, len(robot.joints)))
    rotations, origins = frames(robot, np.vstack([robot.home, spread]))
    bodies = [
        _placed(link.boxes, robot.pad, rotations[:, k], origins[:, k]) if link.boxes else None
        for k, link in enumerate(robot.links)
    ]
    pairs = []
    for i, j in itertools.combinations(range(len(bodies)), 2):
        a, b = bodies[i], bodies[j]
        if j == i + 1 or (a and b and bool(overlaps(a, b).any(axis=(1, 2)).all())):
            pairs.append((i, j))
    return tuple(pairs)


def _placed(boxes: tuple[Box, ...], pad: float, rotations: FloatArray, origins: FloatArray) -> _Boxes:
    """B boxes of a link in S places of it: axes (S, B, 3, 3), centres (S, B, 3) and half edges (B, 3)."""
    own = np.stack([box.link_from_box.rotation for box in boxes])
    centres = np.array([box.link_from_box.origin for box in boxes])
    half = np.array([box.half for box in boxes]) + pad
    return rotations[:, None] @ own, origins[:, None] + centres @ rotations.transpose(0, 2, 1), half


def overlaps(a: _Boxes, b: _Boxes) -> NDArray[np.bool_]:
    """(S, A, B): which boxes overlap which others, by separating axes (Gottschalk, Lin, Manocha, 1996)."""
    (axes_a, at_a, half_a), (axes_b, at_b, half_b) = a, b
    turn = np.swapaxes(axes_a[:, :, None], -1, -2) @ axes_b[:, None]
    away = ((at_b[:, None] - at_a[:, :, None])[..., None, :] @ axes_a[:, :, None])[..., 0, :]
    size = np.abs(turn) + _PARALLEL
    first, second = half_a[:, None], half_b[None]
    apart = (np.abs(away) > first + (size @ second[..., None])[..., 0]).any(axis=-1)
    seen = (away[..., None, :] @ turn)[..., 0, :]
    apart |= (np.abs(seen) > second + (first[..., None, :] @ size)[..., 0, :]).any(axis=-1)
    for i, j in itertools.product(range(3), range(3)):
        i1, i2, j1, j2 = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
        reach = first[..., i1] * size[..., i2, j] + first[..., i2] * size[..., i1, j]
        reach = reach + second[..., j1] * size[..., i, j2] + second[..., j2] * size[..., i, j1]
        apart |= np.abs(away[..., i2] * turn[..., i1, j] - away[..., i1] * turn[..., i2, j]) > reach
    return np.asarray(~apart)
