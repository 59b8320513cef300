"""`follow` on parts by chance, judged by an offset that is not camgen's.

    python -m bench.plan.random_parts [PARTS, 2000] [FIRST, 0] [PROCESSES, 2]

GEOS grows the flattened part by the tool's radius (``buffer``); what is left outside is where the centre of the tool
has room. The program is read back from its printed text, and every motion that is not above the part counts, leads too.
Judged are: how far the tool enters the part; whether each contour beside which there is room has its path, and how much
of the border of that room is not run along; whether holes are done before the outline that holds them. Where the room
is narrower than ROOM it is not judged: so far may the flattening be off. Prints a table for docs/benchmarks.md and a
line for each part that misses, and exits with 1 if any does.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import shapely

import camgen
from bench.plan.follow import along
from bench.render.random_parts import DIAMETERS, RandomPart, random_part
from bench.support.children import map_inputs
from bench.support.runner import Cells, Scenario, read_words, run
from camgen.model.pose import Pose, frozen
from camgen.model.program import Instruction, MoveC, MoveL
from camgen.post.plugins import find_readback

COLUMNS = (
    "tool mm | parts {:,} | contours with room {:,} | dropped | deepest gouge mm {:.4f} "
    "| border not run mm {:.1f} | holes late | s {:.0f}"
)
#: Mm: of a gouge; by which a room must be wider than the tool; from the border of the room to the path.
GOUGE, ROOM, BESIDE = 0.011, 0.004, 0.02
_STEP = 0.15


class Verdict(NamedTuple):
    """Of one part. rooms: contours beside which there is room. dropped: of them, without a path. gouge: mm. missed: mm
    of the rooms' borders that are not run along. late: holes after their outline. why: what camgen says was left out.
    """

    number: int
    diameter: float
    rooms: int
    dropped: int
    gouge: float
    missed: float
    late: int
    seconds: float
    why: str


def judged(number: int) -> Verdict:
    """The verdict on the part of that number."""
    part = random_part(number)
    room = _room(part)
    borders = [_border(room, shape.polygon, part.diameter) for shape in part.shapes]
    start = time.perf_counter()
    try:
        body, why = _program(part)
    except camgen.CamgenError as error:
        body, why = (), str(error)
    seconds = time.perf_counter() - start
    ways = list(_ways(body))
    samples = np.concatenate(ways) if ways else np.zeros((0, 2))
    covered = [_near(border, ways) for border in borders]
    beside = [len(border) > 0 for border in borders]
    return Verdict(
        number,
        part.diameter,
        sum(beside),
        sum(there and not near.any() for there, near in zip(beside, covered, strict=True)),
        _gouge(part, samples),
        _STEP * sum(float((~near).sum()) for near in covered),
        _late(part, ways),
        seconds,
        why,
    )


def _material(part: RandomPart) -> shapely.Geometry:
    """The part: what an odd number of contours hold."""
    area = shapely.Polygon()
    for shape in part.shapes:
        area = shapely.symmetric_difference(area, shape.polygon)
    return area


def _room(part: RandomPart) -> shapely.Geometry:
    """Where the tool's centre has room, narrower places than ROOM left out."""
    radius = part.diameter / 2
    grown = _material(part).buffer(radius, quad_segs=200)
    around = shapely.box(*(np.array(grown.bounds) + np.array([-1, -1, 1, 1])))
    return around.difference(grown).buffer(-ROOM / 2, quad_segs=16).buffer(ROOM / 2, quad_segs=16)


def _border(room: shapely.Geometry, polygon: shapely.Geometry, diameter: float) -> np.ndarray:
    """Points (N, 2) of the border of ``room`` at which the tool touches this contour, about _STEP apart."""
    points = [np.zeros((0, 2))]
    for ring in shapely.get_parts(shapely.boundary(room)):
        count = max(8, int(ring.length / _STEP))
        points.append(
            shapely.get_coordinates(
                shapely.line_interpolate_point(ring, np.arange(count) / count, normalized=True)
            )
        )
    every = np.concatenate(points)
    lines = _outlines(polygon)
    gap = _gaps(every, lines, diameter)
    return every[gap < diameter / 2 + ROOM]


def _outlines(area: shapely.Geometry) -> shapely.STRtree:
    rings = [shapely.get_coordinates(ring) for ring in shapely.get_parts(shapely.boundary(area))]
    return shapely.STRtree(np.concatenate([_segments(ring) for ring in rings]))


def _segments(points: np.ndarray) -> np.ndarray:
    return np.asarray(shapely.linestrings(np.stack([points[:-1], points[1:]], axis=1)))


def _gaps(points: np.ndarray, tree: shapely.STRtree, far: float) -> np.ndarray:
    """Distance of each point from the lines of the tree, inf beyond ``far``."""
    result = np.full(len(points), np.inf)
    (which, _), gap = tree.query_nearest(
        shapely.points(points), max_distance=far, return_distance=True
    )
    result[which] = gap
    return result


def _program(part: RandomPart) -> tuple[tuple[Instruction, ...], str]:
    """What the printed text says, and what was left out."""
    contours = [
        camgen.Contour(frozen(s.rows[:, :2]), frozen(s.rows[:, 2]), True, "0") for s in part.shapes
    ]
    result = camgen.build(
        camgen.part(contours), post="gcode", job={"tool": {"diameter": part.diameter}}
    )
    reading = find_readback("gcode")({file.name: file.text for file in result.files}, {})
    return reading.body, "; ".join(
        f"{n.what}: {n.why}" for n in result.notes if n.kind == "skipped"
    )


def _ways(body: tuple[Instruction, ...]) -> Iterator[np.ndarray]:
    """Points (N, 2) of each stretch of motions that is not above the part."""
    here, way = np.array([0.0, 0.0, 1e3]), []
    for item in body:
        if not isinstance(getattr(item, "target", None), Pose):
            continue
        points = np.array([here, item.target.origin])
        if isinstance(item, (MoveL, MoveC)):
            points = along(here, item)
        here = np.array(item.target.origin)
        low = points[:, 2] < 1e-6
        way += [points[low][:, :2]]
        if here[2] > 1e-6 and any(map(len, way)):
            yield np.concatenate(way)
            way = []


def _near(border: np.ndarray, ways: list[np.ndarray]) -> np.ndarray:
    """(N,): which points of a border have a way beside them."""
    near = np.zeros(len(border), dtype=bool)
    for way in ways:
        if len(way) > 1 and len(border):
            near |= _gaps(border, shapely.STRtree(_segments(way)), 1.0) < BESIDE
    return near


def _gouge(part: RandomPart, samples: np.ndarray) -> float:
    """How far (mm) the tool enters the part at the worst of its places, below 0 if nowhere."""
    if not len(samples):
        return -np.inf
    material = _material(part)
    shapely.prepare(material)
    gap = _gaps(samples, _outlines(material), 100.0)
    inside = shapely.contains_xy(material, *samples.T)
    return float((part.diameter / 2 - np.where(inside, -gap, gap)).max())


def _late(part: RandomPart, ways: list[np.ndarray]) -> int:
    """Holes with a way after the first one of an outline that holds them."""
    polygons = [shape.polygon for shape in part.shapes]
    depth = [sum(other.contains(one) for other in polygons if other is not one) for one in polygons]
    trees = [_outlines(polygon) for polygon in polygons]
    # A way belongs to the contour that it touches along most of it.
    near = [
        [np.mean(_gaps(way, tree, part.diameter) < part.diameter / 2 + BESIDE) for tree in trees]
        for way in ways
    ]
    of = [int(np.argmax(row)) for row in near]
    late = 0
    for k, hole in enumerate(polygons):
        around = [
            j
            for j, one in enumerate(polygons)
            if j != k and depth[j] % 2 == 0 and one.contains(hole)
        ]
        first = min((n for n, j in enumerate(of) if j in around), default=len(of))
        late += depth[k] % 2 == 1 and any(n > first for n, j in enumerate(of) if j == k)
    return late


def measure(name: str, group: Sequence[Verdict]) -> Iterator[Cells]:
    """The row of a group of parts; none for an empty group."""
    if group:
        columns = ("rooms", "dropped", "late", "missed", "seconds")
        rooms, dropped, late, missed, seconds = (
            sum(getattr(each, column) for each in group) for column in columns
        )
        gouge = max(each.gouge for each in group)
        yield name, len(group), rooms, dropped, gouge, missed, late, seconds


def main(count: int, first: int, processes: int) -> int:
    start = time.perf_counter()
    numbers = range(first, first + count)
    verdicts = map_inputs(judged, numbers, processes)
    wrong = [v for v in verdicts if v.dropped or v.gouge > GOUGE or v.late or v.missed]
    for v in wrong:
        counts = f"{v.dropped} dropped, gouge {v.gouge:.4f} mm"
        print(f"part {v.number}: {counts}, {v.missed:.2f} mm not run, {v.late} late; {v.why}")
    groups = [(f"{d:g}", [v for v in verdicts if v.diameter == d]) for d in DIAMETERS]
    note = f"; {time.perf_counter() - start:.0f} s, {processes} at a time"
    run(Scenario(COLUMNS, [*groups, ("all", verdicts)], measure), note=note)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(*read_words(2000, 0, 2)[:3]))
