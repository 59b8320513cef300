"""Planners: a Part to ToolPaths. One function per file."""

from __future__ import annotations

from msgspec import Struct
from msgspec.structs import replace

from camgen.model.errors import JobError
from camgen.model.job import Job
from camgen.model.part import Note, Part
from camgen.model.path import ToolPath
from camgen.plan.fill.cover import Coverage


class Plan(Struct, frozen=True):
    """The paths of a part in the order of its contours, and what the planner left out or wants known.

    coverage: of what is to be filled, None for other operations.
    """

    paths: tuple[ToolPath, ...]
    notes: tuple[Note, ...]
    coverage: Coverage | None = None


def _in_image_space(part: Part, job: Job) -> Plan:
    if part.raster is None:
        what = '"image" plans in a picture, and this is none'
        raise JobError("job", what, "operation.planner", 'set operation.planner to "geometric"')
    if job.operation.kind not in ("auto", "follow"):
        what = f"the image-space planner follows contours, it cannot {job.operation.kind}"
        raise JobError("job", what, "operation.planner", 'set operation.planner to "geometric"')
    from camgen.plan.image_space import image_space  # noqa: PLC0415 (OpenCV is loaded only by what needs it)

    raster = part.raster
    return Plan(*image_space(raster.mask, raster.work_from_view, job, borders=raster.borders))


def plan(part: Part, job: Job) -> Plan:
    """The tool paths of ``part`` as ``job`` asks for them."""
    from camgen.plan.follow import follow  # noqa: PLC0415 (shapely is loaded only by what needs it)
    from camgen.plan.recover import recover  # noqa: PLC0415
    from camgen.plan.trace import trace, with_few_lifts  # noqa: PLC0415

    if job.operation.planner == "image":
        return _in_image_space(part, job)
    if job.operation.kind == "fill":
        from camgen.plan.fill import fill  # noqa: PLC0415 (OpenCV is loaded only by what needs it)

        return Plan(*fill(part, job))
    if job.operation.kind == "drill":
        from camgen.plan.drill import drill  # noqa: PLC0415

        return Plan(*drill(part, job))
    contours, recovered = recover(part.contours, job.tolerance.arc_fit)
    part = replace(part, contours=contours)
    # What is laid on a page is a drawing.
    drawing = job.operation.kind == "auto" and bool(job.page.size)
    if drawing or job.operation.kind == "trace" or job.operation.side == "on":
        part, merged = with_few_lifts(part, job)
        return Plan(trace(part, job), recovered + merged)
    paths, notes = follow(part, job)
    return Plan(paths, recovered + notes)
