"""The bench of mutants: its changes, and its simulations, which must distinguish programs."""

import ast
import math
from pathlib import Path

import pytest

from bench.reliability.modal.machine import Number, describe_arc, is_same, work_out
from bench.reliability.mutants import (
    TRACES,
    Family,
    find_verdicts,
    list_mutants,
    plan_batches,
    trace,
)
from bench.reliability.mutations import LANGUAGES, list_mutations
from bench.reliability.programs import SOURCES, make
from bench.reliability.wide_mutations import KINDS, mutate

ROOT = Path(__file__).parents[2]
POSTS = sorted(SOURCES)
FIRST = {"rapid": 0, "pacscript": 0, "vplus": 0, "gcode": 1, "grbl": 0}


@pytest.mark.parametrize("post", POSTS)
def test_each_program_is_simulated_and_equal_to_itself(post):
    for index in range(len(SOURCES[post])):
        program = make(post, index)
        events = trace(post, program, program.text)
        assert is_same(events, trace(post, program, program.text))
        assert not any(
            event[0] in ("refused", "no end", "two radii", "too long") for event in events
        )


#: Lines of force.ir in PacScript: the motion before force control, its table, and its start.
GO = "    Move L, @0 P(10.000, 10.000, 0.000, 180.0000, 0.0000, 0.0000, -1), Speed = Mps(20)\n"
PARAM = "    ForceParam 1, 2, P(0.000, 12.500, 0.000, 0, 0, 0) ' verify\n"
CTRL = "    ForceCtrl True, 1 ' verify\n"
#: Changes that change the meaning: post, index of the program, a part of its text, its replacement.
DIFFERENT = [
    ("pacscript", 0, "ChangeTool 1", "ChangeTool 2"),
    ("pacscript", 0, "ChangeWork 1\n", "\n"),
    ("pacscript", 0, "Keep = 0", "Keep = 5"),
    ("pacscript", 0, "Keep = 0", "Kepp = 0"),
    ("pacscript", 0, "    GiveArm\nEnd Sub", "    Motor Off\n    GiveArm\nEnd Sub"),
    ("pacscript", 0, "Set IO[24]", "Set IO[25]"),
    (
        "pacscript",
        0,
        "20.000, 180.0000, 0.0000, 0.0000, -1)",
        "20.000, 180.0000, 0.0000, 0.0000, 5)",
    ),
    ("pacscript", 0, "20.000, 180.0000", "20.002, 180.0000"),
    ("pacscript", 0, "180.0000, 0.0000, 0.0000", "180.0000, 0.0000, 0.0100"),
    ("pacscript", 0, "@P", "@0"),
    ("pacscript", 0, "Speed = Mps(100 * unit)", "Speed = Mps(100 + unit)"),
    ("pacscript", 1, "0.000, 0, 0, 0)", "0.000, 1, 0, 0)"),
    ("pacscript", 3, "Mps(20)", "Mps(20.1)"),
    ("pacscript", 3, PARAM, ""),
    ("pacscript", 3, f"{PARAM}{CTRL}", f"{CTRL}{PARAM}"),
    ("pacscript", 3, PARAM, PARAM.replace("ForceParam 1", "ForceParam 2")),
    ("pacscript", 3, PARAM, PARAM.replace("12.500", "12.600")),
    ("pacscript", 3, PARAM, f"{PARAM}    Call other\n"),
    ("pacscript", 10, "(ByVal unit As Single)\n", "(unit As Single)\n    unit = 2\n"),
    ("pacscript", 10, "(ByVal unit As Single)\n", "(ByVal ByVal unit As Single)\n"),
    ("pacscript", 10, "part_part2(ByVal unit As", "part_part2(ByVal other As"),
    ("rapid", 0, "ConfL\\Off;", ""),
    ("rapid", 0, "v100,fine", "v100,z1"),
    ("rapid", 0, "[8,500,5000,1000]", "[8,0,5000,1000]"),
    ("rapid", 0, "[8,500,5000,1000]", "[9,500,5000,1000]"),
    ("rapid", 0, "[0.001,[0,0,0.001]", "[0.101,[0,0,0.001]"),
    ("rapid", 0, "MODULE part", "MODULE user"),
    ("rapid", 0, "MODULE part", "MODULE camSafe"),
    ("rapid", 0, "[0,0,0,0],[9E9", "[0,1,0,0],[9E9"),
    ("rapid", 0, "],[9E9,", "],[8E9,"),
    ("rapid", 0, "SetDO doProcess,1", "SetAO doOther,1"),
    ("rapid", 0, "        ConfL\\Off;\n", "        ConfL\\On;\n"),
    ("rapid", 0, "        c3;", "        ConfL\\On;\n        c3;\n        ConfL\\Off;"),
    ("rapid", 0, "        camSafe;\n", ""),
    ("rapid", 0, "        c3;\n", "        c3;\n        c3;\n"),
    ("rapid", 0, "MODULE part", "MODULE tCamgen"),
    ("rapid", 1, "        WaitTime\\InPos,0;\n", ""),
    (
        "rapid",
        1,
        "    ERROR\n        camSafe;\n        IF FCIsForceMode() FCDeact;",
        "    ERROR\n        camSafe;",
    ),
    ("rapid", 1, "v20,\\Fz:=10,50", "v20,50\\Fz:=10"),
    ("rapid", 3, "\\Fy:=-12.5,50", "\\Fy:=-12.5,60"),
    ("rapid", 4, "[20,30,", "[20,31,"),
    ("rapid", 4, "[20,30,", "[0,30,"),
    ("rapid", 5, "ConfL\\On;", "ConfL\\Off;"),
    ("rapid", 3, "\\Fy:=-12.5,50", "\\Fz:=-12.5,50"),
    ("vplus", 0, "AUTO cg.tool, cg.work", ""),
    ("vplus", 0, "BREAK", ""),
    ("vplus", 0, "ACCEL (0) 100, 100", "ACCEL (0) 100, 50"),
    ("vplus", 0, ", 100 MMPS", ", 90 MMPS"),
    ("vplus", 0, "SIGNAL 33", "SIGNAL 34"),
    ("vplus", 0, ".PROGRAM part()", ".PROGRAM move()"),
    ("vplus", 0, "TRANS(300,-75,100", "TRANS(300,-75,101"),
    ("vplus", 0, "DETACH ()", "DETACH ()\n    MOVE #PPOINT(0, 0)"),
    ("vplus", 0, "    SELECT ROBOT = 1\n    ATTACH ()", "    ATTACH ()\n    SELECT ROBOT = 1"),
    ("vplus", 0, "DETACH ()", "DETACH ()\n    DETACH ()"),
    ("vplus", 0, "RETURN", "RETURN RETURN"),
    ("vplus", 0, "    DETACH ()\n    RETURN", "    RETURN\n    DETACH ()"),
    ("vplus", 0, "SPEED 5, 100 MMPS", "SPEED 6, 100 MMPS"),
    ("vplus", 4, ", 2.5 MMPS", ", 2.6 MMPS"),
    ("vplus", 9, "CALL part.1()\n    CALL part.2()", "CALL part.2()\n    CALL part.1()"),
    ("vplus", 9, "    CALL part.5()\n", ""),
    (
        "vplus",
        9,
        "    SPEED 20, 100 MMPS ALWAYS\n    MOVES cg.work:TRANS(13.86,",
        "    MOVES cg.work:TRANS(13.86,",
    ),
    ("gcode", 1, "G17 ", ""),
    ("gcode", 1, "G49", "G61"),
    ("gcode", 1, "G91.1", ""),
    ("gcode", 1, "Q0", ""),
    ("gcode", 1, "G54 G80", "G55 G80"),
    ("gcode", 1, "M2", ""),
    ("gcode", 1, "S12000 M3", "S12000 M4"),
    ("gcode", 2, "G98 ", "G99 "),
    ("gcode", 2, "Q3", "Q2"),
    ("grbl", 0, "M3 S1000", "M3 S900"),
    ("grbl", 0, "G90", "G91"),
    ("grbl", 0, "M2", "M30"),
    ("grbl", 0, "(post", "(!post"),
]
#: Changes that do not change the meaning, in the same form.
SAME = [
    ("pacscript", 3, PARAM, f"    ForceParam 1, 2, P(0, 5, 0)\n{PARAM}"),
    ("pacscript", 3, f"{GO}{PARAM}", f"{PARAM}{GO}"),
    ("pacscript", 10, "(ByVal unit As Single)", "(unit As Single)"),
    ("pacscript", 10, "part_part3(ByVal unit As", "part_part3(ByVal other As"),
    ("pacscript", 0, "ChangeTool 1", "changetool 01\n    ChangeTool 1 ' again"),
    ("pacscript", 0, "180.0000, 0.0000, 0.0000, -1)", "-180, 0, 0)"),
    ("pacscript", 0, "100 * unit", "unit * 100.0"),
    ("rapid", 0, "MODULE part", "MODULE parts"),
    ("rapid", 0, "MODULE part", "MODULE WObj"),
    ("rapid", 0, "        camSafe;\n", "        camSafe;\n        camSafe;\n"),
    (
        "rapid",
        1,
        "        WaitTime\\InPos,0;\n",
        "        WaitTime\\InPos,0;\n        WaitTime\\InPos,0;\n",
    ),
    (
        "rapid",
        1,
        "FCDeact;\n        RAISE",
        "FCDeact;\n        IF FCIsForceMode() FCDeact;\n        RAISE",
    ),
    ("rapid", 1, "v20,\\Fz:=10,50", "v20\\Fz:=10,50"),
    ("rapid", 4, "[20,30,", "[25,30,"),
    ("rapid", 5, "ConfL\\On;", ""),
    ("rapid", 7, "ConfL\\Off;", "ConfL\\On;"),
    ("rapid", 0, "MoveJ [[", "movej\n  [ [ "),
    ("rapid", 0, "v100,fine", "[100,500,5000,1000],fine"),
    ("rapid", 0, "[1.0000000,0.0000000,0.0000000,0.0000000]", "[-1,0,0,0]"),
    ("vplus", 0, "BREAK", "BREAK\n    break ; again"),
    ("vplus", 0, "TRANS(300,-75,100,0,0,0)", "TRANS(300,-75,100)"),
    ("vplus", 0, "    RETURN\n", ""),
    ("vplus", 0, "ATTACH ()", "ATTACH ()\n    attach ()"),
    ("vplus", 0, "SELECT ROBOT = 1", "SELECT ROBOT = 1\n    SELECT ROBOT = 1"),
    ("vplus", 4, "SPEED 20, 2.5 MMPS", "SPEED 21, 2.5 MMPS"),
    ("vplus", 9, "    SPEED 6.6667, 100 MMPS ALWAYS\n    SPEED 20", "    SPEED 20"),
    ("gcode", 1, "G17 G21", "G21 G17"),
    ("gcode", 1, "S12000 M3", "m03 s12000."),
    ("grbl", 0, "(post", "(posts"),
]


@pytest.mark.parametrize(("post", "index", "was", "now"), DIFFERENT)
def test_a_change_of_the_meaning_is_found(post, index, was, now):
    text = make(post, index).text
    assert was in text
    assert not is_same(TRACES[post](text), TRACES[post](text.replace(was, now, 1)))


@pytest.mark.parametrize(("post", "index", "was", "now"), SAME)
def test_a_change_without_another_meaning_is_accepted(post, index, was, now):
    text = make(post, index).text
    assert was in text
    assert is_same(TRACES[post](text), TRACES[post](text.replace(was, now, 1)))


#: Post, program, and the name of a routine, with a free name and a reserved name of the language.
RENAMED = [
    ("rapid", 0, "c3", "drill", "movel"),
    ("rapid", 0, "camSafe", "safe", "error"),
    ("vplus", 9, "part.2", "second", "move"),
    ("pacscript", 10, "part_part2", "second", "Move"),
]


@pytest.mark.parametrize(("post", "index", "name", "free", "taken"), RENAMED)
def test_a_routine_may_have_any_free_name(post, index, name, free, taken):
    text = make(post, index).text
    trace_of = TRACES[post]
    assert is_same(trace_of(text), trace_of(text.replace(name, free)))
    assert not is_same(trace_of(text), trace_of(text.replace(name, free, 1)))
    assert not is_same(trace_of(text), trace_of(text.replace(name, taken)))


@pytest.mark.parametrize(
    ("before", "after", "same"),
    [
        ("SPEED 5,", "SPEED (5),", True),
        ("TRANS(300,", "TRANS((300),", True),
        ("SPEED 5,", "SPEED (6),", False),
        ("ACCEL (0) 100", "ACCEL 0 100", False),
        ("ATTACH ()", "ATTACH (0)", False),
    ],
)
def test_brackets_around_a_number_do_not_change_it(before, after, same):
    text = make("vplus", 0).text
    assert before in text
    changed = TRACES["vplus"](text.replace(before, after, 1))
    assert is_same(TRACES["vplus"](text), changed) is same


@pytest.mark.parametrize("sweep", [1.0, -1.0, 3.0, 4.0])
def test_an_arc_does_not_depend_on_its_via_point(sweep):
    def at(angle):
        return 5 + 2 * math.cos(angle), 1 + 2 * math.sin(angle), 7.0

    middle = tuple(Number(value, "arc") for value in at(0.3 + sweep / 2))
    for part in (0.3, 0.5, 0.7):
        result = describe_arc(at(0.3), at(0.3 + part * sweep), at(0.3 + sweep))
        assert is_same([result], [("half-way", *middle)])
    assert describe_arc(at(0.3), at(0.3 + 0.1 * sweep), at(0.3 + sweep))[0] == "via near an end"


def test_the_edits_of_a_line_drop_repeat_and_replace_its_parts():
    text = "MoveL p1,v100;\n"
    mutants = {edit.apply(text) for edit in list_mutations(text, LANGUAGES["rapid"])}
    expected = {
        "MoveL p1,v200;\n",
        "MoveL p1v100;\n",
        "MoveL v100,p1;\n",
        "MoveL p1,v100;;\n",
        "MoveL p1,v100; ",
        "",
    }
    assert expected <= mutants
    assert text not in mutants
    assert text + text in mutants


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("post", POSTS)
def test_batches_cover_all_mutants_and_a_sample_covers_all_programs(post, kind):
    family = Family(post, kind)
    programs = range(len(SOURCES[post]))
    sizes = [len(list_mutants(family, program)) for program in programs]
    whole = plan_batches([family], 0)
    wanted = {program: range(sizes[program]) for program in programs if sizes[program]}
    assert {batch.program: batch.places for batch in whole} == wanted
    sample = plan_batches([family], 100)
    assert 50 < sum(len(batch.places) for batch in sample) <= 100
    step = math.ceil(sum(sizes) / 100)
    large = {program for program in programs if sizes[program] >= step}
    assert {batch.program for batch in sample} >= large


@pytest.mark.parametrize("kind", KINDS[1:])
@pytest.mark.parametrize("post", POSTS)
def test_each_mutant_of_a_sample_has_a_verdict(post, kind):
    letters = ""
    for batch in plan_batches([Family(post, kind)], 60):
        letters += find_verdicts(batch)
    assert set(letters) <= {"c", "h"}
    assert len(letters) > 30


@pytest.mark.parametrize(
    ("kind", "least"),
    [("single", 100_000), ("structural", 40_000), ("global", 25_000), ("paired", 10_000)],
)
def test_there_are_enough_mutants(kind, least):
    total = 0
    for post in POSTS:
        for k in range(len(SOURCES[post])):
            total += len(list_mutants(Family(post, kind), k))
    assert total >= least


TEXT = """MODULE m
    CONST num a:=1;
    PROC main()
        ConfJ\\Off;
        ConfL\\Off;
        MoveJ p1,v10;
        MoveL p1,v10;
    ENDPROC
ENDMODULE
"""
#: Changes of `TEXT` that each kind has to make, and their mutants.
PROC, END = "    PROC main()\n", "    ENDPROC\n"
DATA, CONFJ, CONFL = "    CONST num a:=1;\n", "        ConfJ\\Off;\n", "        ConfL\\Off;\n"
MOVEJ, MOVEL = "        MoveJ p1,v10;\n", "        MoveL p1,v10;\n"
WIDE = [
    ("structural", "bounds of a block dropped", TEXT.replace(PROC, "").replace(END, "")),
    ("structural", "moved after an end", TEXT.replace(MOVEJ, "").replace(END, END + MOVEJ)),
    (
        "structural",
        "an end moved before the line",
        TEXT.replace(END, "").replace(MOVEL, END + MOVEL),
    ),
    ("structural", "repeated after an end", TEXT + MOVEJ),
    ("global", "v10 replaced everywhere", TEXT.replace("v10", "v20")),
    ("global", "p1 dropped everywhere", TEXT.replace("p1", "")),
    ("paired", "two lines dropped", TEXT.replace(CONFJ, "").replace(CONFL, "")),
    ("paired", "two lines dropped", TEXT.replace(DATA, "").replace(CONFL, "")),
]


@pytest.mark.parametrize(("kind", "change", "mutant"), WIDE)
def test_wide_mutations_change_several_lines(kind, change, mutant):
    assert (change, mutant) in [
        (mutation.kind, mutation.apply(TEXT)) for mutation in mutate(TEXT, "rapid", kind)
    ]


@pytest.mark.parametrize("kind", KINDS)
def test_mutants_differ_from_the_text_and_are_repeatable(kind):
    mutants = [mutation.apply(TEXT) for mutation in mutate(TEXT, "rapid", kind)]
    assert TEXT not in mutants
    assert mutants == [mutation.apply(TEXT) for mutation in mutate(TEXT, "rapid", kind)]


def test_another_seed_draws_other_mutants():
    first, second = (mutate(TEXT, "rapid", "structural", seed) for seed in (0, 1))
    assert first != second


def test_simulations_and_read_backs_do_not_import_each_other():
    for folder, forbidden in (
        ("bench/reliability/modal", ("camgen", "post")),
        ("postprocessors", ("bench",)),
    ):
        for file in (ROOT / folder).rglob("*.py"):
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
                names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
                names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
                assert not any(name.startswith(forbidden) for name in names), f"{file}: {names}"


@pytest.mark.parametrize(
    ("text", "value"),
    [("5", 5), ("- 5", -5), ("5 - 3", 2), ("0 - 180", -180), ("2 * 3 + 4", 10), ("4 + 2 * - 3", -2),
     ("5 5", None), ("5 -", None), ("x", None), ("* 5", None)],
)  # fmt: skip
def test_sums_and_products_are_computed(text, value):
    assert work_out(text.split()) == value
