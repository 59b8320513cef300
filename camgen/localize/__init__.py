"""Where a CAD part stands in a point cloud: a coarse search from everywhere, an exact fit, and what speaks against it.

``localize`` is the walk; ``scans`` reads clouds, ``starts`` and ``coarse`` search,
``nearest`` and ``fine`` refine, ``sight`` says what the scanner can have seen, ``rims`` whether the scan ends where the
part does, ``doubt`` looks for other poses that fit as well.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from msgspec import Struct

from camgen.localize.coarse import Poses, field
from camgen.localize.doubt import (
    Alternatives,
    Rival,
    SeenShare,
    alike,
    beside,
    decides,
    freedom,
    is_near,
    measure_seen,
    noise_limit,
    rivals,
    stray,
    thin,
    weakness,
)
from camgen.localize.fine import TUKEY, ScanFit, View, costs, on, refine, refine_all
from camgen.localize.model import Cloud, Model, model_part
from camgen.localize.rims import run_on
from camgen.localize.sight import hidden
from camgen.localize.starts import starts, symmetries, things
from camgen.model.errors import InputError, NoSafeProgram
from camgen.model.part import IntArray
from camgen.model.pose import IDENTITY, FloatArray, Pose, angle_between, frozen, to_vec3
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
#: Less than this of the scan on the model, or of what the scanner could see in the scan: the part was not found.
LEAST_OVERLAP, LEAST_SEEN = 0.3, 0.7
#: More points in the model's box that are not on it than this, per point that is: it was not found either.
MOST_STRAY = 0.1
#: A scan smaller or larger than this, as part of the model's size, is in another unit, or does not show it.
_SMALLEST, _LARGEST = 0.05, 50.0
#: More of the points than this hidden from the scanner by the part that they lie on: it does not stand there.
MOST_HIDDEN = 0.1
#: The scan runs on beyond more than this of the part's rims: it is a place on a larger part (0.41 to 0.64 of most that
#: nothing else refused). More than the other: it may be, unless it stands where it was said to (0.13 at least of what
#: was not there; 0.00 to 0.01 where a part stood alone or on a bench; 0.08 for a block flush along a side of its top).
MOST_RUN_ON, SOME_RUN_ON = 0.3, 0.05
#: Poses turned from the start by so much more than the least one, deg, are told apart by where they are.
_AS_LITTLE = 5.0
#: Points that lie about a surface by chance spread evenly: 0.58 of the limit. A part that is there is well below.
_CHANCE = 0.4


class Location(Struct, frozen=True, eq=False):
    """Where the model stands in the scan. Lengths mm, in the scan's frame.

    overlap: share of the scan within ``within`` of the model. rms: of the distances of the ``used`` points that count.
    rivals: other poses that fit as well; next_best: the best of those that do not. free, weak: "" or what the scan
    does not hold, in words. told_apart: mm, surfaces that are nearer to each other the noise does not tell apart.
    run_on: share 0..1 of the rims that show beyond which the scan runs on.
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
    told_apart: float
    run_on: float


def localize(
    name: str,
    part: tuple[FloatArray, IntArray],
    scan: FloatArray,
    start: Pose | None = None,
    stage: Callable[[str], None] = lambda _: None,
    viewpoint: FloatArray | None = None,
) -> Location:
    """Finds the part, vertices (V, 3) and faces (F, 3), in ``scan`` (N, 3), both mm. ``InputError`` if it is not there,
    ``NoSafeProgram`` if it may as well stand where its surface is elsewhere, by more than the noise, or be a place on a
    larger part, and ``start`` does not decide that.

    name: of the scan, for errors. start: base_from_work as far as it is known: tried too, and of poses that fit equally
    well the one that is turned least from it is taken (without it: least turned at all). viewpoint: (3,) where the
    scanner stood, in the scan's frame, mm: what the part hides from there was not seen.
    """
    # About the middle of the scan, so that coordinates far from the origin lose no digits in single precision.
    middle = np.median(scan, axis=0)
    points = np.random.default_rng(0).permutation(scan - middle)[:_MANY]
    eye = None if viewpoint is None else np.asarray(viewpoint, dtype=np.float64) - middle
    given = Pose(IDENTITY, (0.0, 0.0, 0.0)) if start is None else start
    given = Pose(given.rotation, _sum(given.origin, -middle))
    stage("preparing the model")
    model = model_part(*part)
    _size(name, model.size, points)
    samples = Cloud(model.samples)
    few = points[:_FEW]
    fits = _search(model, samples, points, given, stage, eye)
    best = _best(model, samples, few, fits, eye)
    if not math.isfinite(best.noise):
        raise _missing(name, "no pose puts it on the points")
    gate = min(max(best.noise, 1e-6 * model.size) * TUKEY, WITHIN * model.size)
    worth = costs(model, samples, View(few, eye), fits, gate, _SAME_COST)
    equal = [fit for fit, c in zip(fits, worth, strict=True) if c <= min(worth) + _SAME_COST]
    chosen = _choose(model, equal, given, start is not None)
    stage("refining")
    final = chosen
    for some in (points[: 4 * _FEW], points):
        final = refine(model, samples, some, (final.rotation, final.origin), 1.1 * gate)
    return _judge(
        _Told(name, points, middle, eye, start),
        model,
        samples,
        final,
        Alternatives(fits, worth, gate, _SAME_COST),
    )


def _choose(model: Model, equal: list[ScanFit], given: Pose, known: bool) -> ScanFit:
    """Of the poses that fit equally well the one turned least from the given one; of those turned as little the nearest
    to it, if where it is was ``known``.
    """
    turns = [angle_between(given.rotation, frozen(fit.rotation.T)) for fit in equal]
    if not known:
        return equal[int(np.argmin(turns))]
    least = [
        fit
        for fit, turn in zip(equal, turns, strict=True)
        if turn <= min(turns) + math.radians(_AS_LITTLE)
    ]
    middle = (model.low + model.high) / 2
    where = np.asarray(given.rotation) @ middle + np.asarray(given.origin)
    return min(
        least, key=lambda fit: float(np.linalg.norm((middle - fit.origin) @ fit.rotation - where))
    )


def _size(name: str, size: float, points: FloatArray) -> None:
    """``InputError`` if the scan is in another unit than the model, or so large that the part is lost in it."""
    extent = float(np.linalg.norm(np.subtract(*np.percentile(points, (99, 1), axis=0))))
    if _SMALLEST * size <= extent <= _LARGEST * size:
        return
    where = f"the scan measures {extent:.3g} mm across, the model {size:.3g} mm"
    if not extent:
        raise InputError(name, "all its points are at one place")
    remedy = "cut out the part, or give the units: --units, --model-units"
    raise InputError(name, "the scan cannot show this model", where, remedy)


def _search(
    model: Model,
    samples: Cloud,
    points: FloatArray,
    given: Pose,
    stage: Callable[[str], None],
    eye: FloatArray | None,
) -> list[ScanFit]:
    """Refined poses, the right one among them: near ``given``, and if the part is not clearly there, everywhere."""
    within, few = WITHIN * model.size, points[:_FEW]
    ground, sets = field(model, samples), things(model, points[:_SOME])
    same = symmetries(model, ground)
    fits: list[ScanFit] = []
    for place in (given, None):
        stage("searching everywhere" if place is None else "searching near by")
        fits += _look(model, samples, few, starts(model, ground, sets, place))
        fits += _look(model, samples, few, beside(model, samples, few[:_FEWER], fits))
        best = _best(model, samples, few, fits, eye)
        if best.noise < _CHANCE * within:
            fits += _look(model, samples, few, alike(best, same))
            best = _best(model, samples, few, fits, eye)
            if _share_hidden(model, samples, few[:_FEWER], best, within, eye) > MOST_HIDDEN:
                continue
            if not thin(model) and stray(model, samples, few, best, within) < _STRAY:
                break
    return fits


def _look(model: Model, samples: Cloud, few: FloatArray, found: Poses) -> list[ScanFit]:
    """Each pose refined with a few points, those that are far from the best with fewer."""
    poses = list(zip(found.rotations, found.origins, strict=True))
    fits = refine_all(model, samples, few[:_FEWER], poses, 0.02 * model.size)
    worth = costs(model, samples, View(few[:_FEWER]), fits, WITHIN * model.size)
    near = [k for k, c in enumerate(worth) if c < min(worth) + _FAR_COST]
    again = [(fits[k].rotation, fits[k].origin) for k in near]
    for k, fit in zip(near, refine_all(model, samples, few, again, 0.01 * model.size), strict=True):
        fits[k] = fit
    return fits


def _best(
    model: Model, samples: Cloud, few: FloatArray, fits: list[ScanFit], eye: FloatArray | None
) -> ScanFit:
    """The one that puts the points best onto the model."""
    worth = costs(model, samples, View(few[:_FEWER], eye), fits, WITHIN * model.size)
    return fits[int(np.argmin(worth))]


def _share_hidden(
    model: Model,
    samples: Cloud,
    points: FloatArray,
    fit: ScanFit,
    reach: float,
    eye: FloatArray | None,
) -> float:
    """Of the points that lie on the model the share that it hides from the scanner."""
    if eye is None:
        return 0.0
    there = on(model, samples, fit.apply(points), reach)[2]
    return float(hidden(model, there, fit.apply(eye), reach).mean()) if len(there) else 0.0


class _Told(Struct, frozen=True, eq=False):
    """What is known of a scan: its name, the points (N, 3) about its middle (3,), where the scanner stood, about that
    too, and about where the part stands.
    """

    name: str
    points: FloatArray
    middle: FloatArray
    eye: FloatArray | None
    start: Pose | None


def _judge(
    told: _Told,
    model: Model,
    samples: Cloud,
    final: ScanFit,
    others: Alternatives,
) -> Location:
    """What was found with all that speaks for and against it. ``InputError`` if it cannot be the part,
    ``NoSafeProgram`` if it could be elsewhere.
    """
    name, points, eye = told.name, told.points, told.eye
    within = WITHIN * model.size
    rest = np.delete(points, final.used, axis=0)
    overlap = (len(final.used) + len(on(model, samples, final.apply(rest), within)[0])) / len(
        points
    )
    if overlap < LEAST_OVERLAP:
        raise _missing(
            name,
            f"at best {100 * overlap:.0f} % of the points lie within {short(within, 2)} mm of it",
        )
    if not final.noise < _CHANCE * within:
        raise _missing(
            name, f"at best its surface is {short(final.noise, 3)} mm rms off the points"
        )
    view = _refuse_unseen(told, model, samples, final, others.gate)
    equal, following = rivals(model, samples, points[: 4 * _FEW], final, others, told.middle)
    free, away = freedom(model, samples, points[:_FEW], final, (others.gate, others.same), eye)
    back = final.rotation.T
    base_from_work = Pose(frozen(back), to_vec3(told.middle - back @ final.origin))
    weak = "" if free else weakness(final)
    found = Location(
        base_from_work, len(points), overlap, within, final.rms, len(final.used), view, equal, following,
        free, weak, noise_limit(model, final), run_on(model, samples, points, final),
    )  # fmt: skip
    _refuse_larger(told, model, found)
    _refuse_unsettled(name, model, found, away, told.start, eye is not None)
    return found


def _refuse_unseen(
    told: _Told, model: Model, samples: Cloud, final: ScanFit, gate: float
) -> SeenShare:
    """How much of the part shows. ``InputError`` if that is too little, or what shows could not be seen."""
    name, points, eye = told.name, told.points, told.eye
    within, some = WITHIN * model.size, points[: 4 * _FEW]
    unseen = _share_hidden(model, samples, some, final, gate, eye)
    if unseen > MOST_HIDDEN:
        why = f"where it fits best, it hides {100 * unseen:.0f} % of the points on it from the scanner"
        raise InputError(
            name,
            "the model was not found in the scan",
            why,
            "check --viewpoint: where the scanner stood",
        )
    view = measure_seen(model, samples, points, final, within, eye)
    inside = stray(model, samples, some, final, within)
    if view.near < LEAST_SEEN:
        raise _missing(name, f"at best {100 * view.near:.0f} % of its near side show in the scan")
    if inside > MOST_STRAY:
        share = 100 * inside / (1 + inside)
        raise _missing(
            name, f"where it fits best, {share:.0f} % of the points in its box are off its surface"
        )
    return view


def _refuse_larger(told: _Told, model: Model, found: Location) -> None:
    """``InputError`` if the scan shows a larger part at the place, ``NoSafeProgram`` if it may, and the start is not
    near.
    """
    why = f"the scan runs on beyond {100 * found.run_on:.0f} % of its rims"
    if found.run_on > MOST_RUN_ON:
        raise _missing(told.name, f"where it fits best, {why}")
    if found.run_on > SOME_RUN_ON and not (
        told.start and is_near(model, told.start, found.base_from_work)
    ):
        remedy = "cut away what is flush with it, or say about where the part stands with --start"
        what = "the scan does not settle whether it shows the part or a larger one"
        raise NoSafeProgram(told.name, what, f"where it fits best, {why}", remedy)


def _refuse_unsettled(
    name: str, model: Model, found: Location, away: float, start: Pose | None, seen_from: bool
) -> None:
    """``NoSafeProgram`` if the surface may as well be elsewhere, by more than the noise, and ``start`` does not say
    which it is.

    away: mm, how far the motion takes the surface that changes nothing.
    """
    if found.free and away > found.told_apart and start is None:
        why = f"{found.free} changes nothing"
    else:
        open_ones = [rival for rival in found.rivals if rival.off > found.told_apart]
        if start is not None:
            open_ones = [
                r
                for r in open_ones
                if not decides(model, start, found.base_from_work, r.base_from_work)
            ]
        if not open_ones:
            return
        other = max(open_ones, key=lambda rival: rival.off)
        pose = f"a pose turned by {other.turn:.1f} deg and moved by {short(other.shift, 2)} mm"
        why = f"{pose} fits as well; it puts the surface up to {short(other.off, 2)} mm elsewhere"
    place = (
        "about where the part stands with --start"
        if start is None
        else "more exactly where the part stands with --start"
    )
    remedy = place if seen_from else f"where the scanner stood with --viewpoint, or {place}"
    raise NoSafeProgram(
        name,
        "the scan does not settle where the part stands",
        why,
        f"say {remedy}, or scan it from more sides",
    )


def _missing(name: str, why: str) -> InputError:
    remedy = (
        "check that it is this part, in these units (--units), and cut away what is not the part"
    )
    return InputError(name, "the model was not found in the scan", why, remedy)


def _sum(a: tuple[float, float, float], b: FloatArray) -> tuple[float, float, float]:
    return to_vec3(np.asarray(a) + b)
