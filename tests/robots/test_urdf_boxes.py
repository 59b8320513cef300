"""The cuboids of a URDF's links hold what they stand for, and are not much larger."""

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
#: The twelve triangles of a cuboid whose corners are ``CORNERS``.
FACES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip


def arm(folder: Path, shapes: str, more: str = "") -> str:
    """An arm of one joint whose moving link has these shapes."""
    file = folder / "arm.urdf"
    file.write_text(
        f'<robot name="a"><link name="b"/><link name="c">{shapes}</link>{more}<joint name="j" type="revolute">'
        '<parent link="b"/><child link="c"/><limit lower="-1" upper="1" velocity="1"/></joint></robot>'
    )
    return str(file)


def shape(geometry: str, kind: str = "collision", at: str = "") -> str:
    return f"<{kind}>{at}<geometry>{geometry}</geometry></{kind}>"


def obj(vertices: np.ndarray, faces: np.ndarray = FACES) -> str:
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices.tolist()]
    return "\n".join([*lines, *(f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist())]) + "\n"


def stl(vertices: np.ndarray) -> bytes:
    rows = [struct.pack("<12fH", 0, 0, 0, *vertices[face].ravel().tolist(), 0) for face in FACES]
    return b"".ljust(80) + struct.pack("<I", len(rows)) + b"".join(rows)


def boxes(name: str) -> list[tuple[list[float], list[float]]]:
    return [
        (list(box.link_from_box.origin), list(box.half)) for box in find_robot(name).links[1].boxes
    ]


def inside(points: np.ndarray, all_boxes: list[Box]) -> np.ndarray:
    """Which points (N, 3) are in one of the boxes, give or take a micrometre."""
    held = [
        (
            np.abs((points - box.link_from_box.origin) @ box.link_from_box.rotation)
            <= np.array(box.half) + 1e-3
        ).all(axis=1)
        for box in all_boxes
    ]
    return np.asarray(np.any(held, axis=0))


def sampled(
    vertices: np.ndarray, faces: np.ndarray, count: int, rng: np.random.Generator
) -> np.ndarray:
    """Points (count, 3) on triangles."""
    weights = rng.dirichlet((1, 1, 1), count)
    return np.asarray(
        (weights[:, :, None] * vertices[faces[rng.integers(len(faces), size=count)]]).sum(axis=1)
    )


def volume(all_boxes: list[Box]) -> float:
    return sum(8 * math.prod(box.half) for box in all_boxes)


def test_simple_shapes(tmp_path: Path) -> None:
    at = '<origin xyz="0.1 0 -0.2" rpy="0 0 1.5707963267948966"/>'
    text = shape('<box size="0.2 0.4 0.6"/>', at=at) + shape(
        '<cylinder radius="0.05" length="0.3"/>'
    )
    text += shape('<sphere radius="0.07"/>')
    assert boxes(arm(tmp_path, text)) == [
        ([pytest.approx(100), 0, -200], [100, 200, 300]),
        ([0, 0, 0], [pytest.approx(50), pytest.approx(50 * math.sqrt(0.5)), pytest.approx(150)]),
        ([0, 0, 0], [pytest.approx(50 * math.sqrt(0.5)), pytest.approx(50), pytest.approx(150)]),
        ([0, 0, 0], [pytest.approx(70)] * 3),
    ]
    turned = find_robot(str(tmp_path / "arm.urdf")).links[1].boxes[0].link_from_box.rotation
    rounding = rounding_bound(operations=10, functions=12)
    assert turned == pytest.approx(rpy(0, 0, math.pi / 2), abs=rounding)


def test_two_boxes_hold_a_cylinder(tmp_path: Path) -> None:
    """All of it, and none of what is more than a quarter of the radius beside it, where one box would reach 41 %."""
    of = find_robot(arm(tmp_path, shape('<cylinder radius="0.05" length="0.3"/>')))
    angles = np.linspace(0, math.tau, 721)
    circle = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(721)])
    found = list(of.links[1].boxes)
    for height in (-150, 0, 150):
        assert inside(circle * 50 + [0, 0, height], found).all()
        assert inside(circle * 20 + [0, 0, height], found).all()
    assert not inside(circle * 62.5, found).any()


def test_shapes_for_collisions_come_before_those_to_be_seen(tmp_path: Path) -> None:
    seen, hit = shape('<sphere radius="0.2"/>', "visual"), shape('<sphere radius="0.1"/>')
    assert [half for _, half in boxes(arm(tmp_path, seen + hit))] == [[100, 100, 100]]
    assert [half for _, half in boxes(arm(tmp_path, seen))] == [[200, 200, 200]]


@pytest.mark.parametrize(
    ("scale", "half"), [("", [10, 20, 30]), ('scale="0.001 0.002 -0.003"', [0.01, 0.04, 0.09])]
)
def test_a_mesh_is_scaled_and_becomes_millimetres(
    scale: str, half: list[float], tmp_path: Path
) -> None:
    (tmp_path / "body.obj").write_text(obj(CORNERS * [0.01, 0.02, 0.03] + [0, 0, 0.03]))
    (box,) = boxes(arm(tmp_path, shape(f'<mesh filename="body.obj" {scale}/>')))
    assert box[1] == pytest.approx(half)
    assert box[0] == pytest.approx([0, 0, -0.09 if scale else 30])


def test_meshes_are_found_where_packages_have_them(tmp_path: Path) -> None:
    package = tmp_path / "ws" / "arm_description"
    (package / "urdf").mkdir(parents=True)
    (package / "meshes" / "hit").mkdir(parents=True)
    body = package / "meshes" / "hit" / "body.stl"
    body.write_bytes(stl(CORNERS))
    urdf = package / "urdf"
    for name in (
        "package://arm_description/meshes/hit/body.stl", "../meshes/hit/body.stl", f"file://{body}", str(body),
        "model://arm_description/meshes/hit/body.stl", "meshes/hit/body.stl", "package://other_name/meshes/hit/body.stl",
    ):  # fmt: skip
        found = find_mesh(name, urdf)
        assert found is not None, name
        assert found.resolve() == body
    assert find_mesh("package://arm_description/meshes/hit/none.stl", urdf) is None
    assert find_mesh("body.stl", urdf) is None  # a bare name is looked for beside the URDF only
    (urdf / "body.stl").write_bytes(stl(CORNERS))
    assert find_mesh("package://elsewhere/body.stl", urdf) == urdf / "body.stl"
    assert find_mesh("\0.stl", urdf) is None


def test_a_mesh_that_is_missing_or_damaged_is_said(tmp_path: Path) -> None:
    (tmp_path / "cut.stl").write_bytes(stl(CORNERS)[:200])
    (tmp_path / "body.x3d").write_text("<X3D/>")
    names = ("none.stl", "cut.stl", "body.x3d")
    text = "".join(shape(f'<mesh filename="{name}"/>') for name in names)
    of = find_robot(arm(tmp_path, text))
    assert of.links[1].boxes == ()
    assert of.links[1].unread == names
    assert of.notes[-3:] == (
        "link c has no boxes of its mesh none.stl: there is no such file near the URDF",
        "link c has no boxes of its mesh cut.stl: the file ends before its last face, 2 of 12 are there; "
        "export it again from the CAD program",
        "link c has no boxes of its mesh body.x3d: is not a kind of mesh that camgen reads; "
        "give one of .stl, .obj, .ply, .off, .3mf, .glb",
    )


@pytest.mark.parametrize("seed", range(6))
def test_boxes_hold_the_whole_surface(seed: int) -> None:
    """A heap of turned bars: every point of every triangle is in a box, and the boxes are no larger than the one."""
    rng = np.random.default_rng(seed)
    parts = [
        CORNERS * rng.uniform(5, 80, 3) @ rpy(*rng.uniform(-3, 3, 3)).T + rng.uniform(-200, 200, 3)
        for _ in range(3)
    ]
    vertices = np.concatenate(parts)
    faces = np.concatenate([FACES + 8 * k for k in range(3)])
    found = enclose_mesh(vertices, faces)
    points = sampled(vertices, faces, 20_000, rng)
    assert inside(points, found).all()
    assert inside(vertices, found).all()
    assert 1 <= len(found) <= 3
    assert volume(found) <= np.prod(vertices.max(axis=0) - vertices.min(axis=0)) + 1e-6


def test_two_boxes_for_a_foot_with_a_column() -> None:
    """200 x 200 x 50 with a column of 40 x 40 x 350 on it: one box has 16 litres, the two have 2.56, and a
    sixteenth of the height more of the foot, since that is where meshes are cut.
    """
    foot, column = CORNERS * [100, 100, 25], CORNERS * [20, 20, 175] + [0, 0, 200]
    vertices, faces = np.concatenate([foot, column]), np.concatenate([FACES, FACES + 8])
    found = enclose_mesh(vertices, faces)
    assert inside(sampled(vertices, faces, 5000, np.random.default_rng(0)), found).all()
    assert volume(found) < 2.56e6 + 200 * 200 * 400 / 16
    assert len(found) <= 3


def test_a_turned_bar_gets_a_turned_box() -> None:
    turned = rpy(0.5, 0.6, 0.7)
    vertices = CORNERS * [200, 20, 10] @ turned.T + [5, 6, 7]
    (box,) = enclose_mesh(vertices, FACES)
    assert sorted(box.half) == pytest.approx([10, 20, 200], abs=1e-6)
    assert box.link_from_box.origin == pytest.approx((5, 6, 7))
    assert np.linalg.det(box.link_from_box.rotation) == pytest.approx(1)


def test_a_flat_mesh_has_a_thin_box() -> None:
    corners = np.array([[0.0, 0, 0], [10, 0, 0], [10, 10, 0], [0, 10, 0]])
    (box,) = enclose_mesh(corners, np.array([[0, 1, 2], [0, 2, 3]]))
    assert box.half == pytest.approx((5, 5, 0.01))


def test_neighbours_alone_touch() -> None:
    of = find_robot(str(ROBOTS / "cobot.urdf"))
    assert of.touching == tuple((k, k + 1) for k in range(6))
    made = make_scene(of)
    assert ("world", "forearm") in made.pairs
    assert ("wrist_1", "wrist_3") in made.pairs


def test_a_hull_is_told_from_a_shape_with_a_hollow() -> None:
    """A cuboid, its faces wound one way or the other, is its own hull; two of them are not."""
    assert is_own_hull(Surface(CORNERS * 50, FACES))
    assert is_own_hull(Surface(CORNERS * 50, FACES[:, ::-1]))
    both = np.concatenate([CORNERS * 10, CORNERS * 10 + [0, 0, 60]])
    assert not is_own_hull(Surface(both, np.concatenate([FACES, FACES + 8])))


def test_the_mesh_to_be_seen_counts_where_the_other_is_its_hull(tmp_path: Path) -> None:
    """A fork of two prongs, 40 mm apart, in a hull that fills it; the hull if there is no fork."""
    prongs = [CORNERS * [0.01, 0.02, 0.05] + [0, y, 0] for y in (-0.04, 0.04)]
    lines = obj(np.concatenate(prongs), np.concatenate([FACES, FACES + 8]))
    (tmp_path / "hull.stl").write_bytes(stl(CORNERS * [0.01, 0.06, 0.05]))
    (tmp_path / "fork.obj").write_text(lines)
    names = {"collision": "hull.stl", "visual": "fork.obj"}
    text = "".join(shape(f'<mesh filename="{name}"/>', kind) for kind, name in names.items())
    assert len(find_robot(arm(tmp_path, text)).links[1].surfaces[0].faces) == 24
    (tmp_path / "fork.obj").unlink()
    link = find_robot(arm(tmp_path, text)).links[1]
    assert len(link.surfaces[0].faces) == 12
    assert link.unread == ()
