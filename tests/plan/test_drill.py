"""Drilling: marks in pictures, rings, circles of drawings, and the moves that are made of them."""

from __future__ import annotations

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


def planned(part: Part, diameter: float = 1.0, **operation: object) -> Plan:
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


def centres(found: Plan) -> list[tuple[float, float]]:
    return [tuple(path.position[0, :2].round(4).tolist()) for path in found.paths]


@pytest.mark.parametrize("seed", range(50))
def test_marks_are_all_found_and_none_invented(seed: int) -> None:
    missed, invented, off = mark_errors(marks(seed))
    assert (missed, invented) == (0, 0)
    assert off.max() < CENTRE


def test_marks_of_light_ink_on_dark_and_in_colour() -> None:
    board = marks(3)
    light, ink = 255 - board.picture, 255 - board.ink
    found = find_crosses(ink, cv2.merge([light, light, light]))
    assert len(found) == len(board.centres)


def test_a_mark_tells_its_turn_reach_and_width() -> None:
    big = np.zeros((800, 800), dtype=np.uint8)
    turn = np.radians(12)
    turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    for wide, high in ((160, 24), (24, 160)):
        corners = np.array(
            [(-wide, -high), (wide, -high), (wide, high), (-wide, high)]
        ) / 1.0 @ turned.T + (
            399.5,
            379.5,
        )
        cv2.fillPoly(big, [np.rint(corners * 16).astype(np.int32)[:, None]], 255, cv2.LINE_8, 4)
    grey = cv2.resize(big, (100, 100), interpolation=cv2.INTER_AREA)
    (cross,) = find_crosses((grey > 127).astype(np.uint8) * 255, grey)
    # A pixel of the small picture is eight of the large one; its centre (399.5 + 0.5) / 8 - 0.5.
    assert (cross.u, cross.v) == pytest.approx((49.5, 47.0), abs=0.05)
    assert cross.turn == pytest.approx(turn, abs=0.02)
    assert cross.reach == pytest.approx(20, abs=0.7)
    assert cross.width == pytest.approx(6, abs=0.7)


def test_circles_of_a_drawing_by_diameter_the_inner_of_a_pad() -> None:
    part = part_with(
        *(circle(10 * k, 5, r, "holes", f"c{k}") for k, r in enumerate((0.4, 0.4, 0.5, 1.5), 1)),
        *(circle(10 * k, 5, 0.9, "pads") for k in (1, 2)),
        polygon([(0, 0), (50, 0), (50, 20), (0, 20)]),
    )
    found = planned(part)
    assert centres(found) == [(10, 5), (20, 5), (30, 5), (40, 5)]
    assert {path.layer for path in found.paths} == {"holes"}
    told = [note.what for note in found.notes]
    assert "4 holes: 2 of 0.8 mm, 1 of 1 mm, 1 of 3 mm" in told
    assert "2 circles around holes taken for pads" in told
    assert "1 contour is not a circle and is not drilled" in told
    assert any("3 holes are drawn wider or narrower" in what for what in told)
    chosen = planned(part, 0.8, holes=[0.7, 0.9])
    assert [path.id for path in chosen.paths] == ["c1", "c2"]
    assert not [note for note in chosen.notes if note.kind == "warning"]


def test_what_is_no_circle_is_not_drilled() -> None:
    angle = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    many = [(5 + 0.5 * np.cos(a), 5 + 0.5 * np.sin(a)) for a in angle]
    oval = [(15 + 0.5 * np.cos(a), 5 + 0.6 * np.sin(a)) for a in angle]
    square = [(24.5, 4.5), (25.5, 4.5), (25.5, 5.5), (24.5, 5.5)]
    there_and_back = polygon([(34.5, 5), (35.5, 5)], bulges=[1.0, -1.0])
    half = polygon([(44.5, 5), (45.5, 5)], bulges=[1.0, 0.0])
    found = planned(
        part_with(
            polygon(many),
            polygon(oval),
            polygon(square),
            there_and_back,
            half,
            polygon(many[:30], False),
        )
    )
    assert centres(found) == [(5, 5)]


def test_rings_and_marks_of_a_picture() -> None:
    copper = np.zeros((300, 400), dtype=np.uint8)
    for u, v, hole in ((60, 60, 6), (150, 80, 6), (250, 200, 9)):
        cv2.circle(copper, (u, v), 20, 255, -1)
        cv2.circle(copper, (u, v), hole, 0, -1)
    cv2.circle(copper, (330, 60), 12, 255, -1)  # a pad without a hole
    cv2.rectangle(copper, (90, 205), (110, 207), 255, -1)
    cv2.rectangle(copper, (99, 196), (101, 216), 255, -1)
    found = planned(part_of(copper))
    place = [(u * MM, (299 - v) * MM) for u, v in ((100, 206), (60, 60), (150, 80), (250, 200))]
    got = sorted(path.position[0, :2].tolist() for path in found.paths)
    assert np.array(got) == pytest.approx(np.array(sorted(place)), abs=0.2 * MM)
    assert [path.id for path in found.paths].count("mark1") == 1
    assert "1 at a mark" in found.notes[-2].what


def test_a_hole_goes_straight_down_in_pecks_and_up() -> None:
    (path,) = planned(part_with(circle(3, 4, 0.5)), depth=1.8, passes=3).paths
    assert path.position[:, 2].tolist() == pytest.approx(
        [0, -0.6, 2, -0.346, -1.2, 2, -0.946, -1.8, 0]
    )
    assert (path.position[:, :2] == [3, 4]).all()
    assert path.feed.tolist() == [20, 20, 100, 100, 20, 100, 100, 20, 100]
    assert not path.reversible
    (touch,) = planned(part_with(circle(3, 4, 0.5))).paths
    assert touch.position.tolist() == [[3, 4, 0]]


@given(st.floats(0.05, 30), st.integers(1, 12), st.floats(0, 8))
def test_no_peck_is_deeper_than_its_share(depth: float, passes: int, approach: float) -> None:
    job = {
        "operation": {"kind": "drill", "depth": depth, "passes": passes},
        "process": {"approach": approach},
    }
    (path,) = plan(part_with(circle(3, 4, 0.5)), from_mapping(job)).paths
    z, feed = path.position[:, 2], path.feed
    cuts = z[1:][feed[1:] == 20]
    bites = -np.diff(np.concatenate([[0.0], cuts]))
    assert cuts[-1] == pytest.approx(-depth)
    assert bites.min() > 0
    assert bites.max() <= depth / passes * (1 + 2e-6)
    assert passes <= len(cuts) <= passes + 1
    # No rapid motion ends in what has not been drilled yet.
    for before, after, speed in zip(np.minimum.accumulate(z), z[1:], feed[1:], strict=False):
        assert speed == 20 or after >= before


@pytest.mark.parametrize("post", ["gcode", "grbl", "vplus", "rapid", "pacscript"])
def test_a_program_drills_every_hole_once_and_travels_above(post: str, tmp_path: Path) -> None:
    drawing = ezdxf.new(units=4)
    holes = [(5.0 + 7 * i, 5.0 + 6 * j) for i in range(4) for j in range(3)]
    for place in holes:
        drawing.modelspace().add_circle(place, 0.4)
    drawing.saveas(tmp_path / "holes.dxf")
    job = {"operation": {"kind": "drill", "depth": 1.6, "passes": 2}, "tool": {"diameter": 0.8}}
    job["process"] = {"spindle": 9000.0 if post in ("gcode", "grbl") else 0.0}
    result = camgen.build(tmp_path / "holes.dxf", post=post, job=job)
    at: tuple[float, float, float] | None = None
    bottoms = []
    for item in result.program.body:
        if isinstance(item, (MoveL, MoveJ)) and not hasattr(item.target, "values"):
            here = item.target.origin
            # No corner is rounded on the way into the material, nor where the feed begins.
            assert item.blend == 0 or here[2] > 10
            if at is not None and min(at[2], here[2]) < 1.0:
                # Whatever is near the face goes straight up or down.
                assert here[:2] == pytest.approx(at[:2], abs=1e-9)
            if here[2] == pytest.approx(-1.6):
                bottoms.append(here[:2])
                assert item.speed == 20
            at = here
    assert np.array(sorted(bottoms)) == pytest.approx(np.array(sorted(holes)))
    assert result.deviation.max_mm < 0.001


def test_what_cannot_be_drilled_says_why() -> None:
    square = part_with(polygon([(0, 0), (5, 0), (5, 5), (0, 5)]))
    with pytest.raises(InputError, match=r"no \+ mark, ring or circle to drill"):
        planned(square)
    hole = part_with(circle(0, 0, 1))
    with pytest.raises(InputError, match="no hole to drill among 1 found"):
        planned(hole, holes=[0.5, 1.0])
    with pytest.raises(JobError, match="is not a range of diameters"):
        planned(hole, holes=[2.0, 1.0])
    pressing = from_mapping({"operation": {"kind": "drill"}, "process": {"force": 2.0}})
    plunging = from_mapping({"operation": {"kind": "drill"}, "process": {"plunge": 2.0}})
    with pytest.raises(
        JobError, match=r"a drill goes down at process\.feed \(process\.plunge\); leave it out"
    ):
        plan(part_with(circle(0, 0, 1)), plunging)
    with pytest.raises(JobError, match="not to a force"):
        plan(hole, pressing)


def test_spaces_in_the_ink_that_are_no_circles_are_told() -> None:
    """The board of the fixtures has seven round holes; what is hollow besides is said to be left out."""
    board = Path(__file__).parents[2] / "fixtures" / "parts" / "board.png"
    result = camgen.build(
        board, post="gcode", job={"operation": {"kind": "drill"}, "image": {"width_mm": 60}}
    )
    assert len(result.tour.paths) == 7
    assert any("not circles and are not drilled" in note.what for note in result.notes)
