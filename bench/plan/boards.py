"""Filling circuit boards and finding drill marks.

    python -m bench.plan.boards [FOLDER] [BOARDS, 50] [PIXELS ...]

FOLDER holds pictures of boards. Others are rendered at 300 dpi, seeded. Boards to be filled have
PIXELS (1000 and 3000) a side, pads, tracks with bends of 45 degrees, and a ground plane with
clearances; two sets of BOARDS each have drill marks. The first table has the area that a marker
covers, the ink outside, strokes and seconds. Exits with 1 if a goal is missed.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from functools import partial
from itertools import pairwise, product
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from msgspec import Struct

from bench.support.runner import Cells, Missed, Scenario, read_words, run
from bench.support.timing import median_seconds
from camgen.model.part import Contour, Part, Raster
from camgen.model.pose import frozen
from camgen.plan.fill import fill
from camgen.plan.image_space.border import fit_border
from camgen.plan.image_space.field import find_chains
from camgen.read import read
from camgen.read.job_file import from_mapping
from camgen.vision.crosses import find_crosses

FILL_COLUMNS = (
    "board | marker, mm {:g} | covered {:.2f} % | outside {:.2f} % | beside thin {:.2f} % "
    "| strokes | s {:.2f}"
)
MARK_COLUMNS = "boards | marks | missed | invented | rms, px {:.3f} | largest, px {:.3f}"
DPI = 300
MM = 25.4 / DPI
#: For each marker, mm, the least share of the copper that is covered, and the largest share of ink
#: outside, without that beside thin tracks.
GOALS = {0.85: (0.98, 0.02), 0.3: (0.995, 0.02)}
#: Largest error of a drill mark, px.
CENTRE = 0.2
#: Binary digits of a pixel's fraction that OpenCV draws.
_SHIFT = 4


def board(
    pixels: int, seed: int, plane: bool, widths: tuple[float, ...] = (0.4, 0.6, 0.85, 1.2, 2.0)
) -> np.ndarray:
    """A square board, 255 copper: tracks with a pad at each end, and half of it a ground plane."""
    random = np.random.default_rng(seed)
    copper = np.zeros((pixels, pixels), dtype=np.uint8)
    nets = [_draw_net(random, pixels, widths) for _ in range((pixels // 100) ** 2 // 8)]
    if plane:
        cv2.rectangle(copper, (pixels // 2, 30), (pixels - 30, pixels - 30), 255, -1)
        for net in nets:
            _draw_track(copper, net, 1.2, 0)
    for net in nets:
        _draw_track(copper, net, 0.0, 255)
    for net in nets:
        for u, v in net.ends:
            _draw_disc(copper, u, v, net.hole, 0)
    return copper


class Net(NamedTuple):
    """A track with a pad at each end.

    line: (N, 2) points, px.
    width: width of the track, mm.
    size: width of the pads, mm.
    hole: diameter of their holes, mm.
    is_square: whether the pads are square.
    """

    line: np.ndarray
    width: float
    size: float
    hole: float
    is_square: bool

    @property
    def ends(self) -> np.ndarray:
        """The middles of the pads, (2, 2) px."""
        return self.line[[0, -1]]


def _draw_net(random: np.random.Generator, pixels: int, widths: tuple[float, ...]) -> Net:
    room = 60
    u, v = random.integers(room, pixels - room, 2)
    long, slant = random.integers(80, 500, 2)
    along, across = random.choice([-1, 1], 2)
    steps = np.array([(0, 0), (along * long, 0), (along * (long + slant), across * slant)])
    if random.random() < 0.5:
        steps = steps[:, ::-1]
    line = np.clip(steps + np.array([u, v], dtype=float), room, pixels - room)
    size, hole = float(random.choice([1.8, 2.2, 2.8])), float(random.choice([0.6, 0.8, 1.0]))
    is_square = bool(random.random() < 0.3)
    return Net(line, float(random.choice(widths)), size, hole, is_square)


def _draw_track(copper: np.ndarray, net: Net, wider: float, value: int) -> None:
    """A track and its pads, all of them wider by some mm."""
    width, size = net.width + wider, net.size + wider
    for a, b in pairwise(net.line):
        along = b - a
        length = np.hypot(*along)
        if length > 0:
            side = np.array([-along[1], along[0]]) / length * (width / MM / 2)
            _draw_polygon(copper, np.array([a + side, b + side, b - side, a - side]), value)
        for u, v in (a, b):
            _draw_disc(copper, u, v, width, value)
    for u, v in net.ends:
        if net.is_square:
            corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * (size / MM / 2)
            _draw_polygon(copper, corners + np.array([u, v]), value)
        else:
            _draw_disc(copper, u, v, size, value)


def _draw_disc(copper: np.ndarray, u: float, v: float, diameter: float, value: int) -> None:
    angle = np.linspace(0, 2 * np.pi, 96, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    _draw_polygon(copper, circle * (diameter / MM / 2) + (u, v), value)


def _draw_polygon(copper: np.ndarray, points: np.ndarray, value: int) -> None:
    rounded = np.rint(points * 2**_SHIFT).astype(np.int32)[:, None]
    cv2.fillPoly(copper, [rounded], value, cv2.LINE_8, _SHIFT)


def part_of(copper: np.ndarray) -> Part:
    """The board as the reader gives it, with borders fitted to its pixels."""
    table, points = fit_border(find_chains(copper))
    places = np.column_stack([points.real, points.imag])
    borders = tuple(frozen(border) for border in np.split(places, table.first[1:]))
    high = copper.shape[0]
    work_from_view = frozen([[MM, 0, 0], [0, -MM, MM * (high - 1)]])
    raster = Raster(copper, frozen(np.zeros((4, 2))), copper, work_from_view, copper, borders)
    corner = Contour(frozen([[0, 0], [1, 0], [1, 1]]), frozen(np.zeros(3)), True, "copper", "c0")
    return Part("board", "board.png", "px", (corner,), (), raster)


def measure_fill(name: str, part: Part) -> Iterator[Cells]:
    """A row for each marker."""
    for diameter, (covered_share, outside_share) in GOALS.items():
        job = from_mapping({"operation": {"kind": "fill"}, "tool": {"diameter": diameter}})
        paths, _, area = fill(part, job)
        seconds = median_seconds(partial(fill, part, job), 3)
        shares = [100 * mm2 / area.copper for mm2 in (area.covered, area.outside, area.thin)]
        is_met = shares[0] >= 100 * covered_share and shares[1] <= 100 * outside_share
        covered = shares[0] if is_met else Missed(f"{shares[0]:.2f} %")
        yield name, diameter, covered, *shares[1:], len(paths), seconds


def fill_inputs(folder: Path, sizes: tuple[int, ...]) -> Iterator[tuple[str, Part]]:
    """Name and part of each board, rendered and of the folder."""
    for seed, (pixels, plane) in enumerate(product(sizes, (False, True)), 1):
        name = f"rendered {pixels} x {pixels}{', plane' if plane else ''}"
        yield name, part_of(board(pixels, seed, plane))
    scale = {"operation": {"kind": "fill"}, "image": {"mm_per_px": MM}}
    for path in sorted(folder.glob("*_temp.jpg")):
        yield path.name, read(path, from_mapping(scale))


class Marks(Struct):
    """A rendered board with + marks.

    picture: (H, W).
    ink: (H, W), 255 where the picture is dark.
    centres: (N, 2) centres of the marks, px.
    """

    picture: np.ndarray
    ink: np.ndarray
    centres: np.ndarray


def marks(seed: int, pixels: int = 500, finer: int = 8) -> Marks:
    """A board with + marks and other shapes at fractions of a pixel, smoothed, with noise.

    It is turned by up to 5 degrees.
    """
    random = np.random.default_rng(seed)
    degrees, reach, width = random.uniform((-5, 6, 1.8), (5, 14, 4))
    turn = np.radians(degrees)
    ink = np.zeros((pixels * finer, pixels * finer), dtype=np.uint8)
    places = 40.0 + 60 * np.array(list(np.ndindex(7, 7)))
    places = random.permutation(places) + random.uniform(-8, 8, places.shape)
    count = int(random.integers(8, 25))
    turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    other = _other_shapes(reach, width)
    for k, centre in enumerate(places[: count + len(other)]):
        for corners in _cross(reach, width) if k < count else other[k - count]:
            _draw_polygon(ink, (np.array(corners) @ turned.T + centre + 0.5) * finer - 0.5, 255)
    share = cv2.resize(ink, (pixels, pixels), interpolation=cv2.INTER_AREA) / 255
    light, dark = random.uniform(200, 250), random.uniform(10, 60)
    seen = cv2.GaussianBlur(light + (dark - light) * share, (0, 0), 0.6)
    seen += random.normal(0, 6, (pixels, pixels))
    picture = seen.round().clip(0, 255).astype(np.uint8)
    _, mask = cv2.threshold(picture, 0, 255, cv2.THRESH_BINARY_INV | cv2.THRESH_OTSU)
    return Marks(picture, mask, places[:count])


def _bar(left: float, top: float, right: float, bottom: float) -> list[tuple[float, float]]:
    return [(left, top), (right, top), (right, bottom), (left, bottom)]


def _cross(r: float, w: float) -> list[list[tuple[float, float]]]:
    return [_bar(-r, -w / 2, r, w / 2), _bar(-w / 2, -r, w / 2, r)]


def _other_shapes(r: float, w: float) -> list[list[list[tuple[float, float]]]]:
    """Shapes beside the marks: a bar, two T, an L, a disc, a square, a triangle, an x."""
    disc = [(r * np.cos(a), r * np.sin(a)) for a in np.linspace(0, 2 * np.pi, 40, endpoint=False)]
    slants = [
        [(-r, w - r), (w - r, -r), (r, r - w), (r - w, r)],
        [(-r, r - w), (w - r, r), (r, w - r), (r - w, -r)],
    ]
    return [
        [_bar(-r, -w / 2, r, w / 2)],
        [_bar(-r, -w / 2, r, w / 2), _bar(-w / 2, 0, w / 2, r)],
        [_bar(-r, -w / 2, 0, w / 2), _bar(-w / 2, -r, w / 2, r)],
        [_bar(-r, -r, r, w - r), _bar(-r, -r, w - r, r)],
        [disc],
        [_bar(-r, -r, r, r)],
        [[(-r, -r), (r, -r), (0, r)]],
        slants,
    ]


def mark_errors(board: Marks) -> tuple[int, int, np.ndarray]:
    """Marks missed, marks invented, and the errors of the others, px."""
    crosses = find_crosses(board.ink, board.picture)
    centres = np.array([(cross.u, cross.v) for cross in crosses]).reshape(-1, 2)
    distances = np.linalg.norm(board.centres[:, None] - centres, axis=2)
    nearest = distances.min(axis=1, initial=np.inf)
    invented = int((distances.min(axis=0, initial=np.inf) > 1).sum())
    return int((nearest > 1).sum()), invented, nearest[nearest <= 1]


def measure_marks(name: str, chosen: list[tuple[int, int]]) -> Iterator[Cells]:
    """The row of a set of boards, of which seed and pixels are given."""
    results = [mark_errors(marks(seed, pixels)) for seed, pixels in chosen]
    missed_counts, invented_counts, error_groups = zip(*results, strict=True)
    missed, invented = sum(missed_counts), sum(invented_counts)
    errors = np.concatenate(error_groups)
    largest = errors.max()
    is_met = missed == invented == 0 and largest < CENTRE
    counts = len(errors) + missed, missed, invented
    rms = np.sqrt((errors**2).mean())
    yield name, *counts, rms, largest if is_met else Missed(f"{largest:.3f}")


def mark_sets(count: int) -> dict[str, list[tuple[int, int]]]:
    """``count`` boards on which the finder of marks was made, and as many others in other sizes."""
    sizes = (470, 500, 620, 800)
    others = [(1000 + k, sizes[k % len(sizes)]) for k in range(count)]
    return {
        f"{count}, seeds 0 to {count - 1}": [(seed, 500) for seed in range(count)],
        f"{count}, seeds 1000 to {999 + count}": others,
    }


if __name__ == "__main__":
    folder, count, *sizes = read_words(Path(), 50)
    pixels = tuple(map(int, sizes)) or (1000, 3000)
    fills = Scenario(FILL_COLUMNS, fill_inputs(folder, pixels), measure_fill)
    sys.exit(run(fills, Scenario(MARK_COLUMNS, mark_sets(count).items(), measure_marks)))
