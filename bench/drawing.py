"""Pictures as drawings: how many points they need, how near they keep to the pixels, and the way with the pen up.

    python bench/drawing.py [FOLDER]      a table over the pictures of FOLDER (default: shared/data/image)
    python bench/drawing.py docs FOLDER   the pictures of docs/drawing-robot.md: gear.png and drawing-gear.svg in FOLDER

Every picture is traced on an A4 page. Distances are measured on points 0.25 px apart, in both directions.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import shapely
from machine import machine

from camgen.cli_job import from_mapping
from camgen.errors import CamgenError
from camgen.geometry.segments import flatten, from_contours
from camgen.page_fit import on_page
from camgen.planners.trace import trace
from camgen.readers import read
from camgen.shapes import Contour, Part
from camgen.simplify import simplified
from camgen.tour import order, travel
from camgen.vision.similarity import scale_of

DEFAULT = Path(__file__).parents[2] / "shared" / "data" / "image"
JOB = from_mapping({"operation": {"kind": "trace"}, "page": {"size": "A4"}})
METHODS = ("as-drawn", "nearest", "best")


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
    drawn = simplified(raw, JOB)
    seconds = time.perf_counter() - start
    assert raw.raster is not None
    px = scale_of(raw.raster.work_from_view)
    before, after = (sum(len(c.points) for c in part.contours) for part in (raw, drawn))
    arcs = sum(int((c.bulges != 0).sum()) for c in drawn.contours)
    paths = trace(drawn, JOB)
    ways = [travel(order(paths, method, (0.0, 0.0), False).paths, (0.0, 0.0)) / 1000 for method in METHODS]
    far = apart(raw, drawn, px / 4) / px
    told = " | ".join(f"{way:.2f}" for way in ways)
    return f"| {path.name} | {len(paths)} | {before} | {after} | {arcs} | {far:.2f} | {told} | {seconds:.2f} |"


def table(folder: Path) -> None:
    print(machine())
    print("\n| picture | strokes | points | drawn | arcs | off (px) | travel as drawn (m) | nearest | best | s |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for path in sorted(p for p in folder.rglob("*") if p.suffix in {".png", ".jpg", ".tif"}):
        try:
            print(row(path), flush=True)
        except CamgenError as error:
            print(f"| {path.name} | {error} | | | | | | | | |")


def gear(teeth: int = 18, size: int = 600) -> np.ndarray:
    """A gear in black on white, two values, with a bore and six round holes."""
    v, u = np.mgrid[0:size, 0:size] - (size - 1) / 2
    r, turn = np.hypot(u, v), np.arctan2(v, u)
    root, tip = 0.36 * size, 0.44 * size
    half = 0.27 - 0.11 * np.clip((r - root) / (tip - root), 0, 1)
    tooth = np.abs((turn * teeth / (2 * np.pi)) % 1 - 0.5) < half
    ink = ((r <= root) | (tooth & (r <= tip))) & (r >= 0.09 * size)
    for k in range(6):
        a = np.pi / 3 * k + 0.3
        ink &= np.hypot(u - 0.22 * size * np.cos(a), v - 0.22 * size * np.sin(a)) >= 0.055 * size
    return np.where(ink, 0, 255).astype(np.uint8)


def svg(part: Part, raw: Part, path: Path) -> None:
    """The page with the ink in grey, the drawing by stroke in colour, the way with the pen up in thin grey."""
    paths = order(trace(part, JOB), "best", (0.0, 0.0), False).paths
    shapes = "".join("M" + " ".join(f"{x:.2f},{297 - y:.2f}" for x, y in c.points) + "Z" for c in raw.contours)
    lines = [f'<path d="{shapes}" fill="#ddd" fill-rule="evenodd"/>']
    at = np.zeros(2)
    colours = ("#1f77b4", "#d62728", "#2ca02c", "#9467bd", "#ff7f0e", "#17becf", "#8c564b", "#e377c2")
    for k, one in enumerate(paths):
        xy = one.position[:, :2]
        lines.append(
            f'<path d="M{at[0]:.2f},{297 - at[1]:.2f}L{xy[0, 0]:.2f},{297 - xy[0, 1]:.2f}" stroke="#999" '
            'stroke-width="0.3" stroke-dasharray="2 1.5" fill="none"/>'
        )
        at = xy[-1]
        points = []
        for a, b, via in zip(one.position[:-1], one.position[1:], one.via[1:], strict=True):
            if np.isnan(via[0]):
                points.append(f"L{b[0]:.2f},{297 - b[1]:.2f}")
                continue
            chord = float(np.hypot(*(b - a)[:2]))
            height = float(np.hypot(*(via - (a + b) / 2)[:2]))
            radius = (chord**2 / 4 + height**2) / (2 * height)
            left = (b - a)[0] * (via - a)[1] - (b - a)[1] * (via - a)[0] > 0
            points.append(f"A{radius:.2f} {radius:.2f} 0 0 {int(left)} {b[0]:.2f},{297 - b[1]:.2f}")
        d = f"M{xy[0, 0]:.2f},{297 - xy[0, 1]:.2f}" + "".join(points)
        lines.append(f'<path d="{d}" stroke="{colours[k % len(colours)]}" stroke-width="0.7" fill="none"/>')
        lines += [f'<circle cx="{x:.2f}" cy="{297 - y:.2f}" r="0.9" fill="#222"/>' for x, y in xy]
    head = '<svg xmlns="http://www.w3.org/2000/svg" width="105mm" height="148.5mm" viewBox="0 0 210 297">'
    page = '<rect width="210" height="297" fill="white" stroke="#888"/>'
    path.write_text("\n".join([head, page, *lines, "</svg>"]) + "\n")


def docs(folder: Path) -> None:
    import cv2  # noqa: PLC0415 (only here)

    source = folder / "gear.png"
    cv2.imwrite(str(source), gear(), [cv2.IMWRITE_PNG_BILEVEL, 1])
    raw = on_page(read(source, JOB), JOB)
    svg(simplified(raw, JOB), raw, folder / "drawing-gear.svg")


if __name__ == "__main__":
    if sys.argv[1:2] == ["docs"]:
        docs(Path(sys.argv[2]))
    else:
        table(Path(sys.argv[1]) if sys.argv[1:] else DEFAULT)
