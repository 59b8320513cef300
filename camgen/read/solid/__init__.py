"""3-D parts, meshes and STEP (docs/inputs/solid.md)."""

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
from camgen.read.solid.faces import Face, beside, faces_of
from camgen.read.units import MM

#: The suffixes of STEP files.
STEP = (".step", ".stp")
#: So many faces are listed.
_LISTED = 200


class SolidFacts(Struct, frozen=True):
    """The content of a 3-D part; its ``str`` is a page to print.

    size: extent along x, y and z, mm.
    bodies: names of the bodies, "" for a body without a name.
    faces: number of triangles.
    edge_kinds: number of edges of each kind, "convex line" and so on.
    surfaces: faces between sharp edges, each with the ids of its edges.
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
        size = " x ".join(short(v, 3) for v in self.size)
        lines = [
            f"3-D part of {size} mm, units {self.units}, {counted(self.faces, 'triangle')}",
            f"bodies: {describe_bodies(self.bodies)}",
            f"edges: {describe_edges(self.edge_kinds)}",
            *(_describe(edge) for edge in self.edges),
            *self._tell_faces(),
            *map(str, self.notes),
        ]
        return "\n".join(lines)

    def _tell_faces(self) -> list[str]:
        if len(self.surfaces) > _LISTED:
            return [f"faces: {len(self.surfaces)}, too many to list"]
        return [f"faces: {len(self.surfaces)}", *(_describe_face(*one) for one in self.surfaces)]


def count_kinds(edges: Iterable[Edge]) -> dict[str, int]:
    """The number of edges of each kind: "convex line", "concave circle" and so on."""
    kinds = Counter(f"{'convex' if e.convex else 'concave'} {e.kind}" for e in edges)
    return dict(sorted(kinds.items(), reverse=True))


def describe_edges(kinds: Mapping[str, int]) -> str:
    """One line: all, convex ones by kind, concave ones by kind."""
    texts = [str(sum(kinds.values()))]
    for sort in ("convex", "concave"):
        own = {name.split()[1]: n for name, n in kinds.items() if name.split()[0] == sort}
        listed = ", ".join(counted(n, kind) for kind, n in own.items())
        texts.append(f"{sum(own.values())} {sort}" + (f" ({listed})" if own else ""))
    return ", ".join(texts)


def _describe_face(face: Face, edges: tuple[str, ...]) -> str:
    """One face: id, area, where a flat one looks to, and its edges."""
    bent = (
        "bent"
        if face.looks is None
        else "looks to " + " ".join(short(v + 0.0, 3) for v in face.looks.tolist())
    )
    return f"{face.id}: {short(face.area, 1)} mm2, {bent}, " + (
        f"edges {' '.join(edges)}" if edges else "no edges"
    )


def _describe(edge: Edge) -> str:
    """One edge: id, kind, length, angle between the faces' normals, convexity, and where it starts."""
    radius = f" of radius {short(edge.radius, 3)} mm" if edge.radius else ""
    sort = "convex" if edge.convex else "concave"
    start = " ".join(short(v, 2) for v in edge.points[0].tolist())
    size = f"{short(edge.length, 3)} mm, {math.degrees(edge.angle):.1f} deg"
    return f"{edge.id}: {edge.kind}{radius}, {size}, {sort}, from {start}"


def inspect(source: Source, job: Job, _files: Files) -> SolidFacts:
    """What is in the 3-D part. InputError if there is none."""
    found = solid(source, job)
    low, high = found.vertices.min(axis=0), found.vertices.max(axis=0)
    return SolidFacts(
        harmless(found.units),
        to_vec3(np.subtract(high, low)),
        found.bodies,
        len(found.faces),
        count_kinds(found.edges),
        found.edges,
        _surfaces(found),
        found.notes,
    )


def _surfaces(found: Solid) -> tuple[tuple[Face, tuple[str, ...]], ...]:
    """The faces with their edges; of very many without."""
    faces = faces_of(found)
    own: list[list[str]] = [[] for _ in faces.listed]
    if len(own) <= _LISTED:
        for name, pair in beside(found.edges, found, faces).items():
            for k in sorted(set(pair)):
                own[k].append(name)
    return tuple((face, tuple(names)) for face, names in zip(faces.listed, own, strict=True))


def read(source: Source, job: Job, _files: Files) -> Part:
    """The 3-D part in ``source``. InputError if there is none."""
    found = solid(source, job)
    return Part(found.name, found.source, found.units, (), found.notes, solid=found)


def solid(source: Source, job: Job) -> Solid:
    """The 3-D part in ``source``, its units taken from ``input.units`` where the file has none."""
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
    """The fixtures of a job that are no boxes, with their names, work frame.

    part: part with the clamps of its drawing; None without a drawing.

    Raises InputError for a file that is no mesh, and the errors of `make_prism` for clamps that are
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
