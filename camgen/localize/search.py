"""The search for the model in a scan, with and without each plane that may be the bench."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from msgspec import Struct

from camgen.localize.clutter import find_benches
from camgen.localize.coarse import DistanceField, Poses, make_field
from camgen.localize.doubt import (
    find_other_sides,
    is_thin,
    make_symmetric,
    measure_seen,
    measure_stray,
)
from camgen.localize.fine import (
    ScanFit,
    View,
    compute_cost,
    compute_costs,
    find_unseen,
    refine_all,
)
from camgen.localize.model import Model, find_touched_within
from camgen.localize.starts import find_starts, find_symmetries, list_things, split_heaps
from camgen.model.pose import IDENTITY, FloatArray, Pose
from camgen.model.sequences import take_rows

#: Points that choose among poses, and points that choose the poses for a closer look.
FEW, _FEWER = 1500, 300
#: A pose gets a closer look if its cost exceeds that of the best pose by less than this.
FAR_COST = 0.05
#: Points in which things that stand apart are looked for.
_SOME = 20_000
#: A point of the scan lies on the model within this share of the model's size.
WITHIN = 0.005
#: If more of the points in the model's box than this do not lie on it, the search goes on.
_STRAY = 0.02
#: The part does not stand at a pose that hides more than this share of its points.
MOST_HIDDEN = 0.1
#: The rms distance of points from the part is below this share of the limit. Points that lie about
#: a surface by chance spread evenly, with 0.58 of the limit.
CHANCE = 0.4
#: A view is the right one if its best pose costs less than this (0..1). The search ends with it.
_EXPLAINED = 0.1
#: Fewer points than this hold no pose.
LEAST = 100
#: Poses that are tried again in the view without the right bench.
_CARRIED = 24
#: The part was not found if the scan holds less than this share of its near side.
LEAST_SEEN = 0.7
#: Things are apart by one part in this number of the model's size. A further part has at least
#: this share of the points of the first one, and its pose costs less than this.
_APART, _LIKE_FIRST, _AGAIN = 16, 0.3, 0.2


class PreparedModel(Struct, frozen=True, eq=False):
    """The model, prepared for the search.

    symmetries: poses that put its surface about onto itself.
    """

    model: Model
    field: DistanceField
    symmetries: Poses

    @property
    def within(self) -> float:
        """A point nearer to the model than this lies on it, mm."""
        return WITHIN * self.model.size


class Tries:
    """Refined poses in one view: points of a scan that may be the part.

    fits: the refined poses in the order of their trial.
    costs: the cost of each fit without regard to sight, 0..1.
    """

    def __init__(self, prepared: PreparedModel, view: View) -> None:
        self.prepared, self.view = prepared, view
        self.sets = list_things(prepared.model, view.points[:_SOME])
        self.fits: list[ScanFit] = []
        self.costs: list[float] = []
        self._sighted: dict[int, float] = {}

    def add(self, poses: Poses) -> None:
        """Refines each pose with few points, and each that is near to the best one with more."""
        model, within = self.prepared.model, self.prepared.within
        first, fewer = self.view.points[:FEW], View(self.view.points[:_FEWER])
        placements = list(zip(poses.rotations, poses.origins, strict=True))
        fits = refine_all(model, fewer.points, placements, 0.02 * model.size)
        costs = compute_costs(model, fewer, fits, within)
        near = np.flatnonzero(np.array(costs) < min(costs, default=0.0) + FAR_COST).tolist()
        placements = [(fits[k].rotation, fits[k].origin) for k in near]
        refined = refine_all(model, first, placements, 0.01 * model.size)
        refined_costs = compute_costs(model, fewer, refined, within)
        for k, fit, cost in zip(near, refined, refined_costs, strict=True):
            fits[k], costs[k] = fit, cost
        self.fits += fits
        self.costs += costs

    def sort(self) -> list[int]:
        """Indices of the fits, in order of the costs without regard to sight."""
        return sorted(range(len(self.fits)), key=self.costs.__getitem__)

    def best(self) -> tuple[ScanFit, float]:
        """The fit with the least cost with regard to sight, and this cost."""
        least, chosen = math.inf, 0
        view = self.view.first(_FEWER)
        for k in self.sort():
            if self.costs[k] > least:
                break
            if k not in self._sighted:
                self._sighted[k] = compute_cost(
                    self.prepared.model, view, self.fits[k], self.prepared.within
                )
            if self._sighted[k] < least:
                least, chosen = self._sighted[k], k
        return self.fits[chosen], least


def prepare_model(model: Model) -> PreparedModel:
    """The model with its field and its symmetries."""
    field = make_field(model)
    return PreparedModel(model, field, find_symmetries(model, field))


def list_views(model: Model, points: FloatArray, eye: FloatArray | None) -> list[View]:
    """The scan without each plane that may be the bench; the whole scan too if no bench is certain.

    points: (N, 3).
    eye: (3,), the scanner's place, mm. It is in front of a bench.
    """
    views = []
    for bench in find_benches(model, points):
        rest = points[~bench.holds(points)]
        if len(rest) >= LEAST and (eye is None or eye @ bench.normal >= bench.height):
            views.append(View(rest, eye, bench.normal))
            if bench.certain:
                return views
    return [*views, View(points, eye)]


def search_poses(
    prepared: PreparedModel, views: list[View], given: Pose, stage: Callable[[str], None]
) -> Tries:
    """The poses tried in the view that the model explains best, the right one among them.

    The search begins near `given`. If the part is not clearly there, it goes on everywhere. For a
    thin part it is always everywhere: another place lies near each place.
    """
    tries = [Tries(prepared, view) for view in views]
    for near in (True, False):
        if near and is_thin(prepared.model):
            continue
        stage("searching near by" if near else "searching everywhere")
        starts = [
            find_starts(prepared.model, prepared.field, each.sets, given, near) for each in tries
        ]
        for k in sorted(range(len(tries)), key=lambda k: -starts[k].share):
            _try_poses(tries[k], starts[k].poses)
            if _is_clear(tries[k]):
                return tries[k]
    return min(tries, key=lambda each: each.best()[1])


def _try_poses(tries: Tries, poses: Poses) -> None:
    """Refines the poses, and those by which a thin or a symmetric part may have been missed."""
    prepared, points = tries.prepared, tries.view.points
    tries.add(poses)
    other_sides = find_other_sides(prepared.model, points[:_FEWER], tries.fits)
    if len(other_sides):
        tries.add(other_sides)
    best, _ = tries.best()
    if best.noise < CHANCE * prepared.within:
        tries.add(make_symmetric(best, prepared.symmetries))


def _is_clear(tries: Tries) -> bool:
    prepared, (best, cost) = tries.prepared, tries.best()
    view, within = tries.view.first(FEW), prepared.within
    return (
        cost < _EXPLAINED
        and best.noise < CHANCE * within
        and measure_unseen(prepared.model, view, best, within) <= MOST_HIDDEN
        and measure_stray(prepared.model, view.points, best, within) < _STRAY
    )


def measure_unseen(model: Model, view: View, fit: ScanFit, reach: float) -> float:
    """The share of the points within `reach` mm of the model that lie on hidden surface."""
    touch = find_touched_within(model, fit.apply(view.points[:_FEWER]), reach)
    if not len(touch.point):
        return 0.0
    return float(find_unseen(model, touch, view, fit, reach).mean())


def remove_bench(tries: Tries, points: FloatArray) -> Tries:
    """The poses in the view without the bench under the best pose.

    The bench is a plane in the points off the model. So it is not a face of the part, and the part
    does not reach through it. points: (N, 3), all of the scan.
    """
    view = _without_bench(tries, points)
    if len(view.points) == len(tries.view.points):
        return tries
    fits = take_rows(tries.fits, tries.sort()[:_CARRIED])
    rotations = np.stack([fit.rotation for fit in fits])
    without = Tries(tries.prepared, view)
    _try_poses(without, Poses(rotations, np.stack([fit.origin for fit in fits])))
    return without


def _without_bench(tries: Tries, points: FloatArray) -> View:
    """The view of all `points` (N, 3) but those of the bench under the best pose."""
    prepared, (best, _), eye = tries.prepared, tries.best(), tries.view.eye
    model = prepared.model
    touch = find_touched_within(model, best.apply(points), prepared.within)
    rest = np.delete(points, touch.point, axis=0)
    if not len(touch.point) or len(rest) < LEAST:
        return View(points, eye)
    corners = (model.tree.corners.reshape(-1, 3) - best.origin) @ best.rotation
    shown = (model.normals[touch.triangle] @ best.rotation).mean(axis=0)
    for bench in find_benches(model, points, rest):
        if bench.carries(corners, prepared.within) and bench.normal @ shown > 0:
            return View(points[~bench.holds(points)], eye, bench.normal)
    return View(points, eye)


def find_further(prepared: PreparedModel, view: View, final: ScanFit) -> list[ScanFit]:
    """The poses of further parts, each in points off the first part."""
    model, given = prepared.model, Pose(IDENTITY, (0.0, 0.0, 0.0))
    on_first = find_touched_within(model, final.apply(view.points), 2 * prepared.within).point
    rest = np.delete(view.points, on_first, axis=0)
    if len(rest) < LEAST:
        return []
    further = []
    for heap in split_heaps(rest, model.size / _APART):
        if len(heap) >= max(LEAST, _LIKE_FIRST * len(on_first)):
            heap_view = View(heap, view.eye, view.up)
            best, cost = search_poses(prepared, [heap_view], given, lambda _: None).best()
            seen = measure_seen(model, heap_view, best, prepared.within)
            if cost < _AGAIN and seen.near >= LEAST_SEEN:
                further.append(best)
    return further
