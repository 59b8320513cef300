"""Scans from files, in mm: point clouds by the readers in `clouds`, and meshes."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.localize.clouds.cloud import AGAIN, FARTHEST, FileCloud
from camgen.localize.clouds.e57 import read_e57
from camgen.localize.clouds.las import read_las
from camgen.localize.clouds.ptx import read_ptx
from camgen.localize.clouds.records import has_faces, read_pcd, read_ply
from camgen.localize.clouds.text import read_text, read_vertices
from camgen.localize.model import cross_edges, spread_points
from camgen.model.errors import InputError, JobError, make_one_line
from camgen.model.files import Source
from camgen.model.part import Note
from camgen.model.pose import FloatArray
from camgen.model.text import counted
from camgen.read.files import Files, reason
from camgen.read.solid.mesh_file import read_mesh
from camgen.read.units import MM

_TEXTS = (".xyz", ".txt", ".csv", ".asc", ".pts")
_MESHES = (".stl", ".obj", ".off")
_READERS: dict[str, Callable[[str, bytes], FileCloud]] = {
    ".ply": read_ply,
    ".pcd": read_pcd,
    ".ptx": read_ptx,
    ".e57": read_e57,
    ".las": read_las,
    ".laz": read_las,
    **dict.fromkeys(_TEXTS, read_text),
}
SUFFIXES = (*_READERS, *_MESHES)

#: Fewer points than this do not hold a pose.
LEAST = 100
#: Points that are spread over the faces of a scan that is a mesh.
_SPREAD = 100_000
_FACE = re.compile(rb"^f ", re.MULTILINE)


class Scan(Struct, frozen=True, eq=False):
    """A scan that can be used.

    points: (N, 3) mm, finite, N at least `LEAST`.
    notes: omissions and assumptions.
    unit: the unit of the file.
    stated: whether the file itself states the unit, so that it cannot be another.
    viewpoint: (3,) mm, the place of the scanner; None if the file does not state it.
    """

    points: FloatArray
    notes: tuple[Note, ...]
    unit: str
    stated: bool = False
    viewpoint: FloatArray | None = None

    def scaled(self, unit: str) -> Scan:
        """A copy of the scan for a file in another unit."""
        factor = MM[unit] / MM[self.unit]
        viewpoint = None if self.viewpoint is None else self.viewpoint * factor
        return replace(self, points=self.points * factor, unit=unit, viewpoint=viewpoint)


def open_scan(path: Path, files: Files) -> Source:
    """The file of a scan. Raises InputError if it cannot be opened."""
    try:
        return files.open(path)
    except IsADirectoryError:
        raise InputError(path.name, "is a folder", remedy="name a point cloud in it") from None
    except FileNotFoundError:
        raise InputError(path.name, "there is no such file") from None
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        raise InputError(path.name, f"cannot be read: {make_one_line(reason(error))}") from error


def read_scan(source: Source, unit: str = "") -> Scan:
    """The points in `source`.

    unit: the unit of the file, a key of `MM`; "" for the unit that the file states or mm.

    Raises InputError if there are no points that can be used, JobError if the file states another
    unit.
    """
    if source.suffix not in SUFFIXES:
        raise InputError(
            source.name,
            "is not a kind of point cloud that camgen reads",
            remedy=f"give one of {', '.join(SUFFIXES)}",
        )
    if not source.data.strip():
        raise InputError(source.name, "the file is empty")
    cloud = _load(source)
    notes = list(cloud.notes)
    taken = _choose_unit(source.name, cloud, unit, notes)
    points = _select_usable(source.name, cloud.points * MM[taken], notes)
    viewpoint = None if cloud.viewpoint is None else cloud.viewpoint * MM[taken]
    return Scan(points, tuple(notes), taken, bool(cloud.unit), viewpoint)


def _load(source: Source) -> FileCloud:
    name, kind, data = source.name, source.suffix, source.data
    if kind == ".obj" and not _FACE.search(data):
        return read_vertices(name, data)
    if kind in _MESHES or (kind == ".ply" and has_faces(data)):
        return _spread_over_mesh(source)
    return _READERS[kind](name, data)


def _choose_unit(name: str, cloud: FileCloud, unit: str, notes: list[Note]) -> str:
    """The unit of a scan: as the file states, else the option, else the usual one, else mm.

    Raises JobError if the option and the file differ.
    """
    if cloud.unit:
        if unit and MM[unit] != MM[cloud.unit]:
            raise JobError(
                "--units",
                f"says {unit}, and {name} is in {cloud.unit}: {cloud.source} says so",
                remedy="leave it out, or correct the file",
            )
        notes.append(Note("assumed", f"1 unit of the scan = 1 {cloud.unit}", cloud.source))
        return cloud.unit
    if not cloud.usual:
        return unit or "mm"
    if not unit:
        notes.append(
            Note(
                "assumed",
                f"1 unit of the scan = 1 {cloud.usual}",
                f"{cloud.source}; give --units if it is in another unit",
            )
        )
    elif MM[unit] != MM[cloud.usual]:
        notes.append(
            Note("warning", f"1 unit of the scan = 1 {unit}, as --units says", cloud.source)
        )
    return unit or cloud.usual


def _select_usable(name: str, points: FloatArray, notes: list[Note]) -> FloatArray:
    """The finite points.

    Scanners write NaN, or the origin of the sensor, for directions in which they saw nothing.
    """
    finite = np.isfinite(points).all(axis=1)
    near = (np.abs(points) < FARTHEST).all(axis=1)
    void = (points == 0).all(axis=1)
    several = np.count_nonzero(void) > 1
    for left_out, which, why in (
        (~finite, "with coordinates that are not numbers", ""),
        (finite & ~near, f"beyond {FARTHEST:g} mm", "no scan is so far from its origin"),
        (void & several, "at exactly 0, 0, 0", "scanners write that if they see nothing"),
    ):
        count = int(np.count_nonzero(left_out))
        if count:
            what = counted(count, f"point {which} was left out", f"points {which} were left out")
            notes.append(Note("repaired", what, why))
    usable: FloatArray = points[near & ~(void & several)]
    if len(usable) < LEAST:
        beyond = int(np.count_nonzero(finite & ~near))
        where = f"{beyond} more are beyond {FARTHEST:g} mm" if beyond else ""
        raise InputError(
            name,
            f"has {counted(len(usable), 'usable point')}",
            where,
            f"a scan needs {LEAST} or more",
        )
    return usable


def _spread_over_mesh(source: Source) -> FileCloud:
    """Points spread over the faces of a mesh, evenly, however coarse the triangles are."""
    soup = read_mesh(source)
    corners = soup.vertices[soup.faces]
    if not np.linalg.norm(cross_edges(corners), axis=1).any():
        raise InputError(source.name, "has no face with an area", remedy=AGAIN)
    what = f"{_SPREAD} points were spread over the {counted(len(corners), 'face')} of the scan"
    return FileCloud(spread_points(corners, _SPREAD)[0], (*soup.notes, Note("assumed", what)))
