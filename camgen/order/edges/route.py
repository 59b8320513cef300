"""One tour over all processing motions, from and back to home (RFA paper, III.C).

Every link of the tour is proved. Only the free motions that the tour uses are tested. If one
collides, it is marked as blocked and the tour is searched again. At the end `turned_tour` chooses
the whole turns of the joints.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import count, pairwise

import numpy as np
from msgspec import Struct, field
from msgspec.structs import replace

from camgen.geometry.ragged import count_rows
from camgen.model.advice import ANOTHER_PLACE
from camgen.model.part import IntArray, Line
from camgen.model.pose import FloatArray
from camgen.model.text import counted
from camgen.motion.limits import LinkSpeeds
from camgen.motion.pose_paths import PosePath
from camgen.motion.setup import EdgeMotion, FreeSpace, UnreachableEdge
from camgen.order.edges import links
from camgen.order.edges.detour import find_detour
from camgen.order.edges.problem import (
    RouteCell,
    RouteOptions,
    RouteProblem,
    TourCandidate,
    classify_joint_motions,
    examine_links_home,
    examine_tour,
    list_states,
    make_problem,
    remove_penalty,
    round_to_ticks,
    time_links,
    with_detours,
    without_motions,
)
from camgen.order.edges.retract import Retraction, find_retractions, find_short_retraction
from camgen.order.edges.turned_tour import choose_turns
from camgen.order.edges.turns import list_turns, turn_motion
from camgen.order.solver import matrix
from camgen.plan import ignore_stages

#: Tours that are computed and tested in the first attempt. After that, untested links count as
#: blocked.
_FIRST_TOURS = 30
#: The same for each later attempt, of which most links are known from the attempts before.
_LATER_TOURS = 5
#: Attempts after which motions are left out too if their link to home collides. All others can
#: always be reached by way of home.
_HOME_ATTEMPTS = 10
#: Fraction of the usual search while links still turn out to collide.
_QUICK_EFFORT = 0.05
#: Fraction of the usual search for the last tour.
_FULL_EFFORT = 0.3
#: Searches for a detour to home without result, after which no more are made.
_MAX_FRUITLESS = 12
_REMEDY = f"cell.safety or {ANOTHER_PLACE} may help"


class Leg(Struct, frozen=True, eq=False):
    """A processing motion and the link that leads to it."""

    link: tuple[links.LinkMotion, ...]
    motion: EdgeMotion


class Route(Struct, frozen=True, eq=False):
    """A tour over processing motions with all its links.

    legs: motions in order, each with the link to it.
    back: link from the last motion to home.
    dropped: motions without a collision-free link.
    seconds: time of all links at the speeds of joints and travel, s.
    nearest: time of the links in the nearest neighbour's order of the paper, s.
    searched: number of motions whose link to home was found by a search.
    """

    legs: tuple[Leg, ...]
    back: tuple[links.LinkMotion, ...]
    dropped: tuple[UnreachableEdge, ...]
    seconds: float
    nearest: float
    searched: int = 0


def find_route(
    cell: RouteCell,
    motions: Sequence[EdgeMotion],
    edges: Sequence[Line],
    options: RouteOptions,
    on_progress: Callable[[str], None] = ignore_stages,
) -> Route:
    """Search the tour over `motions` along `edges`, one each, from and back to home.

    The search ends after at most `_FIRST_TOURS` and `_HOME_ATTEMPTS` times `_LATER_TOURS` tours,
    and a few more. Motions without a link are in `dropped`.
    """
    detours = _Detours(cell)
    left, outs, dropped = _find_retractable(detours, motions, options.speeds)
    if not left:
        return Route((), (), tuple(dropped), 0.0, 0.0)
    problem = make_problem(cell, left, outs, edges, options)
    for attempt in count():
        tours = _LATER_TOURS if attempt else _FIRST_TOURS
        candidate = _search_tour(problem, options.best, tours, on_progress)
        lost = _find_unlinked(problem, candidate, attempt >= _HOME_ATTEMPTS)
        if not lost:
            problem, candidate = choose_turns(problem, candidate, options.speeds)
            legs, back = _make_legs(problem, candidate, options.speeds)
            counts = count_rows([out.via for out in problem.out])
            searched = int(np.count_nonzero(counts[::2] + counts[1::2]))
            seconds = candidate.seconds
            return Route(legs, back, tuple(dropped), seconds, candidate.nearest, searched)
        if one_sided := _find_one_sided(problem, lost):
            problem = _leave_by_other_end(problem, one_sided, options.speeds)
            continue
        if turned := _turn_unlinked(detours, problem, lost):
            problem = make_problem(cell, *turned, edges, options)
            continue
        on_progress(f"{counted(len(problem.motions), 'edge')}, detours around obstacles")
        opened = _search_detours(detours, problem, lost)
        if opened:
            problem = with_detours(problem, opened, options.speeds)
            continue
        reason = "no collision-free link to it"
        for k in sorted(lost):
            dropped.append(UnreachableEdge(problem.motions[k].id, "collision", reason, _REMEDY))
        if len(lost) == len(problem.motions):
            return Route((), (), tuple(dropped), 0.0, 0.0)
        problem = without_motions(problem, lost)
    raise AssertionError("every attempt leaves at least one motion out")


# Retractions.


class _Detours(Struct, eq=False):
    """The search for detours to home.

    cell: the cell.
    fruitless: number of searches without a result.
    done: ids of the motions from whose ends a detour was searched.
    turned: ids of the motions whose whole turns were tried.
    """

    cell: RouteCell
    fruitless: int = 0
    done: set[str] = field(default_factory=set)
    turned: set[str] = field(default_factory=set)

    def find_home(self, joints: FloatArray) -> FloatArray | None:
        """Find joint values (K, J) to pass through from `joints` (J,) to home; None without any."""
        if self.fruitless >= _MAX_FRUITLESS:
            return None
        detour = find_detour(self.cell.setup, self.cell.free_space, joints, self.cell.home)
        self.fruitless += detour is None
        return None if detour is None else detour[1:-1]


def _find_retractable(
    detours: _Detours, motions: Sequence[EdgeMotion], speeds: LinkSpeeds
) -> tuple[list[EdgeMotion], list[Retraction], list[UnreachableEdge]]:
    """The motions that can be left, two retractions for each, and the motions without any.

    A motion with one retraction alone is left at its other end by going back along the motion.
    """
    kept: list[EdgeMotion] = []
    outs: list[Retraction] = []
    dropped: list[UnreachableEdge] = []
    for motion, results in zip(motions, _retract_all(detours.cell, motions, speeds), strict=True):
        at_ends = [result if isinstance(result, Retraction) else None for result in results]
        if not any(at_ends):
            space = detours.cell.space_of(motion)
            at_ends = [_search_retraction(detours, space, end, speeds) for end in _ends_of(motion)]
        known = [out for out in at_ends if out is not None]
        if not known:
            reason = f"no collision-free retract from it: {results[0]}"
            dropped.append(UnreachableEdge(motion.id, "collision", reason, _REMEDY))
            continue
        kept.append(motion)
        for side, out in enumerate(at_ends):
            outs.append(out or links.make_retraction_along(motion, side, known[0], speeds.part))
    return kept, outs, dropped


def _retract_all(
    cell: RouteCell, motions: Sequence[EdgeMotion], speeds: LinkSpeeds
) -> list[list[Retraction | str]]:
    of_motions: list[list[Retraction | str]] = [[] for _ in motions]
    for space in cell.spaces:
        chosen = [k for k, motion in enumerate(motions) if cell.space_of(motion) is space]
        ends: list[_End] = []
        for k in chosen:
            ends += _ends_of(motions[k])
        results = find_retractions(cell.setup, space, ends, speeds) if chosen else []
        for k, *both in zip(chosen, results[::2], results[1::2], strict=True):
            of_motions[k] = both
    return of_motions


#: A pose path of one row at the end of a motion, and the joint values (J,) there.
_End = tuple[PosePath, FloatArray]


def _ends_of(motion: EdgeMotion) -> tuple[_End, _End]:
    path = motion.pose_path
    no_via = np.full((1, 3), np.nan)
    start = PosePath(path.position[[0]], no_via, path.rotation[[0]])
    end = PosePath(path.position[[-1]], no_via, path.rotation[[-1]])
    return (start, motion.joints[0]), (end, motion.joints[-1])


def _search_retraction(
    detours: _Detours, space: FreeSpace, end: _End, speeds: LinkSpeeds
) -> Retraction | None:
    """Search a retraction with a detour home: back a little, then along searched joint values."""
    out = find_short_retraction(detours.cell.setup, space, *end, speeds)
    if out is None:
        return None
    via = detours.find_home(out.joints[-1])
    return None if via is None else replace(out, via=via)


# The tour.


def _search_tour(
    problem: RouteProblem, best: bool, tours: int, on_progress: Callable[[str], None]
) -> TourCandidate:
    """Search a tour whose links are tested and clear, unless no finite tour is left.

    After `tours` tours only links that are known to be clear are used.
    """
    effort, only_tested = _QUICK_EFFORT, False
    order: matrix.Order | None = None
    for attempt in count():
        on_progress(f"{counted(len(problem.motions), 'edge')}, tour {attempt + 1}")
        if attempt == tours:
            only_tested = True
            examine_links_home(problem)
        between, first, home = time_links(problem, only_tested=only_tested)
        ends = round_to_ticks(home + problem.ends.out).reshape(-1, 2)
        between = round_to_ticks(between).reshape(len(problem.motions), 2, -1, 2)
        table = matrix.Table(between, ends, ends)
        nearest = matrix.nearest(table)
        # A large tour continues from the last one, of which little has changed.
        start = order if len(problem.motions) > links.MAX_SEARCHED_MOTIONS else None
        order = matrix.shortest(table, effort=effort, start=start) if best else nearest
        if not only_tested and examine_tour(problem, order, first):
            continue
        if effort == _FULL_EFFORT:
            seconds = remove_penalty(matrix.total(table, *order))
            of_nearest = remove_penalty(matrix.total(table, *nearest))
            return TourCandidate(order, first, seconds, of_nearest)
        effort = _FULL_EFFORT
    raise AssertionError("every tour tests at least one motion more")


def _find_unlinked(problem: RouteProblem, candidate: TourCandidate, strictly: bool) -> set[int]:
    """Find the motions to which the tour has no finite link.

    Motions after one of these are not included: another link may lead to them.
    strictly: include motions from whose ends the link to home is not known to be clear.
    """
    if math.isfinite(candidate.seconds):
        return set()
    if strictly:
        examine_links_home(problem)
    states = list_states(candidate.order)
    between, _, home = time_links(problem, only_tested=True)
    no_home = np.isinf(home)
    lost = {end // 2 for end in (states[0][0], states[-1][1]) if no_home[end]}
    for (_, a), (b, _) in pairwise(states):
        if math.isinf(between[a, b]) and a // 2 not in lost:
            # At least one end cannot go home, otherwise the link would go by way of home.
            lost.add(b // 2 if no_home[b] else a // 2)
    if strictly:
        lost.update((np.flatnonzero(no_home) // 2).tolist())
    return lost


# Other ends, turns and detours for motions without a link.


def _find_one_sided(problem: RouteProblem, motions: Iterable[int]) -> list[int]:
    """The ends of `motions` whose link to home collides while that of the other end does not."""
    examine_links_home(problem)
    no_home = ~problem.tested.clear[:-1, -1]
    ends = np.add.outer(2 * np.array(sorted(motions)), [0, 1]).ravel()
    return list(ends[no_home[ends] & ~no_home[ends ^ 1]].tolist())


def _leave_by_other_end(
    problem: RouteProblem, ends_to_replace: Sequence[int], speeds: LinkSpeeds
) -> RouteProblem:
    """From each of these ends the tool goes back along the motion and retracts at its other end."""
    ends, tested, out = problem.ends, problem.tested, list(problem.out)
    replaced = np.array(ends_to_replace)
    other = replaced ^ 1
    for end in ends_to_replace:
        motion, of_other = problem.motions[end // 2], out[end ^ 1]
        out[end] = links.make_retraction_along(motion, end % 2, of_other, speeds.part)
    safe, seconds = ends.safe.copy(), ends.out.copy()
    free, to_home = ends.free.copy(), problem.to_home.copy()
    safe[replaced], to_home[replaced] = safe[other], to_home[other]
    seconds[replaced] = [out[end].time(speeds) for end in ends_to_replace]
    for table in (free, tested.blocked, tested.clear, tested.near):
        table[replaced], table[:, replaced] = table[other], table[:, other]
        table[replaced[:, None], replaced] = table[other[:, None], other]
    ends = replace(ends, safe=safe, out=seconds, free=free)
    return replace(problem, out=tuple(out), ends=ends, to_home=to_home, tested=tested)


def _turn_unlinked(
    detours: _Detours, problem: RouteProblem, lost: Iterable[int]
) -> tuple[list[EdgeMotion], list[Retraction]] | None:
    """Move motions of `lost` by whole turns of the joints with which they have a link to home.

    Returns all motions and retractions, or None if no turns help.
    """
    cell, motions, outs = problem.cell, list(problem.motions), list(problem.out)
    has_turned = False
    for index in sorted(lost):
        motion, both = motions[index], outs[2 * index : 2 * index + 2]
        if motion.id in detours.turned or any(len(out.via) for out in both):
            continue
        detours.turned.add(motion.id)
        joints = np.concatenate(
            [motion.sampled_joints, both[0].sampled_joints, both[1].sampled_joints]
        )
        turns = list_turns(cell.setup.robot, joints, cell.home)[1:]
        turned = [
            out.joints[-1] + math.tau * whole for whole, out in itertools.product(turns, both)
        ]
        tests = [(np.stack([joints, cell.home]), (motion,)) for joints in turned]
        verdicts = classify_joint_motions(cell, tests)
        if "clear" in verdicts:
            whole = turns[verdicts.index("clear") // 2]
            motions[index] = turn_motion(motion, whole)
            outs[2 * index : 2 * index + 2] = [turn_motion(out, whole) for out in both]
            has_turned = True
    return (motions, outs) if has_turned else None


def _search_detours(
    detours: _Detours, problem: RouteProblem, lost: Iterable[int]
) -> dict[int, FloatArray]:
    """Search detours home for the motions of `lost`: joint values (K, J) from one end of each."""
    opened = {}
    for motion in sorted(lost):
        name = problem.motions[motion].id
        if name in detours.done:
            continue
        detours.done.add(name)
        for end in (2 * motion, 2 * motion + 1):
            via = detours.find_home(problem.ends.safe[end])
            if via is not None and len(via):
                opened[end] = via
                break
    return opened


# The motions of the links.


def _make_legs(
    problem: RouteProblem, candidate: TourCandidate, speeds: LinkSpeeds
) -> tuple[tuple[Leg, ...], tuple[links.LinkMotion, ...]]:
    """The motions with the links to them, and the link to home, with the speeds of the links."""
    setup, home = problem.cell.setup, problem.cell.home
    legs: list[Leg] = []
    current = home
    before = -1
    for (enter, leave), item, back in zip(
        list_states(candidate.order), *candidate.order, strict=True
    ):
        if before < 0:
            out = problem.out[enter]
            rows = (*out.via[::-1], problem.ends.safe[enter])
            link: list[links.LinkMotion] = [*map(links.JointLink, rows), links.make_approach(out)]
        else:
            link = list(_list_link_motions(problem, candidate.first, before, enter))
        motion = problem.motions[item].reversed() if back else problem.motions[item]
        legs.append(Leg(tuple(links.replace_speeds(setup, link, current, speeds)), motion))
        current, before = motion.joints[-1], leave
    out = problem.out[before]
    to_home: list[links.LinkMotion] = [links.make_retract(out)]
    to_home += map(links.JointLink, (*out.via, home))
    return tuple(legs), tuple(links.replace_speeds(setup, to_home, current, speeds))


def _list_link_motions(
    problem: RouteProblem, first: IntArray, a: int, b: int
) -> Iterator[links.LinkMotion]:
    """The motions of the link from end `a` to end `b`. first: result of `links.choose_links`."""
    ends, out = problem.ends, problem.out
    if first[a, b] < 0:
        yield links.make_retract(out[a])
        if first[a, b] == links.BY_HOME:
            yield from map(links.JointLink, (*out[a].via, problem.cell.home, *out[b].via[::-1]))
        yield links.JointLink(ends.safe[b])
        yield links.make_approach(out[b])
        return
    while a != b:
        next_end = int(first[a, b])
        if next_end == a ^ 1:
            motion = problem.motions[a // 2]
            motion = motion if a % 2 == 0 else motion.reversed()
            speed = np.full(len(motion.pose_path) - 1, ends.speed)
            yield links.PathLink(motion.pose_path, motion.joints, speed, "shared edge")
        else:
            yield links.JointLink(ends.joints[next_end], free=False)
        a = next_end
