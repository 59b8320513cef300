"""The pose of a CAD part in a point cloud: a search, an exact fit, and the evidence against it.

- `scans`, `clouds` and `advice` read clouds and their units.
- `clutter` leaves out strays and the bench.
- `search`, `starts` and `coarse` look for poses, `fine` refines them.
- `doubt` compares poses that fit as well, `sight` says what a scanner can see.
- `rims` and `verdict` compare the shape of the scan with that of the model.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import msgspec
import numpy as np
from msgspec import Struct

from camgen.localize.clutter import isolated
from camgen.localize.doubt import (
    Alternatives,
    Rival,
    SeenShare,
    best_of,
    decides,
    freedom,
    is_near,
    measure_seen,
    noise_limit,
    rivals,
    stray,
    weakness,
)
from camgen.localize.fine import TUKEY, ScanFit, View, costs, on, refine
from camgen.localize.model import Model, model_part
from camgen.localize.rims import run_on
from camgen.localize.search import (
    CHANCE,
    FEW,
    LEAST_SEEN,
    MOST_HIDDEN,
    PreparedModel,
    Scene,
    Tries,
    find_again,
    list_scenes,
    prepare,
    search,
    settle_bench,
    share_unseen,
)
from camgen.localize.verdict import Patch, differences
from camgen.localize.words import describe_patch, pose_values
from camgen.model.errors import InputError, NoSafeProgram
from camgen.model.part import IntArray
from camgen.model.pose import IDENTITY, FloatArray, Pose, angle_between, frozen, to_vec3
from camgen.model.text import short

#: The last fit uses this many points at most.
_MANY = 400_000
#: Poses fit equally well if their costs (0..1, see ``fine.cost``) differ by less. The comparison
#: takes this many poses at least, and all within the last difference.
_SAME_COST, _COMPARED, _FAR_COST = 0.004, 24, 0.05
#: The part was not found if less than this share of the scan lies on the model.
LEAST_OVERLAP = 0.3
#: The part was not found if the box of the model holds more points off it than this, per point on it.
MOST_STRAY = 0.1
#: A scan of less or more than this, as a share of the model's size, cannot show the model.
_SMALLEST, _LARGEST = 0.05, 50.0
#: The scan runs on beyond more than this of the part's rims: it is a place on a larger part (0.41 to 0.64 of most that
#: nothing else refused). More than the other: it may be, unless it stands where it was said to (0.13 at least of what
#: was not there; 0.00 to 0.01 where a part stood alone or on a bench; 0.08 for a block flush along a side of its top).
MOST_RUN_ON, SOME_RUN_ON = 0.3, 0.05
#: Poses turned from the start by so much more than the least one, deg, are told apart by where they are.
_AS_LITTLE = 5.0
#: Patches that a refusal names.
_LISTED = 3


class Location(Struct, frozen=True, eq=False):
    """The pose of the model in the scan. Lengths are mm, in the scan's frame.

    points: the number of points of the scan.
    overlap: the share of the points on the model; points left out do not count.
    within: the distance up to which a point is on the model.
    rms: the rms distance of the ``used`` points.
    seen: the shares of the surface that the scan shows.
    rivals, next_best: other poses that fit as well, and the best of the poses that do not.
    free, weak: a motion that the scan does not hold, or holds weakly, in words; else "".
    told_apart: surfaces nearer to each other than this are one in the noise.
    run_on: the share 0..1 of the rims beyond which the scan runs on.
    patches: the differences between scan and model.
    isolated, bench: the numbers of points that were left out as strays and as the bench.
    again: the poses of further parts in the scan.
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
    patches: tuple[Patch, ...]
    isolated: int
    bench: int
    again: tuple[Pose, ...]


def localize(
    name: str,
    part: tuple[FloatArray, IntArray],
    scan: FloatArray,
    start: Pose | None = None,
    stage: Callable[[str], None] = lambda _: None,
    viewpoint: FloatArray | None = None,
) -> Location:
    """Finds a part in a scan.

    name: the name of the scan, for errors.
    part: vertices (V, 3), mm, and faces (F, 3).
    scan: points (N, 3), mm.
    start: base_from_work, as far as it is known. The search begins there. If several poses fit
        equally well, the pose with the least turn from it is taken; without it, the least turn.
    viewpoint: the scanner's place (3,), mm, in the scan's frame. The scanner did not see surface
        that the part hides from there.

    Raises InputError if the part is not there. Raises NoSafeProgram if the scan shows another
    shape, if it may show a larger part, or if another pose fits as well, moves the surface by more
    than the noise, and ``start`` does not decide.
    """
    # About the middle of the scan, so that coordinates far from the origin lose no digits in single precision.
    middle = np.median(scan, axis=0)
    centred = np.random.default_rng(0).permutation(scan - middle)[:_MANY]
    eye = None if viewpoint is None else np.asarray(viewpoint, dtype=np.float64) - middle
    given = Pose(IDENTITY, (0.0, 0.0, 0.0)) if start is None else start
    given = Pose(given.rotation, _sum(given.origin, -middle))
    stage("preparing the model")
    model = model_part(*part)
    _size(name, model.size, centred)
    ground = prepare(model)
    together = centred[~isolated(centred)]
    tries = search(ground, list_scenes(model, together, eye), given, stage)
    if not math.isfinite(tries.best()[0].noise):
        raise _missing(name, "no pose puts it on the points")
    tries = settle_bench(tries, together)
    scene, others = tries.scene, _compare(tries)
    equal = best_of(model, ground.samples, scene.first(4 * FEW), others, tries.best()[0])
    final = _choose(model, equal, given, start is not None)
    stage("refining")
    for points in (scene.view.points[: 4 * FEW], scene.view.points):
        final = refine(
            model, ground.samples, points, (final.rotation, final.origin), 1.1 * others.gate
        )
    return _judge(
        _CentredScan(name, centred, together, middle, start), ground, scene, final, others
    )


def _compare(tries: Tries) -> Alternatives:
    """The better of the fits that were tried, with their costs."""
    ground, (best, worst) = tries.ground, tries.best()
    gate = min(max(best.noise, 1e-6 * ground.model.size) * TUKEY, ground.within)
    order = sorted(range(len(tries.fits)), key=tries.costs.__getitem__)
    near = sum(each <= worst + _FAR_COST for each in tries.costs)
    fits = [tries.fits[k] for k in order[: max(near, _COMPARED)]]
    worth = costs(ground.model, ground.samples, tries.scene.first(FEW), fits, gate, _SAME_COST)
    return Alternatives(fits, worth, gate, _SAME_COST)


def _choose(model: Model, equal: list[ScanFit], given: Pose, known: bool) -> ScanFit:
    """The pose with the least turn from the given one, of poses that fit equally well.

    If the given place is ``known``, the nearest of the poses that are turned as little.
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
    """Raises InputError if the scan is in another unit than the model, or too large for it."""
    extent = float(np.linalg.norm(np.subtract(*np.percentile(points, (99, 1), axis=0))))
    if _SMALLEST * size <= extent <= _LARGEST * size:
        return
    where = f"the scan measures {extent:.3g} mm across, the model {size:.3g} mm"
    if not extent:
        raise InputError(name, "all its points are at one place")
    remedy = "cut out the part, or give the units: --units, --model-units"
    raise InputError(name, "the scan cannot show this model", where, remedy)


class _CentredScan(Struct, frozen=True, eq=False):
    """A scan about its middle, in mm.

    name: the name of the scan.
    points: (N, 3), all points.
    together: (M, 3), the points without the isolated ones.
    middle: (3,), in the frame of the scan.
    start: base_from_work, as far as it is known.
    """

    name: str
    points: FloatArray
    together: FloatArray
    middle: FloatArray
    start: Pose | None


def _judge(
    centred: _CentredScan, ground: PreparedModel, scene: Scene, final: ScanFit, others: Alternatives
) -> Location:
    """The location with its evidence.

    Raises InputError if it cannot be the part. Raises NoSafeProgram if the part may be elsewhere,
    or if the scan shows another shape.
    """
    model, samples = ground.model, ground.samples
    name, points, view = centred.name, scene.view.points, scene.view
    within = ground.within
    rest = np.delete(points, final.used, axis=0)
    lying = len(final.used) + len(on(model, samples, final.apply(rest), within).point)
    overlap = lying / len(points)
    if overlap < LEAST_OVERLAP:
        raise _missing(
            name,
            f"at best {100 * overlap:.0f} % of the points lie within {short(within, 2)} mm of it",
        )
    if not final.noise < CHANCE * within:
        raise _missing(
            name, f"at best its surface is {short(final.noise, 3)} mm rms off the points"
        )
    seen = _refuse_unseen(centred, ground, view, final, others.gate)
    equal, following = rivals(model, samples, points[: 4 * FEW], final, others, centred.middle)
    free, moved = freedom(model, samples, scene.first(FEW), final, (others.gate, others.same))
    weak = "" if free else weakness(final)
    patches = differences(model, samples, view, final)
    location = Location(
        _place(final, centred.middle), len(centred.points), overlap, within, final.rms, len(final.used), seen, equal,
        following, free, weak, noise_limit(model, final), run_on(model, samples, points, final), tuple(patches),
        len(centred.points) - len(centred.together), len(centred.together) - len(points), (),
    )  # fmt: skip
    _refuse_larger(centred, model, location)
    _refuse_unsettled(name, model, location, moved, centred.start, view.eye is not None)
    _refuse_other_shape(centred, model, location, view.eye is not None)
    again = find_again(ground, view, final)
    return msgspec.structs.replace(
        location, again=tuple(_place(fit, centred.middle) for fit in again)
    )


def _place(fit: ScanFit, middle: FloatArray) -> Pose:
    """base_from_work of a fit to points about ``middle`` (3,)."""
    back = fit.rotation.T
    return Pose(frozen(back), to_vec3(middle - back @ fit.origin))


def _refuse_unseen(
    centred: _CentredScan, ground: PreparedModel, view: View, final: ScanFit, gate: float
) -> SeenShare:
    """The shares of the surface that show.

    Raises InputError if they are too small, or if the scanner cannot have seen that surface.
    """
    model, samples, name = ground.model, ground.samples, centred.name
    within = ground.within
    hides = share_unseen(ground, view, final, gate)
    if hides > MOST_HIDDEN:
        why = (
            f"where it fits best, it hides {100 * hides:.0f} % of the points on it from the scanner"
        )
        raise InputError(
            name,
            "the model was not found in the scan",
            why,
            "check --viewpoint: where the scanner stood",
        )
    seen = measure_seen(model, samples, view, final, within)
    inside = stray(model, samples, view.points[: 4 * FEW], final, within)
    if seen.near < LEAST_SEEN:
        raise _missing(name, f"at best {100 * seen.near:.0f} % of its near side show in the scan")
    if inside > MOST_STRAY:
        share = 100 * inside / (1 + inside)
        raise _missing(
            name, f"where it fits best, {share:.0f} % of the points in its box are off its surface"
        )
    return seen


def _refuse_other_shape(
    centred: _CentredScan, model: Model, location: Location, seen_from: bool
) -> None:
    """Raises NoSafeProgram if surface is missing, or if the scan runs on at the end of the model.

    A start near the pose decides that a neighbour runs on there, and that a scan which lets the
    part slide does not show its ends.
    """
    known = centred.start is not None and is_near(model, centred.start, location.base_from_work)
    against = [
        patch for patch in location.patches if not (known and (patch.beyond or location.free))
    ]
    if against:
        raise NoSafeProgram(
            centred.name,
            "the scan does not show the shape of the model",
            _list_patches(against),
            "check that it is this part and not a variant of it, "
            f"{'' if seen_from else 'say where the scanner stood with --viewpoint, '}"
            "and cut away what is not the part",
        )


def _list_patches(patches: Sequence[Patch]) -> str:
    more = f" and {len(patches) - _LISTED} more" if len(patches) > _LISTED else ""
    return "; ".join(describe_patch(patch) for patch in patches[:_LISTED]) + more


def _refuse_larger(centred: _CentredScan, model: Model, location: Location) -> None:
    """Raises InputError if the scan shows a larger part at the place.

    Raises NoSafeProgram if it may, and the start is not near.
    """
    why = f"the scan runs on beyond {100 * location.run_on:.0f} % of its rims"
    if location.run_on > MOST_RUN_ON:
        raise _missing(centred.name, f"where it fits best, {why}")
    if location.run_on > SOME_RUN_ON and not (
        centred.start and is_near(model, centred.start, location.base_from_work)
    ):
        remedy = "cut away what is flush with it, or say about where the part stands with --start"
        what = "the scan does not settle whether it shows the part or a larger one"
        places = f": {_list_patches(location.patches)}" if location.patches else ""
        raise NoSafeProgram(centred.name, what, f"where it fits best, {why}{places}", remedy)


def _refuse_unsettled(
    name: str, model: Model, location: Location, moved: float, start: Pose | None, seen_from: bool
) -> None:
    """Raises NoSafeProgram if the surface may be elsewhere by more than the noise.

    A start may decide which place it is.

    moved: the distance by which a motion that changes nothing takes the surface, mm.
    """
    if location.free and moved > location.told_apart and start is None:
        why = f"{location.free} changes nothing"
    else:
        open_ones = [rival for rival in location.rivals if rival.off > location.told_apart]
        if start is not None:
            open_ones = [
                r
                for r in open_ones
                if not decides(model, start, location.base_from_work, r.base_from_work)
            ]
        if not open_ones:
            return
        other = max(open_ones, key=lambda rival: rival.off)
        pose = f"a pose turned by {other.turn:.1f} deg and moved by {short(other.shift, 2)} mm"
        both = f"{pose_values(location.base_from_work)} or {pose_values(other.base_from_work)}"
        why = f"{pose} fits as well; it puts the surface up to {short(other.off, 2)} mm elsewhere: {both}"
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
    remedy = "check that it is this part, in these units (--units, --model-units), and cut away what is not the part"
    return InputError(name, "the model was not found in the scan", why, remedy)


def _sum(a: tuple[float, float, float], b: FloatArray) -> tuple[float, float, float]:
    return to_vec3(np.asarray(a) + b)
