"""The fast path of the V+ read-back: texts, and ways to damage them."""

import re
from collections.abc import Iterator

from camgen_posts.vplus import VPlus

from camgen.lang.vplus.strict import read
from camgen.lang.vplus.text import LINE, MOTIONS
from camgen.model.program import MoveJ
from tests.support.damage import Damage
from tests.support.fast_paths import FastPath, cut_nothing, list_paths
from tests.support.samples import Options, Sample

HOME = MoveJ(VPlus.cell().home, 100.0)


def printed(options: Options, turning: bool = False) -> str:
    """A text of the post with six paths."""
    return Sample("vplus", list_paths(HOME, 6, 7, turning=turning), options).written


ON_CONTROLLER = {"declare": False, "tool": "pen", "work": "wf"}
DIVIDED = {"max_lines": 12}
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
NAMED = {"work": "a.very_long.name"[:15], "posture": ["RIGHTY"]}
COARSE = {"max_lines": 9, "rated": 900.0, "decimals": 1}
TEXTS = [
    (BY_HAND, {}),
    (BY_HAND, {"declare": False, "tool": "other", "work": "sub.frame"}),
    (printed({}), {}),
    (printed(DIVIDED), DIVIDED),
    (printed(DIVIDED).replace("\n", "\r\n"), {}),
    (printed(NAMED), {}),
    (printed(ON_CONTROLLER), ON_CONTROLLER),
    (printed(COARSE, turning=True), {"rated": 900.0}),
]
_STATEMENTS = """\
BREAK|SPEED 50|SPEED 30, 100 MMPS ALWAYS|SPEED 10 MMPS|SPEED 2 IPS ALWAYS|SPEED 5 MONITOR
SPEED v ALWAYS|v = 3|v = v+1|SPEED 0|SPEED 1,0 MMPS|SPEED MMPS|DISABLE CP|ENABLE CP
SET wf = TRANS(1,2,3)|SET cg.work = a:b|SET a = HERE|SET cg.work = NULL:TRANS(1)
SET cg.work = TRANS(250,-75,150,0,0,0)|AUTO cg.work|GLOBAL wf|LOCAL v|.END|.PROGRAM x()
.PROGRAM sub(a)|.DATA|CALL sub()|CALL part.1()|CALL x()|FOR v = 1 TO 3|FOR v = 3 TO 1|END|RETURN
IF v THEN|DO|UNTIL v|TOOL wf|TOOL cg.tool|BASE|BASE 1|SIGNAL 33|SIGNAL -v|SIGNAL 1500|SIGNAL 7 8
WAIT.EVENT , 0.5|WAIT.EVENT , v|WAIT.EVENT 3|DELAY 1|DEPARTS 5|DEPART v
APPRO wf:TRANS(1,2,3,0,180,180), 9|MOVE #PPOINT(1,2,3,4)|MOVES #PPOINT(1,2,3,4)
MOVE HERE:TRANS(1,2,3,0,0,0)|MOVES dest:TRANS(1,2,3,0,0,0)|MOVES TRANS(1,2,3,0,180,180)
MOVES transb:TRANS(1,2,3,0,180,180)|MOVE NULL:TRANS(1,2,3,0,180,180)
MOVES wf:TRANS(0,0,0,0,0,0):TRANS(1,2,3,0,0,0)|DRIVE 1, 2|FROBNICATE
TYPE "MOVES wf:TRANS(1,2,3,0,180,180)"|a_very_long_name_1 = 2|a_very_long_name_2 = 2|HALT
DETACH ()|ATTACH ()|ATTACH (1)|SELECT ROBOT = 2|COARSE 50 ALWAYS|FINE|NULL|NULL 3|ACCEL 50
ACCEL (9) 1, 2|FLIP|RIGHTY|7 BREAK|07 BREAK|SPEED 200|SIGNAL 10000|MOVE #PPOINT(1,2,3,4,5,6)
.END foo|.PROGRAM move()|LOCAL v, v|MOVES wf:TRANS(1,2,3,0,90,0)|DISABLE CP"""
STATEMENTS = _STATEMENTS.replace("\n", "|").split("|")
NAMES = [
    "cg.work", "CG.WORK", "wf", "other", "Wf", "p", "p.1", "v", "a_very_long_name_1",
    "a_very_long_name_2", "here", "DEST", "NULL", "TRANS", "a.very_long.nam", "A.very_long.name",
    "pen", "#p", "1a", "wf:wf", "é",
]  # fmt: skip
NUMBERS = [
    "-0", "0", "-0.0", "00", "007", "1.", ".5", "1e3", "1E-3", "+1", "--1", "0.0000000001",
    "123456789", "", " 1", "1234567890", "-5.25", "1/2", "v", "99999999999999999999", "1 ", "\t2",
    "１", "0x1", "-", "180", "0.1234567891",
]  # fmt: skip
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
NAME = re.compile(r"[A-Za-z][A-Za-z0-9._]*")
WORDS = [*NAMES, "MOVE", "MOVES", "TRANS", "moves"]
SPELLINGS = [*NUMBERS, *NAMES]
DAMAGE = Damage(
    STATEMENTS,
    [(NUMBER, NUMBERS), (NAME, WORDS)],
    [" ", "\t", "100 ", "70000 ", "", "; ", ". ", "\v"],
    [" ", "\t", " ; a remark", ";", ' "', ":NULL", ")", ",", "\x85", "\f"],
    [
        *'0159.,-+eE():;" \t\r\n\v\fMOVESTRANSmovestrans=#$_',
        "\r\n", "\n\r", "\x00", "\x85", "\u2028", "é", "ſ", "K",
    ],
)  # fmt: skip
FUNCTIONS = "camgen.lang.vplus.strict.robot."
FIRST = "MOVES f:TRANS({0},{1},{2},{3},{4},{5})\n"
SECOND = "MOVES f:TRANS({6},{7},{8},{9},{10},{11})\n"
PATH = FastPath(
    read=read,
    files=("a", "b"),
    functions=[f"{FUNCTIONS}RobotState.try_stretch"],
    closed=[
        ("camgen.lang.columns.Template.cut", cut_nothing),
        ("camgen.lang.vplus.text._REMEMBERED", 0),
        (f"{FUNCTIONS}_KEPT", 0),
        (f"{FUNCTIONS}parse_plain_speed", lambda _: None),
    ],
    template=MOTIONS,
    lines=LINE,
    line_end=r"\r\n|\r|\n",
    by_hand=BY_HAND.replace("MOVES wf:TRANS(7,8,9.5", "moves wf:trans(7,8,9.5"),
    signed_zeros=False,
    texts=TEXTS,
    numbers=(f".PROGRAM a()\nSET f = NULL\n{FIRST}{SECOND}{FIRST}.END\n", [0, 6, 0]),
    damage=DAMAGE,
    limit=("camgen.lang.vplus.strict._LOOPED", [None, None, None, -60, -15, 0, 30]),
)


def list_around_motions(statement: str) -> Iterator[tuple[str, Options]]:
    """Texts with a statement before, between and after two motions, straight or not."""
    motions = ["    MOVES wf:TRANS(1,2,3,0,180,180)", "    MOVES wf:TRANS(2,2,3,0,180,180)"]
    for place in range(3):
        straight = [*motions[:place], statement, *motions[place:]]
        joint = [line.replace("MOVES", "MOVE") for line in straight]
        for rows in (straight, joint, [*joint, *straight]):
            inserted = "\n".join(rows)
            yield BY_HAND.replace("    DEPARTS 5\n", f"{inserted}\n    DEPARTS 5\n"), {}


def list_within_motions(spelling: str) -> Iterator[tuple[str, Options]]:
    """Texts with a spelling instead of the numbers 9.5 and 0 and of the frame of a motion."""
    motion = "MOVES wf:TRANS(7,8,9.5,0,180,180)"
    for token in ("9.5", "0", "wf"):
        yield BY_HAND.replace(motion, motion.replace(token, spelling)), {}
