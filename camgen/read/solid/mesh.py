"""Meshes (STL, OBJ, PLY, OFF, 3MF, GLB) as solids: a clean surface, its borders and its edges."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.ragged import select_distinct
from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.model.part import FEATURE_ANGLE, BoolArray, IntArray, Note, Solid
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted
from camgen.read.solid.edges import make_edges, sort_edges
from camgen.read.solid.faces import BodyTable, name_bodies, tabulate_bodies
from camgen.read.solid.mesh_file import read_mesh
from camgen.read.solid.sharp import (
    chain_sides,
    compute_normals,
    find_dangling,
    find_sharp_sides,
)
from camgen.read.solid.soup import MeshSoup, NamedVertices
from camgen.read.solid.topology import (
    Pairs,
    drop_degenerate,
    drop_duplicates,
    drop_unused,
    label_components,
    list_ends,
    merge_equal_vertices,
    pair_half_edges,
    split_at_junctions,
    weld_rims,
)
from camgen.read.units import note_doubtful_size

# Winding: faces are turned so that their normals point out of the part, whatever the file states.


def _find_minority(faces: IntArray, pairs: Pairs) -> BoolArray:
    """(F,) whether a face is wound against the majority of its body.

    Every face is two nodes of a graph, one as it is and one turned. Nodes that agree across a side
    are linked. If the two nodes of a face are connected, its body has one side only, as a Moebius
    strip has, and is left as it is.
    """
    count = len(faces)
    if not pairs.turned.any():
        return np.zeros(count, dtype=bool)
    f, g = pairs.first // 3, pairs.second // 3
    body = label_components(count, f, g)
    swap = np.where(pairs.turned, count, 0)
    label = label_components(
        2 * count, np.concatenate([f, f + count]), np.concatenate([g + swap, g + count - swap])
    )
    is_turned = label[:count] > label[count:]
    is_majority = np.bincount(body, is_turned, count) * 2 > np.bincount(body, minlength=count)
    return np.asarray((is_turned ^ is_majority[body]) & (label[:count] != label[count:]))


def _find_inverted(corners: FloatArray, bodies: BodyTable) -> BoolArray:
    """(B,) whether a closed body is inside out.

    These are the bodies of negative volume that lie in no other one, and all bodies in them.
    """
    count = len(bodies.volume)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, bodies.body_of_face, corners.min(axis=1))
    np.maximum.at(high, bodies.body_of_face, corners.max(axis=1))
    closed = bodies.is_closed
    inverted = np.zeros(count, dtype=bool)
    for k in np.flatnonzero(closed & (bodies.volume < 0)).tolist():
        if not (closed & (low < low[k]).all(axis=1) & (high > high[k]).all(axis=1)).any():
            inverted |= closed & (low >= low[k]).all(axis=1) & (high <= high[k]).all(axis=1)
    return inverted


#: Largest tolerance for arcs, as a fraction of the diagonal of the mesh.
_MAX_TOLERANCE = 1e-4


class Surface(Struct, frozen=True, eq=False):
    """A clean mesh.

    vertices: (V, 3) mm.
    faces: (F, 3) vertices of each face, wound outward.
    normals: (F, 3) unit outward normals, zero for a face without height that lies in no other.
    pairs: half-edges where the faces meet.
    units: unit of the file, for the user.
    named: names of bodies by vertex, None if the file has none.
    """

    vertices: FloatArray
    faces: IntArray
    normals: FloatArray
    pairs: Pairs
    units: str
    named: NamedVertices | None = None


def read(
    source: Source,
    mm: float | None = None,
    tolerance: float = 0.01,
    feature_angle: float = FEATURE_ANGLE,
) -> Solid:
    """The solid in a mesh file.

    mm: length of one unit of the file, mm. None for the unit that the file states, or 1 mm.
    tolerance: largest distance of a vertex from the arc that it is recognised as a part of, mm.
    feature_angle: angle between face normals above which an edge is sharp, rad.

    Raises InputError for a file without a mesh.
    """
    solid = make_solid(read_mesh(source), source.stem, source.name, mm, tolerance, feature_angle)
    if mm is not None:
        return solid
    size = np.ptp(solid.vertices, axis=0).tolist()
    return replace(solid, notes=(*solid.notes, *note_doubtful_size(size, solid.units, source.name)))


def make_solid(
    soup: MeshSoup,
    stem: str,
    name: str,
    mm: float | None = None,
    tolerance: float = 0.01,
    feature_angle: float = FEATURE_ANGLE,
) -> Solid:
    """The solid of triangles from any source.

    stem: name of the part.
    name: name of the source in messages.

    The other parameters and errors are those of `read`.
    """
    mesh, notes = _make_surface(soup, name, mm)
    borders = _find_borders(mesh.vertices, mesh.faces, mesh.pairs, notes)
    sides = find_sharp_sides(mesh.vertices, mesh.faces, mesh.normals, mesh.pairs, feature_angle)
    diagonal = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    limit = min(tolerance, _MAX_TOLERANCE * diagonal)
    edges = sort_edges(make_edges(chain_sides(sides, mesh.vertices), mesh.vertices, limit))
    if edges:
        convex = int(np.count_nonzero(sides.convex))
        notes.append(
            Note(
                "joined",
                f"{convex} convex and {len(sides) - convex} concave sides of triangles "
                f"are {counted(len(edges), 'edge')}",
                f"arcs where vertices lie on one within {limit:.3g} mm",
            )
        )
    return Solid(
        stem,
        name,
        mesh.units,
        mesh.vertices,
        mesh.faces,
        mesh.normals,
        edges,
        borders,
        tuple(notes),
        name_bodies(mesh.vertices, mesh.faces, mesh.pairs, mesh.named),
    )


def read_surface(source: Source, mm: float | None = None) -> tuple[Surface, list[Note]]:
    """The clean mesh of a file, and notes on the repairs. `mm` and errors are those of `read`."""
    return _make_surface(read_mesh(source), source.name, mm)


def _make_surface(soup: MeshSoup, name: str, mm: float | None) -> tuple[Surface, list[Note]]:
    notes = list(soup.notes)
    if mm is None and not soup.unit:
        notes.append(
            Note(
                "assumed",
                "1 unit of the mesh = 1 mm",
                "the file states no unit; set input.units if that is not meant",
            )
        )
    vertices, faces, named = _clean(name, soup, soup.mm if mm is None else mm, notes)
    pairs = pair_half_edges(faces)
    is_dangling = find_dangling(vertices, faces, pairs)
    if is_dangling.any():
        _note_repair(notes, int(np.count_nonzero(is_dangling)), "open")
        faces = faces[~is_dangling]
        pairs = pair_half_edges(faces)
    faces, pairs = _wind_outward(vertices, faces, pairs, notes)
    normals, flat = compute_normals(vertices, faces, pairs)
    _note_repair(notes, flat, "flat")
    units = (soup.unit or "mm") if mm is None else f"{mm:g} mm"
    faces = np.array(faces)
    faces.flags.writeable = False
    return Surface(frozen(vertices), faces, frozen(normals), pairs, units, named), notes


def _clean(
    name: str, soup: MeshSoup, mm: float, notes: list[Note]
) -> tuple[FloatArray, IntArray, NamedVertices | None]:
    """Vertices in mm, faces without degenerate and repeated ones, and the names of bodies."""
    vertices, faces = merge_equal_vertices(soup.vertices * mm, soup.faces)
    proper = drop_degenerate(faces)
    single = drop_duplicates(proper)
    welded, welds = weld_rims(vertices, single)
    _note_repair(notes, welds, "welds")
    welded = drop_duplicates(drop_degenerate(welded))
    split, junctions = split_at_junctions(vertices, welded)
    _note_repair(notes, junctions, "junctions")
    _note_repair(notes, len(faces) - len(proper) + len(single) - len(welded), "empty")
    _note_repair(notes, len(proper) - len(single), "twice")
    if not len(split):
        raise InputError(name, "has no face with an area")
    named = soup.named
    if named is not None:
        owners = np.full(len(vertices), -1)
        owners[faces] = named.owners[soup.faces]
        named = named._replace(owners=owners[select_distinct(split.reshape(-1))])
    return *drop_unused(vertices, split), named


#: Text of the note on a repair, for one face, vertex or body and for several.
_REPAIRS = {
    "welds": (
        "vertex of rims that nearly meet was welded",
        "vertices of rims that nearly meet were welded",
    ),
    "open": (
        "face without width that closes nothing was left out",
        "faces without width that close nothing were left out",
    ),
    "flat": (
        "face without width lies in the face beside it",
        "faces without width lie in the face beside them",
    ),
    "junctions": (
        "vertex on a side of a triangle that lacks it was joined to it",
        "vertices on sides of triangles that lack them were joined to them",
    ),
    "empty": ("face that has no area was left out", "faces that have no area were left out"),
    "twice": ("face that is there twice was left out", "faces that are there twice were left out"),
    "odd": (
        "face was wound against the others of its body and turned",
        "faces were wound against the others of their body and turned",
    ),
    "bodies": ("body was inside out and turned", "bodies were inside out and turned"),
}


def _note_repair(notes: list[Note], count: int, repair: str) -> None:
    if count:
        notes.append(Note("repaired", counted(count, *_REPAIRS[repair])))


def _wind_outward(
    vertices: FloatArray, faces: IntArray, pairs: Pairs, notes: list[Note]
) -> tuple[IntArray, Pairs]:
    """The faces wound with their normals outward, where inside and outside are defined.

    Connected faces are wound like the majority of them. A closed body is turned if its volume is
    negative, unless it lies within the box of another one: then it may be a void, and is turned
    together with that one.
    """
    odd = _find_minority(faces, pairs)
    bodies = tabulate_bodies(vertices, faces, pairs, odd)
    inverted = _find_inverted(vertices[faces], bodies)
    _note_repair(notes, int(np.count_nonzero(odd)), "odd")
    _note_repair(notes, int(np.count_nonzero(inverted)), "bodies")
    is_wrong = odd ^ inverted[bodies.body_of_face]
    if is_wrong.any():
        faces = np.where(is_wrong[:, None], faces[:, ::-1], faces)
        pairs = pair_half_edges(faces)
    if pairs.turned.any():
        between = "between faces that cannot be wound alike"
        count = int(pairs.turned.sum())
        what = counted(count, f"side {between} is not an edge", f"sides {between} are not edges")
        notes.append(Note("skipped", what, "inside and outside are not defined there"))
    if len(pairs.crowded):
        start, end = list_ends(faces, pairs.crowded)
        count = len(np.unique(np.sort(np.column_stack([start, end]), axis=1), axis=0))
        where = "where more than two faces meet"
        what = counted(count, f"side {where} is not an edge", f"sides {where} are not edges")
        notes.append(Note("skipped", what))
    return faces, pairs


def _find_borders(
    vertices: FloatArray, faces: IntArray, pairs: Pairs, notes: list[Note]
) -> tuple[FloatArray, ...]:
    """The lines along which the surface ends, each (N, 3) mm."""
    if not len(pairs.open):
        return ()
    start, end = list_ends(faces, pairs.open)
    length = float(np.linalg.norm(vertices[end] - vertices[start], axis=1).sum())
    sides = counted(
        len(pairs.open), f"side, {length:.6g} mm, belongs", f"sides, {length:.6g} mm, belong"
    )
    notes.append(
        Note(
            "warning",
            f"the mesh is not closed: {sides} to one face only",
            "they are borders, not edges",
        )
    )
    return tuple(frozen(vertices[row]) for row in _chain_borders(start.tolist(), end.tolist()))


def _chain_borders(start: list[int], end: list[int]) -> Iterator[list[int]]:
    """The vertices of each border in order.

    start, end: vertices of each open side.

    A border ends at the vertex where it starts, or where no unused side continues it.
    """
    leaving: dict[int, list[int]] = {}
    for a, b in zip(start, end, strict=True):
        leaving.setdefault(a, []).append(b)
    for a in start:
        while leaving[a]:
            chain = [a, leaving[a].pop()]
            while chain[-1] != a and leaving.get(chain[-1]):
                chain.append(leaving[chain[-1]].pop())
            yield chain
