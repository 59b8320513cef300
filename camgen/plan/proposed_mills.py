"""Chooses the end mills of a proposal by the length of the contours that they touch."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.intersect import measure_nearest
from camgen.geometry.nesting import Nesting
from camgen.geometry.ragged import list_owners, number_rows
from camgen.geometry.segments import (
    BoolArray,
    IntArray,
    Segments,
    find_following,
    points_at,
    tangents_at,
)
from camgen.model.errors import CamgenError
from camgen.model.job import ToolTable
from camgen.model.part import EarlierRun, Part
from camgen.model.path import ToolPath
from camgen.model.pose import FloatArray
from camgen.model.sequences import take_rows
from camgen.plan import plan
from camgen.plan.columns import make_path_segments
from camgen.plan.rest import list_runs
from camgen.read.job_file import from_mapping

#: A mill is large enough for a contour if it touches this share of it, sharp corners apart.
ENOUGH_SHARE = 0.95
#: Left at the wall for a last pass, mm.
FINISH_MM = 0.2
#: Depth of a pass, in diameters of the mill.
PASS = 0.6
#: A mill of this diameter or more, mm, takes a last pass at the wall after several passes.
_FINISHING_MILL_MM = 3.0
#: For sharp inner corners alone no mill is smaller than this, mm.
_CORNER_MILL_MM = 3.0
#: Fillets with a smaller radius, mm, are corners.
_FILLET_MM = 0.5
#: Two segments that turn by less than this, rad, go on without a corner.
_SMOOTH = np.radians(5)
#: A rest needs one more mill from this length on, mm, and from this share of the contours on.
_LEAST_REST_MM, _LEAST_REST_SHARE = 2.0, 2e-3
#: The contours are sampled at this spacing, mm, but not at more places than this.
_SPACING_MM, _MOST_SAMPLES = 0.25, 100_000
#: A place that is touched may be farther from the mill by this, mm.
_TOUCH_MM = 0.02
#: A mill follows whole contours if they have this share of the length of their group.
_FEW_SHARE = 0.1
#: A mill is added for the rest if it touches this share of what the mills before it leave.
_WORTH_SHARE = 0.3
#: Up to this number of loops mills are tried in turn. More loops get the largest mill.
MOST_TRIED = 3000

Row = Mapping[str, object]


class ChosenMill(Struct, frozen=True):
    """A mill for contours of a group.

    diameter: mm.
    loops: rows of the loops that it touches.
    share: share of the length that it touches, together with the mills before it.
    cuts_out: whether it runs around a whole contour.
    shortest: length of its shortest closed path, mm; infinity without one.
    longest: length of its longest path, mm; infinity if one is closed.
    before: diameter of the largest mill whose rest it takes, mm; 0 for one that takes no rest.
    may_finish: whether it is wide enough for a last pass after several, and its paths that leave
        `FINISH_MM` run around the same contours.
    """

    diameter: float
    loops: list[int]
    share: float
    cuts_out: bool
    shortest: float
    longest: float
    before: float = 0.0
    may_finish: bool = False


class Samples(Struct, frozen=True, eq=False):
    """Places on the contours of a group.

    points: (N, 2) mm.
    loop: (N,) row of the loop.
    length: (N,) length of contour that each stands for, mm.
    corner: (N,) smallest radius of a mill that misses the place because of a sharp inner corner,
        mm; infinity if none does.
    """

    points: FloatArray
    loop: IntArray
    length: FloatArray
    corner: FloatArray


def choose_mills(
    part: Part, ids: Mapping[int, str], keys: Row, samples: Samples, diameters: Sequence[float]
) -> list[ChosenMill]:
    """The mills that follow whole contours of a group, the largest first, and one for the rest.

    Each contour is followed by the largest mill that touches enough of it, else by the one that
    touches most. A mill with few contours is left out if a smaller one can follow them.

    ids: ids of the contours by their rows.
    keys: keys of the operation.
    """
    mills = sorted(diameters, reverse=True)
    trials = _Trials(part, ids, keys)
    groups = list(_share_out(trials, samples, mills))
    if len(groups) > 1 and not all(_runs_round(trials, group) for group in groups):
        # Contours beside each other have common paths, which need one mill.
        groups = [(min(diameter for diameter, _ in groups), list(ids))]
    chosen: list[ChosenMill] = []
    runs: list[EarlierRun] = []
    touched = np.zeros(len(samples.points), np.bool_)
    for diameter, loops in groups:
        paths = trials.follow(diameter, loops)
        touched |= _touch(samples, paths, diameter / 2) & np.isin(samples.loop, loops)
        mill = _describe(diameter, loops, paths, _share(samples, touched))
        if _FINISHING_MILL_MM <= diameter < float(str(keys["depth"])) / PASS:
            wider = trials.follow(diameter + 2 * FINISH_MM, loops)
            may_finish = sum(path.closed for path in wider) == sum(path.closed for path in paths)
            mill = replace(mill, may_finish=may_finish)
        chosen.append(mill)
        runs += list_runs(paths, ToolTable(diameter=diameter))
    left = ~touched & _may_touch(samples, _CORNER_MILL_MM)
    least = max(_LEAST_REST_MM, _LEAST_REST_SHARE * float(samples.length.sum()))
    if not chosen or float(samples.length[left].sum()) < least:
        return chosen
    smaller = [diameter for diameter in mills if diameter < chosen[0].diameter]
    rest = _find_rest(trials, samples, smaller, runs, touched)
    return [*chosen, replace(rest, before=chosen[0].diameter)] if rest else chosen


class _Trials:
    """Plans the paths of single mills beside the contours of a group, equal ones once.

    ids: ids of the contours by their rows.
    keys: keys of the operation.
    """

    def __init__(self, part: Part, ids: Mapping[int, str], keys: Row) -> None:
        self.part = part
        self.ids = ids
        self.keys = keys
        self._followed: dict[tuple[float, tuple[int, ...]], tuple[ToolPath, ...]] = {}

    def follow(self, diameter: float, loops: Sequence[int]) -> tuple[ToolPath, ...]:
        """The paths of a mill beside the contours in the rows `loops`, none if it fits none."""
        key = diameter, tuple(loops)
        if key not in self._followed:
            self._followed[key] = self._plan(self.part, diameter, {"ids": self._name(loops)})
        return self._followed[key]

    def follow_rest(self, diameter: float, runs: Sequence[EarlierRun]) -> tuple[ToolPath, ...]:
        """The paths of a mill where it takes what the runs of larger mills leave."""
        part = replace(self.part, earlier=tuple(runs))
        return self._plan(part, diameter, {"ids": self._name(self.ids), "rest": True})

    def _name(self, loops: Iterable[int]) -> list[str]:
        return take_rows(self.ids, loops)

    def _plan(self, part: Part, diameter: float, keys: Row) -> tuple[ToolPath, ...]:
        tool = {"name": "mill", "number": 1, "diameter": diameter}
        row = {"kind": "follow", **self.keys, **keys, "tool": "mill"}
        try:
            return plan(part, from_mapping({"tools": [tool], "operations": [row]})).paths
        except CamgenError:  # it fits none
            return ()


def _runs_round(trials: _Trials, group: tuple[float, list[int]]) -> bool:
    return all(path.closed for path in trials.follow(*group))


def _share_out(
    trials: _Trials, samples: Samples, mills: Sequence[float]
) -> Iterator[tuple[float, list[int]]]:
    """The mills that follow whole contours, the largest first, with the rows of their contours."""
    rows = np.array(list(trials.ids), np.int64)
    lengths = np.bincount(samples.loop, samples.length, int(rows.max()) + 1)
    best, mill_of = np.zeros(len(lengths)), np.zeros(len(lengths))
    for diameter in mills:
        paths = trials.follow(diameter, rows.tolist())
        touched = _touch(samples, paths, diameter / 2)
        wanted = np.where(_may_touch(samples, diameter), samples.length, 0.0)
        whole = np.bincount(samples.loop, wanted, len(lengths))
        reached = np.bincount(samples.loop, np.where(touched, wanted, 0.0), len(lengths))
        share = np.where(best < ENOUGH_SHARE, reached / np.maximum(whole, 1e-9), 0.0)
        share[reached == 0] = 0.0
        better = share > best + 1e-9
        best[better], mill_of[better] = share[better], diameter
        if (best[rows] >= ENOUGH_SHARE).all():
            break
    groups = [(d, rows[mill_of[rows] == d].tolist()) for d in mills if (mill_of[rows] == d).any()]
    least = _FEW_SHARE * float(lengths.sum())
    moved: list[int] = []
    for diameter, members in groups:
        loops = sorted([*moved, *members])
        if float(lengths[loops].sum()) < least and diameter != groups[-1][0]:
            moved = loops
            continue
        yield diameter, loops
        moved = []


def _find_rest(
    trials: _Trials,
    samples: Samples,
    mills: Sequence[float],
    runs: Sequence[EarlierRun],
    touched: BoolArray,
) -> ChosenMill | None:
    """The largest mill that touches enough of the rest, else the one that touches most.

    runs: the runs of the mills before it, which touch the places `touched`.

    None if none touches much of it.
    """
    best: ChosenMill | None = None
    longest = 0.0
    for diameter in mills:
        paths = trials.follow_rest(diameter, runs)
        new = _touch(samples, paths, diameter / 2) & ~touched
        wanted = ~touched & _may_touch(samples, min(diameter, _CORNER_MILL_MM))
        gained = float(samples.length[new].sum())
        share = gained / max(float(samples.length[wanted].sum()), 1e-9)
        if gained > longest and share >= _WORTH_SHARE:
            best = _describe(
                diameter,
                np.unique(samples.loop[new]).tolist(),
                paths,
                _share(samples, touched | new),
            )
            longest = gained
        if share >= ENOUGH_SHARE:
            break
    return best


def _share(samples: Samples, touched: BoolArray) -> float:
    return float(samples.length[touched].sum() / samples.length.sum())


def _describe(
    diameter: float,
    loops: list[int],
    paths: Sequence[ToolPath],
    share: float,
) -> ChosenMill:
    lengths = [float(make_path_segments((path,)).length.sum()) for path in paths]
    closed = [length for length, path in zip(lengths, paths, strict=True) if path.closed]
    return ChosenMill(
        diameter,
        loops,
        share,
        bool(closed),
        min(closed, default=np.inf),
        np.inf if closed else max(lengths, default=0.0),
    )


def _touch(samples: Samples, paths: Sequence[ToolPath], radius: float) -> BoolArray:
    if not paths:
        return np.zeros(len(samples.points), np.bool_)
    lines = make_path_segments(tuple(paths))
    return np.asarray(np.isfinite(measure_nearest(samples.points, lines, radius + _TOUCH_MM)))


def _may_touch(samples: Samples, diameter: float) -> BoolArray:
    """(N,) places that a mill of `diameter` mm reaches in spite of sharp corners."""
    return np.asarray(samples.corner > diameter / 2)


def sample(segments: Segments, nesting: Nesting, rows: IntArray) -> Samples:
    """Places on the loops `rows` of `segments`; a loop is a hole if its depth is odd."""
    closed = np.ones(int(segments.owner.max(initial=-1)) + 1, np.bool_)
    following = find_following(segments, closed)
    at_end = _half_angles(segments, nesting, following)
    at_start = np.full(len(at_end), np.inf)
    at_start[following] = at_end
    chosen = np.flatnonzero(np.isin(segments.owner, rows))
    step = max(_SPACING_MM, float(segments.length[chosen].sum()) / _MOST_SAMPLES)
    count = np.maximum(np.ceil(segments.length[chosen] / step), 1).astype(np.int64)
    owner = list_owners(count)
    row = chosen[owner]
    share = (number_rows(count) + 0.5) / count[owner]
    length = segments.length[row] / count[owner]
    # A disc of radius r in a corner of half angle a touches its sides r / tan(a) from the corner.
    radius = np.minimum(
        share * segments.length[row] * np.tan(np.minimum(at_start[row], np.pi / 2)),
        (1 - share) * segments.length[row] * np.tan(np.minimum(at_end[row], np.pi / 2)),
    )
    points = points_at(segments.take(row), share)
    return Samples(
        points, segments.owner[row], length, np.where(np.isfinite(radius), radius, np.inf)
    )


def _half_angles(segments: Segments, nesting: Nesting, following: IntArray) -> FloatArray:
    """(N,) half of the angle of the sharp inner corner at which a segment ends, rad.

    It is infinite where there is no corner that a mill runs into. A small fillet is a corner.
    """
    leaving = tangents_at(segments, np.ones(len(segments)))
    entering = tangents_at(segments.take(following), np.zeros(len(segments)))
    cross = leaving[:, 0] * entering[:, 1] - leaving[:, 1] * entering[:, 0]
    turn = np.arctan2(cross, (leaving * entering).sum(axis=1))
    small = segments.is_arc & (segments.radius < _FILLET_MM)
    turn = turn + np.where(small[following], segments.sweep[following], 0.0)
    hole = nesting.depth[segments.owner] % 2 == 1
    turns_left = turn > 0
    counter_clockwise = nesting.area[segments.owner] > 0
    sharp = (hole == (turns_left == counter_clockwise)) & (np.abs(turn) > _SMOOTH)
    return np.where(sharp, (np.pi - np.minimum(np.abs(turn), np.pi - 0.01)) / 2, np.inf)
