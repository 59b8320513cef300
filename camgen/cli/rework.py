"""The two files of a rework: a drawing with a stretch for each burr, and the job that works them.

The job holds all that its program depends on: tool, speeds, force, cell and post. Nothing of the
job that it was made from is read again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import accumulate, pairwise
from pathlib import Path

import numpy as np

from camgen.check.photo import Inspection, Rework
from camgen.check.photo.rework import LEAD, WITHOUT_FORCE, stays_down
from camgen.cli.job_text import write_table, write_values
from camgen.model.job import Job
from camgen.model.pose import FloatArray
from camgen.model.text import counted, harmless, short
from camgen.model.toml import format_toml
from camgen.model.version import __version__

#: Tables that are taken from the job as they are.
_TABLES = ("tool", "process", "tolerance", "cell", "limits")
#: Keys of them that are left out, since the photo may show loose things and burrs between contours.
_LEFT_OUT = (("process", "stay_down"), ("process", "max_feed"))
#: Keys of [operation] that hold for the rework too.
_KEPT = ("depth", "direction", "corner_radius", "lead_in", "lead_out")
#: Layer of the whole contours, which no operation works on.
PART_LAYER = "part"


def name_layers(work: Rework) -> list[str]:
    """The layer of each pass over a burr. Passes along the same stretch have the same layer."""
    changes = [before is not after for before, after in pairwise(work.stretches)]
    return [f"burr{work.number}-{number}" for number in accumulate(changes, initial=1)]


def write_drawing(works: Sequence[Rework], rings: Sequence[FloatArray]) -> bytes:
    """The stretches as a DXF drawing in mm, each on its layer, and the contours ``rings``."""
    lines = ["0", "SECTION", "2", "HEADER", "9", "$ACADVER", "1", "AC1015"]
    lines += ["9", "$INSUNITS", "70", "4", "0", "ENDSEC", "0", "SECTION", "2", "ENTITIES"]
    for ring in rings:
        lines += _polyline(PART_LAYER, ring, closed=True)
    for work in works:
        for layer, stretch in dict(zip(name_layers(work), work.stretches, strict=True)).items():
            lines += _polyline(layer, stretch, closed=False)
    lines += ["0", "ENDSEC", "0", "EOF", ""]
    return "\n".join(lines).encode()


def _polyline(layer: str, points: FloatArray, closed: bool) -> Iterator[str]:
    yield from ("0", "LWPOLYLINE", "100", "AcDbEntity", "8", layer, "100", "AcDbPolyline")
    yield from ("90", str(len(points)), "70", str(int(closed)))
    for x, y in np.round(points, 6).tolist():
        yield from ("10", f"{x:.6f}", "20", f"{y:.6f}")


def write_job(inspection: Inspection, works: Sequence[Rework], job: Job, target: Path) -> bytes:
    """The job of the rework, for the file ``target``."""
    names = f"{harmless(inspection.photo.source)} against {harmless(inspection.expected.source)}"
    lines = [
        f"# camgen {__version__}: rework of {counted(len(works), 'burr')}, {names}",
        f"# Build it with the drawing beside it: camgen build {harmless(target.stem)}.dxf",
        "# It is for the part as the photo shows it: after a run, also one that was broken off,",
        "# take another photo and another rework.",
    ]
    if not job.process.force:
        lines.append(f"# {WITHOUT_FORCE}.")
    lines += ["", "[input]", 'units = "mm"']
    for table in _TABLES:
        lines += write_table(table, getattr(job, table), target.parent, _LEFT_OUT)
    lines += [*write_values("operation", _operation(job)), *write_values("post", job.post)]
    for work in works:
        lines += _rows(work, stays_down(job))
    return "\n".join([*lines, ""]).encode()


def _operation(job: Job) -> dict[str, object]:
    settings: dict[str, object] = {"kind": "follow", "side": "right"}
    settings |= {key: getattr(job.operation, key) for key in _KEPT}
    if job.process.force:
        for key in ("lead_in", "lead_out"):
            settings[key] = settings[key] or LEAD
    return settings


def _rows(work: Rework, stays: bool) -> Iterator[str]:
    """An operation for each pass, at the whole depth.

    stays: whether later passes are reached at working height.
    """
    x, y = work.burr.place
    size = f"{work.burr.height:.2f} mm high, {work.burr.length:.2f} mm long"
    at = f"at {x:.2f} {y:.2f} of {harmless(work.burr.contour)}"
    yield ""
    yield f"# burr {work.number}: {size}, {at}: {counted(work.passes, 'pass', 'passes')}"
    for number, layer in enumerate(name_layers(work)):
        yield "[[operations]]"
        yield f"layers = [{format_toml(layer)}]"
        yield f"feed = {short(work.feed, 3)}"
        if stays and number:
            yield "stay_down = true"
