"""Changes of a program text, one at a time.

A token or a line is changed, dropped, doubled or swapped.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple
from zlib import crc32


class Language(NamedTuple):
    """Tokens of a language.

    comment: pattern of a comment
    words: words of the language, which replace other words
    is_gcode: whether a letter and its number are one token
    """

    comment: str
    words: tuple[str, ...]
    is_gcode: bool = False


class Edit(NamedTuple):
    """The replacement of `text[begin:end]` by `new`."""

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


def change_place(kind: str, begin: int, end: int, new: str = "") -> Mutation:
    """A mutation of one place."""
    return Mutation(kind, (Edit(begin, end, new),))


class Token(NamedTuple):
    """A word, a number, a sign, a text, a comment or the end of a line."""

    begin: int
    end: int
    text: str
    kind: str


_RAPID = """
    MoveAbsJ MoveJ MoveL MoveC FCPress1LStart FCPressL FCPressC FCPressEnd FCCalib FCDeact SetDO
    SetAO WaitTime ConfJ ConfL On Off SingArea AccSet VelSet PROC ENDPROC MODULE ENDMODULE ERROR
    RAISE RETURN Stop EXIT IF THEN ENDIF TASK PERS CONST VAR LOCAL tooldata wobjdata speeddata
    zonedata robtarget num TRUE FALSE fine z0 z5 z50 v5 v100 v1000 vmax tool0 wobj0 WObj Fx Fz
    InPos Conc Set Reset TPWrite"""
_PACSCRIPT = """
    Move P L C J Set Reset IO Delay Speed Accel Decel ExtSpeed ChangeTool ChangeWork TakeArm
    GiveArm Keep Motor On Off Sub Main End Exit If Then Else And Or Dim As Single Integer Mps
    Call ForceCtrl ForceParam True False Approach Depart Draw Drive Tool Work Next Wait Hold
    Stop For Loop GoTo Rem"""
_VPLUS = """
    MOVE MOVES APPRO APPROS DEPART DEPARTS BREAK SPEED ACCEL MMPS IPS MONITOR ALWAYS SET TRANS
    TOOL BASE NULL SIGNAL WAIT.EVENT ATTACH DETACH SELECT ROBOT ENABLE DISABLE CP LEFTY RIGHTY
    ABOVE BELOW FLIP NOFLIP SINGLE MULTIPLE COARSE FINE NONULL AUTO LOCAL GLOBAL REAL CALL
    RETURN PAUSE STOP DRIVE READY .PROGRAM .END HERE DURATION"""
_RS274 = """
    G0 G1 G2 G3 G4 G17 G18 G19 G20 G21 G28 G40 G41 G43 G49 G53 G54 G55 G61 G64 G80 G81 G83 G90
    G90.1 G91 G91.1 G92 G93 G94 G95 G98 G99 M0 M1 M2 M3 M4 M5 M6 M7 M8 M9 M30 M62 M64 M65 M66
    M68 T2 F10 S100 P1"""
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


def list_tokens(text: str, language: Language) -> list[Token]:
    """All tokens of a text. Blanks are left out."""
    kinds = _GCODE if language.is_gcode else _PLAIN
    outer = rf'(?P<comment>{language.comment})|(?P<text>"[^"\n]*")'
    pattern = rf"{outer}|{kinds}|(?P<newline>\n)|(?P<sign>[^ \t])"
    tokens = []
    for match in re.finditer(pattern, text):
        tokens.append(Token(match.start(), match.end(), match[0], str(match.lastgroup)))
    return tokens


def list_mutations(text: str, language: Language) -> list[Mutation]:
    """All changes of a text, in order, without those that leave it as it is."""
    tokens = list_tokens(text, language)
    mutations: list[Mutation] = []
    for number, token in enumerate(tokens):
        place = token.begin, token.end
        for new in list_replacements(token, language):
            mutations.append(change_place("changed", *place, new))
        mutations.append(change_place("dropped", *place))
        blank = " " if token.kind in ("number", "word") else ""
        mutations.append(change_place("doubled", *place, f"{token.text}{blank}{token.text}"))
        mutations += _swap_tokens(text, tokens[number:])
    mutations += _change_lines(text)
    return [mutation for mutation in dict.fromkeys(mutations) if mutation.apply(text) != text]


def list_replacements(token: Token, language: Language) -> Iterator[str]:
    """Texts that replace a token: other digits, signs, words and names."""
    text = token.text
    checksum = crc32(f"{token.begin} {text}".encode())
    if token.kind in ("number", "word") and re.search(r"\d", text):
        yield from _change_digits(text)
    if token.kind == "number":
        yield f"-{text}"
    if token.kind == "word":
        yield language.words[checksum % len(language.words)]
        yield text.swapcase()
        if language.is_gcode:
            number = text[1:]
            yield text[0] + (number[1:] if number[0] == "-" else "-" + number.removeprefix("+"))
            yield "XYZIJFSPQRTGM"[checksum % 13] + number
        else:
            yield language.words[(checksum // 7 + 3) % len(language.words)]
            yield text + text[-1]
            yield text[:-1] + ("a" if text[-1] != "a" else "b")
    if token.kind == "sign":
        yield _SIGNS[checksum % len(_SIGNS)]
    if token.kind in ("comment", "text"):
        middle = len(text) // 2
        yield text[:middle] + "x" + text[middle:]
    if token.kind == "newline":
        yield " "


def _change_digits(text: str) -> Iterator[str]:
    """Raises the first, a middle and the last digit by one, 9 to 0, and leaves out the point."""
    places = [place for place, mark in enumerate(text) if mark.isdigit()]
    for place in sorted({places[0], places[len(places) // 2], places[-1]}):
        yield f"{text[:place]}{(int(text[place]) + 1) % 10}{text[place + 1 :]}"
    if "." in text.strip("."):
        yield text.replace(".", "")


def _swap_tokens(text: str, tokens: list[Token]) -> Iterator[Mutation]:
    """Swaps the first token with the next one, and with the next of its kind in its line."""
    first = tokens[0]
    for number, second in enumerate(tokens[1:]):
        is_other = second.kind == first.kind and second.text != first.text
        if number == 0 or is_other:
            between = text[first.end : second.begin]
            yield change_place(
                "swapped", first.begin, second.end, second.text + between + first.text
            )
        is_last = number > 0 and second.kind == first.kind
        if is_last or "newline" in (first.kind, second.kind) or first.kind == "sign":
            return


def _change_lines(text: str) -> Iterator[Mutation]:
    """Drops and doubles whole lines, and swaps them with the next line."""
    lines = re.findall(r"[^\n]*\n", text)
    begin = 0
    for number, line in enumerate(lines):
        end = begin + len(line)
        yield change_place("dropped", begin, end)
        yield change_place("doubled", begin, end, line + line)
        if number + 1 < len(lines):
            following = lines[number + 1]
            yield change_place("swapped", begin, end + len(following), following + line)
        begin = end
