"""Compares a photo of a finished part with the job.

The job expects the material inside the contours of a part that is cut or deburred, or the ink of a
pen along the planned paths. The expected polygons and those of the photo are in mm. A rotation and
a shift fit the photo to the expected polygons. Differences above a limit are listed, each with its
sign: surplus or missing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import shapely
from msgspec import Struct

from camgen.check.photo.differences import FOOT, find_differences
from camgen.check.photo.differences import Difference as Difference
from camgen.check.photo.expected import Expected, enclose, expect
from camgen.check.photo.kinds import WHY_NOT as WHY_NOT
from camgen.check.photo.kinds import WHY_NOT_OFF, classify, share_of_fit
from camgen.check.photo.registration import Fit, check_fit, fit_outlines
from camgen.check.photo.rework import NotReworked as NotReworked
from camgen.check.photo.rework import Rework as Rework
from camgen.check.photo.rework import is_in_the_way, plan_burr
from camgen.model.errors import InputError, JobError
from camgen.model.job import Job
from camgen.model.part import Note, Part, Raster
from camgen.model.pose import FloatArray
from camgen.model.text import short

#: Smallest difference that is listed by default, px of the photo, and its lower limit, mm.
_LEAST_PX, _LEAST_MM = 1.0, 0.1
#: A photo shows another part if a smaller fraction of its outline fits. Places that are missing in
#: the photo do not count here, since much of the ink may be missing.
LEAST_FITTING = 0.5
#: The same for both outlines. A plate that lies upside down fits to 59 %, one without its largest
#: hole to 86 %.
LEAST_FIT = 0.8


class Inspection(Struct, frozen=True, eq=False):
    """The comparison of a photo with a drawing, in the frame of the drawing, mm.

    photo: the photo.
    expected: the expected polygons.
    seen: polygons of the photo, fitted to the drawing.
    fit: the rotation and shift that fit it.
    least: smallest difference that is listed, mm.
    differences: the differences, the largest first.
    notes: notes to the user.
    """

    photo: Part
    expected: Expected
    seen: shapely.Geometry
    fit: Fit
    least: float
    differences: tuple[Difference, ...]
    notes: tuple[Note, ...]

    @property
    def burrs(self) -> tuple[Difference, ...]:
        """Differences that are reworked, the highest first."""
        return tuple(each for each in self.differences if each.kind == "burr")

    def area(self, surplus: bool) -> float:
        """Compute the total surplus or missing area, mm2."""
        return math.fsum(each.area for each in self.differences if each.surplus == surplus)


def inspect_photo(photo: Part, drawing: Part, job: Job, least: float | None = None) -> Inspection:
    """Compare `photo`, a picture that was read, with the result of `job` on `drawing`.

    least: smallest difference that is listed, mm; None: a pixel of the photo, but at least 0.1 mm.

    Raises InputError if the photo shows something else. Raises JobError if the job expects nothing
    that can be seen from above.
    """
    raster = photo.raster
    if raster is None:
        raise InputError(photo.source, "is not a picture", remedy="give a photo of the part")
    limit = choose_limit(raster, least)
    expected = expect(drawing, job)
    borders = borders_in_work(raster)
    outlines = borders if expected.inked else outlines_of_part(borders, expected.region)
    fit = fit_outlines(outlines, expected.region)
    check_fit(photo.source, expected.source, fit.share, fit.near, LEAST_FITTING)
    seen = enclose([fit.apply(border) for border in borders])
    differences = list_differences(seen, expected, raster, limit)
    if not expected.inked:
        share = share_of_fit(differences, expected, seen, fit.near)
        check_fit(photo.source, expected.source, share, fit.near, LEAST_FIT)
    notes = (*photo.notes, *drawing.notes, *_note(fit, measure_pixel(raster)))
    return Inspection(photo, expected, seen, fit, limit, differences, notes)


def choose_limit(raster: Raster, least: float | None = None) -> float:
    """Return the height from which on a difference counts, mm. Raises JobError if it is not > 0."""
    limit = max(_LEAST_PX * measure_pixel(raster), _LEAST_MM) if least is None else least
    if not (math.isfinite(limit) and limit > 0):
        raise JobError("--least", f"cannot be {limit:g} mm", remedy="give a length above 0 mm")
    return limit


def list_differences(
    seen: shapely.Geometry, expected: Expected, raster: Raster, limit: float
) -> tuple[Difference, ...]:
    """List the differences from `limit` mm on, with their kinds, the largest first."""
    differences = find_differences(seen, expected, limit, raster.blur * measure_pixel(raster))
    return classify(differences, expected, seen, limit * FOOT)


def measure_pixel(raster: Raster) -> float:
    """Measure the width of a pixel of the view, mm."""
    return float(np.hypot(*raster.work_from_view[:, 0]))


def list_rework(
    inspection: Inspection, job: Job, removal: float
) -> tuple[tuple[Rework, ...], tuple[NotReworked, ...]]:
    """Plan the rework of each burr, and give the reason for all other differences.

    removal: height that one pass removes at the job's feed, mm.

    Raises JobError if `removal` is not a length, or makes too many passes.
    """
    if not (math.isfinite(removal) and removal > 0):
        raise JobError(
            "--removal",
            f"cannot be {removal:g} mm",
            remedy="give the height that one pass removes, above 0 mm",
        )
    differences = inspection.differences
    is_off = any(each.kind == "dimension" for each in differences)
    loose = shapely.union_all([each.shape for each in differences if each.kind == "loose"])
    reworks: list[Rework] = []
    left: list[NotReworked] = []
    for number, each in enumerate(differences, 1):
        if each.kind != "burr" or is_off:
            reason = WHY_NOT[each.kind] if each.kind != "burr" else WHY_NOT_OFF
            left.append(NotReworked(number, reason))
            continue
        work = plan_burr(number, each, inspection.expected, job, removal)
        if isinstance(work, NotReworked):
            left.append(work)
        elif is_in_the_way(work.stretches[0], loose, job):
            left.append(NotReworked(number, "a loose thing lies beside it, in the way of the tool"))
        else:
            reworks.append(work)
    return tuple(reworks), tuple(left)


def outlines_of_part(borders: list[FloatArray], region: shapely.Geometry) -> list[FloatArray]:
    """Return the outlines of the largest pieces, as many as are drawn; the others are chips."""
    pieces = shapely.get_parts(enclose(borders))
    order = np.argsort([-shapely.Polygon(piece.exterior).area for piece in pieces], kind="stable")
    return rings_of(pieces[order[: shapely.get_num_geometries(region)]])


def rings_of(pieces: Sequence[shapely.Geometry]) -> list[FloatArray]:
    """Return the outlines of polygons, (N, 2) each, without the first point at the end."""
    rings = shapely.get_parts(shapely.boundary(shapely.multipolygons(pieces)))
    return [shapely.get_coordinates(ring)[:-1] for ring in rings]


def borders_in_work(raster: Raster) -> list[FloatArray]:
    """Return the borders of the part in the work frame of its photo, (N, 2) mm each."""
    matrix = raster.work_from_view
    return [np.asarray(border @ matrix[:, :2].T + matrix[:, 2]) for border in raster.borders]


def _note(fit: Fit, pixel: float) -> tuple[Note, ...]:
    x, y = fit.shift
    what = (
        f"the photo fits the drawing after a rotation by {short(math.degrees(fit.turn), 3)} deg "
        f"and a shift by {short(x, 3)}, {short(y, 3)} mm; "
        f"{100 * fit.share:.1f} % of its outline fits, {short(fit.rms, 4)} mm rms"
    )
    notes = [Note("assumed", what, f"a pixel is {short(pixel, 4)} mm")]
    if fit.rivals:
        turns = ", ".join(short(math.degrees(turn), 1) for turn in fit.rival_turns)
        notes.append(
            Note(
                "warning",
                f"the photo fits as well rotated by a further {turns} deg",
                "the part looks the same, so the differences may be on another side of it",
            )
        )
    return tuple(notes)
