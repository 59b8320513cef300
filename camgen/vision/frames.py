"""Frames of one view as one picture, and what is wrong with it: blur, light, movement.

The mean of n frames has the noise of one divided by the root of n, as far as the noise of frames is independent, and a
third of a grey value from rounding. Blur is measured at the strongest edges: a step of height h that a Gaussian has
smoothed rises by h / (sqrt(2 pi) sigma) a pixel where it is steepest.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.model.errors import InputError
from camgen.model.part import Note
from camgen.model.text import counted
from camgen.vision.image import Pixels

Float32 = NDArray[np.float32]

WHITE = 255
#: Blur beyond this (px) is told: the outlines of parts are fitted up to about three times of it, ever worse.
_BLURRED = 2.0
#: The mean is so many times as blurred as a single frame, and so many px more, where something moved.
_MOVED_TIMES, _MOVED_PX = 1.5, 0.3
#: This part of the picture at full white is told; and a picture whose brightest part stays below so much of white.
_GLARE, _BRIGHT_SHARE, _DIM = 0.01, 0.005, 0.3
#: Smoothing before the slope is taken, px, and what it and the central difference add to the variance of the blur.
_SMOOTH = 1.0
_ADDED = _SMOOTH**2 + 1 / 3
#: An edge: steepest within so many px, and with so much of the whole contrast, and grey values, within so many px.
_PEAK_PX, _STEP_PX, _STEP_SHARE, _STEP_GREY = 3, 16, 0.4, 12.0
#: A step that is wider than this, px, is a slope of light. Fewer edges tell nothing.
_WIDEST = 60.0
_FEWEST_EDGES = 20


class Shot(Struct, frozen=True, eq=False):
    """Several frames as one picture. pixels: their mean, (H, W, 3) uint8. frames: how many. clipped: the part of the
    pixels that is at full white in most frames. blur: of the first frame, px; smear: of the mean where movement
    blurred it most. None: no edges.
    """

    pixels: Pixels
    frames: int
    clipped: float
    blur: float | None
    smear: float | None


class Sum:
    """The frames so far."""

    def __init__(self) -> None:
        self.first: Pixels = np.zeros((0, 0, 3), dtype=np.uint8)
        self.frames = 0
        self._total: NDArray[np.uint32] = np.zeros(0, dtype=np.uint32)
        self._clipped: NDArray[np.uint16] = np.zeros(0, dtype=np.uint16)

    def add(self, frame: Pixels) -> None:
        """One more. InputError where it is of another size than those before."""
        if not self.frames:
            self.first = frame.copy()
            self._total = np.zeros(frame.shape, dtype=np.uint32)
            self._clipped = np.zeros(frame.shape[:2], dtype=np.uint16)
        elif frame.shape != self.first.shape:
            sizes = " and ".join(f"{one.shape[1]} x {one.shape[0]}" for one in (self.first, frame))
            raise InputError(
                "camera", f"has frames of {sizes} px", remedy="set the camera to one size"
            )
        self._total += frame
        self._clipped += (frame == WHITE).any(axis=2)
        self.frames += 1

    def shot(self) -> Shot:
        """The mean, rounded, and its facts."""
        mean = np.rint(self._total / self.frames).astype(np.uint8)
        clipped = float((2 * self._clipped > self.frames).mean())
        return Shot(mean, self.frames, clipped, edge_blur(self.first), edge_smear(self.first, mean))


class _Edges(Struct, frozen=True, eq=False):
    """The strongest edges of a picture. at: (H, W) bool, where they are steepest. slope, step: (H, W), grey values a
    pixel, and of the whole step.
    """

    at: NDArray[np.bool_]
    slope: Float32
    step: Float32


def edge_blur(pixels: Pixels) -> float | None:
    """The blur of the strongest edges, px: the standard deviation of the Gaussian. None where there are none.

    The pixel's own square counts, which is 0.29. What is more than 6 px comes out as about 6.
    """
    edges = _find_edges(pixels)
    return None if edges is None else _blur_of(edges.step[edges.at] / edges.slope[edges.at])


def edge_smear(first: Pixels, mean: Pixels) -> float | None:
    """The blur (px) in ``mean`` of those edges of ``first`` that suffered most, a tenth: as one frame of many is
    sharp where the camera or the part moves, along one direction perhaps.
    """
    edges = _find_edges(first)
    if edges is None:
        return None
    left = _dilate(_slope(_smooth(mean)), _PEAK_PX)[edges.at]
    worst = float(np.quantile(left / edges.slope[edges.at], 0.1))
    alone = edges.step[edges.at] / edges.slope[edges.at]
    return _blur_of(alone / max(worst, 1e-3))


def _blur_of(wide: Float32) -> float:
    """wide: (N,) step by slope of each edge, px."""
    total = float(np.median(wide)) / math.sqrt(2 * math.pi)
    return math.sqrt(max(total**2 - _ADDED, 1 / 12))


def _find_edges(pixels: Pixels) -> _Edges | None:
    smooth = _smooth(pixels)
    slope = _slope(smooth)
    step = _dilate(smooth, _STEP_PX) + _dilate(-smooth, _STEP_PX)
    low, high = np.percentile(smooth[::4, ::4], (1, 99))
    least = max(_STEP_SHARE * float(high - low), _STEP_GREY)
    at = (slope >= _dilate(slope, _PEAK_PX)) & (step > least) & (slope * _WIDEST > step)
    if np.count_nonzero(at) < _FEWEST_EDGES:
        return None
    # What has the step within reach but is no edge itself, grain on a plateau, is far less steep.
    wide = np.where(at, step / np.maximum(slope, 1e-6), np.inf)
    return _Edges(wide < 2 * np.percentile(wide[at], 20), slope, step)


def _smooth(pixels: Pixels) -> Float32:
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    grey = pixels if pixels.ndim == 2 else cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
    return np.asarray(cv2.GaussianBlur(grey.astype(np.float32), (0, 0), _SMOOTH), dtype=np.float32)


def _slope(smooth: Float32) -> Float32:
    gv, gu = np.gradient(smooth)
    return np.asarray(np.hypot(gu, gv), dtype=np.float32)


def _dilate(values: Float32, reach: int) -> Float32:
    """The greatest value within ``reach`` px, a square."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    return np.asarray(
        cv2.dilate(values, np.ones((2 * reach + 1, 2 * reach + 1), dtype=np.uint8)),
        dtype=np.float32,
    )


def judge(shot: Shot) -> tuple[Note, ...]:
    """What is wrong with the picture, and what to do about it."""
    notes = [*_judge_blur(shot)]
    if shot.clipped > _GLARE:
        what = f"{100 * shot.clipped:.1f} % of the picture is at full white, {WHITE}"
        why = "edges beside it move: expose shorter, close the aperture, or take light away"
        notes.append(Note("warning", what, why, strict=True))
    bright = float(np.quantile(shot.pixels[::2, ::2], 1 - _BRIGHT_SHARE))
    if bright < _DIM * WHITE:
        what = f"the picture is dark: its brightest parts have {bright:.0f} of {WHITE}"
        notes.append(Note("warning", what, "expose longer, or give more light", strict=True))
    return tuple(notes)


def _judge_blur(shot: Shot) -> list[Note]:
    if shot.blur is None or shot.smear is None:
        return [
            Note(
                "warning",
                "the picture shows no edges",
                "is the lens covered, or far out of focus?",
                strict=True,
            )
        ]
    if shot.blur > _BLURRED:
        what = f"edges are blurred by {shot.blur:.1f} px (standard deviation; up to {_BLURRED:g} is fine)"
        return [
            Note(
                "warning",
                what,
                "focus the lens, and expose so short that nothing moves meanwhile",
                strict=True,
            )
        ]
    if shot.smear > _MOVED_TIMES * shot.blur + _MOVED_PX:
        what = f"camera or part moved: {counted(shot.frames, 'frame')} have edges blurred by {shot.smear:.1f} px"
        return [
            Note(
                "warning",
                what,
                f"a single one by {shot.blur:.1f} px; let nothing move",
                strict=True,
            )
        ]
    return []
