"""Photos of flat things whose truth is known: a judge of the vision part without code of camgen.

A photo is a sum over its layers (bench, paper, ink, part; the later ones above), each seen by its
share of a pixel (optics.py); then light, grain, noise and coding. The grain is not blurred: it is
smooth from the start.

All things are flat. Walls of a thick part are not drawn; a layer may lie lower than the work plane
by its z.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from bench.render.optics import Shot, share, work_from_photo
from bench.render.shapes import Loop

#: Grey or blue, green, red: the part of the light that comes back, 0 to 1.
Colour = float | tuple[float, float, float]

#: Grain repeats after a number of cells, a power of 2; size of a cell, mm.
_TILE, _CELL = 2048, 0.1
#: Distance between pixels at which the lens is inverted for the grain.
_GRID = 8


@dataclass(frozen=True, eq=False)
class Layer:
    """Things of one colour.

    texture: relative strength of its grain.
    z: height above the work plane, mm.
    """

    loops: tuple[Loop, ...]
    colour: Colour
    texture: float = 0.0
    z: float = 0.0


@dataclass(frozen=True, eq=False)
class Scene:
    """A bench without end, and the layers on it, from below to above."""

    bench: Colour
    layers: tuple[Layer, ...] = ()
    texture: float = 0.0
    grain_seed: int = 0


def render(scene: Scene, shot: Shot) -> np.ndarray:
    """The photo, uint8: (H, W), or (H, W, 3) blue, green, red if anything has a colour.

    The same input gives the same photo.
    """
    width, height = shot.lens.size
    colours = [np.atleast_1d(np.float32(scene.bench))]
    colours += [np.atleast_1d(np.float32(layer.colour)) for layer in scene.layers]
    depth = max(map(len, colours))
    grained = scene.texture or any(layer.texture for layer in scene.layers)
    grain = _grain(shot, scene.grain_seed) if grained else np.zeros((height, width), np.float32)
    light = np.empty((height, width, depth), np.float32)
    light[:] = colours[0] * (1 + np.float32(scene.texture) * grain[:, :, None])
    for layer, colour in zip(scene.layers, colours[1:], strict=True):
        window, covered = share(layer.loops, shot, layer.z)
        layer_light = colour * (1 + np.float32(layer.texture) * grain[window][:, :, None])
        light[window] += covered.astype(np.float32)[:, :, None] * (layer_light - light[window])
    if shot.motion:
        light = _smeared(light, shot.motion)
    light *= _lit(shot)[:, :, None]
    return _sensed(light, shot).reshape((height, width, 3) if depth == 3 else (height, width))


def _smeared(light: np.ndarray, motion: complex) -> np.ndarray:
    """The mean of the light over a straight motion of the camera, px, half of it to each side."""
    import cv2  # noqa: PLC0415 (only what is smeared needs it)

    half = int(np.ceil(abs(motion) / 2)) + 1
    place = motion * (np.linspace(0, 1, 257) - 0.5)
    # A place between pixels counts for the four around it.
    across, down = (
        np.maximum(1 - np.abs(part[:, None] - np.arange(-half, half + 1)), 0)
        for part in (place.real, place.imag)
    )
    kernel = np.einsum("nv,nu->vu", down, across) / len(place)
    smeared = cv2.filter2D(light, -1, kernel, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(smeared).reshape(light.shape)


def _lit(shot: Shot) -> np.ndarray:
    """Brightness of the light in each pixel."""
    width, height = shot.lens.size
    x, y = (np.linspace(-0.5, 0.5, n, dtype=np.float32) for n in (width, height))
    square = (x**2 * width**2 + (y**2 * height**2)[:, None]) / (0.25 * (width**2 + height**2))
    slope = 1 + shot.gradient[0] * x + (shot.gradient[1] * y)[:, None]
    return (shot.exposure * slope * (1 - shot.vignetting * square)).astype(np.float32)


def _grain(shot: Shot, seed: int) -> np.ndarray:
    """Grain in each pixel, mean 0, deviation 1: streaks along x that are fixed to the bench."""
    width, height = shot.lens.size
    # Between the pixels at which the lens is inverted the grain may lie 0.01 px off.
    v, u = np.mgrid[: height + _GRID : _GRID, : width + _GRID : _GRID].astype(float)
    x, y = work_from_photo(shot, u.ravel(), v.ravel())
    row, column = (_filled(w.reshape(u.shape) / _CELL, height, width) for w in (y, x))
    return _tile(seed)[row.astype(np.int32) & (_TILE - 1), column.astype(np.int32) & (_TILE - 1)]


def _filled(coarse: np.ndarray, height: int, width: int) -> np.ndarray:
    part = (np.arange(_GRID, dtype=np.float32) / _GRID)[:, None]
    coarse = coarse.astype(np.float32)
    rows = (coarse[:-1, None] * (1 - part) + coarse[1:, None] * part).reshape(-1, coarse.shape[1])
    part = part.ravel()
    whole = (rows[:, :-1, None] * (1 - part) + rows[:, 1:, None] * part).reshape(len(rows), -1)
    return whole[:height, :width]


@lru_cache(maxsize=2)
def _tile(seed: int) -> np.ndarray:
    """A tile of 205 mm that repeats without a seam.

    It is white noise, smoothed by 0.2 mm across and 2 mm along.
    """
    noise = np.fft.rfft2(np.random.default_rng(seed).standard_normal((_TILE, _TILE)))
    along = np.fft.rfftfreq(_TILE) * 2.0 / _CELL
    across = np.fft.fftfreq(_TILE)[:, None] * 0.2 / _CELL
    smooth = np.fft.irfft2(noise * np.exp(-2 * np.pi**2 * (along**2 + across**2)))
    return (smooth / smooth.std()).astype(np.float32)


def _sensed(light: np.ndarray, shot: Shot) -> np.ndarray:
    """Noise, coding and rounding to 8 bits. Changes ``light``."""
    if shot.read or shot.shot:
        noise = np.random.default_rng(shot.seed).standard_normal(light.shape, dtype=np.float32)
        noise *= np.sqrt((shot.read / 255) ** 2 + shot.shot * np.maximum(light, 0) / 255)
        light += noise
    np.clip(light, 0, 1, out=light)
    if shot.coding == "srgb":
        curve = 1.055 * light ** np.float32(1 / 2.4) - 0.055
        light = np.where(light <= 0.0031308, 12.92 * light, curve)
    elif shot.coding != "linear":
        raise ValueError(f"no coding {shot.coding!r}")
    return np.rint(light * 255).astype(np.uint8)


def write_photo(file: Path, photo: np.ndarray, quality: int = 95) -> None:
    """The photo as PNG or JPEG, as the suffix says; the same bytes every time."""
    import cv2  # noqa: PLC0415 (only what encodes needs it)

    options = [cv2.IMWRITE_PNG_COMPRESSION, 1]
    if file.suffix == ".jpg":
        options = [cv2.IMWRITE_JPEG_QUALITY, quality]
    done, data = cv2.imencode(file.suffix, photo, options)
    assert done, file
    file.write_bytes(data.tobytes())
