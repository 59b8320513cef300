"""Motions straight up and down: their heights, their speeds, and the outputs during them."""

from __future__ import annotations

import numpy as np

from camgen.check.proof.findings import Findings
from camgen.check.proof.motions import UPRIGHT_MM, Motions, Rounding
from camgen.check.proof.outputs import (
    check_outputs,
    check_spindle,
    is_switched_in_air,
    plunge_speed,
    process_signal,
)
from camgen.check.proof.pieces import BoolArray
from camgen.check.proof.tasks import HOP_MM, Task
from camgen.check.proof.travel import Phases
from camgen.model.pose import FloatArray

#: A speed may differ by this share: a text gives it with a few digits.
_SPEED_SHARE = 1e-3


class DescentChecker:
    """Examines the motions of one task that go up or down.

    of_task: (M,) which motions belong to the task.
    slack: deviation of a height, mm.
    """

    def __init__(
        self,
        task: Task,
        motions: Motions,
        phases: Phases,
        of_task: BoolArray,
        slack: float,
        rounding: Rounding,
    ) -> None:
        self.task, self.motions, self.phases = task, motions, phases
        self.of_task, self.slack, self.rounding = of_task, slack, rounding
        upright = phases.upright & of_task
        change = motions.end[:, 2] - motions.start[:, 2]
        # A chord of a slope may be so short that it counts as upright.
        least = slack + 2 * UPRIGHT_MM
        self.down = upright & (change < -least)
        self.up = upright & (change > least)

    def check(self, findings: Findings) -> None:
        """Finds motions down to the part that are too fast or begin too high, and others."""
        process, end, slack = self.task.job.process, self.motions.end[:, 2], self.slack
        plunges = self.down & (end < process.approach - slack)
        if self.task.kind != "drill":
            self._check_heights(plunges, findings)
        self._check_travel(plunges, findings)
        self._check_outputs(plunges, findings)

    def _check_heights(self, plunges: BoolArray, findings: Findings) -> None:
        process, motions, slack = self.task.job.process, self.motions, self.slack
        start, end = motions.start[:, 2], motions.end[:, 2]
        highest = max(process.approach, process.retract) if process.force else process.approach
        what = "goes down to the part without a stop at process.approach"
        findings.add_first(motions, plunges & ((start > highest + slack) | motions.joint), what)
        hops = self._end_hops() & ~motions.joint
        self._check_speed(hops, process.feed, True, findings)
        self._check_speed(plunges & ~motions.joint & ~hops, plunge_speed(process), True, findings)
        rests = self._rest_heights()
        low = end < process.clearance - slack
        what = "goes down to a height that is neither that of approach nor that of work"
        findings.add_first(
            motions, self.down & ~plunges & low & ~_is_one_of(end, rests, slack), what
        )
        # A tool that turns with the contour is turned back at the height of approach.
        first = 0 if self.task.job.tool.orient == "follow" else 1
        up = self.up & low & ~_is_one_of(end, rests[first:], slack)
        findings.add_first(motions, up, "goes up to less than process.clearance")

    def _end_hops(self) -> BoolArray:
        """(M,) motions down to the floor of a pocket's pass from the height of a hop."""
        start, end = self.motions.start[:, 2], self.motions.end[:, 2]
        if self.task.kind != "pocket":
            return np.zeros(len(end), np.bool_)
        floors = -np.array(self.task.depths)
        from_hop = np.abs(start - end - HOP_MM) <= 2 * self.slack
        return np.asarray(self.down & from_hop & _is_one_of(end, floors, self.slack))

    def _rest_heights(self) -> FloatArray:
        """Heights, mm, at which a motion may end between the part and the clearance height.

        First that of approach; after it the heights to which a tool that presses is lifted.
        """
        process = self.task.job.process
        heights = [process.approach]
        if process.force:
            lift = min(process.retract, process.clearance)
            heights += [lift - depth for depth in (0.0, *self.task.depths)]
        if self.task.kind == "pocket":
            heights += [HOP_MM - depth for depth in self.task.depths]
        return np.array(heights)

    def _check_travel(self, plunges: BoolArray, findings: Findings) -> None:
        process, motions = self.task.job.process, self.motions
        travels = self.phases.known & self.of_task & ~self.phases.works & ~plunges
        travels &= ~motions.joint & (motions.plane.length + np.abs(_rise(motions)) > 0.01)
        if process.force:
            # A lift around a sharp corner has the feed of the corner.
            travels &= ~self.up
        if self.task.kind == "drill":
            travels &= motions.end[:, 2] >= process.approach - self.slack
        self._check_speed(travels, process.travel_speed, False, findings)

    def _check_speed(
        self, rows: BoolArray, wanted: float, slower: bool, findings: Findings
    ) -> None:
        """Finds motions at another speed than `wanted`. slower: a lower one is allowed."""
        speed = self.motions.speed
        slack = self.rounding.speed + _SPEED_SHARE * wanted
        wrong = rows & ((speed > wanted + slack) | ((speed < wanted - slack) & (not slower)))
        for row in np.flatnonzero(wrong)[:1].tolist():
            what = f"has a speed of {speed[row]:.4g} mm/s, the job asks for {wanted:.4g}"
            findings.add(self.motions, row, what)

    def _check_outputs(self, plunges: BoolArray, findings: Findings) -> None:
        job, motions = self.task.job, self.motions
        signal, start = process_signal(job.process), motions.start[:, 2]
        if is_switched_in_air(job):
            low = plunges | (self.up & (start < job.process.clearance - self.slack))
            check_outputs(self.task, motions, np.flatnonzero(low), findings)
            return
        check_spindle(self.task, motions, np.flatnonzero(plunges), findings)
        # A drill keeps its output on from peck to peck.
        if not signal or job.process.force or self.task.kind == "drill":
            return
        # The process may stay on from one pass to the next, which begin below the top face.
        on = (self.down & (start > self.slack)) | self.up
        if len(self.task.depths) > 1:
            on &= ~self.up
        findings.add_first(motions, on & motions.on, f"goes up or down with output {signal} on")


def _rise(motions: Motions) -> FloatArray:
    return np.asarray(np.nan_to_num(motions.end[:, 2] - motions.start[:, 2]))


def _is_one_of(values: FloatArray, wanted: FloatArray, slack: float) -> BoolArray:
    """(M,) whether a value is within `slack` of one of `wanted`."""
    if not len(wanted):
        return np.zeros(len(values), np.bool_)
    return np.asarray((np.abs(values[:, None] - wanted) <= slack).any(axis=1))
