"""Both ways of the V+ read-back, and texts to read.

The long way is the same code with every short way shut: no stretches of lines, no targets without an expression,
nothing remembered.
"""

import re
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from unittest.mock import patch

from camgen_posts.readback.vplus import read
from camgen_posts.vplus import VPlus

from camgen.model.pose import TOOL_DOWN, Pose, frozen, rotation_about
from camgen.model.program import Instruction, Joints, MoveJ, MoveL, Output, Program, Wait
from camgen.post import Reading
from camgen.post.plugins import make_post
from camgen.read.vplus.text import PIECE
from tests.support.whole import whole

PARTS = "camgen_posts.readback."
LINES = re.compile(r"[^\r\n]*(?:\r\n|\r|\n)|[^\r\n]+")
CELL = VPlus.cell()


@contextmanager
def the_long_way() -> Iterator[None]:
    with ExitStack() as stack:
        for name, value in (
            ("camgen.read.vplus.text.PIECE", LINES),
            ("camgen.read.vplus.text._REMEMBERED", 0),
            (PARTS + "vplus.robot._KEPT", 0),
            (PARTS + "vplus.robot.RobotState.plain", lambda *_: False),
            (PARTS + "vplus.robot.pace", lambda _: None),
        ):
            stack.enter_context(patch(name, value))
        yield


def pose(value: Pose | None) -> object:
    """Something to compare. What is added to 0 loses the sign of a zero: a product of frames may give either."""
    return value and (tuple(v + 0.0 for v in value.origin), (value.rotation + 0.0).tobytes())


def said(reading: Reading) -> list[object]:
    """All of a reading as plain values."""
    body: list[object] = []
    for item in reading.body:
        assert isinstance(item, (MoveJ, MoveL, Output, Wait))
        if isinstance(item, (MoveJ, MoveL)):
            target = item.target.values if isinstance(item.target, Joints) else pose(item.target)
            body.append((type(item), target, repr(item.speed), repr(item.blend), item.posture))
            body.append(repr(getattr(item, "turn", 0.0)))
        else:
            body.append(repr(item))
    return [body, reading.lines, reading.faults, pose(reading.work), pose(reading.tool)]


def check(files: Mapping[str, str], options: Mapping[str, object]) -> Reading:
    reading = read(files, options)
    with the_long_way():
        assert said(reading) == said(read(files, options)), files
    return reading


# -- texts ---------------------------------------------------------------------------------------------------------


def printed(count: int, options: dict[str, object], turning: bool = False) -> str:
    body: list[Instruction] = [MoveJ(CELL.home, 100.0)]
    for k in range(count):
        rotation = frozen(rotation_about(2, 0.1 * k) @ TOOL_DOWN) if turning else TOOL_DOWN
        target = Pose(rotation, (k * 1.5 - 20, -k * 0.125, 0.0))
        blend = 0.0 if k % 7 == 6 else 1.0
        body.append(
            MoveJ(target, 200.0, blend) if k % 9 == 0 else MoveL(target, 20.0 + k // 5, blend)
        )
        if not blend:
            body += [Output("process", float(k % 2)), Wait(0.25)]
    body += [MoveL(Pose(TOOL_DOWN, (0, 0, 20)), 50), MoveJ(CELL.home, 100.0)]
    post = make_post(VPlus, options)
    plan = Program("part", CELL.base_from_work, CELL.flange_from_tool, whole(body), ("a remark",))
    (file,) = post.render(post.prepare(plan, 0.01))
    return file.text


ON_CONTROLLER: dict[str, object] = {"declare": False, "tool": "pen", "work": "wf"}
BY_HAND = """\
; several frames, loops, settings that hold once
.PROGRAM main()
    AUTO wf, i
    SET wf = TRANS(10,20,30,0,0,45)
    SET other = TRANS(10,20,30,0,0,45)
    SET p = wf:TRANS(1)
    MOVE #PPOINT(0, 45, 50, 0)
    BREAK
    SPEED 12.5
    MOVE wf:TRANS(1,2,3,0,180,180)
    MOVE wf:TRANS(4,-5.25,0.001,0,180,180)
    SPEED 40 MMPS
    MOVES wf:TRANS(1,2,3,0,180,180)
    MOVES wf:TRANS(4,-5,0.001,0,180,180)
    MOVES wf:TRANS(4,-5,0.001,0,180,90)
    SPEED 20, 100 MMPS ALWAYS
    MOVES wf:TRANS(1,2,3,0,180,180)
    MOVES wf:TRANS(-1,-2,-3,0,0,0)
    DEPARTS 5
    BREAK
    SIGNAL 33, -34
    CALL sub()
    FOR i = 1 TO 3
        MOVES wf:TRANS(7,8,9,0,180,180)
        MOVES wf:TRANS(7,8,9.5,0,180,180)
        CALL sub()
    END
    MOVES DEST:TRANS(0,0,1,0,0,0)
    DISABLE CP
    MOVES wf:TRANS(1,1,1,0,180,180)
    ENABLE CP
    SPEED 50 MONITOR
    MOVES wf:TRANS(1,1,1,0,180,180)
    BREAK
    RETURN
.END

.PROGRAM sub()
    MOVES other:TRANS(0,0,0,0,180,180)
    MOVES other:TRANS(0,0,-0.0,0,180,180)
    BREAK
    WAIT.EVENT , 0.5
.END
"""
TEXTS: list[tuple[str, dict[str, object]]] = [
    (BY_HAND, {}),
    (BY_HAND, {"declare": False, "tool": "other", "work": "sub.frame"}),
    (printed(40, {}), {}),
    (printed(40, {"max_lines": 12}), {"max_lines": 12}),
    (printed(40, {"max_lines": 12}).replace("\n", "\r\n"), {}),
    (printed(30, {"work": "a.very_long.name"[:15], "posture": ["RIGHTY"]}), {}),
    (printed(40, ON_CONTROLLER), ON_CONTROLLER),
    (printed(40, {"max_lines": 9, "rated": 900.0, "decimals": 1}, turning=True), {"rated": 900.0}),
]


def stretches(text: str) -> int:
    return sum(bool(piece.lastgroup) for piece in PIECE.finditer(text))
