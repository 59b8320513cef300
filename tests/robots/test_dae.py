"""COLLADA meshes of a URDF: units, nodes, polygons, and shapes that are not read."""

from pathlib import Path

import numpy as np
import pytest

from camgen.model.errors import InputError
from camgen.model.files import Source
from camgen.robots.urdf.dae import read_dae

POINTS = "0 0 0  2 0 0  2 3 0  0 3 0  1 4 0"
DOCUMENT = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
  <asset>{asset}</asset>
  <library_geometries><geometry id="plate"><mesh>
    <source id="places"><float_array id="numbers" count="15">{points}</float_array>
      <technique_common><accessor source="#numbers" count="5" stride="3"/></technique_common>
    </source>
    <vertices id="corners"><input semantic="POSITION" source="#places"/></vertices>
    {polygons}
  </mesh></geometry></library_geometries>
  <library_visual_scenes><visual_scene id="all">{nodes}</visual_scene></library_visual_scenes>
  <scene><instance_visual_scene url="#all"/></scene>
</COLLADA>
"""
TRIANGLES = (
    '<triangles count="2"><input semantic="VERTEX" source="#corners" offset="0"/>'
    '<input semantic="NORMAL" source="#places" offset="1"/>'
    "<p>0 4 1 4 2 4  0 4 2 4 3 4</p></triangles>"
)
POLYLIST = (
    '<polylist count="2"><input semantic="VERTEX" source="#corners" offset="0"/>'
    "<vcount>4 3</vcount><p>0 1 2 3  3 2 4</p></polylist>"
)
POLYGONS = (
    '<polygons count="1"><input semantic="VERTEX" source="#corners" offset="0"/>'
    "<p>0 1 2 4 3</p></polygons>"
)
INSTANCE = '<instance_geometry url="#plate"/>'
PLAIN = f"<node>{INSTANCE}</node>"


def read_document(
    nodes: str = PLAIN, polygons: str = TRIANGLES, asset: str = "", points: str = POINTS
) -> tuple[np.ndarray, np.ndarray]:
    text = DOCUMENT.format(nodes=nodes, polygons=polygons, asset=asset, points=points)
    vertices, triangles = read_dae(Source(Path("arm.dae"), text.encode()))
    return vertices, triangles.faces


def measure_area(vertices: np.ndarray, faces: np.ndarray) -> float:
    a, b, c = vertices[faces].transpose(1, 0, 2)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


@pytest.mark.parametrize(
    ("polygons", "expected", "count"), [(TRIANGLES, 6.0, 2), (POLYLIST, 7.0, 3), (POLYGONS, 7.0, 3)]
)
def test_polygons_are_divided_into_triangles(polygons: str, expected: float, count: int) -> None:
    vertices, faces = read_document(polygons=polygons)
    assert len(faces) == count
    assert measure_area(vertices, faces) == pytest.approx(expected)


def test_lengths_are_metres_by_the_unit_of_the_file() -> None:
    plain, _ = read_document()
    inches, _ = read_document(asset='<unit name="inch" meter="0.0254"/>')
    assert inches == pytest.approx(0.0254 * plain)


def test_outer_nodes_are_applied_after_inner_ones() -> None:
    """The mesh is scaled by 2, rotated by 90 deg about z, shifted, and then raised by a matrix."""
    nodes = (
        "<node><matrix>1 0 0 0  0 1 0 0  0 0 1 7  0 0 0 1</matrix>"
        "<node><translate>10 20 30</translate>"
        f"<rotate>0 0 2 90</rotate><scale>2 2 2</scale>{INSTANCE}</node></node>"
    )
    vertices, _ = read_document(nodes)
    assert vertices[1] == pytest.approx([10, 20 + 4, 37])
    assert vertices[3] == pytest.approx([10 - 6, 20, 37])


def test_the_up_axis_does_not_rotate_a_mesh() -> None:
    plain, _ = read_document()
    upright, _ = read_document(asset="<up_axis>Y_UP</up_axis>")
    assert upright.tolist() == plain.tolist()


def test_a_node_that_is_instantiated_again_is_read_twice() -> None:
    nodes = (
        f'<node id="kept">{INSTANCE}</node><node><translate>5 0 0</translate>'
        '<instance_node url="#kept"/></node>'
    )
    vertices, faces = read_document(nodes)
    assert len(faces) == 4
    assert vertices[:, 0].max() == pytest.approx(7.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<COLLADA", "is damaged or no COLLADA mesh: "),
        ("<COLLADA/>", "it has no scene"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><COLLADA/>', "declares a DOCTYPE"),
        (
            DOCUMENT.format(nodes=PLAIN, polygons="<tristrips/>", asset="", points=POINTS),
            "holds tristrips, which are not read; export it again as STL",
        ),
        (
            DOCUMENT.format(
                nodes=PLAIN, polygons=TRIANGLES.replace("4 3 4<", "4 9 4<"), asset="", points=POINTS
            ),
            "a face names a vertex that is not there",
        ),
        (
            DOCUMENT.format(
                nodes=f'<node id="a">{INSTANCE}<instance_node url="#a"/></node>',
                polygons=TRIANGLES, asset="", points=POINTS,
            ),
            "its nodes hold each other",
        ),
    ],
)  # fmt: skip
def test_a_damaged_or_unsupported_file_is_refused(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_dae(Source(Path("arm.dae"), text.encode()))
