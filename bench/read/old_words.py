"""Words of old robot programs in a translation: python -m bench.read.old_words [SEED, 1] [WORD ...]

`old_words.tsv` has a row for each instruction and argument of the readers of RAPID, V+ and
PacScript: the language, the word, what it changes, and a statement with it. What a word changes
is judged by the manuals and not by the readers: motion, path, speed, acceleration, frames, axes,
force, timing, outputs, data. `-` stands for words that change nothing of the motion, the outputs
or the time of a program: texts on a screen, files, clocks, cameras. A word that gives data a value
is followed by a motion that depends on the data.

The seed makes 60 programs, 20 of each language: a line, a motion that travels and turns, a turn on
the spot, and an output. They differ in positions, speeds and angles. Each word is dealt to one of
them, and its statement follows the first motion there. The program is built with
`camgen.build` for RAPID with the statement and without its lines that hold the word. An argument
stands in double braces, and is left out alone.

A word has one of four outcomes:

- carried: the two programs differ in an instruction, a comment does not count;
- reported: a note of the build, which is not there without the word, names it or its line;
- refused: the build ends with exit code 2 and one line;
- silent: none of these. Exit code 0, and motion, time and outputs equal those without the word.

A word that changes something must not be silent, and a word that changes nothing must not be
refused. The exit code is 1 if a word that changes something is silent.
"""

from __future__ import annotations

import random
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import camgen
from bench.support.runner import Cells, Scenario, must_be_none, read_words, run

TABLE = Path(__file__).with_suffix(".tsv")
#: Programs of each language.
PROGRAMS = 20
OUTCOMES = ("carried", "reported", "refused", "silent")
#: Marks of arguments beside their word.
_MARKS = "\\=:@"
_ARGUMENT = re.compile(r"\{\{(.*?)\}\}")
_COMMENT = re.compile(r"^\s*!.*$", re.MULTILINE)
#: The outputs of the programs and of the statements, by their names for RAPID.
_SIGNALS = {
    "rapid": ["doGlue", "doOld", "doBeside", "doReal", "aoOld", "goOld"],
    "vplus": ["24", "40", "41", "hand.open"],
    "pacscript": ["24", "40", "41"],
}
_ARMS = {"rapid": "IRB 1200", "vplus": "IRB 1200", "pacscript": "VS-060"}
_SUFFIXES = {"rapid": ".mod", "vplus": ".v2", "pacscript": ".pcs"}


class Row(NamedTuple):
    """A row of the table.

    changes: subject that the word changes, "-" if it leaves motion, outputs and time alone.
    statement: a statement with the word, several lines with a backslash and n between them.
    """

    language: str
    word: str
    changes: str
    statement: str


class Outcome(NamedTuple):
    """The outcome of a word in a program.

    kind: a word of `OUTCOMES`.
    detail: the note or the error that names the word, empty without one.
    """

    row: Row
    kind: str
    detail: str

    @property
    def is_fault(self) -> bool:
        """Whether the word changes something and is silent."""
        return self.kind == "silent" and self.row.changes != "-"

    @property
    def is_needless(self) -> bool:
        """Whether the word changes nothing and is refused."""
        return self.kind == "refused" and self.row.changes == "-"


def read_table() -> list[Row]:
    """The rows of `old_words.tsv`."""
    lines = TABLE.read_text(encoding="ascii").splitlines()[1:]
    return [Row(*line.split("\t")) for line in lines]


# The programs.


def _write_rapid(draw: random.Random, statement: str) -> str:
    end = "[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
    straight = "[0,0,1,0]"
    tilted = "[0,-0.258819,0.9659258,0]"
    x, y, speed = draw.randint(40, 80), draw.randint(10, 40), draw.choice((20, 50, 100))

    def point(place: str, turn: str) -> str:
        return f"[[{place}],{turn},{end}"

    via = point(f"{x + 10},{y + 10},0", tilted)
    frame = "tOld\\WObj:=wOld;"
    return f"""MODULE Old
  PERS tooldata tOld:=[TRUE,[[0,0,100],[1,0,0,0]],[1,[0,0,50],[1,0,0,0],0,0,0]];
  PERS tooldata tOther:=[TRUE,[[0,0,120],[1,0,0,0]],[1,[0,0,50],[1,0,0,0],0,0,0]];
  PERS tooldata tFixed:=[FALSE,[[600,0,500],[1,0,0,0]],[1,[0,0,50],[1,0,0,0],0,0,0]];
  PERS wobjdata wOld:=[FALSE,TRUE,"",[[350,0,150],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
  PERS wobjdata wOther:=[FALSE,TRUE,"",[[350,0,160],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
  PERS wobjdata wHeld:=[TRUE,TRUE,"",[[0,0,150],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
  PERS wobjdata wMoved:=[FALSE,FALSE,"STN_1",[[0,0,0],[1,0,0,0]],[[0,0,250],[1,0,0,0]]];
  CONST jointtarget jHome:=[[0,0,0,0,30,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  VAR num nOld:=1;
  VAR dnum dOld:=1;
  VAR byte byOld:=3;
  VAR pos oOld:=[0,5,0];
  VAR robtarget pOld:={point("0,0,0", straight)};
  VAR jointtarget jOld:=[[0,0,0,0,30,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  VAR triggdata trOld;
  VAR intnum iOld;
  PERS loaddata lOld:=[1,[0,0,50],[1,0,0,0],0,0,0];
  PROC Beside()
    SetDO doBeside,1;
    SetDO doBeside,0;
  ENDPROC
  PROC main()
    MoveAbsJ jHome,v200,fine,{frame}
    SetDO doGlue,0;
    MoveJ {point("0,0,0", straight)},v200,fine,{frame}
    {statement}
    SetDO doGlue,1;
    MoveL {point(f"{x},0,0", straight)},v{speed},fine,{frame}
    MoveL {point(f"{x},{y},0", tilted)},v{speed},fine,{frame}
    MoveC {via},{point(f"{x},{y + 20},0", straight)},v50,fine,{frame}
    MoveL {point(f"{x},{y + 20},0", tilted)},v{speed},fine,{frame}
    SetDO doGlue,0;
    MoveAbsJ jHome,v200,fine,{frame}
  ENDPROC
ENDMODULE
"""


def _write_vplus(draw: random.Random, statement: str) -> str:
    x, y, speed = draw.randint(340, 380), draw.randint(10, 40), draw.choice((20, 50, 100))
    tilt = draw.choice((150, 160, 165))
    return f""".PROGRAM main()
    TOOL TRANS(0,0,100,0,0,0)
    SIGNAL -24
    SPEED {speed} MMPS ALWAYS
    MOVE TRANS(330,0,250,0,180,0)
    BREAK
    {statement}
    BREAK
    SIGNAL 24
    MOVES TRANS({x},0,250,0,180,0)
    MOVES TRANS({x},{y},250,0,180,0)
    BREAK
    SIGNAL -24
    MOVES TRANS({x},{y},250,0,{tilt},0)
    BREAK
    MOVES TRANS({x},{y},280,0,{tilt},0)
    BREAK
.END
.PROGRAM beside()
    SIGNAL 41
    SIGNAL -41
.END
"""


def _write_pacscript(draw: random.Random, statement: str) -> str:
    x, y, speed = draw.randint(340, 380), draw.randint(10, 40), draw.choice((20, 50, 80))
    tilt = draw.choice((150, 160, 165))
    return f"""Sub Main
    Tool 1, P(0, 0, 100, 0, 0, 0)
    Work 1, P(0, 0, 0, 0, 0, 0)
    TakeArm Keep = 1
    ChangeTool 1
    ChangeWork 1
    Speed {speed}
    Reset IO[24]
    Move P, @0 P(330, 0, 250, 180, 0, 0)
    {statement}
    Set IO[24]
    Move L, @0 P({x}, 0, 250, 180, 0, 0)
    Move L, @0 P({x}, {y}, 250, 180, 0, 0)
    Reset IO[24]
    Move L, @0 P({x}, {y}, 250, {tilt}, 0, 0)
    Move L, @0 P({x}, {y}, 280, {tilt}, 0, 0)
    GiveArm
End Sub
Sub Beside
    Set IO[41]
    Reset IO[41]
End Sub
"""


_WRITERS: dict[str, Callable[[random.Random, str], str]] = {
    "rapid": _write_rapid,
    "vplus": _write_vplus,
    "pacscript": _write_pacscript,
}


def deal(seed: int) -> dict[tuple[str, int], list[Row]]:
    """The words of each program. The key is the language and the number of the program."""
    draw = random.Random(seed)
    rows = read_table()
    draw.shuffle(rows)
    numbers: Counter[str] = Counter()
    programs: dict[tuple[str, int], list[Row]] = {}
    for row in rows:
        number = numbers[row.language] % PROGRAMS
        numbers[row.language] += 1
        programs.setdefault((row.language, number), []).append(row)
    return programs


def write_program(language: str, number: int, seed: int, statement: str = "") -> str:
    """The text of a program with a statement after its first motion."""
    draw = random.Random(f"{seed} {language} {number}")
    return _WRITERS[language](draw, statement.replace("\\n", "\n"))


# The outcome of a word.


def _settings(language: str) -> dict[str, dict[str, object]]:
    """The job of the builds."""
    names = {name: f"do_{name.replace('.', '_')}" for name in _SIGNALS[language]}
    return {
        "operation": {"taught_on": _ARMS[language]},
        "post": {"signals": names, "force_calibrated": True},
    }


def _build(text: str, language: str, folder: Path) -> tuple[str, str]:
    """The instructions of the program in RAPID, and the notes. Raises CamgenError for a refusal."""
    file = folder / f"old{_SUFFIXES[language]}"
    file.write_text(text, encoding="ascii")
    result = camgen.build(file, post="rapid", job=_settings(language), name="again")
    instructions = "\n".join(_COMMENT.sub("", each.text) for each in result.files)
    return instructions, "\n".join(map(str, result.notes))


def try_word(row: Row, number: int, seed: int, folder: Path) -> Outcome:
    """The outcome of the word of a row in a program."""
    word = re.escape(row.word.strip(_MARKS) or row.word)
    named = re.compile(rf"(?<![\w.]){word}(?![\w.])", re.IGNORECASE)
    statement = _ARGUMENT.sub(lambda argument: argument[1], row.statement)
    parts = statement.split("\\n")
    rest = "\\n".join(part for part in parts if len(parts) > 1 and not named.search(part))
    if statement != row.statement:
        rest = _ARGUMENT.sub("", row.statement)
    text = write_program(row.language, number, seed, statement)
    try:
        instructions, notes = _build(text, row.language, folder)
    except camgen.CamgenError as error:
        return Outcome(row, "refused", str(error))
    try:
        plain, plain_notes = _build(
            write_program(row.language, number, seed, rest), row.language, folder
        )
    except camgen.CamgenError:
        return Outcome(row, "carried", "without the word the program is refused")
    if instructions != plain:
        return Outcome(row, "carried", "")
    lines = [k for k, line in enumerate(text.splitlines(), start=1) if line.strip() in parts]
    places = re.compile(rf"\bline ({'|'.join(map(str, lines))})\b")
    for note in sorted(set(notes.splitlines()) - set(plain_notes.splitlines())):
        if named.search(note) or places.search(note):
            return Outcome(row, "reported", note)
    return Outcome(row, "silent", "")


def try_all(seed: int, words: set[str]) -> Iterator[Outcome]:
    """The outcomes of the words of all programs.

    words: words to judge in lower case, empty for all.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for (_, number), rows in deal(seed).items():
            for row in rows:
                if not words or row.word.lower() in words:
                    yield try_word(row, number, seed, folder)


def sum_up(outcomes: list[Outcome], language: str) -> Iterator[Cells]:
    """The rows of a language: words that change something, and words that change nothing."""
    for title, changes in (("changes something", True), ("changes nothing", False)):
        group = [
            outcome
            for outcome in outcomes
            if outcome.row.language == language and (outcome.row.changes != "-") == changes
        ]
        counts = Counter(outcome.kind for outcome in group)
        faults = sum(outcome.is_fault for outcome in group)
        needless = sum(outcome.is_needless for outcome in group)
        shown = [counts[kind] for kind in OUTCOMES]
        yield language, title, len(group), *shown, must_be_none(faults), needless


def main() -> int:
    """The tables."""
    seed, *words = read_words(1)
    wanted = {word.lower() for word in words}
    outcomes = list(try_all(seed, wanted))
    rows = [("rapid",), ("vplus",), ("pacscript",)]
    columns = (
        "language | words | count {} | carried {} | reported {} | refused {} | silent {} | "
        "silent faults | refused without need {}"
    )
    scenarios = [Scenario(columns, rows, lambda language: sum_up(outcomes, language))]
    rows_to_list = [
        outcome for outcome in outcomes if outcome.is_fault or outcome.is_needless or wanted
    ]

    def list_faults(language: str) -> Iterator[Cells]:
        for outcome in rows_to_list:
            if outcome.row.language == language:
                yield language, outcome.row.word, outcome.row.changes, outcome.kind, outcome.detail

    scenarios.append(Scenario("language | word | changes | outcome | detail", rows, list_faults))
    return run(*scenarios, note=f", 60 programs, seed {seed}")


if __name__ == "__main__":
    sys.exit(main())
