"""The picture that shows a part, to scale, as the page lays it under the paths."""

from __future__ import annotations

import base64

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.model.pose import FloatArray
from camgen.preview import Built

#: Pixels of the longer side at most, and the quality of the JPEG.
MOST_PIXELS, _QUALITY = 1600, 82


class Photo(Struct, frozen=True, eq=False):
    """image: a JPEG. corners: (4, 2) mm in the work plane, from the first pixel's to the right, down, and back."""

    image: bytes
    corners: FloatArray

    @property
    def address(self) -> str:
        """The picture as a data URI."""
        return f"data:image/jpeg;base64,{base64.b64encode(self.image).decode()}"


def photo_of(result: Built) -> Photo | None:
    """The view of the work plane in which the part was found; None if no picture shows the part."""
    raster = result.part.raster
    tones: str = result.job.image.tones
    if result.located is not None:
        raster, tones = result.located.inspection.photo.raster, result.located.tones
    if raster is None:
        return None
    import cv2  # noqa: PLC0415 (slow to load, only pictures need it)

    high, wide = raster.view.shape[:2]
    around = np.array(
        [(-0.5, -0.5, 1), (wide - 0.5, -0.5, 1), (wide - 0.5, high - 0.5, 1), (-0.5, high - 0.5, 1)]
    )
    pixels = raster.view
    ratio = MOST_PIXELS / max(high, wide)
    if ratio < 1:
        size = (max(round(wide * ratio), 1), max(round(high * ratio), 1))
        pixels = np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    if tones == "srgb":
        pixels = _code(pixels)
    image = bytes(cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1])
    return Photo(image, around @ raster.work_from_view.T)


def _code(light: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Light as screens take it (IEC 61966-2-1): the reader has made light of what was coded so."""
    value = np.arange(256) / 255
    coded = np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1 / 2.4) - 0.055)
    return np.asarray((coded * 255).round().astype(np.uint8)[light])
