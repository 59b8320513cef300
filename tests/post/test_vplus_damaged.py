"""Damaged V+ programs are read alike both ways, whatever has become of them."""

import random
import re
from unittest.mock import patch

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.damage import damaged, one_sign_changed
from tests.support.examples import fewer
from tests.support.vplus_ways import BY_HAND, PARTS, TEXTS, check

STATEMENTS = (
    """BREAK|SPEED 50|SPEED 30, 100 MMPS ALWAYS|SPEED 10 MMPS|SPEED 2 IPS ALWAYS|SPEED 5 MONITOR|SPEED v ALWAYS
v = 3|v = v+1|SPEED 0|SPEED 1,0 MMPS|SPEED MMPS|DISABLE CP|ENABLE CP|SET wf = TRANS(1,2,3)|SET cg.work = a:b
SET a = HERE|SET cg.work = NULL:TRANS(1)|SET cg.work = TRANS(250,-75,150,0,0,0)|AUTO cg.work|GLOBAL wf|LOCAL v
.END|.PROGRAM x()|.PROGRAM sub(a)|.DATA|CALL sub()|CALL part.1()|CALL x()|FOR v = 1 TO 3|FOR v = 3 TO 1|END|RETURN
IF v THEN|DO|UNTIL v|TOOL wf|TOOL cg.tool|BASE|BASE 1|SIGNAL 33|SIGNAL -v|SIGNAL 1500|SIGNAL 7 8|WAIT.EVENT , 0.5
WAIT.EVENT , v|WAIT.EVENT 3|DELAY 1|DEPARTS 5|DEPART v|APPRO wf:TRANS(1,2,3,0,180,180), 9|MOVE #PPOINT(1,2,3,4)
MOVES #PPOINT(1,2,3,4)|MOVE HERE:TRANS(1,2,3,0,0,0)|MOVES dest:TRANS(1,2,3,0,0,0)|MOVES TRANS(1,2,3,0,180,180)
MOVES transb:TRANS(1,2,3,0,180,180)|MOVE NULL:TRANS(1,2,3,0,180,180)|MOVES wf:TRANS(0,0,0,0,0,0):TRANS(1,2,3,0,0,0)
DRIVE 1, 2|FROBNICATE|TYPE "MOVES wf:TRANS(1,2,3,0,180,180)"|a_very_long_name_1 = 2|a_very_long_name_2 = 2|HALT
DETACH ()|ATTACH ()|ATTACH (1)|SELECT ROBOT = 2|COARSE 50 ALWAYS|FINE|NULL|NULL 3|ACCEL 50|ACCEL (9) 1, 2|FLIP|RIGHTY
7 BREAK|07 BREAK|SPEED 200|SIGNAL 10000|MOVE #PPOINT(1,2,3,4,5,6)|.END foo|.PROGRAM move()|LOCAL v, v
MOVES wf:TRANS(1,2,3,0,90,0)|DISABLE CP
""".strip()
    .replace("\n", "|")
    .split("|")
)
NAMES = [
    "cg.work",
    "CG.WORK",
    "wf",
    "other",
    "Wf",
    "p",
    "p.1",
    "v",
    "a_very_long_name_1",
    "a_very_long_name_2",
    "here",
]
NAMES += [
    "DEST",
    "NULL",
    "TRANS",
    "a.very_long.nam",
    "A.very_long.name",
    "pen",
    "#p",
    "1a",
    "wf:wf",
    "é",
]
NUMBERS = [
    "-0",
    "0",
    "-0.0",
    "00",
    "007",
    "1.",
    ".5",
    "1e3",
    "1E-3",
    "+1",
    "--1",
    "0.0000000001",
    "123456789",
    "",
    " 1",
]
NUMBERS += [
    "1234567890",
    "-5.25",
    "1/2",
    "v",
    "99999999999999999999",
    "1 ",
    "\t2",
    "１",
    "0x1",
    "-",
    "180",
    "0.1234567891",
]
SIGNS = [
    *'0159.,-+eE():;" \t\r\n\v\fMOVESTRANSmovestrans=#$_',
    "\r\n",
    "\n\r",
    "\x00",
    "\x85",
    "\u2028",
    "é",
    "ſ",
    "K",
]
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
NAME = re.compile(r"[A-Za-z][A-Za-z0-9._]*")


def changed_line(line: str, chance: random.Random) -> str:
    """One line with one thing changed."""
    places = list((NUMBER if chance.random() < 0.6 else NAME).finditer(line))
    kind = chance.randrange(8)
    if kind < 3 and places:
        place = chance.choice(places)
        new = chance.choice(
            NUMBERS if place[0][0] in "-0123456789" else [*NAMES, "MOVE", "MOVES", "TRANS", "moves"]
        )
        return line[: place.start()] + new + line[place.end() :]
    if kind == 3:
        return chance.choice([line.lower(), line.upper(), line.swapcase(), line.title()])
    if kind == 4:
        return chance.choice([" ", "\t", "100 ", "70000 ", "", "; ", ". ", "\v"]) + line.lstrip(" ")
    if kind == 5:
        return line + chance.choice(
            [" ", "\t", " ; a remark", ";", ' "', ":NULL", ")", ",", "\x85", "\f"]
        )
    return one_sign_changed(line, chance, SIGNS)


def files_of(text: str, chance: random.Random) -> dict[str, str]:
    """The text as one file, or cut anywhere into two."""
    at = chance.randrange(len(text) + 1)
    return {"a": text} if chance.random() < 0.7 else {"a": text[:at], "b": text[at:]}


@fewer(12)
@given(
    st.randoms(use_true_random=True),
    st.sampled_from(TEXTS),
    st.sampled_from([None, None, None, -60, -15, 0, 30]),
)
def test_damaged_texts_are_read_alike(
    chance: random.Random, source: tuple[str, dict[str, object]], looped: int | None
) -> None:
    """looped: how many instructions the loops may add, fewer than none included, so that the count ends within."""
    text, options = source
    files = files_of(damaged(text, chance, STATEMENTS, changed_line), chance)
    if looped is None:
        check(files, options)
    else:
        with patch(PARTS + "vplus._LOOPED", looped):
            check(files, options)


@pytest.mark.parametrize("place", ["before", "within", "after"])
@pytest.mark.parametrize("statement", STATEMENTS)
def test_every_statement_beside_a_stretch(statement: str, place: str) -> None:
    lines = ["    MOVES wf:TRANS(1,2,3,0,180,180)", "    MOVES wf:TRANS(2,2,3,0,180,180)"]
    lines.insert({"before": 0, "within": 1, "after": 2}[place], statement)
    joint = [line.replace("MOVES", "MOVE") for line in lines]
    for rows in (lines, joint, [*joint, *lines]):
        text = BY_HAND.replace("    DEPARTS 5\n", "\n".join(rows) + "\n    DEPARTS 5\n")
        assert text != BY_HAND
        check({"a": text}, {})


@pytest.mark.parametrize("spelling", NUMBERS + NAMES)
def test_every_spelling_within_a_stretch(spelling: str) -> None:
    for old in ("9.5", "0", "wf"):
        text = BY_HAND.replace(
            "MOVES wf:TRANS(7,8,9.5,0,180,180)",
            "MOVES wf:TRANS(7,8,9.5,0,180,180)".replace(old, spelling),
        )
        check({"a": text}, {})
