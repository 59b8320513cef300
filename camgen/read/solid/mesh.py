"""Meshes (STL, OBJ, PLY, OFF, 3MF, GLB) as solids: cleaned triangles, and sharp edges as lines, arcs and circles."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.geometry.ragged import each_once
from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.model.part import FEATURE_ANGLE, BoolArray, IntArray, Note, Solid
from camgen.model.pose import FloatArray, frozen
from camgen.model.text import counted
from camgen.read.solid import topology as welding
from camgen.read.solid.bodies import NamedVertices, name_bodies, tabulate_bodies
from camgen.read.solid.edges import edges_of, order
from camgen.read.solid.mesh_file import MeshSoup, load
from camgen.read.solid.sharp import SharpSides, chain, dangling, face_normals, segments
from camgen.read.solid.tjunctions import split_at_junctions
from camgen.read.solid.topology import Pairs, components, ends, pair
from camgen.read.units import doubts

# Faces wound so that their normals point out of the part, whatever the file says.


def wrongly_wound(
    vertices: FloatArray, faces: IntArray, pairs: Pairs
) -> tuple[BoolArray, int, int]:
    """(F,) the faces to turn round, how many of them disagree with their body, and how many bodies are inside out.

    Faces that hang together are wound like the most of them. A closed body is turned if its volume is negative, unless
    it lies within the box of another one: then it may be a void, and is turned if that one is.
    """
    turn = _minority(faces, pairs)
    odd = int(np.count_nonzero(turn))
    of, volume, closed = tabulate_bodies(vertices, faces, pairs, turn)
    inverted = _invert(vertices[faces], of, volume, closed)
    return turn ^ inverted[of], odd, int(np.count_nonzero(inverted))


def _minority(faces: IntArray, pairs: Pairs) -> BoolArray:
    """(F,) faces that are wound against the most of their body.

    Every face is two nodes, as it is and turned; what agrees across an edge is linked. A body whose two halves
    come out as one cannot be told inside from outside: it is left as it is.
    """
    count = len(faces)
    turn = np.zeros(count, dtype=bool)
    if not pairs.turned.any():
        return turn
    f, g = pairs.first // 3, pairs.second // 3
    body = components(count, f, g)
    swap = np.where(pairs.turned, count, 0)
    label = components(
        2 * count, np.concatenate([f, f + count]), np.concatenate([g + swap, g + count - swap])
    )
    turn = label[:count] > label[count:]
    most = np.bincount(body, turn, count) * 2 > np.bincount(body, minlength=count)
    return np.asarray((turn ^ most[body]) & (label[:count] != label[count:]))


def _invert(corners: FloatArray, of: IntArray, volume: FloatArray, closed: BoolArray) -> BoolArray:
    """(bodies,) which closed ones are inside out: those of negative volume in no other one, and what is in them."""
    count = len(volume)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, of, corners.min(axis=1))
    np.maximum.at(high, of, corners.max(axis=1))
    inverted = np.zeros(count, dtype=bool)
    for k in np.flatnonzero(closed & (volume < 0)).tolist():
        if not (closed & (low < low[k]).all(axis=1) & (high > high[k]).all(axis=1)).any():
            inverted |= closed & (low >= low[k]).all(axis=1) & (high <= high[k]).all(axis=1)
    return inverted


#: An arc is not told from lines more coarsely than by this part of the size of the mesh.
_FINE = 1e-4
_SET_UNITS = "set input.units if that is not meant"


class Surface(Struct, frozen=True, eq=False):
    """A clean mesh: vertices (V, 3) mm, faces (F, 3) wound outward with normals (F, 3), and how they meet.

    named: names of bodies by vertex, None if the file has none.
    """

    vertices: FloatArray
    faces: IntArray
    normals: FloatArray
    pairs: Pairs
    units: str
    named: NamedVertices | None = None

    def sides(self, feature_angle: float) -> SharpSides:
        """The sides of triangles where two faces meet at more than ``feature_angle`` (rad)."""
        return segments(self.vertices, self.faces, self.normals, self.pairs, feature_angle)


def read(
    source: Source,
    mm: float | None = None,
    tolerance: float = 0.01,
    feature_angle: float = FEATURE_ANGLE,
) -> Solid:
    """The solid in a mesh file. ``InputError`` if there is none.

    mm: length of one unit of the file, None for its own, which is 1 mm for formats without one. tolerance: mm, what
    vertices may be off the arcs recognised. feature_angle: rad, sharp edges are those above it.
    """
    found = make_solid(load(source), source.stem, source.name, mm, tolerance, feature_angle)
    size = np.ptp(found.vertices, axis=0).tolist()
    return (
        found
        if mm is not None
        else replace(found, notes=(*found.notes, *doubts(size, found.units, source.name)))
    )


def make_solid(
    soup: MeshSoup,
    stem: str,
    name: str,
    mm: float | None = None,
    tolerance: float = 0.01,
    feature_angle: float = FEATURE_ANGLE,
) -> Solid:
    """The solid of triangles, wherever they are from. stem: the part's name. name: in messages. Else as ``read``."""
    mesh, notes = _surface(soup, name, mm)
    borders = _borders(mesh.vertices, mesh.faces, mesh.pairs, notes)
    sides = mesh.sides(feature_angle)
    limit = min(tolerance, _FINE * float(np.linalg.norm(np.ptp(mesh.vertices, axis=0))))
    edges = order(edges_of(chain(sides, mesh.vertices), mesh.vertices, limit))
    if edges:
        convex = int(np.count_nonzero(sides.convex))
        what = f"{convex} convex and {len(sides) - convex} concave sides of triangles are {counted(len(edges), 'edge')}"
        notes.append(Note("joined", what, f"arcs where vertices lie on one within {limit:.3g} mm"))
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


def surface(source: Source, mm: float | None = None) -> tuple[Surface, list[Note]]:
    """The mesh in ``source``, cleaned, and what was done to it. ``mm`` as in ``read``."""
    return _surface(load(source), source.name, mm)


def _surface(soup: MeshSoup, name: str, mm: float | None) -> tuple[Surface, list[Note]]:
    notes = list(soup.notes)
    if mm is None and not soup.unit:
        notes.append(
            Note("assumed", "1 unit of the mesh = 1 mm", f"the file states no unit; {_SET_UNITS}")
        )
    vertices, faces, named = _clean(name, soup, soup.mm if mm is None else mm, notes)
    pairs = pair(faces)
    useless = dangling(vertices, faces, pairs)
    if useless.any():
        _count(notes, int(np.count_nonzero(useless)), "open")
        faces = faces[~useless]
        pairs = pair(faces)
    faces, pairs = _outward(vertices, faces, pairs, notes)
    normals, flat = face_normals(vertices, faces, pairs)
    _count(notes, flat, "flat")
    units = (soup.unit or "mm") if mm is None else f"{mm:g} mm"
    faces = np.array(faces)
    faces.flags.writeable = False
    return Surface(frozen(vertices), faces, frozen(normals), pairs, units, named), notes


def _clean(
    name: str, soup: MeshSoup, mm: float, notes: list[Note]
) -> tuple[FloatArray, IntArray, NamedVertices | None]:
    """Vertices in mm, and faces that have three of them and are there once."""
    vertices, faces = welding.merge(soup.vertices * mm, soup.faces)
    proper = welding.without_degenerate(faces)
    single = welding.without_duplicates(proper)
    joined, welds = welding.weld(vertices, single)
    if welds:
        many = counted(
            welds, "vertex of rims that nearly meet was", "vertices of rims that nearly meet were"
        )
        notes.append(Note("repaired", f"{many} welded"))
    joined = welding.without_duplicates(welding.without_degenerate(joined))
    whole, split = split_at_junctions(vertices, joined)
    _count(notes, split, "junctions")
    _count(notes, len(faces) - len(proper) + len(single) - len(joined), "empty")
    _count(notes, len(proper) - len(single), "twice")
    if not len(whole):
        raise InputError(name, "has no face with an area")
    if soup.named is None:
        return *welding.drop_unused(vertices, whole), None
    owners = np.full(len(vertices), -1)
    owners[faces] = soup.named.owners[soup.faces]
    named = soup.named._replace(owners=owners[each_once(whole.reshape(-1))])
    return *welding.drop_unused(vertices, whole), named


#: What is said of faces that are mended, of one and of many.
_MENDED = {
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


def _count(notes: list[Note], count: int, what: str) -> None:
    if count:
        notes.append(Note("repaired", counted(count, *_MENDED[what])))


def _outward(
    vertices: FloatArray, faces: IntArray, pairs: Pairs, notes: list[Note]
) -> tuple[IntArray, Pairs]:
    """Faces wound with their normals outward, as far as that can be told."""
    wrong, odd, bodies = wrongly_wound(vertices, faces, pairs)
    _count(notes, odd, "odd")
    _count(notes, bodies, "bodies")
    if wrong.any():
        faces = np.where(wrong[:, None], faces[:, ::-1], faces)
        pairs = pair(faces)
    if pairs.turned.any():
        between = "between faces that cannot be wound alike"
        what = counted(
            int(pairs.turned.sum()), f"side {between} is no edge", f"sides {between} are no edges"
        )
        notes.append(Note("skipped", what, "inside and outside cannot be told apart there"))
    if len(pairs.crowded):
        start, end = ends(faces, pairs.crowded)
        count = len(np.unique(np.sort(np.column_stack([start, end]), axis=1), axis=0))
        where = "where more than two faces meet"
        what = counted(count, f"side {where} is no edge", f"sides {where} are no edges")
        notes.append(Note("skipped", what))
    return faces, pairs


def _borders(
    vertices: FloatArray, faces: IntArray, pairs: Pairs, notes: list[Note]
) -> tuple[FloatArray, ...]:
    """Lines along which the surface ends."""
    if not len(pairs.open):
        return ()
    start, end = ends(faces, pairs.open)
    chains = _border_chains(start.tolist(), end.tolist())
    length = float(np.linalg.norm(vertices[end] - vertices[start], axis=1).sum())
    sides = counted(
        len(pairs.open), f"side, {length:.6g} mm, belongs", f"sides, {length:.6g} mm, belong"
    )
    what = f"the mesh is not closed: {sides} to one face only"
    notes.append(Note("warning", what, "they are borders, not edges"))
    return tuple(frozen(vertices[chain]) for chain in chains)


def _border_chains(start: list[int], end: list[int]) -> list[list[int]]:
    """Vertices of each border in order; it ends where it comes back or another one goes on."""
    leaving: dict[int, list[int]] = {}
    for a, b in zip(start, end, strict=True):
        leaving.setdefault(a, []).append(b)
    chains = []
    for a in start:
        while leaving[a]:
            chain = [a, leaving[a].pop()]
            while chain[-1] != a and leaving.get(chain[-1]):
                chain.append(leaving[chain[-1]].pop())
            chains.append(chain)
    return chains
