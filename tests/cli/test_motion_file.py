"""The lines of a plan file: the keys of docs/command-line.md, in order, without zeros."""

import pytest

from camgen.cli.motion_file import decode, encode
from camgen.model.pose import translation
from camgen.model.program import (
    Comment,
    Force,
    Instruction,
    Joints,
    MoveC,
    MoveJ,
    MoveL,
    Output,
    Posture,
    Program,
    Stop,
    ToolChange,
    Wait,
)

ORIGIN = translation(0, 0, 0)
NEAR, FAR = translation(1, 2, 3), translation(4, 5, 6)
DOWN = (0.0, 0.0, -1.0)
START = MoveJ(Joints((0.0, 0.5)), 100.0)
#: Instructions by their line. All rotations are the same, number 0.
LINES: dict[str, Instruction] = {
    '{"do":"movej","speed":100.0,"joints":[0.0,0.5]}': START,
    '{"do":"movej","speed":9.0,"to":[1.0,2.0,3.0],"rotation":0,"posture":[0.25],'
    '"called":{"figure":5},"share":0.5,"rate":0.25}': MoveJ(
        NEAR, 9.0, joints=Joints((0.25,)), posture=Posture(figure=5), share=0.5, rate=0.25
    ),
    '{"do":"movel","to":[4.0,5.0,6.0],"rotation":0,"speed":8.0}': MoveL(FAR, 8.0),
    '{"do":"movel","to":[4.0,5.0,6.0],"rotation":0,"speed":8.0,"turn":0.5}': MoveL(
        FAR, 8.0, turn=0.5
    ),
    '{"do":"movec","via":[1.0,2.0,3.0],"via_rotation":0,"to":[4.0,5.0,6.0],"rotation":0,'
    '"speed":7.0,"blend":2.0}': MoveC(NEAR, FAR, 7.0, 2.0),
    '{"do":"output","signal":"spindle","value":9000.0}': Output("spindle", 9000),
    '{"do":"wait","seconds":0.5}': Wait(0.5),
    '{"do":"force","newtons":3.0,"press":[0.0,0.0,-1.0]}': Force(3, DOWN),
    '{"do":"force","newtons":0.0}': Force(0.0),
    '{"do":"toolchange","number":2,"name":"mill","diameter":6.0,"length":0.0}': ToolChange(
        2, "mill", 6.0
    ),
    '{"do":"stop"}': Stop(),
    '{"do":"stop","optional":true}': Stop(optional=True),
    '{"do":"comment","text":"first"}': Comment("first"),
}


@pytest.mark.parametrize("line", LINES)
def test_an_instruction_has_this_line(line: str) -> None:
    # A motion that blends needs a motion after it. Everything is off first and last.
    all_off = (Force(0.0), Output("spindle", 0))
    body = (*all_off, START, MoveL(ORIGIN, 5.0), LINES[line], START, *all_off)
    data = encode(Program("a", ORIGIN, ORIGIN, body), "rapid", {}, 0.01)
    assert data.decode().splitlines()[5].removesuffix(",") == line
    plan = decode(data)
    assert encode(plan.program, plan.post, plan.options, plan.chord) == data
    assert type(plan.program.body[4]) is type(LINES[line])


def test_a_line_of_another_instruction_is_refused() -> None:
    data = encode(Program("a", ORIGIN, ORIGIN, (START, Wait(1.0))), "rapid", {}, 0.01)
    with pytest.raises(ValueError, match=r"unknown field `value` - at `\$\.body\[1\]`"):
        decode(data.replace(b'"seconds"', b'"value"'))
