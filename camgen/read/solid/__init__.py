"""3-D parts: meshes and STEP files (docs/inputs/solid.md)."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping

import numpy as np
from msgspec import Struct

from camgen.model.errors import JobError
from camgen.model.files import Source
from camgen.model.job import DrawnFixture, Job
from camgen.model.part import Edge, Note, Part, Solid, describe_bodies
from camgen.model.pose import to_vec3
from camgen.model.text import counted, harmless, short
from camgen.read.clamps import make_prism
from camgen.read.files import Files
from camgen.read.solid import mesh
from camgen.read.solid.faces import Face, find_adjacent_faces, make_faces
from camgen.read.units import MM, format_size

#: Suffixes of STEP files.
STEP = (".step", ".stp")
#: A page lists the faces of a part with at most this number of them.
_MAX_LISTED = 200


class SolidFacts(Struct, frozen=True):
    """The content of a 3-D part. Its `str` is a page to print.

    units: unit of the file.
    size: extent along x, y and z, mm.
    bodies: names of the bodies, "" for a body without a name.
    faces: number of triangles.
    edge_kinds: number of edges of each kind, "convex line" and so on.
    edges: edges in the order of their ids.
    surfaces: faces between sharp edges, each with the ids of its edges. The ids are left out if
        there are too many faces to list.
    notes: everything that was assumed, repaired, joined or left out.
    """

    units: str
    size: tuple[float, float, float]
    bodies: tuple[str, ...]
    faces: int
    edge_kinds: dict[str, int]
    edges: tuple[Edge, ...]
    surfaces: tuple[tuple[Face, tuple[str, ...]], ...]
    notes: tuple[Note, ...]

    def __str__(self) -> str:
        size = format_size(self.size)
        lines = [
            f"3-D part of {size} mm, units {self.units}, {counted(self.faces, 'triangle')}",
            f"bodies: {describe_bodies(self.bodies)}",
            f"edges: {describe_edges(self.edge_kinds)}",
            *map(_describe_edge, self.edges),
        ]
        is_long = len(self.surfaces) > _MAX_LISTED
        lines.append(f"faces: {len(self.surfaces)}" + (", too many to list" if is_long else ""))
        if not is_long:
            lines += [_describe_face(face, edges) for face, edges in self.surfaces]
        return "\n".join([*lines, *map(str, self.notes)])


def count_edge_kinds(edges: Iterable[Edge]) -> dict[str, int]:
    """The number of edges of each kind: "convex line", "concave circle" and so on."""
    kinds = Counter(f"{'convex' if e.convex else 'concave'} {e.kind}" for e in edges)
    return dict(sorted(kinds.items(), reverse=True))


def describe_edges(kinds: Mapping[str, int]) -> str:
    """One line with the number of all edges, of the convex ones and of the concave ones by kind.

    kinds: numbers as from `count_edge_kinds`.
    """
    texts = [str(sum(kinds.values()))]
    for convexity in ("convex", "concave"):
        counts = {name.split()[1]: n for name, n in kinds.items() if name.startswith(convexity)}
        listed = ", ".join(counted(count, kind) for kind, count in counts.items())
        texts.append(f"{sum(counts.values())} {convexity}" + (f" ({listed})" if counts else ""))
    return ", ".join(texts)


def _describe_face(face: Face, edges: tuple[str, ...]) -> str:
    """A line about a face: id, area, direction of a flat one, and its edges."""
    shape = "bent"
    if face.looks is not None:
        shape = "looks to " + format_size((face.looks + 0.0).tolist(), 3, " ")
    listed = f"edges {' '.join(edges)}" if edges else "no edges"
    return f"{face.id}: {short(face.area, 1)} mm2, {shape}, {listed}"


def _describe_edge(edge: Edge) -> str:
    """A line about an edge: id, kind, length, angle between the face normals, convexity, start."""
    radius = f" of radius {short(edge.radius, 3)} mm" if edge.radius else ""
    convexity = "convex" if edge.convex else "concave"
    start = format_size(edge.points[0].tolist(), 2, " ")
    size = f"{short(edge.length, 3)} mm, {math.degrees(edge.angle):.1f} deg"
    return f"{edge.id}: {edge.kind}{radius}, {size}, {convexity}, from {start}"


def inspect(source: Source, job: Job, _files: Files) -> SolidFacts:
    """The content of the 3-D part in a file. Raises the errors of `read`."""
    shape = read_solid(source, job)
    return SolidFacts(
        harmless(shape.units),
        to_vec3(np.subtract(shape.vertices.max(axis=0), shape.vertices.min(axis=0))),
        shape.bodies,
        len(shape.faces),
        count_edge_kinds(shape.edges),
        shape.edges,
        _list_surfaces(shape),
        shape.notes,
    )


def _list_surfaces(shape: Solid) -> tuple[tuple[Face, tuple[str, ...]], ...]:
    """The faces with the ids of their edges, which are left out if the faces are not listed."""
    faces = make_faces(shape)
    edges: list[list[str]] = [[] for _ in faces.listed]
    if len(edges) <= _MAX_LISTED:
        for name, pair in find_adjacent_faces(shape.edges, shape, faces).items():
            for k in sorted(set(pair)):
                edges[k].append(name)
    return tuple((face, tuple(names)) for face, names in zip(faces.listed, edges, strict=True))


def read(source: Source, job: Job, _files: Files) -> Part:
    """The part in a 3-D file. Raises the errors of `read_solid`."""
    shape = read_solid(source, job)
    return Part(shape.name, shape.source, shape.units, (), shape.notes, solid=shape)


def read_solid(source: Source, job: Job) -> Solid:
    """The solid in a 3-D file.

    `input.units` replaces the unit of a mesh. With "auto" it is the one of the file, or mm.

    Raises InputError for a file without a solid. Raises JobError if `input.units` is unknown, or is
    set for a STEP file.
    """
    wanted = job.input.units.strip().lower()
    if source.suffix in STEP:
        from camgen.read.solid import step  # noqa: PLC0415 (3 ms, which a mesh does not need)

        if wanted != "auto":
            raise JobError(
                "[input] units", "a STEP file states its own", remedy='set input.units to "auto"'
            )
        return step.read(source, job.tolerance.chord)
    if wanted != "auto" and wanted not in MM:
        raise JobError(
            "[input] units",
            f"unknown unit {harmless(wanted)!r}",
            remedy="give mm, cm, m, inch, ...",
        )
    return mesh.read(source, None if wanted == "auto" else MM[wanted], job.tolerance.chord)


def read_fixtures(
    job: Job, files: Files, part: Part | None = None
) -> tuple[tuple[str, Solid], ...]:
    """The fixtures of a job except boxes, each with its name, work frame.

    part: part with the clamps of its drawing; None without a drawing.

    Raises InputError for a file without a mesh, and the errors of `make_prism` for clamps that are
    drawn.
    """
    named: list[tuple[str, Solid]] = []
    for number, given in enumerate(job.cell.fixtures or (), 1):
        if isinstance(given, str):
            solid_of_file = mesh.read(files.read(given), tolerance=job.tolerance.chord)
            named.append((f"fixture {number}", solid_of_file))
        elif isinstance(given, DrawnFixture):
            named.append((f"fixture {number}", make_prism(given, part)))
    return tuple(named)
