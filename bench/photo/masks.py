"""Masks of real pictures: python -m bench.photo.masks [FOLDER with pictures] [WIDTH, 3840] [RUNS, 5]

What `mask = "auto"` makes of each picture at 0.1 mm/px (they have no scale), beside the time of the two OpenCV calls
it stands for (Otsu's threshold and the connected components with their statistics), and the same for photos drawn
here, WIDTH px wide (10.5 megapixels). Prints tables for docs/benchmarks.md; exits with 1 where a goal is missed.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from bench.machine import machine
from camgen.model.errors import CamgenError
from camgen.read.files import Files
from camgen.vision.image import load
from camgen.vision.mask.part_mask import Mask, part_mask
from camgen.vision.to_scale import ScaledView, already_to_scale

ENDS = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp"}
GOAL = 1.3
#: px
WIDTH = 3840


def seconds(call: Callable[[], object], runs: int) -> float:
    """The best of so many, after one to warm up."""
    call()
    best = np.inf
    for _ in range(runs):
        start = time.perf_counter()
        call()
        best = min(best, time.perf_counter() - start)
    return best


def bare(pixels: np.ndarray) -> None:
    """What the mask step cannot do with less of, if nobody asks whether it is right."""
    grey = pixels if pixels.ndim == 2 else cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
    binary = cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY_INV | cv2.THRESH_OTSU)[1]
    cv2.connectedComponentsWithStats(binary)


def told(mask: Mask) -> str:
    """The cells of a row that say what was found."""
    count, _, stats, _ = cv2.connectedComponentsWithStats(mask.pixels)
    holes = cv2.connectedComponents(cv2.bitwise_not(mask.pixels), connectivity=4)[0] - 2
    level = (
        f"{mask.level:.1f}"
        if isinstance(mask.level, float)
        else f"{mask.level.min():.0f} to {mask.level.max():.0f}"
    )
    return (
        f"{mask.method} | {level} | {int(stats[1:, 4].sum())} | {count - 1} | {holes} | {mask.why}"
    )


def row(name: str, view: ScaledView, runs: int) -> tuple[str, float]:
    """A row of the table, and how many times as long the mask took as the bare calls."""
    height, width = view.pixels.shape[:2]
    plain = seconds(lambda: bare(view.pixels), runs)
    try:
        mask = part_mask(view, name=name)
    except CamgenError as error:
        return f"| {name} | {width} x {height} | refused | | | | | {error} | | |", 0.0
    taken = seconds(lambda: part_mask(view, name=name), runs)
    times = taken / plain
    return (
        f"| {name} | {width} x {height} | {told(mask)} | {1000 * taken:.1f} | {times:.2f} |",
        times,
    )


def drawn(part: float, bench: float, slope: float, noise: float, width: int) -> ScaledView:
    """A disc with twelve holes, seen with so many pixels and a blur of 1 px; the light falls off by ``slope``."""
    size = width / WIDTH
    height = round(2748 * size)
    shape = np.zeros((height, width), np.float32)
    cv2.circle(shape, (round(1900 * size), round(1300 * size)), round(1000 * size), 1.0, -1)
    for angle in np.arange(12) * np.pi / 6:
        at = (
            round((1900 + 700 * np.cos(angle)) * size),
            round((1300 + 700 * np.sin(angle)) * size),
        )
        cv2.circle(shape, at, round(60 * size), 0.0, -1)
    light = np.linspace(1, 1 - slope, width, dtype=np.float32)
    grey = cv2.GaussianBlur((bench + (part - bench) * shape) * light, (0, 0), 1.0)
    grey += np.random.default_rng(7).normal(0, noise, grey.shape).astype(np.float32)
    pixels = np.clip(np.rint(grey), 0, 255).astype(np.uint8)
    return ScaledView(pixels, np.array([[0.143, 0, 0], [0, -0.143, 0.143 * height]]), 0.143)


def main() -> int:
    default = Path(__file__).parents[2].parent / "shared" / "data" / "image"
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else default
    width = int(sys.argv[2]) if len(sys.argv) > 2 else WIDTH
    runs = int(sys.argv[3]) if len(sys.argv) > 3 else 5
    head = "| picture | pixels | method | level | part px | parts | holes | why | ms | times the bare calls |"
    print(f"{machine()}\n\n{head}\n" + "|---" * 10 + "|")
    missed = False
    scenes = {
        "even light": (60.0, 200.0, 0.0, 2.0),
        "even light, light part": (200.0, 60.0, 0.0, 2.0),
        "light 2:1": (60.0, 200.0, 0.5, 2.0),
        "20 levels, noise 4": (110.0, 130.0, 0.0, 4.0),
    }
    for name, scene in scenes.items():
        line, times = row(name, drawn(*scene, width), runs)
        missed |= name.startswith("even") and times > GOAL
        print(line, flush=True)
    for path in sorted(path for path in folder.rglob("*") if path.suffix.lower() in ENDS):
        name = path.relative_to(folder).as_posix()
        try:
            view = already_to_scale(load(Files().read(path)), mm_per_px=0.1)
        except CamgenError as error:
            print(f"| {name} | | refused | | | | | {error} | | |")
            continue
        print(row(name, view, runs)[0], flush=True)
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
