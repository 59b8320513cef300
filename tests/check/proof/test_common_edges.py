"""Contours with an edge in common: what their proof accepts, and what it refuses."""

import numpy as np
import pytest
from msgspec.structs import replace

import camgen
from camgen.model.errors import NoSafeProgram, VerifyError
from camgen.model.part import Contour, Part
from camgen.plan.beside import OffsetCurve
from tests.check.proof.test_saboteurs import neighbours_gouged, without_last_path, wrong_radius
from tests.support.drawn import circle, contour, part, rectangle
from tests.support.sabotage import Patch, module

JOB = {"tool": {"diameter": 3.0}}


def make_neighbours(x: int) -> list[Contour]:
    """A plate on another one: 4 mm of their edges are in common."""
    return [rectangle(x, 10, 10, 10, f"c{x}"), rectangle(x + 6, 0, 20, 10, f"c{x + 1}")]


def make_inner(*, starts_at_edge: bool) -> Part:
    """A hole from edge to edge of its outline. Its first line is on the outline, or is not."""
    corners = [(65, 40), (75, 40), (75, 60), (65, 60)]
    hole = contour(corners if starts_at_edge else corners[1:] + corners[:1], name="hole")
    return part(rectangle(50, 40, 40, 20, "outline"), hole)


def shared_edges_unseen(patch: Patch) -> None:
    """Paths run beside common edges too."""

    def find_none(*_: object) -> object:
        return np.zeros((0, 2), np.int64)

    patch.setattr(module("geometry.offset"), "_find_edge_pairs", find_none)


def crossing_ones_cut(patch: Patch) -> None:
    """Paths are planned as if nothing crossed."""

    def find_none(curve: OffsetCurve, *_: object) -> object:
        return np.zeros(len(curve.segments), bool)

    patch.setattr(module("plan.follow"), "_are_too_near", find_none)


@pytest.mark.parametrize("starts_at_edge", [False, True])
def test_a_hole_from_edge_to_edge_of_its_outline_is_worked_from_inside(
    starts_at_edge: bool, monkeypatch: Patch
) -> None:
    drawn = make_inner(starts_at_edge=starts_at_edge)
    assert camgen.build(drawn, post="gcode", job=JOB).motion.contours == 2
    wrong_radius(monkeypatch)
    with pytest.raises(VerifyError, match="works where nothing is drawn"):
        camgen.build(drawn, post="gcode", job=JOB)


def test_a_common_edge_is_not_missing_but_the_rest_is(monkeypatch: Patch) -> None:
    drawn = part(*make_neighbours(0), *make_neighbours(100))
    assert camgen.build(drawn, post="gcode", job=JOB).motion.contours == 4
    without_last_path(monkeypatch)
    with pytest.raises(VerifyError, match=r"contour c\d* is not worked"):
        camgen.build(drawn, post="gcode", job=JOB)


def test_a_path_beside_a_common_edge_is_refused(monkeypatch: Patch) -> None:
    upper = contour([(50, 60), (50, 50), (60, 50), (70, 50), (70, 60), (60, 60)], name="c1")
    lower = contour([(65, 50), (55, 50), (55, 40), (45, 40), (45, 30), (65, 30)], name="c2")
    camgen.build(part(upper, lower), post="gcode", job=JOB)
    shared_edges_unseen(monkeypatch)
    with pytest.raises(VerifyError, match=r"nearer to contour c\d"):
        camgen.build(part(upper, lower), post="gcode", job=JOB)


def test_a_path_within_a_part_that_shares_its_edges_is_refused(monkeypatch: Patch) -> None:
    """Each side of the middle tile belongs to a neighbour, whose outside it seems to be."""
    tiles = [rectangle(20 * (k % 3), 20 * (k // 3), 20, 20, f"c{k}") for k in range(9)]
    result = camgen.build(part(*tiles), post="gcode", job=JOB)
    (path,) = result.planned
    assert np.ptp(path.position[:, :2], axis=0) == pytest.approx([63, 63])
    shared_edges_unseen(monkeypatch)
    with pytest.raises(VerifyError, match=r"beside contour c\d, in the part beyond it"):
        camgen.build(part(*tiles), post="gcode", job=JOB)


@pytest.mark.parametrize("x", [7.0, 24.0, 81.3])
def test_a_motion_that_gouges_a_small_neighbour_on_its_way_is_refused(
    x: float, monkeypatch: Patch
) -> None:
    """The middle and the ends of the motion along the plate are far from it."""
    small = replace(rectangle(x, 21, 2, 2, "small"), layer="B")
    drawn = part(rectangle(0, 0, 100, 20, "plate"), small)
    job = {"tool": {"diameter": 6.0}, "operations": [{"kind": "follow", "layers": ["0"]}]}
    camgen.build(drawn, post="rapid", job=job)
    neighbours_gouged(monkeypatch)
    with pytest.raises(VerifyError, match="nearer to contour small"):
        camgen.build(drawn, post="rapid", job=job)


def test_the_tool_keeps_clear_of_contours_that_cross_a_little(monkeypatch: Patch) -> None:
    """0.01 mm of the corner of the plate are in the circle: both are left out, and `b` is not."""
    plate, small = rectangle(0, 0, 60, 40, "plate"), circle(60.7, 40.7, 1, "circle")
    far, near = rectangle(66, 30, 20, 20, "b"), rectangle(63, 30, 20, 20, "b")
    result = camgen.build(part(plate, small, far), post="rapid", job=JOB)
    assert result.motion.contours == 1
    assert [note.ids for note in result.notes if note.kind == "skipped"] == [("plate", "circle")]
    with pytest.raises(NoSafeProgram, match="too near to crossing ones: b"):
        camgen.build(part(plate, small, near), post="rapid", job=JOB)
    crossing_ones_cut(monkeypatch)
    with pytest.raises(VerifyError, match="comes nearer to contour circle"):
        camgen.build(part(plate, small, near), post="rapid", job=JOB)


def test_pockets_with_common_edges_are_cleared_one_by_one(monkeypatch: Patch) -> None:
    """The tool leaves material in corners of each pocket. Both together have no corners there."""
    lower = contour([(0, 0), (0, 20), (10, 20), (10, 10), (20, 10), (20, 0)], name="lower")
    upper = contour([(10, 20), (0, 20), (0, 30), (30, 30), (30, 10), (10, 10)], name="upper")
    job = {**JOB, "operation": {"kind": "pocket"}}
    assert camgen.build(part(lower, upper), post="gcode", job=job).motion.contours == 2
    without_last_path(monkeypatch)
    with pytest.raises(VerifyError, match="the area is not cleared"):
        camgen.build(part(lower, upper), post="gcode", job=job)


def test_a_tile_whose_sides_touch_the_border_of_a_crossing_plate_is_left_out() -> None:
    """Three sides are on the border, and the middle of the fourth is the end of a line of it."""
    corners = [(40, 49), (40, 39), (60, 39), (60, 49), (55, 49), (50, 44), (55, 49)]
    plate, tile = contour(corners, name="plate"), rectangle(50, 39, 10, 10, "tile")
    drawn = part(plate, tile, circle(80, 45, 5, "circle"))
    result = camgen.build(drawn, post="gcode", job=JOB)
    assert result.motion.contours == 1
    assert [note.ids for note in result.notes if note.kind == "skipped"] == [("plate",), ("tile",)]
