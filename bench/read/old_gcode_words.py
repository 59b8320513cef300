"""Old programs in G-code, one for each word of each dialect.

python -m bench.read.old_gcode_words [DIALECT ...]

Programs of lathes are refused whole, so that dialect is left out. The words are the codes of the
tables in camgen/lang/gcode/dialects.py and the letters A to Z.
Each word has a line in the middle of a sound program, with the arguments that its manual asks for,
and the program is built for RAPID. The same program is built without the line.
A word is

- read: the two programs differ;
- reported: a note names the word;
- refused: the build ends with one line, and the program without the word is built;
- without effect: ``WITHOUT_EFFECT`` has it with a reason;
- silent: none of these. A silent word was dropped.
"""

from __future__ import annotations

import itertools
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from string import ascii_uppercase
from typing import NamedTuple

import camgen
from bench.support.runner import Cells, Missed, Scenario, run
from camgen.lang.gcode.dialects import DIALECTS, Dialect

COLUMNS = "dialect | words {} | read {} | reported {} | refused {} | without effect {} | silent"

#: Codes that neither move, switch, wait nor change a later motion of ``_PROGRAM``, by reason.
WITHOUT_EFFECT = {
    "the state in which the program already is": (
        "G1 G17 G21 G40 G49 G54 G64 G69 G71 G80 G90 G91.1 G92.1 G92.2 G92.3 G94 G97 M9 M48 G40.1"
    ),
    "a mode that a later line of the program sets": "G0 G67 G99 G98",
    "switches a function off that is off": "G15 G50 G50.1 G23 M53 M52 M51",
    "how many lines the controller reads ahead, not where it goes": "G5.1 G8 G103",
    "a place or state that is kept and never used": "G28.1 G30.1 M70 M71 M73",
    "a number of a line or a program, and a tool that is made ready and never changed to": (
        "N O T"
    ),
    "the printer's motors and files": (
        "M17 M18 M20 M21 M22 M23 M24 M25 M26 M27 M28 M29 M31 M73 M75 M76 M77 M78 M82 M83 M84 M85"
    ),
}
#: Names of the outputs of the robot for what a program switches.
SIGNALS = {"spindle": "aoSpindle", "dout1": "doOne", "aout1": "aoOne"}
_EFFECTLESS = set(" ".join(WITHOUT_EFFECT.values()).split())

#: The arguments of codes that need some, from the manuals that ``Dialect.source`` names.
_ARGUMENTS = {
    "G2": "X10 Y10 I5 J5 F200",
    "G3": "X10 Y10 I5 J5 F200",
    "G4": "P1",
    "G5": "I1 J1 P-1 Q1 X10 Y5",
    "G5.1": "X10 Y5 I3 J3",
    "G5.2": "P1 X5 Y5",
    "G10": "L2 P1 X3",
    "G12": "I4 F200",
    "G13": "I4 F200",
    "G28": "Z5",
    "G30": "Z5",
    "G31": "Z-3 F100",
    "G33": "Z-3 K1",
    "G33.1": "Z-3 K1",
    "G32": "Z-3 F1",
    "G38.2": "Z-3 F100",
    "G38.3": "Z-3 F100",
    "G38.4": "Z-3 F100",
    "G38.5": "Z-3 F100",
    "G41": "D1",
    "G42": "D1",
    "G41.1": "D2",
    "G42.1": "D2",
    "G43": "H1",
    "G43.1": "Z2",
    "G43.2": "H1",
    "G52": "X3",
    "G53": "G0 Z0",
    "G65": "P9100",
    "G66": "P9100",
    "G68": "X0 Y0 R30",
    "G73": "X5 Y5 Z-2 R1 Q1 F100",
    "G74": "X5 Y5 Z-2 R1 F100",
    "G76": "P1 Z-2 I-1 J0.2 K0.5",
    "G81": "X5 Y5 Z-2 R1 F100",
    "G82": "X5 Y5 Z-2 R1 P1 F100",
    "G83": "X5 Y5 Z-2 R1 Q1 F100",
    "G84": "X5 Y5 Z-2 R1 F100",
    "G85": "X5 Y5 Z-2 R1 F100",
    "G86": "X5 Y5 Z-2 R1 P1 F100",
    "G87": "X5 Y5 Z-2 R1 I1 J1 K1 F100",
    "G88": "X5 Y5 Z-2 R1 P1 F100",
    "G89": "X5 Y5 Z-2 R1 P1 F100",
    "G92": "X3",
    "G93": "",
    "G96": "S100 D2000",
    "M6": "T2",
    "M19": "R90",
    "M61": "Q2",
    "M62": "P1",
    "M63": "P1",
    "M64": "P1",
    "M65": "P1",
    "M66": "P1 L0",
    "M67": "E1 Q5",
    "M68": "E1 Q5",
    "M97": "P900",
    "M98": "P9100",
}
_PROGRAM = """\
G21 G90 G17
{change}M3 S8000
G0 X0 Y0 Z5
G1 Z-1 F200
G1 X5 F300
{line}G1 X20 Y0 F300
G1 X25 Y0
G3 X30 Y5 I0 J5
G1 X30 Y10
G0 Z5
M5
M30
"""
#: The whole line with each letter, if it has no motion.
_LETTER_LINES = {"G": "G61", "M": "M64 P1", "N": "N100", "O": "O100", "T": "T2", "S": "S500"}


class Outcome(NamedTuple):
    """The result of a build.

    text: the program, "" if it is refused.
    words: its notes, and the message of a refusal.
    """

    text: str
    words: str


def build(dialect: str, text: str, folder: Path) -> Outcome:
    """Builds ``text`` for RAPID."""
    path = folder / "old.nc"
    path.write_text(text)
    job = {
        "input": {"dialect": dialect},
        "post": {"signals": SIGNALS},
        "tolerance": {"corner": 0.1},
    }
    try:
        result = camgen.build(path, post="rapid", job=job, name="old")
    except camgen.CamgenError as error:
        return Outcome("", str(error))
    motion = [line for line in result.text.splitlines() if not line.lstrip().startswith("!")]
    return Outcome("\n".join(motion), "\n".join(map(str, result.notes)))


def lines_of(dialect: Dialect) -> Iterator[tuple[str, str]]:
    """Each word of a dialect, and a line that holds it."""
    for code in sorted({*dialect.codes, *dialect.idle, *dialect.names}):
        yield code, f"{code} {_ARGUMENTS.get(code, '')}".rstrip()
    for letter in ascii_uppercase:
        yield f"word {letter}", _LETTER_LINES.get(letter, f"G1 X12 {letter}7.5 F300")


def classify(
    word: str, line: str, dialect: Dialect, plain: Outcome, template: str, folder: Path
) -> str:
    """The name of the column that a word belongs to."""
    outcome = build(dialect.name, template.format(line=line + "\n"), folder)
    code = word.removeprefix("word ")
    if not outcome.text:
        return "refused"
    if code in outcome.words and outcome.words != plain.words:
        return "reported"
    if outcome.text != plain.text:
        return "read"
    return "without effect" if code in _EFFECTLESS else "silent"


def measure(name: str) -> Iterator[Cells]:
    """The row of a dialect."""
    dialect, counts, silent = DIALECTS[name], dict.fromkeys(_KINDS, 0), []
    change = "T1 M6\n" if "M6" in dialect.codes else ""
    template = _PROGRAM.replace("{change}", change)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        plain = build(name, template.format(line=""), folder)
        letter_plain = build(name, template.format(line="G1 X12 F300\n"), folder)
        for word, line in lines_of(dialect):
            without = letter_plain if line.startswith("G1 X12 ") else plain
            kind = classify(word, line, dialect, without, template, folder)
            counts[kind] += 1
            silent += [word] if kind == "silent" else []
    cell = Missed(", ".join(silent)) if silent else "0"
    yield name, sum(counts.values()), *itertools.islice(counts.values(), 4), cell


_KINDS = ("read", "reported", "refused", "without effect", "silent")


if __name__ == "__main__":
    names = sys.argv[1:] or [name for name in DIALECTS if name != "fanuc-lathe"]
    sys.exit(run(Scenario(COLUMNS, [(name,) for name in names], measure)))
