"""Items in the plane made ready for the search, and the search run within a budget that knows no clock."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec import Struct

from camgen.geometry.nearest import Discs, IntArray, Near
from camgen.geometry.ragged import begins, offsets, owners, stretches
from camgen.model.pose import FloatArray
from camgen.model.tolerance import NONZERO
from camgen.order.solver import kernel, speed
from camgen.order.solver import moves as rounds
from camgen.order.solver.kernel import CLOSED, Run, Scene

__all__ = ["Items", "Start", "Tell", "discs_of", "shorten"]

#: Near items that are tried.
WIDTH = 8
#: Looks at an item above which the compiled search is worth its start, where it is installed.
_WORTH = 30_000
#: So many looks of the plain and of the compiled search, some tenths of a second, between two words on the progress.
_PAUSE = (2_000, 100_000)
#: What is told the part of the budget that is used up, 0 to 1.
Tell = Callable[[float], None]


class Items(Struct, frozen=True, eq=False):
    """N items, of which P points are known.

    first: (N + 1,) of each item's points: one or both ends of an open item, samples of a closed one, in order round it.
    points: (P, 2) mm. kind: (N,) BOTH_WAYS, ONE_WAY or CLOSED of ``kernel``. step: (N,) mm, of a closed item what two
    neighbouring samples are apart, along it, at most. parent: (N,) an item that comes later, or -1. rank: (N,) items of
    a lower rank come first.
    """

    first: IntArray
    points: FloatArray
    kind: IntArray
    step: FloatArray
    parent: IntArray
    rank: IntArray


class Start(Struct, frozen=True, eq=False):
    """A tour. order: (N,) items. enter: by item, the point where it is entered. whole: the search came to its end."""

    order: IntArray
    enter: IntArray
    whole: bool = True


def discs_of(items: Items) -> Discs:
    """Discs that cover all points of the items: each end of an open one, a closed one in stretches or as a whole."""
    count = np.diff(items.first)
    owner = np.repeat(np.arange(len(count)), count)
    loop = (items.kind == CLOSED) & (count > 1)
    lone = ~loop[owner]
    centre = [items.points[lone]]
    owners = [owner[lone]]
    radius = [np.zeros(int(lone.sum()))]
    loops = np.flatnonzero(loop)
    if len(loops):
        # So many samples in a disc that one disc is not much larger than an item's usual room.
        number, stretch = _stretches(items, loops)
        firsts = np.flatnonzero(np.concatenate([[True], stretch[1:] != stretch[:-1]]))
        lasts = np.concatenate([firsts[1:], [len(stretch)]])
        points = items.points[number]
        low, high = np.minimum.reduceat(points, firsts), np.maximum.reduceat(points, firsts)
        middle = (low + high) / 2
        which = np.repeat(np.arange(len(firsts)), lasts - firsts)
        far = np.sqrt(((points - middle[which]) ** 2).sum(axis=1))
        own = owner[number[firsts]]
        centre.append(middle)
        owners.append(own)
        # What lies between two samples is no farther from one of them than half a step.
        radius.append(np.maximum.reduceat(far, firsts) + items.step[own] / 2)
    return Discs(np.concatenate(owners), np.concatenate(centre), np.concatenate(radius))


def _stretches(items: Items, loops: IntArray) -> tuple[IntArray, IntArray]:
    """The samples of the closed items ``loops``, and for each the number of the stretch it belongs to, rising."""
    low, high = items.points.min(axis=0), items.points.max(axis=0)
    room = float(np.sqrt(max(np.prod(high - low), (high - low).max() ** 2 / 100) / len(items.kind)))
    count = np.diff(items.first)[loops]
    owner = owners(count)
    number = stretches(items.first[loops], count)
    around = count * items.step[loops]
    parts = np.where(around > 4 * room, np.ceil(around / max(room, NONZERO)), 1.0)
    parts = np.minimum(parts, count).astype(np.int64)
    place = number - items.first[loops][owner]
    stretch = place * parts[owner] // count[owner] + begins(parts)[owner]
    return number, stretch


def shorten(
    items: Items, start: Start, home: FloatArray | None, near: Near, budget: int, seed: int, tell: Tell | None = None
) -> Start:
    """The tour ``start`` shortened by ``budget`` looks at an item. home: x, y where it begins and ends, None: nowhere.

    start must keep the rules of ``items`` (parents and ranks). Equal arguments, equal tours, compiled or not. tell: is
    told now and then which part of the budget is used up; who watches may stop the search (KeyboardInterrupt), and gets
    the best tour so far.
    """
    scene, run = _make(items, start, home, near, seed)
    search: speed.Search = rounds.search
    pause = _PAUSE[0]
    if budget >= _WORTH and speed.available():
        columns = (np.array(value) if isinstance(value, list) else value for value in scene)
        scene = Scene(*columns)  # type: ignore[arg-type]
        run = Run(*(np.array(column) for column in run))  # type: ignore[arg-type]
        search, pause = speed.compile_search(), _PAUSE[1]
    if tell is None:
        search(scene, run, budget, budget)
        return _as_start(items, run.ring, run.enter)
    # An interrupt may come in the middle of a move: what is given back is the tour before it.
    ring, enter, whole = run.ring[:], run.enter[:], True
    try:
        while not rounds.is_done(run, budget):
            search(scene, run, budget, pause)
            ring, enter = np.array(run.ring), np.array(run.enter)  # type: ignore[assignment]
            if not rounds.is_done(run, budget):
                tell(run.marks[kernel.WORK] / budget)
    except KeyboardInterrupt:
        whole = False
    return _as_start(items, ring, enter, whole)


def _as_start(items: Items, ring: list[int], enter: list[int], whole: bool = True) -> Start:
    count = len(items.kind)
    begin = int(np.flatnonzero(np.asarray(ring) == count)[0])
    order = np.concatenate([ring[begin + 1 :], ring[:begin]]).astype(np.int64)
    return Start(order, np.asarray(enter)[:count], whole)


def _make(items: Items, start: Start, home: FloatArray | None, near: Near, seed: int) -> tuple[Scene, Run]:
    """The problem and its first tour as plain lists; home is the last item and the first in the ring."""
    count, points = len(items.kind), len(items.points)
    place = np.zeros((1, 2)) if home is None else np.asarray(home, dtype=np.float64)[None, :]
    xy = np.concatenate([items.points, place])
    table, apart = near.table(count, WIDTH)
    table, apart = _with_home(items, xy[-1], table, apart, home is None)
    children = np.argsort(items.parent, kind="stable")
    children = children[np.sort(items.parent) >= 0]
    counts = np.bincount(items.parent[items.parent >= 0], minlength=count + 1)
    first = np.concatenate([items.first, [points + 1]])
    rank = np.concatenate([items.rank, [0]])
    directed = bool((items.kind == kernel.ONE_WAY).any() or (items.parent >= 0).any() or len(np.unique(items.rank)) > 1)
    scene = Scene(
        x=xy[:, 0].tolist(), y=xy[:, 1].tolist(), first=first.tolist(), kind=[*items.kind.tolist(), CLOSED],
        step=[*items.step.tolist(), 1.0], near=table.reshape(-1).tolist(), apart=apart.reshape(-1).tolist(),
        width=WIDTH, parent=[*items.parent.tolist(), -1], children=offsets(counts).tolist(),
        child=children.tolist() or [0], rank=rank.tolist(), nowhere=points if home is None else -1, directed=directed,
    )  # fmt: skip
    ring = np.concatenate([[count], start.order])
    where = np.empty(count + 1, dtype=np.int64)
    where[ring] = np.arange(count + 1)
    enter = np.concatenate([start.enter, [points]])
    turned = (both_ends(items) - start.enter) if count else start.enter
    leave = np.concatenate([np.where(items.kind == CLOSED, start.enter, turned), [points]])
    run = Run(
        ring=ring.tolist(), place=where.tolist(), enter=enter.tolist(), leave=leave.tolist(), queue=ring.tolist(),
        waits=[1] * (count + 1), log=[0] * (5 * rounds.LOG), marks=[count + 1, 0, 0, 0, 0, seed & 0xFFFFFFFF, 0],
    )  # fmt: skip
    return scene, run


def both_ends(items: Items) -> IntArray:
    """The sum of the first and the last point of each item: of an open one, the other end is this less one end."""
    return items.first[:-1] + items.first[1:] - 1


def _with_home(
    items: Items, home: FloatArray, table: IntArray, apart: FloatArray, nowhere: bool
) -> tuple[IntArray, FloatArray]:
    """The table of near items with a row for home. A home that is nowhere is near to everything and to nothing."""
    count = len(items.kind)
    near, far = np.full((1, WIDTH), -1), np.full((1, WIDTH), np.inf)
    if not nowhere and count:
        gap = np.minimum.reduceat(np.sqrt(((items.points - home) ** 2).sum(axis=1)), items.first[:-1])
        order = np.argsort(gap, kind="stable")[:WIDTH]
        near[0, : len(order)], far[0, : len(order)] = order, gap[order]
    return np.concatenate([table, near]), np.concatenate([apart, far])
