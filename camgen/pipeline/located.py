"""A drawing moved to where a photo shows its part (`camgen build --locate`)."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec.structs import replace

from camgen.model.errors import InputError, JobError
from camgen.model.job import CameraTable, ImageTable, Job
from camgen.model.part import Part
from camgen.model.pose import PlanePose
from camgen.pipeline.inputs import Inputs
from camgen.plan import find_part_kind
from camgen.read.files import Files

if TYPE_CHECKING:
    from camgen.check.photo.locate import Located

#: How the line of a header begins that states the place of the part.
LOCATED = "drawing located by a photo"
#: Digits of the digest of a job.
_DIGITS = 12
#: Kinds of parts that a photo does not place, as messages call them.
_KINDS = {
    "picture": "a picture",
    "solid": "a 3-D part",
    "curves": "a curve in space",
    "program": "a program",
}


def check_placing(job: Job, by_photo: bool, start: Sequence[float] | None) -> PlanePose | None:
    """About where the part lies, from x, y (mm) and turn (deg); None without a start.

    by_photo: whether a photo places the drawing.

    Raises JobError for a start that is not a pose, or without a photo, and if the job places the
    drawing too.
    """
    if not by_photo:
        if start is None:
            return None
        raise JobError(
            "--start", "has no effect without --locate", remedy="give a photo, or leave it out"
        )
    if job.drawn_fixtures:
        raise JobError(
            "job",
            "--locate moves the drawing, and the clamps on its layers stay where they are",
            "cell.fixtures",
            "give them as boxes",
        )
    for key, value in {"input.origin": job.input.origin, "page.size": job.page.size}.items():
        if value:
            raise JobError(
                "job", f"{key} and --locate both place the drawing", key, "leave one of them out"
            )
    if start is None:
        return None
    if len(start) != 3 or not all(map(math.isfinite, start)):
        raise JobError("--start", f"{[*start]} is not a pose", remedy="give X,Y,TURN in mm and deg")
    x, y, turn = start
    return PlanePose(math.radians(turn), x, y)


def locate_inputs(
    inputs: Inputs, job: Job, photo: Path, start: PlanePose | None, files: Files
) -> tuple[Inputs, Job, Located]:
    """The inputs with the drawing at its place, the job for it, and what the photo says.

    The job is without the settings of the photo. Its seams are points of the drawing, and are moved
    with it. The digest of the inputs counts the photo and the start.

    Raises InputError for an input that is not a drawing, and the errors of ``locate`` and of the
    reader of photos.
    """
    from camgen.check.photo.locate import locate  # noqa: PLC0415 (shapely, only for photos)
    from camgen.plan.seams import read_points  # noqa: PLC0415
    from camgen.read.image import read_outlines  # noqa: PLC0415

    _check_drawing(inputs.part)
    files = files.within(job.limits)
    source = files.read(photo)
    located = locate(read_outlines(source, job, files), inputs.part, job, start)
    digest = hashlib.sha256(f"{inputs.digest} {start}".encode() + source.data)
    tour = replace(job.tour, seams=located.pose.apply(read_points(job)).tolist())
    return (
        replace(inputs, part=located.part, digest=digest.hexdigest()[:_DIGITS]),
        replace(job, tour=tour, camera=CameraTable(), image=ImageTable()),
        located,
    )


def _check_drawing(part: Part) -> None:
    """Raises InputError for a part that is not read from a drawing."""
    kind = find_part_kind(part)
    if kind != "drawing":
        raise InputError(
            part.source,
            f"is {_KINDS[kind]}, and --locate places drawings",
            remedy="give a DXF or SVG drawing of the part",
        )
