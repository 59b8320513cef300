"""Real pictures as they come: what is found, in how many pieces, how near, and at another scale the same.

    python -m bench.photo.pictures [FOLDER]      a table over the pictures of FOLDER (default: shared/data/image)

Every picture is read as a photo of parts, 1 mm to 10 px. `pieces`: lines and arcs; `at points`: outlines with a piece
for every second point of theirs or more. `off`: from
the points of the outlines to the lines and arcs, in px: 99 % of them are nearer, and the farthest one. `scales`: at
0.11574 and 0.115741 mm/px the same pieces. `warned`: what is warned of.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import shapely

from bench.machine import machine
from camgen.geometry.segments import flatten, from_contours
from camgen.model.errors import CamgenError
from camgen.model.job import Job
from camgen.model.part import Part
from camgen.read import read
from camgen.read.job_file import from_mapping
from camgen.vision.similarity import scale_of

DEFAULT = Path(__file__).parents[3] / "shared" / "data" / "image"
SCALES = (0.11574, 0.115741)


def job(scale: float) -> Job:
    """A photo of parts; specks of 20 px are none, at every scale."""
    return from_mapping({"image": {"mm_per_px": scale, "min_area": 20 * scale**2}})


def off(part: Part) -> np.ndarray:
    """Distances of the outlines' points from the nearest contour, px."""
    assert part.raster is not None
    matrix = part.raster.work_from_view
    size = scale_of(matrix)
    points, owner = flatten(from_contours(part.contours), size / 100)
    rings = shapely.multilinestrings(
        [
            shapely.linestrings(np.concatenate([points[owner == k], points[owner == k][:1]]))
            for k in np.unique(owner)
        ]
    )
    measured = np.concatenate(part.raster.borders) @ matrix[:, :2].T + matrix[:, 2]
    shapely.prepare(rings)
    return shapely.distance(shapely.points(measured), rings) / size


def row(path: Path) -> str:
    start = time.perf_counter()
    part = read(path, job(0.1))
    seconds = time.perf_counter() - start
    assert part.raster is not None
    pieces = sum(len(c.points) for c in part.contours)
    by_point = sum(
        2 * len(c.points) > len(b) for c, b in zip(part.contours, part.raster.borders, strict=False)
    )
    same = (
        len({tuple(len(c.points) for c in read(path, job(scale)).contours) for scale in SCALES})
        == 1
    )
    far = off(part)
    warned = "; ".join(note.what for note in part.notes if note.kind in ("warning", "skipped"))
    return (
        f"| {path.name} | {len(part.contours)} | {pieces} | {by_point} | {np.percentile(far, 99):.2f} | "
        f"{far.max():.1f} | {'same' if same else 'not the same'} | {warned} | {seconds:.2f} |"
    )


def table(folder: Path) -> None:
    print(machine())
    print("\n| picture | outlines | pieces | at points | 99 % off | most | scales | warned | s |")
    print("|---|---|---|---|---|---|---|---|---|")
    for path in sorted(p for p in folder.rglob("*") if p.suffix in {".png", ".jpg", ".tif"}):
        try:
            print(row(path), flush=True)
        except CamgenError as error:
            print(f"| {path.name} | refused: {error.what} | | | | | | | |", flush=True)


if __name__ == "__main__":
    table(Path(sys.argv[1]) if sys.argv[1:] else DEFAULT)
