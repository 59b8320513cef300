"""The evidence against a pose.

- Other poses that fit as well.
- Motions of the part that the scan does not hold.
- Surface of the part that the scan does not show.
"""

from __future__ import annotations

import math
from itertools import product

import numpy as np
from msgspec import Struct

from camgen.geometry.vectors import multiply_rows
from camgen.localize.coarse import Poses, join_poses, make_turns
from camgen.localize.fine import (
    ScanFit,
    View,
    compute_cost,
    compute_costs,
    compute_losses,
    draw_pose,
    is_worse,
    refine,
)
from camgen.localize.groups import pick_rows
from camgen.localize.model import (
    Cloud,
    Model,
    find_candidates,
    find_touched,
    find_touched_within,
)
from camgen.localize.sight import (
    SeenPlaces,
    estimate_eye,
    find_shown,
    make_far_eyes,
    spread_directions,
)
from camgen.localize.starts import list_corners
from camgen.model.part import BoolArray
from camgen.model.pose import FloatArray, Pose, angle_between, frozen

#: Poses fit equally well if their costs (0..1, see `compute_cost`) differ by less.
SAME_COST = 0.004
#: Two poses are different if a corner of the model's box moves by more than this part of its size.
_DIFFERENT_SHARE = 0.01
#: The search may confuse two sides of a part that are nearer than this part of the model's size.
_THIN = 0.06
#: Maximum number of fits whose other sides are tried, and of shifts for each.
_BESIDE, _SHIFTS = 3, 6
#: The faces of a direction: the cosine between their normals, and the share of the points that has
#: to lie on them. A direction near the plane of the others is not used: the limit of the least
#: singular value of all.
_ALIKE, _FEW_NORMALS, _FLAT = 0.95, 0.03, 0.3
#: A motion is held weakly if the information about it is less than this part of the largest one.
_WEAK = 0.003
#: A motion that may be free is tried. It moves a corner of the box by this part of the size.
_NUDGE = 0.05
#: Number of samples of which it is tested whether they were seen, and the cosine between a face and
#: the line of sight above which the face is seen.
_SEEN_SAMPLES, _FACING = 4000, 0.3
#: Number of samples with which the place of the scanner is estimated. One side of the part was seen
#: if the mean of the normals that were seen is longer than this.
_VIEW_SAMPLES, _ONE_SIDED = 800, 0.2
#: Two normals belong to opposite sides if their cosine is less than this.
_OPPOSITE = -0.5
#: Two surfaces are as good as one if they are nearer than this many standard deviations of the
#: noise, or than this part of the model's size. Its triangles may leave the part by the latter.
_BEYOND_NOISE, _BEYOND_SIZE = 3.0, 2e-4
#: A pose that is drawn onto another one may cost more by this.
_TWIN_COST = 0.004
#: Number of samples, and of corners of triangles, whose distance from another surface is measured.
_SPOTS = 1000
#: A start decides between two poses if it is at most this part of the distance from the one.
_DECIDED = 0.4
#: A start is near a pose if each corner of the model's box is nearer than this part of its size.
_NEAR = 0.2


class Rival(Struct, frozen=True, eq=False):
    """Another pose of the model in the scan, compared with the chosen one.

    turn: angle between the two, deg.
    shift: distance between the middles of the model's box, mm.
    cost: excess of its cost, 0..1.
    distance: largest distance of its surface from that of the chosen pose, mm. It is not measured
        for a pose that fits worse, and inf.
    """

    base_from_work: Pose
    turn: float
    shift: float
    cost: float
    distance: float


class SeenShare(Struct, frozen=True):
    """Shares of the model's surface that have points of the scan, 0..1.

    all: share of the whole surface.
    near: share of the surface that the scanner can see.
    """

    all: float
    near: float


class Alternatives(Struct, frozen=True, eq=False):
    """Fits that were tried, the best first.

    fits, costs: each fit with its cost, 0..1.
    gate: distance of the costs, mm.
    """

    fits: list[ScanFit]
    costs: list[float]
    gate: float


# Other poses that fit as well.


def select_best(model: Model, view: View, others: Alternatives, final: ScanFit) -> list[ScanFit]:
    """The different fits that are not worse than the best one by more than chance.

    view: more points than those that chose the fits.
    final: any of the fits. Its noise decides which fits are different.
    """
    limit = _compute_pose_limit(model, final)
    kept: list[ScanFit] = []
    for fit, cost in zip(others.fits, others.costs, strict=True):
        if cost <= others.costs[0] + SAME_COST and _is_different(model, fit, kept, limit):
            kept.append(fit)
    losses = [compute_losses(model, view, fit, others.gate) for fit in kept]
    best = min(losses, key=lambda loss: float(loss.sum()))
    return [fit for fit, loss in zip(kept, losses, strict=True) if not is_worse(loss, best)]


def find_rivals(
    model: Model, points: FloatArray, final: ScanFit, others: Alternatives, middle: FloatArray
) -> tuple[tuple[Rival, ...], Rival | None]:
    """Poses that fit as well as the final one, in order of their turn, and the best of the rest.

    The latter is None if all other poses fit as well.

    points: (N, 3), refine the poses whose surface is elsewhere.
    middle: (3,), the origin of the points in the frame of the scan, mm.
    """
    limit, noise = _compute_pose_limit(model, final), compute_noise_limit(model, final)
    final_losses = compute_losses(model, View(points), final, others.gate)
    rivals: list[Rival] = []
    different: list[ScanFit] = []
    following = None
    for fit, cost in zip(others.fits, others.costs, strict=True):
        excess = cost - others.costs[0]
        if _measure_corner_distance(model, fit, final) <= limit:
            continue
        if excess > SAME_COST:
            following = _make_rival(model, fit, final, excess, middle, math.inf)
            break
        if not _is_different(model, fit, different, limit):
            continue
        different.append(fit)
        refined, distance = _refine_rival(model, points, final, fit, others.gate)
        if distance <= noise or not is_worse(
            compute_losses(model, View(points), refined, others.gate), final_losses
        ):
            rivals.append(_make_rival(model, refined, final, excess, middle, distance))
    rivals.sort(key=lambda rival: (round(rival.turn, 1), rival.shift))
    return tuple(rivals), following


def _refine_rival(
    model: Model, points: FloatArray, final: ScanFit, fit: ScanFit, gate: float
) -> tuple[ScanFit, float]:
    """The fit and the distance of its surface from the final one, mm.

    The fit is refined with more points if it is elsewhere.
    """
    noise = compute_noise_limit(model, final)
    distance = measure_surface_distance(model, final, fit)
    if distance > noise:
        fit = refine(model, points, (fit.rotation, fit.origin), gate)
        distance = measure_surface_distance(model, final, fit)
    if distance > noise:
        distance = min(distance, _measure_drawn(model, points, final, fit, gate))
    return fit, distance


def _measure_drawn(
    model: Model, points: FloatArray, final: ScanFit, fit: ScanFit, gate: float
) -> float:
    """The distance of the two surfaces after the fit is drawn onto the final pose, mm.

    A motion that the points hold badly moves equal poses by different distances; drawing undoes
    that. The distance is inf if the fit becomes another pose, or fits the points worse.
    """
    limit = _compute_pose_limit(model, final)
    samples = pick_rows(model.samples, _SPOTS)
    twin = draw_pose(model, (samples - final.origin) @ final.rotation, fit, limit)
    twin_cost = compute_cost(model, View(points), twin, gate)
    final_cost = compute_cost(model, View(points), final, gate)
    if _is_different(model, twin, [fit], limit) or twin_cost > final_cost + _TWIN_COST:
        return math.inf
    return measure_surface_distance(model, final, twin)


def _make_rival(
    model: Model, fit: ScanFit, final: ScanFit, excess: float, middle: FloatArray, distance: float
) -> Rival:
    turn = math.degrees(angle_between(frozen(final.rotation), frozen(fit.rotation)))
    moves = _scan_corners(model, fit) - _scan_corners(model, final)
    shift = float(np.linalg.norm(moves.mean(axis=0)))
    return Rival(fit.invert(middle), turn, shift, excess, distance)


def compute_noise_limit(model: Model, final: ScanFit) -> float:
    """The distance up to which the noise of the scan makes two surfaces one, mm."""
    return max(_BEYOND_NOISE * final.noise, _BEYOND_SIZE * model.size)


def _compute_pose_limit(model: Model, final: ScanFit) -> float:
    """The distance of a corner of the model's box above which two poses are different, mm.

    The two sides of a sheet are different poses, unless the noise hides that.
    """
    size = _DIFFERENT_SHARE * model.size
    half_thickness = min(size, model.volume / model.area)
    return max(half_thickness, min(size, 2 * _BEYOND_NOISE * final.noise), 1e-3 * model.size)


def measure_surface_distance(model: Model, a: ScanFit, b: ScanFit) -> float:
    """The largest distance of the model's surface at the pose `b` from that at the pose `a`, mm.

    It is measured at samples, and at corners of triangles.
    """
    corners = pick_rows(model.tree.corners.reshape(-1, 3), _SPOTS)
    spots = np.vstack([pick_rows(model.samples, _SPOTS), corners])
    places = a.apply((spots - b.origin) @ b.rotation)
    middle = (model.low + model.high) / 2
    farthest = float(np.linalg.norm(places - middle, axis=1).max())
    pairs = find_candidates(model, places, 2 * model.size + farthest, 0.0)
    return float(find_touched(model, pairs, places).distance.max())


def _scan_corners(model: Model, fit: ScanFit) -> FloatArray:
    """The corners (8, 3) of the model's box in the scan, mm."""
    return np.asarray((list_corners(model) - fit.origin) @ fit.rotation)


def _measure_corner_distance(model: Model, a: ScanFit, b: ScanFit) -> float:
    """The largest distance between corners of the model's box at the two poses, mm."""
    return float(np.linalg.norm(_scan_corners(model, a) - _scan_corners(model, b), axis=1).max())


def _is_different(model: Model, fit: ScanFit, others: list[ScanFit], limit: float) -> bool:
    return all(_measure_corner_distance(model, fit, other) > limit for other in others)


# Starts.


def is_decided(model: Model, start: Pose, chosen: Pose, other: Pose) -> bool:
    """Whether a start is clearly nearer to the chosen pose than to the other one.

    The corners of the model's box are compared, along the line from the one pose to the other.
    """
    begin, near, far = (_place_corners(model, pose).ravel() for pose in (start, chosen, other))
    line = far - near
    return abs(float(line @ (begin - near))) < _DECIDED * float(line @ line)


def is_near(model: Model, start: Pose, chosen: Pose) -> bool:
    """Whether a start says that the part is at the chosen pose."""
    offsets = _place_corners(model, start) - _place_corners(model, chosen)
    return float(np.linalg.norm(offsets, axis=1).max()) < _NEAR * model.size


def _place_corners(model: Model, pose: Pose) -> FloatArray:
    """The corners (8, 3) of the model's box at the pose, mm."""
    return np.asarray(list_corners(model) @ np.asarray(pose.rotation).T + np.asarray(pose.origin))


# Poses that the search may have missed.


def find_other_sides(model: Model, points: FloatArray, fits: list[ScanFit]) -> Poses:
    """Poses at which the other side of a thin part lies on `points` (N, 3); none for others.

    The best different fits are shifted by the thickness of the part, in both directions, along each
    of up to three directions of its faces, and along several of them together. The shifts that put
    the points nearest to the model are kept.
    """
    if not is_thin(model):
        return Poses(np.zeros((0, 3, 3)), np.zeros((0, 3)))
    thickness = 2 * model.volume / model.area
    groups = []
    for fit in _select_different(model, points, fits):
        places = fit.apply(points)
        axes = _find_face_axes(model.sample_normals[model.cloud.find_nearest(places)[0]])
        signs = np.array([*product((-1, 0, 1), repeat=len(axes))])
        wanted = signs[signs.any(axis=1)].T.astype(np.float64)
        shifts = thickness * np.linalg.lstsq(axes, wanted, rcond=None)[0].T
        distances = [model.cloud.find_nearest(places + shift)[1] for shift in shifts]
        costs = np.minimum(np.stack(distances), thickness).mean(axis=1)
        best = np.argsort(costs, kind="stable")[:_SHIFTS]
        rotations = np.broadcast_to(fit.rotation, (len(best), 3, 3))
        groups.append(Poses(rotations, fit.origin + shifts[best]))
    return join_poses(groups)


def _select_different(model: Model, points: FloatArray, fits: list[ScanFit]) -> list[ScanFit]:
    kept: list[ScanFit] = []
    costs = compute_costs(model, View(points), fits, 0.01 * model.size)
    for k in sorted(range(len(fits)), key=costs.__getitem__):
        if _is_different(model, fits[k], kept, 0.5 * _DIFFERENT_SHARE * model.size):
            kept.append(fits[k])
        if len(kept) == _BESIDE:
            break
    return kept


def _find_face_axes(normals: FloatArray) -> FloatArray:
    """The directions (1 to 3, 3) of most of `normals` (N, 3), not in one plane, up to the sign."""
    axes = np.zeros((0, 3))
    pending = normals
    while len(axes) < 3 and len(pending) >= max(_FEW_NORMALS * len(normals), 1):
        is_alike = np.abs(pending @ pick_rows(pending, 100).T) > _ALIKE
        best = is_alike[:, int(is_alike.sum(axis=0).argmax())]
        axis = np.linalg.eigh(pending[best].T @ pending[best])[1][:, 2]
        if np.linalg.svd(np.vstack([axes, axis]), compute_uv=False)[-1] > _FLAT:
            axes = np.vstack([axes, axis])
        pending = pending[~best]
    return axes


def make_symmetric(fit: ScanFit, symmetries: Poses) -> Poses:
    """The poses at which the model looks about the same as at `fit`.

    symmetries: poses that put the model onto itself.
    """
    rotations = symmetries.rotations
    return Poses(rotations @ fit.rotation, rotations @ fit.origin + symmetries.origins)


def is_thin(model: Model) -> bool:
    """Whether two sides of the part are so near that the search may confuse them."""
    return 2 * model.volume < _THIN * model.size * model.area


# Motions that the scan does not hold.


def find_free_motion(model: Model, view: View, final: ScanFit, gate: float) -> tuple[str, float]:
    """A motion of the part that changes nothing, in words, and how far it moves the surface, mm.

    The part is moved along the motion that the points hold least, and refined. If it stays there
    and fits as well, the motion is free. Without a free motion the result is "" and 0.

    gate: distance of the costs, mm.
    """
    motion = np.linalg.eigh(final.information)[1][:, 0]
    turn, shift = motion[:3] / final.arm, motion[3:]
    moves = np.cross(turn, list_corners(model) - final.centre) + shift
    factor = _NUDGE * model.size / float(np.linalg.norm(moves, axis=1).max())
    rotation = make_turns(factor * turn[None])[0]
    origin = rotation @ (final.origin - final.centre) + final.centre + factor * shift
    nudged = refine(model, view.points, (rotation @ final.rotation, origin), 2 * gate)
    excess = compute_cost(model, view, nudged, gate) - compute_cost(model, view, final, gate)
    moved = _measure_corner_distance(model, nudged, final)
    if moved < 0.5 * _NUDGE * model.size or excess > SAME_COST:
        return "", 0.0
    return _describe_motion(final, motion), measure_surface_distance(model, final, nudged)


def find_weak_motion(final: ScanFit) -> str:
    """The motion that the points hold weakly, in words; "" without one."""
    values, vectors = np.linalg.eigh(final.information)
    if float(values[0]) >= _WEAK * float(values[-1]):
        return ""
    return _describe_motion(final, vectors[:, 0])


def _describe_motion(final: ScanFit, motion: FloatArray) -> str:
    """A motion (6,) in words, in the frame of the scan."""
    turn, shift = motion[:3], motion[3:]
    back = final.rotation.T
    if float(np.linalg.norm(turn)) > float(np.linalg.norm(shift)):
        return f"turning it about {_format_direction(back @ turn)}"
    return f"moving it along {_format_direction(back @ shift)}"


def _format_direction(vector: FloatArray) -> str:
    """A direction: `z` within 5 deg of that axis, else three numbers, the largest positive."""
    unit = vector / np.linalg.norm(vector)
    unit = unit * np.sign(unit[int(np.abs(unit).argmax())])
    if float(unit.max()) > math.cos(math.radians(5)):
        return "xyz"[int(unit.argmax())]
    return "[" + ", ".join(f"{v + 0.0:.2f}" for v in unit.tolist()) + "]"


# Surface that the scan shows.


def measure_stray(model: Model, points: FloatArray, fit: ScanFit, within: float) -> float:
    """The number of points in the model's box that are off the model, per point on it.

    It is 0 if the part is there, and more if it only seems to be. The box is smaller by twice
    `within` at each side.

    within: distance up to which a point is on the model, mm.
    """
    places = fit.apply(points)
    touched = find_touched_within(model, places, within).point
    inside = ((places > model.low + 2 * within) & (places < model.high - 2 * within)).all(axis=1)
    stray = np.count_nonzero(np.delete(inside, touched))
    return float(stray) / max(float(len(touched)), 1.0)


def measure_seen(model: Model, view: View, final: ScanFit, within: float) -> SeenShare:
    """The shares of the model that the scan shows: of all, and of the surface that could be seen.

    That surface faces the scanner, and the part itself does not hide it. An unknown place of the
    scanner is estimated. If several sides were seen, there are scanners all around.
    """
    places = pick_rows(model.samples, _SEEN_SAMPLES)
    normals = pick_rows(model.sample_normals, _SEEN_SAMPLES)
    hit = _find_hit(model, final.apply(view.points), places, normals, within, final)
    if view.eye is not None:
        eyes = final.apply(view.eye)[None]
    elif hit.any() and float(np.linalg.norm(normals[hit].mean(axis=0))) > _ONE_SIDED:
        seen = SeenPlaces(
            pick_rows(places, _VIEW_SAMPLES),
            pick_rows(normals, _VIEW_SAMPLES),
            pick_rows(hit, _VIEW_SAMPLES),
        )
        eyes = estimate_eye(model, seen, _FACING).eye[None]
    else:
        eyes = make_far_eyes(model, spread_directions())
    visible = find_shown(model, places, normals, eyes, _FACING, 1 / len(eyes))
    return SeenShare(float(hit.mean()), float(hit[visible].mean()) if visible.any() else 0.0)


def _find_hit(
    model: Model,
    points: FloatArray,
    places: FloatArray,
    normals: FloatArray,
    within: float,
    final: ScanFit,
) -> BoolArray:
    """Whether each of `places` (N, 3) on the model has one of `points` (P, 3) near it: (N,).

    A point on a face with the opposite normal does not count, unless the noise hides that.

    points: coordinates in the model's frame, mm.
    within: distance up to which a point is near, if the points are not farther apart, mm.
    """
    cloud = Cloud(points)
    nearest, distance = cloud.find_nearest(places)
    spacing = float(np.median(cloud.find_neighbours(pick_rows(points, 1000), 2)[1][:, 1]))
    reach = max(within, 4 * spacing)
    hit = np.asarray(distance <= reach)
    used, point = np.unique(nearest[hit], return_inverse=True)
    touch = find_touched(model, find_candidates(model, points[used], reach, 0.0), points[used])
    face = np.zeros((len(used), 3))
    face[touch.point] = model.normals[touch.triangle]
    heights = np.abs(multiply_rows(points[nearest[hit]] - places[hit], normals[hit]))
    is_same_side = multiply_rows(face[point], normals[hit]) > _OPPOSITE
    hit[hit] = is_same_side | (heights <= compute_noise_limit(model, final))
    return hit
