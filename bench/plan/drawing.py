"""Pictures as drawings: number of points, distance from the pixels, travel with the pen up.

    python -m bench.plan.drawing [FOLDER]

FOLDER holds pictures (default: ``shared/data`` beside the repository). Every picture is traced on
an A4 page. Distances are measured on points 0.25 px apart, in both directions.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import shapely

from bench.support.runner import SHARED, Cells, Scenario, find_files, read_words, run
from bench.support.timing import timed
from camgen.geometry.segments import flatten, make_contour_segments
from camgen.model.job import TourTable
from camgen.model.part import Contour, Part
from camgen.order.arrange import measure_travel, order_paths
from camgen.plan.page import place_on_page
from camgen.plan.simplify import simplify
from camgen.plan.trace import trace
from camgen.read import read
from camgen.read.job_file import from_mapping
from camgen.vision.similarity import measure_scale

COLUMNS = (
    "picture | strokes | points | drawn | arcs | off (px) {:.2f} | travel as drawn (m) {:.2f} "
    "| nearest {:.2f} | best {:.2f} | s {:.2f}"
)
JOB = from_mapping({"operation": {"kind": "trace"}, "page": {"size": "A4"}})
METHODS = ("as-drawn", "nearest", "best")


def make_line(contour: Contour, chord: float) -> shapely.LineString:
    """The closed contour as lines, arcs within ``chord`` mm."""
    points, _ = flatten(make_contour_segments([contour]), chord)
    return shapely.linestrings([*points, points[0]])


def measure_distance(raw: Part, drawn: Part, step: float) -> float:
    """The largest distance between a contour and its drawing, mm."""
    worst = 0.0
    for contours in zip(raw.contours, drawn.contours, strict=True):
        pair = [make_line(contour, step / 50) for contour in contours]
        for line, other in (pair, pair[::-1]):
            points = shapely.points(shapely.get_coordinates(shapely.segmentize(line, step)))
            worst = max(worst, float(shapely.distance(points, other).max()))
    return worst


def measure(path: Path) -> Iterator[Cells]:
    """The row of a picture."""
    (raw, drawn), seconds = timed(lambda: simplified(path))
    assert raw.raster is not None
    px = measure_scale(raw.raster.work_from_view)
    before = sum(len(contour.points) for contour in raw.contours)
    after = sum(len(contour.points) for contour in drawn.contours)
    arcs = sum(int((c.bulges != 0).sum()) for c in drawn.contours)
    paths = trace(drawn, JOB)
    travel = []
    for method in METHODS:
        tour = order_paths(paths, TourTable(method), (0.0, 0.0), False)
        travel.append(measure_travel(tour.paths, (0.0, 0.0)) / 1000)
    distance = measure_distance(raw, drawn, px / 4) / px
    yield path.name, len(paths), before, after, arcs, distance, *travel, seconds


def simplified(path: Path) -> tuple[Part, Part]:
    """The drawing of a picture on its page, before and after it is simplified."""
    raw = place_on_page(read(path, JOB), JOB)
    return raw, simplify(raw, JOB)


if __name__ == "__main__":
    (folder,) = read_words(SHARED / "image")
    pictures = find_files(folder, (".png", ".jpg", ".tif"))
    sys.exit(run(Scenario(COLUMNS, [(path,) for path in pictures], measure, may_refuse=True)))
