"""The golden drawings: strokes on the paper, read back from every post, compared with formulas."""

import importlib.util
import math
import tomllib
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
import shapely

from camgen.model.pose import FloatArray, Pose
from camgen.model.program import MoveC, MoveJ, MoveL
from camgen.post.plugins import find_readback

FIXTURES = Path(__file__).parents[2] / "fixtures"
FILES = {
    "rapid": "part.mod",
    "pacscript": "part.pcs",
    "vplus": "part.v2",
    "gcode": "part.ngc",
    "grbl": "part.nc",
}
#: Height below which the pen draws, mm. The finest text has three digits.
TOUCH = 2e-3


def read_strokes(case: str, post: str) -> list[FloatArray]:
    """Strokes of the expected program of a case, each as points (N, 2) at most 0.2 mm apart."""
    file = FILES[post]
    text = (FIXTURES / "cases" / case / "expected" / file).read_text()
    strokes: list[list[FloatArray]] = []
    at: FloatArray | None = None
    down = False
    for motion in find_readback(post)({file: text}, {}).body:
        if not isinstance(motion, (MoveJ, MoveL, MoveC)):
            continue
        if not isinstance(motion.target, Pose):
            at, down = None, False
            continue
        target = np.array(motion.target.origin)
        drawing = at is not None and at[2] < TOUCH and target[2] < TOUCH
        if drawing and at is not None:
            if not down:
                strokes.append([at[None, :2]])
            via = np.array(motion.via.origin[:2]) if isinstance(motion, MoveC) else None
            strokes[-1].append(sample_motion(at[:2], target[:2], via))
        at, down = target, drawing
    return [np.concatenate(stroke) for stroke in strokes]


def sample_motion(start: FloatArray, end: FloatArray, via: FloatArray | None) -> FloatArray:
    """Points of a line, or of an arc if it has a via point, without its start."""
    if via is None:
        count = max(1, math.ceil(float(np.hypot(*(end - start))) / 0.2))
        return np.asarray(start + (end - start) * np.linspace(0, 1, count + 1)[1:, None])
    (ax, ay), (bx, b_y) = 2 * (via - start), 2 * (end - start)
    u, w = float(via @ via - start @ start), float(end @ end - start @ start)
    centre = np.array([u * b_y - w * ay, ax * w - bx * u]) / (ax * b_y - ay * bx)
    radius = float(np.hypot(*(start - centre)))
    turns = np.unwrap([math.atan2(y - centre[1], x - centre[0]) for x, y in (start, via, end)])
    count = math.ceil(abs(turns[2] - turns[0]) * radius / 0.2) + 1
    angle = np.linspace(turns[0], turns[2], count + 1)[1:]
    return np.asarray(centre + radius * np.column_stack([np.cos(angle), np.sin(angle)]))


def measure_length(stroke: FloatArray) -> float:
    return float(np.hypot(*np.diff(stroke, axis=0).T).sum())


def measure_farthest(points: FloatArray, lines: list[FloatArray]) -> float:
    """Largest distance of a point from the lines, mm."""
    sides = np.concatenate([np.stack([line[:-1], line[1:]], axis=1) for line in lines])
    _, distances = shapely.STRtree(shapely.linestrings(sides)).query_nearest(
        shapely.points(points), return_distance=True, all_matches=False
    )
    assert len(distances) == len(points)
    return float(distances.max())


def list_gear_outlines(scale: float) -> Iterable[FloatArray]:
    """Outlines of the bore, the six holes and the teeth of gear.png by their formulas, mm.

    They are centred on the page of the case. scale: mm of a pixel.
    """
    middle, size = np.array([60.0, 50.0]), 600 * scale
    turn = np.linspace(0, 2 * np.pi, 720)
    round_ = np.column_stack([np.cos(turn), np.sin(turn)])
    yield middle + 0.09 * size * round_
    for k in range(6):
        a = np.pi / 3 * k + 0.3
        # The rows of the picture run down.
        yield middle + 0.22 * size * np.array([np.cos(a), -np.sin(a)]) + 0.055 * size * round_
    root, tip, pitch = 0.36 * size, 0.44 * size, 2 * np.pi / 18
    rows = []
    for k in range(18):
        # The middle of a tooth is at half of a pitch.
        # Its half width is 0.27 pitches at the root and 0.16 at the tip.
        t = np.linspace(0, 1, 60)
        radius = np.concatenate(
            [root + (tip - root) * t, np.full(60, tip), tip - (tip - root) * t, np.full(60, root)]
        )
        width = np.concatenate([0.11 * t - 0.27, 0.32 * t - 0.16, 0.16 + 0.11 * t, 0.27 + 0.46 * t])
        angle = -(k + 0.5 + width) * pitch
        rows.append(middle + radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))
    yield np.concatenate(rows)


@pytest.mark.parametrize("post", FILES)
def test_the_gear_on_paper_is_the_gear_of_the_formula(post: str) -> None:
    page = tomllib.loads((FIXTURES / "cases" / "gear-trace" / "job.toml").read_text())["page"]
    # The outline is as high as the page allows. In the picture it is 0.88 of 600 px high.
    scale = (page["size"][1] - 2 * page["margin"]) / (2 * 0.44 * 600)
    expected = sorted(list_gear_outlines(scale), key=measure_length)
    strokes = sorted(read_strokes("gear-trace", post), key=measure_length)
    assert len(strokes) == len(expected) == 8
    for stroke in strokes:
        assert np.hypot(*(stroke[-1] - stroke[0])) < TOUCH
    # The border of the pixels is within 0.71 px of the shape, the drawing within one of the border.
    assert measure_farthest(np.concatenate(strokes), expected) < 1.75 * scale
    assert measure_farthest(np.concatenate(expected), strokes) < 1.75 * scale
    # The lengths of circles are more exact than a pixel.
    for k, (stroke, circle) in enumerate(zip(strokes[:7], expected[:7], strict=True)):
        assert measure_length(stroke) == pytest.approx(
            measure_length(circle), abs=2 * math.pi * 0.25 * scale
        ), k


def compute_ellipse_length(a: float, b: float) -> float:
    """Length of an ellipse by Ramanujan's second formula, here exact to 1e-6."""
    h = ((a - b) / (a + b)) ** 2
    return math.pi * (a + b) * (1 + 3 * h / (10 + math.sqrt(4 - 3 * h)))


def compute_bezier_length(*control: tuple[float, float]) -> float:
    """Length of a Bezier curve from its control points, by many short chords."""
    t = np.linspace(0, 1, 20_001)[:, None]
    levels = [np.array(point) + 0 * t for point in control]
    while len(levels) > 1:
        levels = [a * (1 - t) + b * t for a, b in pairwise(levels)]
    return measure_length(levels[0])


def compute_arc_length(chord: float, radius: float) -> float:
    return 2 * radius * math.asin(chord / 2 / radius)


@pytest.mark.parametrize("post", FILES)
def test_the_logo_on_paper_has_its_lengths_and_its_place(post: str) -> None:
    # Numbers of the file, in its units of half a mm. S and T mirror the control point before them.
    blade = compute_arc_length(math.hypot(22, 4), 16) + compute_arc_length(math.hypot(14, 12), 14)
    wave = compute_bezier_length((20, 80), (40, 60), (50, 95), (70, 78)) + compute_bezier_length(
        (70, 78), (90, 61), (100, 70), (140, 82)
    )
    # q 12 10 24 0 from (50, 4). t mirrors its control point (62, 14) at (74, 4) to (86, -6).
    tail = compute_bezier_length((50, 4), (62, 14), (74, 4)) + compute_bezier_length(
        (74, 4), (86, -6), (86, 0)
    )
    units = [
        2 * (152 + 92) - 8 * 16 + 2 * math.pi * 16,
        wave,
        2 * math.pi * 7,
        *[blade] * 3,
        compute_ellipse_length(24, 12),
        24.0,
        tail,
    ]
    strokes = read_strokes("logo-trace", post)
    lengths = sorted(map(measure_length, strokes))
    # Chords with a tolerance of 0.02 mm are shorter by less than a tenth of a percent.
    assert lengths == pytest.approx(sorted(unit_length / 2 for unit_length in units), rel=2e-3)
    points = np.concatenate(strokes)
    # The frame is 2 mm from all sides of the page, which is 80 x 50 mm.
    assert points.min(axis=0) == pytest.approx([2, 2], abs=0.02)
    assert points.max(axis=0) == pytest.approx([78, 48], abs=0.02)
    # Two of the three blades are the first one, rotated by 120 degrees about (24, 29).
    # So the mean of their starts is that point.
    blades = [s for s in strokes if abs(measure_length(s) - blade / 2) < 0.1]
    starts = np.array([s[np.argmin(np.abs(np.hypot(*(s - [24, 29]).T) - 6))] for s in blades])
    assert starts.mean(axis=0) == pytest.approx([24, 29], abs=0.02)


def test_the_pictures_are_those_that_their_program_makes(tmp_path: Path) -> None:
    spec = importlib.util.spec_from_file_location("make_pictures", FIXTURES / "make_pictures.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    (tmp_path / "parts").mkdir()
    module.main(tmp_path)
    for picture in sorted((tmp_path / "parts").iterdir()):
        assert picture.read_bytes() == (FIXTURES / "parts" / picture.name).read_bytes(), (
            picture.name
        )
        # Another decoder reads the pixels of the program.
        pixels = cv2.imread(str(picture), cv2.IMREAD_GRAYSCALE)
        assert np.array_equal(pixels == 0, getattr(module, picture.stem)())
