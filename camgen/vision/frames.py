"""Averages the frames of one view to a picture, and warns of blur, bad light and movement.

The mean of n frames has the noise of a single frame divided by the root of n, if the noise of the
frames is independent; rounding adds a third of a grey value. Blur is measured at the strongest
edges: a step of height h that a Gaussian has smoothed rises by h / (sqrt(2 pi) sigma) per pixel
where it is steepest.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.model.errors import InputError
from camgen.model.part import Note
from camgen.model.text import counted
from camgen.vision.image import WHITE, Pixels, convert_to_grey

Float32 = NDArray[np.float32]

#: px: a note warns of more blur than this. Outlines of parts are fitted up to about three times of
#: it, with growing errors.
_MAX_BLUR_PX = 2.0
#: The view moved if the mean is blurred this many times as much as a single frame,
_MOVED_FACTOR = 1.5
#: and this many px more.
_MOVED_PX = 0.3
#: A note warns if more than this fraction of the pixels is at full white.
_MAX_CLIPPED = 0.01
#: Fraction of the pixels that are the brightest part of the picture.
_BRIGHTEST = 0.005
#: A note warns if the brightest part is below this fraction of full white.
_MIN_BRIGHTNESS = 0.3
#: px: sigma of the smoothing before the slope is measured.
_SMOOTHING_PX = 1.0
#: px2: variance that the smoothing and the central difference add to the blur.
_ADDED_VARIANCE = _SMOOTHING_PX**2 + 1 / 3
#: px: an edge is the steepest place within this distance.
_PEAK_PX = 3
#: px: the step of an edge is measured within this distance.
_STEP_PX = 16
#: The step of an edge is at least this fraction of the contrast of the picture,
_MIN_STEP_FRACTION = 0.4
#: and at least this many grey values.
_MIN_STEP = 12.0
#: px: a step that is wider than this is a slope of light, not an edge.
_MAX_WIDTH_PX = 60.0
#: Pixels on edges that a measurement needs, at least.
_MIN_EDGE_PIXELS = 20


class Shot(Struct, frozen=True, eq=False):
    """Several frames as one picture.

    pixels: mean of the frames, (H, W, 3) uint8.
    frames: number of frames.
    clipped: fraction of the pixels that are at full white in most frames.
    blur: blur of the first frame, px; None without edges.
    smear: blur of the mean where movement blurred it most, px; None without edges.
    """

    pixels: Pixels
    frames: int
    clipped: float
    blur: float | None
    smear: float | None


class Sum:
    """A sum of frames.

    first: the first frame.
    frames: number of frames so far.
    """

    def __init__(self) -> None:
        self.first: Pixels = np.zeros((0, 0, 3), dtype=np.uint8)
        self.frames = 0
        self._total: NDArray[np.uint32] = np.zeros(0, dtype=np.uint32)
        self._clipped: NDArray[np.uint16] = np.zeros(0, dtype=np.uint16)

    def add(self, frame: Pixels) -> None:
        """Add a frame, (H, W, 3) uint8. Raises InputError if its size differs from the first."""
        if not self.frames:
            self.first = frame.copy()
            self._total = np.zeros(frame.shape, dtype=np.uint32)
            self._clipped = np.zeros(frame.shape[:2], dtype=np.uint16)
        elif frame.shape != self.first.shape:
            sizes = " and ".join(
                f"{pixels.shape[1]} x {pixels.shape[0]}" for pixels in (self.first, frame)
            )
            raise InputError(
                "camera", f"has frames of {sizes} px", remedy="set the camera to one size"
            )
        self._total += frame
        self._clipped += (frame == WHITE).any(axis=2)
        self.frames += 1

    def shot(self) -> Shot:
        """The mean of at least one frame, rounded, with its measurements."""
        mean = np.rint(self._total / self.frames).astype(np.uint8)
        clipped = float((2 * self._clipped > self.frames).mean())
        return Shot(
            mean, self.frames, clipped, measure_blur(self.first), measure_smear(self.first, mean)
        )


class _Edges(Struct, frozen=True, eq=False):
    """The strongest edges of a picture.

    is_edge: (H, W) bool, True at the steepest pixels of the edges.
    slope: (H, W), grey values per px.
    step: (H, W), height of the step around each pixel, grey values.
    """

    is_edge: NDArray[np.bool_]
    slope: Float32
    step: Float32

    def widths(self) -> Float32:
        """Step divided by slope at each edge pixel, (N,) px."""
        return self.step[self.is_edge] / self.slope[self.is_edge]


def measure_blur(pixels: Pixels) -> float | None:
    """Measure the blur of the strongest edges: sigma of the Gaussian, px; None without edges.

    The area of a pixel is included, which alone is a blur of 0.29. Blurs above 6 px are measured as
    about 6.
    """
    edges = _find_edges(pixels)
    return None if edges is None else _compute_blur(edges.widths())


def measure_smear(first: Pixels, mean: Pixels) -> float | None:
    """Measure the blur of those edges of `first` that are most blurred in `mean`, a tenth; px.

    A camera or a part that moves may blur the edges of one direction only, and leaves those of a
    single frame sharp. Returns None without edges.
    """
    edges = _find_edges(first)
    if edges is None:
        return None
    slope = _dilate(_compute_slope(_smooth(mean)), _PEAK_PX)[edges.is_edge]
    remaining = float(np.quantile(slope / edges.slope[edges.is_edge], 0.1))
    return _compute_blur(edges.widths() / max(remaining, 1e-3))


def _compute_blur(widths: Float32) -> float:
    """Sigma of the blur, px, from step divided by slope of each edge, (N,) px."""
    sigma = float(np.median(widths)) / math.sqrt(2 * math.pi)
    return math.sqrt(max(sigma**2 - _ADDED_VARIANCE, 1 / 12))


def _find_edges(pixels: Pixels) -> _Edges | None:
    smooth = _smooth(pixels)
    slope = _compute_slope(smooth)
    step = _dilate(smooth, _STEP_PX) + _dilate(-smooth, _STEP_PX)
    low, high = np.percentile(smooth[::4, ::4], (1, 99))
    min_step = max(_MIN_STEP_FRACTION * float(high - low), _MIN_STEP)
    is_steepest = slope >= _dilate(slope, _PEAK_PX)
    candidates = is_steepest & (step > min_step) & (slope * _MAX_WIDTH_PX > step)
    if np.count_nonzero(candidates) < _MIN_EDGE_PIXELS:
        return None
    # Grain on a plateau may have a step within reach without being an edge: it is far less steep.
    widths = np.where(candidates, step / np.maximum(slope, 1e-6), np.inf)
    return _Edges(widths < 2 * np.percentile(widths[candidates], 20), slope, step)


def _smooth(pixels: Pixels) -> Float32:
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    grey = convert_to_grey(pixels).astype(np.float32)
    return np.asarray(cv2.GaussianBlur(grey, (0, 0), _SMOOTHING_PX), dtype=np.float32)


def _compute_slope(smooth: Float32) -> Float32:
    """Length of the gradient (H, W), grey values per px."""
    down, right = np.gradient(smooth)
    return np.asarray(np.hypot(right, down), dtype=np.float32)


def _dilate(values: Float32, reach: int) -> Float32:
    """The maximum of `values` (H, W) in a square around each pixel, `reach` px to each side."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    square = np.ones((2 * reach + 1, 2 * reach + 1), dtype=np.uint8)
    return np.asarray(cv2.dilate(values, square), dtype=np.float32)


def note_faults(shot: Shot) -> tuple[Note, ...]:
    """Notes on faults of the picture, with what to do about each; empty for a good picture."""
    notes = _note_blur(shot)
    if shot.clipped > _MAX_CLIPPED:
        notes.append(
            Note(
                "warning",
                f"{100 * shot.clipped:.1f} % of the picture is at full white, {WHITE}",
                "edges beside it move: expose shorter, close the aperture, or take light away",
                strict=True,
            )
        )
    brightness = float(np.quantile(shot.pixels[::2, ::2], 1 - _BRIGHTEST))
    if brightness < _MIN_BRIGHTNESS * WHITE:
        notes.append(
            Note(
                "warning",
                f"the picture is dark: its brightest parts have {brightness:.0f} of {WHITE}",
                "expose longer, or give more light",
                strict=True,
            )
        )
    return tuple(notes)


def _note_blur(shot: Shot) -> list[Note]:
    """The note on missing edges, blur or movement, whichever comes first; empty if all is well."""
    if shot.blur is None or shot.smear is None:
        what = "the picture shows no edges"
        why = "is the lens covered, or far out of focus?"
    elif shot.blur > _MAX_BLUR_PX:
        what = (
            f"edges are blurred by {shot.blur:.1f} px "
            f"(standard deviation; up to {_MAX_BLUR_PX:g} is fine)"
        )
        why = "focus the lens, and expose so short that nothing moves meanwhile"
    elif shot.smear > _MOVED_FACTOR * shot.blur + _MOVED_PX:
        what = (
            f"camera or part moved: {counted(shot.frames, 'frame')} "
            f"have edges blurred by {shot.smear:.1f} px"
        )
        why = f"a single one by {shot.blur:.1f} px; let nothing move"
    else:
        return []
    return [Note("warning", what, why, strict=True)]
