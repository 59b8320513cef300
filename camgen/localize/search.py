"""The search for the model in a scan, with and without each plane that may be the bench."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from msgspec import Struct

from camgen.localize.clutter import Bench, find_benches
from camgen.localize.coarse import DistanceField, Poses, field
from camgen.localize.doubt import alike, beside, measure_seen, stray, thin
from camgen.localize.fine import ScanFit, View, cost, costs, on, refine_all, unseen
from camgen.localize.model import Cloud, Model
from camgen.localize.starts import heaps, starts, symmetries, things
from camgen.model.pose import IDENTITY, FloatArray, Pose

#: Points that choose among poses, and points that choose the poses for a closer look.
FEW, _FEWER = 1500, 300
#: A pose gets a closer look if its cost exceeds that of the best pose by less than this.
_FAR_COST = 0.05
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
#: A scene is the right one if its best pose costs less than this (0..1). The search ends with it.
_EXPLAINED = 0.1
#: Fewer points than this hold no pose.
LEAST = 100
#: Poses that are tried again in the scene with the right bench.
_CARRIED = 24
#: The part was not found if the scan holds less than this share of its near side.
LEAST_SEEN = 0.7
#: Things are apart by one part in this number of the model's size. A further part has at least
#: this share of the points of the first one, and its pose costs less than this.
_APART, _LIKE_FIRST, _AGAIN = 16, 0.3, 0.2


class PreparedModel(Struct, frozen=True, eq=False):
    """The model, prepared for the search.

    same: poses that put its surface about onto itself.
    """

    model: Model
    samples: Cloud
    field: DistanceField
    same: Poses

    @property
    def within(self) -> float:
        """A point nearer to the model than this lies on it, mm."""
        return WITHIN * self.model.size


class Scene(Struct, frozen=True, eq=False):
    """The points of a scan that may be the part.

    bench: the plane that was left out, None without one.
    """

    view: View
    bench: Bench | None = None

    def first(self, count: int) -> View:
        """The view with its first ``count`` points."""
        return View(self.view.points[:count], self.view.eye, self.view.up)


class Tries:
    """Refined poses in one scene.

    fits: the refined poses in the order of their trial.
    costs: the cost of each fit without regard to sight, 0..1.
    """

    def __init__(self, ground: PreparedModel, scene: Scene) -> None:
        self.ground, self.scene = ground, scene
        self.sets = things(ground.model, scene.view.points[:_SOME])
        self.fits: list[ScanFit] = []
        self.costs: list[float] = []
        self._sighted: dict[int, float] = {}

    def add(self, poses: Poses) -> None:
        """Refines each pose with few points, and with more points each that is near to the best."""
        model, samples, within = self.ground.model, self.ground.samples, self.ground.within
        points = self.scene.view.points
        first, fewer = points[:FEW], View(points[:_FEWER])
        begins = list(zip(poses.rotations, poses.origins, strict=True))
        fits = refine_all(model, samples, fewer.points, begins, 0.02 * model.size)
        worth = costs(model, samples, fewer, fits, within)
        near = [k for k, each in enumerate(worth) if each < min(worth) + _FAR_COST]
        again = [(fits[k].rotation, fits[k].origin) for k in near]
        better = refine_all(model, samples, first, again, 0.01 * model.size)
        better_worth = costs(model, samples, fewer, better, within)
        for k, fit, each in zip(near, better, better_worth, strict=True):
            fits[k], worth[k] = fit, each
        self.fits += fits
        self.costs += worth

    def best(self) -> tuple[ScanFit, float]:
        """The fit with the least cost under regard of sight, and this cost."""
        least, chosen = math.inf, 0
        for k in sorted(range(len(self.fits)), key=self.costs.__getitem__):
            if self.costs[k] > least:
                break
            if k not in self._sighted:
                self._sighted[k] = cost(
                    self.ground.model,
                    self.ground.samples,
                    self.scene.first(_FEWER),
                    self.fits[k],
                    self.ground.within,
                )
            if self._sighted[k] < least:
                least, chosen = self._sighted[k], k
        return self.fits[chosen], least


def prepare(model: Model) -> PreparedModel:
    """The model with its field and its symmetries."""
    samples = Cloud(model.samples)
    ground = field(model, samples)
    return PreparedModel(model, samples, ground, symmetries(model, ground))


def list_scenes(model: Model, points: FloatArray, eye: FloatArray | None) -> list[Scene]:
    """The scan without each plane that may be the bench; the whole scan too if no bench is certain.

    points: (N, 3).
    eye: (3,), the scanner's place, mm. It is in front of a bench.
    """
    scenes = []
    for bench in find_benches(model, points):
        rest = points[~bench.holds(points)]
        if len(rest) < LEAST or (eye is not None and eye @ bench.normal < bench.height):
            continue
        scenes.append(Scene(View(rest, eye, bench.normal), bench))
        if bench.certain:
            return scenes
    return [*scenes, Scene(View(points, eye))]


def search(
    ground: PreparedModel, scenes: list[Scene], given: Pose, stage: Callable[[str], None]
) -> Tries:
    """The poses tried in the scene that the model explains best, the right one among them.

    The search begins near ``given``. If the part is not clearly there, it goes on everywhere. For a
    thin part it is always everywhere: another place lies near each place.
    """
    tries = [Tries(ground, scene) for scene in scenes]
    for near in (True, False):
        if near and thin(ground.model):
            continue
        stage("searching near by" if near else "searching everywhere")
        begins = [starts(ground.model, ground.field, scene.sets, given, near) for scene in tries]
        for k in sorted(range(len(tries)), key=lambda k: -begins[k].share):
            _try(tries[k], begins[k].poses)
            if _is_clear(tries[k]):
                return tries[k]
    return min(tries, key=lambda scene: scene.best()[1])


def _try(tries: Tries, poses: Poses) -> None:
    """Refines the poses, and those by which a thin or a symmetric part may have been missed."""
    ground, points = tries.ground, tries.scene.view.points
    tries.add(poses)
    other_sides = beside(ground.model, ground.samples, points[:_FEWER], tries.fits)
    if len(other_sides):
        tries.add(other_sides)
    best, _ = tries.best()
    if best.noise < CHANCE * ground.within:
        tries.add(alike(best, ground.same))


def _is_clear(tries: Tries) -> bool:
    """Whether the part is plainly where the best pose puts it."""
    ground, (best, worth) = tries.ground, tries.best()
    view = tries.scene.first(FEW)
    return (
        worth < _EXPLAINED
        and best.noise < CHANCE * ground.within
        and share_unseen(ground, view, best, ground.within) <= MOST_HIDDEN
        and stray(ground.model, ground.samples, view.points, best, ground.within) < _STRAY
    )


def share_unseen(ground: PreparedModel, view: View, fit: ScanFit, reach: float) -> float:
    """The share of the points within ``reach`` mm of the model that lie on hidden surface."""
    touch = on(ground.model, ground.samples, fit.apply(view.points[:_FEWER]), reach)
    if not len(touch.point):
        return 0.0
    return float(unseen(ground.model, touch, view, fit, reach).mean())


def settle_bench(tries: Tries, points: FloatArray) -> Tries:
    """The poses in the scene without the bench under the best pose.

    The bench is a plane in the points off the model. So it is not a face of the part, and the part
    does not reach through it. points: (N, 3), all of the scan.
    """
    scene = _without_bench(tries, points)
    if len(scene.view.points) == len(tries.scene.view.points):
        return tries
    order = sorted(range(len(tries.fits)), key=tries.costs.__getitem__)[:_CARRIED]
    rotations = np.stack([tries.fits[k].rotation for k in order])
    origins = np.stack([tries.fits[k].origin for k in order])
    settled = Tries(tries.ground, scene)
    _try(settled, Poses(rotations, origins))
    return settled


def _without_bench(tries: Tries, points: FloatArray) -> Scene:
    """The scene of all ``points`` (N, 3) but those of the bench under the best pose."""
    ground, (best, _), eye = tries.ground, tries.best(), tries.scene.view.eye
    model = ground.model
    touch = on(model, ground.samples, best.apply(points), ground.within)
    rest = np.delete(points, touch.point, axis=0)
    if not len(touch.point) or len(rest) < LEAST:
        return Scene(View(points, eye))
    places = (model.tree.corners.reshape(-1, 3) - best.origin) @ best.rotation
    shown = (model.normals[touch.triangle] @ best.rotation).mean(axis=0)
    for bench in find_benches(model, points, rest):
        if bench.carries(places, ground.within) and bench.normal @ shown > 0:
            above = points[~bench.holds(points)]
            return Scene(View(above, eye, bench.normal), bench)
    return Scene(View(points, eye))


def find_again(ground: PreparedModel, view: View, final: ScanFit) -> list[ScanFit]:
    """The poses of further parts, each in points off the first part."""
    model, samples = ground.model, ground.samples
    on_first = on(model, samples, final.apply(view.points), 2 * ground.within).point
    rest = np.delete(view.points, on_first, axis=0)
    if len(rest) < LEAST:
        return []
    further = []
    for heap in heaps(rest, model.size / _APART):
        if len(heap) < max(LEAST, _LIKE_FIRST * len(on_first)):
            continue
        scene = Scene(View(heap, view.eye, view.up))
        best, worth = search(
            ground, [scene], Pose(IDENTITY, (0.0, 0.0, 0.0)), lambda _: None
        ).best()
        seen = measure_seen(model, samples, scene.view, best, ground.within)
        if worth < _AGAIN and seen.near >= LEAST_SEEN:
            further.append(best)
    return further
