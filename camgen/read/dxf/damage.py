"""Damaged numbers and groups of a DXF text, found before ezdxf reads it and guesses.

Each value of a group that holds a number has to be a number of the format. Where it is not,

- the entity with it is left out and named, with its line, its group and the value;
- in a table or an object, which hold nothing to machine, 0 replaces it, with a note;
- of the units or the state of a layer, it stops the reader.

Decimal commas are the exception: they are read in a section in which no number has a point. An
entity that lacks a group, or has one twice, or that has lost a line, is left out, too.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import Final

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import list_range_numbers
from camgen.model.errors import InputError
from camgen.model.part import Note
from camgen.model.text import counted, harmless, short
from camgen.read.dxf.tags import LONGEST_NUMBER, Bytes, Index, Mask, Tags, Texts, tabulate

#: Remedy for a file that cannot be read as it is.
SAVE_AGAIN: Final = "open it in the CAD program and save it again as DXF"
#: Entities that are named one by one, and numbers that were replaced; the others are counted.
_NAMED = 20
#: Characters that a note shows of a value.
_SHOWN = 40

# Group codes and what they hold, by the DXF reference.

_CODES = 1072
#: Largest size of the integers of a group, 0 for a group that holds none. Unsigned spellings pass.
_LIMITS = np.zeros(_CODES + 1)
for _bits, _ranges in (
    (16, ((60, 80), (170, 180), (270, 300), (370, 390), (400, 410), (1060, 1071))),
    (32, ((90, 100), (420, 430), (440, 460), (1071, 1072))),
    (64, ((160, 170),)),
):
    for _first, _after in _ranges:
        _LIMITS[_first:_after] = 2.0**_bits
_FLOATS = (
    *range(10, 60), *range(110, 150), *range(210, 240), *range(460, 470), *range(1010, 1060)
)  # fmt: skip
_IS_FLOAT = np.isin(np.arange(_CODES + 1), _FLOATS)
#: The first group of extended data, which belongs to an application.
_EXTENDED = 1000
_NAME, _HANDLE, _LAYER, _VARIABLE = 2, 5, 8, 9

_OF_NUMBERS = b"0123456789+-.eE \t"
#: Digits of a number that fits every group of integers.
_SHORT = 4
#: Kinds of letters of a plain number, and which may follow which.
_END, _BLANK, _SIGN, _DIGIT, _POINT, _OTHER, _KINDS = range(7)
_LETTERS = np.full(256, _OTHER, np.uint8)
for _letters, _kind in ((b"\0", _END), (b" \t", _BLANK), (b"+-", _SIGN), (b".", _POINT)):
    _LETTERS[list(_letters)] = _kind
_LETTERS[ord("0") : ord("9") + 1] = _DIGIT
_FOLLOWS = np.zeros(_KINDS * _KINDS, np.bool_)
for _kind, _next in (
    (_END, (_END,)),
    (_BLANK, (_BLANK, _SIGN, _DIGIT, _POINT)),
    (_SIGN, (_DIGIT, _POINT)),
    (_DIGIT, (_DIGIT, _POINT, _END)),
    (_POINT, (_DIGIT, _END)),
):
    for _follower in _next:
        _FOLLOWS[_kind * _KINDS + _follower] = True
_COMMA = re.compile(rb"[ \t]*[+-]?\d*,\d+(?:[eE][+-]?\d+)?[ \t]*")
#: A number whose comma may separate thousands.
_THOUSANDS = re.compile(rb"[ \t]*[+-]?[1-9]\d{0,2},\d{3}[ \t]*")
_CODE_LINE = re.compile(rb"[ \t]*-?\d{1,5}[ \t]*\r?")
_KIND_LINE = re.compile(rb"[ \t]*[\w$*.-]*[A-Za-z]{2}[\w$*.-]*[ \t]*\r?")
#: A kind by which the beginning of an entity is recognised within lines that are out of step. Each
#: text that it fits is also one of the above.
_KIND = re.compile(rb"[ \t]*[A-Z0-9_]*[A-Z]{3}[A-Z0-9_]*[ \t]*\r?")

#: Groups that an entity has to have, and groups that it has once.
_REQUIRED: Final = {
    "LINE": (10, 20, 11, 21),
    "CIRCLE": (10, 20, 40),
    "ARC": (10, 20, 40, 50, 51),
    "ELLIPSE": (10, 20, 11, 21, 40),
    "POINT": (10, 20),
    "VERTEX": (10, 20),
    "INSERT": (2, 10, 20),
}
_ONCE: Final = (*range(10, 14), *range(20, 24), *range(30, 34), *range(40, 60), 210, 220, 230)
#: Kinds with rows of points: each x is followed by its y.
_ROWS: Final = ("LWPOLYLINE", "SPLINE", "HELIX")
_X, _Y = (10, 11), (20, 21)
#: Kinds that belong to the entity before them.
_PARTS: Final = ("VERTEX", "ATTRIB", "SEQEND")
_LAYOUTS = re.compile(r"[*$](?:model|paper)_space.*", re.IGNORECASE)
#: Numbers without which a drawing is read wrong: variables of the header, groups of a layer.
_UNITS: Final = ("$INSUNITS", "$MEASUREMENT")
_STATE: Final = (62, 70)


class _Lines(Struct, frozen=True, eq=False):
    """Tags of a text that may have lost lines.

    tags: columns of the tags.
    line: (T,) number of the line of each value in the file, from 1.
    lost: damage of entities that were out of step, by index of the entity.
    """

    tags: Tags
    line: Index
    lost: dict[int, str]


def repair(name: str, data: bytes) -> tuple[bytes, tuple[Note, ...]] | None:
    """The text `data` of the file `name` without its damage, and notes; None for a sound text.

    The notes name the entities that were left out, and the numbers that were replaced or have
    commas.

    Raises InputError if the damage makes the drawing unreadable.
    """
    lines = _read_lines(name, data)
    tags = lines.tags
    damaged = _find_numbers(tags)
    causes = _find_groups(lines)
    if not (len(damaged) or causes):
        return None
    edits: list[tuple[int, int, bytes]] = []
    notes: list[Note] = []
    commas = _find_commas(tags, damaged)
    if len(commas):
        damaged = np.setdiff1d(damaged, commas)
        notes.append(_note_commas(lines, commas))
        edits += [
            _make_edit(tags, tag, tags.value(tag).replace(b",", b".")) for tag in commas.tolist()
        ]
    zeros: list[tuple[int, str]] = []
    sections = _list_sections(tags)
    entity_of = np.searchsorted(tags.head, damaged, side="right") - 1
    for tag, entity in zip(damaged.tolist(), entity_of.tolist(), strict=True):
        cause = f"group {tags.code[tag]} is {_show(tags.value(tag))}, which is not a number"
        if _holds_entity(tags, sections, entity) and tags.code[tag] < _EXTENDED:
            causes.setdefault(entity, f"line {lines.line[tag]}: {cause}")
        else:
            _check_units_and_states(name, lines, tag, entity)
            zeros.append((tag, _describe(tags, max(entity, 0), tag)))
    left_out, removed = _remove_entities(lines, sections, causes)
    edits += [_make_edit(tags, tag, b"0") for tag, _ in zeros] + removed
    notes += _limit(left_out, "entities")
    notes += _limit([_note_zero(lines, tag, record) for tag, record in zeros], "numbers")
    return _apply(tags.text, edits), tuple(notes)


# Lines and tags.


def _read_lines(name: str, data: bytes) -> _Lines:
    """The tags of `data`. Raises InputError if lines are lost outside of blocks and model space."""
    if not data.endswith(b"\n"):
        data += b"\n"
    tags = tabulate(data)
    if tags is not None:
        # After a lost line, a tag with the group code 0 does not name a kind.
        kinds = np.unique(tags.values(tags.head, LONGEST_NUMBER)).tolist()
        if all(_KIND_LINE.fullmatch(kind) for kind in kinds):
            return _Lines(tags, 2 + 2 * np.arange(len(tags.code)), {})
    return _match_lines(name, data.split(b"\n")[:-1])


def _match_lines(name: str, lines: list[bytes]) -> _Lines:
    """The tags of lines of which some are lost.

    An entity is damaged at a line that should hold a group code or a kind and holds something
    else: the lines up to the next entity are left out.
    """
    pairs: list[int] = []
    heads: list[int] = []
    lost: dict[int, str] = {}
    section, k = b"", 0
    while k + 1 < len(lines):
        code, value = lines[k], lines[k + 1]
        begins_entity = code.strip() == b"0"
        is_tag = _CODE_LINE.fullmatch(code) is not None
        if is_tag and (not begins_entity or _KIND_LINE.fullmatch(value)):
            if begins_entity:
                heads.append(len(pairs))
            elif code.strip() == b"2" and pairs and lines[pairs[-1] + 1].strip() == b"SECTION":
                section = value.strip()
            pairs.append(k)
            k += 2
            continue
        wrong = value if is_tag else code
        cause = f"line {k + 1 + is_tag}: {_show(wrong)} is out of step, a line before it is lost"
        if section not in (b"BLOCKS", b"ENTITIES", b"OBJECTS") or not heads:
            raise InputError(name, f"is damaged beyond repair: {cause}", "", SAVE_AGAIN)
        first = pairs[heads[-1]]
        lost[len(heads) - 1] = cause
        pairs[heads[-1] + 1 :] = _named_pairs(lines, pairs[heads[-1] + 1 :])
        k = _find_entity(lines, first + 2)
    rows: list[bytes] = []
    for k in pairs:
        rows += (lines[k].strip(), lines[k + 1])
    tags = tabulate(b"\n".join([*rows, b""]))
    if tags is None:
        raise InputError(
            name, "is damaged beyond repair: a group code of five digits", "", SAVE_AGAIN
        )
    return _Lines(tags, np.array(pairs, np.int64) + 2, lost)


def _named_pairs(lines: list[bytes], pairs: list[int]) -> Iterator[int]:
    """The handle and the layer of a damaged entity, as far as they come before its numbers."""
    for k in pairs:
        if lines[k].strip() not in (b"5", b"8", b"100", b"330"):
            break
        yield k


def _find_entity(lines: list[bytes], k: int) -> int:
    """Index of the next line 0 that is followed by a kind; the number of lines without one."""
    while k + 1 < len(lines):
        if lines[k].strip() == b"0" and _KIND.fullmatch(lines[k + 1]):
            return k
        k += 1
    return len(lines)


# Numbers.


def _find_numbers(tags: Tags) -> Index:
    """Tags of groups of numbers whose value is not a number of the format, in order."""
    floats = _list_floats(tags)
    damaged = floats[~_are_numbers(tags.values(floats, LONGEST_NUMBER))]
    integers = np.flatnonzero(_LIMITS[np.minimum(tags.code, _CODES)] > 0)
    texts = tags.values(integers, LONGEST_NUMBER)
    wrong: list[int] = []
    for k in np.flatnonzero(~_are_short(texts)).tolist():
        number = _read_number(texts[k])
        limit = _LIMITS[tags.code[integers[k]]]
        if number is None or number != int(number) or abs(number) >= limit:
            wrong.append(int(integers[k]))
    return np.union1d(damaged, np.array(wrong, np.int64))


def _list_floats(tags: Tags) -> Index:
    return np.flatnonzero(_IS_FLOAT[np.minimum(tags.code, _CODES)])


def _find_commas(tags: Tags, damaged: Index) -> Index:
    """Tags of `damaged` with a decimal comma that is read, in order.

    It is read in a section in which no number has a point, and one has a comma that cannot separate
    thousands.
    """
    texts = tags.values(damaged, LONGEST_NUMBER)
    has_comma = np.array([_COMMA.fullmatch(text) is not None for text in texts.tolist()], np.bool_)
    commas = damaged[has_comma]
    if not len(commas):
        return commas
    begins = np.zeros(len(tags.code), np.int64)
    begins[tags.head[tags.are(("SECTION",))]] = 1
    section = np.cumsum(begins)
    floats = np.setdiff1d(_list_floats(tags), damaged)
    has_point = np.char.find(tags.values(floats, LONGEST_NUMBER), b".") >= 0
    certain = [_THOUSANDS.fullmatch(text) is None for text in texts[has_comma].tolist()]
    readable = np.setdiff1d(section[commas[certain]], section[floats[has_point]])
    return commas[np.isin(section[commas], readable)]


def _are_numbers(texts: Texts) -> Mask:
    are_numbers = _are_plain(texts)
    for k in np.flatnonzero(~are_numbers).tolist():
        are_numbers[k] = _read_number(texts[k]) is not None
    return are_numbers


def _read_number(text: bytes) -> float | None:
    """The number of a text, None if it is not the spelling of a finite one."""
    if text.translate(None, _OF_NUMBERS):
        return None
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None


def _are_short(texts: Texts) -> Mask:
    """(N,) whether each text is a whole number of at most four digits, which fits every group."""
    kinds = _LETTERS[texts.view(np.uint8).reshape(len(texts), texts.itemsize)]
    is_short = (kinds == _DIGIT).sum(axis=1) <= _SHORT
    return np.asarray(_are_plain(texts) & is_short & (kinds != _POINT).all(axis=1))


def _are_plain(texts: Texts) -> Mask:
    """(N,) whether each text is blanks, a sign, and digits with or without a point.

    Other spellings of a number are not among them: exponents, and blanks after the digits.
    """
    kinds = _LETTERS[texts.view(np.uint8).reshape(len(texts), texts.itemsize)]
    pairs = kinds[:, :-1] * np.uint8(_KINDS) + kinds[:, 1:]
    last = kinds[:, -1]
    plain = _FOLLOWS[pairs].all(axis=1) & (kinds[:, 0] != _END)
    plain &= (last == _END) | (last == _DIGIT) | (last == _POINT)
    plain &= (kinds == _POINT).sum(axis=1) <= 1
    return np.asarray(plain & (kinds == _DIGIT).any(axis=1))


# Groups.


def _find_groups(lines: _Lines) -> dict[int, str]:
    """Damage of entities that lack a group, have one twice, or lost a line, by index."""
    tags = lines.tags
    causes = dict(lines.lost)
    kinds = tags.values(tags.head, LONGEST_NUMBER)
    for kind, required in _REQUIRED.items():
        entities = np.flatnonzero(kinds == kind.encode())
        if len(entities):
            causes = _check_groups(lines, entities, required) | causes
    entities = np.flatnonzero(np.isin(kinds, [kind.encode() for kind in _ROWS]))
    return _check_rows(lines, entities) | causes


def _list_rows(tags: Tags, entities: Index) -> tuple[Index, Index]:
    """Index of each tag of `entities`, and of its entity."""
    count = tags.count[entities]
    return list_range_numbers(tags.head[entities], count), np.repeat(entities, count)


def _check_groups(lines: _Lines, entities: Index, required: tuple[int, ...]) -> dict[int, str]:
    """Damage of `entities` of one kind, by index of the entity."""
    tags = lines.tags
    causes: dict[int, str] = {}
    rows, owner = _list_rows(tags, entities)
    for code in required:
        has = np.isin(entities, owner[tags.code[rows] == code])
        for entity in entities[~has].tolist():
            head = int(tags.head[entity])
            causes.setdefault(entity, f"line {lines.line[head]}: group {code} is missing")
    known = np.isin(tags.code[rows], _ONCE)
    rows, owner = rows[known], owner[known]
    key = owner * _CODES + tags.code[rows]
    order = np.argsort(key, kind="stable")
    for k in np.flatnonzero(key[order][1:] == key[order][:-1]).tolist():
        first, second = rows[order[k : k + 2]].tolist()
        values = f"{_show(tags.value(first))} and {_show(tags.value(second))}"
        cause = f"line {lines.line[second]}: group {tags.code[first]} is there twice, {values}"
        causes.setdefault(int(owner[order[k]]), cause)
    return causes


def _check_rows(lines: _Lines, entities: Index) -> dict[int, str]:
    """Damage of rows of points, by index of the entity: an x without its y, a y without its x."""
    tags = lines.tags
    causes: dict[int, str] = {}
    rows, owner = _list_rows(tags, entities)
    code = tags.code[rows]
    before = tags.code[rows - 1]
    after = np.append(tags.code, 0)[rows + 1]
    for x, y in zip(_X, _Y, strict=True):
        for missing, is_damaged in (
            (y, (code == x) & (after != y)),
            (x, (code == y) & (before != x)),
        ):
            for k in np.flatnonzero(is_damaged).tolist():
                cause = f"line {lines.line[rows[k]]}: group {missing} is missing"
                causes.setdefault(int(owner[k]), cause)
    return causes


# Entities.


def _list_sections(tags: Tags) -> dict[str, tuple[int, int]]:
    """First entity, and the one after the last, of each section by its name."""
    heads = np.flatnonzero(tags.are(("SECTION",))).tolist()
    bounds = pairwise([*heads, len(tags.head)])
    return {_text(tags, first, _NAME): (first, after) for first, after in bounds}


def _holds_entity(tags: Tags, sections: dict[str, tuple[int, int]], entity: int) -> bool:
    """Whether the tag of a kind begins something that is drawn, and not the frame of a block."""
    for section in ("BLOCKS", "ENTITIES"):
        first, after = sections.get(section, (0, 0))
        if first < entity < after:
            kind = _read_kind(tags, entity)
            if kind == "BLOCK":
                return _LAYOUTS.fullmatch(_text(tags, entity, _NAME)) is None
            return kind not in ("ENDBLK", "ENDSEC")
    return False


def _remove_entities(
    lines: _Lines, sections: dict[str, tuple[int, int]], causes: dict[int, str]
) -> tuple[list[Note], list[tuple[int, int, bytes]]]:
    tags = lines.tags
    notes, edits = [], []
    bounds = np.append(tags.at[tags.head], len(tags.text))
    for entity, cause in sorted(causes.items()):
        if entity not in lines.lost and not _holds_entity(tags, sections, entity):
            continue
        notes.append(Note("skipped", _describe(tags, entity), f"{cause}; {SAVE_AGAIN}"))
        first, after = _find_extent(tags, entity)
        if first < after:
            edits.append((int(bounds[first]), int(bounds[after]), b""))
    return notes, edits


def _find_extent(tags: Tags, entity: int) -> tuple[int, int]:
    """First entity and the one after the last that have to be left out with `entity`.

    A polyline goes with its vertices, a reference with its attributes. The frame of a block stays,
    so that references to it draw nothing.
    """
    kind = _read_kind(tags, entity)
    if kind == "BLOCK":
        after = entity + 1
        while after < len(tags.head) and _read_kind(tags, after) != "ENDBLK":
            after += 1
        return entity + 1, after
    first = entity
    while kind in ("VERTEX", "SEQEND") and first > 0 and _read_kind(tags, first) in _PARTS:
        first -= 1
    after = entity + 1
    if _read_kind(tags, first) in ("POLYLINE", "INSERT"):
        after = first + 1
        while after < len(tags.head) and _read_kind(tags, after) in _PARTS:
            after += 1
    return first, after


def _read_kind(tags: Tags, entity: int) -> str:
    return tags.value(int(tags.head[entity])).strip().decode("ascii", "replace")


def _check_units_and_states(name: str, lines: _Lines, tag: int, entity: int) -> None:
    tags = lines.tags
    variable = _variable(tags, tag)
    record = _read_kind(tags, entity) if entity >= 0 else ""
    place = ""
    if variable in _UNITS:
        place = variable
    elif record == "LAYER" and tags.code[tag] in _STATE:
        place = f"line {lines.line[tag]}, layer {harmless(_text(tags, entity, _NAME))}"
    if place:
        raise InputError(
            name,
            f"is damaged: {_show(tags.value(tag))} is not a number",
            place,
            "save it again from the CAD program, or correct the line",
        )


def _variable(tags: Tags, tag: int) -> str:
    """Name of the header variable that a tag belongs to, "" without one."""
    before = max(0, tag - 8)
    names = np.flatnonzero(tags.code[before:tag] == _VARIABLE)
    return (
        tags.value(before + int(names[-1])).strip().decode("ascii", "replace") if len(names) else ""
    )


def _text(tags: Tags, entity: int, code: int) -> str:
    """Value of the first tag of an entity with a group code, "" without one."""
    head = int(tags.head[entity])
    rows = np.flatnonzero(tags.code[head : head + int(tags.count[entity])] == code)
    if not len(rows):
        return ""
    return tags.value(head + int(rows[0])).strip().decode("utf-8", "replace")


# Notes and edits.


def _describe(tags: Tags, entity: int, tag: int = 0) -> str:
    """Kind, name, handle and layer of an entity, or the variable of a tag of the header."""
    kind = _read_kind(tags, entity)
    if kind == "SECTION":
        return _variable(tags, tag) or "the header"
    handle, layer = _text(tags, entity, _HANDLE), _text(tags, entity, _LAYER)
    label = _text(tags, entity, _NAME)
    text = harmless(kind)
    if label and kind in ("BLOCK", "INSERT"):
        text += f" {harmless(label)!r}"
    if handle:
        text += f" #{harmless(handle)}"
    return f"{text} on layer {harmless(layer)}" if layer else text


def _note_commas(lines: _Lines, commas: Index) -> Note:
    first = int(commas[0])
    value = lines.tags.value(first)
    read = short(float(value.replace(b",", b".")), 6)
    what = f"decimal commas in {counted(len(commas), 'number')}"
    example = f"line {lines.line[first]}: {_show(value)} is read as {read}"
    return Note("assumed", what, f"no number of their section has a point; {example}")


def _note_zero(lines: _Lines, tag: int, record: str) -> Note:
    group, value = lines.tags.code[tag], _show(lines.tags.value(tag))
    return Note(
        "repaired",
        f"line {lines.line[tag]}: group {group} of {record} was {value}, read as 0",
        f"not a number; {SAVE_AGAIN}",
        strict=True,
    )


def _limit(notes: list[Note], noun: str) -> Iterable[Note]:
    """The first notes, and the last of them with the count of the rest."""
    if len(notes) <= _NAMED:
        return notes
    rest = notes[_NAMED]
    return [
        *notes[:_NAMED],
        Note(
            rest.kind,
            f"{len(notes) - _NAMED} more damaged {noun}",
            f"the first: {rest.what}",
            strict=rest.strict,
        ),
    ]


def _show(value: bytes) -> str:
    text = value.strip().decode("utf-8", "replace")[:_SHOWN]
    # A comma is harmless within a note, and often the damage itself.
    return "'" + ",".join(map(harmless, text.split(","))) + "'"


def _make_edit(tags: Tags, tag: int, value: bytes) -> tuple[int, int, bytes]:
    begin = int(tags.begin[tag])
    return begin, begin + int(tags.length[tag]), value


def _apply(text: Bytes, edits: list[tuple[int, int, bytes]]) -> bytes:
    """The bytes of a text after its edits; an edit within another one has no effect."""
    data = text.tobytes().rstrip(b"\0")
    pieces: list[bytes] = []
    position = 0
    for begin, end, value in sorted(edits, key=lambda edit: (edit[0], -edit[1])):
        if begin >= position:
            pieces += [data[position:begin], value]
            position = end
    return b"".join([*pieces, data[position:]])
