"""Statements that the grammar of PacScript refuses, with line and reason.

productions.txt has the statements that it accepts.
"""

import pytest

from camgen.lang.pacscript.language import LANGUAGE
from camgen.lang.programs import Executed, RunRequest


def run(*lines: str, head: str = "", **assume: float) -> Executed:
    """Run a Main with these lines, of which the first is line 3 after the lines of `head`."""
    body = "\n".join(lines)
    text = f"{head}Sub Main\nTakeArm Keep = 0\n{body}\nEnd Sub\n"
    return LANGUAGE.run({"part.pcs": text}, RunRequest(assume=assume))


def list_refusals(executed: Executed) -> list[tuple[int, str]]:
    return [
        (finding.line, finding.what) for finding in executed.findings if finding.level == "refused"
    ]


REFUSED_STATEMENTS = [
    ("x = (1 + 2", 3, ") is missing"),
    ("x = 1 + ", 3, "a value is missing"),
    ("x = 1 2", 3, "2 is not understood in 1 2"),
    ("x = * 2", 3, "* is not understood"),
    ("Move Q, P(1)", 3, "Q is not an interpolation of this motion"),
    ("Move L, @Q P(1)", 3, "the pass mark of @Q P(1) is not understood"),
    ("Move P, @0, P10", 3, "a pass mark without a target"),
    ("Move P", 3, "a motion without a target"),
    ("Move L, P(1, 2, 3,), ", 3, "a value is missing"),
    ("Move L, P(1", 3, ") is missing"),
    ("If 1 = 1", 3, "If without Then"),
    ("If 1 = 1 Then", 3, "If has no End If"),
    ("End If", 3, "End If without If"),
    ("Else", 3, "Else without If"),
    ("For i = 1 To 3", 3, "For has no Next"),
    ("For i = 1", 3, "For needs a name, = and To"),
    ("Next", 3, "Next without For"),
    ("Do", 3, "Do has no Loop"),
    ("Loop", 3, "Loop without Do"),
    ("While 1", 3, "While has no Wend"),
    ("For i = 1 To 3\nLoop\nNext", 4, "Loop without Do inside For"),
    ("Select Case x", 3, "Select Case has no End Select"),
    ("Case 1", 3, "Case without Select Case"),
    ("Exit For", 3, "Exit For outside such a block"),
    ("GoTo nowhere", 3, "there is no label nowhere"),
    ("*a\n*a", 4, "a second label a"),
    ("For i = 1 To 3 Step\nNext", 3, "a value is missing"),
    ("Motor", 3, "Motor needs On or Off"),
    ("Dim 3x As Integer", 3, "3x As Integer cannot be declared"),
    ("Dim Move As Integer", 3, "Move As Integer cannot be declared"),
    ("Speed = 3", 3, "= is not understood"),
    ("Wait", 3, "Wait needs a condition"),
    ("Speed 500", 3, "a speed of 500 %: the controller takes 0.1 to 100"),
    ("ExtSpeed 0", 3, "an external speed of 0 %: the controller takes up to 100"),
    ("ChangeTool 99", 3, "tool 99: there are 0 to 63"),
    ("Delay -5", 3, "a delay of -5 ms"),
    ("x = 1 / 0", 3, "a division by zero"),
    ("Dim a(3) As Integer\na(4) = 1", 4, "there is no element (4): the array ends at (3)"),
    ("Set IO[30000]", 3, "IO[30000]: the highest is IO[24063]"),
    ("Motor Off\nMove P, P(1, 2, 3)", 4, "a motion with the motor off"),
    (
        "GiveArm\nMove P, P(1, 2, 3)",
        4,
        "a motion without TakeArm: the controller stops with an error",
    ),
    ("#Nonsense", 3, "#nonsense is not a directive"),
    ("#Error stop here", 3, "#Error stop here"),
    ("#Define A A B\nx = A", 4, "a macro that refers to itself or grows without end"),
    ("x = " + "1 + " * 300 + "1", 3, "a line of more than 1024 bytes"),
]


@pytest.mark.parametrize(("text", "line", "what"), REFUSED_STATEMENTS)
def test_a_statement_that_is_not_in_the_grammar_is_refused(text: str, line: int, what: str) -> None:
    assert (line, what) in list_refusals(run(*text.split("\n")))


OUTSIDE_OF_PROCEDURES = [
    ("x = 1\nSub Main\nEnd Sub\n", 1, "a statement outside a procedure"),
    ("Sub Main\n", 1, "the procedure has no end"),
    ("End Sub\nSub Main\nEnd Sub\n", 1, "End Sub closes nothing"),
    ("Sub Main\nEnd Function\n", 2, "End Function closes a Sub, which ends with End Sub"),
    (
        "Sub Main\nEnd Sub\nFunction F\nEnd Sub\n",
        4,
        "End Sub closes a Function, which ends with End Function",
    ),
    ("Sub Main\nSub Other\nEnd Sub\n", 2, "Sub Other begins inside another procedure"),
    ("Sub Main\nEnd Sub\nSub Other\nEnd Sub\nSub Other\nEnd Sub\n", 5, "a second procedure Other"),
    ("Sub Main\nEnd Sub\nSub Move\nEnd Sub\n", 3, "Move is a word of the language"),
    ("Sub Main\nEnd Sub\nSub Other(1)\nEnd Sub\n", 3, "parameters that cannot be read"),
    ("#If 1\nSub Main\nEnd Sub\n", 1, "#If has no #EndIf"),
    ("#EndIf\nSub Main\nEnd Sub\n", 1, "#EndIf without #If"),
    ("Sub Main\nx = 1 _", 2, "the statement goes on after the last line"),
]


@pytest.mark.parametrize(("text", "line", "what"), OUTSIDE_OF_PROCEDURES)
def test_a_fault_outside_of_a_procedure_is_refused(text: str, line: int, what: str) -> None:
    assert (line, what) in list_refusals(LANGUAGE.run({"part.pcs": text}, RunRequest()))


def test_a_procedure_that_is_not_called_is_checked_too() -> None:
    files = {"part.pcs": "Sub Main\nEnd Sub\nSub Other\nx = (\nEnd Sub\n"}
    assert list_refusals(LANGUAGE.run(files, RunRequest())) == [(4, "a value is missing")]


@pytest.mark.parametrize(
    ("text", "is_pacscript"),
    [
        ('\'!TITLE "part"\nSub Main\nEnd Sub\n', True),
        ("Sub Main\n  TakeArm Keep = 0\n  Move P, @0 P1\nEnd Sub\n", True),
        ("PROGRAM PRO1\nTAKEARM\nMOVE P, P1\nEND\n", True),
        ("MODULE a\nPROC main()\nENDPROC\nENDMODULE\n", False),
        (".PROGRAM a()\nMOVE b\n.END\n", False),
        ("G21\nG0 X1\n", False),
        ("", False),
    ],
)
def test_a_text_is_recognised_as_pacscript(text: str, is_pacscript: bool) -> None:
    assert LANGUAGE.recognise(text) is is_pacscript
