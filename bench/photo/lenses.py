"""Photos of a part on camgen's sheet without a calibration file: errors by lens and by height.

    python -m bench.photo.lenses [PHOTOS, 8] [FIRST, 0] [SET ...]    of each set, from seed FIRST on

The rule, made before the work on it. A photo of 2400 x 1718 px shows the whole A4 sheet; a plate of
70 x 45 mm with round corners and a hole lies in its free area, turned at random. Photo k of n is
tilted by 35 (k + 1/2) / n deg in a random direction. At random: f from 0.75 to 1.3 times the width;
the principal point within 1 % of the width of the middle; k1 as the set says, k2 from 0.1 to
0.5 |k1|, p1 and p2 up to 3e-4 (none without a lens); the camera up to 1.25 times as far as it must
be; light and noise as in bench.render.photos. Walls are as bright as the paper. The job names the
sheet and the height, and no camera.file.

The error is the distance of lines and arcs found from the true outline, at places 0.1 mm apart.
Goals: 0.02 mm without a lens and with a mild one, 0.03 mm with a strong one, 0.1 mm for a height of
5 mm; no flat photo is refused, and none with a height that is tilted by 20 deg or more; no outline
is 0.02 mm beyond its stated bound.

The second table has the same photos, with a mild lens, for a job that names no height: of flat
parts, and of parts that are 3 to 10 mm thick. Their walls are drawn, 0.15 to 0.5 brighter than the
upper face of 0.2. Goals: a warning of a side wall for 6 of 10 thick parts, its height within 25 %
of the true one in the median, and for no more than 1 of 10 flat parts. From straight above, walls
are hidden.
"""

from __future__ import annotations

import re
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

import camgen
from bench.render.board import markers
from bench.render.optics import Lens, Shot, aim_camera, photo_from_work
from bench.render.scene import Layer, Scene, render, write_photo
from bench.render.shapes import Loop, pieces, to_loops
from bench.support.runner import Cells, Scenario, read_words, run, select, verdict
from camgen.model.job import CameraTable, Job
from camgen.read import read
from camgen.vision.boards.sheet import DICTIONARY, make_sheet

SIZE = (2400, 1718)
PAPER = make_sheet("A4")
COLUMNS = (
    "set | photos | refused | lens found | corners, rms mm {:.4f} | outline off: max mm {:.3f} "
    "| rms mm {:.3f} | beyond the bound | goal, mm {:.2f} | reached"
)
#: Room for the part's corners in the free area, mm, and for the sheet in the photo, px.
ROOM, RIM = 44.0, 30.0


class Kind(NamedTuple):
    """A set of photos.

    k1: the least and the largest k1.
    height: the height of the part, mm.
    goal: the limit of the largest error, mm.
    """

    k1: tuple[float, float]
    height: float
    goal: float


SETS = {
    "no lens": Kind((0.0, 0.0), 0.0, 0.02),
    "mild lens": Kind((-0.06, -0.01), 0.0, 0.02),
    "strong lens": Kind((-0.25, -0.12), 0.0, 0.03),
    "no lens, 5 mm": Kind((0.0, 0.0), 5.0, 0.1),
    "mild lens, 5 mm": Kind((-0.06, -0.01), 5.0, 0.1),
    "strong lens, 5 mm": Kind((-0.25, -0.12), 5.0, 0.1),
}


class Photo(NamedTuple):
    """A photo to be made.

    scene: the sheet and the part.
    shot: the camera.
    part: the outlines of the part in the plane of its upper face, mm.
    tilt: the angle between the optical axis and the normal of the sheet, deg.
    """

    scene: Scene
    shot: Shot
    part: tuple[Loop, ...]
    tilt: float


def draw(name: str, k: int, count: int, first: int) -> Photo:
    """Photo ``k`` of ``count`` of a set."""
    kind = SETS[name]
    rng = np.random.default_rng([first + k, list(SETS).index(name)])
    width, height = SIZE
    focal = width * rng.uniform(0.75, 1.3)
    cu, cv = (np.array(SIZE) - 1) / 2 + rng.uniform(-0.01, 0.01, 2) * width
    k1 = rng.uniform(*kind.k1)
    others = (-k1 * rng.uniform(0.1, 0.5), *rng.uniform(-3e-4, 3e-4, 2))
    bent = (k1, *others, 0.0) if k1 else (0.0,) * 5
    lens = Lens(np.array([[focal, 0, cu], [0, focal, cv], [0, 0, 1]]), bent, SIZE)
    tilt, about, roll = 35 * (k + 0.5) / count, rng.uniform(0, 360), rng.normal(0, 10)
    farther, turn = rng.uniform(1, 1.25), rng.uniform(0, 2 * np.pi)
    free = complex(*PAPER.free)
    at = complex(
        rng.uniform(ROOM, free.real - ROOM),
        rng.uniform(min(ROOM, free.imag / 2), max(free.imag - ROOM, free.imag / 2)),
    )
    part = tuple(loop.moved(turn, at) for loop in plate())
    light = {"gradient": tuple(rng.uniform(-0.3, 0.3, 2)), "vignetting": rng.uniform(0, 0.2)}
    scale = 250 / width
    while True:
        pose = aim_camera(lens, free / 2, complex(cu, cv), scale, (tilt, about, roll))
        shot = Shot(lens, *pose, exposure=0.85, read=1.6, shot=0.01, seed=first + k, **light)
        x, y = PAPER.corners.reshape(-1, 2).T
        u, v = photo_from_work(shot, x, y, -kind.height)
        if min(u.min(), v.min(), width - u.max(), height - v.max()) > RIM:
            break
        scale *= 1.02
    pose = aim_camera(lens, free / 2, complex(cu, cv), scale * farther, (tilt, about, roll))
    shot = Shot(lens, *pose, exposure=0.85, read=1.6, shot=0.01, seed=first + k, **light)
    x, y = PAPER.origin
    page = (-x, -y, PAPER.page[0] - x, PAPER.page[1] - y)
    paper = markers(page, PAPER.ids, PAPER.corners, DICTIONARY, -kind.height)
    return Photo(Scene(0.45, (*paper, Layer(part, 0.2, 0.02)), 0.02, 1), shot, part, tilt)


def thick(photo: Photo, seed: int) -> tuple[Photo, float]:
    """The photo with a part that stands on the sheet, and its height, mm: slices of 0.1 mm."""
    rng = np.random.default_rng([seed, 99])
    height, wall = rng.uniform(3, 10), 0.2 + rng.uniform(0.15, 0.5)
    *paper, top = photo.scene.layers
    slices = [replace(top, colour=wall, z=z) for z in np.arange(0, height, 0.1).tolist()]
    layers = (*paper, *slices, replace(top, z=height))
    return photo._replace(scene=replace(photo.scene, layers=layers)), height


def plate() -> tuple[Loop, ...]:
    """70 x 45 mm with corners of 8 mm and a hole of 20 mm beside its middle, about 0."""
    w, h, r, quarter = 35.0, 22.5, 8.0, np.tan(np.pi / 8)
    corners = [w - r - 1j * h, w - 1j * (h - r), w + 1j * (h - r), w - r + 1j * h]
    corners += [-z for z in corners]
    hole = Loop(12 + 10 * np.array([1, -1j, -1, 1j]), np.full(4, -quarter))
    return Loop(np.array(corners), np.array([quarter, 0, quarter, 0] * 2)), hole


def read_photo(folder: Path, photo: Photo, height: float) -> camgen.Part:
    """The part as camgen reads the photo, with the sheet alone."""
    file = folder / "photo.png"
    write_photo(file, render(photo.scene, photo.shot))
    return read(file, Job(camera=CameraTable(markers="A4", height=height)))


def errors(part: camgen.Part, truth: tuple[Loop, ...]) -> np.ndarray:
    """Distances (N,) of the outlines found from the true ones, mm."""
    places = pieces(to_loops(part.contours)).walk_evenly(0.1)
    return pieces(truth).distance(places)


def measure(name: str, count: int, first: int) -> Iterator[Cells]:
    """The row of a set."""
    kind, refused, wrongly, lenses, beyond = SETS[name], 0, 0, 0, 0
    all_distances, rms = [], []
    with tempfile.TemporaryDirectory() as folder:
        for k in range(count):
            photo = draw(name, k, count, first)
            try:
                part = read_photo(Path(folder), photo, kind.height)
            except camgen.CamgenError as error:
                refused += 1
                wrongly += not kind.height or photo.tilt >= 20
                print(f"{name} {first + k}, {photo.tilt:.0f} deg: {error}", file=sys.stderr)
                continue
            distances = errors(part, photo.part)
            notes = "\n".join(f"{note.what} {note.why}" for note in part.notes)
            bound = float(re.search(r"placed to within ([\d.]+) mm", notes)[1])
            all_distances.append(distances)
            rms.append(float(re.search(r"work plane from .* rms ([\d.]+) mm", notes)[1]))
            lenses += "k1" in notes
            beyond += distances.max() > bound + 0.02
            shown = f"{photo.tilt:.0f} deg, off {distances.max():.3f} mm, bound {bound:.3f} mm"
            print(f"{name} {first + k}, {shown}, {len(part.contours)} outlines", file=sys.stderr)
    whole = np.concatenate(all_distances) if all_distances else np.array([np.inf])
    good = whole.max() <= kind.goal and not wrongly and not beyond
    corners = float(np.median(rms)) if rms else None
    figures = corners, float(whole.max()), float(np.sqrt(np.mean(whole**2)))
    yield name, count, refused, lenses, *figures, beyond, kind.goal, verdict(good)


def count_walls(name: str, count: int, first: int) -> Iterator[Cells]:
    """The row of flat or of thick parts."""
    warned, refused, ratios = 0, 0, []
    with tempfile.TemporaryDirectory() as folder:
        for k in range(count):
            photo, height = draw("mild lens", k, count, first), 0.0
            if name == "thick":
                photo, height = thick(photo, first + k)
            try:
                part = read_photo(Path(folder), photo, 0.0)
            except camgen.CamgenError as error:
                refused += 1
                print(f"{name} {first + k}, {photo.tilt:.0f} deg: {error}", file=sys.stderr)
                continue
            walls = [note for note in part.notes if "side wall" in note.what]
            warned += bool(walls)
            shown = f"{photo.tilt:.0f} deg, {height:.1f} mm: {walls[0] if walls else ''}"
            print(f"{name} {first + k}, {shown}", file=sys.stderr)
            if walls and height:
                ratios.append(float(re.search(r"([\d.]+) mm", walls[0].what)[1]) / height - 1)
    error = 100 * float(np.median(np.abs(ratios))) if ratios else None
    enough = warned >= 0.6 * count and error is not None and error <= 25
    good = enough if name == "thick" else warned <= 0.1 * count
    yield name, count, refused, warned, error, verdict(good)


if __name__ == "__main__":
    number, start, *names = read_words(8, 0)
    sets = Scenario(COLUMNS, [(name, number, start) for name in select(SETS, names)], measure)
    words = "parts | photos | refused | warned of a side wall | height off, median % {:.0f} | goal"
    parts = [(name, number, start) for name in select(("flat", "thick"), names)]
    sys.exit(run(sets, Scenario(words, parts, count_walls)))
