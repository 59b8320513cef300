"""Outlines and their lines and arcs against drawn parts: python -m bench.photo.outlines [PARTS, 5] [RUNS, 7] [SHAPE]

Each part, or that named SHAPE, lies PARTS times at random in a grey picture, 60 beside it and 180 on it: the share of
each pixel that the part covers, blurred by a Gaussian, with noise, in whole grey values, and cut half-way for the mask.
All in pixels.

- `pixels`: the centres of the part's outermost pixels, as cv2.findContours gives them; `points`:
  camgen.vision.outline; `lines and arcs`: camgen.vision.lines_arcs, points 0.25 px apart on them, and for the largest
  error the drawing against them too.
- What is within 4 px of a sharp corner is left out, and told by the distance from drawn to found corners.
- `pieces`: how many lines and arcs were found, whole circles being two, and how many were drawn.

Then the best seconds of RUNS at 10.5 megapixels (0: none), beside bare cv2.findContours.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import NamedTuple

import cv2
import numpy as np
import shapely

from bench.machine import machine
from camgen.geometry.segments import flatten, from_contours
from camgen.vision.lines_arcs.contours import primitives
from camgen.vision.outline import outlines
from tests.support.outline_pictures import Drawn, disc, drawn, gear, mask_of, picture, plate

VIEW = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
BLURS, NOISES = (0.5, 0.7, 1.0, 1.5), (0.0, 2.0, 4.0)
REACH = 4.0


class Shape(NamedTuple):
    """A part, the side of its picture, and how many lines and arcs it has."""

    part: Drawn
    side: int
    pieces: int


SHAPES = {
    "disc r 5": Shape(disc(5), 40, 2),
    "disc r 50": Shape(disc(50), 130, 2),
    "rounded, r 3 to 8": Shape(
        drawn([(-40, -30, 0), (40, -30, 4), (40, 30, 8), (-40, 30, 3)]), 130, 7
    ),
    "plate": Shape(plate(), 560, 12 + 4 + 2 * 4),
    "gear, lands 11 px": Shape(gear(30, 150, 190), 410, 120),
    "gear, lands 8 px": Shape(gear(18, 60, 80), 190, 72),
}


def main(count: int, runs: int, names: list[str]) -> None:
    print(f"{machine()}, OpenCV {cv2.__version__}, {count} parts per row\n")
    print(
        "| part | blur | noise | pixels max | rms | points max | rms | lines and arcs max | rms ",
        end="",
    )
    print("| corners max | rms | pieces |\n|---|---|---|---|---|---|---|---|---|---|---|---|")
    for name in names or SHAPES:
        for blur in BLURS:
            for noise in NOISES:
                print(
                    f"| {name} | {blur:g} | {noise:g} | {judged(SHAPES[name], blur, noise, count)} |",
                    flush=True,
                )
    if runs:
        speed(runs)


def judged(shape: Shape, blur: float, noise: float, count: int) -> str:
    raw, points, pieces, back, corners = ([] for _ in range(5))
    found = 0
    for seed in range(count):
        rng = np.random.default_rng(seed)
        middle = complex(*(shape.side / 2 + rng.uniform(-0.5, 0.5, 2)))
        part = shape.part.placed(rng.uniform(0, 2 * np.pi), middle)
        grey = picture(part, shape.side, shape.side, blur, noise)
        mask = mask_of(grey)
        loops = outlines(grey, mask)[0]
        contours = primitives(loops, VIEW)[0]
        found += sum(len(c.points) for c in contours)
        dense = walked(contours)
        chain = np.concatenate(cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)[0])[
            :, 0
        ].astype(float)
        raw.append(away(part, chain @ np.array([1, 1j])))
        points.append(
            away(part, np.concatenate([loop.points for loop in loops]) @ np.array([1, 1j]))
        )
        pieces.append(away(part, dense))
        drawing = np.concatenate(part.loops)
        drawing = drawing[~part.near_corner(drawing, REACH)]
        nearest = shapely.STRtree(shapely.points(dense.real, dense.imag)).nearest(
            shapely.points(drawing.real, drawing.imag)
        )
        back.append(np.abs(dense[nearest] - drawing))
        corner = np.concatenate([c.points for c in contours]) @ np.array([1, -1j])
        corners.append(np.abs(part.sharp[:, None] - corner).min(axis=1, initial=np.inf))
    columns = [np.concatenate(column) for column in (raw, points, pieces, corners)]
    # A point on the drawing is at most an eighth of a pixel along from one on the pieces.
    most = np.sqrt(max(np.concatenate(back).max(initial=0.0) ** 2 - 0.125**2, 0.0))
    told = [f"{np.abs(c).max(initial=0.0):.3f} | {rms(c):.4f}" for c in columns]
    told[2] = f"{max(np.abs(columns[2]).max(), most):.3f} | {rms(columns[2]):.4f}"
    return " | ".join([*told, f"{found / count:.1f} of {shape.pieces}"])


def away(part: Drawn, places: np.ndarray) -> np.ndarray:
    return part.gaps(places[~part.near_corner(places, REACH)])


def rms(values: np.ndarray) -> float:
    return float(np.sqrt((values**2).mean())) if len(values) else 0.0


def walked(contours: tuple) -> np.ndarray:
    """Places on the contours, at most 0.25 px apart, u + i v."""
    points, owner = flatten(from_contours(contours), 1e-4)
    found = []
    for k in range(len(contours)):
        a = points[owner == k] @ np.array([1, -1j])
        b = np.roll(a, -1)
        count = np.maximum(np.ceil(np.abs(b - a) / 0.25), 1).astype(int)
        place = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        found.append(np.repeat(a, count) + np.repeat((b - a) / count, count) * place)
    return np.concatenate(found)


def speed(runs: int) -> None:
    """The plate, six times as large, alone and with many holes of 10 px radius, in a view of 3840 x 2748."""
    loops = [loop * 6 + (1920 + 1374j) for loop in plate().loops]
    hole = 10 * np.exp(2j * np.pi * np.arange(720) / 720)
    grid = [hole + complex(u, v) for u in range(2360, 2840, 40) for v in range(1640, 1960, 40)]
    print(
        "\n| 10.5 megapixels | points | cv2.findContours s | outlines s | primitives s |\n|---|---|---|---|---|"
    )
    for name, more in (("plate", []), ("plate and 96 holes", grid)):
        grey = picture(Drawn([*loops, *more], np.zeros(0, complex)), 2748, 3840, 0.7, 2.0)
        mask = mask_of(grey)
        found = outlines(grey, mask)[0]
        bare = best(
            runs, lambda mask=mask: cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
        )
        first = best(runs, lambda grey=grey, mask=mask: outlines(grey, mask))
        second = best(runs, lambda found=found: primitives(found, VIEW))
        count = sum(len(loop.points) for loop in found)
        print(f"| {name} | {count} | {bare:.3f} | {first:.3f} | {second:.3f} |", flush=True)


def best(runs: int, call: Callable[[], object]) -> float:
    seconds = []
    for _ in range(runs):
        begun = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - begun)
    return min(seconds)


if __name__ == "__main__":
    parts, rounds = (int(word) for word in (*sys.argv[1:3], *("5", "7")[len(sys.argv[1:3]) :]))
    main(parts, rounds, sys.argv[3:])
