"""`follow` on random parts, judged by an offset that is not camgen's.

    python -m bench.plan.random_parts [PARTS, 2000] [FIRST, 0] [PROCESSES, 2]

GEOS grows the flattened part by the tool's radius (``buffer``): the tool centre has room outside of
it. The program is read back from its text, and every motion that is not above the part counts, with
its leads. Three things are judged:

- the depth to which the tool enters the part
- whether each contour with room beside it has its path, and the length of the room's border without
  a path
- whether holes are cut before the outline around them

Rooms narrower than ROOM are not judged: the flattening may be off by that. Parts that miss have a
line each. Exits with 1 if there is one.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from itertools import permutations
from typing import NamedTuple

import numpy as np
import shapely

import camgen
from bench.plan.follow import sample_instruction
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
#: Largest depth of a gouge, mm.
GOUGE = 0.011
#: Width by which a room must be wider than the tool, mm.
ROOM = 0.004
#: Largest distance of a path from the border of its room, mm.
REACH = 0.02
#: Distance between points of a border, mm.
_STEP = 0.15


class Verdict(NamedTuple):
    """The verdict on a part.

    number: number of the part.
    diameter: diameter of the tool, mm.
    rooms: number of contours with room beside them.
    dropped: number of those without a path.
    gouge: depth to which the tool enters the part, mm.
    missed: length of the rooms' borders without a path, mm.
    late: number of holes that are cut after their outline.
    seconds: time of the build.
    why: reasons for which contours were left out.
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


def measure_part(number: int) -> Verdict:
    """Builds the part of a number and judges its program."""
    part = random_part(number)
    room = _find_room(part)
    borders = [_find_border(room, shape.polygon, part.diameter) for shape in part.shapes]
    start = time.perf_counter()
    try:
        body, why = _build(part)
    except camgen.CamgenError as error:
        body, why = (), str(error)
    seconds = time.perf_counter() - start
    paths = list(_list_paths(body))
    samples = np.concatenate(paths) if paths else np.zeros((0, 2))
    covered = [_find_covered(border, paths) for border in borders if len(border)]
    return Verdict(
        number,
        part.diameter,
        len(covered),
        sum(not mask.any() for mask in covered),
        _measure_gouge(part, samples),
        _STEP * sum(float((~mask).sum()) for mask in covered),
        _count_late(part, paths),
        seconds,
        why,
    )


def _material(part: RandomPart) -> shapely.Geometry:
    """The area that lies within an odd number of contours."""
    area = shapely.Polygon()
    for shape in part.shapes:
        area = shapely.symmetric_difference(area, shape.polygon)
    return area


def _find_room(part: RandomPart) -> shapely.Geometry:
    """The area in which the tool centre has room, without places narrower than ROOM."""
    radius = part.diameter / 2
    grown = _material(part).buffer(radius, quad_segs=200)
    around = shapely.box(*(np.array(grown.bounds) + np.array([-1, -1, 1, 1])))
    return around.difference(grown).buffer(-ROOM / 2, quad_segs=16).buffer(ROOM / 2, quad_segs=16)


def _find_border(room: shapely.Geometry, polygon: shapely.Geometry, diameter: float) -> np.ndarray:
    """Points (N, 2) of the border of a room at which the tool touches a contour, _STEP apart."""
    points = [np.zeros((0, 2))]
    for ring in shapely.get_parts(shapely.boundary(room)):
        count = max(8, int(ring.length / _STEP))
        corners = shapely.get_coordinates(ring)
        along = np.append(0.0, np.cumsum(np.hypot(*np.diff(corners, axis=0).T)))
        places = np.arange(count) / count * along[-1]
        points.append(np.column_stack([np.interp(places, along, axis) for axis in corners.T]))
    border = np.concatenate(points)
    return border[_measure_gaps(border, _index_outline(polygon), diameter) < diameter / 2 + ROOM]


def _index_outline(area: shapely.Geometry) -> shapely.STRtree:
    rings = [shapely.get_coordinates(ring) for ring in shapely.get_parts(shapely.boundary(area))]
    return shapely.STRtree(np.concatenate([_segments(ring) for ring in rings]))


def _segments(points: np.ndarray) -> np.ndarray:
    return np.asarray(shapely.linestrings(np.stack([points[:-1], points[1:]], axis=1)))


def _measure_gaps(points: np.ndarray, tree: shapely.STRtree, far: float) -> np.ndarray:
    """Distance of each point from the lines of the tree, inf beyond `far` mm."""
    result = np.full(len(points), np.inf)
    (which, _), gap = tree.query_nearest(
        shapely.points(points), max_distance=far, return_distance=True
    )
    result[which] = gap
    return result


def _build(part: RandomPart) -> tuple[tuple[Instruction, ...], str]:
    """The instructions of the program's text, and the reasons for which contours were left out."""
    contours = []
    for shape in part.shapes:
        points, bulges = frozen(shape.rows[:, :2]), frozen(shape.rows[:, 2])
        contours.append(camgen.Contour(points, bulges, True, "0"))
    job = {"tool": {"diameter": part.diameter}}
    result = camgen.build(camgen.part(contours), post="gcode", job=job)
    reading = find_readback("gcode")({file.name: file.text for file in result.files}, {})
    skipped = [note for note in result.notes if note.kind == "skipped"]
    return reading.body, "; ".join(f"{note.what}: {note.why}" for note in skipped)


def _list_paths(body: tuple[Instruction, ...]) -> Iterator[np.ndarray]:
    """Points (N, 2) of each run of motions that is not above the part."""
    start, path = np.array([0.0, 0.0, 1e3]), []
    for item in body:
        if not isinstance(getattr(item, "target", None), Pose):
            continue
        points = np.array([start, item.target.origin])
        if isinstance(item, (MoveL, MoveC)):
            points = sample_instruction(start, item)
        start = np.array(item.target.origin)
        path.append(points[points[:, 2] < 1e-6][:, :2])
        if start[2] > 1e-6 and any(map(len, path)):
            yield np.concatenate(path)
            path = []


def _find_covered(border: np.ndarray, paths: list[np.ndarray]) -> np.ndarray:
    """Mask (N,) of the points of a border that have a path beside them."""
    covered = np.zeros(len(border), dtype=bool)
    for path in paths:
        if len(path) > 1:
            covered |= _measure_gaps(border, shapely.STRtree(_segments(path)), 1.0) < REACH
    return covered


def _measure_gouge(part: RandomPart, samples: np.ndarray) -> float:
    """The largest depth to which the tool enters the part, mm; negative if it does not."""
    if not len(samples):
        return -np.inf
    material = _material(part)
    shapely.prepare(material)
    gap = _measure_gaps(samples, _index_outline(material), 100.0)
    inside = shapely.contains_xy(material, *samples.T)
    return float((part.diameter / 2 - np.where(inside, -gap, gap)).max())


def _count_late(part: RandomPart, paths: list[np.ndarray]) -> int:
    """The number of holes with a path after the first path of an outline around them."""
    polygons = [shape.polygon for shape in part.shapes]
    around: list[set[int]] = [set() for _ in polygons]
    for (k, hole), (j, other) in permutations(enumerate(polygons), 2):
        if other.contains(hole):
            around[k].add(j)
    trees = [_index_outline(polygon) for polygon in polygons]
    reach = part.diameter / 2 + REACH
    # A path belongs to the contour that it touches along most of its length.
    owners = []
    for path in paths:
        shares = [np.mean(_measure_gaps(path, tree, part.diameter) < reach) for tree in trees]
        owners.append(int(np.argmax(shares)))
    late = 0
    for k, outer in enumerate(around):
        outlines = {j for j in outer if len(around[j]) % 2 == 0}
        first = min((n for n, j in enumerate(owners) if j in outlines), default=len(owners))
        late += len(outer) % 2 == 1 and k in owners[first + 1 :]
    return late


def measure(name: str, group: Sequence[Verdict]) -> Iterator[Cells]:
    """The row of a group of parts; none for an empty group."""
    if group:
        columns = dict(zip(Verdict._fields, zip(*group, strict=True), strict=True))
        rooms, dropped, late = (sum(columns[key]) for key in ("rooms", "dropped", "late"))
        missed, seconds = sum(columns["missed"]), sum(columns["seconds"])
        yield name, len(group), rooms, dropped, max(columns["gouge"]), missed, late, seconds


def main(count: int, first: int, processes: int) -> int:
    """Prints the parts that miss, and the table."""
    start = time.perf_counter()
    numbers = range(first, first + count)
    verdicts = map_inputs(measure_part, numbers, processes)
    wrong = [v for v in verdicts if v.dropped or v.gouge > GOUGE or v.late or v.missed]
    for v in wrong:
        counts = f"{v.dropped} dropped, gouge {v.gouge:.4f} mm"
        print(f"part {v.number}: {counts}, {v.missed:.2f} mm not run, {v.late} late; {v.why}")
    groups = []
    for diameter in DIAMETERS:
        groups.append((f"{diameter:g}", [v for v in verdicts if v.diameter == diameter]))
    note = f"; {time.perf_counter() - start:.0f} s, {processes} at a time"
    run(Scenario(COLUMNS, [*groups, ("all", verdicts)], measure), note=note)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(*read_words(2000, 0, 2)[:3]))
