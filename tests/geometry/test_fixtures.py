"""Fixtures become layers, as high as their shapes triangle by triangle."""

import itertools
import math

import numpy as np
import pytest
import shapely

from camgen.geometry.fixtures import Fixtures, list_bodies, list_fixtures
from camgen.model.errors import JobError
from camgen.model.job import CellTable, Job, ToolTable
from camgen.model.part import Solid
from camgen.model.pose import FloatArray


def make_solid(vertices: FloatArray, faces: list[tuple[int, ...]]) -> Solid:
    indices = np.array(faces)
    normals = np.zeros((len(indices), 3))
    return Solid("clamp", "clamp.stl", "mm", vertices, indices, normals, (), (), ())


def make_wedge(length: float, width: float, height: float) -> Solid:
    """A ramp from x = 0 at height 0 to x = length at `height`."""
    corners = [(0, 0, 0), (length, 0, 0), (length, 0, height)]
    corners += [(x, width, z) for x, _, z in corners]
    faces = [(0, 1, 2), (3, 5, 4), (0, 3, 4), (0, 4, 1), (1, 4, 5), (1, 5, 2), (0, 2, 5), (0, 5, 3)]
    return make_solid(np.array(corners, dtype=np.float64), faces)


def make_dome(radius: float, count: int) -> Solid:
    """The upper half of a sphere around the origin, with `count` rings of triangles."""
    rows = []
    angle = np.arange(4 * count) * 2 * math.pi / (4 * count)
    for k in range(count + 1):
        latitude = k * math.pi / 2 / count
        z, r = np.full(len(angle), radius * math.sin(latitude)), radius * math.cos(latitude)
        rows.append(np.column_stack([r * np.cos(angle), r * np.sin(angle), z]))
    faces = []
    for k in range(count):
        for j in range(4 * count):
            a, b = k * 4 * count + j, k * 4 * count + (j + 1) % (4 * count)
            faces += [(a, b, b + 4 * count), (a, b + 4 * count, a + 4 * count)]
    return make_solid(np.concatenate(rows), faces)


def height_at(solid: Solid, x: float, y: float) -> float:
    """Highest z of the triangles above a point, by barycentric coordinates; -inf beside them."""
    a, b, c = np.moveaxis(solid.vertices[solid.faces], 1, 0)
    u, v, to = b - a, c - a, np.array([x, y]) - a[:, :2]
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    level = np.abs(area) > 1e-9
    area = np.where(level, area, 1.0)
    s = (to[:, 0] * v[:, 1] - to[:, 1] * v[:, 0]) / area
    t = (u[:, 0] * to[:, 1] - u[:, 1] * to[:, 0]) / area
    inside = level & (s >= 0) & (t >= 0) & (s + t <= 1)
    z = a[:, 2] + s * u[:, 2] + t * v[:, 2]
    return float(z[inside].max(initial=-math.inf))


def read(*given: object, meshes: tuple[Solid, ...] = ()) -> Fixtures:
    job = Job(cell=CellTable(fixtures=list(given)))
    fixtures = list_fixtures(job, [(f"fixture {k}", mesh) for k, mesh in enumerate(meshes)])
    assert fixtures is not None
    return fixtures


def test_a_job_without_fixtures_has_none() -> None:
    assert list_fixtures(Job(), ()) is None


def test_a_box_by_any_two_opposite_corners_is_one_layer() -> None:
    (fixture,) = read([30, 20, -5, 10, -10, 12]).listed
    (layer,) = fixture.layers
    assert layer.outline.bounds == (10, -10, 30, 20)
    assert (fixture.number, fixture.top, layer.outline.area) == (1, 12, 600)


def test_a_mesh_among_boxes_keeps_its_number() -> None:
    given = [0, 0, 0, 1, 1, 1], "wedge.stl", [0, 0, 0, 1, 1, 3]
    fixtures = read(*given, meshes=(make_wedge(10, 4, 8),))
    assert [(fixture.number, fixture.top) for fixture in fixtures.listed] == [
        (1, 1),
        (2, 8),
        (3, 3),
    ]
    assert fixtures.travel == 18


@pytest.mark.parametrize(
    "solid", [make_wedge(30, 10, 12), make_dome(20, 24)], ids=["wedge", "dome"]
)
def test_layers_are_at_least_as_high_as_the_mesh_and_at_most_a_band_higher(solid: Solid) -> None:
    (fixture,) = read("clamp.stl", meshes=(solid,)).listed
    low, high = solid.vertices.min(axis=0), solid.vertices.max(axis=0)
    assert len(fixture.layers) <= 64
    assert fixture.top == pytest.approx(high[2])
    places = np.random.default_rng(3).uniform(low[:2] - 2, high[:2] + 2, (300, 2))
    inside = 0
    for x, y in places.tolist():
        true = height_at(solid, x, y)
        point = shapely.Point(x, y)
        tops = [layer.top for layer in fixture.layers if layer.outline.contains(point)]
        stated = max(tops, default=-math.inf)
        inside += math.isfinite(true)
        assert stated >= true - 1e-6
        if math.isfinite(true) and true > 0.01:
            # A band is 1 mm high, and so is a step of its outline, at most.
            assert stated <= true + 1.0 + 1e-6
    assert 100 < inside < 300


def test_a_layer_contains_the_layers_above_it() -> None:
    (fixture,) = read("dome.stl", meshes=(make_dome(20, 24),)).listed
    for upper, lower in zip(fixture.layers, fixture.layers[1:], strict=False):
        assert upper.top > lower.top
        assert lower.outline.buffer(1e-4).contains(upper.outline)


def test_a_mesh_with_upright_walls_is_one_exact_layer() -> None:
    wedge = make_wedge(10, 4, 8)
    box = np.array(list(itertools.product((0, 10), (0, 4), (0, 8))), dtype=np.float64)
    faces = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6)]
    faces += [(0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]
    (fixture,) = read("box.stl", meshes=(make_solid(box, faces),)).listed
    (layer,) = fixture.layers
    assert (layer.top, layer.outline.area) == (8, pytest.approx(40))
    assert len(read("wedge.stl", meshes=(wedge,)).listed[0].layers) == 8


@pytest.mark.parametrize(
    ("box", "what"),
    [
        ([1, 2, 3], "a box has 3 values"),
        ([0, 0, 0, 1, 0, 1], "no size"),
        ([0, 0, 0, 1, 1, math.inf], "no size"),
    ],
)
def test_an_invalid_box_is_refused(box: list[float], what: str) -> None:
    with pytest.raises(JobError, match=what):
        read(box)


def test_a_tool_and_its_holder_are_bodies_with_height_and_radius() -> None:
    tool = ToolTable(
        diameter=6, length=50, holder=[[-10, -8, 0, 10, 8, 20], [-3, -3, 20, 3, 3, 30]]
    )
    bodies = [(body.name, body.height, body.radius) for body in list_bodies(tool)]
    assert bodies == [("tool", 0, 3), ("holder", 30, 10), ("holder", 20, 3)]
