"""RAPID: a routine per path, modules of limited length, and ERROR handlers."""

import pytest
from camgen_posts.rapid import Rapid

from camgen.lang.rapid.strict import read
from camgen.model.program import Instruction, MoveL, Output
from tests.support.rapid_programs import (
    HOME,
    TWO_PATHS,
    assert_same,
    at,
    list_routines,
    path_body,
    pressed,
    pressing_program,
    print_program,
    program,
    program_of_paths,
    verify,
)


def test_a_long_program_is_split_into_modules() -> None:
    plan = program(HOME, *[MoveL(at(i, 0, 0), 20.0) for i in range(25)], Output("process", 1))
    prepared, files = print_program(plan, max_lines=10)
    assert list(files) == ["plate.mod", "plate_part1.mod", "plate_part2.mod", "plate_part3.mod"]
    main = files["plate.mod"]
    assert main.index("part_1;") < main.index("part_2;") < main.index("part_3;")
    assert files["plate_part2.mod"].startswith(
        "MODULE plate_part2\n\n    PROC part_2()\n        MoveL [[8.000,"
    )
    assert all(text.count("tooldata") == (name == "plate.mod") for name, text in files.items())
    reading = read(files, {})
    assert_same(prepared, reading, Rapid().tolerance())
    # The first part begins with MODULE, an empty line and PROC.
    assert reading.lines[0] == main.count("\n") + 4
    backwards = read(dict(reversed(files.items())), {})
    assert backwards.findings == ()


def test_each_path_is_a_routine_that_main_calls() -> None:
    spindle = {"signals": {"process": "doAir", "spindle": "aoRpm"}}
    body = [
        HOME,
        Output("spindle", 900),
        *path_body(0, 10, rise=False),
        *path_body(1, 20),
        Output("spindle", 0),
        HOME,
    ]
    prepared, files = print_program(program_of_paths(*body), **spindle)
    assert list(files) == ["plate.mod"]
    settings = ["ConfJ", "ConfL"]
    work = ["MoveL", "SetDO", "MoveL", "SetDO"]
    assert list_routines(files) == {
        "main": [
            *settings,
            "SetAO",
            "SetDO",
            "MoveAbsJ",
            "SetAO",
            "c1",
            "c2",
            "SetAO",
            "MoveAbsJ",
            "ERROR",
            "camSafe",
            "RAISE",
        ],
        "camSafe": ["SetAO", "SetDO"],
        "c1": [*work, "ERROR", "RAISE"],
        "c2": [*work, "MoveL", "ERROR", "RAISE"],
    }
    assert "        ! path 1\n" in files["plate.mod"].split("PROC c2()")[1]
    reading = read(files, spindle)
    assert reading.findings == ()
    verify(prepared, reading)


def test_main_resets_the_outputs_before_the_first_motion() -> None:
    files = print_program(
        program_of_paths(
            Output("process", 0),
            HOME,
            *path_body(0, 10),
            *path_body(1, 20),
            HOME,
            Output("process", 0),
        )
    )[1]
    assert list_routines(files)["main"] == [
        *(
            "ConfJ",
            "ConfL",
            "SetDO",
            "MoveAbsJ",
            "c1",
            "c2",
            "MoveAbsJ",
            "SetDO",
            "ERROR",
            "camSafe",
            "RAISE",
        ),
    ]
    assert read(files, {}).findings == ()


@pytest.mark.parametrize(
    ("ids", "names"),
    [
        (("c1", "c1"), ["c1", "c1_2"]),
        (("user", "v20"), ["puser", "pv20"]),
        (("plate", "doProcess"), ["plate_2", "doProcess_2"]),
        (("a/b c", "7"), ["a_b_c", "p7"]),
        (("x" * 40, "X" * 40), ["x" * 31, "X" * 26 + "_2"]),
        (("camSafe", "MAIN"), ["pcamSafe", "pMAIN"]),
        (("tCamgen", "wcamgen"), ["tCamgen_2", "wcamgen_2"]),
    ],
)
def test_each_routine_gets_a_legal_name_that_is_not_taken(
    ids: tuple[str, str], names: list[str]
) -> None:
    files = print_program(
        program_of_paths(HOME, *path_body(0, 10), *path_body(1, 20), HOME, ids=ids)
    )[1]
    assert list(list_routines(files))[2:] == names
    assert read(files, {}).findings == ()


def test_routines_of_paths_are_spread_over_modules_of_limited_length() -> None:
    """The routine of a path has 9 lines. Main and a path that is longer than a module are split."""
    ids = [f"c{k}" for k in range(30)]
    long = [MoveL(at(k, 9, 0), 20.0, path=30) for k in range(45)]
    body: list[Instruction] = [HOME]
    for k in range(30):
        body += path_body(k, 10 * k)
    plan = program_of_paths(*body, *long, HOME, ids=[*ids, "long"])
    prepared, files = print_program(plan, max_lines=20)
    routines = list_routines(files)
    assert [name for name in routines if name.startswith(("part_", "long"))] == [
        *("part_1", "part_2", "long", "long_1", "long_2", "long_3"),
    ]
    assert routines["main"][2:4] == ["part_1", "part_2"]
    assert routines["part_2"][-4:] == ["long", "MoveAbsJ", "ERROR", "RAISE"]
    sizes = [text.count("\n") - 2 for name, text in files.items() if name != "plate.mod"]
    # 5 lines more than the limit: PROC, ERROR, RAISE, ENDPROC and an empty line.
    assert max(sizes) <= 20 + 5
    reading = read(files, {})
    assert reading.findings == ()
    verify(prepared, reading)


@pytest.mark.parametrize(("on_error", "last"), [("raise", "RAISE"), ("exit", "EXIT")])
def test_an_error_switches_the_process_off(on_error: str, last: str) -> None:
    files = print_program(TWO_PATHS, on_error=on_error)[1]
    assert list_routines(files)["main"][-3:] == ["ERROR", "camSafe", last]
    assert list_routines(files)["c2"][-2:] == ["ERROR", "RAISE"]
    assert read(files, {"on_error": on_error}).findings == ()
    without = print_program(TWO_PATHS, on_error="none")[1]["plate.mod"]
    assert "ERROR" not in without
    assert "camSafe" not in without


def test_a_post_prints_the_same_text_twice() -> None:
    post = Rapid(force_calibrated=True)
    prepared = post.prepare(pressing_program(pressed(0)), 0.01)
    assert post.render(prepared) == post.render(prepared)


SWITCHES_ITSELF = "the ERROR handler of main switches an output itself, not in a routine"


@pytest.mark.parametrize(
    ("handler", "fault"),
    [
        ("camSafe;\n        RAISE;", ""),
        ("SetDO doProcess,0;\n        EXIT;", SWITCHES_ITSELF),
        ("Reset doProcess;\n        RAISE;", SWITCHES_ITSELF),
        ("RAISE;", "the ERROR handler of main leaves process on"),
        ("SetDO doOther,0;\n        RAISE;", "the ERROR handler of main leaves process on"),
        ("camSafe;", "the ERROR handler of main continues after the error; end it with RAISE"),
        ("SetDO doProcess,1;\n        RAISE;", "an ERROR handler that switches something on"),
        ("camSafe;\n        RAISE;\n        SetDO doProcess,0;", "statements after RAISE"),
        (
            "camSafe;\n        WaitTime 1;\n        RAISE;",
            "waittime in an ERROR handler is not read",
        ),
        (
            "camSafe;\n        IF x FCDeact;\n        RAISE;",
            "IF is read as IF FCIsForceMode() FCDeact; alone",
        ),
        ("camSafe;\n        TRYNEXT;", "TRYNEXT is a statement that is not read"),
        ("nowhere;\n        RAISE;", "nowhere is a statement that is not read"),
    ],
)
def test_a_handler_that_leaves_an_output_on_or_does_more_has_a_fault(
    handler: str, fault: str
) -> None:
    text = print_program(TWO_PATHS)[1]["plate.mod"].replace("camSafe;\n        RAISE;", handler, 1)
    on_error = "exit" if "EXIT" in handler else "raise"
    faults = [item.what for item in read({"a": text}, {"on_error": on_error}).findings]
    assert fault in faults if fault else not faults


def test_a_routine_that_ends_the_program_must_switch_the_process_off() -> None:
    text = print_program(TWO_PATHS)[1]["plate.mod"]
    ends = text.replace("ERROR\n        RAISE;", "ERROR\n        EXIT;", 1)
    assert [fault.what for fault in read({"a": ends}, {}).findings] == [
        "the ERROR handler of c1 leaves process on",
        "the ERROR handler of c1 does more than RAISE",
    ]
