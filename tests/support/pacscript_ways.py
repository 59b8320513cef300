"""Both ways of the PacScript read-back, and texts to read.

The long way is the same code when no line counts as a motion in the usual spelling.
"""

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from unittest.mock import patch

from camgen_posts.pacscript import PacScript
from camgen_posts.readback.pacscript import read
from camgen_posts.readback.pacscript.motion import LINE, PIECE

from camgen.model.pose import TOOL_DOWN, Pose, frozen, pose_from_values, rotation_about, translation
from camgen.model.program import (
    Force,
    Instruction,
    Joints,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Program,
    Wait,
)
from camgen.post import Reading
from camgen.post.plugins import make_post
from tests.support.whole import whole

PARTS = "camgen_posts.readback."


@contextmanager
def the_long_way() -> Iterator[None]:
    with patch(PARTS + "pacscript.text.PIECE", LINE):
        yield


def pose(value: Pose | None) -> object:
    return value and (repr(value.origin), value.rotation.tobytes())


def said(reading: Reading) -> list[object]:
    """All of a reading as plain values."""
    body: list[object] = []
    for item in reading.body:
        if isinstance(item, MoveJ):
            target = (
                repr(item.target.values) if isinstance(item.target, Joints) else pose(item.target)
            )
            body.append(("J", target, repr((item.speed, item.share, item.blend)), item.posture))
        elif isinstance(item, MoveL):
            manner = (item.speed, item.blend, item.force, item.force_direction, item.turn)
            body.append(("L", pose(item.target), repr(manner), item.posture))
        elif isinstance(item, MoveC):
            ends = pose(item.via), pose(item.target)
            body.append(
                (
                    "C",
                    *ends,
                    repr((item.speed, item.blend, item.force, item.force_direction)),
                    item.posture,
                )
            )
        else:
            body.append(repr(item))
    return [body, reading.lines, reading.faults, pose(reading.work), pose(reading.tool)]


def check(files: Mapping[str, str], options: Mapping[str, object]) -> Reading:
    reading = read(files, options)
    with the_long_way():
        assert said(reading) == said(read(files, options)), files
    return reading


# -- texts ---------------------------------------------------------------------------------------------------------


def printed(
    count: int, options: dict[str, object], force: float = 0.0, turning: bool = False
) -> str:
    home = Joints(tuple(math.radians(v) for v in (0.0, 0.0, 90.0, 0.0, 30.0, 0.0)))
    body: list[Instruction] = [MoveJ(home, 100.0), MoveJ(Pose(TOOL_DOWN, (0, 0, 20)), 100.0)]
    press = (0.0, -1.0, 0.0) if force else (0.0, 0.0, 0.0)
    for k in range(count):
        x, rotation = (
            k * 8.0,
            frozen(rotation_about(2, 0.1 * k) @ TOOL_DOWN) if turning else TOOL_DOWN,
        )
        start, via, end = (
            Pose(rotation, p) for p in ((x, 0.125, 0.0), (x + 2, 2.125, 0.0), (x + 4, 0.125, 0.0))
        )
        body += [MoveJ(start, 200.0), Output("process", 1.0)]
        if turning:
            aside = frozen(rotation_about(2, 0.5) @ rotation)
            body += [MoveL(Pose(aside, start.origin), 20.0, turn=1.0), MoveL(start, 20.0, turn=0.5)]
        body += [Force(force, press)] if force else []
        body += [MoveL(end, 20.0 + k, 1.0, force, press), MoveL(start, 20.0, 0.0, force, press)]
        body += [MoveC(via, end, 12.5, 0.0, force, press)]
        body += [Force(0.0)] if force else [Wait(0.25)]
        body += [Output("process", 0.0)]
    body += [MoveL(Pose(TOOL_DOWN, (0, 0, 20)), 50), MoveJ(home, 100.0)]
    post = make_post(PacScript, options)
    frames = pose_from_values((300.0, -75.0, 150.0, 0.0, 0.0, 90.0)), translation(0, 0, 100)
    plan = Program("part", *frames, whole(body), ("a remark",))
    (file,) = post.render(post.prepare(plan, 0.01))
    return file.text


PERCENT: dict[str, object] = {"rated": 2000.0}
CALLED: dict[str, object] = {
    "force": "template",
    "force_on": ["Call PressOn({n}, {x}, {y}, {z})", "Delay 200"],
    "force_change": ["Call PressTo({newtons}, {x}, {y}, {z})"],
    "force_off": ["Call PressOff"],
}
#: Lines of a template that could be motions: then none is read the short way.
MOVED: dict[str, object] = {
    "force_on": ["ForceCtrl True, {n}", "Move L, @0 P({x}, {y}, {z}), Speed = Mps(0.02)"],
    "force_off": [" move l, @P P(1.000, 2.000, {z}), Speed = Mps(0.02)"],
}
SIGNED: dict[str, object] = {"force_on": ["{n} {x} {y} {z}"], "force_off": ["stop"]}
#: A sign that is not ASCII may stand for one that is.
LONG_S: dict[str, object] = {**SIGNED, "force_off": ["ſtop"]}
BY_HAND = """\
' several procedures, a block, speeds of every kind
Sub Main
    TakeArm Keep = 0
    Speed 10
    Work 1, P(1, 2, 3)
    ChangeWork 1
    Move P, J(0, 0, 90, 0, 30, 0), Speed = Mps(0.1)
    Move P, @0 P(10.000, 20.500, 20.000, 180.0000, 0.0000, 0.0000, -1), Speed = 10
    Move L, @0 P(10.000, 20.500, 0.000, 180.0000, 0.0000, 0.0000, -1), Speed = Mps(0.02)
    Set IO[24]
    Move L, @P P(12.000, 20.500, -0.000, 180.0000, 0.0000, 0.0000, -1), Speed = Mps(0.02)
    Move L, @P P(13.000, 20.500, 0.000, 180.0000, 0.0000, 0.0000, 5), Speed = Mps(0.02)
    Move L, @P P(13.500, 20.500, 0.000, 180.0000, 0.0000, 0.0000, 2 + 3), Speed = Mps(0.02)
    Move L, @P P(13.750, 20.500, 0.000, 180.0000, 0.0000, 0.0000, 0.5), Speed = Mps(0.02)
    Move L, @5 P(14.000, 20.500, 0.0)
    Move L, P(16.000, 20.500, 0.0, 180.0)
    Move C, P(18.000, 22.500, 0.000, 180), @P P(20.000, 20.500, 0.000, 180), Speed = Mps(0.0125)
    Move C, P(20.001, 20.500, 0.000, 180), @0 P(30.000, 20.500, 0.000, 180), Speed = 5.5
    Delay 100
    Speed 20
    ExtSpeed 50
    Move L, @0 P(12.000, 20.500, 0.000, 180.0000, 0.0000, 0.0000, -1)
    ForceParam 1, 2, P(0, 5, 0)
    ForceCtrl True, 1
    Move L, @0 P(13.000, 20.500, 0.000, 180.0000, 0.0000, 0.0000, -1), Speed = Mps(0.02)
    Move C, P(15.000, 22.500, 0.000, 180), @0 P(17.000, 20.500, 0.000, 180), Speed = Mps(0.0125)
    ForceCtrl False
    If IO[3] = On Then
    Move L, @0 P(12.000, 20.500, 0.000, 180.0000, 0.0000, 0.0000, -1), Speed = Mps(0.02)
    End If
    Move L, @0 P(12.000, 20.500, 5.000, 180.0000, 0.0000, 0.0000, -1), Speed = Mps(0.02)
    Reset IO[24]
    Call Other(3.5)
    Draw L, V(1, 2, 3), Speed = Mps(0.02)
    GiveArm
End Sub

Sub Other(h)
    Move L, @0 P(12.000, 20.500, 9.250, 180.0000, 0.0000, 0.0000, -1), Speed = Mps(0.02)
    Move L, @0 P(12.000, 20.500, h, 180.0000, 0.0000, 0.0000, -1), Speed = Mps(0.02)
    Move P, @0 P(12.000, 20.500, 9.250, 180.0000, 0.0000, 45.0000, -1), Speed = Mps(0.02)
End Sub
"""
BY_TEMPLATE = BY_HAND.replace(
    "    ForceCtrl False\n", "    Move L, @P P(1.000, 2.000, 3.000), Speed = Mps(0.02)\n"
)
TEXTS: list[tuple[str, dict[str, object]]] = [
    (BY_HAND, {}),
    (BY_HAND, PERCENT),
    (BY_TEMPLATE, MOVED),
    (BY_HAND, SIGNED),
    (BY_HAND, LONG_S),
    (
        "#Define h2 5\n#Define FEED Speed = Mps(0.02)\n"
        + BY_HAND.replace("Speed = Mps(0.02)", "FEED"),
        PERCENT,
    ),
    ("#Define MPS J\n" + BY_HAND, {}),
    (printed(5, {}), {}),
    (printed(5, {"max_lines": 12, "define": True}), {}),
    (printed(5, {"max_lines": 12, "rated": 2000.0, "decimals": 1}).replace("\n", "\r\n"), PERCENT),
    (printed(5, {}, turning=True), {}),
    (printed(5, CALLED, force=8.0), CALLED),
    (printed(5, {"force": "template"}, force=8.0), {}),
]


def short_lines(text: str) -> int:
    return sum(piece.lastindex is not None for piece in PIECE.finditer(text))
