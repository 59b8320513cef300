"""Contours for tests, from a few round numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from camgen.model.part import Contour, Part
from camgen.model.pose import frozen

QUARTER = math.tan(math.pi / 8)


def contour(
    points: Sequence[Sequence[float]],
    bulges: Sequence[float] | None = None,
    *,
    closed: bool = True,
    name: str = "c1",
) -> Contour:
    shape = frozen(points)
    return Contour(
        shape, frozen(np.zeros(len(shape)) if bulges is None else bulges), closed, "0", name
    )


def circle(x: float, y: float, r: float, name: str = "c1") -> Contour:
    return contour([(x + r, y), (x - r, y)], [1.0, 1.0], name=name)


def rectangle(x: float, y: float, w: float, h: float, name: str = "c1") -> Contour:
    return contour([(x, y), (x + w, y), (x + w, y + h), (x, y + h)], name=name)


def rounded(w: float, h: float, r: float, name: str = "c1") -> Contour:
    corners = [(r, 0), (w - r, 0), (w, r), (w, h - r), (w - r, h), (r, h), (0, h - r), (0, r)]
    return contour(corners, [0, QUARTER] * 4, name=name)


def clockwise(shape: Contour) -> Contour:
    bulges = -np.roll(shape.bulges[::-1], -1)
    return Contour(frozen(shape.points[::-1]), frozen(bulges), shape.closed, shape.layer, shape.id)


def part(*contours: Contour) -> Part:
    return Part("part", "part.dxf", "mm", contours, ())
