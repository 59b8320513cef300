"""Items in the plane, prepared for the local search, and the search by a budget or by a clock."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from msgspec import Struct

from camgen.geometry.nearest import Discs, IntArray, NearestItems
from camgen.geometry.ragged import (
    compute_first_rows,
    compute_offsets,
    find_run_starts,
    list_owners,
    list_range_numbers,
    mark_run_starts,
    measure_runs,
    number_rows,
)
from camgen.geometry.vectors import measure_plane_lengths
from camgen.model.pose import FloatArray
from camgen.model.tolerance import NONZERO
from camgen.order.solver import kernel, local_search, speed
from camgen.order.solver.kernel import CLOSED, Run, Scene

#: Nearest items to which moves are tried.
WIDTH = 8
#: Evaluations from which the compiled search saves more time than its start takes.
_MIN_COMPILED_EVALUATIONS = 30_000
#: Seconds by the clock from which it does, s.
_MIN_COMPILED_SECONDS = 0.2
#: Evaluations between two reports, of the plain and of the compiled search: tenths of a second.
_PAUSE = (2_000, 100_000)
#: Evaluations between two readings of the clock, of both: about 0.02 s.
_TICK = (300, 10_000)
#: The end of a search: by its budget or because nothing is left, by the clock, by an interrupt.
DONE, TIMED, STOPPED = 0, 1, 2
#: A callback that gets the used fraction of the budget, 0 to 1.
OnFraction = Callable[[float], None]


class Items(Struct, frozen=True, eq=False):
    """N items with P points.

    first: (N + 1,) index of the first point of each item. An open item has one or both of its ends,
        a closed item has samples in order along it.
    points: (P, 2) x, y, mm.
    kind: (N,) BOTH_WAYS, ONE_WAY or CLOSED of ``kernel``.
    step: (N,) largest distance of neighbouring samples along a closed item, mm.
    parent: (N,) item that comes later, -1 for none.
    rank: (N,) items of a lower rank come first.
    """

    first: IntArray
    points: FloatArray
    kind: IntArray
    step: FloatArray
    parent: IntArray
    rank: IntArray


class Start(Struct, frozen=True, eq=False):
    """A tour.

    order: (N,) items in the order in which they are run.
    enter: (N,) point at which each item is entered.
    end: end of the search for it, ``DONE``, ``TIMED`` or ``STOPPED``.
    """

    order: IntArray
    enter: IntArray
    end: int = DONE


class Problem(Struct, frozen=True, eq=False):
    """The items of a tour in the plane.

    items: the items.
    near: the nearest items of each.
    home: (2,) x, y where the tour starts and ends, mm; None for nowhere.
    """

    items: Items
    near: NearestItems
    home: FloatArray | None


class Clock(Struct, frozen=True):
    """The end of a search by the clock.

    until: time of ``time.monotonic`` at which it ends, s.
    seconds: duration of the search, s.
    """

    until: float
    seconds: float

    def left(self) -> float:
        """The remaining seconds."""
        return self.until - time.monotonic()

    def part(self) -> float:
        """The used fraction of the time, 0 to 1."""
        return min(max(1 - self.left() / self.seconds, 0.0), 1.0)


def make_discs(items: Items) -> Discs:
    """Discs that cover all points of the items, one for each end of an open item."""
    count = np.diff(items.first)
    owner = list_owners(count)
    loop = (items.kind == CLOSED) & (count > 1)
    lone = ~loop[owner]
    centre = [items.points[lone]]
    owners = [owner[lone]]
    radius = [np.zeros(int(lone.sum()))]
    loops = np.flatnonzero(loop)
    if len(loops):
        # A disc is not much larger than the usual room of an item.
        number, stretch = _divide_into_sections(items, loops)
        firsts = find_run_starts(stretch)
        points = items.points[number]
        low, high = np.minimum.reduceat(points, firsts), np.maximum.reduceat(points, firsts)
        middle = (low + high) / 2
        owner_of_point = list_owners(measure_runs(stretch))
        distance_from_middle = measure_plane_lengths(points - middle[owner_of_point])
        item = owner[number[firsts]]
        centre.append(middle)
        owners.append(item)
        # A point between two samples is within half a step of one of them.
        radius.append(np.maximum.reduceat(distance_from_middle, firsts) + items.step[item] / 2)
    return Discs(np.concatenate(owners), np.concatenate(centre), np.concatenate(radius))


def split_ends(items: Items, discs: Discs) -> tuple[Discs, IntArray]:
    """The discs with both ends of an open item as owners, and the first owner of each item."""
    closed = items.kind == CLOSED
    first = compute_first_rows(np.where(closed, 1, 2))
    ends = ~closed[discs.owner]
    owner = first[discs.owner]
    # The two ends of an open item follow each other.
    owner[ends] += ~mark_run_starts(discs.owner[ends])
    return Discs(owner, discs.centre, discs.radius), first


def _divide_into_sections(items: Items, loops: IntArray) -> tuple[IntArray, IntArray]:
    """The samples of the closed items `loops`, and the section of each, in increasing order."""
    low, high = items.points.min(axis=0), items.points.max(axis=0)
    distance = float(
        np.sqrt(max(np.prod(high - low), (high - low).max() ** 2 / 100) / len(items.kind))
    )
    count = np.diff(items.first)[loops]
    owner = list_owners(count)
    number = list_range_numbers(items.first[loops], count)
    lengths = count * items.step[loops]
    parts = np.where(lengths > 4 * distance, np.ceil(lengths / max(distance, NONZERO)), 1.0)
    parts = np.minimum(parts, count).astype(np.int64)
    stretch = number_rows(count) * parts[owner] // count[owner] + compute_first_rows(parts)[owner]
    return number, stretch


def shorten_tour(
    problem: Problem,
    start: Start,
    budget: int,
    seed: int,
    on_progress: OnFraction | None = None,
    clock: Clock | None = None,
) -> Start:
    """The tour `start` shortened within `budget` evaluations of an item.

    Equal arguments give equal tours, compiled or not, unless a clock ends the search.

    start: a tour that keeps the parents and ranks of the items.
    seed: seed of the perturbations.
    on_progress: callback that gets the used fraction of the budget, 0 to 1. A KeyboardInterrupt
        then stops the search, and the result is the best tour so far.
    clock: end of the search, None for the budget alone.
    """
    items = problem.items
    scene, run = _make_scene(problem, start, seed)
    search: speed.Search = local_search.search
    compiled = (
        budget >= _MIN_COMPILED_EVALUATIONS
        if clock is None
        else clock.seconds >= _MIN_COMPILED_SECONDS
    ) and speed.available()
    pause = _PAUSE[compiled] if clock is None else _TICK[compiled] + len(run.ring) // 10
    # An interrupt may come in the middle of a move: the result is the tour before it.
    ring, enter = run.ring[:], run.enter[:]
    try:
        if compiled:
            if on_progress is not None:
                on_progress(0.0)
            search, scene, run, loaded = _compile(scene, run, budget)
            clock = clock and Clock(clock.until + loaded, clock.seconds)
        while not local_search.is_done(scene, run, budget):
            search(scene, run, budget, budget if on_progress is None and clock is None else pause)
            if local_search.is_done(scene, run, budget):
                break
            if clock is not None and clock.left() <= 0 and run.marks[kernel.WORK] >= len(run.ring):
                return _as_start(items, run.ring, run.enter, TIMED)
            if on_progress is not None:
                ring, enter = np.array(run.ring), np.array(run.enter)  # type: ignore[assignment]
                on_progress(run.marks[kernel.WORK] / budget if clock is None else clock.part())
    except KeyboardInterrupt:
        if on_progress is None:
            raise
        return _as_start(items, ring, enter, STOPPED)
    return _as_start(items, run.ring, run.enter)


def _compile(scene: Scene, run: Run, budget: int) -> tuple[speed.Search, Scene, Run, float]:
    """The compiled search, problem and tour as arrays, and the seconds that loading took."""
    begun = time.monotonic()
    scene, run = speed.to_arrays(scene, run)
    search = speed.compile_search()
    search(scene, run, budget, 0)
    return search, scene, run, time.monotonic() - begun


def _as_start(items: Items, ring: list[int], enter: list[int], end: int = DONE) -> Start:
    count = len(items.kind)
    begin = int(np.flatnonzero(np.asarray(ring) == count)[0])
    order = np.concatenate([ring[begin + 1 :], ring[:begin]]).astype(np.int64)
    return Start(order, np.asarray(enter)[:count], end)


def _make_scene(problem: Problem, start: Start, seed: int) -> tuple[Scene, Run]:
    """The problem and its first tour as lists; home is the last item and the first in the ring."""
    items, home = problem.items, problem.home
    count, points = len(items.kind), len(items.points)
    place = np.zeros((1, 2)) if home is None else np.asarray(home, dtype=np.float64)[None, :]
    xy = np.concatenate([items.points, place])
    table, min_cost = problem.near.table(count, WIDTH)
    table, min_cost = add_home(items, xy[-1], table, min_cost, home is None)
    children = np.argsort(items.parent, kind="stable")
    children = children[np.sort(items.parent) >= 0]
    counts = np.bincount(items.parent[items.parent >= 0], minlength=count + 1)
    directed = bool(
        (items.kind == kernel.ONE_WAY).any()
        or (items.parent >= 0).any()
        or len(np.unique(items.rank)) > 1
    )
    scene = Scene(
        x=xy[:, 0].tolist(),
        y=xy[:, 1].tolist(),
        first=[*items.first.tolist(), points + 1],
        kind=[*items.kind.tolist(), CLOSED],
        step=[*items.step.tolist(), 1.0],
        near=table.reshape(-1).tolist(),
        min_cost=min_cost.reshape(-1).tolist(),
        width=WIDTH,
        parent=[*items.parent.tolist(), -1],
        children=compute_offsets(counts).tolist(),
        child=children.tolist() or [0],
        rank=[*items.rank.tolist(), 0],
        nowhere=points if home is None else -1,
        directed=directed,
        table=[],
        least=kernel.EPS,
        longest=min(local_search.LONGEST_SHUFFLED, count // 2),
        shuffles=local_search.ENDLESS,
        newest_first=False,
    )
    ring = np.concatenate([[count], start.order])
    leave = np.where(items.kind == CLOSED, start.enter, sum_ends(items) - start.enter)
    run = Run(
        ring=ring.tolist(),
        place=np.argsort(ring).tolist(),
        enter=[*start.enter.tolist(), points],
        leave=[*leave.tolist(), points],
        queue=ring.tolist(),
        waits=[1] * (count + 1),
        log=[0] * (5 * local_search.LOG),
        marks=[count + 1, 0, 0, 0, 0, seed & 0xFFFFFFFF, 0, 0],
    )
    return scene, run


def sum_ends(items: Items) -> IntArray:
    """The sum of the first and the last point of each item: less one end it is the other end."""
    return items.first[:-1] + items.first[1:] - 1


def add_home(
    items: Items, home: FloatArray, table: IntArray, distance: FloatArray, nowhere: bool
) -> tuple[IntArray, FloatArray]:
    """The table of near items with a row for home, which is empty for a home that is nowhere."""
    count = len(items.kind)
    near, far = np.full((1, WIDTH), -1), np.full((1, WIDTH), np.inf)
    if not nowhere and count:
        gap = np.minimum.reduceat(
            np.sqrt(((items.points - home) ** 2).sum(axis=1)), items.first[:-1]
        )
        order = np.argsort(gap, kind="stable")[:WIDTH]
        near[0, : len(order)], far[0, : len(order)] = order, gap[order]
    return np.concatenate([table, near]), np.concatenate([distance, far])
