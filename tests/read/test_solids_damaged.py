"""Damaged meshes are repaired with a note, or refused in one line that names the fault."""

import struct
from collections import Counter
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from camgen.model.errors import InputError
from camgen.model.part import Solid
from camgen.read.solid import mesh
from tests.read.test_solids_mesh import binary_stl, kinds, list_notes, read
from tests.support.files import source

Array = NDArray[np.float64]

#: Corners of a block of 30 x 20 x 10, by z, y and x, and its faces, counter-clockwise from outside.
CORNERS = np.array(list(product((0, 10), (0, 20), (0, 30))), dtype=float)[:, ::-1]
FACES = np.array(
    [
        *([0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4]),
        *([2, 6, 7], [2, 7, 3], [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5]),
    ]
)


def block() -> Array:
    return CORNERS[FACES]


def assert_is_the_block(solid: Solid) -> None:
    assert kinds(solid) == {("line", True): 12}
    assert sum(edge.length for edge in solid.edges) == pytest.approx(240)
    middle = solid.vertices[solid.faces].mean(axis=1) - [15, 10, 5]
    assert (np.einsum("fi,fi->f", middle, solid.normals) > 0).all()


def test_duplicate_and_degenerate_faces_are_dropped(tmp_path: Path) -> None:
    line = np.array([[[0, 0, 0], [0, 0, 0], [30, 0, 0]]])
    solid = read(tmp_path, np.concatenate([block(), block()[2:5], block()[3:4, ::-1], line]))
    assert_is_the_block(solid)
    assert "4 faces that are there twice" in list_notes(solid)
    assert "1 face that has no area" in list_notes(solid)
    assert len(solid.faces) == 12


def test_a_face_without_width_that_closes_a_gap_is_kept_and_makes_no_edge(tmp_path: Path) -> None:
    # The front is divided at (12, 0, 0), the bottom is not. The sliver between them has no area.
    front = [
        [[0, 0, 0], [12, 0, 0], [0, 0, 10]],
        [[12, 0, 0], [30, 0, 10], [0, 0, 10]],
        [[12, 0, 0], [30, 0, 0], [30, 0, 10]],
    ]
    sliver = [[[0, 0, 0], [30, 0, 0], [12, 0, 0]]]
    solid = read(tmp_path, np.concatenate([np.delete(block(), [4, 5], axis=0), front, sliver]))
    assert_is_the_block(solid)
    assert not solid.borders
    assert "1 face without width" in list_notes(solid)


def test_a_face_without_width_that_closes_nothing_is_dropped(tmp_path: Path) -> None:
    flap = [[[0, 0, 0], [30, 0, 0], [12, 0, 0]]]  # The third face at an edge.
    solid = read(tmp_path, np.concatenate([block(), flap]))
    assert_is_the_block(solid)
    assert not solid.borders
    assert "1 face without width that closes nothing" in list_notes(solid)


@pytest.mark.parametrize("reversed_faces", [[0], [0, 5, 7], [1, 2, 3, 4, 5, 6, 8, 9, 10, 11]])
def test_faces_with_reversed_winding_are_corrected(
    tmp_path: Path, reversed_faces: list[int]
) -> None:
    triangles = block()
    triangles[reversed_faces] = triangles[reversed_faces][:, ::-1]
    solid = read(tmp_path, triangles)
    assert_is_the_block(solid)
    assert "wound against the others" in list_notes(solid)


def test_a_body_inside_out_is_corrected_with_its_void(tmp_path: Path) -> None:
    void = block() * 0.3 + [10, 7, 3]
    assert_is_the_block(read(tmp_path, block()[:, ::-1]))
    sound = read(tmp_path, np.concatenate([block(), void[:, ::-1]]))
    assert Counter(edge.convex for edge in sound.edges) == {True: 12, False: 12}
    assert "inside out" not in list_notes(sound)
    inverted = read(tmp_path, np.concatenate([block()[:, ::-1], void]))
    assert Counter(edge.convex for edge in inverted.edges) == {True: 12, False: 12}
    assert "2 bodies were inside out" in list_notes(inverted)


def test_an_open_border_is_not_an_edge(tmp_path: Path) -> None:
    solid = read(tmp_path, np.delete(block(), [2, 3], axis=0))
    assert kinds(solid) == {("line", True): 8}
    (border,) = solid.borders
    assert np.allclose(border[0], border[-1])
    assert np.linalg.norm(np.diff(border, axis=0), axis=1).sum() == pytest.approx(100)
    assert np.allclose(border[:, 2], 10)
    assert "the mesh is not closed: 4 sides, 100 mm" in list_notes(solid)


def test_borders_that_nearly_meet_are_welded(tmp_path: Path) -> None:
    triangles = block()
    triangles[2:4] += [1e-4, -1e-4, 1e-4]
    solid = read(tmp_path, triangles)
    assert kinds(solid) == {("line", True): 12}
    assert "4 vertices of rims" in list_notes(solid)
    is_top = np.arange(12)[:, None, None] // 2 == 1
    separate = read(tmp_path, triangles + np.where(is_top, 0.1, 0.0))
    assert len(separate.edges) == 8


def test_two_blocks_that_share_an_edge_keep_their_other_edges(tmp_path: Path) -> None:
    solid = read(tmp_path, np.concatenate([block(), block() + np.array([30, 20, 0])]))
    assert len(solid.edges) == 22
    assert "skipped: 1 side where more than two faces meet" in list_notes(solid)


def test_bytes_after_the_last_face_are_left_out(tmp_path: Path) -> None:
    path = tmp_path / "part.stl"
    path.write_bytes(b"solid of a program that lies" + binary_stl(block())[28:] + b"\x00")
    solid = mesh.read(source(path))
    assert_is_the_block(solid)
    assert "1 byte after the last face" in list_notes(solid)


def ascii_stl(corner: str) -> str:
    """The block as text. The first corner of the fourth face is `corner`, unless that is empty."""
    text = "solid x\n"
    for k, face in enumerate(block().tolist()):
        lines = [" ".join(map(str, point)) for point in face]
        lines[0] = corner if k == 3 and corner else lines[0]
        vertices = "".join(f"vertex {line}\n" for line in lines)
        text += f"facet normal 0 0 0\nouter loop\n{vertices}endloop\nendfacet\n"
    return text + "endsolid x\n"


def test_a_text_stl_is_read_like_a_binary_one(tmp_path: Path) -> None:
    (tmp_path / "part.stl").write_text(" " + ascii_stl(""))
    assert_is_the_block(mesh.read(source(tmp_path / "part.stl")))


def infinite_binary() -> bytes:
    triangles = block()
    triangles[4, 1, 2] = np.inf
    return binary_stl(triangles)


REFUSED = {
    "numbers.stl": (
        infinite_binary(),
        "that are not numbers, or too large (the first is face 5)",
    ),
    "text.stl": (
        ascii_stl("nan 0 0").encode(),
        "that are not numbers, or too large (the first is face 4)",
    ),
    "short.stl": (infinite_binary()[:300], "the file ends before its last face, 4 of 12 are there"),
    "empty.stl": (b"", "the file is empty"),
    "none.stl": (b"solid a\nendsolid a\n", "has no faces"),
    "words.stl": (b"this is a letter about a part, it is no mesh at all", "is not an STL mesh"),
    "letter.stl": (b"this is a longer letter about a part, " * 9, "is not an STL mesh"),
    "points.obj": (b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", "has no faces"),
    "lost.off": (b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 9\n", "damaged or no OFF mesh"),
    "flat.stl": (bytes(80) + struct.pack("<I", 1) + bytes(50), "has no face with an area"),
    "cut.ply": (b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n", "PLY"),
    "cut.glb": (b"glTF\x02\x00\x00\x00", "damaged or no GLB mesh"),
    "cut.3mf": (b"PK\x03\x04 and then nothing", "3MF"),
    "part.fbx": (b"Kaydara", "is not a kind of mesh that camgen reads"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_mesh_that_cannot_be_read_is_refused_in_one_line(tmp_path: Path, name: str) -> None:
    data, message = REFUSED[name]
    (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError) as caught:
        mesh.read(source(tmp_path / name))
    text = str(caught.value)
    assert message in text
    assert text.startswith(name)
    assert "\n" not in text


def test_a_folder_and_a_missing_file_are_refused(tmp_path: Path) -> None:
    (tmp_path / "folder.stl").mkdir()
    with pytest.raises(InputError, match="is a folder"):
        mesh.read(source(tmp_path / "folder.stl"))
    with pytest.raises(InputError, match="no such file"):
        mesh.read(source(tmp_path / "none.stl"))
