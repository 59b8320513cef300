"""Leads onto a contour and off it, and the overlap beyond the seam (docs/follow.md)."""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.check.proof.contours import ContourChecker, Matched
from camgen.check.proof.findings import Findings
from camgen.check.proof.matching import PieceTree
from camgen.check.proof.pieces import (
    BoolArray,
    IntArray,
    dot,
    find_feet,
    find_shares,
    find_ways_to,
    normals_along,
    points_along,
)
from camgen.check.proof.tasks import BESIDE
from camgen.check.proof.visits import Laps, followed_part
from camgen.model.pose import FloatArray

#: A lead, or a link at working height, may be nearer to a contour than a path, mm: it is planned
#: with this slack (docs/follow.md).
_CLEAR_SLACK_MM = 0.006
#: A lead and its path run in one direction if the cosine between them is at least this: the text
#: may have short chords in place of a small arc.
_TANGENT = 0.8
#: Places along a lead that are examined.
_LEAD_SHARES = np.linspace(0.1, 0.9, 5)
#: Angle, rad, by which the digits of a text may turn a lead, and a short motion beside it at most.
_TURN, _MOST_TURN = 0.02, 0.35
#: Angles of a quarter circle that are examined, rad, and the room that the tool needs there, mm.
_LEAD_ANGLES = np.linspace(0.4, math.pi / 2, 12)
_CLEAR_ROOM_MM = 0.02
#: A motion that rises or falls by less, mm, has one height in a text with three digits.
_FLAT_MM = 5e-4
#: A feed may differ by this share: a text gives it with a few digits.
_FEED_SHARE = 1e-3
#: Deviation of the length of a lead and of an overlap: mm, and a share.
_LENGTH_MM, _LENGTH_SHARE = 0.05, 0.02


class _End(Struct, frozen=True, eq=False):
    """The first or the last end of each of L laps, with its lead.

    name: setting of the job.
    wanted: length of the lead, mm.
    sense: 1 for a lead-out, -1 for a lead-in.
    row: (L,) the motion along the contour next to the lead.
    joint: (L, 2) where lead and contour meet.
    free: (L, 2) the other end of the lead.
    length: (L,) length of the lead, mm.
    count: (L,) number of its motions.
    """

    name: str
    wanted: float
    sense: int
    row: IntArray
    joint: FloatArray
    free: FloatArray
    length: FloatArray
    count: IntArray


class LeadChecker:
    """Examines the motions of one task before and after those along its contours."""

    def __init__(self, checker: ContourChecker, matched: Matched) -> None:
        self.checker, self.matched = checker, matched
        self.task, self.motions = checker.task, checker.motions

    def find(self, chain: IntArray, level: BoolArray) -> BoolArray:
        """(W,) motions that lead to a contour or from it, or link two, and keep clear of all.

        chain: (W,) number of the run of motions to which each belongs.
        level: (W,) whether a motion runs at the depth of a pass, and not on a slope.
        """
        matched, task, plane = self.matched, self.task, self.motions.plane
        operation, process = task.operation, task.job.process
        free = ~matched.follows
        if not free.any():
            return free
        begins, ends = _stretch_of(chain, matched.follows & level)
        place = np.arange(len(chain))
        before, after = free & (place < begins[chain]), free & (place > ends[chain])
        allowed = np.zeros(len(chain), np.bool_)
        level = level & self._are_flat()
        # A path may begin and end on a rounded inner corner.
        length = np.where(level & ~matched.rounds, plane.length[matched.rows], 0.0)
        count = int(chain.max(initial=-1)) + 1
        lead_in, lead_out = operation.lead_in, operation.lead_out
        if task.kind not in BESIDE:
            lead_in = lead_out = 0.0
        # A ramp onto a short contour goes back and forth, along the lead-out too.
        ramps = before & ~level & (lead_out > 0)
        for candidates, wanted in ((before, lead_in), (after, lead_out)):
            total = np.bincount(chain[candidates], length[candidates], count)
            leads = (candidates & (wanted > 0)) | (ramps & candidates)
            allowed |= leads & (total[chain] <= wanted + self.checker.limit)
        if process.stay_down:
            # A link is straight. The leads beside it are arcs.
            is_arc = plane.turn[matched.rows] != 0
            gap = np.cumsum(matched.follows | (np.diff(chain, prepend=-1) != 0))
            total = np.bincount(gap, length * (free & is_arc))
            allowed |= free & (~is_arc | (total[gap] <= lead_in + lead_out + self.checker.limit))
        chosen = np.flatnonzero(allowed)
        if len(chosen) and task.kind in BESIDE:
            rows = np.tile(matched.rows[chosen], len(_LEAD_SHARES))
            points = points_along(plane, rows, np.repeat(_LEAD_SHARES, len(chosen)))
            distance = self.checker.place.walls.find(points, max(task.distances)).distance
            least = min(task.distances) - _CLEAR_SLACK_MM - self.checker.limit
            near = (distance.reshape(len(_LEAD_SHARES), -1) < least).any(axis=0)
            allowed[chosen[near]] = False
        kinked = self._are_kinked(matched.rows) & (not process.stay_down)
        # A lead runs into the path without a corner, and out of it too.
        allowed[:-1] &= ~(before & level)[:-1] | matched.follows[:-1] | ~kinked
        allowed[1:] &= ~(after & level)[1:] | matched.follows[1:] | ~kinked
        return allowed

    def _are_flat(self) -> BoolArray:
        """(W,) motions at one height. The last chords of a ramp are slopes, however flat."""
        rows = self.matched.rows
        rise = self.motions.end[rows, 2] - self.motions.start[rows, 2]
        return np.asarray(np.abs(rise) < _FLAT_MM)

    def _are_kinked(self, rows: IntArray) -> BoolArray:
        """(W - 1,) whether two motions that follow each other meet at a corner."""
        plane = self.motions.plane
        if len(rows) < 2:
            return np.zeros(0, np.bool_)
        ahead = normals_along(plane, rows[:-1], np.ones(len(rows) - 1))
        after = normals_along(plane, rows[1:], np.zeros(len(rows) - 1))
        return np.asarray(dot(ahead, after) < _TANGENT)

    # -- length and shape

    def check(self, laps: Laps, shorter: BoolArray, findings: Findings) -> None:
        """Finds leads of another length or shape than the job asks for.

        shorter: (L,) laps whose leads may be shorter: a note is about them.
        """
        operation = self.task.operation
        if not len(laps.first) or self.task.kind not in BESIDE:
            return
        if self.task.job.process.stay_down:
            if operation.lead_in or operation.lead_out:
                what, why = "length and shape of leads", "links at working height run into them"
                findings.leave(what, why)
            return
        ends = [self._find_end(laps, name, shorter) for name in ("lead_in", "lead_out")]
        swapped = ~laps.closed & (operation.passes > 1)
        is_rounded = self._are_rounded(laps)
        for end, other in zip(ends, reversed(ends), strict=True):
            is_wrong = self._length_error(end, end.wanted, shorter)
            # The passes of an open path may run in alternating directions.
            is_wrong &= ~swapped | self._length_error(end, other.wanted, shorter)
            claimed = shorter & (end.length < end.wanted - _LENGTH_MM)
            if claimed.any():
                claimed &= self._have_room(laps)
            is_bent = (end.count > 0) & ~self._has_shape(end, laps)
            length = end.length[np.argmax(is_wrong & ~is_rounded)]
            what = f"has a {end.name} of {length:.3f} mm beside it"
            for wrong, text in (
                (is_wrong, f"{what}, the job asks for {end.wanted:.3f} mm"),
                (claimed, f"has no full {end.name} beside it, although there is room for it"),
                (is_bent, f"has a {end.name} beside it that differs from a quarter circle"),
            ):
                self._report(wrong, is_rounded, end.row, text, findings)

    def _are_rounded(self, laps: Laps) -> BoolArray:
        """(L,) laps that begin or end on a rounded corner, whose arc may look like a lead."""
        place, lap = np.arange(len(laps.lap)), laps.lap
        beyond = (place < laps.first[lap]) | (place > laps.last[lap])
        chosen = lap[(lap >= 0) & beyond & self.matched.rounds]
        return np.bincount(chosen, minlength=len(laps.first)) > 0

    def _report(
        self, wrong: BoolArray, rounded: BoolArray, row: IntArray, what: str, findings: Findings
    ) -> None:
        """Adds a difference of the first of the laps `wrong` (L,) that is not `rounded` (L,).

        Rounded ones are named as not proven.

        row: (L,) the motion of each lap that it is about.
        """
        for lap in np.flatnonzero(wrong & ~rounded)[:1].tolist():
            findings.add(self.motions, int(row[lap]), what)
        if (wrong & rounded).any():
            findings.leave("leads and overlaps", "some begin on rounded inner corners")

    def _find_end(self, laps: Laps, name: str, shorter: BoolArray) -> _End:
        """The leads of one end; what may round an inner corner counts as lead where it fits."""
        free = ~self.matched.follows & self._are_flat()
        end = self._measure_end(laps, name, free & ~self.matched.rounds)
        if not self.matched.rounds.any():
            return end
        other = self._measure_end(laps, name, free)
        better = self._is_wrong(end, laps, shorter) & ~self._is_wrong(other, laps, shorter)
        return replace(
            end,
            free=np.where(better[:, None], other.free, end.free),
            length=np.where(better, other.length, end.length),
            count=np.where(better, other.count, end.count),
        )

    def _is_wrong(self, end: _End, laps: Laps, shorter: BoolArray) -> BoolArray:
        """(L,) leads of another length or shape than the job asks for."""
        is_bent = (end.count > 0) & ~self._has_shape(end, laps)
        return np.asarray(self._length_error(end, end.wanted, shorter) | is_bent)

    def _measure_end(self, laps: Laps, name: str, leads: BoolArray) -> _End:
        """leads: (W,) motions that may lead to a contour."""
        rows, lap = self.matched.rows, laps.lap
        place = np.arange(len(rows))
        is_in = name == "lead_in"
        edge = laps.first if is_in else laps.last
        beyond = place < edge[lap] if is_in else place > edge[lap]
        chosen = np.flatnonzero((lap >= 0) & beyond & leads)
        count = np.bincount(lap[chosen], minlength=len(edge))
        length = np.bincount(lap[chosen], self.motions.plane.length[rows[chosen]], len(edge))
        row = rows[edge]
        far = edge.copy()
        (np.minimum if is_in else np.maximum).at(far, lap[chosen], chosen)
        joint = self.motions.start[row] if is_in else self.motions.end[row]
        free = self.motions.start[rows[far]] if is_in else self.motions.end[rows[far]]
        return _End(
            name=name,
            wanted=float(getattr(self.task.operation, name)),
            sense=-1 if is_in else 1,
            row=row,
            joint=joint[:, :2],
            free=free[:, :2],
            length=np.asarray(length, np.float64),
            count=count,
        )

    def _length_error(self, end: _End, wanted: float, shorter: BoolArray) -> BoolArray:
        limit = self.checker.limit
        least = _LENGTH_MM + _LENGTH_SHARE * wanted + limit
        slack = least + (end.count > 1) * followed_part(wanted, limit)
        short = end.length < wanted - slack
        return np.asarray((end.length > wanted + slack) | (short & ~shorter))

    def _frames(self, end: _End, laps: Laps) -> tuple[FloatArray, FloatArray]:
        """(L, 2) unit vectors where leads meet the contour: along the path, and off the contour."""
        plane, pieces = self.motions.plane, self.checker.pieces
        piece = self.matched.piece[laps.first if end.sense < 0 else laps.last]
        at = np.full(len(piece), 0.0 if end.sense < 0 else 1.0)
        left = normals_along(plane, end.row, at)
        from_contour = -find_ways_to(plane.middle[end.row], pieces, piece)
        left_there = normals_along(plane, end.row, np.full(len(piece), 0.5))
        outward = left * np.sign(dot(left_there, from_contour))[:, None]
        return np.column_stack([left[:, 1], -left[:, 0]]), outward

    def _have_room(self, laps: Laps) -> BoolArray:
        """(L,) whether both leads of full length, quarter circles, would keep clear of the part."""
        radius = self.task.job.tool.radius
        ring = laps.closed | (self.task.operation.overlap > 0)
        clear = ring & self.checker.drawing.closed[laps.contour]
        nothing = np.zeros(len(laps.first), np.bool_)
        pieces = self.checker.pieces
        everything = PieceTree(pieces, np.arange(len(pieces)))
        for name in ("lead_in", "lead_out"):
            end = self._find_end(laps, name, nothing)
            along, outward = self._frames(end, laps)
            size = end.wanted / (math.pi / 2)
            for angle in _LEAD_ANGLES.tolist() if size else ():
                across = size * (1 - math.cos(angle)) * outward
                points = end.joint + across + end.sense * size * math.sin(angle) * along
                clear &= everything.find(points, 2 * radius).distance > radius + _CLEAR_ROOM_MM
        return np.asarray(clear)

    def _has_shape(self, end: _End, laps: Laps) -> BoolArray:
        """(L,) whether leads end where a quarter circle does, or a line for a path that is open."""
        plane, limit = self.motions.plane, self.checker.limit
        along, outward = self._frames(end, laps)
        radius = end.length / (math.pi / 2)
        quarter = end.joint + radius[:, None] * (end.sense * along + outward)
        line = end.joint + end.length[:, None] * (end.sense * along)
        # A chord that leaves its arc by s turns away from it by 4 s / length.
        turn = _TURN + np.minimum(4 * limit / np.maximum(plane.length[end.row], 1e-9), _MOST_TURN)
        slack = 3 * limit + 2 * radius * turn
        is_quarter = _distance(end.free, quarter) <= slack
        is_line = _distance(end.free, line) <= slack
        ring = laps.closed & self.checker.drawing.closed[laps.contour]
        return np.asarray(is_quarter | (is_line & ~ring))

    def _chorded_part(self, laps: Laps) -> FloatArray:
        """(L,) length of leads made of chords, mm, that may count as motions along the contour."""
        nothing = np.zeros(len(laps.first), np.bool_)
        part = np.zeros(len(laps.first))
        for name in ("lead_in", "lead_out"):
            end = self._find_end(laps, name, nothing)
            part += (end.count > 1) * followed_part(end.wanted, self.checker.limit)
        return part

    def check_feeds(self, laps: Laps, speed_slack: float, findings: Findings) -> None:
        """Finds leads at another feed than that of the contour beside them, or the job's if lower.

        speed_slack: rounding of a speed, mm/s.
        """
        rows, lap = self.matched.rows, laps.lap
        feed, speed = self.task.job.process.feed, self.motions.speed
        place = np.arange(len(rows))
        leads = (lap >= 0) & ~self.matched.follows & ~self.matched.rounds & self._are_flat()
        if not len(laps.first) or self.task.job.process.stay_down:
            return
        before, after = leads & (place < laps.first[lap]), leads & (place > laps.last[lap])
        for chosen, edge in ((before, laps.first), (after, laps.last)):
            wanted = np.minimum(speed[rows[edge[lap]]], feed)
            is_wrong = chosen & (np.abs(speed[rows] - wanted) > speed_slack + _FEED_SHARE * feed)
            for index in np.flatnonzero(is_wrong)[:1].tolist():
                what = f"has a feed of {speed[rows[index]]:.4g} mm/s on a lead"
                what += f", the job asks for {wanted[index]:.4g}"
                findings.add(self.motions, int(rows[index]), what)

    # -- overlap

    def check_overlap(self, laps: Laps, levels: IntArray, findings: Findings) -> None:
        """Finds laps that end beyond the seam by another length than the job asks for."""
        overlap = self.task.operation.overlap
        matched, plane = self.matched, self.motions.plane
        if not overlap or not len(laps.first):
            return
        rows, lap = matched.rows, laps.lap
        place = np.arange(len(rows))
        along = np.append(0.0, np.cumsum(plane.length[rows]))
        inner = (lap >= 0) & (place > laps.first[lap]) & (place <= laps.last[lap])
        chosen = np.flatnonzero(inner & matched.follows & (levels >= 0))
        seam = self.motions.start[rows[laps.first[lap[chosen]]], :2]
        chosen_rows = rows[chosen]
        at_seam = find_feet(seam, plane, chosen_rows).distance <= self.checker.limit
        share = np.clip(find_shares(seam, plane, chosen_rows), 0.0, 1.0)
        passed = along[chosen] + share * plane.length[chosen_rows]
        beyond = along[laps.last[lap[chosen]] + 1] - passed
        wanted = np.minimum(overlap, passed - along[laps.first[lap[chosen]]])
        least = _LENGTH_MM + _LENGTH_SHARE * overlap + 2 * self.checker.limit
        slack = least + self._chorded_part(laps)[lap[chosen]]
        right = at_seam & (np.abs(beyond - wanted) <= slack)
        meets = np.bincount(lap[chosen[at_seam]], minlength=len(laps.first)) > 0
        fits = np.bincount(lap[chosen[right]], minlength=len(laps.first)) > 0
        what = f"does not end {overlap:g} mm beyond the seam, as operation.overlap asks for"
        is_rounded = self._are_rounded(laps)
        self._report(meets & ~fits, is_rounded, rows[laps.last], what, findings)


def _distance(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(dot(a - b, a - b)))


def _stretch_of(chain: IntArray, chosen: BoolArray) -> tuple[IntArray, IntArray]:
    """Per chain the places of its first and its last motion in the mask `chosen` (W,)."""
    count = int(chain.max(initial=-1)) + 1
    first, last = np.full(count, len(chain)), np.full(count, -1)
    place = np.flatnonzero(chosen)
    np.minimum.at(first, chain[place], place)
    np.maximum.at(last, chain[place], place)
    return first, last
