"""The rectified view of a part, as the page shows it under the paths."""

from __future__ import annotations

import base64

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from camgen.model.pose import FloatArray
from camgen.preview import Built

#: Maximum number of pixels of the longer side, and the quality of the JPEG.
MOST_PIXELS, _QUALITY = 1600, 82


class Photo(Struct, frozen=True, eq=False):
    """A picture in the work plane.

    image: the bytes of a JPEG.
    corners: (4, 2) its corners in the work plane, mm: upper left, upper right, lower right, lower
        left.
    """

    image: bytes
    corners: FloatArray

    @property
    def address(self) -> str:
        """The picture as a data URI."""
        return f"data:image/jpeg;base64,{base64.b64encode(self.image).decode()}"


def make_photo(result: Built) -> Photo | None:
    """The view of the work plane in which the part was found; None if no picture shows the part."""
    raster = result.part.raster
    tones: str = result.job.image.tones
    if result.located is not None:
        raster, tones = result.located.inspection.photo.raster, result.located.tones
    if raster is None:
        return None
    import cv2  # noqa: PLC0415 (slow to load, only pictures need it)

    high, wide = raster.view.shape[:2]
    left, top, right, bottom = -0.5, -0.5, wide - 0.5, high - 0.5
    corners = np.array([(left, top, 1), (right, top, 1), (right, bottom, 1), (left, bottom, 1)])
    pixels = raster.view
    ratio = MOST_PIXELS / max(high, wide)
    if ratio < 1:
        size = (max(round(wide * ratio), 1), max(round(high * ratio), 1))
        pixels = np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    if tones == "srgb":
        pixels = _encode_light(pixels)
    image = bytes(cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1])
    return Photo(image, corners @ raster.work_from_view.T)


def _encode_light(light: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Encode linear light as sRGB (IEC 61966-2-1), which the reader has decoded."""
    value = np.arange(256) / 255
    coded = np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1 / 2.4) - 0.055)
    return np.asarray((coded * 255).round().astype(np.uint8)[light])
