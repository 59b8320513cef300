"""Masks of real pictures: python -m bench.photo.masks [FOLDER] [WIDTH, 3840] [RUNS, 5]

The mask of `mask = "auto"` for each picture of FOLDER, at 0.1 mm/px, since they have no scale, and
for photos drawn here, WIDTH px wide. The time is beside that of the two OpenCV calls that it
replaces: Otsu's threshold, and the connected components with their statistics. Exits with 1 if a
goal is missed.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from bench.support.runner import SHARED, Cells, Missed, Scenario, find_files, read_words, run
from bench.support.timing import best_seconds
from camgen.model.errors import CamgenError
from camgen.read.files import Files
from camgen.vision.image import read_picture
from camgen.vision.mask.part_mask import make_mask
from camgen.vision.to_scale import ScaledView, make_scaled_view

ENDS = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp"}
GOAL = 1.3
COLUMNS = (
    "picture | pixels | method | level {:.1f} | part px | parts | holes | why | ms {:.1f} "
    "| times the bare calls {:.2f}"
)
#: Width and height of a drawn photo, px.
WIDTH, HEIGHT = 3840, 2748


def call_opencv(pixels: np.ndarray) -> None:
    """The calls that a mask needs at least."""
    grey = pixels if pixels.ndim == 2 else cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
    binary = cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY_INV | cv2.THRESH_OTSU)[1]
    cv2.connectedComponentsWithStats(binary)


def measure(name: str, make: Callable[[], ScaledView], runs: int) -> Iterator[Cells]:
    """The row of a picture. The goal is one of photos in even light."""
    size = None
    try:
        view = make()
        size = f"{view.pixels.shape[1]} x {view.pixels.shape[0]}"
        mask = make_mask(view, name=name)
    except CamgenError as error:
        yield name, size, "refused", None, None, None, None, str(error)
        return
    call_opencv(view.pixels)  # the first run of each is slower
    plain = best_seconds(lambda: call_opencv(view.pixels), runs)
    taken = best_seconds(lambda: make_mask(view, name=name), runs)
    count, _, stats, _ = cv2.connectedComponentsWithStats(mask.pixels)
    holes = cv2.connectedComponents(cv2.bitwise_not(mask.pixels), connectivity=4)[0] - 2
    level = mask.level
    if not isinstance(level, float):
        level = f"{level.min():.0f} to {level.max():.0f}"
    counts = int(stats[1:, 4].sum()), count - 1, holes
    times = f"{taken / plain:.2f}"
    if name in EVEN and taken / plain > GOAL:
        times = Missed(times)
    yield name, size, mask.method, level, *counts, mask.why, 1000 * taken, times


def load_view(path: Path) -> ScaledView:
    return make_scaled_view(read_picture(Files().read(path)), mm_per_px=0.1)


def draw(part: float, bench: float, slope: float, noise: float, width: int) -> ScaledView:
    """A disc with twelve holes, a blur of 1 px, and light that falls off by ``slope``."""
    size = width / WIDTH
    height = round(HEIGHT * size)
    shape = np.zeros((height, width), np.float32)
    cv2.circle(shape, (round(1900 * size), round(1300 * size)), round(1000 * size), 1.0, -1)
    for angle in np.arange(12) * np.pi / 6:
        middle = np.array([1900 + 700 * np.cos(angle), 1300 + 700 * np.sin(angle)]) * size
        cv2.circle(shape, np.rint(middle).astype(int).tolist(), round(60 * size), 0.0, -1)
    light = np.linspace(1, 1 - slope, width, dtype=np.float32)
    grey = cv2.GaussianBlur((bench + (part - bench) * shape) * light, (0, 0), 1.0)
    grey += np.random.default_rng(7).normal(0, noise, grey.shape).astype(np.float32)
    pixels = np.clip(np.rint(grey), 0, 255).astype(np.uint8)
    return ScaledView(pixels, np.array([[0.143, 0, 0], [0, -0.143, 0.143 * height]]), 0.143)


SCENES = {
    "even light": (60.0, 200.0, 0.0, 2.0),
    "even light, light part": (200.0, 60.0, 0.0, 2.0),
    "light 2:1": (60.0, 200.0, 0.5, 2.0),
    "20 levels, noise 4": (110.0, 130.0, 0.0, 4.0),
}
EVEN = ("even light", "even light, light part")


if __name__ == "__main__":
    folder, width, runs = read_words(SHARED / "image", WIDTH, 5)
    inputs = [(name, partial(draw, *scene, width), runs) for name, scene in SCENES.items()]
    for path in find_files(folder, ENDS):
        inputs.append((path.relative_to(folder).as_posix(), partial(load_view, path), runs))
    sys.exit(run(Scenario(COLUMNS, inputs, measure)))
