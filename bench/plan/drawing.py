"""Pictures as drawings: how many points they need, how near they keep to the pixels, and the way with the pen up.

    python -m bench.plan.drawing [FOLDER]      a table over the pictures of FOLDER (default: shared/data/image)
    python -m bench.plan.drawing docs FOLDER   the pictures of docs/drawing-robot.md, for FOLDER = docs/images

Every picture is traced on an A4 page. Distances are measured on points 0.25 px apart, in both directions.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import shapely

from bench.machine import machine
from camgen.cli import main
from camgen.geometry.segments import flatten, from_contours
from camgen.model.errors import CamgenError
from camgen.model.part import Contour, Part
from camgen.order.arrange import Search, arrange, measure_travel
from camgen.plan.page import on_page
from camgen.plan.simplify import simplify
from camgen.plan.trace import trace
from camgen.read import read
from camgen.read.job_file import from_mapping
from camgen.vision.similarity import scale_of

DEFAULT = Path(__file__).parents[3] / "shared" / "data" / "image"
JOB = from_mapping({"operation": {"kind": "trace"}, "page": {"size": "A4"}})
METHODS = ("as-drawn", "nearest", "best")
PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
ARM = ["--post", "vplus", "--set", "cell.robot=Cobra s600"]
WALKS = {
    "gear": [*ARM, "--set", "page.size=A5"],
    "board": [*ARM, "--set", "operation.kind=fill", "--set", "tool.diameter=0.8"],
}


def line(contour: Contour, chord: float) -> shapely.LineString:
    """The closed contour as lines, arcs within ``chord`` mm."""
    points, _ = flatten(from_contours([contour]), chord)
    return shapely.linestrings([*points, points[0]])


def apart(a: Part, b: Part, step: float) -> float:
    """The largest distance between a contour and its drawing, mm."""
    worst = 0.0
    for one, other in zip(a.contours, b.contours, strict=True):
        p, q = line(one, step / 50), line(other, step / 50)
        for here, there in ((p, q), (q, p)):
            points = shapely.points(shapely.get_coordinates(shapely.segmentize(here, step)))
            worst = max(worst, float(shapely.distance(points, there).max()))
    return worst


def row(path: Path) -> str:
    start = time.perf_counter()
    raw = on_page(read(path, JOB), JOB)
    drawn = simplify(raw, JOB)
    seconds = time.perf_counter() - start
    assert raw.raster is not None
    px = scale_of(raw.raster.work_from_view)
    before, after = (sum(len(c.points) for c in part.contours) for part in (raw, drawn))
    arcs = sum(int((c.bulges != 0).sum()) for c in drawn.contours)
    paths = trace(drawn, JOB)
    ways = [
        measure_travel(arrange(paths, Search(method, (0.0, 0.0), False)).paths, (0.0, 0.0)) / 1000
        for method in METHODS
    ]
    far = apart(raw, drawn, px / 4) / px
    told = " | ".join(f"{way:.2f}" for way in ways)
    return f"| {path.name} | {len(paths)} | {before} | {after} | {arcs} | {far:.2f} | {told} | {seconds:.2f} |"


def table(folder: Path) -> None:
    print(machine())
    print(
        "\n| picture | strokes | points | drawn | arcs | off (px) | travel as drawn (m) | nearest | best | s |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    for path in sorted(p for p in folder.rglob("*") if p.suffix in {".png", ".jpg", ".tif"}):
        try:
            print(row(path), flush=True)
        except CamgenError as error:
            print(f"| {path.name} | refused: {error.what} | | | | | | | | |")


def docs(folder: Path) -> None:
    """What docs/drawing-robot.md shows, by the commands that it names."""
    for name, words in WALKS.items():
        picture = folder / f"{name}.png"
        picture.write_bytes((PARTS / picture.name).read_bytes())
        with TemporaryDirectory() as made:
            preview = folder / f"drawing-{name}.svg"
            assert (
                main(["build", str(picture), *words, "-q", "-o", made, "--preview", str(preview)])
                == 0
            )


if __name__ == "__main__":
    if sys.argv[1:2] == ["docs"]:
        docs(Path(sys.argv[2]))
    else:
        table(Path(sys.argv[1]) if sys.argv[1:] else DEFAULT)
