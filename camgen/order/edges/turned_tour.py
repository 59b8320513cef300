"""Chooses the whole turns of the joints along a tour over edges, so that links take least time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import count, pairwise, product

import numpy as np
from msgspec import Struct, field
from msgspec.structs import replace

from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray
from camgen.motion.limits import LinkSpeeds
from camgen.order.edges import links
from camgen.order.edges.problem import (
    PENALTIES,
    RouteProblem,
    TourCandidate,
    classify_joint_motions,
    list_states,
    remove_penalty,
    round_to_ticks,
)
from camgen.order.edges.turns import find_cheapest, list_turns, turn_motion

#: Rounds of tests, after which motions that were not tested count as blocked.
_TEST_ROUNDS = 6


class _Block(Struct, frozen=True, eq=False):
    """Motions of a tour between which the tool stays at the part: they turn together.

    enter, leave: ends at which the block begins and ends.
    motions: indices of the motions.
    turns: (T, J) whole turns to choose from; the first row is zero.
    """

    enter: int
    leave: int
    motions: tuple[int, ...]
    turns: IntArray


#: Two stops of a tour, each an end of a motion or -1 for home.
_Stops = tuple[int, int]
#: Two stops, and the index of the turns of each.
_TurnedMotion = tuple[_Stops, tuple[int, int]]


class _TurnTimes(Struct, frozen=True, eq=False):
    """Times of the joint motions between two stops of a tour, in all turns of both.

    rows: (T, J) joint values of each stop in free space.
    seconds: (T, U) times of the motions from a stop to another, inf if they collide.
    tested: (T, U) whether each was tested.
    """

    rows: dict[int, FloatArray]
    seconds: dict[_Stops, FloatArray] = field(default_factory=dict)
    tested: dict[_Stops, BoolArray] = field(default_factory=dict)

    def add(self, problem: RouteProblem, stops: _Stops, speeds: LinkSpeeds) -> None:
        """Adds the motions of two stops, with the test results of the one without turns."""
        first, second = self.rows[stops[0]], self.rows[stops[1]]
        setup, results = problem.cell.setup, problem.tested
        seconds = links.time_joint_motions(setup, first[:, None], second[None], speeds)
        tested = np.zeros(seconds.shape, dtype=np.bool_)
        tested[0, 0] = results.clear[stops] or results.blocked[stops]
        seconds[0, 0] += PENALTIES["near"] * results.near[stops]
        if results.blocked[stops]:
            seconds[0, 0] = math.inf
        self.seconds[stops], self.tested[stops] = round_to_ticks(seconds), tested

    def by_home(self, stops: _Stops) -> FloatArray:
        """(T, U) times between two stops by way of home."""
        first, second = self.seconds[stops[0], -1], self.seconds[stops[1], -1]
        return np.asarray(first + second[:, 0])

    def between(self, stops: _Stops) -> FloatArray:
        """(T, U) times between two stops, directly or by way of home, whichever is faster."""
        direct = self.seconds[stops]
        return direct if -1 in stops else np.minimum(direct, self.by_home(stops))

    def motions(self, stops: _Stops, turns: tuple[int, int]) -> list[_TurnedMotion]:
        """The joint motions of the faster of both, for the turns of these indices."""
        if -1 in stops or self.seconds[stops][turns] <= self.by_home(stops)[turns]:
            return [(stops, turns)]
        return [((stops[0], -1), (turns[0], 0)), ((stops[1], -1), (turns[1], 0))]

    def test(self, problem: RouteProblem, motions: Sequence[_TurnedMotion]) -> None:
        """Tests joint motions and adds the penalties of their verdicts."""
        tests = []
        for stops, turns in motions:
            rows = [self.rows[stop][index] for stop, index in zip(stops, turns, strict=True)]
            linked = tuple(problem.motions[stop // 2] for stop in stops if stop >= 0)
            tests.append((np.stack(rows), linked))
        verdicts = classify_joint_motions(problem.cell, tests)
        for (stops, turns), verdict in zip(motions, verdicts, strict=True):
            self.tested[stops][turns] = True
            self.seconds[stops][turns] += PENALTIES[verdict]


def choose_turns(
    problem: RouteProblem, candidate: TourCandidate, speeds: LinkSpeeds
) -> tuple[RouteProblem, TourCandidate]:
    """The problem and the tour with the whole turns of its motions that take least time."""
    blocks = list(_list_blocks(problem, candidate))
    if all(len(block.turns) == 1 for block in blocks):
        return problem, candidate
    rows = {-1: problem.cell.home[None]}
    for block in blocks:
        for end in (block.enter, block.leave):
            rows[end] = problem.ends.safe[end] + math.tau * block.turns
    times = _TurnTimes(rows)
    between = [(before.leave, after.enter) for before, after in pairwise(blocks)]
    used = [(blocks[0].enter, -1), *between, (blocks[-1].leave, -1)]
    for stops in {*used, *product(rows.keys() - {-1}, [-1])}:
        times.add(problem, stops, speeds)
    chosen, direct, saved = _find_turns(problem, times, used)
    if not any(chosen):
        return problem, candidate
    first = candidate.first.copy()
    for stops in between:
        first[stops] = links.FREE if stops in direct else links.BY_HOME
    turned = _turn_blocks(problem, blocks, chosen)
    return turned, replace(candidate, first=first, seconds=candidate.seconds - saved)


def _list_blocks(problem: RouteProblem, candidate: TourCandidate) -> Iterator[_Block]:
    """The blocks of a tour.

    A block with a link along another edge or with a detour keeps its turns.
    """
    cell, first, states = problem.cell, candidate.first, list_states(candidate.order)
    groups, fixed = [[states[0]]], set()
    for before, state in pairwise(states):
        end, goal = before[1], state[0]
        if first[end, goal] < 0:
            groups.append([state])
            continue
        groups[-1].append(state)
        while end != goal:
            next_end = int(first[end, goal])
            if next_end == end ^ 1:
                fixed |= {end // 2, state[0] // 2}
            end = next_end
    for group in groups:
        enter, leave = group[0][0], group[-1][1]
        motions = tuple(end // 2 for end, _ in group)
        outs = [problem.out[enter], problem.out[leave]]
        joints = [outs[0].sampled_joints, outs[1].sampled_joints]
        joints += [problem.motions[k].sampled_joints for k in motions]
        turns = list_turns(cell.setup.robot, np.concatenate(joints), cell.home)
        if not fixed.isdisjoint(motions) or any(len(out.via) for out in outs):
            turns = turns[:1]
        yield _Block(enter, leave, motions, turns)


def _find_turns(
    problem: RouteProblem, times: _TurnTimes, links_in_order: Sequence[_Stops]
) -> tuple[list[int], set[_Stops], float]:
    """Find the turns of all blocks with the least time, and test the motions that they need.

    Returns the index of the turns of each block, the stops between which the joints move directly,
    and the time that is saved, s. After `_TEST_ROUNDS` rounds untested motions count as blocked.
    """
    for attempt in count():
        if attempt == _TEST_ROUNDS:
            for stops, tested in times.tested.items():
                times.seconds[stops][~tested] = math.inf
        tables = [times.between(stops) for stops in links_in_order]
        chosen, seconds = find_cheapest(tables[0][:, 0], tables[1:-1], tables[-1][:, 0])
        turns_of_links = [(chosen[0], 0), *pairwise(chosen), (chosen[-1], 0)]
        motions: list[_TurnedMotion] = []
        for stops, turns in zip(links_in_order, turns_of_links, strict=True):
            motions += times.motions(stops, turns)
        untested = [(stops, turns) for stops, turns in motions if not times.tested[stops][turns]]
        if not untested:
            unturned = sum(float(table[0, 0]) for table in tables)
            saved = remove_penalty(unturned) - remove_penalty(seconds)
            return chosen, {stops for stops, _ in motions}, saved
        times.test(problem, untested)
    raise AssertionError("the motions of the tour itself are tested")


def _turn_blocks(
    problem: RouteProblem, blocks: Sequence[_Block], chosen: Sequence[int]
) -> RouteProblem:
    motions, outs, ends = list(problem.motions), list(problem.out), problem.ends
    joints, safe = ends.joints.copy(), ends.safe.copy()
    for block, index in zip(blocks, chosen, strict=True):
        whole = block.turns[index]
        for k in block.motions:
            motions[k] = turn_motion(motions[k], whole)
            joints[2 * k : 2 * k + 2] += math.tau * whole
        for end in {block.enter, block.leave} if whole.any() else ():
            outs[end] = turn_motion(outs[end], whole)
            safe[end] += math.tau * whole
    ends = replace(ends, joints=joints, safe=safe)
    return replace(problem, motions=tuple(motions), out=tuple(outs), ends=ends)
