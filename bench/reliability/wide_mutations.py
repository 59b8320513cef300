"""Changes of a program text that reach further than one token or line: structural, global, paired.

- structural: words of the flow of the language are inserted at every line, lines are moved and
  repeated after an end of the program, blocks lose their bounds, vanish or are repeated.
- global: a token is replaced at all its places, or a number at its place in all lines of one kind;
  all lines of one kind are dropped or repeated.
- paired: two lines of the header or the settings are dropped together; two words in G-code.

The choice is a rule: every place gets its changes. If a place has more changes than `PER_LINE`, a
checksum of the seed, the place and the candidate draws among them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from itertools import combinations
from typing import NamedTuple
from zlib import crc32

from bench.reliability.mutations import (
    LANGUAGES,
    Edit,
    Mutation,
    Token,
    change_place,
    list_mutations,
    list_replacements,
    list_tokens,
)

#: Kinds of mutants, in the order of the table.
KINDS = ("single", "structural", "global", "paired")
#: Insertions that are drawn for each line.
PER_LINE = 8
#: Lines of the header, further settings, and words of the header (G-code) that are paired.
_HEADER_LINES, _SETTING_LINES, _HEADER_WORDS = 18, 12, 24
#: Ends of a program after which lines are moved: the first, the last, and one that is drawn.
_ENDS = 3
#: Texts after an inserted word. `{line}` is a line of the program, which is drawn.
_TAILS = ("", ";", " = 5", " 1:", " 1", "()", " {line}", ";\n{line}", "\n{line}")
_NUMBER = re.compile(r"\d+\.?\d*")


class Flow(NamedTuple):
    """Words and lines of a language that decide which statements run.

    words: words that begin, continue, end or leave a block, and names of types and units
    motion: pattern of a line that moves; header and settings are the other ones
    end: pattern of a line after which nothing of its routine or program runs
    blocks: patterns of a line that opens a block, and of the line that closes it
    """

    words: tuple[str, ...]
    motion: re.Pattern[str]
    end: re.Pattern[str]
    blocks: tuple[tuple[re.Pattern[str], re.Pattern[str]], ...]


def _flow(words: str, motion: str, end: str, *blocks: tuple[str, str]) -> Flow:
    def pattern(text: str) -> re.Pattern[str]:
        return re.compile(rf"\s*(?:{text})", re.IGNORECASE)

    pairs = tuple((pattern(opening), pattern(closing)) for opening, closing in blocks)
    return Flow(tuple(words.split()), pattern(motion), pattern(end), pairs)


_RAPID_WORDS = """
    IF THEN ELSE ELSEIF ENDIF FOR FROM TO STEP DO ENDFOR WHILE ENDWHILE TEST CASE DEFAULT ENDTEST
    GOTO CONNECT RETRY TRYNEXT RETURN RAISE EXIT Stop Break ExitCycle ERROR BACKWARD UNDO PROC
    ENDPROC FUNC ENDFUNC TRAP ENDTRAP MODULE ENDMODULE RECORD ENDRECORD ALIAS CONST VAR PERS LOCAL
    TASK num tooldata robtarget speeddata wobjdata TRUE FALSE label: NOT AND"""
_PACSCRIPT_WORDS = """
    If Then Else ElseIf End Exit For To Step Next Do Loop While Until Select Case GoTo Return Stop
    Halt Hold Sub Function Call On Error Resume Dim As Integer Single Double String Position Joint
    Vector Trans Variant Bit Byte #Define #Include #Pragma ByVal ByRef Let Mps unit Keep TakeArm
    GiveArm True False label: Wait Suspend Continue"""
_VPLUS_WORDS = """
    IF THEN ELSE END FOR TO STEP WHILE DO UNTIL CASE OF VALUE ANY GOTO CALL RETURN RETURNE STOP
    PAUSE HALT ABORT EXIT NEXT .PROGRAM .END LOCAL GLOBAL AUTO REAL LOC MC REACT REACTI REACTE LOCK
    ALWAYS MMPS IPS MONITOR TRUE FALSE 10 100 EXECUTE EXITE PARAMETER ENABLE DISABLE SWITCH MODE"""
_RS274_WORDS = """
    % M0 M1 M2 M30 M60 M98 M99 G10 G20 G21 G28 G52 G53 G55 G90 G91 G92 G93 G95 G96 G0 G1 G80 T1 F1
    S1 N1 / O100 sub endsub call if endif while endwhile return #1 (MSG (DEBUG M70 M72 M73"""
_RS274 = _flow(
    _RS274_WORDS,
    r"(?:G0?[0-3]\b(?! *P)|G8[1-3]|[XYZIJ])",
    r"M0?2\b|M30\b|%",
    (r"S\d+ M[34]", r"M5"),
    (r"M64|M68", r"M65|M68"),
    (r"G8[1-3]|G98", r"G80"),
)
FLOWS = {
    "rapid": _flow(
        _RAPID_WORDS,
        r"Move|FCPress|\[\[",
        r"ENDPROC|ENDMODULE|RAISE|EXIT|ERROR",
        (r"(?:LOCAL )?PROC", "ENDPROC"),
        ("MODULE", "ENDMODULE"),
        ("ERROR", "RAISE|EXIT"),
        ("FCPress1LStart", "FCPressEnd"),
    ),
    "pacscript": _flow(
        _PACSCRIPT_WORDS,
        r"Move|Draw|Approach|Depart|Drive",
        r"End Sub|Exit Sub|GiveArm|End If",
        (r"Sub", "End Sub"),
        (r"If", "End If"),
        ("TakeArm", "GiveArm"),
        ("ForceCtrl True", "ForceCtrl False"),
    ),
    "vplus": _flow(
        _VPLUS_WORDS,
        r"MOVE|APPRO|DEPART|DRIVE|\d+,-?\d+,",
        r"RETURN|STOP|\.END|GOTO|END\b",
        (r"\.PROGRAM", r"\.END"),
        (r"ATTACH \(\)", r"DETACH \(\)"),
        (r"IF|WHILE|CASE", "END"),
        (r"SIGNAL [^-]", "SIGNAL -"),
    ),
    "gcode": _RS274,
    "grbl": _RS274,
}


class Line(NamedTuple):
    """A line of a text with its end. begin, end: characters from the start of the text."""

    begin: int
    end: int
    text: str

    @property
    def indent(self) -> str:
        """The blanks before the statement."""
        return self.text[: len(self.text) - len(self.text.lstrip(" "))]


class Source(NamedTuple):
    """A program text that is mutated.

    text: the whole text
    post: key of `FLOWS` and `LANGUAGES`
    seed: number that every draw depends on
    lines: the lines of the text
    """

    text: str
    post: str
    seed: int
    lines: tuple[Line, ...]

    @property
    def flow(self) -> Flow:
        """The words and lines of the language."""
        return FLOWS[self.post]


def mutate(text: str, post: str, kind: str, seed: int = 0) -> list[Mutation]:
    """All mutants of a text of one of `KINDS`, each once; none of them is the text itself."""
    if kind == "single":
        return list_mutations(text, LANGUAGES[post])
    source = Source(text, post, seed, _split(text))
    mutants: dict[tuple[Edit, ...], Mutation] = {}
    for mutation in _FAMILIES[kind](source):
        mutants.setdefault(mutation.edits, mutation)
    return [mutation for mutation in mutants.values() if mutation.apply(text) != text]


def _split(text: str) -> tuple[Line, ...]:
    lines: list[Line] = []
    for match in re.finditer(r"[^\n]*\n|[^\n]+", text):
        lines.append(Line(match.start(), match.end(), match[0]))
    return tuple(lines)


def _draw(seed: int, *place: object) -> int:
    """A number that the seed and a place decide."""
    return crc32(repr((seed, *place)).encode())


# Structural


def _structural(source: Source) -> Iterator[Mutation]:
    yield from _stray_words(source)
    yield from _moved_lines(source)
    yield from _changed_blocks(source)


@cache
def _insertions(post: str) -> tuple[tuple[str, str], ...]:
    pairs = []
    for word in FLOWS[post].words:
        for tail in _TAILS:
            pairs.append((word, tail))
    return tuple(pairs)


def _stray_words(source: Source) -> Iterator[Mutation]:
    """Words of the flow in lines of their own, before the words of a line, and after them."""
    insertions, words, count = _insertions(source.post), source.flow.words, len(source.lines)
    for row, line in enumerate(source.lines):
        for draw in range(PER_LINE):
            word, tail = insertions[_draw(source.seed, "word", row, draw) % len(insertions)]
            other = source.lines[_draw(source.seed, "line", row, draw) % count].text.strip()
            stray = f"{line.indent}{word}{tail.format(line=other)}\n"
            yield change_place(f"inserted {word}", line.begin, line.begin, stray)
        first, last = (
            words[_draw(source.seed, side, row) % len(words)] for side in ("before", "after")
        )
        bare = line.text.strip()
        begin = line.begin + len(line.indent)
        end = begin + len(bare)
        yield change_place(f"{first} before the line", begin, end, f"{first} {bare}")
        yield change_place(f"{last} after the line", begin, end, f"{bare} {last}")


def _drop(place: Line | Token) -> Edit:
    return Edit(place.begin, place.end, "")


def _repeat(line: Line) -> Edit:
    return Edit(line.end, line.end, line.text)


def _moved_lines(source: Source) -> Iterator[Mutation]:
    """Every line moved and repeated after ends of the program, and these ends moved before it."""
    lines = source.lines
    for row in _drawn_ends(source):
        end = lines[row]
        for k, line in enumerate(lines):
            text = line.text.removesuffix("\n") + "\n"
            after = Edit(end.end, end.end, text)
            yield Mutation("repeated after an end", (after,))
            if k != row:
                yield Mutation("moved after an end", _in_order(_drop(line), after))
                before = Edit(line.begin, line.begin, end.text)
                yield Mutation("an end repeated before the line", (before,))
                yield Mutation("an end moved before the line", _in_order(_drop(end), before))


def _drawn_ends(source: Source) -> list[int]:
    """Rows of the first and the last end of the program, and of one between them."""
    rows = [k for k, line in enumerate(source.lines) if source.flow.end.match(line.text)]
    if len(rows) <= _ENDS:
        return rows
    middle = rows[1 + _draw(source.seed, "end") % (len(rows) - 2)]
    return [rows[0], middle, rows[-1]]


def _in_order(*changes: Edit) -> tuple[Edit, ...]:
    return tuple(sorted(changes, key=lambda edit: (edit.begin, edit.end)))


def _changed_blocks(source: Source) -> Iterator[Mutation]:
    """Blocks without their bounds, without either of them, gone, repeated, and at the very end."""
    size = len(source.text)
    for first, last in _list_blocks(source):
        opening, closing = source.lines[first], source.lines[last]
        whole = Edit(opening.begin, closing.end, "")
        block = source.text[opening.begin : closing.end]
        yield Mutation("bounds of a block dropped", (_drop(opening), _drop(closing)))
        yield Mutation("block dropped", (whole,))
        yield change_place("block repeated", closing.end, closing.end, block)
        yield Mutation("block moved to the end", (whole, Edit(size, size, block)))
        yield change_place("block repeated at the end", size, size, block)
        yield change_place("block emptied", opening.end, closing.begin)


def _list_blocks(source: Source) -> Iterator[tuple[int, int]]:
    """First and last row of every block; an inner block before the one that holds it."""
    for opening, closing in source.flow.blocks:
        stack: list[int] = []
        for row, line in enumerate(source.lines):
            if closing.match(line.text) and stack:
                yield stack.pop(), row
            elif opening.match(line.text):
                stack.append(row)


# Global


def _global(source: Source) -> Iterator[Mutation]:
    yield from _replaced_tokens(source)
    yield from _line_kinds(source)


def _replaced_tokens(source: Source) -> Iterator[Mutation]:
    """A token that occurs more than once, replaced at all its places."""
    language = LANGUAGES[source.post]
    groups: dict[str, list[Token]] = {}
    for token in list_tokens(source.text, language):
        if token.kind != "newline":
            groups.setdefault(token.text, []).append(token)
    for text, group in groups.items():
        if len(group) < 2:
            continue
        for new in dict.fromkeys((*list_replacements(group[0], language), *_rough(text), "")):
            kind = f"{text[:20]} replaced everywhere" if new else f"{text[:20]} dropped everywhere"
            yield Mutation(kind, tuple(Edit(each.begin, each.end, new) for each in group))


def _rough(text: str) -> Iterator[str]:
    """Other forms of the number in a token: a fraction, a half, none, another sign, a huge one."""
    match = _NUMBER.search(text)
    if match is None or text[:1] in "\"!';(":
        return
    head, number, rest = text[: match.start()], match[0], text[match.end() :]
    for new in (f"{number.rstrip('.')}.5", "0.5", "0", "1", "1E9", f"- {number}", f"({number})"):
        if not ("." in number and new.endswith(".5") and new != "0.5"):
            yield f"{head}{new}{rest}"


def _line_kinds(source: Source) -> Iterator[Mutation]:
    """All lines of one kind dropped or repeated, and one of their numbers replaced in all."""
    groups: dict[str, list[Line]] = {}
    for line in source.lines:
        for key in _line_keys(line.text):
            groups.setdefault(key, []).append(line)
    for key, group in groups.items():
        if len(group) < 2:
            continue
        yield Mutation(f"all lines {key} dropped", tuple(map(_drop, group)))
        yield Mutation(f"all lines {key} repeated", tuple(map(_repeat, group)))
        yield from _replaced_numbers(source, key, group)


def _line_keys(text: str) -> Iterable[str]:
    """The first word of a line, and its first two."""
    words = text.split()
    return dict.fromkeys((" ".join(words[:1]), " ".join(words[:2])))


def _replaced_numbers(source: Source, key: str, group: Sequence[Line]) -> Iterator[Mutation]:
    """The number at one place of each line of a kind, replaced in all of them."""
    places: list[list[re.Match[str]]] = [list(_NUMBER.finditer(line.text)) for line in group]
    for place in range(min(map(len, places))):
        for new in ("0.5", f"{_draw(source.seed, key, place) % 9 + 1}", "{}.5", "-{}"):
            changes = []
            for line, matches in zip(group, places, strict=True):
                match = matches[place]
                begin = line.begin + match.start()
                changes.append(Edit(begin, begin + len(match[0]), new.format(match[0])))
            yield Mutation(f"number {place + 1} of all lines {key}", tuple(changes))


# Paired


def _paired(source: Source) -> Iterator[Mutation]:
    still = [line for line in source.lines if _is_still(line.text, source)]
    header = still[:_HEADER_LINES]
    texts = {line.text for line in header}
    settings: dict[str, Line] = {}
    for line in still[_HEADER_LINES:]:
        if line.text not in texts:
            settings.setdefault(line.text, line)
    units = [*header, *list(settings.values())[:_SETTING_LINES]]
    for first, second in combinations(units, 2):
        yield Mutation("two lines dropped", (_drop(first), _drop(second)))
    if LANGUAGES[source.post].is_gcode:
        for first_word, second_word in combinations(_header_words(source), 2):
            yield Mutation("two words dropped", (_drop(first_word), _drop(second_word)))


def _is_still(text: str, source: Source) -> bool:
    """Whether a line neither moves nor is a comment or blank."""
    bare = re.sub(LANGUAGES[source.post].comment, "", text).strip()
    return bool(bare) and not source.flow.motion.match(bare)


def _header_words(source: Source) -> list[Token]:
    words: list[Token] = []
    for token in list_tokens(source.text, LANGUAGES[source.post]):
        if token.kind == "word":
            words.append(token)
    return words[:_HEADER_WORDS]


_FAMILIES = {"structural": _structural, "global": _global, "paired": _paired}
