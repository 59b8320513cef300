"""Rendered photos with their job files and their truth, drawn at random from a number."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bench.render.board import markers
from bench.render.optics import Lens, Shot, aim_camera, mm_per_px, photo_from_work
from bench.render.parts import NAMED, random_part
from bench.render.scene import Layer, Scene, render, write_photo
from bench.render.shapes import Loop
from camgen.vision.boards.sheet import DICTIONARY, Sheet, make_sheet

#: Pixels by megapixels: the camera of the paper, with pixels of 1.67 um at a focal length of
#: 8.5 mm, and the same view with a tenth of the pixels.
SIZES = {10: (3840, 2748), 1: (1200, 859)}
FOCAL, SCALE = 8.5 / 0.00167, 0.143
INCH = 25.4
#: Sources of the work plane in a job, in turns.
PLANES = ("pairs", "markers", "pose")


@dataclass(frozen=True, eq=False)
class Photo:
    """A photo to be made.

    plane: source of the work plane in the job, one of `PLANES`.
    tool: diameter of the tool, mm.
    tilt: angle between optical axis and bench normal, deg.
    height: height of the part's top above the markers, mm.
    empty: whether the job uses a photo of the empty bench.
    suffix: suffix of the file.
    """

    name: str
    loops: tuple[Loop, ...]
    scene: Scene
    shot: Shot
    plane: str
    tool: float
    tilt: float
    height: float = 0.0
    empty: bool = False
    suffix: str = ".png"


def photos(count: int, megapixels: int) -> list[Photo]:
    """``count`` photos of one camera: the named parts first, then random ones."""
    return [_photo(k, megapixels) for k in range(count)]


def of_paper(count: int, megapixels: int) -> list[Photo]:
    """``count`` photos of the part of the PIST paper, with different cameras, places and light."""
    return [_photo(k, megapixels, "paper") for k in range(count)]


def hard() -> list[Photo]:
    """Large photos that depart from the others in one thing.

    Their names: sRGB coding (srgb); colour and JPEG (jpeg); little light (dim); a part that is
    little darker than a bench with strong grain, with a photo of the empty bench (faint).
    """
    srgb, jpeg, dim, faint = (_photo(k, 10) for k in (6, 8, 10, 12))
    blue = replace(jpeg.scene.layers[-1], colour=(0.35, 0.2, 0.1))
    colours = replace(jpeg.scene, bench=(0.30, 0.52, 0.62), layers=(*jpeg.scene.layers[:-1], blue))
    grained = Scene(0.6, (Layer(faint.loops, 0.42, 0.02),), 0.05)
    return [
        replace(srgb, name="srgb", shot=replace(srgb.shot, coding="srgb")),
        replace(jpeg, name="jpeg", scene=colours, suffix=".jpg"),
        replace(dim, name="dim", shot=replace(dim.shot, exposure=0.25, gradient=(0.5, 0.2))),
        replace(faint, name="faint", scene=grained, empty=True),
    ]


def _photo(k: int, megapixels: int, part: str = "") -> Photo:
    """The photo of a number. part: name of its part; empty for that of the number."""
    rng = np.random.default_rng([k, megapixels])
    name = part or (list(NAMED)[k] if k < len(NAMED) else f"random{k}")
    loops = NAMED[name]() if name in NAMED else random_part(k)
    plane = PLANES[k % len(PLANES)]
    on_sheet = plane == "markers"
    lens = _lens(megapixels, rng)
    height = float(rng.choice([0.0, 1.5])) if on_sheet else 0.0
    paper = make_sheet("A4")
    middle = complex(*paper.free) / 2 if on_sheet else complex(*rng.uniform(20, 200, 2))
    turn = rng.uniform(0, 2 * np.pi)
    placed = tuple(loop.moved(turn, middle) for loop in loops)
    room = np.array(lens.size) * ((0.12, 0.1) if on_sheet else (0.3, 0.25))
    pixel = complex(*(np.array(lens.size) / 2 + rng.uniform(-1, 1, 2) * room))
    tilt = 18 * rng.uniform() ** 0.5
    about, roll = rng.uniform((0, -180), (360, 180))
    scale = SCALE * SIZES[10][0] / lens.size[0]
    pose = aim_camera(lens, middle, pixel, scale, (tilt, about, roll))
    light = {"gradient": tuple(rng.uniform(-0.3, 0.3, 2)), "vignetting": rng.uniform(0, 0.2)}
    shot = Shot(lens, *pose, blur=0.7, exposure=0.85, **light, read=1.6, shot=0.01, seed=k)
    scene = _scene(placed, paper if on_sheet else None, height, rng)
    tool = 3 / 8 * INCH if name == "paper" else 6.0
    number = f"{k}-" if part else ""
    return Photo(f"{name}-{number}{megapixels}mp", placed, scene, shot, plane, tool, tilt, height)


def _lens(megapixels: int, rng: np.random.Generator) -> Lens:
    width, height = SIZES[megapixels]
    focal = FOCAL * width / SIZES[10][0]
    cu, cv = np.array([width - 1, height - 1]) / 2 + rng.uniform(-0.01, 0.01, 2) * width
    matrix = np.array([[focal, 0, cu], [0, focal * rng.uniform(0.998, 1.002), cv], [0, 0, 1]])
    k1, k2, k3 = rng.uniform((-0.16, 0.0, -0.05), (0.06, 0.12, 0.05))
    p1, p2 = rng.uniform(-1e-3, 1e-3, 2)
    return Lens(matrix, (k1, k2, p1, p2, k3), (width, height))


def _scene(
    part: tuple[Loop, ...], paper: Sheet | None, height: float, rng: np.random.Generator
) -> Scene:
    """A dark part on a light bench or the reverse; on a sheet of white paper always a dark one."""
    dark, light = rng.uniform(0.12, 0.3), rng.uniform(0.6, 0.8)
    turned = paper is None and rng.random() < 0.5
    top = Layer(part, light if turned else dark, texture=0.02)
    if paper is None:
        return Scene(dark if turned else light, (top,), texture=0.02, grain_seed=1)
    x, y = paper.origin
    page = (-x, -y, paper.page[0] - x, paper.page[1] - y)
    sheet = markers(page, paper.ids, paper.corners, DICTIONARY, -height)
    return Scene(0.45, (*sheet, top), texture=0.02, grain_seed=1)


# -- files


def write(folder: Path, photo: Photo) -> None:
    """Writes NAME.png, its job NAME.toml, its camera NAME.yaml and the truth NAME.json.

    The photo of an empty bench is NAME-empty.png.
    """
    write_photo(folder / f"{photo.name}{photo.suffix}", render(photo.scene, photo.shot))
    if photo.empty:
        # A little less light than with the part.
        bench = replace(photo.scene, layers=photo.scene.layers[:-1])
        shot = photo.shot
        other = replace(shot, seed=shot.seed + 1000, exposure=shot.exposure * 0.95)
        write_photo(folder / f"{photo.name}-empty{photo.suffix}", render(bench, other))
    (folder / f"{photo.name}.yaml").write_text(camera_info(photo.shot.lens))
    (folder / f"{photo.name}.toml").write_text(_job(photo))
    loops = []
    for loop in photo.loops:
        points = np.column_stack([loop.points.real, loop.points.imag])
        loops.append({"points": points.tolist(), "bulges": loop.bulges.tolist()})
    truth = {
        "file": f"{photo.name}{photo.suffix}",
        "tilt": photo.tilt,
        "plane": photo.plane,
        "tool": photo.tool,
        "mm_per_px": mm_per_px(photo.shot, complex(photo.loops[0].points.mean())),
        "loops": loops,
    }
    (folder / f"{photo.name}.json").write_text(json.dumps(truth, indent=1))


def camera_info(lens: Lens) -> str:
    """The lens as ROS' camera_info."""
    width, height = lens.size
    values = {
        "camera_matrix": (3, 3, lens.matrix.ravel().tolist()),
        "distortion_coefficients": (1, 5, lens.distortion),
    }
    lines = [
        f"image_width: {width}",
        f"image_height: {height}",
        "camera_name: rendered",
        "distortion_model: plumb_bob",
    ]
    for key, (rows, columns, data) in values.items():
        numbers = ", ".join(repr(float(value)) for value in data)
        lines += [f"{key}:", f"  rows: {rows}", f"  cols: {columns}", f"  data: [{numbers}]"]
    return "\n".join(lines) + "\n"


def _job(photo: Photo) -> str:
    lines = ["[camera]", f'file = "{photo.name}.yaml"', *_plane(photo)]
    if photo.empty:
        lines += [
            "[image]",
            'mask = "background"',
            f'background = "{photo.name}-empty{photo.suffix}"',
        ]
    lines += ["[tool]", f"diameter = {photo.tool!r}", "[process]", "feed = 5.0", "force = 2.0"]
    return "\n".join([*lines, "[post]", 'force = "template"', ""])


def _plane(photo: Photo) -> list[str]:
    shot = photo.shot
    if photo.plane == "markers":
        return ['markers = "A4"', f"height = {photo.height!r}"]
    if photo.plane == "pose":
        r = shot.rotation
        angles = np.arctan2(r[2, 1], r[2, 2]), -np.arcsin(r[2, 0]), np.arctan2(r[1, 0], r[0, 0])
        return [f"plane_from = {[*shot.origin.tolist(), *np.degrees(angles).tolist()]}"]
    middle = photo.loops[0].points.mean()
    grid = middle + np.add.outer([-70, 0, 70], [-60j, 60j]).ravel()
    u, v = photo_from_work(shot, grid.real, grid.imag)
    # As exact as a user could take them from a pattern on the bench: a thousandth of a pixel.
    px = np.column_stack([u, v]).round(3).tolist()
    return [f"points_px = {px}", f"points_mm = {np.column_stack([grid.real, grid.imag]).tolist()}"]
