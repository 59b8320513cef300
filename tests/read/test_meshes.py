"""Mesh files in all their spellings have the bodies and edges of formulas, or are refused."""

import json
from itertools import pairwise

import numpy as np
import pytest

import camgen
from bench.read import meshes
from camgen.cli import main
from camgen.model.errors import InputError
from camgen.model.part import describe_bodies
from camgen.read.solid import glb
from camgen.read.solid.polygons import triangulate_polygons
from tests.read.test_solids_mesh import binary_stl

BODIES = meshes.make_bodies(1)


def read(path, data):
    path.write_bytes(data)
    return camgen.read(path).solid


def area(vertices, faces):
    first, second, third = (vertices[faces[:, k]] for k in range(3))
    return np.cross(second - first, third - first) / 2


@pytest.mark.parametrize("number", range(len(meshes.SPELLINGS)))
def test_every_spelling_has_the_edges_of_the_formula(number, tmp_path):
    spelling = meshes.SPELLINGS[number]
    kind, text = meshes.compare_file(meshes.make_bodies(number), spelling, tmp_path)
    if spelling.damaged:
        assert kind in ("reported", "refused")
    elif spelling.name == "unknown extension":
        assert text.removeprefix(f"{tmp_path}/") == (
            "part.glb: requires the extension EXT_of_somebody, which is not read; "
            "export it again from the CAD program"
        )
    else:
        assert kind == "right"


def test_a_concave_polygon_keeps_its_area():
    """The polygon is an L of 3 squares. A fan from its first corner would cover 5 squares."""
    outline = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
    for first in range(6):
        points = np.array([(x, y, 0.0) for x, y in outline[first:] + outline[:first]])
        faces = triangulate_polygons(points, [np.arange(6)[None]]).faces
        normals = area(points, faces)
        assert len(faces) == 4
        assert (normals[:, 2] > 0).all()
        assert normals[:, 2].sum() == pytest.approx(3.0)


def test_a_hole_that_a_bridge_connects_to_the_outline_stays_open():
    """The outline of a square of 4 runs along a bridge, around a hole of 2, and back."""
    outline = [(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1)]
    points = np.array([(x, y, 0.0) for x, y in outline])
    faces = triangulate_polygons(points, [np.arange(10)[None]]).faces
    assert area(points, faces)[:, 2].sum() == pytest.approx(16.0 - 4.0)


def test_a_polygon_that_crosses_itself_is_left_out_by_name():
    points = np.array([(0, 0, 0), (2, 2, 0), (2, 0, 0), (0, 1, 0)], dtype=float)
    triangles = triangulate_polygons(points, [np.arange(4)[None]])
    assert len(triangles.faces) == 0
    assert str(triangles.notes[0]) == "skipped: 1 face left out (the outline crosses itself)"


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("a.stl", meshes.write_stl(BODIES)[:-60], "the file is cut off (facet"),
        (
            "a.obj",
            b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 0\n",
            "a face names a vertex that is not there",
        ),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nf 1 2 -3\n", "a face names a vertex that is not there"),
        ("a.off", b"4OFF\n0 0 0\n", "is 4OFF, which is not read"),
        ("a.off", b"OFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "it ends before its last face"),
        ("a.ply", meshes.write_ply(BODIES, "<")[:-3], "buffer is smaller than requested size"),
    ],
)
def test_a_damaged_mesh_is_refused_in_one_line(name, data, message, tmp_path):
    with pytest.raises(InputError) as error:
        read(tmp_path / name, data)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def write_model(resources, items, more=""):
    head = f'<model unit="millimeter" {meshes._CORE} {meshes._PRODUCTION} {more}>'
    return f"{head}<resources>{resources}</resources><build>{items}</build></model>"


BOX_CORNERS, BOX_FACES, BOX_TRIANGLES = meshes.make_prism(
    [(0, 0), (10, 0), (10, 20), (0, 20)], 30.0
)
BOX = meshes.make_bodies(1)[0]._replace(
    corners=BOX_CORNERS,
    faces=BOX_FACES,
    triangles=BOX_TRIANGLES,
)


def test_an_item_may_name_another_part_of_the_archive(tmp_path):
    files = {
        "3D/3dmodel.model": write_model(
            "",
            '<item p:path="/3D/A.model" objectid="1"/>'
            '<item p:path="/3D/A.model" objectid="1" transform="-1 0 0 0 1 0 0 0 1 -5 0 0"/>',
        ),
        "3D/A.model": write_model(meshes.write_object(BOX, 1) + meshes.write_object(BOX, 2), ""),
    }
    solid = read(tmp_path / "a.3mf", meshes.pack_3mf(files))
    # The second box is mirrored, from x = 0 to 10 to x = -15 to -5.
    assert np.ptp(solid.vertices, axis=0).tolist() == [25.0, 20.0, 30.0]
    assert len(solid.edges) == 24
    assert all(edge.convex for edge in solid.edges)


def test_components_that_contain_each_other_are_refused(tmp_path):
    loop = (
        '<object id="1"><components><component objectid="2"/></components></object>'
        '<object id="2"><components><component objectid="1"/></components></object>'
    )
    files = {"3D/3dmodel.model": write_model(loop, '<item objectid="1"/>')}
    with pytest.raises(InputError, match="components contain each other"):
        read(tmp_path / "a.3mf", meshes.pack_3mf(files))


def test_a_required_extension_is_refused_by_name(tmp_path):
    lattice = 'xmlns:b="http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02"'
    model = write_model(
        meshes.write_object(BOX, 1), '<item objectid="1"/>', f'{lattice} requiredextensions="b"'
    )
    with pytest.raises(InputError) as error:
        read(tmp_path / "a.3mf", meshes.pack_3mf({"3D/3dmodel.model": model}))
    assert "beamlattice/2017/02, which is not read" in str(error.value)


def test_a_support_of_a_build_is_left_out_by_name(tmp_path):
    support = meshes.write_object(BOX, 2).replace('type="model"', 'type="support"')
    items = '<item objectid="1"/><item objectid="2" transform="1 0 0 0 1 0 0 0 1 50 0 0"/>'
    model = write_model(meshes.write_object(BOX, 1) + support, items)
    solid = read(tmp_path / "a.3mf", meshes.pack_3mf({"3D/3dmodel.model": model}))
    assert len(solid.edges) == 12
    assert any("1 object of the build left out" in note.what for note in solid.notes)


def test_instances_of_a_glb_are_refused_though_they_are_optional(tmp_path):
    data = meshes.write_glb([BOX], "EXT_mesh_gpu_instancing")
    with pytest.raises(InputError, match="has instances of meshes, the extension EXT_mesh_gpu"):
        read(tmp_path / "a.glb", data)


def make_rotation(seed):
    """A random rotation (3, 3)."""
    rotation, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return rotation * np.sign(np.linalg.det(rotation))


@pytest.mark.parametrize("seed", range(6))
def test_t_junctions_are_closed(seed, tmp_path):
    """The top of a box has vertices that its neighbours lack. The box has 12 edges all the same."""
    corners = BOX.corners[np.array(BOX.triangles)]
    is_top = (corners[:, :, 2] == 30).all(axis=1)
    cuts = np.array([0.0, 2.5, 4.0, 10.0])
    strips = []
    for low, high in pairwise(cuts):
        a, b, c, d = [(low, 0, 30), (high, 0, 30), (high, 20, 30), (low, 20, 30)]
        strips += [(a, b, c), (a, c, d)]
    triangles = np.concatenate([corners[~is_top], np.array(strips, dtype=float)])
    solid = read(tmp_path / "box.stl", binary_stl(triangles @ make_rotation(seed)))
    assert len(solid.edges) == 12
    assert not solid.borders
    notes = [str(note) for note in solid.notes if note.kind == "repaired"]
    assert notes == [
        "repaired: 4 vertices on sides of triangles that lack them were joined to them"
    ]


@pytest.mark.parametrize("seed", range(6))
def test_walls_at_30_degrees_are_smooth_in_any_rotation(seed, tmp_path):
    """The walls of a prism over a polygon of 12 corners meet at 30.000 deg."""
    angles = np.arange(12) * np.pi / 6
    outline = [(20 * np.cos(a), 20 * np.sin(a)) for a in angles]
    points, _, triangles = meshes.make_prism(outline, 8.0)
    corners = points[np.array(triangles)] @ make_rotation(seed)
    solid = read(tmp_path / "prism.stl", binary_stl(corners))
    assert [edge.kind for edge in solid.edges] == ["circle", "circle"]


NAMES = ("left", "right")
BOXES = [BOX, BOX._replace(corners=BOX.corners + np.array([30.0, 0.0, 0.0]))]


def write_named_obj(word="o", first="v"):
    """Two boxes with the names `NAMES`. All vertices come first, or those of each box before it."""
    vertices, faces = [], []
    for number, (name, body) in enumerate(zip(NAMES, BOXES, strict=True)):
        vertices.append("".join("v {:g} {:g} {:g}\n".format(*row) for row in body.corners))
        polygons = [np.array(face) + 1 + 8 * number for face in body.faces]
        rows = ["f " + " ".join(map(str, polygon)) for polygon in polygons]
        faces.append("\n".join([f"{word} {name}", *rows, ""]))
    rows = [*vertices, *faces] if first == "v" else [vertices[0], faces[0], vertices[1], faces[1]]
    return "".join(rows).encode()


def write_named_3mf():
    objects = "".join(
        meshes.write_object(body, number).replace("<object ", f'<object name="{name}" ')
        for number, (name, body) in enumerate(zip(NAMES, BOXES, strict=True))
    )
    items = '<item objectid="0"/><item objectid="1"/>'
    return meshes.pack_3mf({"3D/3dmodel.model": write_model(objects, items)})


def write_named_stl():
    parts = [meshes.write_stl([body]) for body in BOXES]
    return b"".join(p.replace(b"body0", n.encode()) for p, n in zip(parts, NAMES, strict=True))


def write_named_glb():
    """Two boxes whose nodes get the names `NAMES`, which the writer of GLB lacks."""
    data = meshes.write_glb(BOXES)
    document, body = glb.split_glb(data)
    for node, name in zip(document["nodes"], NAMES, strict=True):
        node["name"] = name
    return glb._join(document, body)


@pytest.mark.parametrize(
    ("name", "data", "bodies"),
    [
        ("a.obj", write_named_obj(), NAMES),
        ("a.obj", write_named_obj("g", "f"), NAMES),
        ("a.obj", write_named_obj("#"), ("", "")),
        ("a.3mf", write_named_3mf(), NAMES),
        ("a.stl", write_named_stl(), NAMES),
        ("a.stl", meshes.write_binary_stl(BOXES), ("", "")),
        ("a.glb", write_named_glb(), NAMES),
        ("a.glb", meshes.write_glb(BOXES), ("", "")),
        ("a.ply", meshes.write_ply(BOXES), ("", "")),
    ],
)
def test_bodies_have_the_names_of_the_file(name, data, bodies, tmp_path):
    solid = read(tmp_path / name, data)
    assert sorted(solid.bodies) == sorted(bodies)
    assert len(solid.edges) == 24


def test_a_void_belongs_to_its_body(tmp_path):
    """A box of 10 x 20 x 30 mm has a void of 4 x 4 x 6 mm, whose faces point into the void."""
    inner = BOX._replace(
        corners=BOX.corners * [0.4, 0.2, 0.2] + [3.0, 3.0, 3.0],
        faces=[face[::-1] for face in BOX.faces],
    )
    solid = read(tmp_path / "hollow.obj", meshes.write_obj([BOX, inner]))
    assert solid.bodies == ("body0",)
    assert sum(edge.convex for edge in solid.edges) == 12
    assert len(solid.edges) == 24


def test_inspect_counts_bodies_and_edges_by_kind(tmp_path, capsys):
    (tmp_path / "a.obj").write_bytes(write_named_obj())
    assert main(["inspect", str(tmp_path / "a.obj")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1] == "bodies: 2 (left, right)"
    assert lines[2] == "edges: 24, 24 convex (24 lines), 0 concave"
    assert main(["inspect", str(tmp_path / "a.obj"), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)["facts"]
    assert facts["bodies"] == ["left", "right"]
    assert facts["edge_kinds"] == {"convex line": 24}
    assert facts["size"] == [40.0, 20.0, 30.0]


def test_equal_names_are_listed_once_with_their_number():
    assert describe_bodies(["foot", "lid", "foot", ""]) == "4 (2 x foot, lid)"
    assert describe_bodies(["", ""]) == "2"
    ribs = describe_bodies([f"rib{k}" for k in range(25)])
    assert ribs.startswith("25 (rib0, rib1,")
    assert ribs.endswith(", rib19, 5 more names)")
