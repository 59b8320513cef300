"""A camera without a calibration file, as one photo of a marker sheet or a board shows it."""

from __future__ import annotations

from msgspec import Struct

from camgen.model.part import Note
from camgen.model.pose import FloatArray
from camgen.vision.camera.camera import Camera


class SheetLens(Struct, frozen=True, eq=False):
    """The camera of one photo.

    camera: focal length, principal point, and k1 k2 p1 p2 where the corners show a lens.
    bends: whether the corners show a lens.
    focal: the least and the largest focal length that agree with the corners, px. None if they
        contradict all, or if the photo was cut: then the focal length of ``camera`` is only good
        for the plane of the sheet.
    is_focal_known: whether that interval is narrow. A wide one is that of ordinary cameras.
    deviations: (4,), the standard deviations of k1 and k2, and of the principal point, px.
    note: the assumed values, and their reason.
    """

    camera: Camera
    bends: bool
    focal: tuple[float, float] | None
    is_focal_known: bool
    deviations: FloatArray
    note: Note
