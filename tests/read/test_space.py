"""Curves in space of a DXF drawing agree with the formulas of the drawing, and are joined."""

import math
from pathlib import Path

import ezdxf
import numpy as np
import pytest
from ezdxf.layouts import Modelspace

import camgen
from camgen.cli import main
from camgen.model.errors import InputError
from camgen.model.part import Curve, Part
from camgen.model.pose import FloatArray
from camgen.read.space import Piece, join_pieces

FIXTURE = Path(__file__).parents[2] / "fixtures" / "parts" / "space.dxf"
TRACE = {"operation": {"kind": "trace"}, "tolerance": {"chord": 0.01}}


@pytest.fixture(scope="module")
def space() -> dict[str, Curve]:
    return {curve.id: curve for curve in camgen.read(FIXTURE, TRACE).curves}


def drawn(folder: Path, space: Modelspace) -> Part:
    assert space.doc is not None
    space.doc.saveas(folder / "a.dxf")
    return camgen.read(folder / "a.dxf", TRACE)


@pytest.fixture
def sheet() -> Modelspace:
    return ezdxf.new("R2010", units=4).modelspace()


def line(*ends: tuple[float, float, float], layer: str = "0") -> Piece:
    rows = np.array(ends, dtype=np.float64)
    return Piece("LINE", layer, rows, np.full((len(rows) - 1, 3), np.nan))


def test_a_polyline_and_a_line_that_meet_are_one_curve(space: dict[str, Curve]) -> None:
    corners = [[0, 0, 2], [30, 0, 2], [50, 0, 8], [70, 10, 8], [90, 10, 2]]
    assert space["c1"].points.tolist() == corners
    assert (space["c1"].layer, space["c1"].curved.any(), space["c1"].level) == ("SEAM", False, None)


def test_half_a_circle_that_stands_upright_is_an_arc(space: dict[str, Curve]) -> None:
    arch = space["c2"]
    assert arch.points == pytest.approx(np.array([[30, 25, 3], [10, 25, 3], [0, 25, 3]]))
    assert arch.curved.tolist() == [True, False]
    assert arch.middles[0] == pytest.approx([20, 25, 13])
    assert arch.length == pytest.approx(10 * math.pi + 10)


def test_a_spline_is_followed_within_the_tolerance(space: dict[str, Curve]) -> None:
    control = np.array([[0, 60, 2], [15, 70, 14], [25, 50, 2], [40, 60, 10]])
    t = np.linspace(0, 1, 20001)[:, None]
    curve = np.hstack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3]) @ control
    assert space["c3"].points[[0, -1]].tolist() == control[[0, -1]].tolist()
    points = space["c3"].points
    assert measure_deviation(curve, points) < 2e-3
    assert measure_deviation(curve, (points[1:] + points[:-1]) / 2) <= 0.0101


def measure_deviation(curve: FloatArray, points: FloatArray) -> float:
    """Largest distance of the points from the points of the curve, mm."""
    return max(float(np.linalg.norm(curve - point, axis=1).min()) for point in points)


def test_the_height_of_a_helix_is_proportional_to_its_angle(space: dict[str, Curve]) -> None:
    x, y, z = (space["c4"].points - (65, 40, 2)).T
    assert np.hypot(x, y) == pytest.approx(12, abs=1e-5)
    angle = np.unwrap(np.arctan2(y, x))
    assert angle[[0, -1]] == pytest.approx([0, 3 * math.pi], abs=1e-9)
    assert z == pytest.approx(6 * angle / (2 * math.pi), abs=1e-3)
    # A chord deviates from the helix by its sagitta around the axis. The pitch adds nothing.
    sagitta = 12 * (1 - np.cos(np.diff(angle) / 2))
    assert 0.003 < sagitta.max() <= 0.01
    assert space["c4"].length == pytest.approx(1.5 * math.hypot(2 * math.pi * 12, 6), rel=2e-3)


def test_a_flat_curve_is_noted_with_its_height(space: dict[str, Curve]) -> None:
    assert {name for name, curve in space.items() if curve.level is not None} == {"c5"}
    ring = space["c5"]
    assert ring.closed
    assert ring.curved.all()
    assert np.linalg.norm(ring.points - (20, 45, 4), axis=1) == pytest.approx(6)
    (note,) = [note for note in camgen.read(FIXTURE, TRACE).notes if "space" in note.what]
    assert note.what == "4 curves in space: c1, c2, c3, c4; 1 flat one: c5 at z = 4 mm"


def test_an_operation_in_the_plane_skips_curves_in_space_and_names_the_one_that_follows_them(
    capsys: pytest.CaptureFixture[str],
) -> None:
    part = camgen.read(FIXTURE, {"operation": {"kind": "follow"}})
    assert not part.curves
    (skipped,) = [note for note in part.notes if note.kind == "skipped"]
    assert "3-D POLYLINE" in skipped.what
    assert "HELIX" in skipped.what
    assert skipped.why.endswith('operation.kind = "trace" follows them in space')
    assert main(["inspect", str(FIXTURE)]) == 0
    assert "contours: 1 closed, 1 open; 5 curves in space" in capsys.readouterr().out


def test_a_flat_drawing_is_traced_in_its_plane() -> None:
    part = camgen.read(FIXTURE.with_name("plate.dxf"), TRACE)
    assert part.contours
    assert not part.curves


def test_a_drawing_on_a_page_is_flat() -> None:
    part = camgen.read(FIXTURE, TRACE | {"page": {"size": "A4"}})
    assert part.contours
    assert not part.curves


def test_blocks_place_arcs_in_space_and_a_stretched_circle_is_an_ellipse(
    tmp_path: Path, sheet: Modelspace
) -> None:
    assert sheet.doc is not None
    block = sheet.doc.blocks.new("RING")
    block.add_circle((0, 0), 5)
    sheet.add_blockref("RING", (10, 20, 30), dxfattribs={"extrusion": (1, 0, 0)})
    sheet.add_blockref("RING", (10, 20, 90), dxfattribs={"extrusion": (1, 0, 0), "xscale": 2.0})
    even, stretched = drawn(tmp_path, sheet).curves
    # The object coordinates of an extrusion along x are y, z and x.
    assert even.curved.all()
    assert np.linalg.norm(even.points - (30, 10, 20), axis=1) == pytest.approx(5)
    assert not stretched.curved.any()
    y, z = ((stretched.points - (90, 10, 20)) / (1, 10, 5)).T[1:]
    assert np.hypot(y, z) == pytest.approx(1)


def test_an_ellipse_with_equal_axes_is_a_circle_in_space(tmp_path: Path, sheet: Modelspace) -> None:
    sheet.add_ellipse(
        (0, 0, 9), major_axis=(0, 6, 8), ratio=1.0, dxfattribs={"extrusion": (1, 0, 0)}
    )
    (curve,) = drawn(tmp_path, sheet).curves
    assert curve.closed
    assert curve.curved.all()
    assert curve.length == pytest.approx(20 * math.pi)


def test_a_bulge_of_more_than_half_a_circle_is_cut(tmp_path: Path, sheet: Modelspace) -> None:
    points = [(0, 0, 0, 0, math.tan(math.radians(300) / 4)), (10, 0, 0, 0, 0)]
    sheet.add_lwpolyline(points, dxfattribs={"extrusion": (0, -1, 0)})
    (curve,) = drawn(tmp_path, sheet).curves
    assert curve.curved.tolist() == [True, True]
    assert curve.length == pytest.approx(10 * math.radians(300))
    assert np.concatenate([curve.points, curve.middles])[:, 1] == pytest.approx(0)


def test_ends_meet_in_space_and_not_if_one_is_above_the_other() -> None:
    curves, notes = join_pieces(
        [line((0, 0, 0), (9, 0, 0)), line((9, 0, 5), (9, 9, 5)), line((9, 0, 0.02), (0, 5, 5))],
        0.05,
    )
    assert [len(curve.points) for curve in curves] == [4, 2]
    assert curves[0].points[[1, 2], 2].tolist() == [0, 0.02]
    assert [str(note) for note in notes] == [
        "joined: 1 gap between ends, up to 0.02 mm (input.join)"
    ]


def test_a_chain_continues_straight_if_four_ends_meet() -> None:
    cross = [
        line((0, 0, 0), (5, 5, 5)),
        line((10, 0, 0), (5, 5, 5)),
        line((5, 5, 5), (10, 10, 10)),
        line((5, 5, 5), (0, 10, 10)),
    ]
    curves, _ = join_pieces(cross, 0.05)
    assert [curve.points.tolist() for curve in curves] == [
        [[0, 0, 0], [5, 5, 5], [10, 10, 10]],
        [[10, 0, 0], [5, 5, 5], [0, 10, 10]],
    ]


def test_an_end_is_joined_to_an_end_of_its_layer_first() -> None:
    pieces = [
        line((0, 0, 0), (5, 0, 0), layer="A"),
        line((5, 0, 0), (9, 0, 0), layer="B"),
        line((5, 0, 0), (5, 9, 9), layer="A"),
    ]
    curves, _ = join_pieces(pieces, 0.05)
    assert [(curve.layer, len(curve.points)) for curve in curves] == [("A", 3), ("B", 2)]


def test_a_loop_is_closed_and_a_duplicate_dropped() -> None:
    sides = [
        line((0, 0, 0), (9, 0, 0)),
        line((9, 9, 9), (9, 0, 0)),
        line((9, 9, 9), (0, 0, 0)),
        line((9, 0, 0), (0, 0, 0)),
        line((1, 1, 1), (1, 1, 1)),
    ]
    (loop,), notes = join_pieces(sides, 0.05)
    assert loop.closed
    assert loop.points.tolist() == [[0, 0, 0], [9, 0, 0], [9, 9, 9], [0, 0, 0]]
    assert [str(note) for note in notes] == [
        "repaired: dropped: 1 LINE on layer 0 (without length)",
        "repaired: dropped: 1 LINE on layer 0 (drawn twice; each is used once)",
    ]


def test_3000_ends_at_one_point_keep_all_their_lines() -> None:
    rays = [line((0, 0, 0), (k * math.cos(k), k * math.sin(k), k)) for k in range(1, 3001)]
    curves, _ = join_pieces(rays, 0.05)
    assert sum(len(curve.points) - 1 for curve in curves) == 3000


def test_damaged_numbers_are_noted_and_too_many_spans_refused(
    tmp_path: Path, sheet: Modelspace
) -> None:
    sheet.add_line((0, 0, 0), (9, 9, 9))
    sheet.add_line((0, 0, 0), (9, 9, 1e300))
    part = drawn(tmp_path, sheet)
    assert len(part.curves) == 1
    assert "skipped: 1 LINE on layer 0 (damaged numbers)" in map(str, part.notes)
    with pytest.raises(
        InputError, match=r"come to more than 20 lines and arcs; raise tolerance\.chord"
    ):
        camgen.read(FIXTURE, TRACE | {"limits": {"motions": 20}})
