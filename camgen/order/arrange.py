"""Orders the paths of a plan: as drawn, by the nearest neighbour, or by a search that starts there.

Nearest neighbour ("Following a continuous path", section 3.1): the nearest start to the tool comes
next. An open path may begin at either end, a closed one at any point of its segments. The paper
takes vertices alone, but with long lines and arcs most of the gain is between them.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.model.errors import JobError
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


class TourSettings(Struct, frozen=True):
    """The settings of a tour.

    method: "as-drawn" keeps the order and the paths, whatever `inside_first` is; "nearest" takes
        the nearest start next; "best" shortens that by a search.
    start: x, y in the work frame where the tool starts and ends, mm; None for nowhere: then the
        leftmost start is the first of "nearest".
    inside_first: whether a path is run after all paths that it encloses.
    seconds: duration of the search by the clock, s, in which every path is evaluated at least once;
        0 for a number of evaluations, so that the search is the same on every machine.
    seed: seed of the perturbations.
    layers: layers in the order in which they are run; others come last.
    seam: "any" for a start anywhere on a closed path, "smooth" for one off its corners.
    order: contours that come first; the ranks of `layers` come after them.
    """

    method: str
    start: tuple[float, float] | None
    inside_first: bool
    seconds: float = 0.0
    seed: int = 0
    layers: Sequence[str] = ()
    seam: str = "any"
    order: Sequence[str] = ()


def order_paths(
    paths: Sequence[ToolPath], settings: TourSettings, on_progress: OnFraction | None = None
) -> Tour:
    """The paths in the order in which they are run, each once.

    Distances and arcs are those in the plane. `parent` of a path remains the index in `paths`.
    Raises JobError if `TourSettings.order` has a path before one that it encloses, against
    `inside_first`, and ValueError for an unknown method, or for parents that enclose each other.

    on_progress: callback that gets the used fraction of the search, see `plane.shorten_tour`.
    """
    method, start, seconds = settings.method, settings.start, settings.seconds
    if method not in _METHODS:
        raise ValueError(f"unknown method {method!r}")
    if not paths:
        return Tour((), 0.0, _METHODS[method], 0.0)
    start_time, count = time.monotonic(), len(paths)
    where = make_starts(paths, settings.seam)
    ranks = _compute_ranks(paths, settings.layers, settings.order)
    if settings.inside_first and method != "as-drawn":
        _check_inside_first(paths, ranks, settings.order)
    later = _find_later_paths(paths, ranks) if settings.inside_first else [-1] * count
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
    if len(enclosing) > _MAX_ENCLOSING * len(paths) or len(set(ranks)) != 1:
        return False
    if any(_is_cyclic(later, path) for path in enclosing):
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
    if not paths:
        return 0.0
    begins, ends = find_ends(paths)
    gaps = begins[1:] - ends[:-1]
    if start is not None:
        gaps = np.concatenate([gaps, begins[:1] - start, ends[-1:] - start])
    return math.fsum(np.hypot(gaps[:, 0], gaps[:, 1]).tolist())


def _compute_ranks(
    paths: Sequence[ToolPath], layers: Sequence[str], order: Sequence[str]
) -> list[int]:
    """The rank of each path: the place of its first contour in `order`, otherwise of its layer."""
    of_layer = find_first_places(layers)
    of_contour = {name: place for place, name in enumerate(order)}
    ranks = []
    for path in paths:
        rank = len(order) + of_layer.get(path.layer, len(layers))
        named = [of_contour[name] for name in path.contours if name in of_contour]
        ranks.append(min(named, default=rank))
    return ranks


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


def _find_later_paths(paths: Sequence[ToolPath], ranks: Sequence[int]) -> list[int]:
    """For each path the nearest one around it of its own rank, which comes later; -1 for none.

    Between ranks the order of layers decides, even if an outer path comes before an inner one.
    """
    later = []
    for path, rank in zip(paths, ranks, strict=True):
        parent, steps = path.parent, 0
        while parent >= 0 and ranks[parent] != rank and steps < len(paths):
            parent, steps = paths[parent].parent, steps + 1
        later.append(parent)
    return later


def make_rules(
    paths: Sequence[ToolPath],
    arranged: Sequence[ToolPath],
    inside_first: bool,
    layers: Sequence[str],
    order: Sequence[str] = (),
) -> Rules:
    """The precedence of the paths `arranged`, which may be some of `paths`."""
    ranks = _compute_ranks(paths, layers, order)
    later = _find_later_paths(paths, ranks) if inside_first else [-1] * len(paths)
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


class _NearestWalk(Struct, frozen=True, eq=False):
    """A walk from each path to the nearest next one.

    paths: the paths.
    where: their starts.
    tree: starts of the paths that may come next, changed on the walk.
    later: the path that comes after each path, or -1.
    ranks: rank of each path.
    waits: number of paths that have to come before each one, changed on the walk.
    begins, ends: x, y of each path's ends, mm.
    chosen: the order so far, changed on the walk.
    """

    paths: Sequence[ToolPath]
    where: Starts
    tree: StartTree
    later: Sequence[int]
    ranks: Sequence[int]
    waits: list[int]
    begins: list[tuple[float, float]]
    ends: list[tuple[float, float]]
    chosen: Choices


def _find_nearest_order(
    paths: Sequence[ToolPath],
    where: Starts,
    start: tuple[float, float] | None,
    later: Sequence[int],
    ranks: Sequence[int],
) -> Choices:
    """The order by the nearest neighbour, rank by rank, of paths with nothing left inside."""
    begins, ends = where.begin.tolist(), where.end.tolist()
    chosen = Choices([], [0] * len(paths), [0.0] * len(paths))
    tree = StartTree(where)
    waits = np.bincount(np.array(later) + 1, minlength=len(later) + 1)[1:].tolist()
    walk = _NearestWalk(paths, where, tree, later, ranks, waits, begins, ends, chosen)
    of_rank: dict[int, list[int]] = {rank: [] for rank in sorted(set(ranks))}
    first_rank = min(ranks)
    ready = []
    for index, rank in enumerate(ranks):
        of_rank[rank].append(index)
        ready.append(not waits[index] and rank == first_rank)
        if not ready[index]:
            tree.remove(index)
    position = where.leftmost(ready) if start is None else (tree.nearest(*start), *start)
    for rank, indices in of_rank.items():
        if rank != first_rank:
            for index in indices:
                if not waits[index]:
                    tree.add(index)
            position = (tree.nearest(*position[1:], near=position[0]), *position[1:])
        position = _walk_rank(walk, rank, position)
    if len(chosen.order) != len(paths):
        raise ValueError("paths enclose each other in a circle")
    return chosen


def _walk_rank(
    walk: _NearestWalk, rank: int, position: tuple[int, float, float]
) -> tuple[int, float, float]:
    """Run all paths of one rank from a start: its index, and x, y of the tool, mm.

    Returns the last start and position.
    """
    where, tree, chosen, waits = walk.where, walk.tree, walk.chosen, walk.waits
    path_of, row_of = where.path.tolist(), where.row.tolist()
    low, span = where.low.tolist(), where.span.tolist()
    number, x, y = position
    last = max(number, 0)
    while number >= 0:
        index, row = path_of[number], row_of[number]
        fraction, x, y = tree.project(number, x, y)
        chosen.order.append(index)
        chosen.row[index], chosen.fraction[index] = row, low[number] + fraction * span[number]
        if not walk.paths[index].closed:
            x, y = walk.begins[index] if row else walk.ends[index]
            number = where.other_end(number)
        tree.remove(index)
        parent = walk.later[index]
        if parent >= 0:
            waits[parent] -= 1
            if not waits[parent] and walk.ranks[parent] == rank:
                tree.add(parent)
        last, number = number, tree.nearest(x, y, near=number)
    return last, x, y


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
