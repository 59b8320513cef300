"""Runs V+ programs: conditions, loops, jumps, calls with arguments, and lines that are refused."""

import pytest

from camgen.lang.programs import RunRequest, find_language
from camgen.lang.vplus.language import VPLUS, run
from camgen.model.limits import Limits
from camgen.model.program import Joints, MoveJ, MoveL, Output, Stop, Wait


def execute(*lines, **options):
    """Run a program a() with these lines, of which the first is line 2."""
    return run({"a.v2": "\n".join([".PROGRAM a()", *lines, ".END", ""])}, RunRequest(**options))


def list_findings(executed, level):
    return [(finding.line, finding.what) for finding in executed.findings if finding.level == level]


def x_of_motions(executed):
    """The x of the targets of a program without refusals, mm."""
    assert not list_findings(executed, "refused")
    return [item.target.origin[0] for item in executed.body if isinstance(item, MoveJ | MoveL)]


def test_the_language_is_found_by_its_name():
    assert find_language("vplus").about == VPLUS.about
    assert ".v2" in VPLUS.suffixes


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        (
            ["IF 1 < 2 THEN", "MOVE TRANS(1)", "ELSE", "MOVE TRANS(2)", "END", "MOVE TRANS(3)"],
            [1, 3],
        ),
        (
            ["IF 1 > 2 THEN", "MOVE TRANS(1)", "ELSE", "MOVE TRANS(2)", "END", "MOVE TRANS(3)"],
            [2, 3],
        ),
        (["IF 1 > 2 THEN", "MOVE TRANS(1)", "END", "MOVE TRANS(3)"], [3]),
        (["IF 1 < 2 GOTO 10", "MOVE TRANS(1)", "10 MOVE TRANS(2)"], [2]),
        (["IF 1 > 2 GOTO 10", "MOVE TRANS(1)", "10", "MOVE TRANS(2)"], [1, 2]),
        (["GOTO 5", "MOVE TRANS(1)", "5 MOVE TRANS(2)"], [2]),
        (["FOR i = 1 TO 3", "MOVE TRANS(i)", "END", "MOVE TRANS(i)"], [1, 2, 3, 4]),
        (["FOR i = 3 TO 1 STEP -1", "MOVE TRANS(i)", "END"], [3, 2, 1]),
        (["FOR i = 1 TO 0", "MOVE TRANS(i)", "END", "MOVE TRANS(9)"], [9]),
        (["FOR p[1] = 1 TO 2", "MOVE TRANS(p[1])", "END"], [1, 2]),
        (
            [
                "FOR i = 1 TO 5",
                "IF i == 2 THEN",
                "NEXT",
                "END",
                "IF i == 4 THEN",
                "EXIT",
                "END",
                "MOVE TRANS(i)",
                "END",
            ],
            [1, 3],
        ),
        (
            [
                "FOR i = 1 TO 3",
                "FOR j = 1 TO 3",
                "IF j == 2 THEN",
                "EXIT 2",
                "END",
                "MOVE TRANS(10*i+j)",
                "END",
                "END",
            ],
            [11],
        ),
        (["i = 0", "WHILE i < 3 DO", "i = i+1", "MOVE TRANS(i)", "END"], [1, 2, 3]),
        (["i = 0", "DO", "i = i+1", "MOVE TRANS(i)", "UNTIL i >= 2"], [1, 2]),
        (
            [
                "CASE 2 OF",
                "VALUE 1, 3:",
                "MOVE TRANS(1)",
                "VALUE 2:",
                "MOVE TRANS(2)",
                "ANY",
                "HALT",
                "END",
            ],
            [2],
        ),
        (["CASE 5 OF", "VALUE 1, 3:", "MOVE TRANS(1)", "ANY", "MOVE TRANS(3)", "END"], [3]),
        (["CASE 5 OF", "VALUE 1:", "MOVE TRANS(1)", "END", "MOVE TRANS(9)"], [9]),
        (
            [
                '$s = "b"',
                "CASE $s OF",
                'VALUE "a":',
                "MOVE TRANS(1)",
                'VALUE "b":',
                "MOVE TRANS(2)",
                "END",
            ],
            [2],
        ),
        (["i = 0", "10 i = i+1", "MOVE TRANS(i)", "IF i < 3 GOTO 10"], [1, 2, 3]),
        (["MOVE TRANS(1)", "RETURN", "MOVE TRANS(2)"], [1]),
        (["MOVE TRANS(1)", "STOP", "MOVE TRANS(2)"], [1]),
        (["MOVE TRANS(1)", "HALT", "MOVE TRANS(2)"], [1]),
    ],
)
def test_control_flow_runs_the_motions_in_order(lines, expected):
    assert x_of_motions(execute(*lines)) == expected


CALLS = """\
.PROGRAM main()
AUTO n, p, q[3], $t
n = 1
CALL sub(n, (n), 10, p, q[])
MOVE TRANS(n)
MOVE p
MOVE TRANS(q[1], 0, 0)
CALL text($t)
IF $t == "done" THEN
MOVE TRANS(77)
END
CALL twice(q[2])
MOVE TRANS(q[3])
.END
.PROGRAM sub(a, b, c, loc, list[])
AUTO n
n = 100
a = a+c
b = 50
SET loc = TRANS(a+b)
list[1] = 5
.END
.PROGRAM text($out)
$out = "done"
.END
.PROGRAM twice(from[])
from[1] = 8
.END
"""


def test_an_argument_refers_to_its_variable_unless_it_is_in_brackets():
    """In sub, a refers to n (1 + 10), b is a value, loc refers to p (11 + 50), list[1] to q[1].

    In twice, from[1] refers to q[3], as its list starts at q[2].
    """
    assert x_of_motions(run({"a": CALLS}, RunRequest())) == [11, 61, 5, 77, 8]


def test_a_local_variable_keeps_its_value_between_calls_and_an_auto_variable_does_not():
    main = ".PROGRAM main()\nCALL one()\nCALL one()\n.END\n"
    text = main + (
        ".PROGRAM one()\n{} n\nIF DEFINED(n) THEN\nn = n+1\nELSE\nn = 1\nEND\nMOVE TRANS(n)\n.END\n"
    )
    assert x_of_motions(run({"a": text.format("LOCAL")}, RunRequest())) == [1, 2]
    assert x_of_motions(run({"a": text.format("AUTO")}, RunRequest())) == [1, 1]


def test_a_recursive_program_has_undefined_parameters_if_arguments_are_omitted():
    down = [
        "MOVE TRANS(n)",
        "IF DEFINED(m) THEN",
        "MOVE TRANS(99)",
        "END",
        "IF n > 1 THEN",
        "CALL down(n-1)",
        "END",
    ]
    text = "\n".join(
        [".PROGRAM main()", "CALL down(3)", ".END", ".PROGRAM down(n, m)", *down, ".END"]
    )
    assert x_of_motions(run({"a": text}, RunRequest())) == [3, 2, 1]


def test_calls_runs_the_program_that_a_string_names():
    text = (
        '.PROGRAM main()\n$p = "su"\nCALLS $p+"b"(4)\n.END\n.PROGRAM sub(x)\nMOVE TRANS(x)\n.END\n'
    )
    assert x_of_motions(run({"a": text}, RunRequest())) == [4]


def test_a_missing_program_is_left_out_with_an_assumption():
    executed = execute("CALL other(1)", "MOVE TRANS(1)")
    assert x_of_motions(executed) == [1]
    assert [assumption.what for assumption in executed.assumed] == [
        "program other is not in these files: left out"
    ]


def test_the_program_that_runs_is_the_entry_or_main_or_the_first_uncalled_one():
    text = ".PROGRAM sub()\nMOVE TRANS(2)\n.END\n.PROGRAM first()\nCALL sub()\n.END\n"
    text += ".PROGRAM other()\nMOVE TRANS(3)\n.END\n"
    executed = run({"a": text}, RunRequest())
    assert x_of_motions(executed) == [2]
    assert ("programs not run", "other") in executed.facts
    assert x_of_motions(run({"a": text}, RunRequest(entry="OTHER"))) == [3]
    assert run({"a": text}, RunRequest(entry="absent")).stopped == (1, "there is no program absent")
    assert x_of_motions(
        run({"a": text + ".PROGRAM main()\nMOVE TRANS(4)\n.END\n"}, RunRequest())
    ) == [4]


def test_lines_are_counted_through_several_files():
    executed = run(
        {"a": ".PROGRAM main()\nCALL b()\n.END\n", "b": ".PROGRAM b()\nMOVE TRANS(1)\n.END\n"},
        RunRequest(),
    )
    assert (x_of_motions(executed), executed.lines) == ([1], (5,))


def test_a_second_task_is_named():
    text = (
        ".PROGRAM main()\nEXECUTE 2 watch(), 0\nMOVE TRANS(1)\n.END\n.PROGRAM watch()\nSIGNAL 5\n"
        ".END\n"
    )
    executed = run({"a": text}, RunRequest())
    assert [type(item) for item in executed.body] == [MoveJ]
    assert ("tasks beside it, not run", "watch (task 2): sets 5 to 1") in executed.facts


def test_a_concurrent_task_is_checked_on_its_own():
    text = (
        ".PROGRAM main()\nx = 5\nEXECUTE 2 watch(), 0\nMOVE TRANS(1)\n.END\n.PROGRAM watch()\n"
        "{}\n.END\n"
    )
    task = (
        "MOVE TRANS(9)\nSIGNAL 5\nWAIT SIG(1001)\nWAIT.EVENT , 2\nPAUSE\nSPEED -1\n"
        "WHILE TRUE DO\nSIGNAL -6\nEND"
    )
    executed = run({"a": text.format(task)}, RunRequest())
    assert x_of_motions(executed) == [1]
    assert dict(executed.facts)["tasks beside it, not run"] == (
        "watch (task 2): sets 5 to 1, sets 6 to 0, stops, waits, 1 motion"
    )
    assert executed.lost[0][0] == 3
    assert executed.lost[0][1].startswith("another task, watch (task 2), is not shown: sets 5 to 1")
    assert [(finding.level, finding.line) for finding in executed.findings] == [
        ("dangerous", 8),
        ("unusual", 12),
    ]
    assert executed.findings[1].what.startswith("in watch: ")
    assert not [entry for entry in executed.assumed if "round" in entry.what]


@pytest.mark.parametrize(
    ("line", "name"),
    [("REACT 1001, halt.it(2), 5", "halt.it"), ("REACTI -1002, halt.it(2)", "halt.it")],
)
def test_a_reaction_runs_if_the_user_assumes_it(line, name):
    text = f".PROGRAM main()\nMOVE TRANS(1)\n{line}\nMOVE TRANS(2)\n{line}\n.END\n"
    text += ".PROGRAM halt.it(x)\nMOVE TRANS(x*10)\n.END\n"
    executed = run({"a": text}, RunRequest())
    assert x_of_motions(executed) == [1, 2]
    assert [(entry.line, entry.key, entry.value) for entry in executed.assumed] == [(3, name, 0.0)]
    assert dict(executed.facts)["reactions that do not come"].startswith("halt.it (REACT")
    assert x_of_motions(run({"a": text}, RunRequest(assume={name: 1.0}))) == [1, 20, 2]


def test_a_reaction_without_a_program_and_one_with_a_missing_program_are_facts():
    executed = run({"a": ".PROGRAM main()\nREACT 1001\nREACTE other\n.END\n"}, RunRequest())
    assert dict(executed.facts)["reactions"] == "REACT 1001"
    assert (
        dict(executed.facts)["reactions that do not come"]
        == "other (REACTE, line 3): in none of the files"
    )


@pytest.mark.parametrize(
    "lines",
    [
        ["WHILE TRUE DO", "MOVE TRANS(1)", "END"],
        ["DO", "MOVE TRANS(1)", "UNTIL FALSE"],
        ["run = TRUE", "WHILE run DO", "MOVE TRANS(1)", "END"],
        ["10 MOVE TRANS(1)", "GOTO 10"],
        ["WHILE NOT SIG(1001) DO", "MOVE TRANS(1)", "END"],
        ["WHILE x DO", "MOVE TRANS(1)", "END"],
    ],
)
def test_an_endless_loop_is_run_once_with_an_assumption(lines):
    executed = execute(*lines, "MOVE TRANS(2)")
    assert x_of_motions(executed) == [1, 2]
    assert executed.stopped is None
    assert executed.assumed


def test_an_endless_loop_is_run_as_often_as_the_user_assumes():
    loop = ["WHILE TRUE DO", "MOVE TRANS(1)", "END"]
    assert x_of_motions(execute(*loop, assume={"rounds": 3})) == [1, 1, 1]


def test_a_run_stops_at_the_limit_of_steps_and_of_nested_calls():
    executed = execute(
        "i = 0",
        "WHILE i < 1E6 DO",
        "i = i+1",
        "MOVE TRANS(i)",
        "END",
        limits=Limits(vplus_steps=300),
    )
    assert executed.stopped is not None
    assert executed.stopped[1] == (
        "the program has not ended after 300 steps in loops and calls (limits.vplus_steps)"
    )
    # The loop has four instructions.
    assert 70 < len(executed.body) < 80
    recursive = run({"a": ".PROGRAM a()\nCALL a()\n.END\n"}, RunRequest())
    assert recursive.stopped == (2, "more than 60 programs call each other")


@pytest.mark.parametrize(
    ("line", "what"),
    [
        ("LMOVE p", "LMOVE is not an instruction of V+"),
        ("JMOVE #[1,2]", "a number expected instead of '#'"),
        ("IF x", "IF wants THEN or GOTO"),
        ("GOTO 99", "there is no label 99 in this program"),
        ("EXIT", "EXIT outside of a loop"),
        ("END", "END closes nothing"),
        ("ELSE", "ELSE outside of an IF"),
        ("IF x THEN\nELSE IF y THEN\nEND", "ELSE stands alone, without IF y THEN"),
        ("FOR i = 1 TO 2", "FOR is not closed"),
        ("MOVE TRANS(1", ") expected before the end of the line"),
        ("MOVE TRANS(1) 5", "'5' is not expected here"),
        ("x = 1+", "something is missing at the end of the line"),
        ("x = 1/0", "a division by zero"),
        ("x = SQRT(-1)", "the root of a negative number"),
        ("SET a = #PPOINT(1,2,3,4)", "a location expected instead of '#PPOINT'"),
        ("SET #a = TRANS(1)", "a precision point expected instead of 'TRANS'"),
        ("$s = 5", "a string expected instead of '5'"),
        ('x = "a"', "something is missing at the end of the line"),
        ("SIGNAL 1.5", "1.5 is not an output"),
        ("SPEED -5", "a speed must be positive"),
        ("APPRO TRANS(1)", ", expected before the end of the line"),
        ("x = frob(3)", "FROB is not a function"),
        ("10 x = 1\n10 x = 2", "label 10 is there twice"),
        ("70000 x = 1", "label 70000 is above 65535"),
        ("x = 1\nAUTO y", "AUTO after the first instruction"),
    ],
)
def test_a_line_that_the_controller_refuses_is_refused(line, what):
    """A line that is jumped over is refused too, unless its fault is a value."""
    for before in ([], ["GOTO 7"]):
        executed = execute(*before, *line.split("\n"), "7")
        if before and any(fault in what for fault in ("division", "root", "an output", "positive")):
            continue
        assert what in [text for _, text in list_findings(executed, "refused")], (line, before)


@pytest.mark.parametrize(
    "line",
    [
        'TYPE "x", /S',
        "WAIT",
        "WAIT.EVENT , 1",
        "BREAK",
        "ENABLE CP, POWER",
        "PARAMETER HAND.TIME = 0.3",
        "REACTI 1001, stop.it, 5",
        "IGNORE 1001",
        'ATTACH (lun, 4) "TCP"',
        "DETACH (lun)",
        "FCLOSE (lun)",
        'FOPENR (lun) "a.dat"',
        "CALIBRATE",
        "MC SPEED 50",
        "PRIORITY 5",
        "LOCK 10",
        "ABORT 2",
        "SET.EVENT 1, 2",
        "COARSE 200 ALWAYS",
        "FINE 50",
        "NULL",
        "NONULL ALWAYS",
        "ACCEL (1) 50, 60",
        "DURATION 0.5 ALWAYS",
        "RIGHTY",
        "FLIP ALWAYS",
        "TIMER 1 = 0",
        "SELECT ROBOT = 1",
        "RESET",
        "CPOFF",
        "SWITCH POWER = TRUE",
        "WRITE (lun) $a, /N",
        "x = GETC(lun, 1)",
        "x = TASK(1, 3)",
        "x = SWITCH(DRY.RUN)",
        "x = BITS(1, 4)",
        "x = STATE(2)",
        "x = RANDOM",
        "x = TIME",
        "x = INRANGE(p)",
        "MOVE p:TRANS(1)",
        "HERE p",
        "x = DX(HERE)",
        "SET p = p:q:INVERSE(r)",
        "SET #q = #p",
        "MOVE #p[1,2]",
        "x = ^HFF BAND ^B101",
        "$s = $TIME()",
        "READY",
    ],
)
def test_a_line_that_the_controller_accepts_is_not_refused(line):
    assert not list_findings(execute(line), "refused")
    assert not list_findings(execute("GOTO 7", line, "7"), "refused")


def test_each_line_is_checked_once_whether_it_is_run_or_not():
    executed = execute("FOR i = 1 TO 5", "FROB", "END", "IF FALSE THEN", "FROB 2", "END")
    assert list_findings(executed, "refused") == [
        (3, "FROB is not an instruction of V+"),
        (6, "FROB is not an instruction of V+"),
    ]


def test_stops_waits_and_the_hand_are_instructions():
    executed = execute(
        "PARAMETER HAND.TIME = 0.5",
        "MOVE TRANS(1)",
        "PAUSE",
        "DELAY 2",
        "CLOSEI",
        "OPEN",
        "MOVE TRANS(2)",
    )
    kinds = [MoveJ, Stop, Wait, Output, Wait, Output, MoveJ]
    assert [type(item) for item in executed.body] == kinds
    assert [item.seconds for item in executed.body if isinstance(item, Wait)] == [2, 0.5]
    assert [(item.signal, item.value) for item in executed.body if isinstance(item, Output)] == [
        ("hand.open", 0),
        ("hand.open", 1),
    ]


def test_a_program_without_brackets_or_end_and_with_control_characters_is_read():
    executed = run(
        {
            "a": (
                ".PROGRAM a ; comment\nMOVE TRANS(1)\n.END\n\f\n.PROGRAM b\nMOVE TRANS(2)\n.END\n"
                "\x1a"
            )
        },
        RunRequest(),
    )
    assert x_of_motions(executed) == [1]
    unclosed = run({"a": ".PROGRAM a()\nMOVE TRANS(1)\n"}, RunRequest())
    assert x_of_motions(unclosed) == [1]
    assert list_findings(unclosed, "unusual") == [(2, "a has no .END")]


def test_a_text_without_a_program_line_is_refused_and_run():
    executed = run({"pick.v2": "MOVE TRANS(1)\nBREAK\n"}, RunRequest())
    assert list_findings(executed, "refused") == [
        (1, "the text has no .PROGRAM line: taken for a program pick")
    ]
    assert len(executed.body) == 1


def test_a_precision_point_is_joint_values_in_rad():
    executed = execute("SET #p = #PPOINT(10,20,30,40)", "MOVE #p")
    assert executed.body[0].target == Joints(
        pytest.approx((0.17453293, 0.34906585, 30.0, 0.6981317))
    )


def test_a_word_after_end_is_unusual():
    assert list_findings(execute("IF TRUE THEN", "END l5"), "unusual") == [
        (3, "END stands alone, without l5")
    ]


def test_next_in_a_loop_that_is_not_closed_goes_on():
    executed = execute("WHILE TRUE DO", "NEXT", "MOVE TRANS(1)")
    assert list_findings(executed, "refused") == [(2, "WHILE is not closed")]
    assert executed.stopped is None
    assert executed.lines == (4,)


# -- loops at a fixed point --------------------------------------------------------------------


def test_a_loop_that_ends_at_its_start_position_is_run_once():
    executed = execute(
        "MOVE TRANS(2)", "n = 0", "WHILE n < 1 DO", "MOVE TRANS(1)", "MOVE TRANS(2)", "END"
    )
    assert x_of_motions(executed) == [2, 1, 2]
    assert [item.line for item in executed.assumed if "shown for one round" in item.what] == [4]


def test_exit_leaves_as_many_loops_as_the_value_of_its_expression():
    lines = ["n = 2", "FOR i = 1 TO 3", "FOR j = 1 TO 3", "MOVE TRANS(10*i+j)", "EXIT n", "END"]
    assert x_of_motions(execute(*lines, "END")) == [11]
