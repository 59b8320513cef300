"""Runs of the branches that a text leaves open, and the findings of all runs."""

import pytest

from camgen.lang import alternatives
from camgen.lang.alternatives import Alternatives, format_alternatives, run_alternatives
from camgen.lang.programs import Executed, Finding, Language, OpenChoice, RunRequest, find_language

ORIENTED = "[[500,0,500],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
#: The squares of the orientation add up to 0.81.
SHORT = ORIENTED.replace("[0,0,1,0]", "[0,0,0.9,0]")
GOOD, BAD = f"MoveL {ORIENTED},v100,fine,tool0;", f"MoveL {SHORT},v100,fine,tool0;"


def run_rapid(*lines: str) -> Alternatives:
    """Run a main with these lines, of which the first is line 3."""
    text = "\n".join(["MODULE M", "PROC main()", *lines, "ENDPROC", "ENDMODULE", ""])
    return run_alternatives(find_language("rapid"), {"m.mod": text}, RunRequest())


def list_levels(result: Alternatives) -> list[tuple[str, int]]:
    return [(finding.level, finding.line) for finding in result.executed.findings]


def test_a_program_without_an_open_choice_is_run_once() -> None:
    result = run_rapid(GOOD, BAD)
    assert list_levels(result) == [("refused", 4)]
    assert (result.runs, format_alternatives(result)) == (1, [])


def test_a_refusal_in_the_other_branch_is_possible_and_names_its_condition() -> None:
    result = run_rapid(GOOD, "IF diReady=1 THEN", GOOD, "ELSE", BAD, "ENDIF")
    assert list_levels(result) == [("possible", 7)]
    assert result.executed.findings[0].what.endswith("; it depends on diReady in line 4")
    # The motions are those of the default run: two straight motions.
    assert (result.runs, len(result.executed.body)) == (2, 2)
    assert format_alternatives(result) == [("branches", "1 choice left open, 2 runs")]


def test_a_refusal_in_the_default_branch_is_possible_and_one_after_it_is_refused() -> None:
    result = run_rapid("IF diReady=1 THEN", BAD, "ELSE", GOOD, "ENDIF", BAD)
    assert list_levels(result) == [("possible", 4), ("refused", 8)]


def test_each_case_is_run() -> None:
    cases = ["CASE 1:", GOOD, "CASE 2:", BAD, "CASE 3:", BAD]
    result = run_rapid("TEST GInput(giPart)", *cases, "ENDTEST")
    assert list_levels(result) == [("possible", 7), ("possible", 9)]
    assert result.runs == 3


def test_a_choice_in_another_branch_is_open_as_well() -> None:
    inner = ["IF diSecond=1 THEN", GOOD, "ELSE", BAD, "ENDIF"]
    result = run_rapid("IF diFirst=1 THEN", GOOD, "ELSE", *inner, "ENDIF")
    assert list_levels(result) == [("possible", 9)]
    what = result.executed.findings[0].what
    assert what.endswith("; it depends on diFirst in line 3 and diSecond in line 6")
    assert result.runs == 3


def test_pacscript_and_v_plus_take_the_other_branch_too() -> None:
    lines = ["Sub Main", "TakeArm Keep = 0", "If I[3] = 0 Then", "Set IO[4]", "Else", "Motor Off"]
    lines += ["End If", "Move P, @0 P(400, 0, 300, 180, 0, 180, -1)", "End Sub", ""]
    result = run_alternatives(
        find_language("pacscript"), {"part.pcs": "\n".join(lines)}, RunRequest()
    )
    # The motion is refused while the motor is off.
    assert list_levels(result) == [("possible", 8)]
    assert result.runs == 2
    v_plus = ".PROGRAM p()\nIF SIG(1001) THEN\nSIGNAL 1\nELSE\nGOTO 7\nEND\n.END\n"
    result = run_alternatives(find_language("vplus"), {"p.v2": v_plus}, RunRequest())
    assert result.runs == 2


class RecordedLanguage(Language, frozen=True):
    """A language whose runs are given, one for each option of the choice in line 2."""


def run_recorded(*runs: Executed) -> Alternatives:
    def run(_files: object, options: RunRequest) -> Executed:
        return runs[options.shifts.get(2, 0)]

    language = RecordedLanguage("played", "runs that are given", (), lambda _: True, run)
    return run_alternatives(language, {"a": "1\n2\n3\n"}, RunRequest())


def test_a_run_to_the_end_is_preferred() -> None:
    choice = (OpenChoice(2, "di1"),)
    broken = Executed((), (), stopped=(3, "calls itself too often"), choices=choice)
    whole = Executed((), (), findings=(Finding("unusual", 1, "odd"),), choices=choice)
    result = run_recorded(broken, whole).executed
    assert result.stopped is None
    assert result.findings == (
        Finding("unusual", 1, "odd"),
        Finding(
            "possible", 3, "the run stops here: calls itself too often; it depends on di1 in line 2"
        ),
    )


def test_a_stop_in_each_branch_stays_a_stop() -> None:
    choice = (OpenChoice(2, "di1"),)
    broken = Executed((), (), stopped=(3, "no end"), choices=choice)
    assert run_recorded(broken, broken).executed.stopped == (3, "no end")


def test_long_loops_are_run_on_few_branches() -> None:
    """The default run takes 60,000 steps: after one more run the limit is passed."""
    choices = []
    for number in range(6):
        choices += [f"IF di{number}=1 THEN", GOOD, "ENDIF"]
    result = run_rapid("VAR num n;", *choices, "FOR i FROM 1 TO 29990 DO", "n:=n+i;", "ENDFOR")
    assert result.executed.steps > 50_000
    assert (result.runs, result.missing) == (2, 5)


def test_branches_that_are_not_run_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(alternatives, "_RUN_LIMIT", 2)
    choice = (OpenChoice(2, "gi1", 5),)
    result = run_recorded(*[Executed((), (), choices=choice)] * 5)
    assert (result.runs, result.missing) == (3, 2)
    assert format_alternatives(result) == [
        ("branches", "1 choice left open, 3 runs, 2 branches not run")
    ]
