"""No text makes the interpreter of RAPID raise an error or take long.

The interpreter and the strict read-back give the same motions for the programs of the post.
"""

import random
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.lang.programs import Executed, RunRequest
from camgen.lang.rapid.language import run
from camgen.lang.rapid.strict import read
from camgen.model.limits import Limits
from camgen.model.pose import Pose
from camgen.model.program import MoveC, MoveJ, MoveL
from tests.support.rapid_texts import changed, program
from tests.support.steps import CALLS_OF_A_STEP, assert_linear, count_calls

ROOT = Path(__file__).parents[3]
CASE_PROGRAMS = sorted((ROOT / "fixtures" / "cases").rglob("*.mod"))
HEAD = (
    "MODULE m\nVAR num n;\nVAR string s;\n"
    "CONST robtarget p1:=[[500,0,400],[0,1,0,0],[0,0,0,0],[9,9,9,9,9,9]];\n"
)
HEAD += "PERS tooldata t1:=[TRUE,[[0,0,100],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];\nPROC main()\n"
TAIL = "\nENDPROC\nENDMODULE\n"
WORDS = """
IF THEN ELSEIF ELSE ENDIF FOR FROM TO STEP DO ENDFOR WHILE ENDWHILE TEST CASE DEFAULT ENDTEST GOTO
RETURN RAISE PROC ENDPROC FUNC ENDFUNC TRAP ENDTRAP MODULE ENDMODULE RECORD ENDRECORD ERROR UNDO
VAR PERS CONST LOCAL TASK num p1 n s MoveL MoveC MoveAbsJ TriggL SearchL SetDO WaitDI Offs(
RelTool( CRobT( [ ] ( ) { } , ; := = < > + - * / \\ % . 1 0 -5 "a" TRUE NOT AND DIV main v100 fine
tool0 <SMT> ! PDispOn FCPressL ArcLStart x: Present( Dim( EulerZYX(\\X,
""".split()  # noqa: SIM905


#: Statements that a loop may run in these tests: enough to be far above the lines of a text.
STEPS = 20_000
DEFAULT = Limits()


def run_module(text: str, limits: Limits = DEFAULT) -> Executed:
    return run({"m.mod": text}, RunRequest(limits=limits))


@given(st.text())
def test_any_text_is_run(text: str) -> None:
    run_module(text)
    run_module(HEAD + text + TAIL)


@given(st.lists(st.sampled_from([*WORDS, "\n", ";\n"]), max_size=60))
def test_words_in_any_order_are_run(words: list[str]) -> None:
    run_module(HEAD + " ".join(words) + TAIL)


@pytest.mark.parametrize("seed", range(10))
def test_a_damaged_program_is_run(seed: int) -> None:
    chance = random.Random(seed)
    for _ in range(20):
        texts = program(chance)
        for _ in range(chance.choice([1, 3, 9])):
            index = chance.randrange(len(texts))
            texts[index] = changed(chance, texts[index])
        executed = run({f"{index}.mod": text for index, text in enumerate(texts)}, RunRequest())
        assert len(executed.lines) == len(executed.body)
        assert not executed.frame or len(executed.frame) == len(executed.body)


def test_a_tool_without_an_orientation_is_refused_at_each_motion() -> None:
    tool = "PERS tooldata tBad:=[TRUE,[[0,0,0],[9,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];\n"
    joints = "MoveAbsJ [[0,0,0,0,0,0],[9,9,9,9,9,9]],v100,fine,tBad;\n"
    executed = run_module(
        f"MODULE m\n{tool}PROC main()\n{joints}{joints}MoveL *,v100,fine,tBad;{TAIL}"
    )
    assert [fault.line for fault in executed.findings] == [4, 5, 6]
    assert all("the sum of its squares is 81" in fault.what for fault in executed.findings)


FAULTS: dict[str, Callable[[int], str]] = {
    "no zone": lambda count: "MoveL p1,v100,,fine;\n" * count,
    "ends": lambda count: "ENDIF\n" * count,
    "open blocks": lambda count: "IF n=0 THEN\n" * count,
    "by zero": lambda count: "n:=1/0;\n" * count,
    "open texts": lambda count: 'TPWrite "abc;\n' * count,
    "no commas": lambda count: "MoveL p1 v100 fine t1\n" * count,
    "brackets": lambda count: "n:=" + "(" * count + "1" + ")" * count + ";",
    "a sum": lambda count: "n:=" + "+".join(["1"] * count) + ";",
    "unknown routines": lambda count: "".join(f"there{k};\n" for k in range(count)),
}


@pytest.mark.parametrize("name", FAULTS)
def test_each_fault_costs_the_same(name: str) -> None:
    def execute(count: int) -> Executed:
        return run_module(HEAD + FAULTS[name](count) + TAIL)

    assert_linear(execute, 1600)
    executed = execute(1600)
    assert executed.findings or executed.assumed or executed.stopped


@pytest.mark.parametrize(
    "body",
    [
        'WHILE TRUE DO\ns:=s+"abc"+s;\nIF n=1 RETURN;\nENDWHILE',
        "WHILE TRUE DO\nn:=(n+1)*(n+1);\nIF n<0 RETURN;\nENDWHILE",
        "FOR i FROM 1 TO 1E30 DO\nn:=n+1;\nENDFOR",
        "FOR i FROM 1 TO 2 STEP 1E-30 DO\nENDFOR",
        "FOR i FROM 1 TO 9000 DO\nFOR j FROM 1 TO 9000 DO\nENDFOR\nENDFOR",
    ],
)
def test_loops_end_at_the_limit_of_steps(body: str) -> None:
    def execute() -> None:
        executed = run_module(HEAD + body + TAIL, Limits(rapid_steps=STEPS))
        assert executed.findings or executed.assumed or executed.stopped

    assert count_calls(execute) < CALLS_OF_A_STEP * STEPS


@pytest.mark.parametrize(
    "line",
    [
        (
            "MoveL [[1.5,2.5,3.5],[0,1,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],"
            "v100,z10,t1\\WObj:=wobj0;\n"
        ),
        (
            "MoveL [ [1.5, 2.5, 3.5], [0, 1, 0, 0], [0, 0, 0, 0], "
            "[9E9, 9E9, 9E9, 9E9, 9E9, 9E9] ], v100, z10, t1;\n"
        ),
        "MoveL Offs(p1,n,2,3),v100,z10,t1\\WObj:=wobj0;\n",
        (
            "MoveC Offs(p1,5,5,0),Offs(p1,10,0,0),v100,z10,t1;\n"
            "MoveC Offs(p1,5,-5,0),p1,v100,z10,t1;\n"
        ),
        "IF di1=1 THEN\nMoveL p1,v100,fine,t1;\nELSE\nStop;\nENDIF\n",
    ],
)
def test_each_line_of_a_long_program_costs_the_same(line: str) -> None:
    def execute(count: int) -> None:
        executed = run_module(HEAD + line * count + TAIL)
        assert executed.stopped is None
        assert len(executed.body) >= count

    assert_linear(execute, 1000)


def make_comparable(value: object) -> object:
    """An instruction as lists of rounded numbers, which `==` can compare."""
    if isinstance(value, Pose):
        return value.rotation.round(9).tolist(), [round(v, 6) + 0.0 for v in value.origin]
    if isinstance(value, (MoveJ, MoveL, MoveC)):
        # The interpreter moves the via point half-way along the arc.
        names = set(value.__struct_fields__) - {"via"}
        return type(value), [make_comparable(getattr(value, name)) for name in sorted(names)]
    return value


def test_many_traps_without_end_share_the_limit_of_steps() -> None:
    traps = "\n".join(f"TRAP t{k}\nWHILE TRUE DO\nn:=n+1;\nENDWHILE\nENDTRAP" for k in range(2000))
    text = f"MODULE m\nVAR num n;\nPROC main()\nENDPROC\n{traps}\nENDMODULE\n"
    options = RunRequest(limits=Limits(rapid_steps=STEPS))
    calls = count_calls(lambda: run({"a.mod": text}, options))
    assert calls < CALLS_OF_A_STEP * STEPS


@pytest.mark.parametrize(
    "path", CASE_PROGRAMS, ids=lambda path: f"{path.parents[1].name}-{path.stem}"
)
def test_a_program_of_the_post_has_the_instructions_of_its_read_back(path: Path) -> None:
    text = path.read_text(encoding="latin-1")
    strict, executed = read({path.name: text}, {"signals": {}}), run_module(text)
    assert [make_comparable(item) for item in executed.body] == [
        make_comparable(item) for item in strict.body
    ]
    assert executed.lines == tuple(strict.lines)
    assert executed.findings == ()
    assert executed.stopped is None
