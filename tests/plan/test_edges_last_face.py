"""The face of an edge that was machined last, on the block of the RFA paper with known faces."""

import math
from pathlib import Path

import numpy as np
import pytest

import camgen
from camgen.model.errors import JobError
from camgen.model.part import Solid
from camgen.motion.pose_paths import PosePath
from camgen.plan.edges.last_face import TOP, Offset, read_offset
from camgen.plan.edges.poses import make_poses
from camgen.read.files import Files
from camgen.read.solid import inspect, mesh
from camgen.read.solid.faces import find_adjacent_faces, make_faces
from tests.support.files import source

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"
#: Normals of faces of rfa1: its top, the slope along its front, and the front below the slope.
UP, SLOPE, FRONT = (0, 0, 1), (0, -25 / math.hypot(25, 30), 30 / math.hypot(25, 30)), (0, -1, 0)


def read_block() -> Solid:
    return mesh.read(source(PARTS / "rfa1.stl"))


def read_last_face(value: str | list[float]) -> Offset:
    solid = read_block()
    job = camgen.job({"operation": {"offset_along": "burr", "last_face": value}})
    return read_offset(job, solid, solid.edges)


def find_offset_direction(name: str, value: str | list[float]) -> list[float]:
    """Direction of the offset of an edge, against the tool axis."""
    edge = next(edge for edge in read_block().edges if edge.id == name)
    path = make_poses(edge, 2, read_last_face(value))
    assert isinstance(path, PosePath)
    return [float(v) for v in -path.rotation[0, :, 2]]


# e1: top and slope. e9: slope and front. f1: top, f2: slope, f7: front.
@pytest.mark.parametrize(
    ("name", "value", "normal"),
    [
        ("e1", "top", UP), ("e9", "top", SLOPE),
        ("e1", [0, 0, 1], UP), ("e1", [0, -3, 0], SLOPE),
        ("e9", [0, -3, 0], FRONT), ("e9", [0, 0, -1], FRONT),
        ("e1", "f2", SLOPE), ("e9", "f2", SLOPE), ("e9", "f7", FRONT), ("e1", "f7", UP),
        ("e1", "f2 f1", UP), ("e1", "f1, f2", SLOPE),
        ("e9", "f2 f7", FRONT), ("e9", "f7 f2", SLOPE),
    ],
)  # fmt: skip
def test_the_offset_is_the_normal_of_the_named_face(
    name: str, value: str | list[float], normal: tuple[float, float, float]
) -> None:
    assert np.allclose(find_offset_direction(name, value), normal, atol=1e-6)


def test_the_default_is_the_upper_face() -> None:
    solid = read_block()
    burr = camgen.job({"operation": {"offset_along": "burr"}})
    assert read_offset(burr, solid, solid.edges) is TOP
    assert read_offset(camgen.job(), solid, solid.edges) == "mean"


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("f9", "no face f9"),
        ("bottom", '"bottom" is not a face'),
        ("", "names no face"),
        ([0, 0, 0], "not a direction"),
        ([1, 0], "not a direction"),
        ([0, 0, 1, 0], "not a direction"),
    ],
)
def test_an_invalid_face_is_an_error(value: str | list[float], words: str) -> None:
    with pytest.raises(JobError, match=words) as error:
        read_last_face(value)
    assert "last_face" in str(error.value)


def test_a_last_face_without_an_offset_along_the_burr_is_refused() -> None:
    solid = read_block()
    with pytest.raises(JobError, match="no effect"):
        read_offset(camgen.job({"operation": {"last_face": "f2"}}), solid, solid.edges)


@pytest.mark.parametrize("name", ["rfa1.stl", "rfa1.step"])
def test_inspect_lists_the_area_the_direction_and_the_edges_of_each_face(name: str) -> None:
    if name.endswith("step"):
        pytest.importorskip("OCP", reason="the extra step is not installed")
    facts = inspect(source(PARTS / name), camgen.job(), Files())
    surfaces = {face.id: (face, edges) for face, edges in facts.surfaces}
    assert list(surfaces) == [f"f{k}" for k in range(1, 9)]
    bevel, edges = surfaces["f5"]
    assert bevel.area == pytest.approx(70 * 25 * math.sqrt(2), abs=0.1)
    assert bevel.looks is not None
    assert np.allclose(bevel.looks, [math.sqrt(0.5), math.sqrt(0.5), 0])
    assert set(edges) == {"e5", "e10", "e11", "e20"}
    bore, edges = surfaces["f6"]
    assert bore.area == pytest.approx(math.tau * 15 * 125, rel=2e-3)
    assert bore.looks is None
    assert set(edges) == {"e12", "e13"}
    assert "f5: 2474.9 mm2, looks to 0.707 0.707 0, edges e5 e10 e11 e20" in str(facts)


def test_the_adjacent_faces_of_an_edge_have_its_normals() -> None:
    solid = mesh.read(source(PARTS / "rfa2.stl"))
    faces = make_faces(solid)
    adjacent = find_adjacent_faces(solid.edges, solid, faces)
    for edge in solid.edges:
        for side, index in enumerate(adjacent[edge.id]):
            normal = faces.listed[index].looks
            if normal is not None:
                assert np.allclose(edge.normals[0, side], normal, atol=1e-3), (edge.id, side)
        assert adjacent[edge.id][0] != adjacent[edge.id][1]
