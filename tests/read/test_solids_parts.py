"""The parts of the RFA paper have the sizes, edges and volumes that they should have."""

import math
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from camgen.read.solid import mesh
from tests.support.files import source

PARTS = Path(__file__).parents[2] / "fixtures" / "parts"


def test_rfa1_has_21_convex_edges_15_of_them_above_the_bottom() -> None:
    solid = mesh.read(source(PARTS / "rfa1.stl"))
    assert np.allclose(np.ptp(solid.vertices, axis=0), [125, 95, 70])
    assert len(solid.edges) == 21
    assert all(edge.convex for edge in solid.edges)
    upper = [edge for edge in solid.edges if not np.allclose(edge.points[:, 2], 0)]
    assert len(upper) == 21 - 6
    assert Counter(edge.kind for edge in upper) == {"line": 12, "arc": 1, "circle": 2}
    assert sorted({round(edge.radius, 4) for edge in solid.edges}) == [0, 15, 25]


def test_rfa2_has_24_convex_edges_20_of_them_above_the_bottom() -> None:
    solid = mesh.read(source(PARTS / "rfa2.stl"))
    assert np.allclose(np.ptp(solid.vertices, axis=0), [200, 150, 100])
    kinds = Counter((edge.kind, edge.convex) for edge in solid.edges)
    assert kinds == {("line", True): 18, ("circle", True): 6, ("circle", False): 6}
    assert sum(np.allclose(edge.points[:, 2], 0) for edge in solid.edges) == 4


@pytest.mark.parametrize(
    ("name", "volume"),
    [
        # The block without corner, round, slope and bore. Round and bore are polygons of 72 sides.
        (
            "rfa1",
            125 * 95 * 70
            - 25 * 25 / 2 * 70
            - (625 - 625 * 18 * math.sin(math.radians(5)) / 2) * 70
            - 30 * 25 / 2 * 125
            - 225 * 36 * math.sin(math.radians(5)) * 125,
        ),
        ("rfa1_base", 85 * 55 * 40),
        ("rfa2", (150 * 100 - 45 * 45) * 200 - 6 * 30 * 400 * 36 * math.sin(math.radians(5))),
    ],
)
def test_the_meshes_are_closed_and_have_the_volume_of_the_part(name: str, volume: float) -> None:
    solid = mesh.read(source(PARTS / f"{name}.stl"))
    assert [note.kind for note in solid.notes] == ["assumed", "joined"]
    corners = solid.vertices[solid.faces]
    measured = np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    assert measured == pytest.approx(volume, rel=1e-6)
