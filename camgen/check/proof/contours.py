"""Contours that are followed, traced or chamfered: each motion beside them, each of them covered.

A motion is examined at its two ends and half-way. Two lines or arcs that agree at three places are
the same within the tolerance, and a chord leaves its arc most half-way. A contour is examined along
every stretch that no motion runs along.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from msgspec import Struct

from camgen.check.proof.findings import Findings
from camgen.check.proof.matching import (
    Covered,
    Nearest,
    PieceTree,
    Ragged,
    cover,
    find_gaps,
    find_nearest,
    find_whole,
    join_ranges,
    measure_ends,
)
from camgen.check.proof.motions import Motions
from camgen.check.proof.nesting import count_around, crosses_itself
from camgen.check.proof.pieces import (
    BoolArray,
    IntArray,
    Pieces,
    find_shares,
    find_ways_to,
    normals_along,
    points_along,
    rows_of,
)
from camgen.check.proof.tasks import Drawing, Task
from camgen.model.pose import FloatArray

#: Half of the length of a stretch of a motion, mm, of which only the middle is examined.
_CLEAR_STEP_MM = 0.1
#: A stretch of a contour that is shorter, mm, is not examined on its own.
_LEAST_GAP_MM = 0.1
#: A place is within reach if the tool is too near to a wall there by at most this, mm. The path
#: ends where the tool touches both walls, so a place that is blocked by less is beside the path.
_REACH_MM = 1e-4
#: Least room beside the tool, mm, in a place that it can reach.
_ROOM_MM = 5e-3
#: A stretch is a room of its own if it is no longer, mm, and no motion is nearer, mm.
_ROOM_LENGTH_MM, _NEAR_MM = 2.0, 0.5
#: A shorter motion, mm, may lie beside two pieces: its side, direction
#: and exact feed are not examined.
SHORT_MM = 0.5
#: An arc about a corner has the tool's radius within this, mm; the text rounds its points.
_ROLL_MM = 0.05
#: An arc that covers less of a piece, mm, may be one about a corner.
_LEAST_ROLL_MM = 0.3
#: Error of the sagitta of an arc in a text with three digits, mm.
_DIGITS_MM = 4e-3
#: Samples of a gap: step in mm, minimum and maximum number.
_GAP_STEP_MM, _LEAST_SAMPLES, _MOST_SAMPLES = 1.0, 3, 64


class Matched(Struct, frozen=True, eq=False):
    """The motions of a task beside the drawing, W of them.

    rows: (W,) their indices.
    piece: (W,) the piece of the drawing that is nearest half-way.
    distance: (W,) the distance at which a motion should run, mm; the nearest of the task's.
    side: (W,) side of the piece on which it runs half-way: 1 left, -1 right, 0 beside an end.
    follows: (W,) whether it runs at that distance, at both ends and half-way.
    rounds: (W,) whether it may be the rounding of an inner corner, farther from the contour.
    foreign: (W,) whether the piece is not of the contours of its path, whose side is then not its
        own.
    has_tool_radius: (W,) arcs whose radius is `distance`, as far as the text shows it.
    covered: the stretches of the drawing along which motions run.
    place: (N,) the place in `rows` of the motion of each stretch.
    """

    rows: IntArray
    piece: IntArray
    distance: FloatArray
    side: FloatArray
    follows: BoolArray
    rounds: BoolArray
    foreign: BoolArray
    has_tool_radius: BoolArray
    covered: Covered
    place: IntArray


def find_rolling(motions: Motions, matched: Matched) -> BoolArray:
    """(W,) motions that roll about an outer corner: arcs about it, or chords of such an arc."""
    is_line = motions.plane.turn[matched.rows] == 0
    return np.asarray((matched.side == 0) & (matched.has_tool_radius | is_line))


def may_roll(motions: Motions, matched: Matched, pieces: Pieces) -> BoolArray:
    """(W,) arcs that may roll about a corner, as far as the digits of the text show."""
    may = matched.has_tool_radius.copy()
    rows, piece = matched.rows[may], matched.piece[may]
    shares = find_shares(motions.plane.middle[rows], pieces, piece)
    to_end = np.minimum(np.abs(shares), np.abs(1 - shares)) * pieces.length[piece]
    may[may] = to_end <= _ROLL_MM
    return may


def _have_tool_radius(radius: FloatArray, cosine: FloatArray, distance: FloatArray) -> BoolArray:
    """(W,) arcs whose radius is `distance`, as far as the text shows it.

    A radius through three rounded points is the less certain, the flatter the arc.
    cosine: (W,) cosine of half of the angle that an arc sweeps.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.abs(radius - distance) <= _ROLL_MM + _DIGITS_MM / (1 - cosine))


class Workplace:
    """The pieces of the drawing where a task works.

    lists: the pieces at which to look first, for each path.
    """

    def __init__(self, task: Task, drawing: Drawing, lists: Ragged) -> None:
        self.task, self.drawing, self.lists = task, drawing, lists
        self.pieces = drawing.pieces
        #: The pieces of `Task.walls`, by place.
        self.walls = PieceTree(drawing.pieces, np.flatnonzero(task.walls[drawing.pieces.owner]))

    @cached_property
    def near(self) -> Ragged:
        """For each contour the pieces of others that the tool may come near to beside it."""
        task, count = self.task, len(self.drawing.contours)
        kept_clear = task.walls & bool(task.kept_clear.any())
        pairs = task.near[task.worked[task.near[:, 0]] & kept_clear[task.near[:, 1]]]
        first = np.searchsorted(self.pieces.owner, np.arange(count + 1))
        size = first[pairs[:, 1] + 1] - first[pairs[:, 1]]
        piece = join_ranges(first[pairs[:, 1]], size)
        contour = np.repeat(pairs[:, 0], size)
        # The tool's centre runs in the box of its contour, widened by the distance.
        box = self.drawing.boxes[contour] + np.array([-1, -1, 1, 1]) * 2 * max(task.distances)
        other = self.pieces.boxes[piece]
        meet = np.all(other[:, :2] <= box[:, 2:], axis=1)
        meet &= np.all(other[:, 2:] >= box[:, :2], axis=1)
        order = np.argsort(contour[meet], kind="stable")
        counts = np.bincount(contour[meet], minlength=count)
        return Ragged(piece[meet][order], np.cumsum(counts) - counts, counts.astype(np.intp))


class ContourChecker:
    """Examines the motions of one task that run along contours.

    limit: distance, mm, that a motion may have from its place in the drawing.
    """

    def __init__(self, place: Workplace, motions: Motions, limit: float) -> None:
        self.place, self.motions, self.limit = place, motions, limit
        self.task, self.drawing, self.pieces = place.task, place.drawing, place.pieces

    # -- motions beside the drawing

    def match(self, rows: IntArray, findings: Findings) -> Matched:
        """Assigns the motions `rows` to pieces, with a finding for a motion on a wrong side."""
        plane, size = self.motions.plane, len(rows)
        # A motion starts where the one before it ends, if that is in contact too.
        first = np.flatnonzero(np.diff(rows, prepend=-2) != 1)
        middles, ends = rows_of(plane.middle, rows), rows_of(plane.end, rows)
        points = np.concatenate([middles, ends, rows_of(plane.start, rows[first])])
        path = self.motions.path[rows]
        nearest = find_nearest(middles, path, self.pieces, self.place.lists)
        # The ends are beside the same piece, as a rule.
        nearest = measure_ends(points, nearest, first, self.pieces)
        wanted = np.array(self.task.distances)
        deviation = self._deviation(nearest, wanted)
        lost = np.flatnonzero(deviation > self.limit)
        if len(lost):
            paths = np.concatenate([path, path, path[first]])
            again = find_nearest(points[lost], paths[lost], self.pieces, self.place.lists)
            nearest.replace(lost, again)
            is_beside = self._deviation(again, wanted) <= self.limit
            lost = lost[~is_beside & ~self._may_round(again, wanted)]
        if len(lost):
            reach = float(wanted.max()) + self.task.operation.corner_radius + self.limit
            nearest.replace(lost, self.place.walls.find(points[lost], reach))
        # All of a motion runs at one of the distances.
        is_at = np.abs(nearest.distance - wanted[:, None]) <= self.limit
        follows = np.any([_join_ends(row, first, size) for row in is_at], axis=0)
        rounds = _join_ends(self._may_round(nearest, wanted), first, size) & ~follows
        piece, side = nearest.piece[:size], nearest.side[:size]
        distance = wanted[np.abs(nearest.distance[:size, None] - wanted).argmin(axis=1)]
        foreign = np.zeros(size, np.bool_)
        foreign[lost[lost < size]] = True
        foreign &= path >= 0
        along = np.flatnonzero(follows & (piece >= 0) & ((side != 0) | (distance == 0)))
        covered = cover(plane, rows[along], piece[along], self.pieces)
        rolls = _have_tool_radius(plane.radius[rows], plane.cosine[rows], distance)
        matched = Matched(
            rows, piece, distance, side, follows, rounds, foreign, rolls, covered, place=along
        )
        self._check_sides(matched, findings)
        return matched

    def _deviation(self, nearest: Nearest, wanted: FloatArray) -> FloatArray:
        return np.asarray(np.abs(nearest.distance[:, None] - wanted).min(axis=1))

    def _may_round(self, nearest: Nearest, wanted: FloatArray) -> BoolArray:
        """Whether points are beside a rounded inner corner: farther by at most its radius."""
        radius = self.task.operation.corner_radius
        if not radius:
            return np.zeros(len(nearest.distance), np.bool_)
        beyond = nearest.distance[:, None] - wanted
        is_near = (beyond >= -self.limit) & (beyond <= radius + self.limit)
        return np.asarray(is_near.any(axis=1))

    def _check_sides(self, matched: Matched, findings: Findings) -> None:
        """Finds motions on the wrong side of their contour.

        A short one may lie beside two pieces: a path is wrong if most of its length is.
        """
        contour = self.pieces.owner[matched.piece]
        turned = matched.side * self.task.tool_side[contour]
        chosen = np.flatnonzero(matched.follows & ~matched.foreign & (turned != 0))
        rows, contour, wrong = matched.rows[chosen], contour[chosen], turned[chosen] < 0
        short = self.motions.plane.length[rows] < SHORT_MM
        for index in np.flatnonzero(wrong & ~short)[:1].tolist():
            what = "runs on the wrong side of contour"
            self._report(int(rows[index]), int(contour[index]), what, findings)
        for index in self._find_majority(rows, contour, wrong & short):
            what = "and others beside it run on the wrong side of contour"
            self._report(int(rows[index]), int(contour[index]), what, findings)

    def _report(self, row: int, contour: int, what: str, findings: Findings) -> None:
        """Adds a difference; a contour that crosses itself has neither sides nor a direction."""
        name = self.drawing.contours[contour].id
        if crosses_itself(self.pieces, contour):
            findings.leave(f"side and direction of contour {name}", "it crosses itself")
            return
        findings.add(self.motions, row, f"{what} {name}")

    def _find_majority(self, rows: IntArray, contour: IntArray, wrong: BoolArray) -> list[int]:
        """The place of the first motion whose path is wrong for most of its length; or none.

        rows: (N,) motions, each with its `contour` (N,), and whether it is `wrong` (N,).
        """
        if not wrong.any():
            return []
        group = (self.motions.path[rows] + 1) * len(self.drawing.contours) + contour
        _, number = np.unique(group, return_inverse=True)
        length = self.motions.plane.length[rows]
        share = np.bincount(number, length * wrong) / np.maximum(np.bincount(number, length), 1e-9)
        return list(np.flatnonzero(wrong & (share[number] > 0.5))[:1].tolist())

    def check_direction(self, matched: Matched, directed: BoolArray, findings: Findings) -> None:
        """Finds motions against `operation.direction`. Climb: the part is on the right.

        directed: (W,) whether a motion has to run in the direction of its path.
        """
        direction = self.task.operation.direction
        covered = matched.covered
        if direction == "any" or self.task.kind == "trace" or not len(covered.piece):
            return
        contour = self.pieces.owner[covered.piece]
        climbs = covered.forward == (self.task.tool_side[contour] > 0)
        # A motion of no length has no direction.
        judged = (covered.high > covered.low) & directed[matched.place]
        wrong = judged & (climbs != (direction == "climb"))
        # Between two walls a motion climbs along one of them and not along the other.
        wrong[wrong] = ~self.are_between(covered.motion[wrong], covered.piece[wrong])
        short = self._are_ambiguous(matched, covered)
        first = np.flatnonzero(wrong & ~short)[:1].tolist()
        for index in self._find_majority(
            covered.motion[judged], contour[judged], (wrong & short)[judged]
        ):
            first.append(int(np.flatnonzero(judged)[index]))
        for index in first[:1]:
            what = "runs against operation.direction along contour"
            self._report(int(covered.motion[index]), int(contour[index]), what, findings)

    def _are_ambiguous(self, matched: Matched, covered: Covered) -> BoolArray:
        """(N,) stretches so short that their motions may belong to another piece, or to a corner.

        An arc about a corner covers next to nothing of the pieces beside it.
        """
        length = (covered.high - covered.low) * self.pieces.length[covered.piece]
        rolls = matched.has_tool_radius[matched.place] & (length < _LEAST_ROLL_MM)
        return np.asarray(rolls | (self.motions.plane.length[covered.motion] < SHORT_MM))

    def are_between(self, rows: IntArray, piece: IntArray, ends: bool = False) -> BoolArray:
        """(N,) whether motions have walls on both sides, as far apart as the tool is wide.

        rows: (N,) the motions.
        piece: (N,) the piece of the drawing beside each.
        ends: they may have them at one of their ends, and not half-way.
        """
        between = np.zeros(len(rows), np.bool_)
        if not len(rows) or self.task.kind != "follow":
            return between
        plane, distance = self.motions.plane, self.task.distances[-1]
        reach = distance / 2 + self.limit
        places = [plane.middle, plane.start, plane.end] if ends else [plane.middle]
        for place in (column[rows] for column in places):
            arm = -find_ways_to(place, self.pieces, piece)
            length = np.maximum(np.sqrt((arm**2).sum(axis=1)), 1e-9)[:, None]
            beyond = place + distance / 2 * arm / length
            between |= self._distance_to_walls(beyond, self.pieces.owner[piece], reach) <= reach
        return between

    def check_clear(self, matched: Matched, findings: Findings) -> None:
        """Finds motions that come nearer to another contour than the tool may."""
        task = self.task
        lists = self.place.near
        if not len(lists.rows):
            return
        contour = self.pieces.owner[matched.piece]
        rows = np.flatnonzero((matched.follows | matched.rounds) & (lists.count[contour] > 0))
        if not len(rows):
            return
        plane = self.motions.plane
        chosen = matched.rows[rows]
        points = np.concatenate([rows_of(plane.middle, chosen), rows_of(plane.end, chosen)])
        nearest = find_nearest(points, np.tile(contour[rows], 2), self.pieces, lists)
        least = min(task.distances) - self.limit
        at_end = nearest.piece[len(rows) :]
        other = np.where(nearest.distance[len(rows) :] < least, at_end, -1)
        other = np.maximum(other, self._find_too_near(chosen, contour[rows], least))
        for index in np.flatnonzero(other >= 0)[:1].tolist():
            name = self.drawing.contours[int(self.pieces.owner[other[index]])].id
            what = f"comes nearer to contour {name} than the tool's radius"
            findings.add(self.motions, int(matched.rows[rows[index]]), what)
        # Within a part that shares its edges, the tool may keep clear of all of them.
        touches = nearest.distance[: len(rows)] <= max(task.distances) + self.limit
        inner = touches.copy()
        for walls in (task.kept_clear, task.walls):
            inner[inner] = self._count_around(rows_of(plane.middle, chosen[inner]), walls) % 2 == 1
        for index in np.flatnonzero(inner)[:1].tolist():
            name = self.drawing.contours[int(contour[rows[index]])].id
            what = f"runs beside contour {name}, in the part beyond it"
            findings.add(self.motions, int(matched.rows[rows[index]]), what)

    def _find_too_near(self, rows: IntArray, contour: IntArray, least: float) -> IntArray:
        """(N,) a piece of another contour from which each motion is less than `least` mm, or -1.

        Along a motion the distance changes by no more than its length. So a stretch is halved only
        if its middle is not farther than `least` by half of the stretch.

        rows: (N,) the motions.
        contour: (N,) the contour of each.
        """
        plane, lists = self.motions.plane, self.place.near
        others = np.full(len(rows), -1)
        row, low, share = np.arange(len(rows)), np.zeros(len(rows)), 1.0
        while len(row):
            points = points_along(plane, rows[row], low + share / 2)
            nearest = find_nearest(points, contour[row], self.pieces, lists)
            is_near = nearest.distance < least
            others[row[is_near]] = nearest.piece[is_near]
            half = plane.length[rows[row]] * share / 2
            is_open = (nearest.distance < least + half) & ~is_near & (half > _CLEAR_STEP_MM)
            share /= 2
            row = np.tile(row[is_open], 2)
            low = np.concatenate([low[is_open], low[is_open] + share])
        return others

    def _count_around(self, points: FloatArray, chosen: BoolArray) -> IntArray:
        """(N,) number of the contours `chosen` (C,) around points (N, 2)."""
        return count_around(self.pieces, self.drawing.boxes, chosen, points)

    # -- the drawing beside the motions

    def find_uncovered(
        self,
        covered: Covered,
        motions: IntArray,
        distance: float,
        left_out: BoolArray,
        findings: Findings,
    ) -> Covered:
        """Stretches of the contours that could be worked on and are not.

        A short one away from all motions is a room that the tool just fits: it is not proven that
        the tool should go there.

        covered: the stretches at one depth.
        motions: indices of the motions at that depth.
        distance: distance of the tool's centre from the contour, mm.
        left_out: (C,) contours of which notes say that they are left out, as a whole or in part.
        """
        slack = np.minimum(_LEAST_GAP_MM / np.maximum(self.pieces.length, 1e-9), 1.0)
        wanted = self.task.worked[self.pieces.owner] & ~find_whole(covered, slack)
        gaps = find_gaps(covered.take(wanted[covered.piece]), np.flatnonzero(wanted), slack)
        if not len(gaps.piece):
            return gaps
        reachable, isolated = self._is_reachable(gaps, motions, distance)
        doubtful = isolated & ~left_out[self.pieces.owner[gaps.piece]]
        for index in np.flatnonzero(doubtful)[:1].tolist():
            piece, share = gaps.piece[index : index + 1], gaps.low[index : index + 1]
            x, y = points_along(self.pieces, piece, share)[0].tolist()
            name = self.drawing.contours[int(self.pieces.owner[piece[0]])].id
            why = f"near {x:.3f} {y:.3f} mm it just fits, and no motion is near"
            findings.leave(f"that contour {name} is worked wherever the tool fits", why)
        return gaps.take(reachable & ~isolated)

    def _is_reachable(
        self, gaps: Covered, rows: IntArray, distance: float
    ) -> tuple[BoolArray, BoolArray]:
        """(G,) whether the tool's centre could run beside a stretch, and no motion does.

        The second mask has the short stretches without a motion near.
        """
        size = (gaps.high - gaps.low) * self.pieces.length[gaps.piece]
        count = np.clip(np.ceil(size / _GAP_STEP_MM), _LEAST_SAMPLES, _MOST_SAMPLES).astype(np.intp)
        gap = np.repeat(np.arange(len(count)), count)
        place = join_ranges(np.zeros(len(count), np.intp), count) + 0.5
        share = gaps.low[gap] + (gaps.high - gaps.low)[gap] * place / count[gap]
        piece = gaps.piece[gap]
        contour = self.pieces.owner[piece]
        points = points_along(self.pieces, piece, share)
        normal = normals_along(self.pieces, piece, share) * self.task.tool_side[contour][:, None]
        centre = points + distance * normal
        open_ = np.ones(len(points), np.bool_)
        if distance:
            # With rounded inner corners the path is where a larger circle still fits.
            room = distance + self.task.operation.corner_radius + _ROOM_MM
            wall_distance = self._distance_to_walls(points + room * normal, contour, room)
            open_ = wall_distance >= room - _REACH_MM
            if self.task.kind == "follow" and not self.task.operation.corner_radius:
                slot = self._fits_exactly(centre, normal, contour, distance) & ~open_
                long = np.bincount(gap[slot], minlength=len(count)) * size / count > distance
                open_ |= slot & long[gap]
        chosen = np.flatnonzero(open_)
        if len(chosen) and self.task.kept_clear.any():
            # Beyond an edge that two parts have in common there is room, but in the other part.
            open_[chosen] = self._count_around(centre[chosen], self.task.walls) % 2 == 0
            chosen = np.flatnonzero(open_)
        if len(chosen):
            plane = self.motions.plane
            near = np.full(len(points), np.inf)
            farthest = max(_NEAR_MM, self.limit)
            near[chosen] = PieceTree(plane, rows).find(centre[chosen], farthest).distance
            open_[near <= self.limit] = False
        samples = np.bincount(gap[open_], minlength=len(count))
        alone = np.ones(len(count), np.bool_)
        if len(chosen):
            alone[gap[open_ & np.isfinite(near)]] = False
        short = samples * size / count <= _ROOM_LENGTH_MM
        return samples > 0, (samples > 0) & alone & short

    def _fits_exactly(
        self, centre: FloatArray, normal: FloatArray, contour: IntArray, distance: float
    ) -> BoolArray:
        """(N,) whether a tool at `centre` (N, 2) touches one wall and has another on its far side.

        normal: (N, 2) from the wall to the centre.
        """
        clear = self._distance_to_walls(centre, contour, distance) >= distance - _REACH_MM
        beyond = self._distance_to_walls(centre + distance / 2 * normal, contour, distance)
        return np.asarray(clear & (beyond <= distance / 2 + _REACH_MM))

    def _distance_to_walls(self, points: FloatArray, contour: IntArray, reach: float) -> FloatArray:
        """(N,) distance of points from what the tool keeps clear of, up to `reach` mm."""
        if self.task.kept_clear.any():
            return self.place.walls.find(points, reach).distance
        first = np.searchsorted(self.pieces.owner, np.arange(len(self.drawing.contours) + 1))
        lists = Ragged(np.arange(len(self.pieces)), first[:-1], np.diff(first))
        return find_nearest(points, contour, self.pieces, lists).distance


def _join_ends(right: BoolArray, first: IntArray, size: int) -> BoolArray:
    """(W,) whether motions are right half-way, at their end and at their start.

    right: (2 W + F,) for the middles, the ends, and the starts of the motions `first` (F,). The
        others start where the motion before them ends.
    """
    middle, end = right[:size], right[size : 2 * size]
    start = np.append(True, end[:-1])
    start[first] = right[2 * size :]
    return np.asarray(middle & end & start)
