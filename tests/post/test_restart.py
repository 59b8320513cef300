"""A program that is run again after an abort never moves with the tool on where it should be off.

The readings of the texts are executed with every output on at the start, as after an abort.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

import camgen
from camgen.model.errors import Refused
from camgen.model.pose import TOOL_DOWN, Pose
from camgen.model.program import (
    Comment,
    Force,
    Joints,
    Motion,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Program,
    switch_off_first,
)
from camgen.post.plugins import find_post

PART = Path(__file__).parents[2] / "fixtures" / "parts" / "bracket.dxf"
ROBOTS, MILLS = ("rapid", "pacscript", "vplus"), ("gcode", "grbl")
#: Options that each post needs for forces.
PRESSES = {
    "rapid": {"force_load": "lTool"},
    "pacscript": {"force": "template"},
    "vplus": {"force": "signal", "signals": {"process": 33, "force": 34}},
    "gcode": {"force": "analog", "force_scale": 0.1},
}


def simulate(post: str, job: dict[str, object]) -> list[tuple[Motion, Motion, set[str]]]:
    """The motions of a text, as planned and as read, each with the outputs that are on.

    All outputs are on before the first instruction.
    """
    result = camgen.build(PART, post=post, job=job)
    reading = camgen.read_back(result.files, post, job)
    assert not reading.findings
    chord = 0.01
    poster = find_post(post)(**job.get("post", {}))
    prepared = poster.prepare(result.program, chord)
    planned = [item for item in prepared.body if not isinstance(item, Comment)]
    assert len(planned) == len(reading.body)
    used = {item.signal for item in reading.body if isinstance(item, Output)}
    on = used | ({"force"} if any(isinstance(item, Force) for item in reading.body) else set())
    moves = []
    for plan, item in zip(planned, reading.body, strict=True):
        match item:
            case Output(signal, value):
                (on.add if value else on.discard)(signal)
            case Force(newtons):
                (on.add if newtons else on.discard)("force")
            case MoveJ() | MoveL() | MoveC():
                moves.append((plan, item, set(on)))
    assert used or not job
    assert not on, "something is left on at the end"
    return moves


@pytest.mark.parametrize("post", [*ROBOTS, *MILLS])
def test_a_process_that_is_switched_at_contact_is_on_along_paths_only(post: str) -> None:
    moves = simulate(post, {"process": {"switch": "contact", "feed": 20.0}})
    assert [plan.work for plan, _, _ in moves] == ["process" in on for _, _, on in moves]


@pytest.mark.parametrize("post", ROBOTS)
def test_a_rotating_tool_is_on_from_above_its_path_until_it_is_above_again(post: str) -> None:
    moves = simulate(post, {"operation": {"depth": 3.0}})
    for (before, _, _), (plan, _, on) in pairwise(moves):
        assert plan.work <= ("process" in on)
        if on and not plan.work:
            (x, y, _), (u, v, _) = before.target.origin, plan.target.origin
            assert (x, y) == (u, v), "travel with the tool on"
    assert not moves[0][2]


@pytest.mark.parametrize("post", MILLS)
def test_a_spindle_runs_whenever_the_cutter_is_in_the_material(
    post: str,
) -> None:
    job = {"operation": {"depth": 3.0}, "process": {"spindle": 9000.0}}
    moves = simulate(post, job)
    low = [bool(item.target.origin[2] < 0) for _, item, _ in moves]
    assert any(low)
    assert all("spindle" in on for (_, _, on), below in zip(moves, low, strict=True) if below)
    assert not moves[0][2]
    assert not moves[-1][2]


@pytest.mark.parametrize("post", MILLS)
def test_a_cut_with_the_spindle_at_rest_is_refused(post: str) -> None:
    with pytest.raises(
        camgen.CamgenError, match=r"a cut of 3 mm .*process\.spindle.*process\.switch"
    ):
        camgen.build(PART, post=post, job={"operation": {"depth": 3.0}})
    relay = {"operation": {"depth": 3.0}, "process": {"switch": "air", "signal": ""}}
    with pytest.raises(camgen.CamgenError, match=r"a cut of 3 mm .*process\.spindle"):
        camgen.build(PART, post=post, job=relay)
    laser = {"operation": {"depth": 3.0}, "process": {"switch": "contact"}}
    assert all(plan.work == bool(on) for plan, _, on in simulate(post, laser))


@pytest.mark.parametrize("post", PRESSES)
def test_a_force_acts_along_paths_only_and_the_process_is_off_after_the_retract(
    post: str,
) -> None:
    job = {
        "tool": {"orient": "follow"} if post in ROBOTS else {},
        "process": {"force": 5.0},
        "post": PRESSES[post],
    }
    # With its built-in cell a SCARA cannot turn its tool further and further about its axis.
    if post == "vplus":
        job["tool"] = {}
    moves = simulate(post, job)
    assert not moves[0][2]
    for number, (plan, _, on) in enumerate(moves):
        assert ("force" in on) <= plan.work
        if "process" in on and "process" not in moves[min(number + 1, len(moves) - 1)][2]:
            assert not plan.work, "switched off on the surface"
            assert plan.target.origin[2] >= 5.0


def program(*body: object) -> Program:
    frame = Pose(np.eye(3), (0.0, 0.0, 0.0))
    return Program("part", frame, frame, (*body,))  # type: ignore[arg-type]


HOME = MoveJ(Joints((0.0,) * 6), 100.0)


@pytest.mark.parametrize(
    ("body", "why"),
    [
        (
            (HOME, Output("glue", 1.0), Output("glue", 0.0)),
            "output glue is not switched off before the first motion",
        ),
        (
            (Output("glue", 1.0), HOME, Output("glue", 0.0)),
            "output glue is not switched off before the first motion",
        ),
        ((Output("glue", 0.0), HOME, Output("glue", 1.0)), "output glue must be off at the end"),
        (
            (Output("glue", 0.0), HOME, Output("spindle", 9.0), Output("spindle", 0.0)),
            "output spindle is not switched",
        ),
        (
            (HOME, Force(1.0, (0.0, 0.0, -1.0)), Force(0.0)),
            "force control is not switched off before the first motion",
        ),
        ((Force(0.0), HOME, Force(1.0, (0.0, 0.0, -1.0))), "force control must be off at the end"),
    ],
)
def test_a_program_that_does_not_switch_its_outputs_off_is_refused(
    body: tuple[object, ...], why: str
) -> None:
    with pytest.raises(Refused, match=why):
        program(*body)


def test_outputs_are_switched_off_first() -> None:
    body = (
        HOME,
        Output("a", 1.0),
        Output("b", 1.0),
        Output("a", 0.0),
        Force(0.0),
        Output("b", 0.0),
    )
    assert switch_off_first(body) == (Output("a", 0.0), Output("b", 0.0), Force(0.0), *body)
    assert program(*switch_off_first(body)).body[:1] == (Output("a", 0.0),)
    assert switch_off_first((HOME,)) == (HOME,)


def test_a_reorientation_without_a_speed_is_refused() -> None:
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turn = MoveL(Pose(TOOL_DOWN @ quarter, (1.0, 2.0, 3.0)), 20.0)
    start = MoveJ(Pose(TOOL_DOWN, (1.0, 2.0, 3.0)), 20.0)
    with pytest.raises(Refused, match="a motion that only turns the tool has no speed of turning"):
        program(HOME, start, turn)
    program(HOME, start, replace(turn, turn=1.0))
