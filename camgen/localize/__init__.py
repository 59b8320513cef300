"""Where a CAD part stands in a point cloud: a coarse search from everywhere, an exact fit, and what speaks against it.

``finding.localize`` is the walk; ``scans`` and ``records`` read clouds, ``starts`` and ``coarse`` search,
``nearest`` and ``fine`` refine, ``doubt`` looks for other poses that fit as well.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from msgspec import Struct

from camgen.localize.coarse import Poses, field
from camgen.localize.doubt import Rival, SeenShare, alike, beside, freedom, measure_seen, rivals, stray, thin, weakness
from camgen.localize.fine import TUKEY, ScanFit, cost, on, refine
from camgen.localize.model import Cloud, Model, model_part
from camgen.localize.starts import starts, symmetries, things
from camgen.model.errors import InputError
from camgen.model.part import IntArray
from camgen.model.pose import IDENTITY, FloatArray, Pose, angle_between, frozen
from camgen.model.text import short

# The walk: search everywhere, refine the best, look for others that fit as well, and judge what was found.

#: Points that choose among poses, and those that the last fit is made of at most.
_FEW, _MANY = 1500, 400_000
#: Points that show which poses are worth more, and by how much the cost of such a one may be greater.
_FEWER, _FAR_COST = 300, 0.05
#: Points in which the bench and things on it are looked for.
_SOME = 20_000
#: Where more of the points in the model's box do not lie on it, the search goes on.
_STRAY = 0.02
#: Poses whose costs (0..1, see ``fine.cost``) differ by less fit equally well.
_SAME_COST = 0.004
#: A point of the scan lies on the model within this part of the model's size.
WITHIN = 0.005
#: Less than this of the scan on the model, or less of the model's near side in the scan: the part was not found.
LEAST_OVERLAP, LEAST_SEEN = 0.3, 0.65
#: More points in the model's box that are not on it than this, per point that is: it was not found either.
MOST_STRAY = 0.1
#: A scan smaller or larger than this, as part of the model's size, is in another unit, and in which it may be.
_SMALLEST, _LARGEST = 0.05, 50.0
_UNITS = (("m", 1000.0), ("inch", 25.4), ("um", 0.001))
#: Points that lie about a surface by chance spread evenly: 0.58 of the limit. A part that is there is well below.
_CHANCE = 0.4


class Location(Struct, frozen=True, eq=False):
    """Where the model stands in the scan. Lengths mm, in the scan's frame.

    overlap: share of the scan within ``within`` of the model. rms: of the distances of the ``used`` points that count.
    rivals: other poses that fit as well; next_best: the best of those that do not. free, weak: "" or what the scan
    does not hold, in words.
    """

    base_from_work: Pose
    points: int
    overlap: float
    within: float
    rms: float
    used: int
    seen: SeenShare
    rivals: tuple[Rival, ...]
    next_best: Rival | None
    free: str
    weak: str


def localize(
    name: str,
    part: tuple[FloatArray, IntArray],
    scan: FloatArray,
    start: Pose | None = None,
    stage: Callable[[str], None] = lambda _: None,
) -> Location:
    """Finds the part, vertices (V, 3) and faces (F, 3), in ``scan`` (N, 3), both mm. ``InputError`` if it is not there.

    name: of the scan, for errors. start: base_from_work as far as it is known: tried too, and of poses that fit equally
    well the one that is turned least from it is taken (without it: least turned at all).
    """
    # About the middle of the scan, so that coordinates far from the origin lose no digits in single precision.
    middle = np.median(scan, axis=0)
    points = np.random.default_rng(0).permutation(scan - middle)[:_MANY]
    given = Pose(IDENTITY, (0.0, 0.0, 0.0)) if start is None else start
    given = Pose(given.rotation, _sum(given.origin, -middle))
    stage("preparing the model")
    model = model_part(*part)
    _size(name, model.size, points)
    samples = Cloud(model.samples)
    few = points[:_FEW]
    fits = _search(model, samples, points, given, stage)
    best = _best(model, samples, few, fits)
    if not math.isfinite(best.noise):
        raise _missing(name, "no pose puts it on the points")
    gate = min(max(best.noise, 1e-6 * model.size) * TUKEY, WITHIN * model.size)
    costs = [cost(model, samples, few, fit, gate) for fit in fits]
    equal = [fit for fit, c in zip(fits, costs, strict=True) if c <= min(costs) + _SAME_COST]
    chosen = min(equal, key=lambda fit: angle_between(given.rotation, frozen(fit.rotation.T)))
    stage("refining")
    final = chosen
    for some in (points[: 4 * _FEW], points):
        final = refine(model, samples, some, (final.rotation, final.origin), 1.1 * gate)
    return _judge(name, model, samples, points, middle, final, (fits, costs, gate))


def _size(name: str, size: float, points: FloatArray) -> None:
    """``InputError`` if the scan is in another unit than the model, or so large that the part is lost in it."""
    extent = float(np.linalg.norm(np.subtract(*np.percentile(points, (99, 1), axis=0))))
    if _SMALLEST * size <= extent <= _LARGEST * size:
        return
    where = f"the scan measures {extent:.3g} mm across, the model {size:.3g} mm"
    if not extent:
        raise InputError(name, "all its points are at one place")
    unit = next((unit for unit, mm in _UNITS if 0.3 * size < mm * extent < 3 * size), "")
    remedy = f"if it is in {unit}, give --units {unit}" if unit else "cut out the part, or give its --units"
    raise InputError(name, "the scan cannot show this model", where, remedy)


def _search(
    model: Model, samples: Cloud, points: FloatArray, given: Pose, stage: Callable[[str], None]
) -> list[ScanFit]:
    """Refined poses, the right one among them: near ``given``, and if the part is not clearly there, everywhere."""
    within, few = WITHIN * model.size, points[:_FEW]
    ground, sets = field(model, samples), things(model, points[:_SOME])
    same = symmetries(model, ground)
    fits: list[ScanFit] = []
    for place in (given, None):
        stage("searching everywhere" if place is None else "searching near by")
        fits += _look(model, samples, few, starts(model, ground, sets, place))
        fits += _look(model, samples, few, beside(model, samples, few, fits))
        best = _best(model, samples, few, fits)
        if best.noise < _CHANCE * within:
            fits += _look(model, samples, few, alike(best, same))
            best = _best(model, samples, few, fits)
            if not thin(model) and stray(model, samples, few, best, within) < _STRAY:
                break
    return fits


def _look(model: Model, samples: Cloud, few: FloatArray, found: Poses) -> list[ScanFit]:
    """Each pose refined with a few points, those that are far from the best with fewer."""
    poses = zip(found.rotations, found.origins, strict=True)
    fits = [refine(model, samples, few[:_FEWER], pose, 0.02 * model.size) for pose in poses]
    costs = [cost(model, samples, few[:_FEWER], fit, WITHIN * model.size) for fit in fits]
    return [
        refine(model, samples, few, (fit.rotation, fit.origin), 0.01 * model.size)
        if c < min(costs) + _FAR_COST
        else fit
        for fit, c in zip(fits, costs, strict=True)
    ]


def _best(model: Model, samples: Cloud, few: FloatArray, fits: list[ScanFit]) -> ScanFit:
    """The one that puts the points best onto the model."""
    return min(fits, key=lambda fit: cost(model, samples, few[:_FEWER], fit, WITHIN * model.size))


def _judge(
    name: str,
    model: Model,
    samples: Cloud,
    points: FloatArray,
    middle: FloatArray,
    final: ScanFit,
    others: tuple[list[ScanFit], list[float], float],
) -> Location:
    """What was found with all that speaks for and against it. ``InputError`` if it cannot be the part."""
    within = WITHIN * model.size
    rest = np.delete(points, final.used, axis=0)
    overlap = (len(final.used) + len(on(model, samples, final.apply(rest), within)[0])) / len(points)
    view = measure_seen(model, points, final, within)
    inside = stray(model, samples, points[: 4 * _FEW], final, within)
    if overlap < LEAST_OVERLAP:
        raise _missing(name, f"at best {100 * overlap:.0f} % of the points lie within {short(within, 2)} mm of it")
    if not final.noise < _CHANCE * within:
        raise _missing(name, f"at best its surface is {short(final.noise, 3)} mm rms off the points")
    if view.near < LEAST_SEEN:
        raise _missing(name, f"at best {100 * view.near:.0f} % of its near side show in the scan")
    if inside > MOST_STRAY:
        share = 100 * inside / (1 + inside)
        raise _missing(name, f"where it fits best, {share:.0f} % of the points in its box are off its surface")
    equal, following = rivals(model, final, others, _SAME_COST, middle)
    free = freedom(model, samples, points[:_FEW], final, (others[2], _SAME_COST))
    back = final.rotation.T
    origin = middle - back @ final.origin
    x, y, z = origin.tolist()
    weak = "" if free else weakness(final)
    return Location(
        Pose(frozen(back), (x, y, z)), len(points), overlap, within, final.rms, len(final.used), view, equal, following,
        free, weak,
    )  # fmt: skip


def _missing(name: str, why: str) -> InputError:
    remedy = "check that it is this part, in these units (--units), and cut away what is not the part"
    return InputError(name, "the model was not found in the scan", why, remedy)


def _sum(a: tuple[float, float, float], b: FloatArray) -> tuple[float, float, float]:
    x, y, z = (np.asarray(a) + b).tolist()
    return (x, y, z)
