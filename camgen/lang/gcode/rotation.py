"""Rotated coordinates (G68): points of the program as those of the machine."""

from __future__ import annotations

import math

from msgspec import Struct


class Rotation(Struct, frozen=True):
    """G68: axes of the plane, the centre in it, mm absolute, and the angle from the first to the second, rad."""

    axes: tuple[int, int]
    centre: complex
    angle: float

    def turn(self, point: list[float], back: bool = False) -> list[float]:
        """A point of the program as one of the machine; back: the other way round."""
        first, second = self.axes
        way = complex(point[first], point[second]) - self.centre
        there = self.centre + way * _turn(-self.angle if back else self.angle)
        point[first], point[second] = there.real, there.imag
        return point

    def turn_offset(self, words: dict[str, float], absolute: bool) -> None:
        """The words of a centre, mm: from the start of its arc, or absolute."""
        names = tuple("IJK"[axis] for axis in self.axes)
        if not any(name in words for name in names):
            return
        origin = self.centre if absolute else 0j
        way = (complex(*(words.get(name, 0.0) for name in names)) - origin) * _turn(
            self.angle
        ) + origin
        words[names[0]], words[names[1]] = way.real, way.imag


def _turn(angle: float) -> complex:
    return complex(math.cos(angle), math.sin(angle))
