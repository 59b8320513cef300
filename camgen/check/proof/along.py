"""The proof of a task along contours: each stretch of motions first, and what all of them cover."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, count, repeat
from operator import attrgetter

import numpy as np
from msgspec.structs import replace

from camgen.check.proof.contours import ContourChecker, Matched, Workplace
from camgen.check.proof.earlier import EarlierCuts
from camgen.check.proof.findings import Findings
from camgen.check.proof.heights import check_heights, find_levels, tab_top
from camgen.check.proof.hints import Program
from camgen.check.proof.leads import LeadChecker
from camgen.check.proof.matching import Ragged, join_tables, list_pieces
from camgen.check.proof.motions import Motions
from camgen.check.proof.nesting import find_unclear
from camgen.check.proof.outputs import check_outputs
from camgen.check.proof.passes import check_inside_first, check_pass_order, check_repeats
from camgen.check.proof.pieces import BoolArray, IntArray, points_along
from camgen.check.proof.process import (
    check_feeds,
    check_force_directions,
    check_forces,
    check_tool_turns,
    find_directions,
)
from camgen.check.proof.slopes import SlopeChecker, TabChecker
from camgen.check.proof.subject import Context, Subject, are_named
from camgen.check.proof.tasks import BESIDE, Drawing, Task
from camgen.check.proof.visits import Laps, find_laps, number_visits
from camgen.model.pose import FloatArray
from camgen.model.program import Origin


class ContourProver:
    """Examines the motions of one task along contours, in one program.

    The motions come in stretches, so that a long program stays in the cache of the processor.
    slack: deviation of a coordinate of the text, mm.
    earlier: motions of earlier operations, if the task takes only what they leave.
    """

    def __init__(
        self,
        task: Task,
        program: Program,
        context: Context,
        slack: float,
        earlier: EarlierCuts | None = None,
    ) -> None:
        self.task, self.context, self.slack = _leave_unclear(task, context), context, slack
        self._earlier = earlier
        self._place = Workplace(self.task, context.drawing, _hint(context.drawing, program.origins))
        self._matched: list[Matched] = []
        self._depths: list[FloatArray] = []

    def _checker(self, motions: Motions) -> ContourChecker:
        return ContourChecker(self._place, motions, self.slack + self.context.drawing.slack)

    def examine(self, subject: Subject, first: int, findings: Findings) -> BoolArray:
        """Examines one stretch; returns (M,) the motions in contact.

        first: index of its first motion among those of the program.
        """
        subject = subject._replace(task=self.task)
        task, motions = self.task, subject.motions
        phases, rows = subject.phases, subject.works
        checker = self._checker(motions)
        matched = checker.match(rows, findings)
        if task.job.process.stay_down:
            # Links at working height may have the process off.
            check_outputs(task, motions, rows[matched.follows], findings)
        levels = find_levels(task, motions, rows, subject.slack)
        leads = LeadChecker(checker, matched)
        leading = leads.find(phases.chain[rows], levels >= 0)
        strange = ~matched.follows & ~leading & ~matched.rounds
        for index in np.flatnonzero(strange)[:1].tolist():
            findings.add(motions, int(rows[index]), "works where nothing is drawn to be worked")
        laps, directed = _check_laps(subject, leads, levels, findings)
        checker.check_direction(matched, directed, findings)
        check_pass_order(checker, matched, levels, findings)
        checker.check_clear(matched, findings)
        check_feeds(checker, matched, subject.context.rounding, findings)
        check_forces(task, motions, matched, findings)
        _check_directions(subject, matched, findings)
        check_heights(task, motions, rows, levels, subject.slack, findings)
        self._depths.append(_depths_of(subject, matched, laps, levels))
        covered = replace(matched.covered, motion=matched.covered.motion + first)
        place = matched.place + sum(len(part.rows) for part in self._matched)
        self._matched.append(replace(matched, rows=rows + first, covered=covered, place=place))
        return phases.works

    def finish(self, motions: Motions, findings: Findings) -> BoolArray:
        """(C,) contours that are covered at each depth; a finding for the first that is not.

        motions: all motions of the program.
        """
        checker = self._checker(motions)
        matched = join_tables(self._matched)
        check_inside_first(checker, matched, findings)
        return self._check_passes(checker, matched, np.concatenate(self._depths), findings)

    def _check_passes(
        self, checker: ContourChecker, matched: Matched, depths: FloatArray, findings: Findings
    ) -> BoolArray:
        task, skipped = self.task, self.context.named.skipped
        drawing, owner = checker.drawing, checker.pieces.owner
        named = are_named(drawing, skipped)
        done = task.worked.copy()
        touched = np.zeros(len(done), np.bool_)
        touched[owner[matched.piece[matched.follows]]] = True
        for number, depth in enumerate(task.depths):
            # Passes that the digits of the text do not distinguish are covered together.
            at_depth = np.abs(depths - depth) <= self.slack
            last = number == len(task.depths) - 1
            distance = task.distances[-1] if last else task.distances[0]
            chosen = at_depth[matched.place]
            at_distance = chosen & (np.abs(matched.distance[matched.place] - distance) < 1e-9)
            check_repeats(checker, matched.covered.take(at_distance), depth, findings)
            if last:
                chosen = at_distance
            rows = matched.rows[at_depth]
            covered = matched.covered.take(chosen)
            gaps = checker.find_uncovered(covered, rows, distance, named, findings)
            if self._earlier is not None:
                gaps = gaps.take(~self._earlier.touch(gaps, checker.pieces, depth, self.slack))
            for piece, low, high in zip(gaps.piece, gaps.low, gaps.high, strict=True):
                contour = drawing.contours[int(owner[piece])]
                done[owner[piece]] = False
                left_out = not skipped.isdisjoint({contour.id, *contour.sources})
                if left_out or not touched[owner[piece]]:
                    continue
                share = np.array([(low + high) / 2])
                x, y = points_along(checker.pieces, np.array([piece]), share)[0].tolist()
                place = f"at {x:.3f} {y:.3f} mm, depth {depth:g} mm"
                findings.miss(f"contour {contour.id} is not worked {place}")
                return done
        # A contour without a gap is worked, unless a note says that the tool does not fit there.
        return np.asarray(done & (touched | ~named))


def _leave_unclear(task: Task, context: Context) -> Task:
    """The task without the contours that have no outside, or no clear one, as notes say."""
    drawing = context.drawing
    if task.kind in BESIDE and task.operation.side not in ("left", "right"):
        # An open contour has no outside: a note has to say that it is left out.
        worked = task.worked & drawing.closed
        task = replace(task, worked=worked, walls=worked | task.kept_clear)
    if task.kept_clear.any():
        suspects = task.kept_clear & are_named(drawing, context.named.others)
        unclear = find_unclear(drawing.pieces, suspects, task.near)
        task = replace(task, kept_clear=task.kept_clear & ~unclear, worked=task.worked & ~unclear)
    return task


def _hint(drawing: Drawing, origins: Sequence[Origin]) -> Ragged:
    """For each path the pieces of the drawing at which to look first."""
    place = dict(zip(map(attrgetter("id"), drawing.contours), count(), strict=False))
    names = list(map(attrgetter("contours"), origins))
    path = np.repeat(np.arange(len(names)), list(map(len, names)))
    flat = map(place.get, chain.from_iterable(names), repeat(-1))
    contour = np.fromiter(flat, np.intp, len(path))
    known = contour >= 0
    return list_pieces(drawing.pieces, len(names), path[known], contour[known])


def _check_laps(
    subject: Subject, leads: LeadChecker, levels: IntArray, findings: Findings
) -> tuple[Laps | None, BoolArray]:
    """Checks leads, overlaps, slopes and tabs.

    Returns the laps, or None if the job asks for nothing of these, and (W,) motions that have the
    direction of their path: level ones, and ramps around it.
    """
    task, drawing, motions = subject.task, subject.drawing, subject.motions
    operation, matched = task.operation, leads.matched
    has_ends = operation.lead_in or operation.lead_out or operation.overlap
    has_slopes = operation.entry != "plunge" or np.isfinite(tab_top(task))
    if not has_ends and not has_slopes and operation.passes == 1:
        return None, levels >= 0
    clearance = task.job.process.clearance
    visit = number_visits(motions, subject.phases, clearance, subject.slack)[matched.rows]
    laps = find_laps(task, motions, matched, visit, drawing.pieces.owner, subject.limit)
    names = subject.context.named
    leads.check(laps, _laps_named(subject, matched, laps, names.leads), findings)
    leads.check_overlap(laps, levels, findings)
    leads.check_feeds(laps, subject.context.rounding.speed, findings)
    slopes = SlopeChecker(task, motions, matched.rows, laps.reached, subject.slack)
    slopes.check(visit, levels, findings)
    slopes.check_linked(laps, visit, findings)
    fewer = _laps_named(subject, matched, laps, names.tabs)
    skipped = are_named(drawing, names.skipped)
    TabChecker(task, drawing, motions, subject.slack, skipped).check(matched, laps, fewer, findings)
    return laps, (levels >= 0) | slopes.goes_round(laps)


def _laps_named(subject: Subject, matched: Matched, laps: Laps, names: frozenset[str]) -> BoolArray:
    """(L,) laps along a contour that is among `names`, or on a path beside one."""
    if not names:
        return np.zeros(len(laps.first), np.bool_)
    on_path = [not names.isdisjoint(origin.contours) for origin in subject.program.origins]
    by_path = np.array([*on_path, False], np.bool_)[subject.motions.path[matched.rows[laps.first]]]
    return np.asarray(by_path | are_named(subject.drawing, names)[laps.contour])


def _check_directions(subject: Subject, matched: Matched, findings: Findings) -> None:
    """Compares tool x and the direction of the force with the way to the contour."""
    task, controller = subject.task, subject.context.controller
    if controller is None or task.kind not in BESIDE:
        return
    tool, force = task.job.tool, task.job.process.force
    follows = tool.orient == "follow" and not tool.symmetric and tool.turn is None
    if not follows and not force:
        return
    motions = subject.motions
    towards = find_directions(subject.drawing, motions, matched, subject.limit)
    if force and "force-direction" in controller.stated:
        check_force_directions(motions, towards, findings)
    elif motions.force.any():
        findings.leave("the direction of the force", "the text does not state it")
    if follows and "orientation" in controller.stated:
        check_tool_turns(motions, towards, findings)
    elif tool.orient == "follow":
        why = "the text states no orientation" if follows else "the tool may turn about its axis"
        findings.leave("that tool x points at the contour", why)


def _depths_of(
    subject: Subject, matched: Matched, laps: Laps | None, levels: IntArray
) -> FloatArray:
    """(W,) depth at which each motion covers its contour, mm; infinite for one on a slope."""
    depths = np.array(subject.task.depths)
    if laps is None:
        return np.where(levels >= 0, depths[levels], np.inf)
    # Over a tab a lap is as high as the tab, which may be the depth of an earlier pass. A ramp is
    # as steep as the slope after a tab, or steeper, so all laps begin at their depth.
    lowest = tab_top(subject.task) + subject.slack
    in_lap = (levels >= 0) | (subject.motions.end[matched.rows, 2] <= lowest)
    return np.where(in_lap, np.append(depths[laps.depth], np.inf)[laps.lap], np.inf)
