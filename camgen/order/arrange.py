"""Orders the paths of a plan: as drawn, by the nearest neighbour, or by a search that starts there.

Nearest neighbour ("Following a continuous path", section 3.1): the nearest start to the tool comes
next. An open path may begin at either end, a closed one at any point of its segments. The paper
takes vertices alone, but with long lines and arcs most of the gain is between them.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from itertools import filterfalse, groupby

import numpy as np

from camgen.model.errors import JobError
from camgen.model.job import TourTable
from camgen.model.path import PLAIN, ToolPath, Tour
from camgen.model.sequences import find_first_places, take_rows
from camgen.order.proven import MAX_PROVEN_PATHS, improve_few, is_proven
from camgen.order.search import (
    Choices,
    compute_lower_bound,
    is_bound_affordable,
    is_compiled,
    is_crowd,
    is_large,
    sample_paths,
    search_tour,
)
from camgen.order.solver.matrix import Rules
from camgen.order.solver.plane import DONE, STOPPED, TIMED, Clock, OnFraction
from camgen.order.starts import Starts, make_starts
from camgen.order.tree import StartTree
from camgen.plan.starting import find_ends, move_each_start, reverse_each

#: The methods, and their names in the summary.
_METHODS = {"as-drawn": "as drawn", "nearest": "nearest neighbour", "best": "local search"}

#: Fraction of the paths that may enclose others if a greedy tour is to be a good start.
_MAX_ENCLOSING = 0.001


def order_paths(
    paths: Sequence[ToolPath],
    settings: TourTable,
    start: tuple[float, float] | None,
    inside_first: bool,
    on_progress: OnFraction | None = None,
) -> Tour:
    """The paths in the order in which they are run, each once.

    Distances and arcs are those in the plane. `parent` of a path remains the index in `paths`.
    Raises JobError if `tour.order` has a path before one that it encloses, against `inside_first`,
    and ValueError for an unknown method, or for parents that enclose each other.

    settings: method "as-drawn" keeps the order and the paths, whatever `inside_first` is; "nearest"
        takes the nearest start next; "best" shortens that by a search. In `seconds` by the clock
        every path is evaluated at least once. The ranks of `layers` come after those of `order`.
    start: x, y in the work frame where the tool starts and ends, mm; None for nowhere: then the
        leftmost start is the first of "nearest".
    inside_first: whether a path is run after all paths that it encloses.
    on_progress: callback that gets the used fraction of the search, see `plane.shorten_tour`.
    """
    method, seconds = settings.method, settings.seconds
    if method not in _METHODS:
        raise ValueError(f"unknown method {method!r}")
    if not paths:
        return Tour((), 0.0, _METHODS[method], 0.0)
    start_time, count = time.monotonic(), len(paths)
    where = make_starts(paths, settings.seam)
    ranks = list(_compute_ranks(paths, settings))
    if inside_first and method != "as-drawn":
        _check_inside_first(paths, ranks, settings.order)
    later = list(_find_later_paths(paths, ranks)) if inside_first else [-1] * count
    searched = method == "best" and count > 1
    has_bound = is_bound_affordable(seconds, count)
    sampled = sample_paths(paths, where, later, ranks) if searched or has_bound else None
    ordered = take_rows(paths, sorted(range(count), key=ranks.__getitem__))
    chosen, end = None, DONE
    starts_greedy = searched and is_crowd(count) and is_free(paths, later, ranks)
    if method != "as-drawn" and not starts_greedy:
        chosen = _find_nearest_order(paths, where, start, later, ranks)
        ordered = _run_paths(paths, chosen)
    if searched and sampled:
        clock = Clock(start_time + seconds, seconds) if seconds else None
        solution = search_tour(sampled, chosen, start, settings.seed, on_progress, clock)
        end = solution.end
        better = _run_paths(paths, solution)
        # A short search over samples may end above the first tour, whose starts are anywhere.
        if not chosen or measure_travel(better, start) < measure_travel(ordered, start):
            ordered, chosen = better, solution
    length, bound = measure_travel(ordered, start), None
    if sampled and chosen and method == "best" and count <= MAX_PROVEN_PATHS:
        proven, bound = improve_few(sampled, chosen, start)
        candidates = [ordered, _run_paths(paths, proven)]
        ordered = min(candidates, key=lambda tour: measure_travel(tour, start))
        length, end = measure_travel(ordered, start), DONE
    if sampled and has_bound and (bound is None or not is_proven(length, bound)):
        bound_seconds = 0.0 if end == STOPPED else seconds
        bound = max(bound or 0.0, compute_lower_bound(sampled, start, length, bound_seconds))
    kind = _METHODS[method] + (_describe_search(seconds, count) if searched else "")
    return Tour(tuple(ordered), length, kind, bound, stopped=end == STOPPED, timed=end == TIMED)


def _describe_search(seconds: float, count: int) -> str:
    """The duration or the kind of the search, if its result is not the same on every machine."""
    if seconds:
        return f" of {seconds:g} s"
    if not is_large(count):
        return ""
    return ", compiled" if is_compiled(count) else f", {PLAIN}"


def is_free(paths: Sequence[ToolPath], later: Sequence[int], ranks: Sequence[int]) -> bool:
    """Whether a greedy tour is a good start.

    Each path may be reversed, all have one rank, and only a few, such as the outline of a sheet,
    have to come after others. later: result of `_find_later_paths`.
    """
    enclosing = set(later) - {-1}
    if (
        len(enclosing) > _MAX_ENCLOSING * len(paths)
        or len(set(ranks)) != 1
        or any(_is_cyclic(later, path) for path in enclosing)
    ):
        return False
    return all(path.closed or path.reversible for path in paths)


def _is_cyclic(later: Sequence[int], path: int) -> bool:
    for _ in range(len(later)):
        path = later[path]
        if path < 0:
            return False
    return True


def measure_travel(paths: Sequence[ToolPath], start: tuple[float, float] | None) -> float:
    """Length of the links in the plane, from and to `start` if that is given, mm."""
    begins, ends = find_ends(paths)
    gaps = begins[1:] - ends[:-1]
    if start is not None:
        gaps = np.concatenate([gaps, begins[:1] - start, ends[-1:] - start])
    return math.fsum(np.hypot(gaps[:, 0], gaps[:, 1]).tolist())


def _compute_ranks(paths: Sequence[ToolPath], settings: TourTable) -> Iterator[int]:
    """The rank of each path: the place of its first contour in `order`, otherwise of its layer."""
    of_layer = find_first_places(settings.layers)
    of_contour = {name: place for place, name in enumerate(settings.order)}
    for path in paths:
        rank = len(settings.order) + of_layer.get(path.layer, len(settings.layers))
        named = [of_contour[name] for name in path.contours if name in of_contour]
        yield min(named, default=rank)


def _check_inside_first(
    paths: Sequence[ToolPath], ranks: Sequence[int], order: Sequence[str]
) -> None:
    for path, rank in zip(paths, ranks, strict=True):
        parent, steps = path.parent, 0
        while parent >= 0 and steps < len(paths):
            if ranks[parent] < rank and ranks[parent] < len(order):
                what = (
                    f"{order[ranks[parent]]} would be run before path {path.id}, "
                    "which lies inside it or comes first"
                )
                remedy = "put the inner path first, or set operation.inside_first = false"
                raise JobError("job", what, "tour.order", remedy)
            parent, steps = paths[parent].parent, steps + 1


def _find_later_paths(paths: Sequence[ToolPath], ranks: Sequence[int]) -> Iterator[int]:
    """For each path the nearest one around it of its own rank, which comes later; -1 for none.

    Between ranks the order of layers decides, even if an outer path comes before an inner one.
    """
    for path, rank in zip(paths, ranks, strict=True):
        parent, steps = path.parent, 0
        while parent >= 0 and ranks[parent] != rank and steps < len(paths):
            parent, steps = paths[parent].parent, steps + 1
        yield parent


def make_rules(
    paths: Sequence[ToolPath],
    arranged: Sequence[ToolPath],
    settings: TourTable,
    inside_first: bool,
) -> Rules:
    """The precedence of the paths `arranged`, which may be some of `paths`."""
    ranks = list(_compute_ranks(paths, settings))
    later = list(_find_later_paths(paths, ranks)) if inside_first else [-1] * len(paths)
    place = {path.id: k for k, path in enumerate(arranged)}
    index_of = {path.id: k for k, path in enumerate(paths)}
    parents, arranged_ranks = [], []
    for path in arranged:
        parent = later[index_of[path.id]]
        while parent >= 0 and paths[parent].id not in place:
            parent = later[parent]
        parents.append(place[paths[parent].id] if parent >= 0 else -1)
        arranged_ranks.append(ranks[index_of[path.id]])
    return Rules(np.array(parents, dtype=np.int64), np.array(arranged_ranks, dtype=np.int64))


def _find_nearest_order(
    paths: Sequence[ToolPath],
    where: Starts,
    start: tuple[float, float] | None,
    later: Sequence[int],
    ranks: Sequence[int],
) -> Choices:
    """The order by the nearest neighbour, rank by rank, of paths with nothing left inside."""
    begins, ends = where.begin.tolist(), where.end.tolist()
    path_of, row_of = where.path.tolist(), where.row.tolist()
    low, span = where.low.tolist(), where.span.tolist()
    chosen = Choices([], [0] * len(paths), [0.0] * len(paths))
    # The starts of the paths that may come next.
    tree = StartTree(where)
    # For each path the number of paths that have to come before it.
    waits = np.bincount(np.array(later) + 1, minlength=len(later) + 1)[1:].tolist()

    def walk_rank(rank: int, number: int, x: float, y: float) -> tuple[int, float, float]:
        """Run all paths of one rank from a start with the tool at x, y; returns the last start."""
        last = max(number, 0)
        while number >= 0:
            index, row = path_of[number], row_of[number]
            fraction, x, y = tree.project(number, x, y)
            chosen.order.append(index)
            chosen.row[index], chosen.fraction[index] = row, low[number] + fraction * span[number]
            if not paths[index].closed:
                x, y = begins[index] if row else ends[index]
                number = where.other_end(number)
            tree.remove(index)
            parent = later[index]
            if parent >= 0:
                waits[parent] -= 1
                if not waits[parent] and ranks[parent] == rank:
                    tree.add(parent)
            last, number = number, tree.nearest(x, y, near=number)
        return last, x, y

    by_rank = groupby(sorted(range(len(paths)), key=ranks.__getitem__), ranks.__getitem__)
    first_rank, _ = next(by_rank)
    is_ready = (np.array(ranks) == first_rank) & (np.array(waits) == 0)
    for index in np.flatnonzero(~is_ready).tolist():
        tree.remove(index)
    position = where.leftmost(is_ready) if start is None else (tree.nearest(*start), *start)
    number, x, y = walk_rank(first_rank, *position)
    for rank, indices in by_rank:
        for index in filterfalse(waits.__getitem__, indices):
            tree.add(index)
        number, x, y = walk_rank(rank, tree.nearest(x, y, near=number), x, y)
    if len(chosen.order) != len(paths):
        raise ValueError("paths enclose each other in a circle")
    return chosen


def _run_paths(paths: Sequence[ToolPath], chosen: Choices) -> list[ToolPath]:
    """The chosen paths, open ones reversed and closed ones rotated to their starts."""
    moved = np.flatnonzero(chosen.row).tolist()
    loops = [i for i in moved if paths[i].closed]
    reversed_open = [i for i in moved if not paths[i].closed]
    rows, fractions = take_rows(chosen.row, loops), take_rows(chosen.fraction, loops)
    rotated = move_each_start(take_rows(paths, loops), rows, fractions)
    back = reverse_each(take_rows(paths, reversed_open))
    result = list(paths)
    for i, path in zip([*loops, *reversed_open], [*rotated, *back], strict=True):
        result[i] = path
    return take_rows(result, chosen.order)
