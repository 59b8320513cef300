"""A point cloud as it is in its file, before it is known what one unit of it is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.model.part import Note
from camgen.model.pose import FloatArray
from camgen.model.text import counted

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


class StationScan(Struct, frozen=True, eq=False):
    """A scan from one place of the scanner.

    points: (N, 3), in the frame of the file.
    missing: number of points that the scanner did not measure.
    place: (3,) of the scanner in the frame of the file; None if it is not known.
    """

    points: FloatArray
    missing: int
    place: FloatArray | None


def join_scans(
    scans: Sequence[StationScan], missing: tuple[str, str], whys: tuple[str, str], source: str
) -> FileCloud:
    """The points of one or more scans, usually in m.

    missing: words for one and for many points that were not measured, with their verb.
    whys: reasons for the notes on missing points and on several scans.
    source: reason for the usual unit.
    """
    count, notes = sum(scan.missing for scan in scans), []
    if count:
        notes.append(Note("repaired", f"{counted(count, *missing)} left out", whys[0]))
    if len(scans) > 1:
        notes.append(Note("joined", f"{len(scans)} scans were joined", whys[1]))
    points = np.concatenate([scan.points for scan in scans])
    place = scans[0].place if len(scans) == 1 else None
    return FileCloud(points, tuple(notes), place, "", "m", source)


def parse_numbers(words: Sequence[str | bytes]) -> list[float]:
    """The numbers in `words`; none if one word is not a number below `FARTHEST`."""
    try:
        values = list(map(float, words))
    except ValueError:
        return []
    return values if np.all(np.abs(values) < FARTHEST) else []
