"""The order of the paths of a plan: as drawn, the nearest next one, or a search that begins with that.

The nearest next one ("Following a continuous path", section 3.1):

from where the tool is, the nearest start comes next. An open path may begin at either end, a closed one at any point
of any of its segments: the paper takes vertices only, but with long lines and arcs most of the gain is between them.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.model.errors import JobError
from camgen.model.path import PLAIN, ToolPath, Tour
from camgen.order.proven import FEW, improve_few, is_proven
from camgen.order.search import (
    Choices,
    is_bound_worth,
    is_compiled,
    is_crowd,
    is_large,
    lower_bound,
    sample_paths,
    search,
)
from camgen.order.solver.matrix import Rules
from camgen.order.solver.plane import DONE, STOPPED, TIMED, Clock, Tell
from camgen.order.starts import Starts, starts
from camgen.order.tree import StartTree
from camgen.plan.starting import ends_of, reverse_each, starting_each

#: The methods and what the summary calls them.
_METHODS = {"as-drawn": "as drawn", "nearest": "nearest neighbour", "best": "local search"}

#: A share of the paths: as many may be around others where a greedy tour is a good start.
_FEW_AROUND = 0.001


class Search(Struct, frozen=True):
    """The settings of a tour.

    method: "as-drawn" keeps the order and the paths, whatever ``inside_first`` says; "nearest" takes
        the nearest start next; "best" shortens that by a search.
    start: x, y in the work frame where the tool starts and ends, mm; None for nowhere: then the
        leftmost start is the first of "nearest".
    inside_first: whether a path is run after all paths that it encloses.
    seconds: duration of the search by the clock, s, in which every path is evaluated at least once;
        0 for a number of evaluations, so that the search is the same on every machine.
    seed: seed of the shuffles.
    layers: layers in the order in which they are run; others come last.
    seam: "any" for a start anywhere on a closed path, "smooth" for one off its corners.
    order: contours that come first, before ``layers`` counts.
    """

    method: str
    start: tuple[float, float] | None
    inside_first: bool
    seconds: float = 0.0
    seed: int = 0
    layers: Sequence[str] = ()
    seam: str = "any"
    order: Sequence[str] = ()


def arrange(paths: Sequence[ToolPath], settings: Search, tell: Tell | None = None) -> Tour:
    """The paths in the order in which they are run, each once.

    tell: callback that gets the used fraction of the search, 0 to 1; see ``plane.shorten``.

    Distances are measured in the plane, and arcs are taken to lie in it. ``parent`` of a path remains
    the index in ``paths``. JobError where ``Search.order`` has a path before one that it encloses,
    against ``inside_first``. ValueError for an unknown method, or for parents that enclose each other.
    """
    method, start, seconds = settings.method, settings.start, settings.seconds
    if method not in _METHODS:
        raise ValueError(f"unknown method {method!r}")
    if not paths:
        return Tour((), 0.0, _METHODS[method], 0.0)
    begun, count = time.monotonic(), len(paths)
    where = starts(paths, settings.seam)
    ranks = _ranks(paths, settings.layers, settings.order)
    if settings.inside_first and method != "as-drawn":
        _insist_inside_first(paths, ranks, settings.order)
    waits_for = _waits_for(paths, ranks) if settings.inside_first else [-1] * count
    searched = method == "best" and count > 1
    told = is_bound_worth(seconds, count)
    known = sample_paths(paths, where, waits_for, ranks) if searched or told else None
    arranged = [paths[i] for i in sorted(range(count), key=ranks.__getitem__)]
    chosen, end = None, DONE
    if method != "as-drawn" and not (
        searched and is_crowd(count) and is_free(paths, waits_for, ranks)
    ):
        chosen = _nearest_neighbour(paths, where, start, waits_for, ranks)
        arranged = _arrange(paths, chosen)
    if searched and known:
        clock = Clock(begun + seconds, seconds) if seconds else None
        found = search(known, chosen, start, settings.seed, tell, clock)
        end = found.end
        better = _arrange(paths, found)
        # A short search from samples may end above the first tour, whose starts lie anywhere.
        if not chosen or measure_travel(better, start) < measure_travel(arranged, start):
            arranged, chosen = better, found
    length, bound = measure_travel(arranged, start), None
    if known and chosen and method == "best" and count <= FEW:
        solved, bound = improve_few(known, chosen, start)
        arranged = min(
            [arranged, _arrange(paths, solved)], key=lambda tour: measure_travel(tour, start)
        )
        length, end = measure_travel(arranged, start), DONE
    if known and told and (bound is None or not is_proven(length, bound)):
        bound = max(
            bound or 0.0, lower_bound(known, start, length, 0.0 if end == STOPPED else seconds)
        )
    kind = _METHODS[method] + (_kind(seconds, count) if searched else "")
    return Tour(tuple(arranged), length, kind, bound, stopped=end == STOPPED, timed=end == TIMED)


def _kind(seconds: float, count: int) -> str:
    """Which search it was, where it is not the same one everywhere."""
    if seconds:
        return f" of {seconds:g} s"
    if not is_large(count):
        return ""
    return ", compiled" if is_compiled(count) else f", {PLAIN}"


def is_free(paths: Sequence[ToolPath], waits_for: Sequence[int], ranks: Sequence[int]) -> bool:
    """Each path may be run either way, and but for a few, such as the outline of a sheet, none has to wait for another
    one: a greedy tour is a good start.
    """
    around = {parent for parent in waits_for if parent >= 0}
    few = len(around) <= _FEW_AROUND * len(paths) and not any(
        _is_in_circle(waits_for, one) for one in around
    )
    return few and len(set(ranks)) == 1 and all(path.closed or path.reversible for path in paths)


def _is_in_circle(waits_for: Sequence[int], path: int) -> bool:
    """Whether what comes after ``path`` has no end."""
    for _ in range(len(waits_for)):
        path = waits_for[path]
        if path < 0:
            return False
    return True


def measure_travel(paths: Sequence[ToolPath], start: tuple[float, float] | None) -> float:
    """Distance in the plane, mm, from each path's end to the next one's start, from and back to ``start`` if given."""
    if not paths:
        return 0.0
    begins, ends = ends_of(paths)
    gaps = begins[1:] - ends[:-1]
    if start is not None:
        gaps = np.concatenate([gaps, begins[:1] - start, ends[-1:] - start])
    return math.fsum(np.hypot(gaps[:, 0], gaps[:, 1]).tolist())


def _ranks(paths: Sequence[ToolPath], layers: Sequence[str], order: Sequence[str]) -> list[int]:
    """The place of each path's first contour in ``order``; of others that of its layer among ``layers``, behind."""
    places = {name: place for place, name in reversed(list(enumerate(layers)))}
    behind = [len(order) + places.get(path.layer, len(layers)) for path in paths]
    if not order:
        return behind
    own = {name: place for place, name in enumerate(order)}
    return [
        min((own[name] for name in path.contours if name in own), default=rank)
        for path, rank in zip(paths, behind, strict=True)
    ]


def _insist_inside_first(
    paths: Sequence[ToolPath], ranks: Sequence[int], order: Sequence[str]
) -> None:
    """JobError where ``order`` has what is around a path before it."""
    for path, rank in zip(paths, ranks, strict=True):
        around, steps = path.parent, 0
        while around >= 0 and steps < len(paths):
            if ranks[around] < rank and ranks[around] < len(order):
                what = f"{order[ranks[around]]} would be run before path {path.id}, which lies inside it or comes first"
                remedy = "put what is inside before it, or set operation.inside_first = false"
                raise JobError("job", what, "tour.order", remedy)
            around, steps = paths[around].parent, steps + 1


def _waits_for(paths: Sequence[ToolPath], ranks: Sequence[int]) -> list[int]:
    """For each path the nearest one around it of its own rank, which comes later; -1 if there is none.

    Between ranks the order of layers decides, also where it takes what is around before what is inside.
    """
    found = []
    for path, rank in zip(paths, ranks, strict=True):
        parent, steps = path.parent, 0
        while parent >= 0 and ranks[parent] != rank and steps < len(paths):
            parent, steps = paths[parent].parent, steps + 1
        found.append(parent)
    return found


def rules_of(
    paths: Sequence[ToolPath],
    arranged: Sequence[ToolPath],
    inside_first: bool,
    layers: Sequence[str],
    order: Sequence[str] = (),
) -> Rules:
    """What comes before what, by the places of ``paths`` in ``arranged``, which may be some of them."""
    ranks = _ranks(paths, layers, order)
    waits_for = _waits_for(paths, ranks) if inside_first else [-1] * len(paths)
    place = {path.id: k for k, path in enumerate(arranged)}
    number = {path.id: k for k, path in enumerate(paths)}
    own = [number[path.id] for path in arranged]
    parents = []
    for k in own:
        parent = waits_for[k]
        while parent >= 0 and paths[parent].id not in place:
            parent = waits_for[parent]
        parents.append(place[paths[parent].id] if parent >= 0 else -1)
    return Rules(
        np.array(parents, dtype=np.int64), np.array([ranks[k] for k in own], dtype=np.int64)
    )


class _Walk(Struct, frozen=True, eq=False):
    """What a walk from path to path knows. waits_for: by path, the one that comes later, or -1. ranks: by path.

    waits: by path, how many have to come before it; that and ``tree`` and ``chosen`` change on the way. begins, ends:
    by path, x, y mm.
    """

    paths: Sequence[ToolPath]
    where: Starts
    tree: StartTree
    waits_for: Sequence[int]
    ranks: Sequence[int]
    waits: list[int]
    begins: list[tuple[float, float]]
    ends: list[tuple[float, float]]
    chosen: Choices


def _nearest_neighbour(
    paths: Sequence[ToolPath],
    where: Starts,
    start: tuple[float, float] | None,
    waits_for: Sequence[int],
    ranks: Sequence[int],
) -> Choices:
    """The nearest next path of all whose turn it is: those with nothing left inside, rank by rank."""
    begins, ends = (column.tolist() for column in (where.begin, where.end))
    chosen = Choices([], [0] * len(paths), [0.0] * len(paths))
    walk = _Walk(
        paths, where, StartTree(where), waits_for, ranks, _enclose(waits_for), begins, ends, chosen
    )
    turns = sorted(set(ranks))
    ready = [not count and rank == turns[0] for count, rank in zip(walk.waits, ranks, strict=True)]
    for index, may in enumerate(ready):
        if not may:
            walk.tree.remove(index)
    at = where.leftmost(ready) if start is None else (walk.tree.nearest(*start), *start)
    of_turn: dict[int, list[int]] = {}
    for index, rank in enumerate(ranks):
        of_turn.setdefault(rank, []).append(index)
    for turn in turns:
        if turn != turns[0]:
            for index in of_turn[turn]:
                if not walk.waits[index]:
                    walk.tree.add(index)
            at = (walk.tree.nearest(*at[1:], near=at[0]), *at[1:])
        at = _walk(walk, turn, at)
    if len(chosen.order) != len(paths):
        raise ValueError("paths enclose each other in a circle")
    return chosen


def _walk(walk: _Walk, turn: int, at: tuple[int, float, float]) -> tuple[int, float, float]:
    """All paths of one rank, from the start ``at``: its number and where the tool is; the last start and place."""
    where, tree, chosen, waits = walk.where, walk.tree, walk.chosen, walk.waits
    path_of, row_of, low, span = (
        column.tolist() for column in (where.path, where.row, where.low, where.span)
    )
    number, x, y = at
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
        parent = walk.waits_for[index]
        if parent >= 0:
            waits[parent] -= 1
            if not waits[parent] and walk.ranks[parent] == turn:
                tree.add(parent)
        last, number = number, tree.nearest(x, y, near=number)
    return last, x, y


def _enclose(waits_for: Sequence[int]) -> list[int]:
    """How many paths each one has to wait for."""
    counts = [0] * len(waits_for)
    for parent in waits_for:
        if parent >= 0:
            counts[parent] += 1
    return counts


def _arrange(paths: Sequence[ToolPath], chosen: Choices) -> list[ToolPath]:
    """The chosen paths, reversed where they begin at their end, closed ones begun where they were met."""
    loops = [i for i, path in enumerate(paths) if path.closed and chosen.row[i]]
    turned = [i for i, path in enumerate(paths) if chosen.row[i] and not path.closed]
    begun = starting_each(
        [paths[i] for i in loops],
        [chosen.row[i] for i in loops],
        [chosen.fraction[i] for i in loops],
    )
    back = reverse_each([paths[i] for i in turned])
    result = list(paths)
    for i, path in zip([*loops, *turned], [*begun, *back], strict=True):
        result[i] = path
    return [result[i] for i in chosen.order]
