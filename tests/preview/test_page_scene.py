"""The page draws contours that are left out, and the bodies around the part."""

import base64
import tomllib
from pathlib import Path

import numpy as np
import pytest

import camgen
from camgen.model.part import Note
from camgen.pipeline import Result
from camgen.preview.page import format_page
from camgen.preview.view import list_reasons, make_view, split_chain
from tests.preview.test_page import PARTS, read_data

# -- contours and edges that are left out


def test_the_reason_of_an_id_is_that_of_its_first_note() -> None:
    notes = [
        Note(
            "skipped", "2 contours not followed, open: c2, 2/c9 on layer A", "gap", ("c2", "2/c9")
        ),
        Note("skipped", "edge e7, line", "", ("e7",)),
        Note("skipped", "contour c2", "other", ("c2",)),
        Note("skipped", "c5 on a layer of that name", "no name of it"),
    ]
    assert list_reasons(notes) == {"c2": "gap", "2/c9": "gap", "e7": "edge e7, line"}


def test_a_contour_without_a_path_is_shown_with_its_reason() -> None:
    result = camgen.build(PARTS / "bracket.dxf", post="gcode", job={"tool": {"diameter": 12.0}})
    lines = {line.id: line for line in make_view(result).lines}
    skipped = [line for line in lines.values() if line.state == "skipped"]
    assert skipped
    assert all(line.why for line in skipped)
    assert {line.id for line in lines.values() if line.state == "done"} == {
        p.id for p in result.tour.paths
    }


def test_contours_in_the_path_of_another_contour_are_done(tmp_path: Path) -> None:
    # One path runs a square and its diagonal. It has the id of one of the two contours.
    lines = ["0", "SECTION", "2", "ENTITIES", "0", "POLYLINE", "8", "A", "66", "1", "70", "1"]
    for x, y in ((0, 0), (10, 0), (10, 10), (0, 10)):
        lines += ["0", "VERTEX", "8", "A", "10", str(x), "20", str(y)]
    lines += ["0", "SEQEND", "0", "LINE", "8", "A", "10", "0", "20", "0", "11", "10", "21", "10"]
    (tmp_path / "square.dxf").write_text("\n".join([*lines, "0", "ENDSEC", "0", "EOF\n"]))
    result = camgen.build(
        tmp_path / "square.dxf", post="gcode", job={"operation": {"kind": "trace"}}
    )
    assert len(result.tour.paths) == 1
    assert [line.state for line in make_view(result).lines] == ["done", "done"]


def test_an_edge_is_split_at_the_ends_of_its_pieces() -> None:
    # An L of 10 and 5 mm that is worked from 1 to 12 mm and from 13 mm to its end.
    points = np.array([[0, 0, 0], [10, 0, 0], [10, 5, 0]], float)
    parts = split_chain(points, [(1.0, 12.0), (13.0, 15.0)])
    assert [piece_index for piece_index, _ in parts] == [-1, 0, -1, 1]
    assert parts[0][1].tolist() == [[0, 0, 0], [1, 0, 0]]
    assert parts[1][1].tolist() == [[1, 0, 0], [10, 0, 0], [10, 2, 0]]
    assert parts[2][1].tolist() == [[10, 2, 0], [10, 3, 0]]
    assert parts[3][1].tolist() == [[10, 3, 0], [10, 5, 0]]
    assert [piece_index for piece_index, _ in split_chain(points, [(0.0, 15.0)])] == [0]


def test_a_piece_of_a_closed_edge_may_contain_its_start() -> None:
    square = np.array([[0, 0, 0], [10, 0, 0], [10, 10, 0], [0, 10, 0], [0, 0, 0]], float)
    piece, gap = split_chain(square, [(25.0, 45.0)])
    assert (piece[0], gap[0]) == (0, -1)
    assert piece[1].tolist() == [[5, 10, 0], [0, 10, 0], [0, 0, 0], [5, 0, 0]]
    assert gap[1].tolist() == [[5, 0, 0], [10, 0, 0], [10, 10, 0], [5, 10, 0]]


@pytest.mark.parametrize(("trim", "kind"), [(0, "skipped"), (6, "assumed")])
def test_the_ends_of_an_edge_that_are_left_out_are_drawn(trim: float, kind: str) -> None:
    job = tomllib.loads((PARTS / "rfa2.toml").read_text())
    result = camgen.build(
        PARTS / "rfa2.stl", post="rapid", job=job | {"operation": {"offset": 2, "trim": trim}}
    )
    lines = make_view(result).lines
    left_out = [line for line in lines if line.state == "skipped"]
    # Four edges of 55 mm end on the table, from which the tool keeps a distance of 2 mm.
    uprights = {"e23", "e24", "e25", "e26"}
    assert {line.id for line in left_out} == uprights
    notes = {note.ids[0]: note for note in result.notes if uprights & set(note.ids)}
    assert {note.kind for note in notes.values()} == {kind}
    for line in left_out:
        assert 4.0 < line.length <= 5.5
        lengths = [other.length for other in lines if other.id == line.id]
        assert sum(lengths) == pytest.approx(55, abs=1e-6)
        assert line.why == (notes[line.id].why if trim == 0 else "operation.trim allows it")
    assert all(not line.why for line in lines if line.state == "done")


# -- bodies around the part


def test_the_drawn_table_is_the_table_of_the_collision_test(solid: Result) -> None:
    view = make_view(solid)
    assert solid.part.solid is not None
    vertices = solid.part.solid.vertices
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    (table,) = view.standing
    assert table.name == "table"
    centre, half = np.array(table.boxes[0].link_from_box.origin), np.array(table.boxes[0].half)
    # The table is 0.5 mm below the part, extends 200 mm beyond it, and is 20 mm thick.
    assert centre + half == pytest.approx([high[0] + 200, high[1] + 200, low[2] - 0.5])
    assert centre - half == pytest.approx([low[0] - 200, low[1] - 200, low[2] - 20.5])
    assert table.boxes[0].link_from_box.rotation == pytest.approx(np.eye(3))
    assert "table" in dict(view.facts)["Collision"]


def test_tool_and_holder_are_drawn_as_tested_and_a_fixture_mesh_by_its_triangles(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(PARTS)
    view = make_view(camgen.build("rfa1.stl", post="rapid", job="rfa1.toml"))
    tool, holder = view.bodies
    # The box of the tool is 6 mm wide and reaches from the TCP to the holder, 120 mm along the tool
    # (rfa1.toml: 60 deg).
    assert tool.boxes[0].half == pytest.approx((3, 3, 60), abs=1e-3)
    assert holder.boxes[0].half == pytest.approx((35, 35, 50))
    ((name, mesh),) = view.meshes
    assert name == "fixture 2"
    assert mesh.source == "rfa1_base.stl"
    page_data = read_data(format_page(view))
    vertices = np.frombuffer(
        base64.b64decode(page_data["meshes"][0][1]["vertices"]), "<f4"
    ).reshape(-1, 3)
    assert vertices + page_data["origin"] == pytest.approx(mesh.vertices, abs=1e-4)


def test_without_a_robot_fixtures_and_holder_are_drawn_as_in_the_job() -> None:
    job = {
        "cell": {"fixtures": [[0, 0, -10, 20, 30, 0]]},
        "tool": {"holder": [[-5, -5, 0, 5, 5, 40]]},
    }
    view = make_view(camgen.build(PARTS / "bracket.dxf", post="gcode", job=job))
    assert [(body.name, body.boxes[0].half) for body in view.bodies] == [("holder", (5, 5, 20))]
    assert view.standing[0].boxes[0].link_from_box.origin == (10, 15, -5)
    assert "Collision" not in dict(view.facts)
