"""The judge of written programs: does the motion of a text do what its job asks of its drawing?

It knows the drawing by its vertices, the job by its numbers and the documented rules, and the text
by its trace. It imports nothing of camgen.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import shapely

from bench.reliability.code_mutants.cases import Case
from bench.reliability.code_mutants.shapes import Array, make_region
from bench.reliability.code_mutants.traces import (
    BY_ACCELERATION,
    FREE,
    JOINTS,
    Motion,
    Pause,
    Statement,
    Step,
    Switch,
)
from bench.support.motions import find_arc, sample_motion

#: Distance between samples of a motion, mm.
STEP_MM = 0.2
#: Positions may differ by the printed digits, mm.
DIGIT_MM = 2e-3
#: Speeds may differ by the printed digits, as a fraction.
SPEED_FRACTION = 2e-3
#: Entries of a rotation may differ by the printed digits.
_ROTATION = 2e-4
#: A controller runs through corners flatter than this without a stop, rad.
_FLAT_RAD = math.radians(1.0)


class Wrong(Exception):
    """A program that does not do what its job asks: the first place, and the fault."""


class Piece(NamedTuple):
    """A motion with the state in which it runs.

    index: number of the motion in the program.
    start: mm; nan if unknown.
    points: samples along it, (N, 3) mm.
    is_on: whether the signal is on.
    rpm: speed of the spindle.
    """

    index: int
    start: Array
    motion: Motion
    points: Array
    is_on: bool
    rpm: float

    @property
    def is_known(self) -> bool:
        """Whether its start is known."""
        return not bool(np.isnan(self.start).any())

    @property
    def is_vertical(self) -> bool:
        """The motion changes its height alone."""
        return float(np.ptp(self.points[:, :2], axis=0).max()) < DIGIT_MM

    @property
    def places(self) -> Array:
        """Its samples as seen from above, (N,) points of shapely."""
        return shapely.points(self.points[:, :2])

    @property
    def length(self) -> float:
        """Its length, mm."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())

    def find_direction(self, place: int) -> Array:
        """The direction at the start (0) or at the end (-1), not of unit length."""
        if self.motion.via is None:
            return self.points[-1] - self.points[0]
        centre, axis, _ = find_arc(self.start, self.motion.via, self.motion.end)
        return np.cross(axis, self.points[place] - centre)

    def complain(self, fault: str) -> Wrong:
        """The error that names the place of this motion."""
        x, y, z = self.motion.end
        return Wrong(f"motion {self.index} to {x:.3f} {y:.3f} {z:.3f}: {fault}")


class Run(NamedTuple):
    """Motions in the material, one after the other without a lift."""

    pieces: list[Piece]

    @property
    def points(self) -> Array:
        """All samples, (N, 3) mm."""
        return np.concatenate([piece.points for piece in self.pieces])


def check_program(case: Case, steps: Sequence[Step]) -> list[Run]:
    """Checks the rules that all jobs share. Returns the motions in the material. Wrong, else."""
    pieces = follow_state(case, steps)
    _check_end(case, pieces, steps)
    runs: list[Run] = []
    is_open = False
    for piece in pieces:
        if piece.motion.kind == JOINTS:
            is_open = False
            continue
        _check_set_up(case, piece)
        if piece.is_known and piece.length < DIGIT_MM:
            continue
        if _is_work(case, piece):
            if not is_open:
                runs.append(Run([]))
            runs[-1].pieces.append(piece)
            is_open = True
        else:
            _check_air(case, piece)
            is_open = is_open and _is_lift_between(case, piece)
    _check_corners(case, pieces)
    return runs


def _is_lift_between(case: Case, piece: Piece) -> bool:
    """Whether a motion goes up or down between contact and the retract height.

    A tool that presses does so before and after an outer corner.
    """
    if not case.setting("process", "force") or not piece.is_vertical:
        return False
    retract = case.setting("process", "retract")
    heights = (piece.start[2], piece.motion.end[2])
    return abs(max(heights) - retract) < DIGIT_MM


def follow_state(case: Case, steps: Sequence[Step]) -> list[Piece]:
    """The motions with their state; checks the switches between them."""
    pieces: list[Piece] = []
    position = np.full(3, np.nan)
    is_on, rpm = False, 0.0
    for number, step in enumerate(steps):
        if isinstance(step, Switch):
            _check_switch(case, step, position, steps[number + 1 :])
            if step.name == case.spindle:
                rpm = step.value
            else:
                is_on = step.value > 0.0
        elif isinstance(step, Motion):
            points = _sample(position, step)
            pieces.append(Piece(len(pieces), position, step, points, is_on, rpm))
            position = np.full(3, np.nan) if step.kind == JOINTS else step.end
    return pieces


def _sample(start: Array, motion: Motion) -> Array:
    if motion.kind == JOINTS or np.isnan(start).any():
        return motion.end[None]
    return sample_motion(start, motion.via, motion.end, STEP_MM, 2 if motion.via is None else 3)


def _check_switch(case: Case, switch: Switch, position: Array, after: Sequence[Step]) -> None:
    x, y, z = position
    place = f"switch {switch.name} to {switch.value:g} at {x:.3f} {y:.3f} {z:.3f}"
    if switch.name not in (case.signal, case.spindle):
        raise Wrong(f"{place}: the job has no such output")
    if switch.value == 0.0 and np.isnan(z):
        return
    is_spindle = switch.name == case.spindle
    if is_spindle:
        if switch.value not in (0.0, *_list_rpm(case)):
            raise Wrong(f"{place}: the job has another spindle speed")
        if z < case.setting("process", "clearance") - DIGIT_MM:
            raise Wrong(f"{place}: below the clearance height")
    elif switch.value not in (0.0, 1.0):
        raise Wrong(f"{place}: neither on nor off")
    else:
        wanted = _switch_height(case, is_on=switch.value > 0.0)
        if abs(z - wanted) > DIGIT_MM:
            raise Wrong(f"{place}: not at height {wanted:g}")
    dwell = case.setting("process", "dwell")
    pause = after[0].seconds if after and isinstance(after[0], Pause) else 0.0
    if switch.value > 0.0 and abs(pause - dwell) > 1e-3:
        raise Wrong(f"{place}: waits {pause:g} s, not {dwell:g} s")


def _list_rpm(case: Case) -> list[float]:
    if "tools" in case.job:
        return [tool["speed"] for tool in case.job["tools"]]  # type: ignore[index]
    return [case.setting("process", "spindle")]


def _switch_height(case: Case, is_on: bool) -> float:
    """The height at which the signal is switched: at the contact, or in the air around it."""
    if case.job["process"].get("switch") != "air":
        return 0.0
    return case.setting("process", "approach" if is_on else "clearance")


def _check_end(case: Case, pieces: list[Piece], steps: Sequence[Step]) -> None:
    if not pieces:
        raise Wrong("no motion")
    values = {step.name: step.value for step in steps if isinstance(step, Switch)}
    for name in (case.signal, case.spindle):
        if name and values.get(name) != 0.0:
            raise Wrong(f"{name} is not switched off at the end")
    last = pieces[-1].motion
    if last.kind != JOINTS and last.end[2] < case.setting("process", "clearance") - DIGIT_MM:
        raise pieces[-1].complain("the program ends below the clearance height")
    # A pause that follows no switch stops the tool for nothing.
    before: Step | None = None
    for step in steps:
        if isinstance(step, Pause) and not (isinstance(before, Switch) and before.value > 0.0):
            raise Wrong(f"a wait of {step.seconds:g} s that follows no output")
        before = before if isinstance(step, Statement) else step


def _check_set_up(case: Case, piece: Piece) -> None:
    """Checks frames and the orientation of a fixed tool."""
    motion = piece.motion
    if motion.frames:
        cell = case.job["cell"]
        wanted = [*cell["flange_from_tool"][:3], *cell["base_from_work"][:3]]  # type: ignore[index]
        if not np.allclose(motion.frames[:6], wanted, atol=DIGIT_MM):
            raise piece.complain(f"frames {motion.frames[:6]}, not {wanted}")
        rotations = np.array(motion.frames[6:])
        unit = np.eye(3).ravel() if len(rotations) % 9 == 0 else [1.0, 0.0, 0.0, 0.0]
        if not np.allclose(rotations.reshape(-1, len(unit)), unit, atol=_ROTATION):
            raise piece.complain("a frame is rotated")
    if motion.rotation is not None:
        axes = motion.rotation.T
        if not np.allclose(axes[2], [0.0, 0.0, -1.0], atol=_ROTATION):
            raise piece.complain("the tool axis does not point down")
        is_fixed = case.job["tool"].get("orient") != "follow"
        if is_fixed and not np.allclose(axes[0], [1.0, 0.0, 0.0], atol=_ROTATION):
            raise piece.complain("the tool is turned about its axis")
    if case.post == "pacscript":
        words = " ".join(motion.setup)
        if "changetool 1 changework 1" not in words:
            raise piece.complain("not with tool 1 and work 1 of the controller")


def _is_work(case: Case, piece: Piece) -> bool:
    """Whether a motion runs below the clearance height in the plane."""
    if not piece.is_known or piece.is_vertical:
        return False
    is_low = float(piece.points[:, 2].min()) < case.setting("process", "clearance") - DIGIT_MM
    if is_low and not piece.is_on and case.job["process"].get("stay_down"):
        return False
    return is_low


def _check_air(case: Case, piece: Piece) -> None:
    """Checks a motion above the part, straight down to it or up from it."""
    clearance = case.setting("process", "clearance")
    start, end = piece.start[2], piece.motion.end[2]
    if not piece.is_known:
        if end < clearance - DIGIT_MM:
            raise piece.complain("the first position is below the clearance height")
        return
    if not piece.is_vertical:
        if piece.points[:, 2].min() < clearance - DIGIT_MM:
            _check_stay_down(case, piece)
        elif piece.is_on:
            raise piece.complain("travel with the signal on")
        check_speed(piece, case.setting("process", "travel"), "travel")
        return
    if case.kind == "drill":
        return
    if _is_lift_between(case, piece):
        _check_lift(case, piece)
    elif end < start:
        _check_descent(case, piece)
    else:
        if end < clearance - DIGIT_MM:
            raise piece.complain("up to less than the clearance height")
        check_speed(piece, case.setting("process", "travel"), "travel")


def _check_lift(case: Case, piece: Piece) -> None:
    """Checks a motion between contact and the height of retract."""
    retract = case.setting("process", "retract")
    if abs(np.ptp(piece.points[:, 2]) - retract) > DIGIT_MM:
        raise piece.complain("not between contact and the height of retract")
    if piece.motion.end[2] < piece.start[2]:
        check_speed(piece, _plunge(case), "plunge")
        return
    # It goes up at the speed of the corner that follows.
    feed = case.setting("process", "feed") * case.setting("process", "max_feed_factor")
    check_speed(piece, feed, "feed")


def _check_descent(case: Case, piece: Piece) -> None:
    """Checks a motion down: at travel to the height of approach, at plunge below it."""
    start, end = piece.start[2], piece.motion.end[2]
    approach = case.setting("process", "approach")
    if end < approach - DIGIT_MM:
        if piece.motion.kind == FREE or start > approach + DIGIT_MM:
            raise piece.complain("down to the part without stopping at the approach height")
        _check_rpm(case, piece)
        check_speed(piece, _plunge(case), "plunge")
        return
    is_high = end > case.setting("process", "clearance") - DIGIT_MM
    if abs(end - approach) > DIGIT_MM and not is_high:
        raise piece.complain("down to another height than that of approach")
    check_speed(piece, case.setting("process", "travel"), "travel")


def _plunge(case: Case) -> float:
    return case.setting("process", "plunge", case.setting("process", "feed"))


def _check_rpm(case: Case, piece: Piece) -> None:
    if case.spindle and piece.rpm == 0.0:
        raise piece.complain("the spindle does not turn")


def check_speed(piece: Piece, wanted: float, label: str = "") -> None:
    """Checks the speed of a motion; a free one may state none."""
    speed = piece.motion.speed
    if math.isnan(speed):
        if piece.motion.kind != FREE:
            raise piece.complain("a line without a speed")
        return
    if abs(speed - wanted) > SPEED_FRACTION * wanted:
        text = f"{label} {wanted:g} mm/s".strip()
        raise piece.complain(f"{speed:g} mm/s, not {text}")


def _check_stay_down(case: Case, piece: Piece) -> None:
    if piece.motion.kind == FREE:
        raise piece.complain("a joint motion below the clearance height")
    if np.abs(piece.points[:, 2]).max() > DIGIT_MM:
        raise piece.complain("stays down at another height than that of the work")
    radius = case.setting("tool", "diameter") / 2.0
    distances = shapely.distance(make_region(case.shapes), piece.places)
    if distances.min() < radius - 0.005 - DIGIT_MM:
        raise piece.complain(f"travels {distances.min():.3f} mm from the part")


# Corners


def _check_corners(case: Case, pieces: list[Piece]) -> None:
    """Checks how far the controller rounds corners of the work, and stops where it has to stop."""
    for before, after in pairwise(pieces):
        if not (_is_work(case, before) and _is_work(case, after)):
            continue
        angle = find_angle(before.find_direction(-1), after.find_direction(0))
        if angle < _FLAT_RAD:
            continue
        radius = _blend_radius(case, before, after)
        limit = case.setting("tolerance", "corner")
        if case.post in ("gcode", "grbl"):
            # G64 P is the deviation itself.
            deviation = radius
        else:
            deviation = radius * math.tan(angle / 4.0)
        if deviation > limit + DIGIT_MM:
            raise before.complain(f"the corner after it is rounded by {deviation:.3f} mm")


def find_angle(a: Array, b: Array) -> float:
    """The angle between two directions, rad."""
    cosine = a @ b / (np.linalg.norm(a) * np.linalg.norm(b))
    return math.acos(float(np.clip(cosine, -1.0, 1.0)))


def _blend_radius(case: Case, before: Piece, after: Piece) -> float:
    """Length of a corner's rounding from its point, mm: at most half of either motion."""
    blend = before.motion.blend
    if case.post == "grbl":
        return 0.0
    if case.post == "gcode":
        return blend
    if blend == BY_ACCELERATION:
        # The next motion begins as the last one brakes: v^2 / 2a before the corner.
        blend = before.motion.speed**2 / (2.0 * case.setting("process", "acceleration"))
    return float(min(blend, before.length / 2.0, after.length / 2.0))
