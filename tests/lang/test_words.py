"""Tables of words: each is read, reported or refused, or has a reason to be silent."""

from collections import Counter
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import camgen
from bench.read.old_words import read_table, write_program
from camgen.lang.pacscript import code, statements
from camgen.lang.pacscript import effects as pacscript
from camgen.lang.pacscript.words import STATEMENTS
from camgen.lang.programs import Executed, RunRequest, find_language
from camgen.lang.rapid import effects as rapid
from camgen.lang.rapid.instructions import EFFECTS
from camgen.lang.rapid.motions import FORMS
from camgen.lang.vplus import effects as vplus
from camgen.lang.vplus.flow import DOES
from camgen.lang.word_tables import by_word

TABLES = {"rapid": rapid, "vplus": vplus, "pacscript": pacscript}
STATEMENTS_OF = {row.language: {} for row in read_table()}
for row in read_table():
    STATEMENTS_OF[row.language][row.word] = row.statement
#: The table of the bench has the words of RAPID in lower case, those of V+ in capitals.
WORDS = []
for language, table in TABLES.items():
    for kind in ("SILENT", "OMITTED", "LOST"):
        WORDS += [(language, kind, word) for word in getattr(table, kind)]


@cache
def run(language: str, statement: str) -> Executed:
    """The run of a program of the bench with a statement, done once for equal statements."""
    text = write_program(language, 0, 1, statement)
    return find_language(language).run({"a.txt": text}, RunRequest())


def describe(executed: Executed) -> list[str]:
    """The instructions as texts."""
    return list(map(repr, executed.body))


@pytest.mark.parametrize(("language", "kind", "word"), WORDS)
def test_a_word_has_the_effect_of_its_table(language, kind, word):
    statement = STATEMENTS_OF[language].get(word, word + (";" if language == "rapid" else ""))
    executed, without = run(language, statement), run(language, "")
    assert [finding for finding in executed.findings if finding.level == "refused"] == []
    reason = getattr(TABLES[language], kind)[word]
    omitted = [what for _, what in executed.omitted if what.endswith(reason)]
    lost = [what for _, what in executed.lost if what.endswith(reason)]
    assert (bool(omitted), bool(lost)) == (kind == "OMITTED", kind == "LOST")
    assert all(word.lower() in what.lower() for what in omitted + lost)
    if kind == "SILENT":
        assert executed.omitted == without.omitted
        assert executed.lost == without.lost
        assert len(executed.body) == len(without.body)


@pytest.mark.parametrize("language", TABLES)
def test_no_word_is_in_two_tables(language):
    table = TABLES[language]
    words = [*table.SILENT, *table.OMITTED, *table.LOST]
    assert [word for word, count in Counter(words).items() if count > 1] == []
    assert all(map(str.strip, [*table.SILENT.values(), *table.OMITTED.values()]))


def test_every_word_of_rapid_is_in_a_table_of_the_bench():
    interrupts = {"icap", "ipathpos", "irmqmessage"}
    assert EFFECTS.keys() | FORMS.keys() <= STATEMENTS_OF["rapid"].keys() | interrupts


def test_every_keyword_of_vplus_is_in_a_table_of_the_bench():
    flow = {"AUTO", "CALL", "CALLS", "GLOBAL", "LOCAL", "WAIT", "WAIT.EVENT"}
    words = DOES.keys() | vplus.SILENT.keys() | vplus.OMITTED.keys() | vplus.LOST.keys()
    assert words - flow <= STATEMENTS_OF["vplus"].keys()


#: Words of the flow of a program and of declarations, which the compiler reads.
FLOW = {
    "byref",
    "byval",
    "case",
    "else",
    "elseif",
    "for",
    "function",
    "goto",
    "if",
    "loop",
    "next",
    "on",
    "resume",
}
FLOW |= {"select", "step", "sub", "then", "to", "until", "while", "exit", "end", "do", "error"}
#: Functions that the list of statements has too.
FUNCTIONS = {"createarray", "createmultiarray", "createmutex", "curlmt", "msgbox"}


def test_every_statement_of_pacscript_is_read_reported_or_refused():
    read = (
        statements.ORDERS.keys()
        | {"stop", "stopend"}
        | statements.DECLARE
        | pacscript.SILENT.keys()
        | FLOW
        | FUNCTIONS
    )
    assert code.SILENT is pacscript.SILENT
    assert STATEMENTS - read == set()


def test_a_word_in_two_groups_is_an_error():
    with pytest.raises(ValueError, match="a stands in two groups"):
        by_word({"one": "a b", "two": "c a"})


LINE = "MoveL [[30,0,0],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v80,fine,"
CASES = {
    "stationary tool": (
        f"{LINE}tFixed\\WObj:=wHeld;",
        "the tool tFixed stands still, and the robot holds the work",
    ),
    "work in the hand": (
        f"{LINE}tOld\\WObj:=wHeld;",
        "the work object wHeld is held by the robot",
    ),
    "another unit": (
        f"{LINE}tOld\\WObj:=wMoved;",
        "the work object wMoved is moved by STN_1",
    ),
    "conveyor": ("WaitWObj wOld;", "waitwobj: the robot follows a conveyor"),
    "two robots": ("SyncMoveOn syOld,tasksOld;", "syncmoveon: several robots move in step"),
    "sensor": ("CorrWrite hOld,oOld;", "corrwrite: a sensor corrects the path"),
    "soft servo": ("SoftAct 1,70;", "softact: the servo is soft"),
    "wrist": ("CirPathMode\\Wrist45;", "cirpathmode \\wrist45: the tool turns as the wrist does"),
}


TRIGGERS = {
    "a signal at its place": ("TriggIO trOld,5\\DOp:=doOld,1;", [], []),
    "a value that is not known": (
        "TriggIO trOld,5\\GOp:=goOld,nUnknown;",
        ["triggio: its signal or its value is not known"],
        [],
    ),
    "a time": (
        "TriggIO trOld,0.5\\Time\\DOp:=doOld,1;",
        [],
        ["triggio \\time: the time before the end; here it acts at the end"],
    ),
    "a lag": (
        "TriggEquip trOld,5,0.2\\DOp:=doOld,1;",
        [],
        ["triggequip: the lag of its equipment, 0.2 s"],
    ),
    "an analog output": (
        "TriggSpeed trOld,5,0.2,aoOld,1;",
        ["triggspeed: an analog output along the path; set it by SetAO"],
        [],
    ),
    "a check": (
        "TriggCheckIO trOld,5,diOld,EQ,1,iOld;",
        [],
        ["triggcheckio: a check of a signal on the way"],
    ),
    "nothing": ("", ["triggl: a trigger is not known; define it by TriggIO"], []),
}


@pytest.mark.parametrize("name", TRIGGERS)
def test_a_trigger_is_read_reported_or_refused(name: str) -> None:
    statement, lost, omitted = TRIGGERS[name]
    motion = LINE.replace("MoveL", "TriggL").replace("v80,", "v80,trOld,")
    executed = run("rapid", f"{statement} {motion}tOld\\WObj:=wOld;")
    assert [what for _, what in executed.lost] == lost
    assert [what for _, what in executed.omitted] == omitted


def test_outputs_along_a_joint_motion_are_reported():
    joint = LINE.replace("MoveL", "TriggJ").replace("v80,", "v80,trOld,")
    executed = run("rapid", f"TriggIO trOld,5\\DOp:=doOld,1; {joint}tOld\\WObj:=wOld;")
    what = "triggj: the place of its triggers on the way; here they act at its end"
    assert [text for _, text in executed.omitted] == [what]


@pytest.mark.parametrize("name", CASES)
def test_a_build_refuses_a_word_that_another_machine_runs_differently(
    tmp_path: Path, name: str
) -> None:
    """The error is one line with the file, the word, the remedy and the line number."""
    statement, what = CASES[name]
    file = tmp_path / "old.mod"
    text = write_program("rapid", 0, 1, statement)
    file.write_text(text)
    line = text[: text.index(statement)].count("\n") + 1
    with pytest.raises(camgen.InputError) as error:
        camgen.build(file, post="rapid", job={"post": {"signals": {"doGlue": "doGlue"}}})
    assert str(error.value).startswith(f"{file}: {what}")
    assert f"(line {line})" in str(error.value)
    assert "\n" not in str(error.value)


def test_a_build_prints_the_assumptions_and_omissions_of_verify(tmp_path: Path) -> None:
    file = tmp_path / "old.mod"
    file.write_text(write_program("rapid", 0, 1, "AccSet 20,30; WaitDI di1,1; PulseDO doGlue;"))
    result = camgen.build(file, post="rapid", job={"post": {"signals": {"doGlue": "doGlue"}}})
    notes = list(map(str, result.notes))
    assert (
        "skipped: line 27: accset 20, 30: accelerations (the translation does without it)" in notes
    )
    assert "assumed: line 27: di1: the wait for 1 is over at once" in notes
    assert "assumed: pulses: doGlue, 0.2 s" in notes


def test_the_tool_is_tilted_at_the_circle_point() -> None:
    """Half a circle with level ends whose circle point at (30, 0) is tilted by 30 deg."""
    tail = "[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
    statement = (
        f"MoveJ [[0,-30,0],[0,0,1,0],{tail},v50,fine,tOld\\WObj:=wOld; CirPathMode\\CirPointOri; "
        f"MoveC [[30,0,0],[0,-0.2588190,0.9659258,0],{tail},[[0,30,0],[0,0,1,0],{tail},v50,fine,"
        "tOld\\WObj:=wOld;"
    )
    arcs = [item for item in run("rapid", statement).body if isinstance(item, camgen.MoveC)][:2]
    start = run("rapid", statement).body[3]
    assert [arc.target.origin for arc in arcs] == [
        pytest.approx((30, 0, 0)),
        pytest.approx((0, 30, 0)),
    ]
    poses = [arcs[0].via, arcs[0].target, arcs[1].via, arcs[1].target]
    angles = [angle_of(start.target, pose) for pose in poses]
    assert angles == pytest.approx([15, 30, 15, 0], abs=1e-5)


def angle_of(start: camgen.Pose, end: camgen.Pose) -> float:
    """The angle in deg between two orientations, from the trace of the rotation between them."""
    trace = float((start.rotation * end.rotation).sum())
    return float(np.degrees(np.arccos(np.clip((trace - 1) / 2, -1, 1))))
