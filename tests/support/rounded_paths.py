"""A judge of rounded corners in texts for arms, with a reading and formulas of its own.

It looks at motions in the plane, as complex numbers. Curves are walked in small steps, so there is
no formula for a kind of corner.
"""

from __future__ import annotations

import cmath
import math
import re
from itertools import pairwise
from typing import NamedTuple

import numpy as np

Points = np.ndarray
_STEPS = 300
_NUMBER = r"(-?[\d.]+)"
#: For each language: a straight motion or an arc, a point of it, and the speed, mm/s.
_MOTION = {
    "rapid": re.compile(r"Move(?P<kind>[LC]) "),
    "pacscript": re.compile(r"Move (?P<kind>[LC]), "),
    "vplus": re.compile(r"MOVE(?P<kind>S) "),
}
_POINT = {
    "rapid": re.compile(rf"\[\[{_NUMBER},{_NUMBER},{_NUMBER}\]"),
    "pacscript": re.compile(rf"P\({_NUMBER}, {_NUMBER}, {_NUMBER},"),
    "vplus": re.compile(rf"TRANS\({_NUMBER},{_NUMBER},{_NUMBER},"),
}
_SPEED = {"pacscript": re.compile(r"Mps\(([\d.]+)"), "vplus": re.compile(r"SPEED ([\d.]+)")}
_ZONE = re.compile(r",(fine|z\d+|zCam[\d_]+),")
#: mm/s2, for controllers that begin a motion while the one before ends.
_ACCELERATION = 5000.0


class Piece(NamedTuple):
    """A level motion.

    points: start and end, mm, of an arc with its circle point between them.
    reach: distance, mm, before its end at which the controller may leave it; 0 for a stop.
    line: number of its line in the text, from 1.
    """

    points: tuple[complex, ...]
    reach: float
    line: int


class Corner(NamedTuple):
    """A corner that is passed without a stop.

    mm: distance between the executed and the programmed path.
    line: line of the motion before it.
    """

    mm: float
    line: int


class Paths(NamedTuple):
    """The motions of a text as points, and the curves in their corners.

    programmed: (N,) points of the motions, mm, at the height of the part or below.
    executed: (M,) points of the curves in their corners, mm.
    joints: number of joints between two such motions.
    """

    programmed: Points
    executed: Points
    joints: int


def trace(language: str, text: str) -> Paths:
    """The programmed and the executed path of a text as points."""
    programmed, executed = [np.zeros(0, complex)], [np.zeros(0, complex)]
    pieces = list_pieces(language, text)
    joints = 0
    for before, after in pairwise([*pieces, None]):
        if before:
            length = _length(before)
            programmed.append(_walk(before, np.linspace(0.0, length, math.ceil(length * 10) + 1)))
        joints += bool(before and after)
        if before and after and before.reach:
            executed += [curve[:: _STEPS // 60] for curve in _round(language, before, after)]
    return Paths(np.concatenate(programmed), np.concatenate(executed), joints)


def list_corners(language: str, text: str) -> list[Corner]:
    """The corners between motions of a text at the height of the part or below."""
    pieces = list_pieces(language, text)
    corners = []
    for before, after in pairwise(pieces):
        if before and after and before.reach:
            mm = max(_leave(before, after, curve) for curve in _round(language, before, after))
            corners.append(Corner(mm, before.line))
    return corners


def list_pieces(language: str, text: str) -> list[Piece | None]:
    """The motions of a text; None for all else."""
    pieces: list[Piece | None] = []
    place, speed = None, 0.0
    lines = re.sub(r",\n\s+\[\[", ", [[", text).splitlines()
    joined = 0
    for number, line in enumerate(lines, 1):
        first = number + joined
        joined += line.count(", [[")
        points = []
        if "move" in line.lower():
            points = [tuple(map(float, point)) for point in _POINT[language].findall(line)]
        motion = _MOTION[language].search(line)
        if language in _SPEED and (word := _SPEED[language].search(line)):
            speed = float(word[1])
        heights = {place and place[2], *(point[2] for point in points)}
        if motion and place and len(heights) == 1 and place[2] <= 0:
            path = tuple(complex(x, y) for x, y, _ in (place, *points))
            pieces.append(Piece(path, _reach(language, line, lines[number], speed), first))
        elif line.strip() and not line.lstrip().startswith(("!", "'", ";", "SPEED")):
            pieces.append(None)
        place = points[-1] if points else place
    return pieces


def _reach(language: str, line: str, following: str, speed: float) -> float:
    if language == "rapid":
        name = _ZONE.findall(line)[-1]
        if name == "fine":
            return 0.0
        return 0.3 if name == "z0" else float(re.sub("z(Cam)?", "", name).replace("_", "."))
    stops = "@0" in line if language == "pacscript" else "BREAK" in following
    return 0.0 if stops else speed**2 / (2 * _ACCELERATION)


def _walk(piece: Piece, lengths: Points) -> Points:
    """Points at lengths, mm, from the start of a motion."""
    start, end = piece.points[0], piece.points[-1]
    if len(piece.points) == 2:
        return start + lengths * (end - start) / abs(end - start)
    centre, angle = _circle(piece)
    turn = math.copysign(1.0, angle) / abs(start - centre)
    return centre + (start - centre) * np.exp(1j * turn * lengths)


def _circle(piece: Piece) -> tuple[complex, float]:
    """The centre of an arc, and its signed sweep, rad."""
    a, b, c = piece.points
    ratio = (c - a) / (b - a)
    centre = (b - a) * (ratio - abs(ratio) ** 2) / (ratio - ratio.conjugate()) + a
    sweep = cmath.phase((c - centre) / (a - centre))
    left = cmath.phase((b - centre) / (a - centre))
    if left > 0:
        return centre, sweep % math.tau if left < sweep % math.tau else sweep % math.tau - math.tau
    return centre, -((-sweep) % math.tau) if -left < (-sweep) % math.tau else (sweep % math.tau)


def _length(piece: Piece) -> float:
    if len(piece.points) == 2:
        return abs(piece.points[1] - piece.points[0])
    centre, sweep = _circle(piece)
    return abs(piece.points[0] - centre) * abs(sweep)


def _round(language: str, before: Piece, after: Piece) -> list[Points]:
    """Curves that the controller may run from the first motion onto the second one."""
    lengths = (_length(before), _length(after))
    t = np.linspace(0.0, 1.0, _STEPS + 1)
    corner = before.points[-1]
    if language != "rapid":
        reaches = [min(before.reach, length / 2) for length in lengths]
        left, run = (1 - t) ** 2 * reaches[0], t**2 * reaches[1]
        return [_walk(before, lengths[0] - left) + _walk(after, run) - corner]
    # The zone is a circle about the corner; it is cut at half of the shorter motion.
    reaches = [min(_arc_of(piece, before.reach), min(lengths) / 2) for piece in (before, after)]
    left, run = (1 - t) ** 2 * reaches[0], t**2 * reaches[1]
    curves = [_walk(before, lengths[0] - left) + _walk(after, run) - corner]
    tiny = 1e-6
    enter = _walk(before, lengths[0] - reaches[0] + np.array([0.0, tiny]))
    leave = _walk(after, reaches[1] - np.array([tiny, 0.0]))
    first, last = enter[1] - enter[0], leave[1] - leave[0]
    cross = (first.conjugate() * last).imag
    if abs(cross) > 1e-9 * abs(first) * abs(last):
        chord = leave[1] - enter[0]
        ahead = (chord.conjugate() * last).imag / cross
        back = (first.conjugate() * chord).imag / cross
        middle = enter[0] + ahead * first
        lengths = abs(ahead * first), abs(back * last)
    # A parabola has its middle control point ahead of its start and back its end.
    if cross and min(ahead, back) > 0 and max(lengths) < 2 * max(reaches):
        curves.append((1 - t) ** 2 * enter[0] + 2 * t * (1 - t) * middle + t**2 * leave[1])
    return curves


def _arc_of(piece: Piece, chord: float) -> float:
    """The length of the part of a motion within a distance of its end, mm."""
    if len(piece.points) == 2:
        return chord
    radius = abs(piece.points[0] - _circle(piece)[0])
    return 2 * radius * math.asin(min(chord / (2 * radius), 1.0))


def _leave(before: Piece, after: Piece, curve: Points) -> float:
    """The larger of both distances: of the curve from the motions, and of their corner from it."""
    grid = np.linspace(0.0, 1.0, 8 * _STEPS + 1)
    span = 2 * max(abs(curve - before.points[-1]))
    ends = _length(before) - grid * min(_length(before), span)
    path = np.concatenate([_walk(before, ends), _walk(after, grid * min(_length(after), span))])
    curve_distance = max(abs(path - point).min() for point in curve[:: _STEPS // 30])
    return max(curve_distance, abs(curve - before.points[-1]).min())
