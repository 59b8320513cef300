"""A tool that follows contours never winds up its cable by more than one turn.

The controller takes the shorter rotation between two orientations.
"""

import itertools
import math
from pathlib import Path
from typing import Any

import pytest

import camgen
from camgen.lower import lower
from camgen.model.job import Job, OperationTable, ProcessTable, ToolTable
from camgen.model.part import Contour, Part
from camgen.model.path import Tour
from camgen.model.pose import Pose
from camgen.model.program import Instruction, Joints, MoveC, MoveJ, MoveL
from camgen.plan import plan
from camgen.post.plugins import find_post
from tests.support.drawn import circle, rectangle


def program(*contours: Contour, post: str = "rapid", **operation: Any) -> tuple[Instruction, ...]:
    job = Job(
        tool=ToolTable(orient="follow"),
        operation=OperationTable(**operation),
        process=ProcessTable(clearance=30),
    )
    planned = plan(Part("part", "part.dxf", "mm", contours, ()), job)
    return lower(Tour(planned.paths, 0.0, ""), find_post(post).cell(), job, "part", ()).body


def headings(body: tuple[Instruction, ...]) -> list[float]:
    """Directions of tool x, seen from above, deg, in order of time. The first one is at home."""
    angles = [0.0]
    for item in body:
        if isinstance(item, (MoveJ, MoveL, MoveC)) and not isinstance(item.target, Joints):
            poses: list[Pose] = (
                [item.via, item.target] if isinstance(item, MoveC) else [item.target]
            )
            angles += [math.degrees(math.atan2(p.rotation[1, 0], p.rotation[0, 0])) for p in poses]
    return angles


def wound(body: tuple[Instruction, ...]) -> list[float]:
    """Angles by which the tool has turned since home, deg, by the shorter rotation at each step."""
    total, turns = 0.0, [0.0]
    for before, after in itertools.pairwise(headings(body)):
        step = (after - before + 180) % 360 - 180
        assert abs(step) < 155, "no sense of its own"
        total += step
        turns.append(total)
    return turns


def row(count: int) -> list[Contour]:
    return [circle(40 * k, 0, 15, f"c{k + 1}") for k in range(count)]


@pytest.mark.parametrize("direction", ["climb", "conventional"])
@pytest.mark.parametrize("operation", [{}, {"passes": 4, "depth": 8.0}], ids=["once", "passes"])
def test_contours_in_a_row_do_not_wind_the_tool_up(
    direction: str, operation: dict[str, Any]
) -> None:
    turns = wound(program(*row(6), direction=direction, **operation))
    assert max(map(abs, turns)) <= 360 + 1e-6
    assert max(turns) - min(turns) >= 360 - 1e-6  # each contour is one turn


def test_holes_and_outline_undo_each_other() -> None:
    body = program(rectangle(-40, -40, 200, 80), circle(0, 0, 15, "c2"))
    assert max(map(abs, wound(body))) <= 360 + 1e-6


def test_the_tool_turns_back_in_the_air() -> None:
    body = program(*row(3))
    cartesian = [i for i in body if isinstance(i, (MoveL, MoveC))]
    for before, after in itertools.pairwise(cartesian):
        if before.target.origin == after.target.origin:
            assert after.target.origin[2] == 30
            assert before.blend == after.blend == 0
    assert any(a.target.origin == b.target.origin for a, b in itertools.pairwise(cartesian))


def test_a_mill_does_not_turn_back() -> None:
    fixed = program(*row(3), post="gcode")
    assert [i for i in fixed if isinstance(i, MoveJ)]
    assert len(fixed) < len(program(*row(3)))


def test_a_program_with_turns_is_built_and_read_back() -> None:
    job = {"tool": {"orient": "follow"}}
    part = Path(__file__).parents[2] / "fixtures" / "parts" / "gaps.dxf"
    result = camgen.build(part, post="rapid", job=job)
    assert max(map(abs, wound(result.program.body))) <= 360 + 1e-6
