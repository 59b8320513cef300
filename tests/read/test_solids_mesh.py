"""The sharp edges of a mesh have the kinds, lengths, normals and convexity of its part."""

import math
import struct
import subprocess
import sys
from collections import Counter
from io import BytesIO
from itertools import pairwise, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from camgen.model.errors import InputError
from camgen.model.part import Edge, Solid
from camgen.model.pose import rotation_from_quaternion
from camgen.read.files import Files
from camgen.read.solid import mesh
from camgen.read.solid.mesh_file import read_mesh
from camgen.read.solid.ply import unroll
from tests.support.files import source

Array = NDArray[np.float64]
SHARED = Path(__file__).parents[2].parent / "shared" / "data"
L_PROFILE = [(0, 0), (40, 0), (40, 10), (15, 10), (15, 30), (0, 30)]


def extruded(outline: Any, height: float, holes: Any = ()) -> Array:
    """Triangles of a prism. Its outline runs counter-clockwise, its holes clockwise."""
    polygon = shapely.Polygon(outline, holes)
    triangles = shapely.constrained_delaunay_triangles(polygon).geoms
    flat = np.array([triangle.exterior.coords[:3] for triangle in triangles])
    u, v = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    flat = np.where((u[:, 0] * v[:, 1] > u[:, 1] * v[:, 0])[:, None, None], flat, flat[:, ::-1])
    top = np.concatenate([flat, np.full((*flat.shape[:2], 1), height)], axis=2)
    faces = [top, (top * [1, 1, 0])[:, ::-1]]
    for loop in (outline, *holes):
        a = np.column_stack([loop, np.zeros(len(loop))])
        b, up = np.roll(a, -1, axis=0), np.array([0, 0, height])
        faces += [np.stack([a, b, b + up], axis=1), np.stack([a, b + up, a + up], axis=1)]
    return np.concatenate(faces)


def ring(x: float, y: float, radius: float, sides: int) -> Array:
    angle = np.arange(sides) * 2 * np.pi / sides
    return np.column_stack([x + radius * np.cos(angle), y + radius * np.sin(angle)])


def block() -> Array:
    return extruded([(0, 0), (30, 0), (30, 20), (0, 20)], 10)


def binary_stl(triangles: Array) -> bytes:
    rows = np.zeros(len(triangles), dtype=[("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    rows["v"] = triangles
    return bytes(80) + struct.pack("<I", len(rows)) + rows.tobytes()


def read(tmp_path: Path, triangles: Array, **options: Any) -> Solid:
    (tmp_path / "part.stl").write_bytes(binary_stl(triangles))
    return mesh.read(source(tmp_path / "part.stl"), **options)


def kinds(solid: Solid) -> Counter[tuple[str, bool]]:
    """Number of edges of each kind, with whether they are convex."""
    return Counter((edge.kind, edge.convex) for edge in solid.edges)


def list_notes(solid: Solid) -> str:
    return "; ".join(map(str, solid.notes))


def assert_sound(edge: Edge) -> None:
    """The normals, the convexity and the closedness of an edge must agree with its geometry."""
    chords = np.diff(edge.points, axis=0)
    assert np.allclose(np.linalg.norm(edge.normals, axis=2), 1)
    assert np.allclose(np.linalg.norm(edge.via_normals, axis=2), 1)
    bend = np.einsum("ni,ni->n", np.cross(edge.via_normals[:, 0], edge.via_normals[:, 1]), chords)
    assert ((bend > 0) == edge.convex).all()
    assert edge.closed == bool((edge.points[0] == edge.points[-1]).all())


def test_a_block_has_twelve_lines_with_the_normals_of_its_faces(tmp_path: Path) -> None:
    solid = read(tmp_path, block())
    assert kinds(solid) == {("line", True): 12}
    assert [e.id for e in solid.edges] == [f"e{i}" for i in range(1, 13)]
    assert sorted(round(e.length, 6) for e in solid.edges) == [10] * 4 + [20] * 4 + [30] * 4
    for edge in solid.edges:
        assert_sound(edge)
        assert len(edge.points) == 2
        assert edge.angle == pytest.approx(math.pi / 2)
        for normal in edge.normals.reshape(-1, 3):
            # The edge lies in the face with this normal: no vertex is farther in its direction.
            assert np.allclose(edge.points @ normal, (solid.vertices @ normal).max(), atol=1e-5)
    heights = [e.points[:, 2].mean() for e in solid.edges]
    assert heights == sorted(heights, reverse=True)
    assert solid.normals.shape == solid.faces.shape == (12, 3)
    assert "1 unit of the mesh = 1 mm" in list_notes(solid)


def test_a_tessellated_cylinder_has_two_circles_of_its_radius(tmp_path: Path) -> None:
    solid = read(tmp_path, extruded(ring(5, 7, 12.5, 40), 9))
    assert kinds(solid) == {("circle", True): 2}
    for edge in solid.edges:
        assert_sound(edge)
        assert edge.closed
        assert edge.radius == pytest.approx(12.5, abs=1e-5)
        assert edge.length == pytest.approx(2 * math.pi * 12.5, abs=1e-4)
        for points, normals in ((edge.points, edge.normals), (edge.via, edge.via_normals)):
            from_axis = points - [5, 7, points[0, 2]]
            assert np.allclose(np.linalg.norm(from_axis, axis=1), 12.5, atol=1e-5)
            (radial,) = (normals[:, k] for k in (0, 1) if abs(normals[0, k, 2]) < 0.5)
            assert np.allclose(radial, from_axis / 12.5, atol=1e-5)
        centre = np.array([5, 7, edge.points[0, 2]])
        assert np.allclose(edge.via[0], 2 * centre - edge.via[1], atol=1e-4)


@pytest.mark.parametrize("sides", [9, 12, 36, 300])
def test_a_hole_of_any_number_of_sides_is_a_circle(tmp_path: Path, sides: int) -> None:
    hole = ring(20, 15, 6, sides)[::-1]
    plate = extruded([(0, 0), (40, 0), (40, 30), (0, 30)], 5, [hole])
    solid = read(tmp_path, plate, feature_angle=math.radians(45))
    assert kinds(solid) == {("line", True): 12, ("circle", True): 2}
    for edge in (edge for edge in solid.edges if edge.kind == "circle"):
        assert edge.radius == pytest.approx(6, abs=1e-5)
        wall = edge.normals[:, int(abs(edge.normals[0, 0, 2]) > 0.5)]
        # The normal of the wall points from the material to the axis of the hole.
        assert np.allclose(wall * [6, 6, 0], [20, 15, 0] - edge.points * [1, 1, 0], atol=1e-4)


def test_an_l_shape_has_one_concave_edge(tmp_path: Path) -> None:
    solid = read(tmp_path, extruded(L_PROFILE, 25))
    assert kinds(solid) == {("line", True): 17, ("line", False): 1}
    (inner,) = (edge for edge in solid.edges if not edge.convex)
    assert_sound(inner)
    assert np.allclose(inner.points[:, :2], [15, 10], atol=1e-5)
    assert inner.angle == pytest.approx(math.pi / 2)


@given(
    st.lists(st.floats(-1, 1), min_size=4, max_size=4),
    st.lists(st.floats(-80, 80), min_size=3, max_size=3),
)
@settings(max_examples=15)
def test_the_edges_of_a_moved_part_are_moved_with_it(
    tmp_path_factory: Any, turn: list[float], move: list[float]
) -> None:
    if math.hypot(*turn) < 0.1:
        turn = [1.0, 0.0, 0.0, 0.0]
    rotation = rotation_from_quaternion(turn)
    triangles = extruded(L_PROFILE, 25, [ring(7, 22, 4, 24)[::-1]])
    solid = read(tmp_path_factory.mktemp("tilted"), triangles @ rotation.T + move)
    assert kinds(solid) == {("line", True): 17, ("line", False): 1, ("circle", True): 2}
    for edge in solid.edges:
        assert_sound(edge)
        assert edge.angle == pytest.approx(math.pi / 2, abs=1e-4)
    (inner,) = (edge for edge in solid.edges if not edge.convex)
    back = (inner.points - move) @ rotation
    assert np.allclose(np.sort(back[:, 2]), [0, 25], atol=1e-4)
    assert np.allclose(back[:, :2], [15, 10], atol=1e-4)


def test_a_rounded_plate_is_lines_and_arcs(tmp_path: Path) -> None:
    corners = [(34, 24, 0), (6, 24, 1), (6, 6, 2), (34, 6, 3)]
    angles = np.linspace(0, np.pi / 2, 10)
    arcs = []
    for x, y, quarters in corners:
        angle = angles + quarters * np.pi / 2
        arcs.append([x, y] + 6 * np.column_stack([np.cos(angle), np.sin(angle)]))
    solid = read(tmp_path, extruded(np.concatenate(arcs), 4))
    assert kinds(solid) == {("line", True): 8, ("arc", True): 8}
    for edge in solid.edges:
        assert_sound(edge)
        assert len(edge.points) == 2
        if edge.kind == "arc":
            assert edge.radius == pytest.approx(6, abs=1e-4)
            assert edge.length == pytest.approx(3 * math.pi, abs=1e-4)
        else:
            is_along_x = abs(np.ptp(edge.points[:, 0])) > 1
            assert edge.length == pytest.approx(28 if is_along_x else 18, abs=1e-4)


def test_a_vertex_of_another_face_on_the_rim_of_a_hole_does_not_change_its_normals(
    tmp_path: Path,
) -> None:
    """Two of 36 sides are divided near an end, where the circle has 4 deg against their faces."""
    angles = np.arange(36) * (math.tau / 36)
    corners = np.column_stack([np.cos(angles), np.sin(angles)])
    circle: list[Array] = []
    for k, corner in enumerate(corners):
        circle.append(corner)
        if k in (4, 22):
            circle.append(0.9 * corner + 0.1 * corners[k + 1])
    flat = np.array(circle)
    sections = [(3, 0), (3, 5), (10, 5), (10, 0), (3, 0)]
    rings = [np.column_stack([r * flat, np.full(len(flat), z)]) for r, z in sections]
    triangles = []
    for low, high in pairwise(rings):
        for k in range(len(flat)):
            after = (k + 1) % len(flat)
            triangles += [(low[k], high[k], high[after]), (low[k], high[after], low[after])]
    solid = read(tmp_path, np.array(triangles)[:, ::-1])
    assert kinds(solid) == {("circle", True): 4}
    for edge in solid.edges:
        assert_sound(edge)
        # The edge has two half circles, like that of a mesh without such vertices.
        assert len(edge.points) == 3
        radial = edge.points[:, :2] / np.linalg.norm(edge.points[:, :2], axis=1)[:, None]
        side = 1 if edge.radius > 5 else -1
        walls = [normal for normal in np.swapaxes(edge.normals, 0, 1) if abs(normal[0, 2]) < 0.5]
        assert np.allclose(walls[0][:, :2], side * radial, atol=2e-3)


def test_the_order_of_faces_does_not_matter(tmp_path: Path) -> None:
    triangles = extruded(L_PROFILE, 25, [ring(7, 22, 4, 24)[::-1]])
    shuffled = np.random.default_rng(1).permutation(np.roll(triangles, 1, axis=1))
    first, second = read(tmp_path, triangles), read(tmp_path, shuffled)
    for a, b in zip(first.edges, second.edges, strict=True):
        assert (a.id, a.kind, a.convex) == (b.id, b.kind, b.convex)
        assert np.allclose(a.points, b.points, atol=1e-6)
        assert np.allclose(a.via_normals, b.via_normals, atol=1e-6)


def test_the_feature_angle_decides_which_edges_are_sharp(tmp_path: Path) -> None:
    prism = extruded(ring(0, 0, 10, 10), 5)  # The normals at upright edges differ by 36 deg.
    assert kinds(read(tmp_path, prism)) == {("line", True): 30}
    assert kinds(read(tmp_path, prism, feature_angle=math.radians(37))) == {("circle", True): 2}


def test_units_scale_the_part(tmp_path: Path) -> None:
    solid = read(tmp_path, block(), mm=25.4)
    assert max(edge.length for edge in solid.edges) == pytest.approx(30 * 25.4)
    assert "assumed: 1 unit" not in list_notes(solid)


@pytest.mark.parametrize(
    ("kind", "scale"), [("obj", 1), ("ply", 1), ("off", 1), ("glb", 1000), ("3mf", 1)]
)
def test_each_format_of_meshes_gives_the_same_edges(
    tmp_path: Path, kind: str, scale: float
) -> None:
    if kind == "3mf":
        pytest.importorskip("lxml", reason="trimesh writes 3MF with lxml")
        pytest.importorskip("networkx", reason="trimesh writes 3MF with networkx")
    shape = trimesh.Trimesh(*_indexed(extruded(L_PROFILE, 25)))
    shape.units = "mm"
    path = tmp_path / f"part.{kind}"
    shape.export(path)
    solid = mesh.read(source(path))
    assert kinds(solid) == {("line", True): 17, ("line", False): 1}
    assert sum(edge.length for edge in solid.edges) == pytest.approx((2 * 140 + 6 * 25) * scale)


def test_a_mesh_with_materials_is_read_without_the_package_for_pictures(tmp_path: Path) -> None:
    """The faces have materials, and positions on the pictures of these."""
    (tmp_path / "wall.obj").write_text(
        "v 0 0 0\nv 10 0 0\nv 10 10 0\nv 0 10 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
        "usemtl brick\nf 1/1 2/2 3/3\nusemtl stone\nf 1/1 3/3 4/4\n"
    )
    code = (
        "import sys; sys.modules['PIL'] = None; from camgen.read.files import Files;"
        "from camgen.read.solid import mesh;"
        "print(len(mesh.read(Files().read('wall.obj')).faces))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.stdout, done.stderr) == ("2\n", "")


def _indexed(triangles: Array) -> tuple[Array, Any]:
    return triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3)


def test_a_shared_part_has_the_circles_of_its_exact_twin() -> None:
    path = SHARED / "mesh" / "trimesh" / "featuretype.STL"
    if not path.exists():
        pytest.skip("shared/data/mesh/trimesh/featuretype.STL is not beside the repository")
    solid = mesh.read(source(path), mm=25.4)
    circles = [edge for edge in solid.edges if edge.kind == "circle"]
    assert Counter(edge.convex for edge in circles) == {True: 26, False: 8}
    # The radii (inch) in the exact part featuretype.STEP.
    stated = sorted([0.133] * 16 + [0.1947] * 2 + [0.21875] * 16)
    assert np.allclose(sorted(edge.radius / 25.4 for edge in circles), stated, atol=1e-4)


#: A block of 30 x 20 x 10, with its corners by z, y and x. The first list is a strip of the four
#: sides. The second list holds the strips of bottom and top.
STRIPS = [[4, 0, 5, 1, 7, 3, 6, 2, 4, 0], [1, 0, 3, 2, -1, 4, 5, 6, 7]]


def strips(rows: list[list[int]], binary: bool) -> bytes:
    """A PLY file of the block, as text or binary, with strips of triangles."""
    corners = [(x, y, z) for z, y, x in product((0, 10), (0, 20), (0, 30))]
    head = [
        "ply",
        f"format {'binary_little_endian' if binary else 'ascii'} 1.0",
        "comment as scanners write it",
        "element vertex 8",
        "property float x",
        "property float y",
        "property float z",
        f"element tristrips {len(rows)}",
        "property list int int vertex_indices",
        "end_header\n",
    ]
    lists = [[len(row), *row] for row in rows]
    if binary:
        body = b"".join(struct.pack("<3f", *corner) for corner in corners)
        body += b"".join(struct.pack(f"<{len(numbers)}i", *numbers) for numbers in lists)
    else:
        body = "".join(
            " ".join(map(str, numbers)) + "\n" for numbers in (*corners, *lists)
        ).encode()
    return "\n".join(head).encode() + body


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("rows", [STRIPS, [[*STRIPS[0], -1, *STRIPS[1], -1]]])
def test_strips_of_triangles_are_faces(tmp_path: Path, rows: list[list[int]], binary: bool) -> None:
    (tmp_path / "part.ply").write_bytes(strips(rows, binary))
    solid = mesh.read(source(tmp_path / "part.ply"))
    assert kinds(solid) == {("line", True): 12}
    assert len(solid.faces) == 12
    assert solid.borders == ()
    # No face was reversed or dropped.
    assert "repaired" not in list_notes(solid)


def test_strips_may_follow_faces_and_a_strip_that_is_cut_off_is_refused(tmp_path: Path) -> None:
    faces = b"element face 2\nproperty list uchar int vertex_index\n"
    data = strips([STRIPS[0]], False).replace(b"element tristrips", faces + b"element tristrips")
    corners, strip = data.rsplit(b"\n10 ", 1)
    (tmp_path / "part.ply").write_bytes(corners + b"\n4 0 2 3 1\n4 4 5 7 6\n10 " + strip)
    solid = mesh.read(source(tmp_path / "part.ply"))
    assert (kinds(solid), len(solid.faces)) == ({("line", True): 12}, 12)
    for binary in (False, True):
        (tmp_path / "part.ply").write_bytes(strips(STRIPS, binary)[:-5])
        with pytest.raises(
            InputError, match=r"part\.ply: is damaged or no PLY mesh: .*; export it again"
        ):
            mesh.read(source(tmp_path / "part.ply"))


def test_every_second_triangle_of_a_strip_is_reversed() -> None:
    strip = np.array([0, 1, 2, 3, 3, 9, 4, -1, 5, 6, 7, 8])
    assert unroll(strip).tolist() == [[0, 1, 2], [2, 1, 3], [3, 9, 4], [5, 6, 7], [7, 6, 8]]
    assert unroll(strip[:2]).shape == (0, 3)


@pytest.mark.parametrize(
    ("mm", "warning"),
    [
        (
            0.005,
            "warning: the part is 0.15 x 0.1 x 0.05 mm, which is small "
            "(drawn in mm, likely in m; set input.units",
        ),
        (
            300.0,
            "warning: the part is 9000 x 6000 x 3000 mm, which is large "
            "(drawn in mm, likely in um; set input.units",
        ),
        (1.0, ""),
    ],
)
def test_an_implausible_size_is_a_warning(tmp_path: Path, mm: float, warning: str) -> None:
    warnings = [str(note) for note in read(tmp_path, block() * mm).notes if note.kind == "warning"]
    assert warnings[0].startswith(warning) if warning else not warnings
    # There is no warning if the unit is given.
    assert "which is" not in list_notes(read(tmp_path, block(), mm=mm))


def test_a_binary_stl_is_read_as_by_trimesh() -> None:
    source = Files().read(Path(__file__).parents[2] / "fixtures" / "parts" / "rfa2.stl")
    by_trimesh = trimesh.load(BytesIO(source.data), file_type="stl", process=False)
    by_camgen = read_mesh(source)
    assert np.array_equal(by_camgen.vertices, by_trimesh.vertices)
    assert np.array_equal(by_camgen.faces, by_trimesh.faces)
    assert (by_camgen.unit, by_camgen.mm) == ("", 1.0)
