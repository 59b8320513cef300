"""What a V+ program does: tests, loops, jumps, calls and their arguments, and what its lines may not be."""

import pytest

from camgen.lang.programs import RunRequest, find_language
from camgen.lang.vplus.language import VPLUS, run
from camgen.model.limits import Limits
from camgen.model.program import Joints, MoveJ, MoveL, Output, Stop, Wait


def execute(*lines, request=None, **more):
    return run(
        {"a.v2": "\n".join([".PROGRAM a()", *lines, ".END", ""])}, request or RunRequest(**more)
    )


def told(found, level):
    return [(finding.line, finding.what) for finding in found.findings if finding.level == level]


def places(found):
    """x of the motions."""
    assert not told(found, "refused")
    return [item.target.origin[0] for item in found.body if isinstance(item, MoveJ | MoveL)]


def value(expression, *before):
    """What a real expression is, by the place of a motion."""
    return places(execute(*before, f"x = {expression}", "MOVE TRANS(x)"))[0]


def test_the_language_is_found():
    assert find_language("vplus").about == VPLUS.about
    assert ".v2" in VPLUS.suffixes


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        (["IF 1 < 2 THEN", "MOVE TRANS(1)", "ELSE", "MOVE TRANS(2)", "END", "MOVE TRANS(3)"], [1, 3]),
        (["IF 1 > 2 THEN", "MOVE TRANS(1)", "ELSE", "MOVE TRANS(2)", "END", "MOVE TRANS(3)"], [2, 3]),
        (["IF 1 > 2 THEN", "MOVE TRANS(1)", "END", "MOVE TRANS(3)"], [3]),
        (["IF 1 < 2 GOTO 10", "MOVE TRANS(1)", "10 MOVE TRANS(2)"], [2]),
        (["IF 1 > 2 GOTO 10", "MOVE TRANS(1)", "10", "MOVE TRANS(2)"], [1, 2]),
        (["GOTO 5", "MOVE TRANS(1)", "5 MOVE TRANS(2)"], [2]),
        (["FOR i = 1 TO 3", "MOVE TRANS(i)", "END", "MOVE TRANS(i)"], [1, 2, 3, 4]),
        (["FOR i = 3 TO 1 STEP -1", "MOVE TRANS(i)", "END"], [3, 2, 1]),
        (["FOR i = 1 TO 0", "MOVE TRANS(i)", "END", "MOVE TRANS(9)"], [9]),
        (["FOR p[1] = 1 TO 2", "MOVE TRANS(p[1])", "END"], [1, 2]),
        (["FOR i = 1 TO 5", "IF i == 2 THEN", "NEXT", "END", "IF i == 4 THEN", "EXIT", "END", "MOVE TRANS(i)", "END"],
         [1, 3]),
        (["FOR i = 1 TO 3", "FOR j = 1 TO 3", "IF j == 2 THEN", "EXIT 2", "END", "MOVE TRANS(10*i+j)", "END", "END"],
         [11]),
        (["i = 0", "WHILE i < 3 DO", "i = i+1", "MOVE TRANS(i)", "END"], [1, 2, 3]),
        (["i = 0", "DO", "i = i+1", "MOVE TRANS(i)", "UNTIL i >= 2"], [1, 2]),
        (["CASE 2 OF", "VALUE 1, 3:", "MOVE TRANS(1)", "VALUE 2:", "MOVE TRANS(2)", "ANY", "HALT", "END"], [2]),
        (["CASE 5 OF", "VALUE 1, 3:", "MOVE TRANS(1)", "ANY", "MOVE TRANS(3)", "END"], [3]),
        (["CASE 5 OF", "VALUE 1:", "MOVE TRANS(1)", "END", "MOVE TRANS(9)"], [9]),
        (['$s = "b"', "CASE $s OF", 'VALUE "a":', "MOVE TRANS(1)", 'VALUE "b":', "MOVE TRANS(2)", "END"], [2]),
        (["i = 0", "10 i = i+1", "MOVE TRANS(i)", "IF i < 3 GOTO 10"], [1, 2, 3]),
        (["MOVE TRANS(1)", "RETURN", "MOVE TRANS(2)"], [1]),
        (["MOVE TRANS(1)", "STOP", "MOVE TRANS(2)"], [1]),
        (["MOVE TRANS(1)", "HALT", "MOVE TRANS(2)"], [1]),
    ],
)  # fmt: skip
def test_control(lines, expected):
    assert places(execute(*lines)) == expected


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


def test_arguments_are_names_for_variables_and_values_in_brackets_are_not():
    # a names n (1 + 10), b is a value, loc names p (11 + 50), list[1] is q[1]; from q[2] on, [1] is q[3].
    assert places(run({"a": CALLS}, RunRequest())) == [11, 61, 5, 77, 8]


def test_what_local_keeps_and_auto_does_not():
    main = ".PROGRAM main()\nCALL one()\nCALL one()\n.END\n"
    counted = (
        main
        + ".PROGRAM one()\n{} n\nIF DEFINED(n) THEN\nn = n+1\nELSE\nn = 1\nEND\nMOVE TRANS(n)\n.END\n"
    )
    assert places(run({"a": counted.format("LOCAL")}, RunRequest())) == [1, 2]
    assert places(run({"a": counted.format("AUTO")}, RunRequest())) == [1, 1]


def test_recursion_and_what_is_left_out_of_a_list():
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
    assert places(run({"a": text}, RunRequest())) == [3, 2, 1]


def test_a_name_in_a_string_is_called():
    assert places(
        run(
            {
                "a": '.PROGRAM main()\n$p = "su"\nCALLS $p+"b"(4)\n.END\n.PROGRAM sub(x)\nMOVE TRANS(x)\n.END\n'
            },
            RunRequest(),
        )
    ) == [4]


def test_programs_that_are_not_there_are_named():
    found = execute("CALL other(1)", "MOVE TRANS(1)")
    assert places(found) == [1]
    assert [a.what for a in found.assumed] == ["program other is not in these files: left out"]


def test_the_program_that_is_run():
    text = ".PROGRAM sub()\nMOVE TRANS(2)\n.END\n.PROGRAM first()\nCALL sub()\n.END\n"
    text += ".PROGRAM other()\nMOVE TRANS(3)\n.END\n"
    found = run({"a": text}, RunRequest())
    assert places(found) == [2]
    assert ("programs not run", "other") in found.facts
    assert places(run({"a": text}, RunRequest(entry="OTHER"))) == [3]
    assert run({"a": text}, RunRequest(entry="nobody")).stopped == (1, "there is no program nobody")
    assert places(run({"a": text + ".PROGRAM main()\nMOVE TRANS(4)\n.END\n"}, RunRequest())) == [4]


def test_programs_of_several_files_and_their_lines():
    found = run(
        {"a": ".PROGRAM main()\nCALL b()\n.END\n", "b": ".PROGRAM b()\nMOVE TRANS(1)\n.END\n"},
        RunRequest(),
    )
    assert (places(found), found.lines) == ([1], (5,))


def test_a_second_task_is_named():
    text = ".PROGRAM main()\nEXECUTE 2 watch(), 0\nMOVE TRANS(1)\n.END\n.PROGRAM watch()\nSIGNAL 5\n.END\n"
    found = run({"a": text}, RunRequest())
    assert [type(i) for i in found.body] == [MoveJ]
    assert ("tasks beside it, not run", "watch (task 2): sets 5 to 1") in found.facts


def test_another_task_is_looked_at_by_itself():
    text = ".PROGRAM main()\nx = 5\nEXECUTE 2 watch(), 0\nMOVE TRANS(1)\n.END\n.PROGRAM watch()\n{}\n.END\n"
    task = "MOVE TRANS(9)\nSIGNAL 5\nWAIT SIG(1001)\nWAIT.EVENT , 2\nPAUSE\nSPEED -1\nWHILE TRUE DO\nSIGNAL -6\nEND"
    found = run({"a": text.format(task)}, RunRequest())
    assert places(found) == [1]
    assert dict(found.facts)["tasks beside it, not run"] == (
        "watch (task 2): sets 5 to 1, sets 6 to 0, stops, waits, 1 motion"
    )
    assert found.lost[0][0] == 3
    assert found.lost[0][1].startswith("another task, watch (task 2), is not shown: sets 5 to 1")
    assert [(one.level, one.line) for one in found.findings] == [("dangerous", 8), ("unusual", 12)]
    assert found.findings[1].what.startswith("in watch: ")
    assert not [one for one in found.assumed if "round" in one.what]


@pytest.mark.parametrize(
    ("line", "name"),
    [("REACT 1001, halt.it(2), 5", "halt.it"), ("REACTI -1002, halt.it(2)", "halt.it")],
)
def test_a_reaction_comes_where_the_user_says_so(line, name):
    text = f".PROGRAM main()\nMOVE TRANS(1)\n{line}\nMOVE TRANS(2)\n{line}\n.END\n"
    text += ".PROGRAM halt.it(x)\nMOVE TRANS(x*10)\n.END\n"
    calm = run({"a": text}, RunRequest())
    assert places(calm) == [1, 2]
    assert [(one.line, one.key, one.value) for one in calm.assumed] == [(3, name, 0.0)]
    assert dict(calm.facts)["reactions that do not come"].startswith("halt.it (REACT")
    assert places(run({"a": text}, RunRequest(assume={name: 1.0}))) == [1, 20, 2]


def test_reactions_without_a_program_and_with_one_of_another_file():
    found = run({"a": ".PROGRAM main()\nREACT 1001\nREACTE other\n.END\n"}, RunRequest())
    assert dict(found.facts)["reactions"] == "REACT 1001"
    assert (
        dict(found.facts)["reactions that do not come"]
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
def test_a_loop_that_nothing_ends_is_told_for_one_round(lines):
    found = execute(*lines, "MOVE TRANS(2)")
    assert places(found) == [1, 2]
    assert found.stopped is None
    assert found.assumed


def test_more_rounds():
    assert places(execute("WHILE TRUE DO", "MOVE TRANS(1)", "END", assume={"rounds": 3})) == [
        1,
        1,
        1,
    ]


def test_the_bound_of_a_run():
    found = execute(
        "i = 0",
        "WHILE i < 1E6 DO",
        "i = i+1",
        "MOVE TRANS(i)",
        "END",
        limits=Limits(vplus_steps=300),
    )
    assert found.stopped is not None
    assert found.stopped[1] == (
        "the program has not ended after 300 steps in loops and calls (limits.vplus_steps)"
    )
    assert 70 < len(found.body) < 80  # four instructions a round
    deep = run({"a": ".PROGRAM a()\nCALL a()\n.END\n"}, RunRequest())
    assert deep.stopped == (2, "more than 60 programs call each other")


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
def test_what_the_controller_would_not_take(line, what):
    for before in ([], ["GOTO 7"]):  # whether it is carried out or not
        found = execute(*before, *line.split("\n"), "7")
        if before and (
            "division" in what or "root" in what or "an output" in what or "positive" in what
        ):
            continue
        assert what in [text for _, text in told(found, "refused")], (line, before)


@pytest.mark.parametrize(
    "line",
    [
        'TYPE "x", /S', "WAIT", "WAIT.EVENT , 1", "BREAK", "ENABLE CP, POWER", "PARAMETER HAND.TIME = 0.3",
        "REACTI 1001, stop.it, 5", "IGNORE 1001", 'ATTACH (lun, 4) "TCP"', "DETACH (lun)", "FCLOSE (lun)",
        'FOPENR (lun) "a.dat"', "CALIBRATE", "MC SPEED 50", "PRIORITY 5", "LOCK 10", "ABORT 2", "SET.EVENT 1, 2",
        "COARSE 200 ALWAYS", "FINE 50", "NULL", "NONULL ALWAYS", "ACCEL (1) 50, 60", "DURATION 0.5 ALWAYS",
        "RIGHTY", "FLIP ALWAYS", "TIMER 1 = 0", "SELECT ROBOT = 1", "RESET", "CPOFF", "SWITCH POWER = TRUE",
        "WRITE (lun) $a, /N", "x = GETC(lun, 1)", "x = TASK(1, 3)", "x = SWITCH(DRY.RUN)", "x = BITS(1, 4)",
        "x = STATE(2)", "x = RANDOM", "x = TIME", "x = INRANGE(p)", "MOVE p:TRANS(1)", "HERE p", "x = DX(HERE)",
        "SET p = p:q:INVERSE(r)", "SET #q = #p", "MOVE #p[1,2]", "x = ^HFF BAND ^B101", "$s = $TIME()", "READY",
    ],
)  # fmt: skip
def test_what_the_controller_takes(line):
    assert not told(execute(line), "refused")
    assert not told(execute("GOTO 7", line, "7"), "refused")


def test_every_line_is_judged_but_each_once():
    found = execute("FOR i = 1 TO 5", "FROB", "END", "IF FALSE THEN", "FROB 2", "END")
    assert told(found, "refused") == [
        (3, "FROB is not an instruction of V+"),
        (6, "FROB is not an instruction of V+"),
    ]


def test_stops_waits_and_the_hand():
    found = execute(
        "PARAMETER HAND.TIME = 0.5",
        "MOVE TRANS(1)",
        "PAUSE",
        "DELAY 2",
        "CLOSEI",
        "OPEN",
        "MOVE TRANS(2)",
    )
    assert [type(i) for i in found.body] == [MoveJ, Stop, Wait, Output, Wait, Output, MoveJ]
    assert [i.seconds for i in found.body if isinstance(i, Wait)] == [2, 0.5]
    assert [(i.signal, i.value) for i in found.body if isinstance(i, Output)] == [
        ("hand.open", 0),
        ("hand.open", 1),
    ]


def test_a_program_without_brackets_without_end_and_with_the_marks_of_a_disk():
    found = run(
        {
            "a": ".PROGRAM a ; comment\nMOVE TRANS(1)\n.END\n\f\n.PROGRAM b\nMOVE TRANS(2)\n.END\n\x1a"
        },
        RunRequest(),
    )
    assert places(found) == [1]
    open_ended = run({"a": ".PROGRAM a()\nMOVE TRANS(1)\n"}, RunRequest())
    assert (places(open_ended), told(open_ended, "unusual")) == ([1], [(2, "a has no .END")])


def test_a_text_without_a_program_line_is_refused_and_run():
    found = run({"pick.v2": "MOVE TRANS(1)\nBREAK\n"}, RunRequest())
    assert told(found, "refused") == [
        (1, "the text has no .PROGRAM line: taken for a program pick")
    ]
    assert len(found.body) == 1


def test_joints_and_names_with_dollar_signs():
    found = execute("SET #p = #PPOINT(10,20,30,40)", "MOVE #p")
    assert found.body[0].target == Joints(pytest.approx((0.17453293, 0.34906585, 30.0, 0.6981317)))


def test_more_behind_an_end_is_odd():
    assert told(execute("IF TRUE THEN", "END l5"), "unusual") == [
        (3, "END stands alone, without l5")
    ]


# -- loops that repeat themselves --------------------------------------------------------------


def test_one_round_of_a_loop_is_shown_if_it_ends_where_the_robot_stood():
    program = execute(
        "MOVE TRANS(2)", "n = 0", "WHILE n < 1 DO", "MOVE TRANS(1)", "MOVE TRANS(2)", "END"
    )
    assert places(program) == [2, 1, 2]
    assert [item.line for item in program.assumed if "shown for one round" in item.what] == [4]


def test_exit_leaves_as_many_loops_as_its_expression_says():
    lines = ["n = 2", "FOR i = 1 TO 3", "FOR j = 1 TO 3", "MOVE TRANS(10*i+j)", "EXIT n", "END"]
    assert places(execute(*lines, "END")) == [11]
