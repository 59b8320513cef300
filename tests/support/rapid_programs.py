"""Programs of tests for RAPID: their parts, their texts, and the comparison with a reading."""

import math
import re
from collections.abc import Mapping, Sequence
from itertools import pairwise

import pytest
from camgen_posts.rapid import Rapid

from camgen.lang.programs import Executed
from camgen.model.pose import (
    TOOL_DOWN,
    Pose,
    angle_between,
    frozen,
    rotation_about,
    translation,
)
from camgen.model.program import (
    Comment,
    Force,
    Instruction,
    Joints,
    MoveJ,
    MoveL,
    Origin,
    Output,
    Program,
)
from camgen.post import Tolerance
from camgen.post.plugins import make_post
from camgen.post.verify import compare
from tests.support.whole import whole

HOME = MoveJ(Joints((0.0, 0.0, 0.0, 0.0, math.radians(30), 0.0)), 200.0)
E9 = "[9E9,9E9,9E9,9E9,9E9,9E9]"
DOWN = f"[0.0000000,1.0000000,0.0000000,0.0000000],[0,0,0,0],{E9}]"


def at(x: float, y: float, z: float = 0.0) -> Pose:
    return Pose(TOOL_DOWN, (x, y, z))


def program(*body: Instruction, name: str = "plate") -> Program:
    return Program(
        name, translation(300, -75, 100), translation(0, 0, 100), whole(body), ("made by hand",)
    )


def print_program(plan: Program, **options: object) -> tuple[Program, dict[str, str]]:
    """The program as the post prepares it, and the text of each file by its name.

    Without `force_load` the cell sets the force sensor to zero.
    """
    post = make_post(Rapid, {"force_calibrated": not options.get("force_load")} | options)
    prepared = post.prepare(plan, 0.01)
    return prepared, {file.name: file.text for file in post.render(prepared)}


def print_main(plan: Program, **options: object) -> list[str]:
    """The statements of main without indentation, settings of supervision and ERROR handler."""
    text = "\n".join(print_program(plan, **options)[1].values())
    body = text.split("PROC main()\n")[1].split("ENDPROC")[0].split("    ERROR\n")[0]
    return [line.strip() for line in body.splitlines() if "Conf" not in line and line.strip()]


def assert_same(plan: Program, reading: Executed, tolerance: Tolerance) -> None:
    """The reading has no finding, and its instructions are those of `plan` without its comments."""
    assert reading.findings == ()
    wanted = [item for item in plan.body if not isinstance(item, Comment)]
    assert [type(item) for item in reading.body] == [type(item) for item in wanted]
    assert len(reading.lines) == len(reading.body)
    assert all(a <= b for a, b in pairwise(reading.lines))
    limits = {
        "speed": tolerance.speed,
        "blend": tolerance.mm,
        "seconds": tolerance.seconds,
        "value": 5e-4,
        "force": tolerance.force,
        "newtons": tolerance.force,
    }
    for want, got in zip(wanted, reading.body, strict=True):
        for name in ("target", "via"):
            assert_near(getattr(want, name, None), getattr(got, name, None), tolerance)
        for name, limit in limits.items():
            planned = getattr(want, name, 0)
            assert getattr(got, name, 0) == pytest.approx(planned, rel=0, abs=limit + 1e-9)
        if getattr(want, "turn", 0):  # each motion of the text has one
            assert getattr(got, "turn", 0) == pytest.approx(
                getattr(want, "turn", 0), rel=0, abs=tolerance.turn
            )
        assert getattr(got, "signal", "") == getattr(want, "signal", "")
        if getattr(want, "force", 0) or getattr(want, "newtons", 0):
            assert getattr(got, "force_direction", None) == pytest.approx(
                getattr(want, "force_direction", None), abs=tolerance.angle
            )


def assert_near(
    want: Pose | Joints | None, got: Pose | Joints | None, tolerance: Tolerance
) -> None:
    assert type(got) is type(want)
    if isinstance(want, Joints) and isinstance(got, Joints):
        assert got.values == pytest.approx(want.values, rel=0, abs=tolerance.joint + 1e-12)
    if isinstance(want, Pose) and isinstance(got, Pose):
        assert got.origin == pytest.approx(want.origin, rel=0, abs=tolerance.mm + 1e-9)
        assert angle_between(want.rotation, got.rotation) <= tolerance.angle


def verify(prepared: Program, reading: Executed) -> None:
    """Compares a reading with the program that was printed, as a build does."""
    post = Rapid()
    compare(prepared, reading, post.tolerance(), post.list_verified(), "plate.mod")


def turned(x: float, angle: float) -> Pose:
    return Pose(frozen(rotation_about(2, angle) @ TOOL_DOWN), (x, 0.0, 0.0))


def reorientation(degrees: float, speed: float = 100.0, angle: float = 1.0) -> Program:
    """A program with a reorientation by `angle`, rad, at a fixed TCP, at `degrees` per second."""
    turn = MoveL(turned(0, angle), speed, turn=math.radians(degrees))
    return program(HOME, MoveL(at(0, 0, 0), 100.0), turn, MoveL(turned(9, angle), 100.0))


def on_disc(angle: float, z: float = -2.0) -> Pose:
    """Pose on the border of a disc of radius 20 about the origin, tool x towards its centre."""
    c, s = math.cos(angle), math.sin(angle)
    return Pose(frozen([[-c, -s, 0], [-s, c, 0], [0, 0, -1]]), (20 * c, 20 * s, z))


def inward(angle: float) -> tuple[float, float, float]:
    """Unit vector from the border of the disc towards its centre."""
    return (-math.cos(angle), -math.sin(angle), 0.0)


def pressing_program(*body: Instruction) -> Program:
    """A program that presses on the disc with 25 N during `body`."""
    return program(
        HOME,
        MoveL(on_disc(0), 50.0),
        Force(25.0, inward(0)),
        *body,
        Force(0.0),
        MoveL(on_disc(0, 9), 50.0),
    )


def pressed(angle: float, force: float = 25.0, blend: float = 0.0) -> MoveL:
    """A motion that presses on the disc."""
    return MoveL(on_disc(angle), 20.0, blend, force, inward(angle))


def path_body(path: int, x: float, rise: bool = True, signal: str = "process") -> list[Instruction]:
    """A path of one motion with the process on, from x - 5 to x."""
    up = [MoveL(at(x, 0, 20), 100.0, path=path)] if rise else []
    return [
        Comment(f"path {path}"),
        MoveL(at(x - 5, 0, 0), 50.0, path=path),
        Output(signal, 1),
        MoveL(at(x, 0, 0), 20.0, path=path, work=True),
        Output(signal, 0),
        *up,
    ]


def program_of_paths(
    *body: Instruction, ids: Sequence[str] = ("c1", "c2"), name: str = "plate"
) -> Program:
    return Program(
        name,
        translation(300, -75, 100),
        translation(0, 0, 100),
        whole(body),
        (),
        tuple(map(Origin, ids)),
    )


def list_routines(files: Mapping[str, str]) -> dict[str, list[str]]:
    """The first word of each statement, by the name of its PROC."""
    routines = re.findall(r"PROC (\w+)\(\)\n(.*?)ENDPROC", "".join(files.values()), re.S)
    return {name: re.findall(r"^ +([A-Za-z_]\w*)", body, re.M) for name, body in routines}


TWO_PATHS = program_of_paths(HOME, *path_body(0, 10), *path_body(1, 20), HOME)
