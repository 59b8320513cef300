"""Drilling: marks in pictures, rings, circles of drawings, and the motions at each hole."""

from __future__ import annotations

import itertools
from pathlib import Path

import cv2
import ezdxf
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import camgen
from bench.plan.boards import CENTRE, MM, mark_errors, marks, part_of
from camgen.model.errors import InputError, JobError
from camgen.model.part import Contour, Part
from camgen.model.pose import frozen
from camgen.model.program import MoveJ, MoveL
from camgen.plan import Plan, plan
from camgen.read.job_file import from_mapping
from camgen.vision.crosses import find_crosses


def plan_drill(part: Part, diameter: float = 1.0, **operation: object) -> Plan:
    return plan(
        part,
        from_mapping({"operation": {"kind": "drill", **operation}, "tool": {"diameter": diameter}}),
    )


def circle(x: float, y: float, radius: float, layer: str = "0", name: str = "c") -> Contour:
    return Contour(
        frozen([(x - radius, y), (x + radius, y)]), frozen([1.0, 1.0]), True, layer, name
    )


def polygon(
    points: list[tuple[float, float]], closed: bool = True, bulges: list[float] | None = None
) -> Contour:
    return Contour(frozen(points), frozen(bulges or np.zeros(len(points))), closed, "0", "p")


def part_with(*contours: Contour) -> Part:
    return Part("part", "part.dxf", "mm", contours, ())


def list_centres(planned: Plan) -> list[tuple[float, float]]:
    return [tuple(path.position[0, :2].round(4).tolist()) for path in planned.paths]


@pytest.mark.parametrize("seed", range(50))
def test_marks_are_all_found_and_none_is_invented(seed: int) -> None:
    missed, invented, deviations = mark_errors(marks(seed))
    assert (missed, invented) == (0, 0)
    assert deviations.max() < CENTRE


def test_marks_of_light_ink_in_a_picture_with_colours_are_found() -> None:
    board = marks(3)
    light, ink = 255 - board.picture, 255 - board.ink
    crosses = find_crosses(ink, cv2.merge([light, light, light]))
    assert len(crosses) == len(board.centres)


def test_a_mark_has_its_rotation_reach_and_width() -> None:
    big = np.zeros((800, 800), dtype=np.uint8)
    turn = np.radians(12)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    for wide, high in ((160, 24), (24, 160)):
        box = np.array([(-wide, -high), (wide, -high), (wide, high), (-wide, high)])
        corners = box / 1.0 @ rotation.T + (399.5, 379.5)
        cv2.fillPoly(big, [np.rint(corners * 16).astype(np.int32)[:, None]], 255, cv2.LINE_8, 4)
    grey = cv2.resize(big, (100, 100), interpolation=cv2.INTER_AREA)
    (cross,) = find_crosses((grey > 127).astype(np.uint8) * 255, grey)
    # Eight pixels of the large picture are one of the small one, so u is (399.5 + 0.5) / 8 - 0.5.
    assert (cross.u, cross.v) == pytest.approx((49.5, 47.0), abs=0.05)
    assert cross.turn == pytest.approx(turn, abs=0.02)
    assert cross.reach == pytest.approx(20, abs=0.7)
    assert cross.width == pytest.approx(6, abs=0.7)


def test_circles_of_a_drawing_are_drilled_but_not_the_pads_around_them() -> None:
    part = part_with(
        *(circle(10 * k, 5, r, "holes", f"c{k}") for k, r in enumerate((0.4, 0.4, 0.5, 1.5), 1)),
        *(circle(10 * k, 5, 0.9, "pads") for k in (1, 2)),
        polygon([(0, 0), (50, 0), (50, 20), (0, 20)]),
    )
    planned = plan_drill(part)
    assert list_centres(planned) == [(10, 5), (20, 5), (30, 5), (40, 5)]
    assert {path.layer for path in planned.paths} == {"holes"}
    texts = [note.what for note in planned.notes]
    assert "4 holes: 2 of 0.8 mm, 1 of 1 mm, 1 of 3 mm" in texts
    assert "2 circles around holes taken for pads" in texts
    assert "1 contour is not a circle and is not drilled" in texts
    assert any("3 holes are drawn wider or narrower" in what for what in texts)
    chosen = plan_drill(part, 0.8, holes=[0.7, 0.9])
    assert [path.id for path in chosen.paths] == ["c1", "c2"]
    assert not [note for note in chosen.notes if note.kind == "warning"]


@pytest.mark.parametrize(
    ("tool", "depth", "drilled"),
    [
        ({"diameter": 5.0}, 4.0, ["wide", "same"]),
        ({"diameter": 5.02}, 4.0, ["wide"]),
        ({"diameter": 5.0}, 0.0, ["wide", "same", "narrow"]),  # a touch cuts nothing
        ({"kind": "v", "diameter": 9.0}, 1.5, ["wide", "same", "narrow"]),  # 3 mm wide
        ({"kind": "v", "diameter": 9.0, "tip_angle": 120.0}, 1.0, ["wide", "same"]),  # 3.46 mm
        ({"kind": "v", "diameter": 9.0, "tip_diameter": 1.0}, 2.5, ["wide"]),  # 6 mm
        ({"diameter": 8.0}, 4.0, []),
    ],
)
def test_a_circle_smaller_than_the_cut_is_left_out(
    tool: dict[str, object], depth: float, drilled: list[str]
) -> None:
    holes = {"wide": 3.0, "same": 2.5, "narrow": 1.5}
    circles = [circle(10 * k, 0, holes[name], "0", name) for k, name in enumerate(holes)]
    job = {"operation": {"kind": "drill", "depth": depth}, "tool": tool}
    planned = plan(part_with(*circles), from_mapping(job))
    assert [path.id for path in planned.paths] == drilled
    skipped = [note.ids for note in planned.notes if note.kind == "skipped"]
    assert skipped == ([tuple(holes)[len(drilled) :]] if len(drilled) < len(holes) else [])
    sizes = [note.what for note in planned.notes if note.why == "sizes to 0.05 mm"]
    assert len(sizes) == (len(drilled) > 0)


def test_only_circles_are_drilled() -> None:
    angle = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    circle_of_lines = [(5 + 0.5 * np.cos(a), 5 + 0.5 * np.sin(a)) for a in angle]
    oval = [(15 + 0.5 * np.cos(a), 5 + 0.6 * np.sin(a)) for a in angle]
    square = [(24.5, 4.5), (25.5, 4.5), (25.5, 5.5), (24.5, 5.5)]
    there_and_back = polygon([(34.5, 5), (35.5, 5)], bulges=[1.0, -1.0])
    half = polygon([(44.5, 5), (45.5, 5)], bulges=[1.0, 0.0])
    open_arc = polygon(circle_of_lines[:30], False)
    others = polygon(oval), polygon(square), there_and_back, half, open_arc
    assert list_centres(plan_drill(part_with(polygon(circle_of_lines), *others))) == [(5, 5)]


def test_rings_and_marks_of_a_picture_are_drilled() -> None:
    copper = np.zeros((300, 400), dtype=np.uint8)
    for u, v, hole in ((60, 60, 6), (150, 80, 6), (250, 200, 9)):
        cv2.circle(copper, (u, v), 20, 255, -1)
        cv2.circle(copper, (u, v), hole, 0, -1)
    cv2.circle(copper, (330, 60), 12, 255, -1)  # a pad without a hole
    cv2.rectangle(copper, (90, 205), (110, 207), 255, -1)
    cv2.rectangle(copper, (99, 196), (101, 216), 255, -1)
    planned = plan_drill(part_of(copper))
    holes = [(u * MM, (299 - v) * MM) for u, v in ((100, 206), (60, 60), (150, 80), (250, 200))]
    centres = sorted(path.position[0, :2].tolist() for path in planned.paths)
    assert np.array(centres) == pytest.approx(np.array(sorted(holes)), abs=0.2 * MM)
    assert [path.id for path in planned.paths].count("mark1") == 1
    assert "1 at a mark" in planned.notes[-2].what


def test_a_hole_goes_straight_down_in_pecks_and_up() -> None:
    (path,) = plan_drill(part_with(circle(3, 4, 0.5)), depth=1.8, passes=3).paths
    assert path.position[:, 2].tolist() == pytest.approx(
        [0, -0.6, 2, -0.346, -1.2, 2, -0.946, -1.8, 0]
    )
    assert (path.position[:, :2] == [3, 4]).all()
    assert path.feed.tolist() == [20, 20, 100, 100, 20, 100, 100, 20, 100]
    assert not path.reversible
    (touch,) = plan_drill(part_with(circle(3, 4, 0.5))).paths
    assert touch.position.tolist() == [[3, 4, 0]]


@given(st.floats(0.05, 30), st.integers(1, 12), st.floats(0, 8))
def test_no_peck_is_deeper_than_its_share_of_the_depth(
    depth: float, passes: int, approach: float
) -> None:
    job = {
        "operation": {"kind": "drill", "depth": depth, "passes": passes},
        "process": {"approach": approach},
    }
    (path,) = plan(part_with(circle(3, 4, 3.0)), from_mapping(job)).paths
    z, feed = path.position[:, 2], path.feed
    cuts = z[1:][feed[1:] == 20]
    bites = -np.diff(np.concatenate([[0.0], cuts]))
    assert cuts[-1] == pytest.approx(-depth)
    assert bites.min() > 0
    assert bites.max() <= depth / passes * (1 + 2e-6)
    assert passes <= len(cuts) <= passes + 1
    # No rapid motion ends in material.
    for before, after, speed in zip(np.minimum.accumulate(z), z[1:], feed[1:], strict=False):
        assert speed == 20 or after >= before


@pytest.mark.parametrize("post", ["gcode", "grbl", "vplus", "rapid", "pacscript"])
def test_a_program_drills_every_hole_once_and_travels_above(post: str, tmp_path: Path) -> None:
    drawing = ezdxf.new(units=4)
    holes = list(itertools.product((5.0, 12.0, 19.0, 26.0), (5.0, 11.0, 17.0)))
    for centre in holes:
        drawing.modelspace().add_circle(centre, 0.4)
    drawing.saveas(tmp_path / "holes.dxf")
    job = {"operation": {"kind": "drill", "depth": 1.6, "passes": 2}, "tool": {"diameter": 0.8}}
    job["process"] = {"spindle": 9000.0 if post in ("gcode", "grbl") else 0.0}
    result = camgen.build(tmp_path / "holes.dxf", post=post, job=job)
    at: tuple[float, float, float] | None = None
    bottoms = []
    for item in result.program.body:
        if isinstance(item, (MoveL, MoveJ)) and not hasattr(item.target, "values"):
            target = item.target.origin
            # No corner is blended near or in the material.
            assert item.blend == 0 or target[2] > 10
            if at is not None and min(at[2], target[2]) < 1.0:
                # A motion near the top face runs straight up or down.
                assert target[:2] == pytest.approx(at[:2], abs=1e-9)
            if target[2] == pytest.approx(-1.6):
                bottoms.append(target[:2])
                assert item.speed == 20
            at = target
    assert np.array(sorted(bottoms)) == pytest.approx(np.array(sorted(holes)))
    assert result.deviation.max_mm < 0.001


def test_a_drawing_or_job_that_cannot_be_drilled_is_refused_with_the_reason() -> None:
    square = part_with(polygon([(0, 0), (5, 0), (5, 5), (0, 5)]))
    with pytest.raises(InputError, match=r"no \+ mark, ring or circle to drill"):
        plan_drill(square)
    hole = part_with(circle(0, 0, 1))
    with pytest.raises(InputError, match="no hole to drill among 1 found"):
        plan_drill(hole, holes=[0.5, 1.0])
    with pytest.raises(JobError, match="is not a range of diameters"):
        plan_drill(hole, holes=[2.0, 1.0])
    pressing = from_mapping({"operation": {"kind": "drill"}, "process": {"force": 2.0}})
    plunging = from_mapping({"operation": {"kind": "drill"}, "process": {"plunge": 2.0}})
    with pytest.raises(
        JobError, match=r"a drill goes down at process\.feed \(process\.plunge\); leave it out"
    ):
        plan(part_with(circle(0, 0, 1)), plunging)
    with pytest.raises(JobError, match="not to a force"):
        plan(hole, pressing)


def test_a_note_counts_the_holes_in_the_ink_that_are_not_circles() -> None:
    """The board of the fixtures has seven round holes, and others that are left out."""
    board = Path(__file__).parents[2] / "fixtures" / "parts" / "board.png"
    result = camgen.build(
        board, post="gcode", job={"operation": {"kind": "drill"}, "image": {"width_mm": 60}}
    )
    assert len(result.tour.paths) == 7
    assert any("not circles and are not drilled" in note.what for note in result.notes)
