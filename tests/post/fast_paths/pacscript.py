"""The fast path of the PacScript read-back: texts, and ways to damage them."""

import math
import re
from collections.abc import Iterator

from camgen.lang.pacscript.plain import MOTIONS
from camgen.lang.pacscript.strict import read
from camgen.model.program import Joints, MoveJ
from tests.support.damage import Damage
from tests.support.examples import is_night
from tests.support.fast_paths import FastPath, cut_nothing, list_paths
from tests.support.samples import Options, Sample

HOME = MoveJ(Joints(tuple(math.radians(angle) for angle in (0, 0, 90, 0, 30, 0))), 100.0)


def printed(options: Options, force: float = 0.0, turning: bool = False) -> str:
    """A text of the post with five paths."""
    return Sample("pacscript", list_paths(HOME, 5, 2, force, turning), options).written


PERCENT = {"rated": 2000.0}
CALLED = {
    "force": "template",
    "force_on": ["Call PressOn({n}, {x}, {y}, {z})", "Delay 200"],
    "force_change": ["Call PressTo({newtons}, {x}, {y}, {z})"],
    "force_off": ["Call PressOff"],
}
#: Lines of a template that could be motions: they close the fast path.
MOVED = {
    "force_on": ["ForceCtrl True, {n}", "Move L, @0 P({x}, {y}, {z}), Speed = Mps(0.02)"],
    "force_off": [" move l, @P P(1.000, 2.000, {z}), Speed = Mps(0.02)"],
}
SIGNED = {"force_on": ["{n} {x} {y} {z}"], "force_off": ["stop"]}
#: The upper case of this letter is `S`, so that a line may start with either: no fast path.
LONG_S = {**SIGNED, "force_off": ["ſtop"]}
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
BY_MACRO = BY_HAND.replace("Speed = Mps(0.02)", "FEED")
COARSE = {"max_lines": 12, "rated": 2000.0, "decimals": 1}
TURNING = printed({}, turning=True)
TEXTS = [
    (BY_HAND, {}),
    (BY_HAND, PERCENT),
    (BY_TEMPLATE, MOVED),
    (BY_HAND, SIGNED),
    (BY_HAND, LONG_S),
    (f"#Define h2 5\n#Define FEED Speed = Mps(0.02)\n{BY_MACRO}", PERCENT),
    (f"#Define MPS J\n{BY_HAND}", {}),
    (printed({}), {}),
    (printed({"max_lines": 12, "define": True}), {}),
    (printed(COARSE).replace("\n", "\r\n"), PERCENT),
    (TURNING, {}),
    (printed(CALLED, force=8.0), CALLED),
    (printed({"force": "template"}, force=8.0), {}),
]
_STATEMENTS = """\
TakeArm|TakeArm Keep = 0|GiveArm|Speed 50|Speed Mps(0.03)|Speed v|ExtSpeed 20|ExtSpeed 0
Accel 50|ChangeWork 2|ChangeTool 1|Work 1, P(1, 2, 3)|Tool 2, P(0, 0, 100)
ForceParam 1, 2, P(0, 5, 0)|ForceParam 2, 2, P(0, 0, -3)|ForceCtrl True, 1|ForceCtrl True, 2
ForceCtrl False|Call PressOn(1, 0.000, 8.000, 0.000)|Call PressOff|Delay 200|Delay 5
Call PressTo(8.000, 0.000, 8.000, 0.000)|Set IO[24]|Reset IO[24]|Set IO[v]|v = 3|v = v + 1
Dim v As Integer = 7|P5 = P(1, 2, 3)|Move L, @0 P5|Move L, P[5], Speed = Mps(v)
Move P, J(1, 2, 3)|Draw L, V(1, 2, 3)|Depart L, 5|Approach P, P(1, 2, 3), 5|If v = 1 Then
If v = 1 Then v = 2|End If|EndIf|For v = 1 To 3|Next|Do|Loop|Select Case v|End Select|Sub Other
Sub x(v)|End Sub|Function y|End Function|Exit Sub|Call Other(2)|Call x(1)|Call Main|#Define L P
#Define Move Draw|#Define P J|#Define v 3|#Define a b|#Define h 2.000|#Define Speed Decel
#Define mps v|#Undef L|Rem x|Rem Move L, P(1.0, 2.0, 3.0)|' Move|Move L, P(1.0, 2.0, 3.0), Next
Move L, @P P(1.0, 2.0, 3.0), Speed = 101|*a:|GoTo *a|Move L, P(1.0, 2.0, 3.0), Speed = 0.01
Move C, P(1.0, 2.0, 3.0)|Move L, @0 P(1.0, 2.0, 3.0), @P P(2.0, 2.0, 3.0)|1 2.0 3.0 4.0|ſtop
STOP|Move L, @P P(1.000, 2.000, 3.000), Speed = Mps(0.02)|Frobnicate 5|IO[24] = On|:"""
STATEMENTS = _STATEMENTS.replace("\n", "|").split("|")
NUMBERS = [
    "-0", "0", "-0.0", "-0.000", "00.5", "007", "1.", ".5", "1e3", "+1.0", "--1.0", "1234567890.0",
    "", " 1.0", "123456789.5", "0.1234567891", "h", "v", "1/2", "9" * 60, "9" * 60 + ".5", "1 ",
    "\t2.0", "1.0", "&HF", "１.0", "1.0.0", "1 2", "-", ".", "1,", "1, 2",
    "1.0, 2.0, 3.0, 4.0, 5.0", "(1.0)", "180", "3.25",
]  # fmt: skip
WORDS = [
    "Move", "move", "L", "P", "C", "l", "S", "PTP", "T", "J", "Speed", "S", "speed", "Mps", "MPS",
    "Accel", "Next", "Sub", "End", "Other", "v", "h", "IO", "ſpeed",
]  # fmt: skip
MARKS = [
    "@0", "@P", "@E", "@p", "@e", "@5", "@10", "@007", "@[5]", "@5.5", "@Q", "@", "@ 0", "@0,",
    "@-1", "@1234567",
]  # fmt: skip
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
WORD = re.compile(r"[A-Za-z]+")
MARK = re.compile(r"@\w+")
SPELLINGS = [*NUMBERS, *WORDS, *MARKS]
DAMAGE = Damage(
    STATEMENTS,
    [(NUMBER, NUMBERS), (NUMBER, NUMBERS), (WORD, WORDS), (MARK, MARKS)],
    [" ", "\t", "", "' ", "#", "\v", " " * 40, " " * 300, " " * 1100],
    [" ", "\t", " ' a remark", "'", ' "', ", Next", ")", ",", "\x85", ", Accel = 50"],
    [
        *"0159.,-+eE()@:;\" '\t\r\n\v\fMOVESPLCmoveslp=#[]_&",
        "\r\n", "\n\r", "\x00", "\x85", "\u2028", "é", "K",
    ],
    ["", "Sub Main\n", "Sub Main(h)\n"],
)  # fmt: skip
FIRST, SECOND = "{0}, {1}, {2}", "{3}, {4}, {5}"
LINES = f"Move P, P({FIRST})\nMove L, @P P({FIRST}, {SECOND})\n"
ARC = f"Move C, P({SECOND}), @0 P({SECOND}, {FIRST})\n"
PATH = FastPath(
    read=read,
    files=("a.pcs", "Other.pcs"),
    functions=["camgen.lang.pacscript.plain.Plain"],
    closed=[("camgen.lang.columns.Template.cut", cut_nothing)],
    template=MOTIONS,
    lines=re.compile(r"[^\n]*+\n|[^\n]++"),
    line_end="\n",
    by_hand=BY_HAND,
    signed_zeros=True,
    texts=TEXTS,
    numbers=(f"Sub Main\nTakeArm\n{LINES}{ARC}GiveArm\nEnd Sub\n", [0, 0, 3]),
    damage=DAMAGE,
    limit=("camgen.lang.pacscript.strict._STEPS", [2000, 2000, 2000, 5, 17, 30]),
)


def list_around_motions(statement: str) -> Iterator[tuple[str, Options]]:
    """Texts with a statement at each place without options, at every fourth with options.

    In the nightly tests the statement is at each place with all options.
    """
    rows = BY_HAND.split("\n")
    places = (0, 3, 8, 11, 15, 23, 26, 28, 33)
    for number, options in enumerate((PERCENT, CALLED, MOVED, LONG_S, {})):
        fewer_places = options and not is_night()
        for place in places[number::4] if fewer_places else places:
            yield "\n".join([*rows[:place], statement, *rows[place:]]), options


def list_within_motions(spelling: str) -> Iterator[tuple[str, Options]]:
    """Texts with a spelling instead of each token of a straight line and of an arc."""
    rows = BY_HAND.split("\n")
    before, after = rows[:9], [*rows[10:12], *rows[34:36]]
    straight, arc = rows[10].strip(), rows[16].strip()
    for row in (straight, arc):
        for pattern in (NUMBER, WORD, MARK):
            for token in pattern.finditer(row):
                changed = row[: token.start()] + spelling + row[token.end() :]
                yield "\n".join([*before, changed, *after]), PERCENT
