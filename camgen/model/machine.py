"""A three-axis machine as the settings of its controller describe it."""

from __future__ import annotations

import math
from typing import Literal

from msgspec import Struct
from msgspec.structs import replace

from camgen.model.cell import Axes, Dynamics
from camgen.model.part import Note
from camgen.model.pose import Vec3


class Machine(Struct, frozen=True):
    """The machine of `cell.machine`.

    file: name of the file of its settings.
    controller: name of its controller.
    post: the post for this controller.
    corner: kind of corner of the controller, as in `Dynamics`.
    axes: limits of its axes.
    low, high: ends of the travel of its axes, mm, machine coordinates.
    speed: maximum speed along the path, mm/s.
    acceleration: maximum acceleration along the path, mm/s2.
    deviation: junction deviation, mm; None: corners are rounded as the program says.
    chord: distance by which the chords of an arc leave it, mm.
    pause: time for which the machine stands where it comes to rest, s.
    notes: settings that the file lacks, with the values that are assumed.
    """

    file: str
    controller: str
    post: str
    corner: Literal["arc", "junction"]
    axes: Axes
    low: Vec3
    high: Vec3
    speed: float = math.inf
    acceleration: float = math.inf
    deviation: float | None = None
    chord: float = 0.002
    pause: float = 0.0
    notes: tuple[Note, ...] = ()

    def drive(self, dynamics: Dynamics) -> Dynamics:
        """`dynamics` of a post with the limits of this machine."""
        # No direction allows more than the axes together.
        speed = min(self.speed, math.hypot(*self.axes.rates))
        acceleration = min(self.acceleration, math.hypot(*self.axes.accelerations))
        deviation = dynamics.deviation if self.deviation is None else self.deviation
        return replace(
            dynamics,
            axes=self.axes,
            fastest=speed,
            acceleration=acceleration,
            deviation=deviation,
            chord=self.chord,
            pause=self.pause,
        )
