"""Coverage: the statements of a program, and those that its runs executed."""

from textwrap import dedent

import numpy as np
import pytest

from camgen.lang.alternatives import run_alternatives
from camgen.lang.coverage import Coverage, format_coverage, join_coverage
from camgen.lang.programs import Places, RunRequest, find_language
from camgen.model.limits import Limits

TARGET = "[[500,0,500],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
USUAL = RunRequest()
#: Programs, each line with its mark: "+" for a statement that runs, "-" for one that does not,
#: blank for a line without a statement.
PROGRAMS = {
    "a subroutine that is not called": (
        "gcode",
        """
          (a comment)
          %
        + G21 G90 F100
        + G0 X0 Y0 Z5
        + o100 sub
        - G1 X5
        - o100 endsub
        + G1 X1
        + M2
        - G1 X2
        """,
    ),
    "a loop that is run twice": (
        "gcode",
        """
        + G21 G90 F100
        + G0 X0 Y0 Z5
        + #1=0
        + o1 while [#1 LT 2]
        + G1 X[#1]
        + #1=[#1+1]
        + o1 endwhile
        + M2
        """,
    ),
    "both branches of an input": (
        "rapid",
        f"""
          MODULE M
          PROC main()
        + IF diReady=1 THEN
        + MoveL {TARGET},v100,fine,tool0;
          ELSE
        + MoveJ {TARGET},v100,fine,tool0;
          ENDIF
        + IF 1=2 THEN
        - Stop;
          ENDIF
          ENDPROC
          PROC other()
        - Stop;
          ENDPROC
          ENDMODULE
        """,
    ),
    "motions in a program that is not called": (
        "vplus",
        """
          .PROGRAM main()
        + MOVES TRANS(500,0,100,0,180,0)
        + BREAK
          .END
          .PROGRAM other()
        - MOVES base:TRANS(500,0,100,0,180,0)
        - MOVES base:TRANS(500,10,100,0,180,0)
        - MOVES base:TRANS(500,20,100,0,180,0)
          .END
        """,
    ),
    "a procedure that is not called": (
        "pacscript",
        """
          Sub Main
        + TakeArm
        + Move L, P(500, 0, 100, 180, 0, 180, 5)
        + Move L, P(500, 10, 100, 180, 0, 180, 5)
        + GiveArm
          End Sub
          Sub Other
        - Move L, P(500, 0, 100, 180, 0, 180, 5)
          End Sub
        """,
    ),
}


def measure(language: str, text: str, request: RunRequest = USUAL) -> Coverage:
    coverage = run_alternatives(
        find_language(language), {"program": text}, request
    ).executed.coverage
    assert coverage is not None
    return coverage


@pytest.mark.parametrize("name", PROGRAMS)
def test_coverage_has_all_statements_and_those_that_ran(name: str) -> None:
    language, marked = PROGRAMS[name]
    rows = dedent(marked).strip("\n").split("\n")
    coverage = measure(language, "\n".join(row[2:] for row in rows) + "\n")
    numbered = list(enumerate((row[0] for row in rows), 1))
    assert coverage.lines.tolist() == [line for line, mark in numbered if mark in "+-"]
    assert coverage.lines[coverage.ran].tolist() == [line for line, mark in numbered if mark == "+"]


def test_lines_after_the_end_of_a_program_are_a_gap() -> None:
    lines = [
        "G21 G90 F100",
        "G0 X0 Y0 Z5",
        *(f"G1 X{x}" for x in range(50)),
        "M2",
        "G1 X1",
        "G1 X2",
    ]
    coverage = measure("gcode", "\n".join(lines))
    assert coverage.list_gaps() == [(54, 55)]
    assert coverage.as_data() == {"statements": 55, "run": 53}


def test_lines_of_an_endless_loop_have_run() -> None:
    loop = "o1 while [1 EQ 1]\nG1 X[#1]\nF200\n#1=[#1+1]\no1 endwhile\n"
    text = f"G21 G90 F100\nG0 X0 Y0 Z5\n#1=0\n{loop}"
    # The run ends between the two lines of a step that has run before.
    request = RunRequest(limits=Limits(gcode_steps=1001))
    assert measure("gcode", text, request).list_gaps() == []


def test_the_coverage_of_several_runs_is_their_union() -> None:
    lines = np.array([3, 4, 7])
    first = Coverage(lines, np.array([True, False, False]))
    second = Coverage(lines, np.array([False, False, True]))
    joined = join_coverage([first, second])
    assert joined is not None
    assert joined.ran.tolist() == [True, False, True]
    assert join_coverage([first, None]) is None


def test_the_summary_names_the_lines_that_did_not_run() -> None:
    places = Places({"a.mod": "\n" * 10, "b.mod": "\n" * 10})
    lines = np.arange(1, 21)
    ran = ~np.isin(lines, [4, 5, 6, 12])
    text = "16 of 20 statements run (80 %), not run: a.mod line 4 to 6, b.mod line 2"
    assert format_coverage(Coverage(lines, ran), places.find) == [("coverage", text)]
    every_second = Coverage(lines, lines % 2 == 0)
    assert format_coverage(every_second, places.find)[0][1].endswith(
        "a.mod line 9 and 5 more places"
    )
    full = Coverage(lines, lines > 0)
    assert format_coverage(full, places.find) == [("coverage", "all 20 statements run")]
    assert format_coverage(Coverage(lines[:0], ran[:0]), places.find) == []
    assert format_coverage(None, places.find) == []
