"""Damaged PacScript programs are read alike both ways, whatever has become of them."""

import random
import re
from unittest.mock import patch

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.damage import damaged, one_sign_changed
from tests.support.examples import fewer, is_night
from tests.support.pacscript_ways import (
    BY_HAND,
    CALLED,
    LONG_S,
    MOVED,
    PARTS,
    PERCENT,
    TEXTS,
    check,
    short_lines,
)

STATEMENTS = (
    """TakeArm|TakeArm Keep = 0|GiveArm|Speed 50|Speed Mps(0.03)|Speed v|ExtSpeed 20|ExtSpeed 0|Accel 50|ChangeWork 2
ChangeTool 1|Work 1, P(1, 2, 3)|Tool 2, P(0, 0, 100)|ForceParam 1, 2, P(0, 5, 0)|ForceParam 2, 2, P(0, 0, -3)
ForceCtrl True, 1|ForceCtrl True, 2|ForceCtrl False|Call PressOn(1, 0.000, 8.000, 0.000)|Call PressOff|Delay 200|Delay 5
Call PressTo(8.000, 0.000, 8.000, 0.000)|Set IO[24]|Reset IO[24]|Set IO[v]|v = 3|v = v + 1|Dim v As Integer = 7
P5 = P(1, 2, 3)|Move L, @0 P5|Move L, P[5], Speed = Mps(v)|Move P, J(1, 2, 3)|Draw L, V(1, 2, 3)|Depart L, 5
Approach P, P(1, 2, 3), 5|If v = 1 Then|If v = 1 Then v = 2|End If|EndIf|For v = 1 To 3|Next|Do|Loop|Select Case v
End Select|Sub Other|Sub x(v)|End Sub|Function y|End Function|Exit Sub|Call Other(2)|Call x(1)|Call Main|#Define L P
#Define Move Draw|#Define P J|#Define v 3|#Define a b|#Define h 2.000|#Define Speed Decel|#Define mps v|#Undef L|Rem x
Rem Move L, P(1.0, 2.0, 3.0)|' Move|Move L, P(1.0, 2.0, 3.0), Next|Move L, @P P(1.0, 2.0, 3.0), Speed = 101|*a:|GoTo *a
Move L, P(1.0, 2.0, 3.0), Speed = 0.01|Move C, P(1.0, 2.0, 3.0)|Move L, @0 P(1.0, 2.0, 3.0), @P P(2.0, 2.0, 3.0)
1 2.0 3.0 4.0|ſtop|STOP|Move L, @P P(1.000, 2.000, 3.000), Speed = Mps(0.02)|Frobnicate 5|IO[24] = On|:
""".strip()
    .replace("\n", "|")
    .split("|")
)
NUMBERS = [
    "-0",
    "0",
    "-0.0",
    "-0.000",
    "00.5",
    "007",
    "1.",
    ".5",
    "1e3",
    "+1.0",
    "--1.0",
    "1234567890.0",
    "",
    " 1.0",
]
NUMBERS += [
    "123456789.5",
    "0.1234567891",
    "h",
    "v",
    "1/2",
    "9" * 60,
    "9" * 60 + ".5",
    "1 ",
    "\t2.0",
    "1.0",
    "&HF",
    "１.0",
]
NUMBERS += [
    "1.0.0",
    "1 2",
    "-",
    ".",
    "1,",
    "1, 2",
    "1.0, 2.0, 3.0, 4.0, 5.0",
    "(1.0)",
    "180",
    "3.25",
]
WORDS = [
    "Move",
    "move",
    "L",
    "P",
    "C",
    "l",
    "S",
    "PTP",
    "T",
    "J",
    "Speed",
    "S",
    "speed",
    "Mps",
    "MPS",
    "Accel",
    "Next",
]
WORDS += ["Sub", "End", "Other", "v", "h", "IO", "ſpeed"]
MARKS = [
    "@0",
    "@P",
    "@E",
    "@p",
    "@e",
    "@5",
    "@10",
    "@007",
    "@[5]",
    "@5.5",
    "@Q",
    "@",
    "@ 0",
    "@0,",
    "@-1",
    "@1234567",
]
SIGNS = [
    *"0159.,-+eE()@:;\" '\t\r\n\v\fMOVESPLCmoveslp=#[]_&",
    "\r\n",
    "\n\r",
    "\x00",
    "\x85",
    "\u2028",
    "é",
    "K",
]
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
WORD = re.compile(r"[A-Za-z]+")
MARK = re.compile(r"@\w+")


def changed_line(line: str, chance: random.Random) -> str:
    """One line with one thing changed."""
    kind = chance.randrange(9)
    if kind < 4:
        pattern, news = chance.choice(
            [(NUMBER, NUMBERS), (NUMBER, NUMBERS), (WORD, WORDS), (MARK, MARKS)]
        )
        if places := list(pattern.finditer(line)):
            place = chance.choice(places)
            return line[: place.start()] + chance.choice(news) + line[place.end() :]
    if kind == 4:
        return chance.choice([line.lower(), line.upper(), line.swapcase(), line.title()])
    if kind == 5:
        return chance.choice(
            [" ", "\t", "", "' ", "#", "\v", " " * 40, " " * 300, " " * 1100]
        ) + line.lstrip(" ")
    if kind == 6:
        return line + chance.choice(
            [" ", "\t", " ' a remark", "'", ' "', ", Next", ")", ",", "\x85", ", Accel = 50"]
        )
    return one_sign_changed(line, chance, SIGNS)


def files_of(text: str, chance: random.Random) -> dict[str, str]:
    """The text as one file, or cut anywhere into two, the second one with a Main of its own or not."""
    at = chance.randrange(len(text) + 1)
    if chance.random() < 0.7:
        return {"a.pcs": text}
    return {
        "a.pcs": text[:at],
        "Other.pcs": chance.choice(["", "Sub Main\n", "Sub Main(h)\n"]) + text[at:],
    }


@fewer(12)
@given(
    st.randoms(use_true_random=True),
    st.sampled_from(TEXTS),
    st.sampled_from([None, None, None, 5, 17, 30]),
)
def test_damaged_texts_are_read_alike(
    chance: random.Random, source: tuple[str, dict[str, object]], steps: int | None
) -> None:
    """steps: after so many statements a program counts as endless."""
    text, options = source
    files = files_of(damaged(text, chance, STATEMENTS, changed_line), chance)
    with patch(PARTS + "pacscript._STEPS", steps or 2000):
        check(files, options)


@pytest.mark.parametrize("statement", STATEMENTS)
def test_every_statement_beside_motions(statement: str) -> None:
    """At each place, and with all options; at night with all options at each place."""
    rows = BY_HAND.split("\n")
    places = (0, 3, 8, 11, 15, 23, 26, 28, 33)
    for number, options in enumerate((PERCENT, CALLED, MOVED, LONG_S, {})):
        for k in places if is_night() or not options else places[number::4]:
            check({"a.pcs": "\n".join([*rows[:k], statement, *rows[k:]])}, options)


#: Lines of a program before and after a motion that is put in.
BEFORE, AFTER = BY_HAND.split("\n")[:9], BY_HAND.split("\n")[10:12] + BY_HAND.split("\n")[34:36]


def test_the_motion_of_many_spellings_is_read_at_once() -> None:
    assert short_lines("\n".join([*BEFORE, *AFTER])) >= 4
    assert AFTER[-1] == "End Sub"


@pytest.mark.parametrize("spelling", [*NUMBERS, *WORDS, *MARKS])
def test_every_spelling_within_a_motion(spelling: str) -> None:
    straight, arc = (
        row.strip() for row in BY_HAND.split("\n") if "-0.000" in row or "@P P(20" in row
    )
    for row in (straight, arc):
        for pattern in (NUMBER, WORD, MARK):
            for place in pattern.finditer(row):
                changed = row[: place.start()] + spelling + row[place.end() :]
                check({"a.pcs": "\n".join([*BEFORE, changed, *AFTER])}, PERCENT)
