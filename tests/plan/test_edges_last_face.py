"""Which face of an edge was machined last: on the block of the RFA paper, whose faces are known."""

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
#: Of rfa1: its top, the slope along its front, the front below it.
UP, SLOPE, FRONT = (0, 0, 1), (0, -25 / math.hypot(25, 30), 30 / math.hypot(25, 30)), (0, -1, 0)


def block() -> Solid:
    return mesh.read(source(PARTS / "rfa1.stl"))


def said(value: str | list[float]) -> Offset:
    solid = block()
    job = camgen.job({"operation": {"offset_along": "burr", "last_face": value}})
    return read_offset(job, solid, solid.edges)


def away(name: str, value: str | list[float]) -> list[float]:
    """The offset's direction of an edge, from the tool's axis."""
    edge = next(edge for edge in block().edges if edge.id == name)
    found = make_poses(edge, 2, said(value))
    assert isinstance(found, PosePath)
    return [float(v) for v in -found.rotation[0, :, 2]]


# e1: top and slope. e9: slope and front. f1: top, f2: slope, f7: front.
@pytest.mark.parametrize(
    ("name", "value", "normal"),
    [
        ("e1", "top", UP), ("e9", "top", SLOPE),
        ("e1", [0, 0, 1], UP), ("e1", [0, -3, 0], SLOPE), ("e9", [0, -3, 0], FRONT), ("e9", [0, 0, -1], FRONT),
        ("e1", "f2", SLOPE), ("e9", "f2", SLOPE), ("e9", "f7", FRONT), ("e1", "f7", UP),
        ("e1", "f2 f1", UP), ("e1", "f1, f2", SLOPE), ("e9", "f2 f7", FRONT), ("e9", "f7 f2", SLOPE),
    ],
)  # fmt: skip
def test_the_offset_is_the_normal_of_the_face_that_is_meant(
    name: str, value: str | list[float], normal: tuple[float, float, float]
) -> None:
    assert np.allclose(away(name, value), normal, atol=1e-6)


def test_the_default_is_the_upper_face() -> None:
    solid = block()
    assert (
        read_offset(camgen.job({"operation": {"offset_along": "burr"}}), solid, solid.edges) is TOP
    )
    assert read_offset(camgen.job(), solid, solid.edges) == "mean"


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("f9", "no face f9"), ("bottom", '"bottom" is not a face'), ("", "names no face"),
        ([0, 0, 0], "not a direction"), ([1, 0], "not a direction"), ([0, 0, 1, 0], "not a direction"),
    ],
)  # fmt: skip
def test_what_is_no_face_is_an_error(value: str | list[float], words: str) -> None:
    with pytest.raises(JobError, match=words) as error:
        said(value)
    assert "last_face" in str(error.value)


def test_without_a_burr_it_has_no_effect_and_is_refused() -> None:
    solid = block()
    with pytest.raises(JobError, match="no effect"):
        read_offset(camgen.job({"operation": {"last_face": "f2"}}), solid, solid.edges)


@pytest.mark.parametrize("name", ["rfa1.stl", "rfa1.step"])
def test_faces_are_listed_with_what_is_known_of_them(name: str) -> None:
    if name.endswith("step"):
        pytest.importorskip("OCP", reason="the extra step is not installed")
    facts = inspect(source(PARTS / name), camgen.job(), Files())
    told = {face.id: (face, edges) for face, edges in facts.surfaces}
    assert list(told) == [f"f{k}" for k in range(1, 9)]
    bevel, edges = told["f5"]
    assert bevel.area == pytest.approx(70 * 25 * math.sqrt(2), abs=0.1)
    assert bevel.looks is not None
    assert np.allclose(bevel.looks, [math.sqrt(0.5), math.sqrt(0.5), 0])
    assert set(edges) == {"e5", "e10", "e11", "e20"}
    bore, edges = told["f6"]
    assert bore.area == pytest.approx(math.tau * 15 * 125, rel=2e-3)
    assert bore.looks is None
    assert set(edges) == {"e12", "e13"}
    assert "f5: 2474.9 mm2, looks to 0.707 0.707 0, edges e5 e10 e11 e20" in str(facts)


def test_the_faces_beside_an_edge_have_its_normals() -> None:
    solid = mesh.read(source(PARTS / "rfa2.stl"))
    faces = make_faces(solid)
    found = find_adjacent_faces(solid.edges, solid, faces)
    for edge in solid.edges:
        for side, place in enumerate(found[edge.id]):
            looks = faces.listed[place].looks
            if looks is not None:
                assert np.allclose(edge.normals[0, side], looks, atol=1e-3), (edge.id, side)
        assert found[edge.id][0] != found[edge.id][1]
