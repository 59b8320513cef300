"""Rotated coordinates (G68): coordinates of the program become coordinates of the machine."""

from __future__ import annotations

import math

from msgspec import Struct


class Rotation(Struct, frozen=True):
    """The rotation of G68.

    axes: numbers of the two axes of the plane.
    centre: absolute coordinates of the centre along these axes, mm.
    angle: angle from the first axis to the second, rad.
    """

    axes: tuple[int, int]
    centre: complex
    angle: float

    def turn(self, point: list[float], back: bool = False) -> list[float]:
        """Rotates a point, mm. Changes the list and returns it.

        back: whether the point is of the machine and the result of the program.
        """
        first, second = self.axes
        offset = complex(point[first], point[second]) - self.centre
        rotated = self.centre + offset * _make_factor(-self.angle if back else self.angle)
        point[first], point[second] = rotated.real, rotated.imag
        return point

    def turn_offset(self, words: dict[str, float], absolute: bool) -> None:
        """Rotates the centre of an arc in `words`, mm: an offset from its start, or absolute."""
        names = tuple("IJK"[axis] for axis in self.axes)
        if not any(name in words for name in names):
            return
        origin = self.centre if absolute else 0j
        offset = complex(*(words.get(name, 0.0) for name in names)) - origin
        centre = offset * _make_factor(self.angle) + origin
        words[names[0]], words[names[1]] = centre.real, centre.imag


def _make_factor(angle: float) -> complex:
    return complex(math.cos(angle), math.sin(angle))
