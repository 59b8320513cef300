"""Changes of a program text, one at a time: its tokens and its lines changed, dropped, doubled, swapped."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple
from zlib import crc32


class Language(NamedTuple):
    """comment: what one looks like. words: some of the language, of which others are put into their place. gcode: a
    letter and its number are one token.
    """

    comment: str
    words: tuple[str, ...]
    gcode: bool = False


class Edit(NamedTuple):
    """``text[begin:end]`` becomes ``new``."""

    begin: int
    end: int
    new: str


class Mutation(NamedTuple):
    """Edits of a text that are made together.

    kind: name of the change, for the list of mutants
    edits: changes in order of their place; none overlaps another
    """

    kind: str
    edits: tuple[Edit, ...]

    def apply(self, text: str) -> str:
        """The mutant."""
        parts: list[str] = []
        last = 0
        for edit in self.edits:
            parts += (text[last : edit.begin], edit.new)
            last = edit.end
        return "".join((*parts, text[last:]))


def single(kind: str, begin: int, end: int, new: str = "") -> Mutation:
    """The mutation of one place."""
    return Mutation(kind, (Edit(begin, end, new),))


class Token(NamedTuple):
    """A word, a number, a sign, a text, a comment or the end of a line."""

    begin: int
    end: int
    text: str
    kind: str


_RAPID = """
    MoveAbsJ MoveJ MoveL MoveC FCPress1LStart FCPressL FCPressC FCPressEnd FCCalib FCDeact SetDO SetAO WaitTime ConfJ
    ConfL On Off SingArea AccSet VelSet PROC ENDPROC MODULE ENDMODULE ERROR RAISE RETURN Stop EXIT IF THEN ENDIF TASK
    PERS CONST VAR LOCAL tooldata wobjdata speeddata zonedata robtarget num TRUE FALSE fine z0 z5 z50 v5 v100 v1000
    vmax tool0 wobj0 WObj Fx Fz InPos Conc Set Reset TPWrite"""
_PACSCRIPT = """
    Move P L C J Set Reset IO Delay Speed Accel Decel ExtSpeed ChangeTool ChangeWork TakeArm GiveArm Keep Motor On Off
    Sub Main End Exit If Then Else And Or Dim As Single Integer Mps Call ForceCtrl ForceParam True False Approach Depart
    Draw Drive Tool Work Next Wait Hold Stop For Loop GoTo Rem"""
_VPLUS = """
    MOVE MOVES APPRO APPROS DEPART DEPARTS BREAK SPEED ACCEL MMPS IPS MONITOR ALWAYS SET TRANS TOOL BASE NULL SIGNAL
    WAIT.EVENT ATTACH DETACH SELECT ROBOT ENABLE DISABLE CP LEFTY RIGHTY ABOVE BELOW FLIP NOFLIP SINGLE MULTIPLE COARSE
    FINE NONULL AUTO LOCAL GLOBAL REAL CALL RETURN PAUSE STOP DRIVE READY .PROGRAM .END HERE DURATION"""
_RS274 = """
    G0 G1 G2 G3 G4 G17 G18 G19 G20 G21 G28 G40 G41 G43 G49 G53 G54 G55 G61 G64 G80 G81 G83 G90 G90.1 G91 G91.1 G92 G93
    G94 G95 G98 G99 M0 M1 M2 M3 M4 M5 M6 M7 M8 M9 M30 M62 M64 M65 M66 M68 T2 F10 S100 P1"""
LANGUAGES = {
    "rapid": Language(r"![^\n]*", tuple(_RAPID.split())),
    "pacscript": Language(r"'[^\n]*", tuple(_PACSCRIPT.split())),
    "vplus": Language(r";[^\n]*", tuple(_VPLUS.split())),
    "gcode": Language(r"\([^)\n]*\)|;[^\n]*", tuple(_RS274.split()), True),
    "grbl": Language(r"\([^)\n]*\)|;[^\n]*", tuple(_RS274.split()), True),
}
_SIGNS = ",;:=()[]-+*/\\@.<>'\"!%"
_PLAIN = r"(?P<number>\d+\.?\d*(?:[eE][+-]?\d+)?)|(?P<word>[.$#]?[A-Za-z_][\w.]*)"
_GCODE = r"(?P<word>[A-Za-z][+-]?[\d.]+)|(?P<number>\d[\d.]*)"


def tokens(text: str, language: Language) -> list[Token]:
    """All of a text, blanks left out."""
    kinds = _GCODE if language.gcode else _PLAIN
    pattern = rf'(?P<comment>{language.comment})|(?P<text>"[^"\n]*")|{kinds}|(?P<newline>\n)|(?P<sign>[^ \t])'
    return [Token(m.start(), m.end(), m[0], str(m.lastgroup)) for m in re.finditer(pattern, text)]


def edits(text: str, language: Language) -> list[Mutation]:
    """Every change of a text, in order, none of which leaves it as it is."""
    found = tokens(text, language)
    made: list[Mutation] = []
    for k, token in enumerate(found):
        place = token.begin, token.end
        made += (single("changed", *place, new) for new in replacements(token, language))
        made.append(single("dropped", *place))
        blank = " " if token.kind in ("number", "word") else ""
        made.append(single("doubled", *place, f"{token.text}{blank}{token.text}"))
        made += _swaps(text, found, k)
    made += _lines(text)
    return [change for change in dict.fromkeys(made) if change.apply(text) != text]


def replacements(token: Token, language: Language) -> Iterator[str]:
    """Texts that replace a token: other digits, signs, words and names."""
    text, pick = token.text, crc32(f"{token.begin} {token.text}".encode())
    if token.kind in ("number", "word") and re.search(r"\d", text):
        yield from _digits(text)
    if token.kind == "number":
        yield f"-{text}"
    if token.kind == "word":
        yield language.words[pick % len(language.words)]
        yield text.swapcase()
        if language.gcode:
            sign = text[1] in "+-"
            yield text[0] + ("" if text[1] == "-" else "-") + text[1 + sign :]
            yield "XYZIJFSPQRTGM"[pick % 13] + text[1:]
        else:
            yield language.words[(pick // 7 + 3) % len(language.words)]
            yield text + text[-1]
            yield text[:-1] + ("a" if text[-1] != "a" else "b")
    if token.kind == "sign":
        yield _SIGNS[pick % len(_SIGNS)]
    if token.kind in ("comment", "text"):
        middle = len(text) // 2
        yield text[:middle] + "x" + text[middle:]
    if token.kind == "newline":
        yield " "


def _digits(text: str) -> Iterator[str]:
    """The first, a middle and the last digit raised by one, 9 to 0; the point left out."""
    places = [k for k, mark in enumerate(text) if mark.isdigit()]
    for k in sorted({places[0], places[len(places) // 2], places[-1]}):
        yield f"{text[:k]}{(int(text[k]) + 1) % 10}{text[k + 1 :]}"
    if "." in text.strip("."):
        yield text.replace(".", "")


def _swaps(text: str, found: list[Token], k: int) -> Iterator[Mutation]:
    """A token and the one after it, and the next of its kind in the line where that is another."""
    one = found[k]
    for j in range(k + 1, len(found)):
        two = found[j]
        if j == k + 1 or (two.kind == one.kind and two.text != one.text):
            between = text[one.end : two.begin]
            yield single("swapped", one.begin, two.end, two.text + between + one.text)
        if (
            (j > k + 1 and two.kind == one.kind)
            or "newline" in (one.kind, two.kind)
            or one.kind == "sign"
        ):
            return


def _lines(text: str) -> Iterator[Mutation]:
    """Whole lines dropped, doubled, and swapped with the next."""
    lines = re.findall(r"[^\n]*\n", text)
    begin = 0
    for k, line in enumerate(lines):
        end = begin + len(line)
        yield single("dropped", begin, end)
        yield single("doubled", begin, end, line + line)
        if k + 1 < len(lines):
            yield single("swapped", begin, end + len(lines[k + 1]), lines[k + 1] + line)
        begin = end
