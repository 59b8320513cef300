"""Lead-in, lead-out and overlap."""

import math

import numpy as np
import pytest

from camgen.geometry.arcs import measure_path, measure_spans
from camgen.geometry.intersect import Obstacles
from camgen.geometry.segments import make_contour_segments
from camgen.model.job import Job, OperationTable, ProcessTable
from camgen.model.part import Contour, Note
from camgen.model.path import ToolPath
from camgen.order.leads import add_leads
from camgen.plan import plan
from camgen.plan.starting import move_start
from tests.support.drawn import circle, contour, part, rectangle


def plan_with_leads(*contours: Contour, **operation: object) -> tuple[list[ToolPath], list[Note]]:
    job = Job(operation=OperationTable(**operation))  # type: ignore[arg-type]
    drawn = part(*contours)
    return add_leads(plan(drawn, job).paths, drawn, job)


def list_tangents(path: ToolPath) -> list[np.ndarray]:
    """Directions at the start and at the end of each segment, from its ends and its via point."""
    directions = []
    for a, v, b in zip(path.position[:-1], path.via[1:], path.position[1:], strict=True):
        if np.isnan(v[0]):
            directions += [(b - a) / np.linalg.norm(b - a)] * 2
        else:
            # The tangent at an end of an arc is the chord, mirrored at the chord to the via point.
            chord = (b - a) / np.linalg.norm(b - a)
            for half in ((v - a) / np.linalg.norm(v - a), (b - v) / np.linalg.norm(b - v)):
                directions.append(2 * (half @ chord) * half - chord)
    return directions


def test_a_lead_is_a_quarter_circle_that_meets_the_path_smoothly() -> None:
    (path,), notes = plan_with_leads(rectangle(0, 0, 100, 60), lead_in=4.0, lead_out=3.0)
    assert not notes
    lengths = measure_spans(path.position, path.via[1:])
    assert lengths[0] == pytest.approx(4.0)
    assert lengths[-1] == pytest.approx(3.0)
    direction = list_tangents(path)
    assert direction[1] @ direction[2] == pytest.approx(1.0)
    assert direction[-3] @ direction[-2] == pytest.approx(1.0)
    assert abs(direction[0] @ direction[1]) == pytest.approx(0.0, abs=1e-9)
    assert not path.closed


def test_leads_never_come_nearer_to_the_part_than_the_tool() -> None:
    shapes = [rectangle(0, 0, 100, 60), circle(30, 30, 12, "c2"), rectangle(60, 20, 20, 9, "c3")]
    paths, _ = plan_with_leads(*shapes, lead_in=5.0, lead_out=5.0)
    assert len(paths) == 3
    obstacles = Obstacles(
        drawn := make_contour_segments(shapes), np.zeros(len(drawn), dtype=np.int64)
    )
    for path in paths:
        for row in (1, len(path.position) - 1):
            points = np.array([path.position[row - 1], path.via[row], path.position[row]])[:, :2]
            points = points[~np.isnan(points[:, 0])]
            gap = obstacles.nearest(points, np.zeros(len(points), dtype=np.int64), 3.0)
            assert (gap >= 3.0 - 0.005).all()


def test_a_lead_that_does_not_fit_is_shortened_with_a_note() -> None:
    (path,), notes = plan_with_leads(circle(0, 0, 4), side="inside", lead_in=8.0)
    # In a hole of 8 mm the centre of the 6 mm tool runs on a circle with a radius of 1 mm.
    # So the lead is a quarter circle with a radius of 1 mm at most.
    assert measure_path(path) <= 2 * math.pi + math.pi / 2 + 1e-9
    assert len(notes) == 1
    assert notes[0].kind == "warning"


def test_an_overlap_continues_beyond_the_seam() -> None:
    (path,), _ = plan_with_leads(rectangle(0, 0, 100, 60), overlap=7.5)
    (plain,), _ = plan_with_leads(rectangle(0, 0, 100, 60))
    assert measure_path(path) == pytest.approx(measure_path(plain) + 7.5)
    assert not path.closed
    (long,), _ = plan_with_leads(rectangle(0, 0, 100, 60), overlap=130.0)
    assert measure_path(long) == pytest.approx(measure_path(plain) + 130.0)
    (twice,), _ = plan_with_leads(circle(0, 0, 10), overlap=1000.0)
    assert measure_path(twice) == pytest.approx(2 * 2 * math.pi * 13)


def test_a_lead_has_no_force() -> None:
    job = Job(operation=OperationTable(lead_in=4.0, lead_out=4.0), process=ProcessTable(force=5.0))
    drawn = part(circle(0, 0, 20))
    ((path,), _) = add_leads(plan(drawn, job).paths, drawn, job)
    assert path.force[1] == 0.0
    assert path.force[-1] == 0.0
    assert (path.force[2:-1] == 5.0).all()


def test_a_lead_at_an_outer_corner_keeps_the_feed() -> None:
    job = Job(operation=OperationTable(lead_in=4.0, lead_out=4.0), process=ProcessTable(feed=10.0))
    drawn = part(rectangle(0, 0, 60, 40))
    (planned,) = plan(drawn, job).paths
    corner = move_start(planned, int(np.argmax(planned.feed[1:])) + 1, 0.5)
    assert corner.feed[1] == corner.feed[-1] == 20.0
    ((path,), _) = add_leads([corner], drawn, job)
    assert path.feed[[1, -1]].tolist() == [10.0, 10.0]
    assert path.feed[[2, -2]].tolist() == [20.0, 20.0]


def test_the_force_stays_perpendicular_to_the_travel_along_a_lead() -> None:
    (path,), _ = plan_with_leads(circle(0, 0, 20), lead_in=4.0, lead_out=4.0)
    direction = list_tangents(path)
    for row in range(1, len(path.position)):
        for end in (0, 1):
            travel = direction[2 * (row - 1) + end]
            assert path.force_direction[row, end] @ travel == pytest.approx(0.0, abs=1e-6)


def test_the_leads_of_an_open_contour_run_along_its_tangents() -> None:
    line = contour([(0, 0), (50, 0)], closed=False)
    (path,), _ = plan_with_leads(line, side="left", lead_in=5.0, lead_out=2.0)
    assert path.position[0].tolist() == pytest.approx([-5, 3, 0])
    assert path.position[-1].tolist() == pytest.approx([52, 3, 0])


def test_traced_lines_have_no_leads() -> None:
    (path,), notes = plan_with_leads(circle(0, 0, 20), kind="trace", lead_in=5.0)
    assert measure_path(path) == pytest.approx(40 * math.pi)
    assert not notes


def test_a_lead_without_space_at_the_seam_is_moved_to_the_middle_of_a_long_side() -> None:
    # The seam is at the lower left corner, and the lead to it would come from the lower right.
    shapes = [rectangle(0, 0, 100, 60), circle(10, -9, 3, "c2")]
    paths, notes = plan_with_leads(*shapes, lead_in=12.0)
    (path,) = [path for path in paths if path.contours == ("c1",)]
    assert not notes
    # The tool of 6 mm runs 3 mm from the long sides, whose middle is at x = 50.
    x, y, _ = path.position[1]
    assert (x, y) == pytest.approx((50.0, 63.0))
