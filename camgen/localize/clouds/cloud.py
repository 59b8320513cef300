"""A point cloud as it is in its file, before it is known what one unit of it is."""

from __future__ import annotations

from msgspec import Struct

from camgen.model.part import Note
from camgen.model.pose import FloatArray

#: What to do about a damaged file.
AGAIN = "export it again from the scanner's program"
#: A coordinate beyond this is damage, mm. A place on earth in metres is at most 1e10 mm from the
#: origin of its grid; a double holds that to 2e-6 mm.
FARTHEST = 1e11


class FileCloud(Struct, frozen=True, eq=False):
    """The points of a file, with the facts that it states about them.

    points: (N, 3) in the unit of the file; not finite if the scanner saw nothing.
    notes: omissions and assumptions.
    viewpoint: (3,) place of the scanner, in the unit of the file; None if it is not known.
    unit: the unit that the file itself states; "" if it states none.
    usual: the unit that the kind of file is written in, by its standard or by custom; "" if any.
    source: the reason for `unit` or `usual`, for messages.
    """

    points: FloatArray
    notes: tuple[Note, ...] = ()
    viewpoint: FloatArray | None = None
    unit: str = ""
    usual: str = ""
    source: str = ""
