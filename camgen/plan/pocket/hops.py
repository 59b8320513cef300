"""Hops: ways of a pocket over cleared ground, run at the speed of travel with a small lift.

The loops of a channel return straight over what they have cleared, and passes run through channels.
Nothing is cut there. The area that the tool's centre can reach without touching material is what
the channels sweep, less the tool's radius all around. A way in it becomes a hop of few straight
lines where these stay in the area too. Other ways, and those so short that the lift takes longer,
keep the feed: none runs along a curved wall at the speed of travel.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.ragged import owners, ramp, true_runs
from camgen.geometry.segments import (
    BoolArray,
    IntArray,
    Segments,
    concatenate,
    flatten,
    points_at,
    split,
)
from camgen.model.path import PLACES, ToolPath
from camgen.model.pose import FloatArray, frozen
from camgen.plan.pocket.chains import make_polyline
from camgen.plan.pocket.channel import Channel

#: Height of a hop above the floor of the pass, mm.
LIFT_MM = 0.3
#: On a hop the tool may overlap with material by this, mm; what polygons leave of arcs is as much.
_NEARER_MM = 0.005
#: Chords of a quarter of a circle.
_QUARTER = 32
#: Places on a pass: how far apart, as a share of the tool's radius.
_EVERY = 0.1
#: Halvings by which the end of a way over cleared ground is found.
_HALVINGS = 20
#: Chords leave the arcs of a channel by at most this, mm.
_CHORD_MM = 0.01
#: Straight ways of a hop at most, and places on a way where one may end.
_MOST_WAYS, _STOPS = 6, 48
#: A hop has to save this time at least, s.
_LEAST_S = 0.03


class Speeds(Struct, frozen=True):
    """Speeds of a job, mm/s: of cutting and of travel."""

    feed: float
    travel: float

    def saved(self, cut: float, travelled: float) -> float:
        """Seconds that a hop of ``travelled`` mm saves in place of ``cut`` mm at the feed."""
        lifts = LIFT_MM / self.travel + LIFT_MM / self.feed
        return cut / self.feed - travelled / self.travel - lifts


class Way(Struct, frozen=True, eq=False):
    """A walk with its hops.

    chain: N segments in order.
    travels: (N,) whether a segment is part of a hop.
    loops: number of segments at its start that are a channel.
    """

    chain: Segments
    travels: BoolArray
    loops: int


def cleared_by(channels: Sequence[Channel], radius: float) -> Any:
    """The area in which the middle of a tool touches nothing after ``channels``.

    radius: radius of the tool, mm.
    """
    lines: list[Any] = []
    for channel in channels:
        # The lines between the arcs may be hops, which cut nothing.
        arcs = channel.chain.take(channel.chain.is_arc)
        rows = np.arange(len(arcs))
        points, owner = flatten(replace(arcs, owner=rows), _CHORD_MM)
        order = np.argsort(np.concatenate([owner, rows]), kind="stable")
        ends = np.concatenate([points, arcs.end])[order]
        lines += shapely.linestrings(ends, indices=np.concatenate([owner, rows])[order]).tolist()
    swept = shapely.union_all(shapely.buffer(lines, radius, quad_segs=_QUARTER))
    area = shapely.buffer(swept, _NEARER_MM - radius, quad_segs=_QUARTER)
    shapely.prepare(area)
    return area


def hop(chain: Segments, loops: int, cleared: Any, radius: float, speeds: Speeds) -> Way:
    """The way of a walk, its returns and all that runs over ``cleared`` ground as hops.

    loops: number of segments at the start of ``chain`` that are a channel.
    radius: radius of the tool, mm.
    """
    if shapely.is_empty(cleared):
        return Way(chain, np.zeros(len(chain), dtype=np.bool_), loops)
    channel = chain.take(np.arange(loops))
    idle = ~channel.is_arc
    # The first lines lead to where the tool goes in.
    idle[: int(np.argmax(channel.is_arc)) if channel.is_arc.any() else loops] = False
    rest, rest_idle = _part(chain.take(np.arange(loops, len(chain))), cleared, radius)
    whole = concatenate([channel, rest])
    is_idle = np.concatenate([idle, rest_idle])
    parts: list[Segments] = []
    travels: list[BoolArray] = []
    done = new_loops = 0
    for first, last in [*_idle_runs(whole, is_idle, loops, cleared), (len(whole), len(whole))]:
        parts.append(whole.take(np.arange(done, first)))
        travels.append(np.zeros(first - done, dtype=np.bool_))
        new_loops += max(min(first, loops) - done, 0)
        run = whole.take(np.arange(first, last))
        # Between two loops, ground may lie in the area that only later ones clear.
        straight: Segments | None = run
        if last > loops and len(run):
            straight = _shorten(run, cleared)
        saved = 0.0
        if straight is not None:
            saved = speeds.saved(run.length.sum(), straight.length.sum())
        chosen = run if straight is None or saved < _LEAST_S else straight
        parts.append(chosen)
        travels.append(np.full(len(chosen), chosen is straight))
        new_loops += len(chosen) if first < loops else 0
        done = last
    return Way(concatenate(parts), np.concatenate(travels), new_loops)


def _idle_runs(
    chain: Segments, is_idle: BoolArray, loops: int, cleared: Any
) -> list[tuple[int, int]]:
    """The runs of idle segments.

    At the end of a channel a run is parted if no straight ways replace the whole of it.
    """
    runs: list[tuple[int, int]] = []
    for first, last in true_runs(is_idle).tolist():
        leaves = first < loops < last
        if leaves and _shorten(chain.take(np.arange(first, last)), cleared) is None:
            runs += [(first, loops), (loops, last)]
        else:
            runs.append((first, last))
    return runs


def _part(chain: Segments, cleared: Any, radius: float) -> tuple[Segments, BoolArray]:
    """``chain`` parted where it enters or leaves ``cleared`` ground, and which parts lie in it."""
    if not len(chain):
        return chain, np.zeros(0, dtype=np.bool_)
    # The first place of a segment is its start, the last one its end.
    count = np.maximum(np.ceil(chain.length / (_EVERY * radius)), 2).astype(np.int64) + 1
    row = owners(count)
    at = ramp(count) / (count[row] - 1)

    def is_clear(rows: IntArray, fraction: FloatArray) -> BoolArray:
        points = points_at(chain.take(rows), fraction)
        return np.asarray(shapely.contains_xy(cleared, points[:, 0], points[:, 1]))

    clear = is_clear(row, at)
    change = np.flatnonzero((row[1:] == row[:-1]) & (clear[1:] != clear[:-1]))
    rows, low, high = row[change], at[change], at[change + 1]
    before = clear[change]
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        same = is_clear(rows, middle) == before
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    # The border is cut rather than run over.
    cut = np.where(before, low, high)
    begins_row = np.concatenate([np.arange(len(chain)), rows])
    begins_at = np.concatenate([np.zeros(len(chain)), cut])
    first_clear = clear[np.cumsum(count) - count]
    state = np.concatenate([first_clear, ~before])
    order = np.lexsort((begins_at, begins_row))
    begins_row, begins_at, state = begins_row[order], begins_at[order], state[order]
    is_last = np.append(begins_row[1:] != begins_row[:-1], True)
    ends_at = np.where(is_last, 1.0, np.append(begins_at[1:], 1.0))
    return split(chain, begins_row, begins_at, ends_at), state


def _shorten(run: Segments, cleared: Any) -> Segments | None:
    """A few straight ways in place of ``run``, each as far as it stays on ``cleared`` ground.

    None if more than `_MOST_WAYS` would be needed, as along a wall that bends towards the tool.
    """
    ends = np.cumsum(run.length)
    along = np.unique(np.concatenate([[0.0], ends, np.linspace(0.0, ends[-1], _STOPS)]))
    row = np.minimum(np.searchsorted(ends, along), len(run) - 1)
    fraction = (along - (ends[row] - run.length[row])) / np.maximum(run.length[row], 1e-12)
    points = points_at(run.take(row), np.clip(fraction, 0.0, 1.0))
    stops = [0]
    while stops[-1] < len(points) - 1:
        if len(stops) > _MOST_WAYS:
            return None
        ahead = np.arange(stops[-1] + 1, len(points))
        start = np.repeat(points[stops[-1]][None], len(ahead), axis=0)
        lines = shapely.linestrings(np.stack([start, points[ahead]], axis=1))
        reached = np.flatnonzero(shapely.covers(cleared, lines))
        if not len(reached):
            return None
        stops.append(int(ahead[reached[-1]]))
    return make_polyline(points[stops])


def lift(path: ToolPath, travels: BoolArray, speeds: Speeds) -> ToolPath:
    """The path with its hops lifted: up, across, and down at the feed over a cleared floor.

    travels: (N,) whether the segment that ends in a row is part of a hop.
    """
    if not travels.any():
        return path
    table, rows = path.table, np.arange(len(path))
    runs = true_runs(travels)
    ups, downs = runs[:, 0], runs[:, 1] - 1
    source = np.concatenate([rows, ups, downs])
    # Up before the first row of a run, down after its last one.
    key = np.concatenate([rows, ups - 0.5, downs + 0.5])
    kind = np.concatenate([np.where(travels, 1, 0), np.full(len(ups), 2), np.full(len(ups), 3)])
    order = np.argsort(key, kind="stable")
    source, kind = source[order], kind[order]
    lifted = table[source].copy()
    position, via, feed = (PLACES[name] for name in ("position", "via", "feed"))
    before = kind == 2
    lifted[before, position] = table[source[before] - 1, position]
    lifted[before | (kind == 3), via] = np.nan
    lifted[(kind == 1) | before, 2] += LIFT_MM
    lifted[(kind == 1) | before, feed] = speeds.travel
    lifted[kind == 3, feed] = speeds.feed
    return replace(path, table=frozen(lifted))
