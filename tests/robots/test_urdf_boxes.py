"""The boxes of the links of a URDF contain the shapes of the links and are not much larger."""

import itertools
import math
import struct
from pathlib import Path

import numpy as np
import pytest

from camgen.collision.scene import make_scene
from camgen.robots.catalogue import find_robot
from camgen.robots.models import Box, Surface
from camgen.robots.urdf.boxes import enclose_mesh, is_own_hull
from camgen.robots.urdf.xml import find_mesh
from tests.support.rounding import rounding_bound
from tests.support.urdf_arms import rpy

ROBOTS = Path(__file__).parents[2] / "fixtures" / "robots"
CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
#: The twelve triangles of a cuboid whose corners are `CORNERS`.
FACES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip


def write_arm(folder: Path, shapes: str, more: str = "") -> str:
    """The name of the file of an arm of one joint whose moving link has these shapes."""
    file = folder / "arm.urdf"
    file.write_text(
        f'<robot name="a"><link name="b"/><link name="c">{shapes}</link>{more}'
        '<joint name="j" type="revolute"><parent link="b"/><child link="c"/>'
        '<limit lower="-1" upper="1" velocity="1"/></joint></robot>'
    )
    return str(file)


def shape_xml(geometry: str, kind: str = "collision", origin: str = "") -> str:
    return f"<{kind}>{origin}<geometry>{geometry}</geometry></{kind}>"


def make_obj(vertices: np.ndarray, faces: np.ndarray = FACES) -> str:
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices.tolist()]
    return "\n".join([*lines, *(f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist())]) + "\n"


def make_stl(vertices: np.ndarray) -> bytes:
    rows = [struct.pack("<12fH", 0, 0, 0, *vertices[face].ravel().tolist(), 0) for face in FACES]
    return b"".ljust(80) + struct.pack("<I", len(rows)) + b"".join(rows)


def find_boxes(name: str) -> list[tuple[list[float], list[float]]]:
    return [
        (list(box.link_from_box.origin), list(box.half)) for box in find_robot(name).links[1].boxes
    ]


def are_inside(points: np.ndarray, all_boxes: list[Box]) -> np.ndarray:
    """Whether each point (N, 3) is in one of the boxes, or at most 0.001 mm outside."""
    is_inside = np.zeros(len(points), dtype=np.bool_)
    for box in all_boxes:
        in_box = (points - box.link_from_box.origin) @ box.link_from_box.rotation
        is_inside |= (np.abs(in_box) <= np.array(box.half) + 1e-3).all(axis=1)
    return is_inside


def sample_triangles(
    vertices: np.ndarray, faces: np.ndarray, count: int, rng: np.random.Generator
) -> np.ndarray:
    """Random points (count, 3) on triangles."""
    weights = rng.dirichlet((1, 1, 1), count)
    return np.asarray(
        (weights[:, :, None] * vertices[faces[rng.integers(len(faces), size=count)]]).sum(axis=1)
    )


def sum_volumes(all_boxes: list[Box]) -> float:
    return sum(8 * math.prod(box.half) for box in all_boxes)


def test_simple_shapes_become_boxes(tmp_path: Path) -> None:
    origin = '<origin xyz="0.1 0 -0.2" rpy="0 0 1.5707963267948966"/>'
    text = shape_xml('<box size="0.2 0.4 0.6"/>', origin=origin) + shape_xml(
        '<cylinder radius="0.05" length="0.3"/>'
    )
    text += shape_xml('<sphere radius="0.07"/>')
    assert find_boxes(write_arm(tmp_path, text)) == [
        ([pytest.approx(100), 0, -200], [100, 200, 300]),
        ([0, 0, 0], [pytest.approx(50), pytest.approx(50 * math.sqrt(0.5)), pytest.approx(150)]),
        ([0, 0, 0], [pytest.approx(50 * math.sqrt(0.5)), pytest.approx(50), pytest.approx(150)]),
        ([0, 0, 0], [pytest.approx(70)] * 3),
    ]
    rotation = find_robot(str(tmp_path / "arm.urdf")).links[1].boxes[0].link_from_box.rotation
    rounding = rounding_bound(operations=10, functions=12)
    assert rotation == pytest.approx(rpy(0, 0, math.pi / 2), abs=rounding)


def test_two_boxes_contain_a_cylinder(tmp_path: Path) -> None:
    """They extend less than a quarter of the radius beyond it; one box would by 41 %."""
    robot = find_robot(write_arm(tmp_path, shape_xml('<cylinder radius="0.05" length="0.3"/>')))
    angles = np.linspace(0, math.tau, 721)
    circle = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(721)])
    cylinder_boxes = list(robot.links[1].boxes)
    for height in (-150, 0, 150):
        assert are_inside(circle * 50 + [0, 0, height], cylinder_boxes).all()
        assert are_inside(circle * 20 + [0, 0, height], cylinder_boxes).all()
    assert not are_inside(circle * 62.5, cylinder_boxes).any()


def test_collision_shapes_are_preferred_to_visual_shapes(tmp_path: Path) -> None:
    visual, collision = (
        shape_xml('<sphere radius="0.2"/>', "visual"),
        shape_xml('<sphere radius="0.1"/>'),
    )
    assert [half for _, half in find_boxes(write_arm(tmp_path, visual + collision))] == [
        [100, 100, 100]
    ]
    assert [half for _, half in find_boxes(write_arm(tmp_path, visual))] == [[200, 200, 200]]


@pytest.mark.parametrize(
    ("scale", "half"), [("", [10, 20, 30]), ('scale="0.001 0.002 -0.003"', [0.01, 0.04, 0.09])]
)
def test_a_mesh_is_scaled_and_converted_to_mm(
    scale: str, half: list[float], tmp_path: Path
) -> None:
    (tmp_path / "body.obj").write_text(make_obj(CORNERS * [0.01, 0.02, 0.03] + [0, 0, 0.03]))
    (box,) = find_boxes(write_arm(tmp_path, shape_xml(f'<mesh filename="body.obj" {scale}/>')))
    assert box[1] == pytest.approx(half)
    assert box[0] == pytest.approx([0, 0, -0.09 if scale else 30])


def test_meshes_are_found_by_all_usual_addresses(tmp_path: Path) -> None:
    package = tmp_path / "ws" / "arm_description"
    (package / "urdf").mkdir(parents=True)
    (package / "meshes" / "hit").mkdir(parents=True)
    body = package / "meshes" / "hit" / "body.stl"
    body.write_bytes(make_stl(CORNERS))
    urdf = package / "urdf"
    for name in (
        "package://arm_description/meshes/hit/body.stl", "../meshes/hit/body.stl",
        f"file://{body}", str(body), "model://arm_description/meshes/hit/body.stl",
        "meshes/hit/body.stl", "package://other_name/meshes/hit/body.stl",
    ):  # fmt: skip
        mesh = find_mesh(name, urdf)
        assert mesh is not None, name
        assert mesh.resolve() == body
    assert find_mesh("package://arm_description/meshes/hit/none.stl", urdf) is None
    assert find_mesh("body.stl", urdf) is None  # a bare name means a file beside the URDF
    (urdf / "body.stl").write_bytes(make_stl(CORNERS))
    assert find_mesh("package://elsewhere/body.stl", urdf) == urdf / "body.stl"
    assert find_mesh("\0.stl", urdf) is None


def test_a_missing_or_damaged_mesh_is_noted(tmp_path: Path) -> None:
    (tmp_path / "cut.stl").write_bytes(make_stl(CORNERS)[:200])
    (tmp_path / "body.x3d").write_text("<X3D/>")
    names = ("none.stl", "cut.stl", "body.x3d")
    text = "".join(shape_xml(f'<mesh filename="{name}"/>') for name in names)
    robot = find_robot(write_arm(tmp_path, text))
    assert robot.links[1].boxes == ()
    assert robot.links[1].unread == names
    assert robot.notes[-3:] == (
        "link c has no boxes of its mesh none.stl: there is no such file near the URDF",
        "link c has no boxes of its mesh cut.stl: the file ends before its last face, "
        "2 of 12 are there; export it again from the CAD program",
        "link c has no boxes of its mesh body.x3d: is not a kind of mesh that camgen reads; "
        "give one of .stl, .obj, .ply, .off, .3mf, .glb",
    )


@pytest.mark.parametrize("seed", range(6))
def test_boxes_contain_the_whole_surface_of_a_mesh(seed: int) -> None:
    """The mesh is three rotated bars; its boxes are not larger than one box around all."""
    rng = np.random.default_rng(seed)
    bars = [
        CORNERS * rng.uniform(5, 80, 3) @ rpy(*rng.uniform(-3, 3, 3)).T + rng.uniform(-200, 200, 3)
        for _ in range(3)
    ]
    vertices = np.concatenate(bars)
    faces = np.concatenate([FACES + 8 * k for k in range(3)])
    mesh_boxes = enclose_mesh(vertices, faces)
    points = sample_triangles(vertices, faces, 20_000, rng)
    assert are_inside(points, mesh_boxes).all()
    assert are_inside(vertices, mesh_boxes).all()
    assert 1 <= len(mesh_boxes) <= 3
    assert sum_volumes(mesh_boxes) <= np.prod(vertices.max(axis=0) - vertices.min(axis=0)) + 1e-6


def test_a_foot_with_a_column_gets_boxes_of_little_more_than_its_volume() -> None:
    """A foot of 200 x 200 x 50 mm carries a column of 40 x 40 x 350 mm.

    One box would have 16 litres, two boxes 2.56 litres. The box of the foot may be higher by a
    sixteenth of the whole height, since a mesh is divided at multiples of that.
    """
    foot, column = CORNERS * [100, 100, 25], CORNERS * [20, 20, 175] + [0, 0, 200]
    vertices, faces = np.concatenate([foot, column]), np.concatenate([FACES, FACES + 8])
    mesh_boxes = enclose_mesh(vertices, faces)
    assert are_inside(
        sample_triangles(vertices, faces, 5000, np.random.default_rng(0)), mesh_boxes
    ).all()
    assert sum_volumes(mesh_boxes) < 2.56e6 + 200 * 200 * 400 / 16
    assert len(mesh_boxes) <= 3


def test_a_rotated_bar_gets_a_rotated_box() -> None:
    rotation = rpy(0.5, 0.6, 0.7)
    vertices = CORNERS * [200, 20, 10] @ rotation.T + [5, 6, 7]
    (box,) = enclose_mesh(vertices, FACES)
    assert sorted(box.half) == pytest.approx([10, 20, 200], abs=1e-6)
    assert box.link_from_box.origin == pytest.approx((5, 6, 7))
    assert np.linalg.det(box.link_from_box.rotation) == pytest.approx(1)


def test_a_flat_mesh_has_a_thin_box() -> None:
    corners = np.array([[0.0, 0, 0], [10, 0, 0], [10, 10, 0], [0, 10, 0]])
    (box,) = enclose_mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]))
    assert box.half == pytest.approx((5, 5, 0.01))


def test_neighbouring_links_alone_may_touch() -> None:
    robot = find_robot(str(ROBOTS / "cobot.urdf"))
    assert robot.touching == tuple((k, k + 1) for k in range(6))
    scene = make_scene(robot)
    assert ("world", "forearm") in scene.pairs
    assert ("wrist_1", "wrist_3") in scene.pairs


def test_a_convex_mesh_is_its_own_hull_and_two_cuboids_are_not() -> None:
    """Either winding of the faces counts."""
    assert is_own_hull(Surface(CORNERS * 50, FACES))
    assert is_own_hull(Surface(CORNERS * 50, FACES[:, ::-1]))
    both = np.concatenate([CORNERS * 10, CORNERS * 10 + [0, 0, 60]])
    assert not is_own_hull(Surface(both, np.concatenate([FACES, FACES + 8])))


def test_the_visual_mesh_is_used_if_the_collision_mesh_is_its_hull(tmp_path: Path) -> None:
    """A fork of two prongs has a hull that fills the gap; without the fork the hull is used."""
    prongs = [CORNERS * [0.01, 0.02, 0.05] + [0, y, 0] for y in (-0.04, 0.04)]
    lines = make_obj(np.concatenate(prongs), np.concatenate([FACES, FACES + 8]))
    (tmp_path / "hull.stl").write_bytes(make_stl(CORNERS * [0.01, 0.06, 0.05]))
    (tmp_path / "fork.obj").write_text(lines)
    names = {"collision": "hull.stl", "visual": "fork.obj"}
    text = "".join(shape_xml(f'<mesh filename="{name}"/>', kind) for kind, name in names.items())
    assert len(find_robot(write_arm(tmp_path, text)).links[1].surfaces[0].faces) == 24
    (tmp_path / "fork.obj").unlink()
    link = find_robot(write_arm(tmp_path, text)).links[1]
    assert len(link.surfaces[0].faces) == 12
    assert link.unread == ()
