"""The order of the paths of a plan: as drawn, the nearest next one, or a search that begins with that.

The nearest next one ("Following a continuous path", section 3.1):

from where the tool is, the nearest start comes next. An open path may begin at either end, a closed one at any point
of any of its segments: the paper takes vertices only, but with long lines and arcs most of the gain is between them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from camgen.paths import ToolPath, Tour
from camgen.tour_search import Choices, looks, lower_bound, sampled, searched
from camgen.tour_start import ends_of, reversed_each, starting_at, starting_each
from camgen.tour_tree import Starts, Tree, starts

__all__ = ["order", "starting_at", "travel"]

#: The methods and what the summary calls them.
_METHODS = {"as-drawn": "as drawn", "nearest": "nearest neighbour", "best": "local search"}


def order(
    paths: Sequence[ToolPath],
    method: str,
    start: tuple[float, float] | None,
    inside_first: bool,
    seconds: float = 0.0,
    seed: int = 0,
) -> Tour:
    """The paths in the order in which they are run, each once.

    method: "as-drawn" keeps the order and the paths as they are, whatever ``inside_first`` says; "nearest" takes the
    nearest next start; "best" shortens that by a search. start: x, y (work frame, mm) where the tool comes from and
    goes back to; without it the leftmost start is the first of "nearest". inside_first: a path is run after all the
    paths that it encloses. seconds: budget of the search in seconds of its compiled form, counted in looks at a path
    and not by a clock; 0: a short one, none for thousands of paths. seed: of its shuffles. Distances are measured in
    the plane, and arcs are taken to lie in it. ``parent`` keeps the index in ``paths`` as given. ValueError for another
    method, or parents that enclose each other.
    """
    if method not in _METHODS:
        raise ValueError(f"unknown method {method!r}")
    if not paths:
        return Tour((), 0.0, _METHODS[method], 0.0)
    where = starts(paths)
    known = sampled(paths, where, inside_first)
    budget = looks(seconds, len(paths))
    arranged = list(paths)
    if method != "as-drawn":
        first = _nearest_neighbour(paths, where, start, inside_first)
        arranged = _arranged(paths, first)
        if method == "best" and not budget:
            method = "nearest"
        if method == "best" and len(paths) > 1:
            better = _arranged(paths, searched(known, first, start, budget, seed))
            # A short search from samples may end above the first tour, whose starts lie anywhere.
            arranged = min(arranged, better, key=lambda tour: travel(tour, start))
    length = travel(arranged, start)
    return Tour(tuple(arranged), length, _METHODS[method], lower_bound(known, start, length, seconds))


def travel(paths: Sequence[ToolPath], start: tuple[float, float] | None) -> float:
    """Distance in the plane, mm, from each path's end to the next one's start, from and back to ``start`` if given."""
    if not paths:
        return 0.0
    begins, ends = ends_of(paths)
    gaps = begins[1:] - ends[:-1]
    if start is not None:
        gaps = np.concatenate([gaps, begins[:1] - start, ends[-1:] - start])
    return math.fsum(np.hypot(gaps[:, 0], gaps[:, 1]).tolist())


def _nearest_neighbour(
    paths: Sequence[ToolPath], where: Starts, start: tuple[float, float] | None, inside_first: bool
) -> Choices:
    tree = Tree(where)
    waits = _enclosed(paths) if inside_first else [0] * len(paths)
    for index, count in enumerate(waits):
        if count:
            tree.remove(index)
    begins, ends = (column.tolist() for column in ends_of(paths))
    path_of, row_of = where.path.tolist(), where.row.tolist()
    chosen = Choices([], [0] * len(paths), [0.0] * len(paths))
    if start is None:
        number, x, y = where.leftmost([not count for count in waits])
    else:
        x, y = start
        number = tree.nearest(x, y)
    while number >= 0:
        index, row = path_of[number], row_of[number]
        fraction, x, y = tree.project(number, x, y)
        chosen.order.append(index)
        chosen.row[index], chosen.fraction[index] = row, fraction
        if not paths[index].closed:
            x, y = begins[index] if row else ends[index]
            number = where.other_end(number)
        tree.remove(index)
        parent = paths[index].parent
        if inside_first and parent >= 0:
            waits[parent] -= 1
            if not waits[parent]:
                tree.add(parent)
        number = tree.nearest(x, y, near=number)
    if len(chosen.order) != len(paths):
        raise ValueError("paths enclose each other in a circle")
    return chosen


def _enclosed(paths: Sequence[ToolPath]) -> list[int]:
    """How many paths lie directly inside each."""
    counts = [0] * len(paths)
    for path in paths:
        if path.parent >= 0:
            counts[path.parent] += 1
    return counts


def _arranged(paths: Sequence[ToolPath], chosen: Choices) -> list[ToolPath]:
    """The chosen paths, reversed where they begin at their end, closed ones begun where they were met."""
    loops = [i for i, path in enumerate(paths) if path.closed and len(path.position) > 1]
    turned = [i for i, path in enumerate(paths) if chosen.row[i] and not path.closed]
    begun = starting_each(
        [paths[i] for i in loops], [chosen.row[i] for i in loops], [chosen.fraction[i] for i in loops]
    )
    back = reversed_each([paths[i] for i in turned])
    result = list(paths)
    for i, path in zip([*loops, *turned], [*begun, *back], strict=True):
        result[i] = path
    return [result[i] for i in chosen.order]
