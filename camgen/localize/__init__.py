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

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.localize.clutter import find_isolated
from camgen.localize.doubt import (
    SAME_COST,
    Alternatives,
    Rival,
    SeenShare,
    compute_noise_limit,
    find_free_motion,
    find_rivals,
    find_weak_motion,
    is_decided,
    is_near,
    measure_seen,
    measure_stray,
    select_best,
)
from camgen.localize.fine import TUKEY, ScanFit, View, compute_costs, refine
from camgen.localize.model import Model, find_touched_within, make_model
from camgen.localize.rims import measure_run_on
from camgen.localize.search import (
    CHANCE,
    FAR_COST,
    FEW,
    LEAST_SEEN,
    MOST_HIDDEN,
    PreparedModel,
    Tries,
    find_further,
    list_views,
    measure_unseen,
    prepare_model,
    remove_bench,
    search_poses,
)
from camgen.localize.verdict import Patch, find_differences
from camgen.localize.words import describe_patch, format_values
from camgen.model.errors import InputError, NoSafeProgram
from camgen.model.part import IntArray
from camgen.model.pose import IDENTITY, FloatArray, Pose, angle_between, frozen, to_vec3
from camgen.model.sequences import take_rows
from camgen.model.text import short

#: Maximum number of points of a scan that are used. More are drawn with a fixed seed.
_MANY = 400_000
#: Number of points that decide between poses that fit about equally well.
_DECIDING = 4 * FEW
#: Minimum number of poses that are compared. All whose cost is near to the best one are.
_COMPARED = 24
#: The part was not found if less than this share of the scan lies on the model.
LEAST_OVERLAP = 0.3
#: The part was not found if its box holds more points off the model than this, per point on it.
MOST_STRAY = 0.1
#: A scan of less or more than this, as a share of the model's size, cannot show the model.
_SMALLEST, _LARGEST = 0.05, 50.0
#: The scan runs on beyond more than this share of the part's rims: the model fits into a larger
#: part. The share was 0.41 to 0.64 for most of the wrong poses that nothing else refused.
MOST_RUN_ON = 0.3
#: The scan runs on beyond more than this: the part may be larger, unless a start is near. The share
#: was 0.13 or more for parts that were not there, 0.00 to 0.01 for a part alone or on a bench, and
#: 0.08 for a block that is flush along a side of its top.
SOME_RUN_ON = 0.05
#: Poses are turned about as little from the start as the best of them, up to this angle, deg. Then
#: their places decide.
_AS_LITTLE = 5.0
#: Maximum number of patches that a refusal names.
_LISTED = 3


class Location(Struct, frozen=True, eq=False):
    """The pose of the model in the scan. Lengths are mm, in the scan's frame.

    points: the number of points of the scan.
    overlap: the share of the points on the model; points left out do not count.
    within: the distance up to which a point is on the model.
    rms: the rms distance of the `used` points.
    seen: the shares of the surface that the scan shows.
    rivals, next_best: other poses that fit as well, and the best of the poses that do not.
    free, weak: a motion that the scan does not hold, or holds weakly, in words; else "".
    noise_limit: the distance up to which the noise makes two surfaces one.
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
    noise_limit: float
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
        equally well, the one turned least from it is taken. Without it, the one turned least.
    viewpoint: the scanner's place (3,), mm, in the scan's frame. The scanner did not see surface
        that the part hides from there.

    Raises InputError if the part is not there. Raises NoSafeProgram if the scan shows another
    shape, if it may show a larger part, or if another pose fits as well, moves the surface by more
    than the noise, and `start` does not decide.
    """
    # The points are relative to the middle of the scan. Single precision then loses no digits.
    middle = np.median(scan, axis=0)
    points = np.random.default_rng(0).permutation(scan - middle)[:_MANY]
    eye = None if viewpoint is None else np.asarray(viewpoint, dtype=np.float64) - middle
    given = Pose(IDENTITY, (0.0, 0.0, 0.0)) if start is None else start
    given = Pose(given.rotation, to_vec3(np.asarray(given.origin) - middle))
    stage("preparing the model")
    model = make_model(*part)
    _check_size(name, model.size, points)
    prepared = prepare_model(model)
    together = points[~find_isolated(points)]
    centred = _CentredScan(name, points, together, middle, start, viewpoint is not None)
    tries = search_poses(prepared, list_views(model, together, eye), given, stage)
    if not math.isfinite(tries.best()[0].noise):
        raise _not_found(name, "no pose puts it on the points")
    tries = remove_bench(tries, together)
    view, others = tries.view, _compare_fits(tries)
    equal = select_best(model, view.first(_DECIDING), others, tries.best()[0])
    final = _choose_fit(model, equal, given, start is not None)
    stage("refining")
    for used in (view.points[:_DECIDING], view.points):
        final = refine(model, used, (final.rotation, final.origin), 1.1 * others.gate)
    return _collect_evidence(centred, prepared, view, final, others)


def _compare_fits(tries: Tries) -> Alternatives:
    """The best of the fits that were tried, with their costs from more points."""
    model, within, (best, lowest) = tries.prepared.model, tries.prepared.within, tries.best()
    gate = min(max(best.noise, 1e-6 * model.size) * TUKEY, within)
    near = int((np.array(tries.costs) <= lowest + FAR_COST).sum())
    fits = take_rows(tries.fits, tries.sort()[: max(near, _COMPARED)])
    costs = compute_costs(model, tries.view.first(FEW), fits, gate, SAME_COST)
    order = sorted(range(len(fits)), key=costs.__getitem__)
    return Alternatives(take_rows(fits, order), sorted(costs), gate)


def _choose_fit(model: Model, equal: list[ScanFit], given: Pose, known: bool) -> ScanFit:
    """The pose turned least from the given one, of poses that fit equally well.

    If the given pose is `known`, it is the nearest of the poses that are turned about as little.
    """
    turns = [angle_between(given.rotation, frozen(fit.rotation.T)) for fit in equal]
    if not known:
        return equal[int(np.argmin(turns))]
    limit = min(turns) + math.radians(_AS_LITTLE)
    least = [fit for fit, turn in zip(equal, turns, strict=True) if turn <= limit]
    middle = (model.low + model.high) / 2
    wanted = np.asarray(given.rotation) @ middle + np.asarray(given.origin)

    def measure_shift(fit: ScanFit) -> float:
        return float(np.linalg.norm((middle - fit.origin) @ fit.rotation - wanted))

    return min(least, key=measure_shift)


def _check_size(name: str, size: float, points: FloatArray) -> None:
    extent = float(np.linalg.norm(np.subtract(*np.percentile(points, (99, 1), axis=0))))
    if _SMALLEST * size <= extent <= _LARGEST * size:
        return
    if not extent:
        raise InputError(name, "all its points are at one place")
    raise InputError(
        name,
        "the scan cannot show this model",
        f"the scan measures {extent:.3g} mm across, the model {size:.3g} mm",
        "cut out the part, or give the units: --units, --model-units",
    )


class _CentredScan(Struct, frozen=True, eq=False):
    """A scan relative to its middle, in mm.

    name: the name of the scan.
    points: (N, 3), all points.
    together: (M, 3), the points without the isolated ones.
    middle: (3,), in the frame of the scan.
    start: base_from_work, as far as it is known.
    has_viewpoint: whether the place of the scanner is known.
    """

    name: str
    points: FloatArray
    together: FloatArray
    middle: FloatArray
    start: Pose | None
    has_viewpoint: bool

    def starts_near(self, model: Model, pose: Pose) -> bool:
        """Whether a start is known and near the pose."""
        return self.start is not None and is_near(model, self.start, pose)


def _collect_evidence(
    centred: _CentredScan,
    prepared: PreparedModel,
    view: View,
    final: ScanFit,
    others: Alternatives,
) -> Location:
    """The location with its evidence.

    Raises InputError if it cannot be the part. Raises NoSafeProgram if the part may be elsewhere,
    or if the scan shows another shape.
    """
    model, within, name, points = prepared.model, prepared.within, centred.name, view.points
    rest = np.delete(points, final.used, axis=0)
    lying = len(final.used) + len(find_touched_within(model, final.apply(rest), within).point)
    overlap = lying / len(points)
    if overlap < LEAST_OVERLAP:
        raise _not_found(
            name,
            f"at best {100 * overlap:.0f} % of the points lie within {short(within, 2)} mm of it",
        )
    if not final.noise < CHANCE * within:
        raise _not_found(
            name, f"at best its surface is {short(final.noise, 3)} mm rms off the points"
        )
    seen = _measure_shown(name, prepared, view, final, others.gate)
    rivals, following = find_rivals(model, points[:_DECIDING], final, others, centred.middle)
    free, moved = find_free_motion(model, view.first(FEW), final, others.gate)
    location = Location(
        base_from_work=final.invert(centred.middle),
        points=len(centred.points),
        overlap=overlap,
        within=within,
        rms=final.rms,
        used=len(final.used),
        seen=seen,
        rivals=rivals,
        next_best=following,
        free=free,
        weak="" if free else find_weak_motion(final),
        noise_limit=compute_noise_limit(model, final),
        run_on=measure_run_on(model, points, final),
        patches=tuple(find_differences(model, view, final)),
        isolated=len(centred.points) - len(centred.together),
        bench=len(centred.together) - len(points),
        again=(),
    )
    _check_rims(centred, model, location)
    _check_rivals(centred, model, location, moved)
    _check_shape(centred, model, location)
    further = tuple(fit.invert(centred.middle) for fit in find_further(prepared, view, final))
    return replace(location, again=further)


def _measure_shown(
    name: str, prepared: PreparedModel, view: View, final: ScanFit, gate: float
) -> SeenShare:
    """The shares of the surface that the scan shows.

    Raises InputError if they are too small, or if the scanner cannot have seen that surface.
    """
    model, within = prepared.model, prepared.within
    unseen = measure_unseen(model, view, final, gate)
    if unseen > MOST_HIDDEN:
        verb = "give" if view.eye is None else "check"
        raise InputError(
            name,
            "the model was not found in the scan",
            f"where it fits best, it hides {100 * unseen:.0f} % of the points on it from the "
            "scanner",
            f"{verb} --viewpoint: where the scanner stood",
        )
    seen = measure_seen(model, view, final, within)
    stray = measure_stray(model, view.points[:_DECIDING], final, within)
    if seen.near < LEAST_SEEN:
        raise _not_found(name, f"at best {100 * seen.near:.0f} % of its near side show in the scan")
    if stray > MOST_STRAY:
        raise _not_found(
            name,
            f"where it fits best, {100 * stray / (1 + stray):.0f} % of the points in its box are "
            "off its surface",
        )
    return seen


def _check_rims(centred: _CentredScan, model: Model, location: Location) -> None:
    """Raises InputError if the scan shows a larger part at the place.

    Raises NoSafeProgram if it may, and the start is not near.
    """
    why = f"where it fits best, the scan runs on beyond {100 * location.run_on:.0f} % of its rims"
    if location.run_on > MOST_RUN_ON:
        raise _not_found(centred.name, why)
    is_near_start = centred.starts_near(model, location.base_from_work)
    if location.run_on > SOME_RUN_ON and not is_near_start:
        places = f": {_describe_patches(location.patches)}" if location.patches else ""
        raise NoSafeProgram(
            centred.name,
            "the scan does not settle whether it shows the part or a larger one",
            why + places,
            "cut away what is flush with it, or say about where the part stands with --start",
        )


def _check_rivals(centred: _CentredScan, model: Model, location: Location, moved: float) -> None:
    """Raises NoSafeProgram if the surface may be elsewhere by more than the noise.

    A start may decide which place it is.

    moved: the distance by which a motion that changes nothing takes the surface, mm.
    """
    pose, start = location.base_from_work, centred.start
    if location.free and moved > location.noise_limit and start is None:
        why = f"{location.free} changes nothing"
    else:
        others = []
        for rival in location.rivals:
            is_open = start is None or not is_decided(model, start, pose, rival.base_from_work)
            if is_open and rival.distance > location.noise_limit:
                others.append(rival)
        if not others:
            return
        other = max(others, key=lambda rival: rival.distance)
        why = (
            f"a pose turned by {other.turn:.1f} deg and moved by {short(other.shift, 2)} mm fits "
            f"as well; it puts the surface up to {short(other.distance, 2)} mm elsewhere: "
            f"{format_values(pose)} or {format_values(other.base_from_work)}"
        )
    exactly = "about" if start is None else "more exactly"
    place = f"{exactly} where the part stands with --start"
    if not centred.has_viewpoint:
        place = f"where the scanner stood with --viewpoint, or {place}"
    raise NoSafeProgram(
        centred.name,
        "the scan does not settle where the part stands",
        why,
        f"say {place}, or scan it from more sides",
    )


def _check_shape(centred: _CentredScan, model: Model, location: Location) -> None:
    """Raises NoSafeProgram if surface is missing, or if the scan runs on at the end of the model.

    A start near the pose decides that a neighbour runs on there, and that a scan which lets the
    part slide does not show its ends.
    """
    against = list(location.patches)
    if centred.starts_near(model, location.base_from_work):
        against = [patch for patch in against if not (patch.beyond or location.free)]
    if against:
        viewpoint = (
            "" if centred.has_viewpoint else "say where the scanner stood with --viewpoint, "
        )
        raise NoSafeProgram(
            centred.name,
            "the scan does not show the shape of the model",
            _describe_patches(against),
            "check that it is this part and not a variant of it, "
            f"{viewpoint}and cut away what is not the part",
        )


def _describe_patches(patches: Sequence[Patch]) -> str:
    more = f" and {len(patches) - _LISTED} more" if len(patches) > _LISTED else ""
    return "; ".join(map(describe_patch, patches[:_LISTED])) + more


def _not_found(name: str, where: str) -> InputError:
    return InputError(
        name,
        "the model was not found in the scan",
        where,
        "check that it is this part, in these units (--units, --model-units), "
        "and cut away what is not the part",
    )
