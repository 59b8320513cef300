"""Whether a picture is a drawing, or a photo of a part: the settings of the job tell."""

from __future__ import annotations

from camgen.settings import Camera, Job

_KINDS = ("trace", "fill", "drill")


def meant(job: Job) -> bool:
    """Whether a picture is a drawing: to be traced, filled, drilled or laid on a page, and no photo."""
    kind = job.operation.kind
    drawing = kind in _KINDS or (kind == "auto" and bool(job.page.size))
    return drawing and job.camera == Camera() and job.image.mask in ("auto", "otsu", "threshold")
