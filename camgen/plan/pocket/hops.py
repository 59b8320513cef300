"""Hops: links of a pocket over the cleared area, run at travel speed with a small lift.

The loops of a trochoidal channel return over the area that they have cleared, and passes lead
through channels. Nothing is cut there. The tool centre touches no material in the area that the
channels sweep, less the tool radius on all sides. A stretch of the path inside this area becomes a
hop of a few straight lines if they stay inside too. Other stretches keep the feed, and so do those
so short that the lift would take longer. So the tool never follows a curved wall at travel speed.
Returns between two loops are hops in any case.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.ragged import find_true_runs, list_owners, number_rows
from camgen.geometry.segments import (
    BoolArray,
    IntArray,
    Segments,
    concatenate,
    flatten,
    points_at,
    split_segments,
)
from camgen.model.path import PLACES, ToolPath
from camgen.model.pose import FloatArray, frozen
from camgen.plan.pocket.chains import make_polyline
from camgen.plan.pocket.channel import Channel
from camgen.plan.pocket.linking import LinkedPasses

#: Height of a hop above the floor of the pass, mm.
LIFT_MM = 0.3
#: mm: on a hop the tool may overlap with material by this. Polygons deviate from arcs by as much.
_OVERLAP_MM = 0.005
#: Chords of a quarter of a circle.
_QUARTER = 32
#: Spacing of samples on a pass, as a fraction of the tool radius.
_SPACING_FRACTION = 0.1
#: Bisection steps by which the border of the cleared area is found on a pass.
_HALVINGS = 20
#: mm: maximum deviation of chords from the arcs of a channel.
_CHORD_MM = 0.01
#: Maximum number of straight lines of a hop.
_MAX_LINES = 6
#: Evenly spaced points on a stretch at which a line of the hop may end.
_STOPS = 48
#: s: minimum time that a hop saves, apart from returns between two loops.
_MIN_SAVED_S = 0.03


class Speeds(Struct, frozen=True):
    """Speeds of a job, mm/s: `feed` for cutting, `travel` for links without contact."""

    feed: float
    travel: float

    def saved(self, cut: float, travelled: float) -> float:
        """Seconds that a hop of `travelled` mm saves in place of `cut` mm at the feed."""
        lifts = LIFT_MM / self.travel + LIFT_MM / self.feed
        return cut / self.feed - travelled / self.travel - lifts


def make_cleared_area(channels: Sequence[Channel], radius: float) -> Any:
    """The area in which the tool centre touches no material after `channels` are cut, as polygons.

    radius: tool radius, mm.
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
    area = shapely.buffer(swept, _OVERLAP_MM - radius, quad_segs=_QUARTER)
    shapely.prepare(area)
    return area


def add_hops(linked: LinkedPasses, cleared: Any, radius: float, speeds: Speeds) -> LinkedPasses:
    """Replace the returns of a channel, and all stretches over the cleared area, by hops.

    cleared: polygons in which the tool centre touches no material.
    radius: tool radius, mm.
    """
    if shapely.is_empty(cleared):
        return linked
    chain, channel_segments = linked.chain, linked.channel_segments
    channel = chain.take(np.arange(channel_segments))
    is_return = ~channel.is_arc
    # The first lines lead to the point at which the tool enters.
    first_arc = int(np.argmax(channel.is_arc)) if channel.is_arc.any() else channel_segments
    is_return[:first_arc] = False
    passes = chain.take(np.arange(channel_segments, len(chain)))
    passes, is_clear = _split_at_border(passes, cleared, radius)
    whole = concatenate([channel, passes])
    is_idle = np.concatenate([is_return, is_clear])
    parts: list[Segments] = []
    is_hop: list[BoolArray] = []
    done = new_channel_segments = 0
    runs = _find_idle_runs(whole, is_idle, channel_segments, cleared)
    for first, last in [*runs, (len(whole), len(whole))]:
        parts.append(whole.take(np.arange(done, first)))
        is_hop.append(np.zeros(first - done, dtype=np.bool_))
        new_channel_segments += max(min(first, channel_segments) - done, 0)
        stretch = whole.take(np.arange(first, last))
        # A return between two loops is always a hop, and stays as it is. A shortcut could lead over
        # material that only later loops clear.
        chosen, hops = stretch, True
        if last > channel_segments and len(stretch):
            lines = _shorten(stretch, cleared)
            hops = False
            if lines is not None:
                hops = speeds.saved(stretch.length.sum(), lines.length.sum()) >= _MIN_SAVED_S
                chosen = lines if hops else stretch
        parts.append(chosen)
        is_hop.append(np.full(len(chosen), hops))
        new_channel_segments += len(chosen) if first < channel_segments else 0
        done = last
    return replace(
        linked,
        chain=concatenate(parts),
        is_hop=np.concatenate(is_hop),
        channel_segments=new_channel_segments,
    )


def _find_idle_runs(
    chain: Segments, is_idle: BoolArray, channel_segments: int, cleared: Any
) -> Iterator[tuple[int, int]]:
    """First row and end row of each run of idle segments.

    is_idle: (N,) whether nothing is cut on a segment.

    A run over the end of the channel is split there, unless a hop can replace all of it.
    """
    for first, last in find_true_runs(is_idle).tolist():
        leaves_channel = first < channel_segments < last
        if leaves_channel and _shorten(chain.take(np.arange(first, last)), cleared) is None:
            yield first, channel_segments
            yield channel_segments, last
        else:
            yield first, last


def _split_at_border(chain: Segments, cleared: Any, radius: float) -> tuple[Segments, BoolArray]:
    """Split a chain at the border of the cleared area.

    Returns the M parts, and whether each of them lies inside (M,).
    """
    if not len(chain):
        return chain, np.zeros(0, dtype=np.bool_)
    # The first sample of a segment is its start, the last one its end.
    count = np.maximum(np.ceil(chain.length / (_SPACING_FRACTION * radius)), 2).astype(np.int64) + 1
    row = list_owners(count)
    at = number_rows(count) / (count[row] - 1)

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
    # The cut is on the inner side of the border.
    cut = np.where(before, low, high)
    begins_row = np.concatenate([np.arange(len(chain)), rows])
    begins_at = np.concatenate([np.zeros(len(chain)), cut])
    state = np.concatenate([clear[np.cumsum(count) - count], ~before])
    order = np.lexsort((begins_at, begins_row))
    begins_row, begins_at, state = begins_row[order], begins_at[order], state[order]
    is_last = np.append(begins_row[1:] != begins_row[:-1], True)
    ends_at = np.where(is_last, 1.0, np.append(begins_at[1:], 1.0))
    return split_segments(chain, begins_row, begins_at, ends_at), state


def _shorten(stretch: Segments, cleared: Any) -> Segments | None:
    """A few straight lines in place of a stretch, each as long as the cleared area allows.

    None if more than `_MAX_LINES` are needed, for example along a wall that curves towards the
    tool.
    """
    ends = np.cumsum(stretch.length)
    along = np.unique(np.concatenate([[0.0], ends, np.linspace(0.0, ends[-1], _STOPS)]))
    row = np.minimum(np.searchsorted(ends, along), len(stretch) - 1)
    fraction = (along - (ends[row] - stretch.length[row])) / np.maximum(stretch.length[row], 1e-12)
    points = points_at(stretch.take(row), np.clip(fraction, 0.0, 1.0))
    stops = [0]
    while stops[-1] < len(points) - 1:
        if len(stops) > _MAX_LINES:
            return None
        ahead = np.arange(stops[-1] + 1, len(points))
        start = np.repeat(points[stops[-1]][None], len(ahead), axis=0)
        lines = shapely.linestrings(np.stack([start, points[ahead]], axis=1))
        reached = np.flatnonzero(shapely.covers(cleared, lines))
        if not len(reached):
            return None
        stops.append(int(ahead[reached[-1]]))
    return make_polyline(points[stops])


def lift_hops(path: ToolPath, is_hop: BoolArray, speeds: Speeds) -> ToolPath:
    """The path with its hops lifted by `LIFT_MM`: up and across at travel speed, down at the feed.

    is_hop: (N,) whether the segment that ends in a row of the path is part of a hop.
    """
    if not is_hop.any():
        return path
    table, rows = path.table, np.arange(len(path))
    runs = find_true_runs(is_hop)
    ups, downs = runs[:, 0], runs[:, 1] - 1
    source = np.concatenate([rows, ups, downs])
    # A row up comes before the first row of a run, a row down after its last one.
    key = np.concatenate([rows, ups - 0.5, downs + 0.5])
    kind = np.concatenate([np.where(is_hop, 1, 0), np.full(len(ups), 2), np.full(len(ups), 3)])
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
