"""The place of a drawing in a photo, and the deviations of the photo from the drawing there.

The outline of the photo is laid on the drawing as `camgen inspect --against` does it. The drawing
is then moved to where the photo shows it. All that follows is in the work frame of the photo.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
import shapely
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from camgen.check.photo import (
    LEAST_FIT,
    LEAST_FITTING,
    Difference,
    Inspection,
    borders_in_work,
    choose_limit,
    list_differences,
    outlines_of_part,
    rings_of,
)
from camgen.check.photo.expected import Expected, Sought, enclose, seek
from camgen.check.photo.kinds import remove_loose, sample, share_of_fit
from camgen.check.photo.registration import Fit, check_fit, fit_outlines
from camgen.check.report import clean
from camgen.model.errors import InputError, NoSafeProgram
from camgen.model.job import Job
from camgen.model.part import Note, NoteKind, Part, Raster
from camgen.model.pose import FloatArray, PlanePose
from camgen.model.text import counted, name_ranges
from camgen.read.move import place_part

#: A piece of the photo may be the part if its area is within this factor of the drawn one.
_SAME_AREA = 1.25
#: The other side is up if the mirrored outline fits so well that this times its share is larger.
_AS_WELL = 0.99
#: The photo shows a contour of which it has this share.
_SHOWN = 0.5
#: A start decides between poses alike up to this part of the way from the nearest to another.
_NEARER = 0.4
#: Poses that are turned by less against each other lie alike, rad.
_SAME_TURN = math.radians(5)
#: Poses alike that are named.
_NAMED = 6
_REMEDY = "give --start=X,Y,TURN near the right one, mm and deg"
#: Deviations as notes call them, one and several.
_NAMES = {
    "burr": ("burr", "burrs"),
    "dent": ("dent", "dents"),
    "loose": ("loose thing", "loose things"),
    "feature missing": ("missing feature", "missing features"),
    "feature extra": ("extra feature", "extra features"),
    "dimension": ("wrong dimension", "wrong dimensions"),
    "unclear": ("unclear deviation", "unclear deviations"),
}


class Located(Struct, frozen=True, eq=False):
    """The place of the part of a drawing in a photo. Lengths are mm, in the photo's work frame.

    pose: work_from_drawing.
    part: the drawing at its place, with notes on the photo and its deviations.
    inspection: the photo against the drawing at its place.
    share: share of both outlines that fits, the smaller of the two.
    deviation: largest distance between the two outlines.
    place: point of the photo's outline at that distance.
    tones: tones of the photo, as `image.tones` states them.
    """

    pose: PlanePose
    part: Part
    inspection: Inspection
    share: float
    deviation: float
    place: tuple[float, float]
    tones: str

    @property
    def report(self) -> dict[str, object]:
        """The contract's report of it: mm to 1e-4 mm, deg to 1e-4 deg."""
        return {
            "photo": clean(self.inspection.photo.source),
            "x": round(self.pose.x, 4),
            "y": round(self.pose.y, 4),
            "turn_deg": round(math.degrees(self.pose.turn), 4),
            "fit": round(self.share, 4),
            "rms_mm": round(self.inspection.fit.rms, 4),
            "max_deviation_mm": round(self.deviation, 4),
            "max_deviation_at": [round(value, 4) for value in self.place],
            "differences": [*map(_report, self.inspection.differences)],
        }


def _report(difference: Difference) -> dict[str, object]:
    return {
        "kind": difference.kind,
        "place": [round(value, 4) for value in difference.place],
        "height": round(difference.height, 4),
        "contour": clean(difference.contour),
    }


class _Trial(Struct, frozen=True, eq=False):
    """The drawing laid on a piece of the photo.

    fit: the photo laid on the drawing.
    expected: the contours that the photo has to show and those that it shows, at their place.
    differences: the differences of the photo from them.
    share: share of both outlines that fits, the smaller of the two.
    hidden: names of the other contours.
    """

    fit: Fit
    expected: Expected
    differences: tuple[Difference, ...]
    share: float
    hidden: tuple[str, ...]

    @property
    def pose(self) -> PlanePose:
        """work_from_drawing."""
        return self.fit.photo_from_drawing


def locate(photo: Part, drawing: Part, job: Job, start: PlanePose | None = None) -> Located:
    """The place of the part of ``drawing`` in ``photo``, a picture that was read.

    start: about where the part lies. It chooses the nearest of several poses that fit alike.

    Raises InputError for a drawing without a closed contour. Raises NoSafeProgram if the photo
    shows another part, the other side of the part, or the part in several poses alike.
    """
    if photo.raster is None or not photo.raster.borders:
        raise InputError(photo.source, "shows no part", remedy="give a photo of the part")
    sought = seek(drawing, job)
    borders = borders_in_work(photo.raster)
    seen = enclose(borders)
    candidates = _list_candidates(borders, seen, sought)
    turn = None if start is None else -start.turn
    fits = [fit_outlines(outlines, sought.region, turn) for outlines in candidates]
    best = max(range(len(fits)), key=lambda number: fits[number].share)
    _check_side(photo.source, candidates[best], sought, fits[best])
    check_fit(
        photo.source,
        drawing.source,
        fits[best].share,
        fits[best].near,
        LEAST_FITTING,
        NoSafeProgram,
    )
    trials = [
        _try_fit(fit, sought, photo.raster, seen) for fit in fits if fit.share >= LEAST_FITTING
    ]
    surest = max(trials, key=lambda trial: trial.share)
    check_fit(photo.source, drawing.source, surest.share, surest.fit.near, LEAST_FIT, NoSafeProgram)
    chosen = _choose(
        [trial for trial in trials if trial.share >= LEAST_FIT],
        start,
        f"{drawing.source} lies in {photo.source}",
    )
    limit = choose_limit(photo.raster)
    inspection = Inspection(
        photo, chosen.expected, seen, chosen.fit, limit, chosen.differences, photo.notes
    )
    placed = place_part(drawing, chosen.pose)
    deviation, place = _measure_deviation(seen, chosen)
    part = replace(
        placed,
        notes=(
            *placed.notes,
            *_note_photo(photo),
            *_note_hidden(photo.source, chosen),
            *_note_differences(inspection),
        ),
    )
    return Located(chosen.pose, part, inspection, chosen.share, deviation, place, job.image.tones)


def _list_candidates(
    borders: list[FloatArray], seen: shapely.Geometry, sought: Sought
) -> list[list[FloatArray]]:
    """The outlines of what may be the part, once for each piece of the photo that has its size.

    A drawing of several pieces has one candidate: the largest pieces of the photo.
    """
    drawn = shapely.get_parts(sought.certain.region)
    if len(drawn) == 1:
        pieces = shapely.get_parts(seen)
        ratios = _measure_areas(pieces) / _measure_areas(drawn)
        is_alike = (ratios < _SAME_AREA) & (ratios > 1 / _SAME_AREA)
        if is_alike.any():
            return [rings_of([piece]) for piece in pieces[is_alike]]
    return [outlines_of_part(borders, sought.certain.region)]


def _measure_areas(pieces: NDArray[np.object_]) -> FloatArray:
    return np.asarray(shapely.area(shapely.polygons(shapely.get_exterior_ring(pieces))))


def _check_side(photo: str, outlines: list[FloatArray], sought: Sought, fit: Fit) -> None:
    """Raises NoSafeProgram if the outline of a photo fits mirrored, and worse as it is."""
    if fit.share >= _AS_WELL:
        return
    mirrored = fit_outlines([outline * (-1.0, 1.0) for outline in outlines], sought.region)
    if mirrored.share >= LEAST_FIT and mirrored.share * _AS_WELL > fit.share:
        source = sought.certain.source
        what = f"shows the other side of {source}: mirrored {100 * mirrored.share:.0f} % of its "
        what += f"outline lies within {fit.near:.2f} mm of that, as it is {100 * fit.share:.0f} %"
        raise NoSafeProgram(photo, what, remedy="turn the part over, or mirror the drawing")


def _try_fit(fit: Fit, sought: Sought, raster: Raster, seen: shapely.Geometry) -> _Trial:
    """The drawing laid into the photo as ``fit`` says, and what differs there."""
    outline = shapely.boundary(seen)
    pose = fit.photo_from_drawing
    rings = [pose.apply(ring) for ring in sought.certain.rings]
    names = [*sought.certain.names]
    hidden = []
    for ring, name in zip(sought.possible.rings, sought.possible.names, strict=True):
        placed = pose.apply(ring)
        points = sample(shapely.LineString(np.concatenate([placed, placed[:1]])))
        if np.mean(shapely.distance(points, outline) <= fit.near) >= _SHOWN:
            rings.append(placed)
            names.append(name)
        else:
            hidden.append(name)
    source = sought.certain.source
    expected = Expected(source, enclose(rings), tuple(rings), tuple(names), inked=False)
    differences = list_differences(seen, expected, raster, choose_limit(raster))
    share = share_of_fit(differences, expected, seen, fit.near)
    return _Trial(fit, expected, differences, share, tuple(hidden))


def _choose(alike: Sequence[_Trial], start: PlanePose | None, lies: str) -> _Trial:
    """The trial nearest to ``start``. Raises NoSafeProgram if that does not decide.

    lies: beginning of a message, "part.dxf lies in photo.png".
    """
    poses = [trial.pose for trial in alike]
    for trial in alike:
        poses += [rival.photo_from_drawing for rival in trial.fit.rivals]
    if len(poses) == 1:
        return alike[0]
    if start is None:
        listed = "; ".join(map(str, poses[:_NAMED]))
        more = f"; and {len(poses) - _NAMED} more" if len(poses) > _NAMED else ""
        what = f"in {len(poses)} poses alike: {listed}{more}"
        raise NoSafeProgram("--locate", f"{lies} {what}", remedy=_REMEDY)
    turns = [_measure_turn(start, trial.pose) for trial in alike]
    as_little = [
        trial for trial, turn in zip(alike, turns, strict=True) if turn <= min(turns) + _SAME_TURN
    ]
    chosen = min(as_little, key=lambda trial: _measure_distance(start, trial.pose))
    for other in poses:
        if other != chosen.pose and not _is_nearer(start, chosen.pose, other):
            what = f"does not decide between poses alike: {lies} at {chosen.pose}; or at {other}"
            raise NoSafeProgram("--start", what, remedy=_REMEDY)
    return chosen


def _is_nearer(start: PlanePose, pose: PlanePose, other: PlanePose) -> bool:
    """Whether ``start`` is plainly nearer to ``pose`` than to ``other``, by turn or by place."""
    turn = _measure_turn(pose, other)
    if turn > _SAME_TURN:
        return _measure_turn(start, pose) <= _NEARER * turn
    return _measure_distance(start, pose) <= _NEARER * _measure_distance(pose, other)


def _measure_turn(a: PlanePose, b: PlanePose) -> float:
    return abs(math.remainder(a.turn - b.turn, math.tau))


def _measure_distance(a: PlanePose, b: PlanePose) -> float:
    return math.hypot(a.x - b.x, a.y - b.y)


def _measure_deviation(seen: shapely.Geometry, trial: _Trial) -> tuple[float, tuple[float, float]]:
    """The largest distance between the outlines, mm, and where it is. Loose things do not count."""
    points = shapely.get_coordinates(shapely.boundary(remove_loose(seen, trial.differences)))
    distances = shapely.distance(shapely.points(points), shapely.boundary(trial.expected.region))
    farthest = int(distances.argmax())
    x, y = points[farthest].tolist()
    deviations = [(float(distances[farthest]), (x, y))]
    deviations += [(each.height, each.place) for each in trial.differences if each.kind != "loose"]
    return max(deviations)


def _note_photo(photo: Part) -> Iterator[Note]:
    """The notes on the photo. Nothing that it leaves out is left out of the program."""
    for note in photo.notes:
        kind: NoteKind = "warning" if note.kind == "warning" else "assumed"
        yield replace(note, kind=kind, what=f"{photo.source}: {note.what}", ids=())


def _note_hidden(photo: str, trial: _Trial) -> Iterator[Note]:
    if trial.hidden:
        contours = counted(len(trial.hidden), "contour is", "contours are")
        what = f"{photo}: {contours} not in it: {', '.join(name_ranges([*trial.hidden]))}"
        yield Note("assumed", what, "worked on the part, and not compared with the photo")


def _note_differences(inspection: Inspection) -> Iterator[Note]:
    photo, drawing = inspection.photo.source, inspection.expected.source
    why = f"against {drawing}, from {inspection.least:.2f} mm on"
    for kind in dict.fromkeys(difference.kind for difference in inspection.differences):
        differences = [each for each in inspection.differences if each.kind == kind]
        largest = differences[0]
        x, y = largest.place
        what = f"{photo}: {counted(len(differences), *_NAMES[kind])}, "
        what += "the largest " if len(differences) > 1 else ""
        what += f"{largest.height:.2f} mm at {x:.2f}, {y:.2f} mm, contour {largest.contour}"
        places = tuple(each.place for each in differences)
        # A burr may be what the program is for.
        yield Note("warning", what, why, places=places, strict=kind != "burr")
