"""A build asks about an outline with a gap only if camgen itself decides a side by the outline."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import ezdxf
import pytest

import camgen
from camgen.model.errors import InputError
from camgen.plan import plan
from camgen.plan.propose import propose
from camgen.read.job_file import from_mapping
from camgen.read.made import make_part

Point = tuple[float, float]
OUTLINE = [(0.0, 0.0), (100.0, 0.0), (100.0, 60.0), (0.0, 60.0), (0.0, 0.5)]
FRAME = [(-20.0, -20.0), (120.0, -20.0), (120.0, 80.0), (-20.0, 80.0)]
WINDOW = [(30.0, 20.0), (70.0, 20.0), (70.0, 40.0), (30.0, 40.0)]
MILL = {"name": "mill", "diameter": 6.0}
PEN = {"name": "pen", "kind": "pen", "diameter": 0.5}
V_TOOL = {"kind": "v", "diameter": 8.0}
QUESTION = (
    "part.dxf: the outline c1 has a gap of 0.5 mm, so inside and outside of c2, which it encloses, "
    "would be swapped (near x 0, y 0.25); input.join = 0.501 closes it; if it is meant to be open, "
)


@pytest.fixture
def drawing(tmp_path: Path) -> Path:
    """An outline with a gap on the layer OUTLINE, and a window in it on the layer WINDOW."""
    return write_drawing(tmp_path / "part.dxf", [WINDOW])


def write_drawing(file: Path, windows: Sequence[Sequence[Point]]) -> Path:
    document = ezdxf.new("R2010", units=4)
    space = document.modelspace()
    space.add_lwpolyline(OUTLINE, dxfattribs={"layer": "OUTLINE"})
    for window in windows:
        space.add_lwpolyline(window, close=True, dxfattribs={"layer": "WINDOW"})
    document.saveas(file)
    return file


def plan_part(file: Path, job: dict[str, object]) -> list[str]:
    """The contours of the paths that `job` plans."""
    paths = plan(camgen.read(file, job), from_mapping(job)).paths
    return [path.contours[0] for path in paths]


def follow_rows(**choice: object) -> dict[str, object]:
    return {"tools": [MILL], "operations": [{"kind": "follow", "tool": "mill", **choice}]}


@pytest.mark.parametrize(
    ("job", "remedy"),
    [
        ({}, "set operation.side"),
        ({"operation": {"kind": "chamfer", "width": 1.0}, "tool": V_TOOL}, "set operation.side"),
        ({"operation": {"kind": "pocket"}}, "leave it out of what is cleared"),
        ({"operation": {"kind": "fill"}}, "leave it out of the contours to fill"),
        (follow_rows(ids=["c2"]), "set operation.side"),
        (
            follow_rows(nesting="outer", side="outside"),
            "choose by layers or ids in place of operations.0.nesting",
        ),
    ],
    ids=["follow", "chamfer", "pocket", "fill", "one contour", "nesting"],
)
def test_a_job_whose_side_depends_on_the_gap_is_refused_with_a_question(
    drawing: Path, job: dict[str, object], remedy: str
) -> None:
    with pytest.raises(InputError) as error:
        plan_part(drawing, job)
    assert str(error.value) == QUESTION + remedy


@pytest.mark.parametrize(
    ("job", "contours"),
    [
        ({"operation": {"side": "inside"}}, ["c2"]),
        ({"operation": {"side": "outside"}}, ["c2"]),
        ({"operation": {"side": "left"}}, ["c1", "c2"]),
        ({"operation": {"side": "on"}}, ["c1", "c2"]),
        ({"operation": {"kind": "trace"}}, ["c1", "c2"]),
        ({"input": {"layers": ["WINDOW"]}}, ["c1"]),
        ({"input": {"join": 0.501}}, ["c1", "c2"]),
        # An engraved outline does not bound the material.
        (
            {
                "tools": [MILL, PEN],
                "operations": [
                    {"kind": "follow", "tool": "mill", "layers": ["WINDOW"]},
                    {"kind": "trace", "tool": "pen", "layers": ["OUTLINE"]},
                ],
            },
            ["c1", "c2"],
        ),
    ],
    ids=["inside", "outside", "left", "on", "trace", "layer", "joined", "engraved"],
)
def test_a_job_that_sets_the_side_is_planned(
    drawing: Path, job: dict[str, object], contours: list[str]
) -> None:
    assert sorted(plan_part(drawing, job)) == contours


def test_an_outline_with_a_gap_inside_a_frame_is_refused_too(tmp_path: Path) -> None:
    """The window of a plate that lies in a window of its sheet would be cut like a hole."""
    file = write_drawing(tmp_path / "part.dxf", [WINDOW, FRAME])
    with pytest.raises(InputError) as error:
        plan_part(file, {})
    assert str(error.value) == QUESTION + "set operation.side"


def test_contours_that_are_not_worked_on_need_no_side(tmp_path: Path) -> None:
    other_part = [(x + 200, y) for x, y in FRAME]
    file = write_drawing(tmp_path / "part.dxf", [WINDOW, other_part])
    assert plan_part(file, follow_rows(ids=["c3"])) == ["c3"]


def test_the_message_for_a_part_made_in_code_says_how_to_close_it_there() -> None:
    part = make_part([OUTLINE, [*WINDOW, WINDOW[0]]])
    with pytest.raises(InputError, match="close it: a closed contour ends at its first point; if"):
        plan(part, from_mapping({}))


def test_several_outlines_and_many_contours_have_one_message(tmp_path: Path) -> None:
    document = ezdxf.new("R2010", units=4)
    space = document.modelspace()
    for shift, gap in ((0, 0.5), (200, 0.9)):
        corners = [(x + shift, y) for x, y in OUTLINE[:-1]]
        space.add_lwpolyline([*corners, (shift, gap)])
        for k in range(0, 20, 2):
            space.add_circle((shift + 4 * k + 10, 30), 2)
            space.add_lwpolyline([(shift + 4 * k + 8, 5), (shift + 4 * k + 10, 8)])
    document.saveas(tmp_path / "part.dxf")
    with pytest.raises(InputError) as error:
        propose(camgen.read(tmp_path / "part.dxf"))
    message = str(error.value)
    assert "the outline c1 has a gap of 0.5 mm, like 1 other, so" in message
    assert " and 2 more, which it encloses" in message
    assert "input.join = 0.901 closes all of them; if it is meant to be open, leave its" in message
