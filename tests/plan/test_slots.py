"""Slots, necks and holes as wide as the tool: plans, their proof, and faults that it finds."""

import math
from typing import Any

import numpy as np
import pytest

import camgen
from camgen.model.body import Body
from camgen.model.errors import NoSafeProgram, VerifyError
from camgen.model.part import Contour
from tests.support.drawn import circle, contour, part, rectangle
from tests.support.sabotage import Patch, change_program, change_result, module, with_columns
from tests.support.swept import enclosed, swept

DEPTH = 2.0
SLOT = contour([(0, -3), (30, -3), (30, 3), (0, 3)], [0, 1, 0, 1])
DOG_BONE = contour(
    [(0, 0), (20, 0), (20, 7), (40, 7), (40, 0), (60, 0), (60, 20), (40, 20), (40, 13), (20, 13),
     (20, 20), (0, 20)]
)  # fmt: skip
SHAPES = {
    "slot": (SLOT,),
    "square slot": (rectangle(0, 0, 30, 6),),
    "bent slot": (
        contour(
            [(0, 17), (17, 0), (23, 0), (0, 23)],
            [-math.tan(math.pi / 8), 1, math.tan(math.pi / 8), 1],
        ),
    ),
    "L": (contour([(0, 0), (30, 0), (30, 30), (24, 30), (24, 6), (0, 6)]),),
    "T": (contour([(0, 0), (30, 0), (30, 6), (18, 6), (18, 30), (12, 30), (12, 6), (0, 6)]),),
    "ring": (circle(0, 0, 23), circle(0, 0, 17, "c2")),
    "two rooms and a neck": (DOG_BONE,),
}


def make_job(kind: str, **operation: Any) -> dict[str, Any]:
    settings = {"kind": kind, "depth": DEPTH, **operation}
    return {"operation": settings, "process": {"spindle": 9000.0}, "tool": {"diameter": 6.0}}


def choose_side(shapes: tuple[Contour, ...]) -> dict[str, str]:
    """Settings with which `follow` runs within the shapes; a ring needs none."""
    return {} if len(shapes) > 1 else {"side": "inside"}


@pytest.mark.parametrize("kind", ["follow", "pocket"])
@pytest.mark.parametrize("name", SHAPES)
def test_a_slot_as_wide_as_the_tool_is_cut_without_its_walls(name: str, kind: str) -> None:
    shapes = SHAPES[name]
    if kind == "follow" and name == "ring":
        shapes = (rectangle(-40, -40, 80, 80, "c3"), *shapes)
    more = choose_side(shapes) if kind == "follow" else {}
    result = camgen.build(part(*shapes), post="gcode", job=make_job(kind, entry="ramp", **more))
    covered = swept(result.tour.paths, 3.0)
    region = enclosed(SHAPES[name])
    # The rest material in an inner corner of 90 degrees is (1 - pi / 4) r^2.
    corners = {"square slot": 4, "L": 5, "T": 6, "two rooms and a neck": 8}.get(name, 0)
    left = corners * (1 - math.pi / 4) * 9
    if kind == "pocket" or name in ("slot", "square slot", "bent slot"):
        assert region.difference(covered).area == pytest.approx(left, abs=0.05)
        assert covered.difference(region.buffer(0.002)).area < 1e-3
    assert not [note for note in result.notes if note.kind == "skipped"]


def find_cuts(body: Body) -> np.ndarray:
    """Indices of the motions that start and end at the depth, (M,)."""
    deep = np.abs(body.packed.end[:, 2] + DEPTH) < 1e-6
    return np.flatnonzero(deep & np.append(False, deep[:-1]))


def find_longest(body: Body) -> int:
    """Index of the longest motion at the depth, which is in the slot or the neck."""
    rows = find_cuts(body)
    length = np.hypot(*(body.packed.end[rows] - body.packed.end[rows - 1])[:, :2].T)
    return int(rows[int(np.argmax(length))])


def move_cut(body: Body) -> Body:
    end = body.packed.end.copy()
    end[find_longest(body), 1] += 0.1
    return with_columns(body, end=end)


def shorten_cut(body: Body) -> Body:
    end, row = body.packed.end.copy(), find_longest(body)
    end[row:][np.abs(end[row:, :2] - end[row, :2]).max(axis=1) < 1e-6, 0] -= 1.0
    return with_columns(body, end=end)


def deepen_cut(body: Body) -> Body:
    end = body.packed.end.copy()
    end[find_longest(body), 2] -= 0.5
    return with_columns(body, end=end)


def leave_out_cut(body: Body) -> Body:
    return body.take(np.delete(np.arange(len(body)), body.at[find_longest(body)]))


@pytest.mark.parametrize("fault", [move_cut, shorten_cut, deepen_cut, leave_out_cut])
@pytest.mark.parametrize("kind", ["follow", "pocket"])
def test_a_fault_in_a_slot_is_found(kind: str, fault: Any, monkeypatch: Patch) -> None:
    settings = make_job(kind, **({"side": "inside"} if kind == "follow" else {}))
    camgen.build(part(SLOT), post="gcode", job=settings)
    change_program(monkeypatch, fault)
    with pytest.raises((VerifyError, NoSafeProgram)):
        camgen.build(part(SLOT), post="gcode", job=settings)


@pytest.mark.parametrize("kind", ["follow", "pocket"])
def test_a_neck_that_is_left_out_is_found(kind: str, monkeypatch: Patch) -> None:
    """The areas on both sides of the neck are cut."""
    settings = make_job(kind, **({"side": "inside"} if kind == "follow" else {}))
    camgen.build(part(DOG_BONE), post="gcode", job=settings)
    monkeypatch.setattr(module("plan.follow"), "with_centre_lines", lambda curve, _: curve)
    change_result(monkeypatch, "plan.pocket", "plan_slots", lambda _: [])
    with pytest.raises(VerifyError, match=r"not worked|not cleared"):
        camgen.build(part(DOG_BONE), post="gcode", job=settings)


@pytest.mark.parametrize("kind", ["bore", "pocket"])
def test_a_hole_as_wide_as_the_mill_needs_one_that_cuts_over_its_centre(kind: str) -> None:
    hole = part(circle(5, 5, 3))
    settings = make_job(kind)
    with pytest.raises(NoSafeProgram, match=r"drill it, or set tool\.center_cutting = true"):
        camgen.build(hole, post="gcode", job=settings)
    settings["tool"]["center_cutting"] = True
    result = camgen.build(hole, post="gcode", job=settings)
    (path,) = result.tour.paths
    assert path.position.tolist() == [pytest.approx([5, 5, 0])]


@pytest.mark.parametrize("kind", ["bore", "pocket"])
def test_a_stroke_into_a_hole_that_is_left_out_is_found(kind: str, monkeypatch: Patch) -> None:
    holes = part(circle(5, 5, 3), circle(25, 5, 4, "c2"))
    settings = make_job(kind)
    settings["tool"]["center_cutting"] = True

    def shallow(body: Body) -> Body:
        end = body.packed.end.copy()
        end[(np.abs(end[:, :2] - 5).max(axis=1) < 1e-6) & (end[:, 2] < 0), 2] = 0.5
        return with_columns(body, end=end)

    camgen.build(holes, post="gcode", job=settings)
    change_program(monkeypatch, shallow)
    with pytest.raises(VerifyError, match=r"not worked|nothing is to be worked"):
        camgen.build(holes, post="gcode", job=settings)


def test_a_slot_too_narrow_is_refused_with_its_width() -> None:
    narrow = contour([(0, -2.99), (30, -2.99), (30, 2.99), (0, 2.99)], [0, 1, 0, 1])
    for kind in ("follow", "pocket"):
        more = {"side": "inside"} if kind == "follow" else {}
        with pytest.raises(NoSafeProgram, match=r"it is 5\.98 mm wide, a 6 mm tool does not fit"):
            camgen.build(part(narrow), post="gcode", job=make_job(kind, **more))
