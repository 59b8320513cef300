"""What would be drawn of a picture, for ``camgen inspect``: strokes, scale and size on the page."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from msgspec import Struct

from camgen.artwork import meant
from camgen.geometry.segments import bounds, from_contours
from camgen.page_fit import on_page
from camgen.readers import read
from camgen.settings import Job
from camgen.shapes import Note
from camgen.simplify import simplified
from camgen.text import short

__all__ = ["Facts", "inspect", "meant"]


class Facts(Struct, frozen=True):
    """What a picture is as a drawing; its ``str`` is a page to print. Lengths mm. lines, arcs: of all strokes.

    use: what is done with them, "" where they are drawn.
    """

    size: tuple[int, int]
    scale: str
    strokes: int
    lines: int
    arcs: int
    length: float
    shortest: float
    drawn: tuple[float, float]
    use: str
    notes: tuple[Note, ...]

    def __str__(self) -> str:
        width, height = (short(v, 2) for v in self.drawn)
        what = "borders of the ink" if self.use else "strokes"
        lines = [
            f"picture of {self.size[0]} x {self.size[1]} px, taken as a drawing",
            f"scale: {self.scale}, drawing {width} x {height} mm",
            f"{what}: {self.strokes}, all closed, of {self.lines} lines and {self.arcs} arcs; "
            f"{short(self.length, 1)} mm in all, the shortest {short(self.shortest, 2)} mm",
            *([self.use] if self.use else []),
            *map(str, self.notes),
        ]
        return "\n".join(lines)


def inspect(path: Path, job: Job) -> Facts:
    """What ``job`` makes of the picture ``path``, which it takes for a drawing. Errors as of a build."""
    raw = read(path, job)
    assert raw.raster is not None
    part = simplified(on_page(raw, job), job)
    segments = from_contours(part.contours)
    box = bounds(segments)
    lengths = np.bincount(segments.owner, segments.length, minlength=len(part.contours))
    arcs = sum(int((c.bulges != 0).sum()) for c in part.contours)
    extent = (box[:, 2:].max(axis=0) - box[:, :2].min(axis=0)).tolist() if len(box) else [0.0, 0.0]
    height, width = raw.raster.photo.shape[:2]
    return Facts(
        size=(width, height),
        scale=part.units,
        strokes=len(part.contours),
        lines=len(segments.length) - arcs,
        arcs=arcs,
        length=float(lengths.sum()),
        shortest=float(lengths.min(initial=np.inf)) if len(lengths) else 0.0,
        drawn=(extent[0], extent[1]),
        use=_use(job),
        notes=part.notes,
    )


def _use(job: Job) -> str:
    if job.operation.kind == "fill":
        return f"filled with a pen of {short(job.tool.diameter, 3)} mm (tool.diameter)"
    return "drilled at marks and rings; build says which" if job.operation.kind == "drill" else ""
