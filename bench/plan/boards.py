"""Filling circuit boards and finding drill marks.

    python -m bench.plan.boards [FOLDER] [BOARDS, 50] [PIXELS ...]

FOLDER holds pictures of boards. Others are rendered at 300 dpi, seeded: to be filled, PIXELS (1000 and 3000) a side,
with pads, tracks with bends of 45 degrees, a ground plane with clearances; and with marks, BOARDS in each of two sets.
Prints the tables of docs/benchmarks.md: what a marker covers, what it inks beside, strokes and seconds. Exits with 1
when a figure misses its goal.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from functools import partial
from itertools import pairwise, product
from pathlib import Path

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
    "| copper, mm2 {:.0f} | bare {:.1f} | outside {:.1f} | thin {:.1f} | strokes | points "
    "| s {:.2f}"
)
MARK_COLUMNS = "boards | marks | missed | invented | rms, px {:.3f} | largest, px {:.3f}"
DPI = 300
MM = 25.4 / DPI
#: By marker, mm: the least share of the copper covered, and the most ink outside beside that of thin tracks.
GOALS = {0.85: (0.98, 0.02), 0.3: (0.995, 0.02)}
#: Of drill marks, px.
CENTRE = 0.2
_SHIFT = 4


def board(
    pixels: int, seed: int, plane: bool, widths: tuple[float, ...] = (0.4, 0.6, 0.85, 1.2, 2.0)
) -> np.ndarray:
    """A square board, 255 copper: parts with rows of pads, tracks between them, half of it a ground plane if asked."""
    random = np.random.default_rng(seed)
    copper = np.zeros((pixels, pixels), dtype=np.uint8)
    nets = [_net(random, pixels, widths) for _ in range((pixels // 100) ** 2 // 8)]
    if plane:
        cv2.rectangle(copper, (pixels // 2, 30), (pixels - 30, pixels - 30), 255, -1)
        for line, width, pads in nets:
            _track(copper, line, width + 1.2, 0)
            _pads(copper, pads, 1.2, 0)
    for line, width, pads in nets:
        _track(copper, line, width, 255)
        _pads(copper, pads, 0.0, 255)
    for _, _, pads in nets:
        for u, v, _, hole, _ in pads:
            _disc(copper, u, v, hole, 0)
    return copper


def _net(random: np.random.Generator, pixels: int, widths: tuple[float, ...]):
    """A track with one or two bends and a pad at each end: points px, width mm, pads (u, v, mm, hole mm, square)."""
    room = 60
    u, v = random.integers(room, pixels - room, 2)
    long, slant = random.integers(80, 500, 2)
    signs = random.choice([-1, 1], 2)
    points = [
        (u, v),
        (u + signs[0] * long, v),
        (u + signs[0] * (long + slant), v + signs[1] * slant),
    ]
    if random.random() < 0.5:
        points = [(u + (b - v), v + (a - u)) for a, b in points]
    line = np.clip(np.array(points, dtype=float), room, pixels - room)
    size, hole = float(random.choice([1.8, 2.2, 2.8])), float(random.choice([0.6, 0.8, 1.0]))
    square = bool(random.random() < 0.3)
    ends = [(float(a), float(b), size, hole, square) for a, b in (line[0], line[-1])]
    return line, float(random.choice(widths)), ends


def _track(copper: np.ndarray, line: np.ndarray, width: float, value: int) -> None:
    half = width / MM / 2
    for a, b in pairwise(line):
        along = b - a
        size = np.hypot(*along)
        if size > 0:
            side = np.array([-along[1], along[0]]) / size * half
            _polygon(copper, np.array([a + side, b + side, b - side, a - side]), value)
        for u, v in (a, b):
            _disc(copper, u, v, width, value)


def _pads(copper: np.ndarray, pads, more: float, value: int) -> None:
    for u, v, size, _, square in pads:
        half = (size + more) / MM / 2
        if square:
            corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * half
            _polygon(copper, corners + np.array([u, v]), value)
        else:
            _disc(copper, u, v, size + more, value)


def _disc(copper: np.ndarray, u: float, v: float, diameter: float, value: int) -> None:
    angle = np.linspace(0, 2 * np.pi, 96, endpoint=False)
    _polygon(
        copper,
        np.column_stack([np.cos(angle), np.sin(angle)]) * (diameter / MM / 2) + (u, v),
        value,
    )


def _polygon(copper: np.ndarray, points: np.ndarray, value: int) -> None:
    cv2.fillPoly(
        copper, [np.rint(points * 2**_SHIFT).astype(np.int32)[:, None]], value, cv2.LINE_8, _SHIFT
    )


def part_of(copper: np.ndarray) -> Part:
    """The board as the reader gives it, with the borders that its pixels tell."""
    table, points = fit_border(find_chains(copper))
    borders = tuple(
        frozen(np.column_stack([p.real, p.imag])) for p in np.split(points, table.first[1:])
    )
    high = copper.shape[0]
    work_from_view = frozen([[MM, 0, 0], [0, -MM, MM * (high - 1)]])
    raster = Raster(copper, frozen(np.zeros((4, 2))), copper, work_from_view, copper, borders)
    corner = Contour(frozen([[0, 0], [1, 0], [1, 1]]), frozen(np.zeros(3)), True, "copper", "c0")
    return Part("board", "board.png", "px", (corner,), (), raster)


def judge_fill(name: str, part: Part) -> Iterator[Cells]:
    """A row for each marker."""
    for diameter, (least, most) in GOALS.items():
        job = from_mapping({"operation": {"kind": "fill"}, "tool": {"diameter": diameter}})
        paths, _, area = fill(part, job)
        seconds = median_seconds(partial(fill, part, job), 3)
        shares = [100 * mm2 / area.copper for mm2 in (area.covered, area.outside, area.thin)]
        areas = [area.copper, area.copper - area.covered, area.outside, area.thin]
        points = sum(len(path.position) for path in paths)
        is_met = shares[0] >= 100 * least and shares[1] <= 100 * most
        covered = shares[0] if is_met else Missed(f"{shares[0]:.2f} %")
        yield name, diameter, covered, *shares[1:], *areas, len(paths), points, seconds


def fill_inputs(folder: Path, sizes: tuple[int, ...]) -> Iterator[tuple[str, Part]]:
    """Name and part of each board, rendered and of the folder."""
    for seed, (pixels, plane) in enumerate(product(sizes, (False, True)), 1):
        name = f"rendered {pixels} x {pixels}{', plane' if plane else ''}"
        yield name, part_of(board(pixels, seed, plane))
    scale = {"operation": {"kind": "fill"}, "image": {"mm_per_px": MM}}
    for path in sorted(folder.glob("*_temp.jpg")):
        yield path.name, read(path, from_mapping(scale))


class Marks(Struct):
    """A rendered board with + marks. centres: (N, 2) px. ink: (H, W), 255 where the picture is dark."""

    picture: np.ndarray
    ink: np.ndarray
    centres: np.ndarray


def marks(seed: int, pixels: int = 500, finer: int = 8) -> Marks:
    """A board turned by up to 5 degrees: + marks and other shapes, smoothed, with noise, at fractions of a pixel."""
    random = np.random.default_rng(seed)
    turn, reach, width = (
        np.radians(random.uniform(-5, 5)),
        random.uniform(6, 14),
        random.uniform(1.8, 4),
    )
    ink = np.zeros((pixels * finer, pixels * finer), dtype=np.uint8)
    places = np.array([(40 + 60 * i, 40 + 60 * j) for i in range(7) for j in range(7)], dtype=float)
    places = random.permutation(places) + random.uniform(-8, 8, places.shape)
    count = int(random.integers(8, 25))
    turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    other = _other_shapes(reach, width)
    for k, centre in enumerate(places[: count + len(other)]):
        for corners in _cross(reach, width) if k < count else other[k - count]:
            _polygon(ink, (np.array(corners) @ turned.T + centre + 0.5) * finer - 0.5, 255)
    share = cv2.resize(ink, (pixels, pixels), interpolation=cv2.INTER_AREA) / 255
    light, dark = random.uniform(200, 250), random.uniform(10, 60)
    seen = cv2.GaussianBlur(light + (dark - light) * share, (0, 0), 0.6) + random.normal(
        0, 6, (pixels, pixels)
    )
    picture = seen.round().clip(0, 255).astype(np.uint8)
    _, mask = cv2.threshold(picture, 0, 255, cv2.THRESH_BINARY_INV | cv2.THRESH_OTSU)
    return Marks(picture, mask, places[:count])


def _bar(left: float, top: float, right: float, bottom: float) -> list[tuple[float, float]]:
    return [(left, top), (right, top), (right, bottom), (left, bottom)]


def _cross(r: float, w: float) -> list[list[tuple[float, float]]]:
    return [_bar(-r, -w / 2, r, w / 2), _bar(-w / 2, -r, w / 2, r)]


def _other_shapes(r: float, w: float) -> list[list[list[tuple[float, float]]]]:
    """What is no mark: a bar, two T, an L, a disc, a square, a triangle, an x."""
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
    """Marks missed, marks invented, and how far (px) the found ones are off."""
    found = np.array([(c.u, c.v) for c in find_crosses(board.ink, board.picture)]).reshape(-1, 2)
    far = np.hypot(*(board.centres[:, None] - found[None]).transpose(2, 0, 1))
    nearest = far.min(axis=1, initial=np.inf)
    return (
        int((nearest > 1).sum()),
        int((far.min(axis=0, initial=np.inf) > 1).sum()),
        nearest[nearest <= 1],
    )


def judge_marks(name: str, chosen: list[tuple[int, int]]) -> Iterator[Cells]:
    """The row of a set of boards, of which seed and pixels are given."""
    results = [mark_errors(marks(seed, pixels)) for seed, pixels in chosen]
    missed, invented = (sum(result[k] for result in results) for k in (0, 1))
    off = np.concatenate([result[2] for result in results])
    largest = off.max()
    is_met = missed == invented == 0 and largest < CENTRE
    counts = len(off) + missed, missed, invented
    rms = np.sqrt((off**2).mean())
    yield name, *counts, rms, largest if is_met else Missed(f"{largest:.3f}")


def mark_sets(count: int) -> dict[str, list[tuple[int, int]]]:
    """``count`` boards on which the finder of marks was made, and as many others in pictures of other sizes."""
    return {
        f"{count}, seeds 0 to {count - 1}": [(seed, 500) for seed in range(count)],
        f"{count}, seeds 1000 to {999 + count}": [
            (1000 + k, (470, 500, 620, 800)[k % 4]) for k in range(count)
        ],
    }


if __name__ == "__main__":
    folder, count, *sizes = read_words(Path(), 50)
    pixels = tuple(map(int, sizes)) or (1000, 3000)
    sys.exit(
        run(
            Scenario(FILL_COLUMNS, fill_inputs(folder, pixels), judge_fill),
            Scenario(MARK_COLUMNS, mark_sets(count).items(), judge_marks),
        )
    )
