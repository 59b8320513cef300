"""A photo of a finished part, compared with the job (the outlook of continuous-path.md and of pist.md).

The job expects the material inside the contours of a part that is cut or deburred, or the ink of a
pen along the planned paths. The expected polygons and those of the photo are in mm. A turn and a
shift lay the photo on the expected polygons. Differences above a limit are listed, each with its
sign: too much, or missing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import shapely
from msgspec import Struct

from camgen.check.photo.differences import FOOT, differ
from camgen.check.photo.differences import Difference as Difference
from camgen.check.photo.expected import Expected, enclose, expect
from camgen.check.photo.kinds import WHY_NOT as WHY_NOT
from camgen.check.photo.kinds import WHY_NOT_OFF, classify, share_of_fit
from camgen.check.photo.registration import Fit, insist_on_fit, lay_on
from camgen.check.photo.rework import NotReworked as NotReworked
from camgen.check.photo.rework import Rework as Rework
from camgen.check.photo.rework import is_in_the_way, plan_burr
from camgen.model.errors import InputError, JobError
from camgen.model.job import Job
from camgen.model.part import Note, Part, Raster
from camgen.model.pose import FloatArray
from camgen.model.text import short

#: Differences from so many pixels of the photo on are told, and never below this, mm.
_LEAST_PX, _LEAST_MM = 1.0, 0.1
#: A photo shows another part if a smaller share of its own outline fits. Places that are missing
#: in the photo do not count here, since ink may lack much.
LEAST_FITTING = 0.5
#: It does too if less of both outlines fits. A plate that lies upside down fits to 59 %, one that
#: lacks its largest hole to 86 %.
LEAST_FIT = 0.8


class Inspection(Struct, frozen=True, eq=False):
    """What a photo says of what was made. All mm, in the frame of the drawing. seen: of the photo, laid on. fit: how.
    least: what is told. differences: the greatest first.
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
        """Deviations that are worked again, the highest first."""
        return tuple(each for each in self.differences if each.kind == "burr")

    def area(self, much: bool) -> float:
        """What is too much, or missing, in all, mm2."""
        return math.fsum(one.area for one in self.differences if one.much == much)


def inspect_photo(photo: Part, drawing: Part, job: Job, least: float | None = None) -> Inspection:
    """What of ``photo`` (a picture that was read) differs from what ``job`` makes of ``drawing``.

    least: mm, from where on a difference is told; None: a pixel of the photo, 0.1 mm at least. InputError where the
    photo shows something else, JobError where the job expects nothing that could be seen from above.
    """
    raster = photo.raster
    if raster is None:
        raise InputError(photo.source, "is no picture", remedy="give a photo of the part")
    limit = choose_limit(raster, least)
    expected = expect(drawing, job)
    borders = borders_in_work(raster)
    outlines = borders if expected.inked else outlines_of_part(borders, expected.region)
    fit = lay_on(outlines, expected.region)
    insist_on_fit(photo.source, expected.source, fit.share, fit.near, LEAST_FITTING)
    seen = enclose([fit.apply(border) for border in borders])
    differences = list_differences(seen, expected, raster, limit)
    if not expected.inked:
        share = share_of_fit(differences, expected, seen, fit.near)
        insist_on_fit(photo.source, expected.source, share, fit.near, LEAST_FIT)
    notes = (*photo.notes, *drawing.notes, *_note(fit, measure_pixel(raster)))
    return Inspection(photo, expected, seen, fit, limit, differences, notes)


def choose_limit(raster: Raster, least: float | None = None) -> float:
    """The height from which on a difference counts, mm. Raises JobError for a ``least`` below 0."""
    limit = max(_LEAST_PX * measure_pixel(raster), _LEAST_MM) if least is None else least
    if not (math.isfinite(limit) and limit > 0):
        raise JobError("--least", f"cannot be {limit:g} mm", remedy="give a length above 0 mm")
    return limit


def list_differences(
    seen: shapely.Geometry, expected: Expected, raster: Raster, limit: float
) -> tuple[Difference, ...]:
    """The differences from ``limit`` mm on, with their kinds, the greatest first."""
    differences = differ(seen, expected, limit, raster.blur * measure_pixel(raster))
    return classify(differences, expected, seen, limit * FOOT)


def measure_pixel(raster: Raster) -> float:
    """The width of a pixel of the view, mm."""
    return float(np.hypot(*raster.work_from_view[:, 0]))


def list_rework(
    found: Inspection, job: Job, removal: float
) -> tuple[tuple[Rework, ...], tuple[NotReworked, ...]]:
    """The rework of each burr, and all other differences with the reason why they are left.

    removal: height that a pass takes off at the job's feed, mm. Raises JobError if it is not a
    length, or makes too many passes.
    """
    if not (math.isfinite(removal) and removal > 0):
        raise JobError(
            "--removal",
            f"cannot be {removal:g} mm",
            remedy="give what one pass takes off, above 0 mm",
        )
    is_off = any(each.kind == "dimension" for each in found.differences)
    loose = shapely.union_all([each.shape for each in found.differences if each.kind == "loose"])
    planned: list[Rework | NotReworked] = []
    for number, each in enumerate(found.differences, 1):
        if each.kind != "burr":
            planned.append(NotReworked(number, WHY_NOT[each.kind]))
        elif is_off:
            planned.append(NotReworked(number, WHY_NOT_OFF))
        else:
            work = plan_burr(number, each, found.expected, job, removal)
            if isinstance(work, Rework) and is_in_the_way(work.stretches[0], loose, job):
                work = NotReworked(number, "a loose thing lies beside it, in the way of the tool")
            planned.append(work)
    return (
        tuple(each for each in planned if isinstance(each, Rework)),
        tuple(each for each in planned if isinstance(each, NotReworked)),
    )


def outlines_of_part(borders: list[FloatArray], region: shapely.Geometry) -> list[FloatArray]:
    """The outlines of the largest pieces of a photo, as many as are drawn: the others are chips."""
    pieces = shapely.get_parts(enclose(borders))
    order = np.argsort([-shapely.Polygon(piece.exterior).area for piece in pieces], kind="stable")
    return rings_of(pieces[order[: shapely.get_num_geometries(region)]])


def rings_of(pieces: Sequence[shapely.Geometry]) -> list[FloatArray]:
    """The outlines of polygons, (N, 2) each, the first point not again at the end."""
    rings = shapely.get_parts(shapely.boundary(shapely.multipolygons(pieces)))
    return [shapely.get_coordinates(ring)[:-1] for ring in rings]


def borders_in_work(raster: Raster) -> list[FloatArray]:
    """The borders of the part in the work frame of its photo, (N, 2) mm each."""
    matrix = raster.work_from_view
    return [np.asarray(border @ matrix[:, :2].T + matrix[:, 2]) for border in raster.borders]


def _note(fit: Fit, pixel: float) -> tuple[Note, ...]:
    x, y = fit.shift
    what = f"photo laid on the drawing: turned by {short(math.degrees(fit.turn), 3)} deg, moved by {short(x, 3)}, "
    what += f"{short(y, 3)} mm; {100 * fit.share:.1f} % of its outline fits to {short(fit.rms, 4)} mm rms"
    notes = [Note("assumed", what, f"a pixel is {short(pixel, 4)} mm")]
    if fit.rivals:
        turns = ", ".join(short(math.degrees(turn), 1) for turn in fit.rival_turns)
        why = "the part looks the same; places may be meant for another side of it"
        notes.append(Note("warning", f"it fits as well turned further by {turns} deg", why))
    return tuple(notes)
