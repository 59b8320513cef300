"""Photos of parts with known burrs against their drawings: heights, burrs missed, false ones.

    python -m bench.photo.burrs [PHOTOS, 10] [BURRS, 6] [MEGAPIXELS, 10]

PHOTOS are taken of clean parts, and as many of parts with BURRS each. They are those of
bench.photo.photo (tilted camera, lens, grain, noise, 0.14 mm/px; 0.46 with MEGAPIXELS 1), read with
their jobs as by a user; the part lies and is turned at random. Burrs are 1.4 to 7 px high. Goals:
heights within 0.05 mm, or 0.35 px, none missed, and no false one.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

import camgen
from bench.render.burrs import Burr, add_burrs
from bench.render.optics import mm_per_px
from bench.render.parts import NAMED, random_part
from bench.render.photos import SIZES, Photo, photos, write
from bench.render.shapes import Loop
from bench.support.runner import Cells, Scenario, Table, fill, machine, read_words, verdict
from bench.support.timing import timed
from camgen.check.photo import Difference, Inspection, inspect_photo
from camgen.read import read
from camgen.read.job_file import load_job

GOAL_MM, GOAL_PX = 0.05, 0.35
COLUMNS = (
    "photo | mm/px {:.3f} | clean: false ones | burrs | found | height off: max mm {:.3f} "
    "| rms mm {:.3f} | length off: max mm {:.2f} | false ones | s {:.1f}"
)
TOTALS = "photos | burrs | missed | false ones | height off: max mm {:.3f} | rms mm {:.3f} | goal"
Loops = tuple[Loop, ...]
#: Burrs with the differences that show them, and all other differences.
Matches = tuple[list[tuple[Burr, Difference]], list[Difference]]


class Sums:
    """Sums over all photos.

    errors: errors of heights, mm.
    missed: burrs that are missed.
    false: differences where no burr is.
    """

    def __init__(self) -> None:
        self.errors: list[float] = []
        self.missed = self.false = 0


def measure(
    number: int, photo: Photo, count: int, megapixels: int, folder: Path, sums: Sums
) -> Iterator[Cells]:
    """The row of a photo."""
    drawn = draw_part(number)
    pixel = 0.143 * SIZES[10][0] / SIZES[megapixels][0]
    rng = np.random.default_rng([number, 7])
    burred, burrs = add_burrs(drawn, count, rng, 1.4 * pixel, 7 * pixel)
    clean = inspect(folder, photo, drawn, drawn).differences
    inspection, seconds = timed(partial(inspect, folder, photo, drawn, burred))
    pairs, others = match(burrs, inspection)
    heights = np.array([shown.height - abs(burr.height) for burr, shown in pairs])
    lengths = np.array([shown.length - burr.width for burr, shown in pairs])
    sums.errors += heights.tolist()
    sums.missed += len(burrs) - len(pairs)
    sums.false += len(clean) + len(others)
    scale = mm_per_px(photo.shot, complex(photo.loops[0].points.mean()))
    errors = _find_largest(heights), _find_rms(heights), _find_largest(lengths)
    yield photo.name, scale, len(clean), len(burrs), len(pairs), *errors, len(others), seconds


def main(count: int, each: int, megapixels: int) -> int:
    """Prints the tables; 1 if a goal is missed."""
    print(machine())
    sums = Sums()
    with tempfile.TemporaryDirectory() as folder:
        shared = (each, megapixels, Path(folder), sums)
        inputs = [(*row, *shared) for row in enumerate(photos(count, megapixels))]
        fill(Scenario(COLUMNS, inputs, measure))
    largest, rms = _find_largest(np.array(sums.errors)), _find_rms(np.array(sums.errors))
    goal = GOAL_MM if megapixels == 10 else GOAL_PX * 0.46
    is_met = not (sums.missed or sums.false or largest > goal)
    table = Table(TOTALS)
    counts = len(sums.errors) + sums.missed, sums.missed, sums.false
    table.add(f"{count} clean, {count} burred", *counts, largest, rms, verdict(is_met))
    return int(table.missed > 0)


def draw_part(number: int) -> Loops:
    """The part of a photo as it is drawn."""
    return list(NAMED.values())[number]() if number < len(NAMED) else random_part(number)


def inspect(folder: Path, photo: Photo, drawn: Loops, burred: Loops) -> Inspection:
    """The inspection of a photo with another part in the same place, against the drawing."""
    # The motion that brings the first two points of the drawing to their places in the photo.
    old, new = drawn[0].points[:2], photo.loops[0].points[:2]
    turn = float(np.angle((new[1] - new[0]) / (old[1] - old[0])))
    shift = complex(new[0] - old[0] * np.exp(1j * turn))
    loops = tuple(loop.moved(turn, shift) for loop in burred)
    layers = (*photo.scene.layers[:-1], replace(photo.scene.layers[-1], loops=loops))
    write(folder, replace(photo, loops=loops, scene=replace(photo.scene, layers=layers)))
    seen = read(folder / f"{photo.name}.png", load_job(folder / f"{photo.name}.toml"))
    return inspect_photo(seen, make_drawing(drawn), camgen.Job())


def make_drawing(loops: Sequence[Loop]) -> camgen.Part:
    """The loops as a part that was read."""
    contours = []
    for k, loop in enumerate(loops, 1):
        points = np.column_stack([loop.points.real, loop.points.imag])
        contours.append(camgen.Contour(points, loop.bulges, True, "0", f"c{k}"))
    return camgen.Part("part", "part.dxf", "mm", tuple(contours), ())


def match(burrs: Sequence[Burr], inspection: Inspection) -> Matches:
    """Burrs and differences in pairs.

    A part that looks the same from several sides is matched from the side that fits best.
    """
    turns = (0.0, *inspection.fit.rival_turns)
    return max((_match(burrs, inspection, turn) for turn in turns), key=lambda both: len(both[0]))


def _match(burrs: Sequence[Burr], inspection: Inspection, turn: float) -> Matches:
    left, pairs = list(inspection.differences), []
    for burr in burrs:
        for difference in left:
            distance = abs(complex(*difference.place) * np.exp(1j * turn) - burr.place)
            is_alike = difference.surplus == (burr.height > 0)
            if is_alike and distance < burr.width / 2 + 0.3:
                pairs.append((burr, difference))
                left.remove(difference)
                break
    return pairs, left


def _find_largest(values: np.ndarray) -> float:
    return float(np.abs(values).max(initial=0.0))


def _find_rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


if __name__ == "__main__":
    sys.exit(main(*read_words(10, 6, 10)))
