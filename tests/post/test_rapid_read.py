"""RAPID: programs written by hand, and the faults of wrong ones by line."""

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.lang.rapid.strict import read
from camgen.model.pose import Pose
from camgen.model.program import Comment, Force, MoveC, MoveJ, MoveL, Output, Wait
from camgen.post import Tolerance
from tests.support.rapid_programs import (
    E9,
    assert_same,
    at,
    pressed,
    pressing_program,
    print_program,
    program,
)

SHARED = Path(__file__).parents[2].parent / "shared"
FRAMES = """TASK PERS tooldata t1:=[TRUE,[[0,0,9],[1,0,0,0]],[0.001,[0,0,0.001],[1,0,0,0],0,0,0]];
TASK PERS wobjdata w1:=[FALSE,TRUE,"",[[100,0,0],[0.70710678,0,0,0.70710678]],[[10,0,0],[1,0,0,0]]];
"""
POINT = f"[[1,2,3],[0,1,0,0],[0,0,0,0],{E9}]"
START = f"ConfJ\\Off;ConfL\\Off;MoveAbsJ [[0,0,0,0,90,0],{E9}],v100,fine,t1;"
#: Options of programs written by hand, which have no ERROR handlers.
BY_HAND: dict[str, object] = {"on_error": "none", "tool": "t1", "work": "w1"}


def module(body: str, data: str = "") -> str:
    """A module with frames, `data` from line 4, and `body` in main from line 6 without data."""
    return f"MODULE m\n{FRAMES}{data}PROC main()\n{START}\n{body}\nENDPROC\nENDMODULE\n"


def test_an_unconditional_end_of_force_control_is_read() -> None:
    """Third-party programs end it after a section. That is right, so it is only a remark."""
    end = f"FCPressEnd {POINT},v5,t1\\WObj:=w1;\nFCDeact;"
    section = (
        f"MoveL {POINT},v5,fine,t1\\WObj:=w1;\n"
        f"FCPress1LStart {POINT},v5,\\Fx:=5,50,fine,t1\\WObj:=w1;\n"
    )
    reading = read({"m.mod": module(section + end)}, BY_HAND)
    (remark,) = reading.findings
    assert remark.level == "unusual"
    assert (remark.line, remark.what.split(":")[0]) == (9, "fcdeact without IF FCIsForceMode()")
    assert reading.body[-1] == Force(0.0)


def test_a_program_written_by_hand_is_read() -> None:
    text = module(
        """\
  movel OFFS ( p1 , 0, 0,-1.5e0 ) , v50\\V:=25 , z5 \\Z:=2.5 , T1 , \\wobj := w1 ;  ! down
        MoveJ RelTool(p1,0,0,5\\Rz:=90),v1,FINE,t1\\WObj:=w1;
        SET do1; Reset do1; WaitTime \\InPos, 0.5; SetDO do1,
            high;
        sub;""",
        f"LOCAL CONST robtarget p1:={POINT};\nCONST num a:=7;\n"
        "VAR speeddata v1:=[a,500,5000,1000];\n"
        "LOCAL PROC sub()\n! nothing\nENDPROC\n",
    )
    options = BY_HAND | {"signals": {"process": "DO1"}}
    reading = read({"a.mod": text}, options)
    local = "a routine that is LOCAL, which the controller cannot call by an event"
    assert list_faults({"a.mod": text}, options) == [(7, local)]
    kinds = [type(item) for item in reading.body]
    assert kinds == [MoveJ, MoveL, MoveJ, Output, Output, Wait, Output]
    down, turned = reading.body[1], reading.body[2]
    assert isinstance(down, MoveL)
    assert (down.target.origin, down.speed, down.blend) == ((1.0, 2.0, 1.5), 25.0, 2.5)
    assert isinstance(turned, MoveJ)
    assert isinstance(turned.target, Pose)
    # Tool z points down, so 5 mm along it is z - 5. A rotation about it by 90 deg turns tool x
    # from (1, 0, 0) to (0, -1, 0).
    assert turned.target.origin == pytest.approx((1, 2, -2))
    assert turned.target.rotation[:, 0] == pytest.approx((0, -1, 0))
    assert turned.speed == 7
    assert [item.value for item in reading.body if isinstance(item, Output)] == [1, 0, 1]
    assert {item.signal for item in reading.body if isinstance(item, Output)} == {"process"}
    # the user frame turns x of the object frame to y of the base
    assert reading.work is not None
    assert reading.work.origin == pytest.approx((100, 10, 0), abs=1e-6)


@pytest.mark.parametrize(
    ("body", "faults"),
    [
        (f"MoveL {POINT},v100,fine,t9\\WObj:=w1;", [(6, "t9 is not declared")]),
        (f"\nMoveL {POINT},v37,fine,t1\\WObj:=w1;", [(7, "v37 is not declared")]),
        (f"MoveL {POINT},v100,z3,t1\\WObj:=w1;", [(6, "z3 is not declared")]),
        (f"MoveL {POINT},fine,v100,t1\\WObj:=w1;", [(6, "fine is zonedata, not speeddata")]),
        (
            f"MoveL [[1,2,3],[0,1,0.01,0],[0,0,0,0],{E9}],v100,fine,t1\\WObj:=w1;",
            [(6, "a quaternion is not normalised (its square differs from 1 by 0.0001)")],
        ),
        (
            f"MoveL [[1,2,3],[1,0,0],[0,0,0,0],{E9}],v100,fine,t1\\WObj:=w1;",
            [(6, "orient has 4 components, not 3")],
        ),
        (
            f"MoveL {POINT},v100,z5,t1\\WObj:=w1;\nSetDO do1,1;",
            [(6, "a motion that blends before setdo")],
        ),
        (f"MoveL {POINT},v100,z5,t1\\WObj:=w1;", [(6, "a motion that blends before the end")]),
        (
            f"MoveL {POINT},v100,fine,t1;\nMoveL {POINT},v100,fine,t1\\WObj:=w1;",
            [(7, "w1 is a second work object")],
        ),
        (f"MoveL {POINT},v100\\T:=5,fine,t1\\WObj:=w1;", [(6, "\\t of movel is not read")]),
        (
            "MoveL [[1,2,3],[0,1,0,0],[0,0,0,0],[0,9E9,9E9,9E9,9E9,9E9]],v5,fine,t1;",
            [(6, "external axes are not read")],
        ),
        (
            f"MoveC {POINT},{POINT},v5,fine,t1;\nMoveC {POINT},{POINT},v5,fine,t1;",
            [(7, "the points of an arc are on one line")],
        ),
        (
            'TPWrite "MoveL";\nStop 1;',
            [(6, "tpwrite is a statement that is not read"), (7, "stop is read without arguments")],
        ),
        (
            "FOR i FROM 1 TO 2 DO\nSetDO do1,1;\nENDFOR",
            [(6, "FOR is a statement that is not read")],
        ),
        ("x:=5;", [(6, "x:= is a statement that is not read")]),
        ("SetDO do1,2;", [(6, "a digital output is 0 or 1")]),
        (f"SetDO {'d' * 33},1;", [(6, f"{'d' * 33} is longer than 32 characters")]),
        ("SetDO do1,1", [(7, "; expected, found 'ENDPROC'")]),
        ("WaitTime -1;", [(6, "a wait must not be negative")]),
        ("WaitTime 9E99;", [(6, "9E99 is larger than a num can be")]),
        ("main;", [(6, "main is called too deeply")]),
        ("FCPressL p,v100,5,z5,t1;", [(6, "p is not declared")]),
        (f"FCPressL {POINT},v100,5,fine,t1;", [(6, "fcpressl without FCPress1LStart")]),
        (
            (
                f"MoveL {POINT},v5,fine,t1;\nFCPress1LStart {POINT},v5,\\Fx:=5,50,fine,t1;\n"
                f"MoveL {POINT},v5,fine,t1;"
            ),
            [
                (8, "movel while pressing, before FCPressEnd"),
                (10, "FCPressEnd is missing at the end"),
            ],
        ),
        (
            f"MoveL {POINT},v5,fine,t1;\nFCPress1LStart {POINT},v5,\\Fx:=5,50,fine,t1;\n"
            f"FCPressL {POINT},v5,-5,fine,t1;\n"
            f"FCPressEnd {POINT},v5,t1;",
            [(8, "fcpressl does not press in the direction of FCPress1LStart")],
        ),
    ],
)
def test_a_wrong_statement_is_a_fault_in_its_line(body: str, faults: list[tuple[int, str]]) -> None:
    assert list_faults({"m.mod": module(body)}, BY_HAND) == faults


#: Remarks on most short texts. Other tests are about them.
COMMON = re.compile(
    r".* is declared and never used|(?:t1|wobj0) is the \w+(?: object)? of a motion.*"
)


def list_faults(files: dict[str, str], options: dict[str, object]) -> list[tuple[int, str]]:
    """Line and message of each fault of a text, without the `COMMON` remarks."""
    faults = [(fault.line, fault.what) for fault in read(files, options).findings]
    return [(line, what) for line, what in faults if not COMMON.fullmatch(what)]


@pytest.mark.parametrize(
    ("text", "faults"),
    [
        ("", [(1, "there is no PROC main")]),
        (
            "MODULE m\nENDMODULE\n! tail\n5",
            [
                (3, "a comment outside of a module, where the kernel manual has none"),
                (4, "'5' stands outside a module"),
                (4, "there is no PROC main"),
            ],
        ),
        (
            f"MODULE m\nPROC main()\n{START}\n",
            [
                (3, "t1 is not declared"),
                (4, "ENDPROC of main is missing"),
                (4, "ENDMODULE of m is missing"),
            ],
        ),
        (
            (
                f"MODULE m\n{FRAMES}PROC main()\nConfJ\\Off;MoveJ {POINT},v5,fine,t1;\n"
                "ENDPROC\nENDMODULE"
            ),
            [(5, "the first motion is movej, not MoveAbsJ")],
        ),
        (
            f"MODULE {'n' * 33}\nCONST num {'k' * 33}:=1;\nCONST num v5:=1;\n"
            "CONST num a:=b;\nCONST num b:=a;\n"
            "PERS num c:=a;\nPROC main()\nENDPROC\nENDMODULE",
            [
                (1, f"{'n' * 33} is longer than 32 characters"),
                (2, f"{'k' * 33} is longer than 32 characters"),
                (3, "v5 is predefined"),
                (4, "a is defined by itself or through too many others"),
                (6, "PERS c must have a literal value"),
            ],
        ),
        (
            (
                "MODULE user\nCONST num reg1:=1;\nLOCAL CONST num edge:=1;\nPROC main()\n"
                "ENDPROC\nENDMODULE"
            ),
            [
                (1, "user is the name of a system module or of what one declares"),
                (2, "reg1 is the name of a system module or of what one declares"),
            ],
        ),
        (
            (
                "MODULE a\nPROC main()\nENDPROC\nPROC b()\nENDPROC\nPROC MoveL()\nENDPROC\n"
                "ENDMODULE\nMODULE b\nENDMODULE"
            ),
            [(6, "MoveL is predefined"), (9, "the module b has the name of something global")],
        ),
        (
            "MODULE p\nPROC p()\nENDPROC\nPROC main()\nENDPROC\nPROC MAIN()\nENDPROC\nENDMODULE",
            [(2, "p is global and has the name of a module"), (6, "MAIN is declared twice")],
        ),
        (
            "MODULE m\nPERS speeddata v:=[5,500,5000,1000];\nPROC main()\nENDPROC\nENDMODULE",
            [(2, "v is PERS: an earlier run or another task may have changed it")],
        ),
    ],
)
def test_a_wrong_module_has_faults(text: str, faults: list[tuple[int, str]]) -> None:
    assert list_faults({"m.mod": text}, {}) == faults


def test_the_fast_path_and_the_general_parser_read_the_same() -> None:
    plan = pressing_program(pressed(0), pressed(0.3, 12.0, 1.0), pressed(0.5))
    plan = program(*plan.body, MoveJ(at(1, 2, 3), 33.0, 5.0), MoveC(at(2, 3, 3), at(3, 2, 3), 9.0))
    text = print_program(plan)[1]["plate.mod"]
    compact, spaced = read({"a": text}, {}), read({"a": re.sub(r"([\[\],])", r" \1 ", text)}, {})
    assert spaced.lines == compact.lines
    assert_same(program(*compact.body), spaced, Tolerance(0, 0, 0, 0, 0, 0))


GOOD = print_program(
    pressing_program(pressed(0), pressed(0.3), Output("process", 1), Comment("x"), Wait(1))
)[1]["plate.mod"]
TOKENS = re.findall(r"\w+|[^\w\s]|\s+", GOOD)
PIECES = [
    *'[];,\\!\n-()é\x00"',
    ":=",
    "9E999",
    "PROC x()",
    "ENDPROC",
    "MODULE y",
    "IF",
    "THEN",
    "%%%",
    "[" * 3000,
    "main;",
    "CONST num q:=",
    "1.2.3",
    "TASK",
    "MoveL",
    "TRUE",
    "t1",
    "fine",
]
CHANGES = st.tuples(st.integers(0, len(TOKENS) - 1), st.sampled_from(PIECES), st.booleans())


@given(st.lists(CHANGES, min_size=1, max_size=4))
def test_a_changed_program_is_read_without_an_exception(
    changes: list[tuple[int, str, bool]],
) -> None:
    tokens = list(TOKENS)
    for place, piece, insert in changes:
        tokens[place] = f"{tokens[place]} {piece} " if insert else piece
    text = "".join(tokens)
    reading = read({"a": text}, {})
    assert all(
        1 <= fault.line <= text.count("\n") + text.count("\r") + 1 for fault in reading.findings
    )
    assert len(reading.body) == len(reading.lines)


@given(st.text(), st.text(alphabet='[]();,\\:=!"%MODULE PRCEND\n09.'))
def test_any_text_is_read_without_an_exception(first: str, second: str) -> None:
    assert read({"a": first, "b": second}, {}).findings


@pytest.mark.skipif(
    not (SHARED / "data").is_dir(), reason="the folder shared is not beside the repository"
)
def test_third_party_programs_have_faults_and_raise_no_exception() -> None:
    paths = sorted((SHARED / "data" / "robot").rglob("*.*"))
    assert paths
    for path in paths:
        reading = read({path.name: path.read_text(errors="replace")}, {})
        assert reading.findings, path.name
