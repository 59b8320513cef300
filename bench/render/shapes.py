"""Outlines made of lines and arcs, for the renderer and its truth, without camgen's geometry.

A point of the plane is a complex number x + i y, mm. A piece runs from `start` over `chord` with a
bulge, tan of a quarter of the angle that it turns by, positive counter-clockwise. Material is on
the left of every loop: outer loops run counter-clockwise, holes clockwise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np


@dataclass(frozen=True, eq=False)
class Loop:
    """A closed loop.

    points: (N,) complex, mm.
    bulges: (N,), bulge of the piece that leaves each point.
    """

    points: np.ndarray
    bulges: np.ndarray

    def moved(self, turn: float, shift: complex) -> Loop:
        """Turned about the origin by ``turn`` rad, then shifted."""
        return Loop(self.points * np.exp(1j * turn) + shift, self.bulges)


@dataclass(frozen=True, eq=False)
class Pieces:
    """Lines and arcs.

    start, chord: (P,) complex, mm.
    sweep: (P,) angle that each turns by, rad, 0 for a line.
    """

    start: np.ndarray
    chord: np.ndarray
    sweep: np.ndarray

    @property
    def length(self) -> np.ndarray:
        """(P,) mm."""
        half = self.sweep / 2
        return np.abs(self.chord) / np.sinc(half / np.pi)

    def at(self, which: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places at ``t`` (0 to 1) of pieces ``which``, and their derivative by t."""
        start, chord, sweep = self.start[which], self.chord[which], self.sweep[which]
        straight = sweep == 0
        whole = np.where(straight, 1, np.expm1(1j * sweep))
        along = np.where(straight, t, np.expm1(1j * sweep * t) / whole)
        rate = np.where(straight, 1, 1j * sweep * np.exp(1j * sweep * t) / whole)
        return start + chord * along, chord * rate

    def walk(self, counts: np.ndarray) -> np.ndarray:
        """Points along the pieces, (N,) complex.

        counts: (P,) number of points of each piece, from its start on.
        """
        which = np.repeat(np.arange(len(counts)), counts)
        number = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
        return self.at(which, number / counts[which])[0]

    def walk_evenly(self, step: float) -> np.ndarray:
        """Points along the pieces, (N,) complex, at most `step` mm apart."""
        return self.walk(np.ceil(self.length / step).astype(int).clip(1))

    def distance(self, places: np.ndarray) -> np.ndarray:
        """Distance of each of the places (N,) from the nearest point of all pieces, mm."""
        least = np.full(len(places), np.inf)
        for start, chord, sweep in zip(self.start, self.chord, self.sweep, strict=True):
            least = np.minimum(least, _distance(places, start, chord, sweep))
        return least


def _distance(places: np.ndarray, start: complex, chord: complex, sweep: float) -> np.ndarray:
    if sweep == 0:
        along = ((places - start) / chord).real.clip(0, 1)
        return np.abs(places - start - along * chord)
    centre = start - chord / np.expm1(1j * sweep)
    # The foot of a place lies on the arc if the angle from its middle is small enough.
    middle = (start - centre) * np.exp(0.5j * sweep)
    is_beside = np.abs(np.angle((places - centre) / middle)) <= abs(sweep) / 2
    ends = np.minimum(np.abs(places - start), np.abs(places - start - chord))
    return np.where(is_beside, np.abs(np.abs(places - centre) - abs(middle)), ends)


def pieces(loops: Sequence[Loop]) -> Pieces:
    """All pieces of the loops, in order."""
    start = np.concatenate([loop.points for loop in loops])
    chord = np.concatenate([np.roll(loop.points, -1) - loop.points for loop in loops])
    return Pieces(start, chord, 4 * np.arctan(np.concatenate([loop.bulges for loop in loops])))


class Contour(Protocol):
    """A closed contour.

    points: (N, 2) mm.
    bulges: (N,), of the piece that leaves each point.
    """

    points: np.ndarray
    bulges: np.ndarray


def to_loops(contours: Iterable[Contour], shift: complex = 0j) -> tuple[Loop, ...]:
    """Contours that were read, as loops, moved back by `shift`, mm."""
    loops = []
    for contour in contours:
        loops.append(Loop(contour.points @ np.array([1, 1j]) - shift, np.asarray(contour.bulges)))
    return tuple(loops)


def find_turns(loops: Sequence[Loop]) -> tuple[np.ndarray, np.ndarray]:
    """The turns of loops where a piece ends and the next one starts.

    Returned are, for each start, the unit direction before it, (N,) complex, and the turn there,
    (N,) rad, positive counter-clockwise.
    """
    directions, turns = [], []
    for loop in loops:
        whole, numbers = pieces([loop]), np.arange(len(loop.points))
        _, after = whole.at(numbers, np.zeros(len(numbers)))
        _, before = whole.at(np.roll(numbers, 1), np.ones(len(numbers)))
        directions.append(before / np.abs(before))
        turns.append(np.angle(after / before))
    return np.concatenate(directions), np.concatenate(turns)


def find_corners(loops: Sequence[Loop], least: float) -> np.ndarray:
    """Places (N,) where two pieces meet with a turn of more than `least` rad, mm."""
    return pieces(loops).start[np.abs(find_turns(loops)[1]) > least]


def are_away(places: np.ndarray, corners: np.ndarray, room: float) -> np.ndarray:
    """Which of the places (N,) are farther than `room` mm from all corners (M,)."""
    are_far = np.ones(len(places), bool)
    for corner in corners:
        are_far &= np.abs(places - corner) > room
    return are_far


def flatten(loop: Loop, count: Callable[[Pieces], np.ndarray]) -> np.ndarray:
    """Points along a loop, (N, 2) mm.

    count: gives the number of points of each piece, (P,); they are even, from its start on.
    """
    whole = pieces([loop])
    points = whole.walk(np.asarray(count(whole)).astype(int))
    return np.column_stack([points.real, points.imag])


def flatten_arcs(loop: Loop, step: float, fewest: int) -> np.ndarray:
    """Points along a loop, (N, 2) mm: lines as they are, arcs as chords of at most `step` mm.

    fewest: number of chords of a short arc.
    """

    def count(whole: Pieces) -> np.ndarray:
        return np.where(whole.sweep == 0, 1, np.maximum(np.ceil(whole.length / step), fewest))

    return flatten(loop, count)


def rounded(corners: Sequence[tuple[float, float, float]]) -> Loop:
    """A polygon with corners (x, y, radius) in mm, radius 0: sharp."""
    at = np.array([complex(x, y) for x, y, _ in corners])
    points, bulges = [], []
    for k, (_, _, radius) in enumerate(corners):
        into, out = at[k] - at[k - 1], at[(k + 1) % len(at)] - at[k]
        turn = float(np.angle(out / into))
        if radius == 0:
            points.append(at[k])
            bulges.append(0.0)
            continue
        reach = radius * np.tan(abs(turn) / 2)
        points += [at[k] - reach * into / abs(into), at[k] + reach * out / abs(out)]
        bulges += [float(np.tan(turn / 4)), 0.0]
    place = np.array(points)
    # Two arcs may leave nothing of the side between them.
    kept = np.abs(np.roll(place, -1) - place) > 1e-9
    return Loop(place[kept], np.array(bulges)[kept])


def circle(x: float, y: float, radius: float) -> Loop:
    """A round outer loop, two half circles."""
    return Loop(np.array([complex(x + radius, y), complex(x - radius, y)]), np.ones(2))


def slot(x: float, y: float, length: float, width: float, angle: float) -> Loop:
    """Two straight sides and two half circles as an outer loop.

    length: mm, with both half circles.
    angle: direction of the sides, deg.
    """
    half, radius = (length - width) / 2, width / 2
    ends = np.array([-half, half, half, -half]) + 1j * radius * np.array([-1, -1, 1, 1])
    return Loop(ends, np.array([0.0, 1.0, 0.0, 1.0])).moved(np.radians(angle), complex(x, y))


def box(x0: float, y0: float, x1: float, y1: float) -> Loop:
    """A rectangle, counter-clockwise."""
    return rounded([(x0, y0, 0), (x1, y0, 0), (x1, y1, 0), (x0, y1, 0)])


def hole(loop: Loop) -> Loop:
    """The loop in the other direction."""
    return Loop(loop.points[::-1], -np.roll(loop.bulges[::-1], -1))


def area(loops: Sequence[Loop]) -> float:
    """Enclosed area, mm2: the polygon, and the segments between chords and arcs."""
    total = 0.0
    for loop in loops:
        ends = np.roll(loop.points, -1)
        sweep = 4 * np.arctan(loop.bulges)
        half = np.abs(ends - loop.points) / 2
        radius = half / np.where(sweep == 0, 1, np.sin(np.abs(sweep) / 2))
        total += float((loop.points.conj() * ends).imag.sum() / 2)
        segments = radius**2 * (np.abs(sweep) - np.sin(np.abs(sweep))) / 2
        total += float((np.sign(sweep) * segments).sum())
    return total
