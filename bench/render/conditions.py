"""Photos as they come, drawn by number: a part on a bench, and what makes a photo hard.

A photo takes each condition with a chance of one half, and then draws it from its range. Lengths
are mm, grey values of 255.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import shapely

from bench.render.board import charuco, markers
from bench.render.optics import Lens, Shot, aim_camera, photo_from_work
from bench.render.parts import Part, bracket, gear, plate, random_part
from bench.render.scene import Layer, Scene, render
from bench.render.shapes import Loop, box, flatten
from camgen.vision.boards.sheet import DICTIONARY, make_sheet

#: Pixels of the photo, the focal length in pixels, and mm of a pixel.
SIZE, FOCAL, PIXEL = (2400, 1700), 2600.0, 0.13
#: What gives the work plane, in turns: camgen's sheet around the part, a ChArUco board
#: beside it, pairs of points around it.
WAYS = ("sheet", "board", "pairs")
#: Squares of the board, their width and that of the markers.
BOARD, SQUARE, MARKER = (7, 5), 20.0, 14.0
PARTS: tuple[Callable[[int], Part], ...] = (
    lambda _: plate(),
    lambda _: bracket(),
    lambda _: gear(),
    random_part,
)
#: Distance between layers that stand for a wall.
_WALL_STEP = 0.2


@dataclass(frozen=True)
class Conditions:
    """The conditions of a photo. The defaults are those of a clean one.

    contrast: difference of part and ground.
    noise: its standard deviation.
    blur: its standard deviation, px, without the pixel's own square.
    motion: length of the camera's path, px.
    chips: number of chips beside the part.
    height: height of the part's upper face above the ground.
    is_told: whether the job states the height.
    k1: first coefficient of a lens without calibration.
    bench: plain, brushed or wood. On the sheet it is plain.
    shadow: light that a shadow beside the part takes away, 0..1.
    """

    contrast: float = 100.0
    noise: float = 1.0
    blur: float = 0.7
    motion: float = 0.0
    chips: int = 0
    height: float = 0.0
    is_told: bool = False
    k1: float = 0.0
    bench: str = "plain"
    shadow: float = 0.0

    @property
    def names(self) -> tuple[str, ...]:
        """The conditions that are not those of a clean photo."""
        clean = Conditions()
        fields = ("contrast", "noise", "blur", "motion", "chips", "height", "k1", "bench", "shadow")
        return tuple(name for name in fields if getattr(self, name) != getattr(clean, name))


#: How each condition is drawn.
_RANGES: dict[str, Callable[[np.random.Generator], object]] = {
    "contrast": lambda rng: float(rng.uniform(5, 120)),
    "noise": lambda rng: float(rng.uniform(0, 4)),
    "blur": lambda rng: float(rng.uniform(0.3, 3)),
    "motion": lambda rng: float(rng.uniform(0, 9)),
    "chips": lambda rng: int(rng.integers(1, 101)),
    "height": lambda rng: float(rng.uniform(0, 10)),
    "is_told": lambda _: True,
    "k1": lambda rng: float(rng.uniform(-0.25, 0)),
    "bench": lambda rng: str(rng.choice(["brushed", "wood"])),
    "shadow": lambda rng: float(rng.uniform(0.1, 0.5)),
}


@dataclass(frozen=True, eq=False)
class ConditionedPhoto:
    """A photo with its truth.

    pixels: (H, W) uint8.
    loops: outlines of the part's upper face in the work frame.
    box: (2, 2), the corner of the part with the least u and v, and that with the most, px.
    job: tables of the job, as they are in its file.
    """

    number: int
    plane_by: str
    conditions: Conditions
    pixels: np.ndarray
    loops: tuple[Loop, ...]
    box: np.ndarray
    job: dict[str, dict[str, object]]


def draw_conditions(number: int) -> Conditions:
    """The conditions of the photo with this number."""
    rng = np.random.default_rng([number, 41])
    drawn = {name: make(rng) for name, make in _RANGES.items() if rng.random() < 0.5}
    return Conditions(**drawn)


def draw_photo(number: int, conditions: Conditions) -> ConditionedPhoto:
    """The photo with this number under these conditions."""
    rng = np.random.default_rng([number, 42])
    plane_by = WAYS[number % len(WAYS)]
    middle, looked_at = _places(plane_by)
    turn = rng.uniform(0, 2 * np.pi)
    drawn = PARTS[number // len(WAYS) % len(PARTS)](number)
    part = tuple(loop.moved(turn, middle) for loop in drawn)
    shot = _take(looked_at, conditions, rng)
    scene = _make_scene(part, plane_by, conditions, rng)
    pixels = _sense(render(scene, shot), conditions, rng)
    job = _job(part, plane_by, shot, conditions, rng)
    outline = np.column_stack(photo_from_work(shot, part[0].points.real, part[0].points.imag))
    box = np.array([outline.min(axis=0), outline.max(axis=0)])
    return ConditionedPhoto(number, plane_by, conditions, pixels, part, box, job)


def _places(plane_by: str) -> tuple[complex, complex]:
    """The middle of the part and that of the photo, mm."""
    if plane_by == "sheet":
        middle = complex(*make_sheet("A4").free) / 2
        return middle, middle
    if plane_by == "board":
        half = complex(BOARD[0], BOARD[1]) * SQUARE / 2
        return 2 * half.real + 70 + 1j * half.imag, 2 * half.real - 10 + 1j * half.imag
    return complex(100, 80), complex(100, 80)


def _take(at: complex, conditions: Conditions, rng: np.random.Generator) -> Shot:
    """The camera above the bench."""
    width, height = SIZE
    matrix = np.array([[FOCAL, 0, (width - 1) / 2], [0, FOCAL, (height - 1) / 2], [0, 0, 1]])
    lens = Lens(matrix, (conditions.k1, -0.3 * conditions.k1, 0, 0, 0), SIZE)
    pixel = complex(width - 1, height - 1) / 2 + complex(*rng.uniform(-40, 40, 2))
    tilt, about, roll = rng.uniform((0, 0, -5), (15, 360, 5))
    gradient = tuple(rng.uniform(-0.15, 0.15, 2))
    pose = aim_camera(lens, at, pixel, PIXEL, (tilt, about, roll))
    return Shot(lens, *pose, blur=conditions.blur, gradient=gradient, vignetting=0.05)


def _make_scene(
    part: Part, plane_by: str, conditions: Conditions, rng: np.random.Generator
) -> Scene:
    """The layers on the bench, from below to above."""
    ground = 0.72 if plane_by == "sheet" else float(rng.uniform(0.55, 0.7))
    layers: list[Layer] = []
    if plane_by == "sheet":
        paper = make_sheet("A4")
        x, y = paper.origin
        page = (-x, -y, paper.page[0] - x, paper.page[1] - y)
        page_layer, ink = markers(page, paper.ids, paper.corners, DICTIONARY)
        layers += [replace(page_layer, colour=ground), ink]
    elif conditions.bench == "wood":
        layers += _wood(part, ground, rng)
    if plane_by == "board":
        layers += charuco(*BOARD, SQUARE, MARKER, DICTIONARY)
    if conditions.shadow:
        shift = 4 * np.exp(1j * rng.uniform(0, 2 * np.pi))
        shaded = ground * (1 - conditions.shadow)
        layers.append(Layer(tuple(loop.moved(0.0, shift) for loop in part), shaded))
    tone = ground - conditions.contrast / 255
    chips = _chips(part, plane_by, conditions.chips, rng)
    if chips:
        layers.append(Layer(chips, float(rng.uniform(0.1, 0.5)), texture=0.05))
    heights = np.arange(0.0, conditions.height, _WALL_STEP).tolist()
    layers += [Layer(part, 0.7 * tone, z=z) for z in heights]
    layers.append(Layer(part, tone, texture=0.01, z=conditions.height))
    grained = conditions.bench == "brushed" and plane_by != "sheet"
    return Scene(ground, tuple(layers), texture=0.06 if grained else 0.01, grain_seed=1)


def _wood(part: Part, ground: float, rng: np.random.Generator) -> list[Layer]:
    """Dark stripes with a wave, 0.4 to 2 mm wide, 3 to 9 mm apart."""
    middle = part[0].points.mean()
    x = np.linspace(-260.0, 260.0, 105)
    loops, y = [], -200.0
    while y < 200:
        width = rng.uniform(0.4, 2.0)
        wave = rng.uniform(0.5, 3) * np.sin(x / rng.uniform(30, 80) + rng.uniform(0, 6))
        lower, upper = x + 1j * (y + wave), x[::-1] + 1j * (y + width + wave[::-1])
        loops.append(Loop(np.concatenate([lower, upper]) + middle, np.zeros(2 * len(x))))
        y += width + rng.uniform(3, 9)
    return [Layer(tuple(loops), ground * float(rng.uniform(0.85, 0.95)), texture=0.03)]


def _chips(part: Part, plane_by: str, count: int, rng: np.random.Generator) -> tuple[Loop, ...]:
    """Strips of 1 to 8 mm by 0.4 to 2 mm, 1 mm or more from the part and from each other."""
    if not count:
        return ()
    low, high = np.zeros(2), np.array(make_sheet("A4").free)
    if plane_by != "sheet":
        points = part[0].points
        low = np.array([points.real.min(), points.imag.min()]) - 14
        high = np.array([points.real.max(), points.imag.max()]) + 14
    taken = material(part)
    room = shapely.box(*(low + 2), *(high - 2))
    chips: list[Loop] = []
    for _ in range(20 * count):
        if len(chips) == count:
            break
        length, width, turn = rng.uniform((1, 0.4, 0), (8, 2, np.pi))
        at = complex(*rng.uniform(low, high))
        chip = box(-length / 2, -width / 2, length / 2, width / 2).moved(turn, at)
        shape = material((chip,))
        if shape.within(room) and shape.distance(taken) > 1:
            taken = shapely.union(taken, shape)
            chips.append(chip)
    return tuple(chips)


def material(loops: Sequence[Loop]) -> shapely.Geometry:
    """The material of loops, arcs as chords of 0.1 mm."""
    region = shapely.Polygon()
    for loop in loops:
        at = flatten(loop, lambda whole: np.where(whole.sweep == 0, 1, whole.length / 0.1 + 2))
        region = shapely.symmetric_difference(region, shapely.Polygon(at))
    return region


def _sense(light: np.ndarray, conditions: Conditions, rng: np.random.Generator) -> np.ndarray:
    """The picture of a camera that moves and has noise."""
    values = light.astype(np.float32)
    angle = rng.uniform(0, np.pi)
    if conditions.motion:
        # A line of points a tenth of a pixel apart, spread to the pixels around each of them.
        along = np.arange(-conditions.motion / 2, conditions.motion / 2, 0.1) + 0.05
        kernel = np.zeros((13, 13), np.float32)
        x, y = 6 + along * np.cos(angle), 6 + along * np.sin(angle)
        left, top = np.floor(x).astype(int), np.floor(y).astype(int)
        for i, j in ((0, 0), (0, 1), (1, 0), (1, 1)):
            share = np.abs(1 - i - (y - top)) * np.abs(1 - j - (x - left))
            np.add.at(kernel, (top + i, left + j), share.astype(np.float32))
        values = cv2.filter2D(values, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REPLICATE)
    values = values + conditions.noise * rng.standard_normal(values.shape, dtype=np.float32)
    return np.rint(np.clip(values, 0, 255)).astype(np.uint8)


def _job(
    part: Part, plane_by: str, shot: Shot, conditions: Conditions, rng: np.random.Generator
) -> dict[str, dict[str, object]]:
    """The tables of the job. Points are read with an error of 0.2 px."""
    camera: dict[str, object] = {}
    image: dict[str, object] = {}
    if plane_by == "sheet":
        camera["markers"] = "A4"
    elif plane_by == "board":
        points = part[0].points
        low, high = points.real.min() - 15, points.real.max() + 15
        image["region"] = [low, points.imag.min() - 15, high, points.imag.max() + 15]
        camera |= {"markers": "{}x{}".format(*BOARD), "square": SQUARE, "marker": MARKER}
    else:
        at = part[0].points.mean() + np.delete(np.add.outer([-70, 0, 70], [-60j, 0, 60j]), 4)
        px = np.column_stack(photo_from_work(shot, at.real, at.imag))
        px += rng.normal(0, 0.2, px.shape)
        camera["points_px"] = px.tolist()
        camera["points_mm"] = np.column_stack([at.real, at.imag]).tolist()
    if conditions.height and conditions.is_told:
        camera["height"] = conditions.height
    return {"camera": camera, "image": image}
