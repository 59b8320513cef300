"""No text makes the interpreter of V+ raise an error or take long."""

import random
from collections.abc import Callable

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from camgen.lang.programs import Executed, RunRequest
from camgen.lang.vplus.language import recognise, run
from camgen.model.limits import Limits
from camgen.model.program import MoveC, MoveJ, MoveL
from tests.support.steps import CALLS_OF_A_STEP, assert_linear, count_calls

#: A program with instructions of every kind.
SAMPLE = """\
.PROGRAM main()
AUTO i, p[4], $s
LOCAL REAL total
GLOBAL pick
    SPEED 50 ALWAYS
    SPEED 20, 100 MMPS ALWAYS
    ACCEL (1) 80, 80
    TOOL grip
    BASE 0, 0, 10, 0
    SET p[0] = SHIFT(pick BY 0,0,10):RZ(90)
    MOVE #safe
    FOR i = 1 TO 3
        APPRO p[0], 50
        MOVES pick:TRANS(i,0,0,0,180,0)
        MOVES pick:TRANS(1,2,3,0,180,0)
        MOVES pick:TRANS(4,2,3,0,180,0)
        CLOSEI
        DEPARTS 30
        IF (i == 2) AND SIG(1001) THEN
            NEXT
        ELSE
            CALL place(i, p[], $s)
        END
    END
    WHILE NOT SIG(1003) DO
        CASE i OF
        VALUE 1, 2:
            SIGNAL 5, -6
        ANY
            EXIT
        END
    END
    DO
        i = i+1
    UNTIL i > 10
10  TIMER 1 = 0
    WAIT TIMER(1) > 0.5
    READ (5) a, $b
    $s = $DECODE($b,",",0)+$ENCODE(/F0.2,i)
    DECOMPOSE q[] = HERE
    IF LEN($s) > 100 GOTO 10
    MOVE #PPOINT(1,2,3,4)
    DRIVE 1, 10, 50
    EXECUTE 2 place()
    WAIT.EVENT , 0.1
    RETURN
.END
.PROGRAM place(n, at[], $out)
    MOVES at[0]
    $out = $CHR(64+n)
    HERE here.now
    total = total+1
.END
.LOCATIONS
pick 1 2 3 0 180 0
.END
"""
FEW_STEPS = RunRequest(limits=Limits(vplus_steps=2000))
PIECES = sorted(set(SAMPLE.replace("(", " ( ").replace(")", " ) ").replace(",", " , ").split()))


def check_result(executed: Executed, lines: int) -> None:
    """Check that a result is consistent: its lines, frames, findings, speeds and blends."""
    count = len(executed.body)
    assert len(executed.lines) == count
    assert executed.frame == () or (
        len(executed.frame) == count and max(executed.frame) < len(executed.frames)
    )
    assert list(executed.findings) == sorted(executed.findings, key=lambda finding: finding.line)
    assert all(
        "\n" not in finding.what and len(finding.what) <= 160 and finding.line >= 1
        for finding in executed.findings
    )
    assert all(finding.line <= lines for finding in executed.findings)
    for item in executed.body:
        if isinstance(item, MoveJ | MoveL | MoveC):
            assert item.speed > 0
            assert item.blend >= 0


def check_text(text: str) -> None:
    recognise(text)
    # A single carriage return ends a line too.
    check_result(run({"a.v2": text}, FEW_STEPS), text.count("\n") + text.count("\r") + 2)


def test_the_sample_is_run_to_its_end():
    executed = run({"a.v2": SAMPLE}, RunRequest())
    assert not [finding for finding in executed.findings if finding.level == "refused"]
    assert len(executed.body) == 26


@given(st.text(max_size=300))
@example("\r\r0")
def test_any_text_is_run(text: str) -> None:
    check_text(text)
    check_text(f".PROGRAM a()\n{text}\n.END\n")


@given(st.lists(st.lists(st.sampled_from(PIECES), max_size=9).map(" ".join), max_size=30))
def test_words_in_any_order_are_run(lines: list[str]) -> None:
    check_text("\n".join([".PROGRAM a()", *lines, ".END", ""]))


@given(st.randoms(use_true_random=False))
def test_a_program_with_damaged_lines_is_run(chance: random.Random) -> None:
    lines = SAMPLE.splitlines()
    for _ in range(chance.randint(1, 6)):
        index = chance.randrange(len(lines))
        change = chance.randrange(5)
        if change == 0:
            del lines[index]
        elif change == 1:
            lines.insert(index, lines[chance.randrange(len(lines))])
        elif change == 2:
            lines[index] = lines[index][: chance.randrange(len(lines[index]) + 1)]
        elif change == 3:
            column = chance.randrange(len(lines[index]) + 1)
            lines[index] = (
                lines[index][:column]
                + chance.choice('()[]",:#$^-+.;\\x1a=<>0')
                + lines[index][column:]
            )
        else:
            lines[index] = lines[index].replace(
                chance.choice(["1", "2", "3", "0", "i", "p", "s", "pick", "SET ", "("]),
                chance.choice(["", "99", "-1", "1e30", "x", "i", "#p", "$s"]),
            )
    check_text("\n".join(lines) + "\n")


#: Statements that a loop may run in these tests: enough to be far above the lines of a text.
STEPS = 20_000

LONG_TEXTS: dict[str, Callable[[int], str]] = {
    "brackets": lambda count: "x = " + "(" * count + "\n",
    "not": lambda count: "x = " + "NOT " * count + "1\n",
    "complements": lambda count: "x = " + "COM " * count + "1\n",
    "inverses": lambda count: "MOVE " + "INVERSE(" * count + "\n",
    "open blocks": lambda count: "IF x THEN\nEXIT\n" * count,
    "open loops": lambda count: "WHILE TRUE DO\nEXIT\n" * count,
    "unknown words": lambda count: "FROB 1\n" * count,
    "ends": lambda count: "END\n" * count,
    "variables": lambda count: (
        "RETURN\n" + "".join(f"SIGNAL {k % 900 + 1}, x{k}\n" for k in range(count))
    ),
    "programs": lambda count: "".join(
        f"CALL a{k}()\n.END\n.PROGRAM a{k}()\n" for k in range(1, count)
    ),
}


@pytest.mark.parametrize("name", LONG_TEXTS)
def test_each_line_of_a_long_text_costs_the_same(name: str) -> None:
    def execute(count: int) -> None:
        text = f".PROGRAM a()\n{LONG_TEXTS[name](count)}.END\n"
        check_result(run({"a.v2": text}, RunRequest()), text.count("\n") + 2)

    assert_linear(execute, 1600)


@pytest.mark.parametrize(
    "text",
    [
        (
            ".PROGRAM a()\nSPEED 1E-300 ALWAYS\nSPEED 1E29 MMPS\nMOVE TRANS(1)\n"
            "SPEED 1, 1E-300 MMPS\nMOVE NULL\n.END\n"
        ),
        ".PROGRAM a()\nCALL a()\nCALL a()\n.END\n",
        ".PROGRAM a()\nFOR i = 1 TO 1E6\nBITS 1,32 = i\nEND\n.END\n",
        ".PROGRAM a()\nFOR i = 1 TO 1E6\n x[i] = LAST(x[])\nEND\n.END\n",
        ".PROGRAM a()\nFOR i = 1 TO 1E6\nCASE i OF\n" + "VALUE 0:\n" * 3000 + "END\nEND\n.END\n",
        '.PROGRAM a()\n$s = "a"\nWHILE LEN($s) > 0 DO\n$s = $s+$s\nx = x+1\nEND\n.END\n',
        ".PROGRAM a()\nSET w = NULL\nFOR i = 1 TO 1E6\n"
        + "MOVES w:TRANS(1,2,3,0,180,180)\n" * 300
        + "END\n.END\n",
    ],
)
def test_loops_end_at_the_limit_of_steps(text: str) -> None:
    def execute() -> None:
        options = RunRequest(limits=Limits(vplus_steps=STEPS))
        check_result(run({"a.v2": text}, options), text.count("\n") + 2)

    assert count_calls(execute) < CALLS_OF_A_STEP * STEPS


def test_each_line_of_a_long_program_costs_the_same() -> None:
    block = [
        "SET p[{0}] = SHIFT(wf BY x,0,{0})",
        "APPRO p[{0}], 50",
        "SPEED 20",
        "MOVES p[{0}]",
        "BREAK",
        "SIGNAL 5, -6",
        "x = {0}*2+SIN(30)",
        "IF x > 5 THEN",
        "DEPARTS 50",
        "END",
    ]

    def execute(count: int) -> None:
        lines: list[str] = []
        for k in range(count):
            lines += [line.format(k % 10) for line in block]
        text = "\n".join([".PROGRAM a()", "SET wf = TRANS(1,2,3)", *lines, ".END", ""])
        executed = run({"a.v2": text}, RunRequest())
        assert executed.stopped is None
        assert "refused" not in [finding.level for finding in executed.findings]

    assert_linear(execute, 1000)


def test_the_message_of_a_statement_of_escapes_stays_short() -> None:
    text = ".PROGRAM main()\n" + "\U00018cd6" * 40 + "\n.END\n"
    executed = run({"a.v2": text}, FEW_STEPS)
    check_result(executed, 3)
    assert [finding.what[:17] for finding in executed.findings] == ["unknown statement"]
