"""The search problem of a route over edges: motions, times of their links, and tested links."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise, product
from typing import Literal

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.model.part import BoolArray, IntArray, Line
from camgen.model.pose import FloatArray
from camgen.model.sequences import take_rows
from camgen.motion.limits import LinkSpeeds
from camgen.motion.setup import Blockage, EdgeMotion, FreeSpace, SampledMotion, Setup
from camgen.order.edges import links
from camgen.order.edges.retract import Retraction
from camgen.order.solver import matrix

#: mm: ends of edges nearer than this are one vertex.
_VERTEX_MM = 0.01
#: Samples of a joint motion that are tested before the whole motion.
_FIRST_SAMPLES = 11
#: s: penalty of a link that comes nearer than the margin. It is more than any tour takes, so the
#: link is used only if there is no other one.
NEAR_PENALTY = 1e5
#: mm: a motion whose clearance is smaller than that of its ends by less than this keeps it.
_CLEARANCE_SLACK_MM = 0.05
#: s: a power of two, so that a sum of less than two months is exact.
_TICK = 2.0**-30


class RouteCell(Struct, frozen=True, eq=False):
    """The cell in which a route is searched.

    setup: the arm, and the collision test of joint values.
    free_space: the safety level, and the collision test of motions.
    home: (J,) joint values from which the route starts and to which it returns.
    rims: ids of the lines whose own rim the tip of the tool may enter, as `free_space` allows.
    strict: free space for all other lines; None without rims.
    """

    setup: Setup
    free_space: FreeSpace
    home: FloatArray
    rims: frozenset[str] = frozenset()
    strict: FreeSpace | None = None

    @property
    def spaces(self) -> tuple[FreeSpace, ...]:
        """The free spaces of all motions."""
        return (self.free_space,) if self.strict is None else (self.free_space, self.strict)

    def space_of(self, *motions: EdgeMotion) -> FreeSpace:
        """The free space of the retractions and links of some motions."""
        if self.strict is None or any(motion.line in self.rims for motion in motions):
            return self.free_space
        return self.strict


class RouteOptions(Struct, frozen=True):
    """The settings of a job for its links.

    speeds: speeds of the links.
    best: True to search the shortest tour, False to take the nearest neighbour next.
    lifted: whether each link leaves the part, as a tool in contact has to.
    barred: pairs of motions, by their ids, between which no link stays at the part.
    """

    speeds: LinkSpeeds
    best: bool
    lifted: bool = False
    barred: frozenset[frozenset[str]] = frozenset()


class TestedLinks(Struct, eq=False):
    """The results of all collision tests so far, (2 n + 1, 2 n + 1) from end to end, home last.

    blocked: whether the motion collides.
    clear: whether it is tested and does not collide.
    near: whether it is clear and comes nearer than the margin.
    """

    blocked: BoolArray
    clear: BoolArray
    near: BoolArray


class RouteProblem(Struct, frozen=True, eq=False):
    """Motions, retractions and links of a route, with all test results so far.

    cell: the cell.
    motions: n motions that the tool can leave at both ends.
    out: (2 n) retraction of each end.
    ends: joint values and link times of the ends.
    at_part: result of `links.find_links_at_part`.
    to_home: (2 n,) time from free space to home, s.
    tested: results of the collision tests; `examine_links` adds to them.
    """

    cell: RouteCell
    motions: tuple[EdgeMotion, ...]
    out: tuple[Retraction, ...]
    ends: links.MotionEnds
    at_part: tuple[FloatArray, IntArray]
    to_home: FloatArray
    tested: TestedLinks


class TourCandidate(Struct, frozen=True, eq=False):
    """A tour whose links may still be untested.

    order: order and directions of the motions.
    first: result of `links.choose_links`, the first step of each link.
    seconds: time of its links, s.
    nearest: time of the links in the nearest neighbour's order, s.
    """

    order: matrix.Order
    first: IntArray
    seconds: float
    nearest: float


Verdict = Literal["blocked", "near", "clear"]
#: s: what each verdict adds to the time of a link.
PENALTIES: dict[Verdict, float] = {"clear": 0.0, "near": NEAR_PENALTY, "blocked": math.inf}


def make_problem(
    cell: RouteCell,
    motions: Sequence[EdgeMotion],
    retractions: Sequence[Retraction],
    edges: Sequence[Line],
    options: RouteOptions,
) -> RouteProblem:
    """Compute the times of all links between motions, and test those that stay at the part.

    retractions: two for each motion, of its start and of its end.
    edges: the edges of the motions, in any order.
    """
    setup, home = cell.setup, cell.home
    speed = options.speeds.part
    joints = np.concatenate([motion.joints[[0, -1]] for motion in motions])
    safe = np.stack([retraction.joints[-1] for retraction in retractions])
    out = np.array([retraction.time(options.speeds) for retraction in retractions])
    lengths = np.array([motion.pose_path.length.sum() for motion in motions])
    through = options.speeds.time_tool(lengths, speed)
    free = links.time_joint_motions(setup, safe[:, None], safe[None], options.speeds)
    direct = links.time_joint_motions(
        setup, joints[:, None], joints[None], options.speeds, at_part=True
    )
    edge_of = {edge.id: edge for edge in edges}
    vertices = np.concatenate([_find_vertices(motion, edge_of[motion.line]) for motion in motions])
    direct[options.lifted | ~links.find_shared_vertices(vertices, _VERTEX_MM)] = math.inf
    direct[direct >= free + out[:, None] + out[None]] = math.inf
    _bar_links(direct, motions, options.barred)
    pairs = np.argwhere(np.triu(np.isfinite(direct))).tolist()
    linked = [(joints[[a, b]], (motions[a // 2], motions[b // 2])) for a, b in pairs]
    for (a, b), verdict in zip(pairs, classify_joint_motions(cell, linked), strict=True):
        if verdict != "clear":
            direct[a, b] = direct[b, a] = direct[a, b] + PENALTIES[verdict]
    ends = links.MotionEnds(joints, safe, out, free, direct, through, speed)
    to_home = links.time_joint_motions(setup, safe, home[None], options.speeds)
    size = len(joints) + 1
    tested = TestedLinks(*np.zeros((3, size, size), dtype=bool))
    at_part = links.find_links_at_part(ends)
    problem = RouteProblem(cell, tuple(motions), tuple(retractions), ends, at_part, to_home, tested)
    detours = {end: out.via for end, out in enumerate(retractions) if len(out.via)}
    return with_detours(problem, detours, options.speeds)


def _find_vertices(motion: EdgeMotion, edge: Line) -> FloatArray:
    """(2, 3) start and end of the edge as the motion runs it, NaN if the motion ends before."""
    ends = edge.points[[-1, 0] if motion.backwards else [0, -1]].copy()
    ends[np.array(motion.trimmed) != 0] = np.nan
    return np.asarray(ends)


def _bar_links(
    direct: FloatArray, motions: Sequence[EdgeMotion], barred: frozenset[frozenset[str]]
) -> None:
    ends_of = {motion.id: slice(2 * k, 2 * k + 2) for k, motion in enumerate(motions)}
    for pair in barred:
        if pair <= ends_of.keys():
            first, second = map(ends_of.__getitem__, pair)
            direct[first, second] = direct[second, first] = math.inf


def with_detours(
    problem: RouteProblem, detours: Mapping[int, FloatArray], speeds: LinkSpeeds
) -> RouteProblem:
    """The problem with detours (K, J) from ends of motions to home, which count as tested."""
    out, to_home, tested = list(problem.out), problem.to_home.copy(), problem.tested
    for end, via in detours.items():
        out[end] = replace(out[end], via=via)
        joints = np.concatenate([out[end].joints[-1:], via, problem.cell.home[None]])
        seconds = links.time_joint_motions(problem.cell.setup, joints[:-1], joints[1:], speeds)
        to_home[end] = float(seconds.sum())
        tested.clear[end, -1] = tested.clear[-1, end] = True
        tested.blocked[end, -1] = tested.blocked[-1, end] = False
        tested.near[end, -1] = tested.near[-1, end] = False
    return replace(problem, out=tuple(out), to_home=to_home)


def without_motions(problem: RouteProblem, left_out: set[int]) -> RouteProblem:
    """The problem without some motions, with the test results of the others."""
    kept = sorted(set(range(len(problem.motions))) - left_out)
    rows = np.add.outer(2 * np.array(kept), [0, 1]).ravel()
    ends, tested = problem.ends, problem.tested
    square, with_home = np.ix_(rows, rows), np.ix_([*rows, -1], [*rows, -1])
    ends = links.MotionEnds(
        joints=ends.joints[rows],
        safe=ends.safe[rows],
        out=ends.out[rows],
        free=ends.free[square],
        direct=ends.direct[square],
        through=ends.through[kept],
        speed=ends.speed,
    )
    return RouteProblem(
        cell=problem.cell,
        motions=tuple(take_rows(problem.motions, kept)),
        out=tuple(take_rows(problem.out, rows)),
        ends=ends,
        at_part=links.find_links_at_part(ends),
        to_home=problem.to_home[rows],
        tested=TestedLinks(
            tested.blocked[with_home], tested.clear[with_home], tested.near[with_home]
        ),
    )


# Collision tests.


def classify_joint_motions(
    cell: RouteCell, tests: Sequence[tuple[FloatArray, tuple[EdgeMotion, ...]]]
) -> list[Verdict]:
    """The verdict on each joint motion.

    A motion is near if its clearance is below the margin and below that of both its ends.

    tests: one for each motion, its joint values (2, J) at both ends and the edge motions it links.
    """
    if not tests:
        return []
    fractions = np.linspace(0.0, 1.0, _FIRST_SAMPLES)[:, None]
    samples = np.stack([(1 - fractions) * rows[0] + fractions * rows[1] for rows, _ in tests])
    clear = np.asarray(cell.setup.clear(samples.reshape(-1, samples.shape[-1])))
    all_clear = np.asarray(clear.reshape(samples.shape[:2]).all(axis=1))
    verdicts: list[Verdict] = np.where(all_clear, "clear", "blocked").tolist()
    clear_tests = np.flatnonzero(all_clear).tolist()
    for space in cell.spaces:
        chosen = [k for k in clear_tests if cell.space_of(*tests[k][1]) is space]
        results = space.look([SampledMotion(tests[k][0]) for k in chosen])
        for k, result in zip(chosen, results, strict=True):
            if isinstance(result, Blockage):
                verdicts[k] = "blocked"
            elif (
                result < space.margin
                and result < space.gaps(tests[k][0]).min() - _CLEARANCE_SLACK_MM
            ):
                verdicts[k] = "near"
    return verdicts


def examine_links(problem: RouteProblem, pairs: set[tuple[int, int]]) -> bool:
    """Test the free motions between pairs of ends, -1 for home; True if one collides or is near.

    Pairs that were tested before are left out. The results are added to `problem.tested`.
    """
    tested, safe, motions = problem.tested, problem.ends.safe, problem.motions
    untested = [pair for pair in sorted(pairs) if not (tested.clear[pair] or tested.blocked[pair])]
    tests: list[tuple[FloatArray, tuple[EdgeMotion, ...]]] = []
    for a, b in untested:
        if b < 0:
            tests.append((np.stack([safe[a], problem.cell.home]), (motions[a // 2],)))
        else:
            tests.append((safe[[a, b]], (motions[a // 2], motions[b // 2])))
    verdicts = classify_joint_motions(problem.cell, tests)
    for (a, b), verdict in zip(untested, verdicts, strict=True):
        tested.blocked[a, b] = tested.blocked[b, a] = verdict == "blocked"
        tested.clear[a, b] = tested.clear[b, a] = verdict != "blocked"
        tested.near[a, b] = tested.near[b, a] = verdict == "near"
    return any(verdict != "clear" for verdict in verdicts)


def examine_links_home(problem: RouteProblem) -> None:
    """Test the motions from all ends to home."""
    examine_links(problem, set(product(range(len(problem.to_home)), [-1])))


def examine_tour(problem: RouteProblem, order: matrix.Order, first: IntArray) -> bool:
    """Test the free motions of a tour; True if one collides or comes near."""
    states = list_states(order)
    pairs = {(states[0][0], -1), (states[-1][1], -1)}
    for (_, a), (b, _) in pairwise(states):
        if first[a, b] == links.FREE:
            pairs.add((max(a, b), min(a, b)))
        elif first[a, b] == links.BY_HOME:
            pairs |= {(a, -1), (b, -1)}
    return examine_links(problem, pairs)


# Times and orders.


def list_states(order: matrix.Order) -> list[tuple[int, int]]:
    """For each motion in order, the end at which it is entered and the end at which it is left."""
    return [(2 * i + back, 2 * i + 1 - back) for i, back in zip(*order, strict=True)]


def time_links(
    problem: RouteProblem, *, only_tested: bool
) -> tuple[FloatArray, IntArray, FloatArray]:
    """The result of `links.choose_links`, and the times (2 n,) to home, s, inf if that collides.

    Near motions have a penalty. only_tested: untested motions count as blocked.
    """
    tested = problem.tested
    blocked, penalty = ~tested.clear if only_tested else tested.blocked, NEAR_PENALTY * tested.near
    home = np.where(blocked[:-1, -1], math.inf, problem.to_home + penalty[:-1, -1])
    ends = replace(problem.ends, free=problem.ends.free + penalty[:-1, :-1])
    return *links.choose_links(ends, problem.at_part, blocked[:-1, :-1], home), home


def round_to_ticks(seconds: FloatArray) -> FloatArray:
    """Times whose sums are exact in any order.

    Tours of the same links then take exactly the same time, so the choice between them does not
    depend on the last bit, in which processors differ.
    """
    return np.asarray(np.rint(seconds / _TICK) * _TICK)


def remove_penalty(seconds: float) -> float:
    """The time of a tour without the penalties of near links."""
    return math.fmod(seconds, NEAR_PENALTY) if math.isfinite(seconds) else seconds
