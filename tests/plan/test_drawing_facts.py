"""The golden drawings, judged by what they are to show: marks on the paper, read back from the text of every post."""

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
#: The pen marks below this height, mm; the finest text has three digits.
TOUCH = 2e-3


def marks(case: str, post: str) -> list[FloatArray]:
    """The strokes on the paper as points (N, 2) at most 0.2 mm apart, as the text of the case says."""
    file = FILES[post]
    text = (FIXTURES / "cases" / case / "expected" / file).read_text()
    strokes: list[list[FloatArray]] = []
    at: FloatArray | None = None
    down = False
    for one in find_readback(post)({file: text}, {}).body:
        if not isinstance(one, (MoveJ, MoveL, MoveC)):
            continue
        if not isinstance(one.target, Pose):
            at, down = None, False
            continue
        place = np.array(one.target.origin)
        drawing = at is not None and at[2] < TOUCH and place[2] < TOUCH
        if drawing and at is not None:
            if not down:
                strokes.append([at[None, :2]])
            via = np.array(one.via.origin) if isinstance(one, MoveC) else None
            strokes[-1].append(along(at[:2], place[:2], None if via is None else via[:2]))
        at, down = place, drawing
    return [np.concatenate(stroke) for stroke in strokes]


def along(start: FloatArray, end: FloatArray, via: FloatArray | None) -> FloatArray:
    """Points of the line, or of the arc through ``via``, without its start."""
    if via is None:
        count = max(1, math.ceil(float(np.hypot(*(end - start))) / 0.2))
        return np.asarray(start + (end - start) * np.linspace(0, 1, count + 1)[1:, None])
    (ax, ay), (bx, by) = 2 * (via - start), 2 * (end - start)
    u, w = float(via @ via - start @ start), float(end @ end - start @ start)
    centre = np.array([u * by - w * ay, ax * w - bx * u]) / (ax * by - ay * bx)
    radius = float(np.hypot(*(start - centre)))
    turns = np.unwrap([math.atan2(y - centre[1], x - centre[0]) for x, y in (start, via, end)])
    count = math.ceil(abs(turns[2] - turns[0]) * radius / 0.2) + 1
    angle = np.linspace(turns[0], turns[2], count + 1)[1:]
    return np.asarray(centre + radius * np.column_stack([np.cos(angle), np.sin(angle)]))


def length(stroke: FloatArray) -> float:
    return float(np.hypot(*np.diff(stroke, axis=0).T).sum())


def farthest(points: FloatArray, lines: list[FloatArray]) -> float:
    """The largest distance of one of the points from the lines."""
    all_lines = shapely.multilinestrings([shapely.linestrings(line) for line in lines])
    return float(shapely.distance(shapely.points(points), all_lines).max())


def gear_outline(scale: float) -> Iterable[FloatArray]:
    """The shapes in gear.png by their formula: bore, six holes and teeth, centred on the page of the case, mm."""
    middle, size = np.array([60.0, 50.0]), 600 * scale
    turn = np.linspace(0, 2 * np.pi, 720)
    round_ = np.column_stack([np.cos(turn), np.sin(turn)])
    yield middle + 0.09 * size * round_
    for k in range(6):
        a = np.pi / 3 * k + 0.3
        # The picture's rows run down.
        yield middle + 0.22 * size * np.array([np.cos(a), -np.sin(a)]) + 0.055 * size * round_
    root, tip, pitch = 0.36 * size, 0.44 * size, 2 * np.pi / 18
    rows = []
    for k in range(18):
        # A tooth stands where the turn is half a pitch; flanks run from half width 0.27 to 0.16 of the pitch.
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
    # The outline is as high as the page allows: 0.88 of the picture's 600 px, from border to border.
    scale = (page["size"][1] - 2 * page["margin"]) / (2 * 0.44 * 600)
    expected = sorted(gear_outline(scale), key=length)
    strokes = sorted(marks("gear-trace", post), key=length)
    assert len(strokes) == len(expected) == 8
    for stroke in strokes:
        assert np.hypot(*(stroke[-1] - stroke[0])) < TOUCH
    # The border of the pixels is within 0.71 px of the shape, the drawing within one of the border.
    assert farthest(np.concatenate(strokes), expected) < 1.75 * scale
    assert farthest(np.concatenate(expected), strokes) < 1.75 * scale
    # What is round is known better than a pixel.
    for k, (stroke, circle) in enumerate(zip(strokes[:7], expected[:7], strict=True)):
        assert length(stroke) == pytest.approx(length(circle), abs=2 * math.pi * 0.25 * scale), k


def ellipse_length(a: float, b: float) -> float:
    """Ramanujan's second formula, here good to 1e-6."""
    h = ((a - b) / (a + b)) ** 2
    return math.pi * (a + b) * (1 + 3 * h / (10 + math.sqrt(4 - 3 * h)))


def bezier_length(*control: tuple[float, float]) -> float:
    """By many short chords of de Casteljau's scheme."""
    t = np.linspace(0, 1, 20_001)[:, None]
    levels = [np.array(one) + 0 * t for one in control]
    while len(levels) > 1:
        levels = [a * (1 - t) + b * t for a, b in pairwise(levels)]
    return length(levels[0])


def arc(chord: float, radius: float) -> float:
    return 2 * radius * math.asin(chord / 2 / radius)


@pytest.mark.parametrize("post", FILES)
def test_the_logo_on_paper_has_its_lengths_and_its_place(post: str) -> None:
    # By hand from the file, in its units of half a mm. S and T mirror the control point before them.
    blade = arc(math.hypot(22, 4), 16) + arc(math.hypot(14, 12), 14)
    wave = bezier_length((20, 80), (40, 60), (50, 95), (70, 78)) + bezier_length(
        (70, 78), (90, 61), (100, 70), (140, 82)
    )
    # q 12 10 24 0 from (50, 4); t mirrors its control point (62, 14) at (74, 4) to (86, -6).
    tail = bezier_length((50, 4), (62, 14), (74, 4)) + bezier_length((74, 4), (86, -6), (86, 0))
    units = [
        2 * (152 + 92) - 8 * 16 + 2 * math.pi * 16,
        wave,
        2 * math.pi * 7,
        *[blade] * 3,
        ellipse_length(24, 12),
        24.0,
        tail,
    ]
    strokes = marks("logo-trace", post)
    found = sorted(map(length, strokes))
    # Chords of 0.02 mm: curves come out shorter by less than a tenth of a percent.
    assert found == pytest.approx(sorted(one / 2 for one in units), rel=2e-3)
    points = np.concatenate(strokes)
    # The frame: 2 mm from the page's border on all sides, the page is 80 x 50 mm.
    assert points.min(axis=0) == pytest.approx([2, 2], abs=0.02)
    assert points.max(axis=0) == pytest.approx([78, 48], abs=0.02)
    # The three blades are one turned by 120 degrees about (24, 29): their middles make the circle's centre.
    blades = [s for s in strokes if abs(length(s) - blade / 2) < 0.1]
    starts = np.array([s[np.argmin(np.abs(np.hypot(*(s - [24, 29]).T) - 6))] for s in blades])
    assert starts.mean(axis=0) == pytest.approx([24, 29], abs=0.02)


def test_the_pictures_are_what_their_program_makes(tmp_path: Path) -> None:
    spec = importlib.util.spec_from_file_location("make_pictures", FIXTURES / "make_pictures.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    (tmp_path / "parts").mkdir()
    module.main(tmp_path)
    for made in sorted((tmp_path / "parts").iterdir()):
        assert made.read_bytes() == (FIXTURES / "parts" / made.name).read_bytes(), made.name
        # Another decoder sees the ink that was meant.
        pixels = cv2.imread(str(made), cv2.IMREAD_GRAYSCALE)
        assert np.array_equal(pixels == 0, getattr(module, made.stem)())
