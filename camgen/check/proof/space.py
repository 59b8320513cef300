"""Edges of 3-D parts and curves in space: the TCP runs along them at the distance of the job.

An edge or a curve becomes a dense chain of points. So does each motion of its path. Both are
compared by the distance of the points of one from the chain of the other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain as join

import numpy as np

from camgen.check.proof.findings import Findings, MotionProof
from camgen.check.proof.hints import Named, Program
from camgen.check.proof.motions import Motions, Rounding, tabulate
from camgen.check.proof.outputs import check_joint_motions, is_switched_in_air, process_signal
from camgen.check.proof.pieces import BoolArray, IntArray
from camgen.model.job import Job
from camgen.model.part import Line, Part
from camgen.model.pose import FloatArray
from camgen.model.program import Origin

#: Points along a line, and at least along an arc.
_LINE_POINTS = 9
#: Distance, mm, by which the chords between points along an arc leave it at most, unless that takes
#: more than `_MOST_POINTS`: on a whole circle with a radius above 400 mm.
_CHORD_MM = 0.0005
#: A stretch of an edge that is shorter, mm, may be left out at its ends.
_END_SLACK_MM = 0.05
#: Points along an edge are not farther apart, mm, but `_MOST_POINTS` are added at most.
_FINE_MM, _MOST_POINTS = 0.25, 2000


def prove_space(
    part: Part, job: Job, program: Program, named: Named, rounding: Rounding
) -> MotionProof:
    """The proof of `prove_motion` for edges and curves, without the motions that are not placed.

    named: ids in notes.
    """
    if job.operation.depth:
        reason = "curves in space with a depth are not examined"
        return MotionProof(0, 0.0, 0, (), (reason,))
    findings = Findings()
    signal = process_signal(job.process)
    motions = tabulate(program.body, program.lines, program.path, signal)
    distance = 0.0 if part.curves else job.operation.offset
    limit = rounding.slack + job.tolerance.chord + job.tolerance.arc_fit
    lines = select_lines(part, job, program.origins, findings)
    checker = SpaceChecker(job, motions, distance, limit, named.gaps)
    done = checker.check(lines, program.origins, findings)
    for line in lines:
        if line.id not in done and line.id not in named.skipped:
            findings.miss(f"{line.id} is not worked, and no note says so")
            break
    unknown = np.isnan(motions.start[:, 0]) | np.isnan(motions.end[:, 0])
    check_joint_motions(job, motions, unknown, findings)
    return MotionProof(
        contours=len(done),
        length=float(sum(done.values())),
        motions=int((~unknown).sum()),
        findings=tuple((program.file, item) for item in findings.items),
        unproven=tuple(findings.unproven),
    )


def select_lines(part: Part, job: Job, origins: Sequence[Origin], findings: Findings) -> list[Line]:
    """The curves of `part`, or the edges that `input.select` names.

    origins: contours of each path. If the setting has more than ids in it, the edges that have a
        path are examined, and it is not proven that these are all.
    """
    if part.solid is None or part.curves:
        return list(part.curves)
    edges = part.solid.edges
    select = job.input.select.strip()
    if select == "all":
        return list(edges)
    names = {name.strip() for name in select.split(",")}
    listed = [edge for edge in edges if edge.id in names]
    if len(listed) == len(names):
        return list(listed)
    if select != "convex":
        findings.leave("that no edge is missing", f'input.select = "{select}" is not read again')
        worked = set(join.from_iterable(origin.contours for origin in origins))
        return [edge for edge in edges if edge.id in worked]
    return [edge for edge in edges if edge.convex]


class SpaceChecker:
    """Examines the motions along edges or curves.

    distance: distance of the TCP from the edge, mm.
    limit: distance, mm, that a motion may have from its place.
    gaps: length, mm, that notes leave out of an edge, by its id.
    """

    def __init__(
        self,
        job: Job,
        motions: Motions,
        distance: float,
        limit: float,
        gaps: Mapping[str, float],
    ) -> None:
        self.job, self.motions = job, motions
        self.distance, self.limit, self.gaps = distance, limit, gaps
        self.follows = np.zeros(len(motions), np.bool_)

    def check(
        self, lines: Sequence[Line], origins: Sequence[Origin], findings: Findings
    ) -> dict[str, float]:
        """Checks all edges or curves.

        Returns the worked length of those that are worked, mm, by their ids.
        """
        paths: dict[str, list[int]] = {}
        for index, origin in enumerate(origins):
            for name in origin.contours:
                paths.setdefault(name, []).append(index)
        done: dict[str, float] = {}
        for line in lines:
            rows = np.flatnonzero(np.isin(self.motions.path, paths.get(line.id, [])))
            if len(rows) and (worked := self._check_line(line, rows, findings)):
                done[line.id] = worked
        self._check_rest(findings)
        return done

    def _check_line(self, line: Line, rows: IntArray, findings: Findings) -> float:
        chain = refine(chain_of(line.points, _vias(line)), _FINE_MM)
        motions = self.motions
        bare = np.full(len(chain), np.inf)
        open_start = False
        # An edge that is run with the process off is a way to another edge.
        switched = bool(process_signal(self.job.process))
        for row in rows[motions.on[rows] | (not switched)].tolist():
            points = arc_points(motions.start[row], motions.vias[row], motions.end[row])
            if not np.isfinite(points).all():
                open_start |= self._ends_on(row, chain)
                continue
            deviation = np.abs(distances(points, chain) - self.distance)
            if (deviation <= self.limit).all():
                self.follows[row] = True
                bare = np.minimum(bare, distances(chain, points))
        if not self.follows[rows].any() and not open_start:
            findings.miss(f"no motion runs along {line.id}")
            return 0.0
        uncovered = bare > self.distance + self.limit
        left = _measure_gaps(chain, uncovered)
        if self._is_trimmed(chain, uncovered) and not uncovered.all():
            return line.length - left
        if open_start:
            findings.leave(f"the start of {line.id}", "it is given by joint values")
            return line.length
        named = self.gaps.get(line.id, 0.0)
        gaps = int((np.diff(np.append(False, uncovered).astype(np.int8)) == 1).sum())
        if named and left <= named + _FINE_MM * gaps:
            return line.length - left
        x, y, z = chain[int(np.flatnonzero(uncovered)[0])].tolist()
        also = f"; {left:.1f} mm are left out, notes say {named:.1f} mm" if named else ""
        findings.miss(f"{line.id} is not worked at {x:.3f} {y:.3f} {z:.3f} mm{also}")
        return 0.0

    def _ends_on(self, row: int, chain: FloatArray) -> bool:
        """Whether a straight motion whose start is not known ends beside the edge."""
        end = self.motions.end[row : row + 1]
        if self.motions.joint[row] or not np.isfinite(end).all():
            return False
        return bool(abs(distances(end, chain)[0] - self.distance) <= self.limit)

    def _is_trimmed(self, chain: FloatArray, bare: BoolArray) -> bool:
        """Whether only the ends of an edge are left out, no more than `operation.trim` of each."""
        steps = np.sqrt((np.diff(chain, axis=0) ** 2).sum(axis=1))
        along = np.append(0.0, np.cumsum(steps))
        trim = self.job.operation.trim + _END_SLACK_MM
        return not bool((bare & ((along > trim) & (along < along[-1] - trim))).any())

    def _check_rest(self, findings: Findings) -> None:
        motions, process = self.motions, self.job.process
        for row in np.flatnonzero((motions.force > 0) & ~self.follows)[:1].tolist():
            findings.add(motions, row, "presses where nothing is to be worked")
        fastest = process.feed * process.max_feed_factor * (1 + 1e-3)
        works = motions.force > 0
        if not process.force and not is_switched_in_air(self.job):
            works = motions.on
        for row in np.flatnonzero(self.follows & works & (motions.speed > fastest))[:1].tolist():
            what = f"has a feed of {motions.speed[row]:.4g} mm/s, the job allows {fastest:.4g}"
            findings.add(motions, row, what)


def _vias(line: Line) -> FloatArray:
    """(N - 1, 3) points half-way along the spans of an edge or a curve."""
    middles = getattr(line, "middles", None)
    return np.asarray(line.via if middles is None else middles)


def chain_of(points: FloatArray, vias: FloatArray) -> FloatArray:
    """(M, 3) dense points along spans from `points` (N, 3) through `vias` (N - 1, 3)."""
    parts = []
    for start, via, end in zip(points[:-1], vias, points[1:], strict=True):
        parts.append(arc_points(start, via, end))
    return np.concatenate(parts)


def refine(chain: FloatArray, step: float) -> FloatArray:
    """The chain with points that are at most `step`, mm, apart, farther apart in long chains."""
    along = np.append(0.0, np.cumsum(np.sqrt((np.diff(chain, axis=0) ** 2).sum(axis=1))))
    count = min(int(np.ceil(along[-1] / step)), _MOST_POINTS)
    places = np.sort(np.concatenate([along, np.linspace(0.0, along[-1], count + 1)]))
    # `np.unique` loads numpy's masked arrays, which takes 5 ms.
    places = places[np.append(True, np.diff(places) > 0)]
    return np.column_stack([np.interp(places, along, column) for column in chain.T])


def _measure_gaps(chain: FloatArray, bare: BoolArray) -> float:
    """Length of a chain, mm, between points that are bare."""
    return float(np.sqrt((np.diff(chain, axis=0) ** 2).sum(axis=1))[bare[:-1] & bare[1:]].sum())


def arc_points(start: FloatArray, via: FloatArray, end: FloatArray) -> FloatArray:
    """(M, 3) points from `start` through `via` to `end`: on a circle, or on a line.

    A chord over the angle a leaves a circle of the radius r by less than r a^2 / 8. So an arc with
    a large radius has more points.
    """
    chord, arm = end - start, via - start
    normal = np.cross(arm, chord)
    size = float(normal @ normal)
    if not size > 1e-14 * float(chord @ chord) ** 2:
        return np.asarray(start + np.linspace(0.0, 1.0, _LINE_POINTS)[:, None] * chord)
    level = float(arm @ arm) * chord - float(chord @ chord) * arm
    to_centre = np.cross(level, normal) / (2 * size)
    x_axis = -to_centre
    y_axis = np.cross(normal / np.sqrt(size), x_axis)
    to_end = chord - to_centre
    angle = np.arctan2(float(to_end @ y_axis), float(to_end @ x_axis)) % (2 * np.pi)
    radius = float(np.sqrt(to_centre @ to_centre))
    chords = int(np.ceil(angle * np.sqrt(radius / (8 * _CHORD_MM))))
    count = min(max(_LINE_POINTS, chords + 1), _MOST_POINTS)
    turned = np.linspace(0.0, angle, count)[:, None]
    return np.asarray(start + to_centre + np.cos(turned) * x_axis + np.sin(turned) * y_axis)


def distances(points: FloatArray, chain: FloatArray) -> FloatArray:
    """(N,) distance of `points` (N, 3) from the chain of lines through `chain` (M, 3).

    It is off by less than 1e-8 times the size of both: squares are multiplied out, which takes a
    tenth of the time.
    """
    middle = chain.mean(axis=0)
    points, chain = points - middle, chain - middle
    start, along = chain[:-1], np.diff(chain, axis=0)
    size = (along**2).sum(axis=1) + 1e-300
    nearest = np.full(len(points), np.inf)
    for low in range(0, len(points), 512):
        part = points[low : low + 512]
        ahead = part @ along.T - (start * along).sum(axis=1)
        share = np.clip(ahead / size, 0.0, 1.0)
        square = (start**2).sum(axis=1) - 2 * (part @ start.T) + share * (share * size - 2 * ahead)
        nearest[low : low + 512] = square.min(axis=1) + (part**2).sum(axis=1)
    return np.asarray(np.sqrt(np.maximum(nearest, 0.0)))
