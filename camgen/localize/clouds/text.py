"""Point clouds in text: a point a line, with a head that names the columns or without one.

Between the words of a line stand semicolons, tabs, commas or blanks. Numbers have a decimal point,
or a decimal comma where no number has a point and commas do not stand between the words. A line
with one whole number says how many lines of points follow, as in PTS files.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import chain, compress
from operator import itemgetter

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.localize.clouds.cloud import AGAIN, FileCloud
from camgen.localize.clouds.columns import Columns, find_columns, find_unit
from camgen.model.errors import AmbiguousInput, InputError, make_one_line
from camgen.model.part import Note
from camgen.model.pose import FloatArray
from camgen.model.text import counted

_LINE_END = re.compile(r"\r\n|\r|\n")
_NUMBER = re.compile(
    r"[+-]?(?:\d+(?:\.\d*|,\d+)?|[.,]\d+)(?:e[+-]?\d+)?|[+-]?(?:nan|inf|infinity)", re.IGNORECASE
)
#: A name in a line of names with blanks between them, with quotes or a unit in brackets.
_NAME = re.compile(r"""(?:"[^"]*"|'[^']*'|[^\s\[({]+)(?:\s*[\[({][^\])}]*[\])}])?""")
_COMMENT = re.compile(r"\s*(?:#|//|%)+")
#: Separators of words, in the order in which a line is searched for them; "" for blanks.
_MARKS = (";", "\t", ",", "")
#: This number of whole numbers between commas may also be three with decimal commas.
_LEAST_PAIRED = 6
_NAMING = "name the columns in a first line, as in: id x y z"


class _Rows(Struct, frozen=True):
    """The lines of points.

    lines: their texts without comments.
    numbers: their numbers in the file, from 1.
    mark: the separator of words; "" for blanks.
    """

    lines: list[str]
    numbers: list[int]
    mark: str

    @property
    def width(self) -> int:
        """Words of the first line, without empty ones at its end."""
        return _count_words(_split(self.lines[0], self.mark))


def read_text(name: str, data: bytes) -> FileCloud:
    """The points of a text. Raises InputError for a line that is not a point."""
    if b"\x00" in data[:4096]:
        raise InputError(name, "is not a text", remedy=AGAIN)
    lines = _LINE_END.split(data.decode("utf-8-sig", "replace"))
    begin = next((k for k, line in enumerate(lines) if _find_mark(line) is not None), None)
    if begin is None:
        raise InputError(
            name,
            "has no line of three numbers",
            remedy="a line is x y z, in mm; --units for others",
        )
    rows = _collect_rows(name, lines, begin)
    columns, notes = _read_head(name, lines[:begin], rows)
    places = columns.places if columns else (0, 1, 2)
    _check_width(name, rows, places)
    points, commas = _read_points(name, rows, places)
    if columns is None:
        _check_commas(name, rows, points)
        _check_first_column(name, rows, points)
    if commas:
        notes.append(
            Note(
                "assumed",
                f"decimal commas in {counted(commas, 'number')}",
                "no number of the coordinates has a point",
            )
        )
    unit = columns.unit if columns else ""
    return FileCloud(points, tuple(notes), None, unit, "", "its head" if unit else "")


def read_vertices(name: str, data: bytes) -> FileCloud:
    """The vertices of an OBJ file without faces."""
    lines = _LINE_END.split(data.decode("utf-8-sig", "replace"))
    rows = _Rows([], [], "")
    for number, line in enumerate(lines, 1):
        if line.split(None, 1)[:1] == ["v"]:
            rows.lines.append(line.strip()[1:].strip())
            rows.numbers.append(number)
    if not rows.lines:
        raise InputError(name, "has no vertices", remedy=AGAIN)
    return FileCloud(_read_points(name, rows, (0, 1, 2))[0])


# Lines and words.


def _split(line: str, mark: str) -> list[str]:
    return line.split(mark) if mark else line.split()


def _count_words(words: Sequence[str]) -> int:
    """The number of words, without empty ones at the end."""
    count = len(words)
    while count and not words[count - 1].strip():
        count -= 1
    return count


def _find_mark(line: str) -> str | None:
    """The separator of a line of points; None for any other line.

    A line is a point if three of its words are numbers, and more than half of all its words.
    """
    text = _strip_comment(line)
    for mark in _MARKS:
        if mark in text:
            words = _split(text, mark)
            numbers = sum(_NUMBER.fullmatch(word.strip()) is not None for word in words)
            if numbers >= 3 and 2 * numbers > _count_words(words):
                return mark
    return None


def _strip_comment(line: str) -> str:
    if "#" in line or "/" in line:
        line = line.partition("#")[0].partition("//")[0]
    return line.strip()


def _collect_rows(name: str, lines: Sequence[str], begin: int) -> _Rows:
    """The lines of points from `begin` on, without those that say how many there are."""
    texts, numbers = [], []
    for number, line in enumerate(lines[begin:], begin + 1):
        if text := _strip_comment(line):
            texts.append(text)
            numbers.append(number)
    counts = _find_counts(name, lines[:begin], texts, numbers)
    mark = _find_mark(texts[0]) or ""
    if counts:
        is_point = [k not in counts for k in range(len(texts))]
        texts, numbers = list(compress(texts, is_point)), list(compress(numbers, is_point))
    return _Rows(texts, numbers, mark)


def _find_counts(
    name: str, head: Sequence[str], lines: Sequence[str], numbers: Sequence[int]
) -> set[int]:
    """Places in `lines` of the lines that say how many points follow, each of them right.

    Raises InputError if as many do not follow.
    """
    indices, blocks = set(), []
    for k, line in enumerate(lines):
        if line.isdecimal():
            indices.add(k)
            blocks.append((k + 1, numbers[k], line))
    above = [(k, line.strip()) for k, line in enumerate(head, 1) if line.strip()]
    for number, line in above[-1:] + above[:1]:
        if line.isdecimal():
            blocks.insert(0, (0, number, line))
            break
    ends = [begin - 1 for begin, _, _ in blocks[1:]] + [len(lines)]
    for (begin, number, count), end in zip(blocks, ends, strict=False):
        if count.lstrip("0") != str(end - begin).lstrip("0"):
            raise InputError(
                name,
                f"says that {count[:20]} points follow, and {end - begin} do",
                f"line {number}",
                AGAIN,
            )
    return indices


# The head.


def _read_head(name: str, head: Sequence[str], rows: _Rows) -> tuple[Columns | None, list[Note]]:
    """The columns as the lines above the points name them, and notes on them.

    Raises InputError for names that do not fit the lines, or hold no x, y and z.
    """
    others = []
    for number, line in reversed([*enumerate(head, 1)]):
        text = _COMMENT.sub("", line, count=1).strip()
        if text and not text.isdecimal():
            where = f"line {number}, {make_one_line(text[:40])!r}"
            columns = _name_columns(name, text, where, rows)
            if columns is not None:
                return _state_unit(name, columns, head[number:], rows), _note_names(columns)
            if not _COMMENT.match(line):
                others.append((text, where))
    for text, where in others:
        if _count_words(_split_names(text, rows.mark)) == rows.width:
            raise InputError(
                name,
                "its head names no columns x, y and z",
                where,
                "name them x, y, z, or begin a comment with #",
            )
    if not others:
        return None, []
    return None, [
        Note(
            "assumed", "the first three columns are x, y and z", f"{others[-1][1]} names no columns"
        )
    ]


def _split_names(line: str, mark: str) -> list[str]:
    return line.split(mark) if mark else [match[0] for match in _NAME.finditer(line)]


def _name_columns(name: str, line: str, where: str, rows: _Rows) -> Columns | None:
    """The columns that a line names; None if it names none. Raises InputError if they cannot be."""
    for mark in dict.fromkeys((rows.mark, *_MARKS)):
        names = _split_names(line, mark)
        try:
            columns = find_columns(names)
        except ValueError as error:
            raise AmbiguousInput(name, str(error), where, "leave one of them") from error
        if columns is not None:
            wide = _count_words(names)
            leading = sorted(columns.places) == [0, 1, 2] and rows.mark != ","
            if wide != rows.width and not leading:
                raise InputError(
                    name,
                    f"its head names {counted(wide, 'column')}, "
                    f"and the line below it has {counted(rows.width, 'word')}",
                    where,
                    "name each column once, without blanks",
                )
            return columns
    return None


def _state_unit(name: str, columns: Columns, below: Sequence[str], rows: _Rows) -> Columns:
    for number, line in enumerate(below):
        words = _split(line, rows.mark)
        try:
            unit = find_unit(words, columns.places)
        except ValueError as error:
            raise AmbiguousInput(
                name, str(error), f"line {number + 1} below the head", "give one unit"
            ) from error
        if unit and columns.unit not in ("", unit):
            raise AmbiguousInput(
                name,
                f"its columns are in {columns.unit}, and in {unit} by the line below",
                remedy="leave one of them",
            )
        if unit:
            return replace(columns, unit=unit)
    return columns


def _note_names(columns: Columns) -> list[Note]:
    if not columns.compass:
        return []
    names = ", ".join(make_one_line(word.strip(" \"'")) for word in columns.names)
    return [Note("assumed", f"the columns {names} are x, y and z", "so its head names them")]


# The points.


def _check_width(name: str, rows: _Rows, places: Sequence[int]) -> None:
    """Raises InputError for a line with blanks that has more or fewer words than the first."""
    if rows.mark or max(places) == 2:
        return
    for line, number in zip(rows.lines, rows.numbers, strict=True):
        words = len(line.split())
        if words != rows.width:
            raise InputError(
                name,
                f"has {counted(words, 'word')}, the first line of points {rows.width}",
                f"line {number}",
                AGAIN,
            )


def _read_points(name: str, rows: _Rows, places: tuple[int, int, int]) -> tuple[FloatArray, int]:
    """(N, 3) the points, and how many numbers have a decimal comma. Raises InputError."""
    try:
        # In C, for numbers with points.
        points = np.loadtxt(
            rows.lines, comments=None, delimiter=rows.mark or None, usecols=places, ndmin=2
        )
    except ValueError:
        return _read_words(name, rows, places)
    return points, 0


def _read_words(name: str, rows: _Rows, places: tuple[int, int, int]) -> tuple[FloatArray, int]:
    try:
        words = [_split(line, rows.mark) for line in rows.lines]
        texts = list(chain.from_iterable(map(itemgetter(*places), words)))
        whole, commas = "\n".join(texts), sum("," in text for text in texts)
        if "_" in whole or (commas and "." in whole):
            raise ValueError("no number")
        values = np.array(list(map(float, whole.replace(",", ".").split("\n"))))
    except (ValueError, IndexError) as error:
        raise _explain_fault(name, rows, places) from error
    return values.reshape(-1, 3), commas


def _explain_fault(name: str, rows: _Rows, places: Sequence[int]) -> InputError:
    first: dict[str, int] = {}
    for line, number in zip(rows.lines, rows.numbers, strict=True):
        where, words = f"line {number}", _split(line, rows.mark)
        numbers = [
            words[k] for k in places if k < len(words) and _NUMBER.fullmatch(words[k].strip())
        ]
        if len(numbers) < 3:
            text = make_one_line(line[:40])
            return InputError(name, f"{text!r} is not a point", where, "a line is x y z")
        for mark in ",.":
            if mark in "".join(numbers):
                first.setdefault(mark, number)
        if len(first) == 2:
            return InputError(
                name,
                f"has decimal points (line {first['.']}) and decimal commas (line {first[',']})",
                remedy="write all numbers with a point",
            )
    return InputError(name, "has numbers that cannot be read", remedy=AGAIN)


def _check_first_column(name: str, rows: _Rows, points: FloatArray) -> None:
    """Raises AmbiguousInput if the first of four and more columns may number the points.

    It does if it counts up, or if it holds whole numbers and not all columns beside it do.
    """
    if rows.width < 4:
        return
    points = points[np.isfinite(points).all(axis=1)]
    whole = (points == np.round(points)).all(axis=0)
    counts = len(points) > 1 and bool((np.diff(points[:, 0]) == 1).all())
    if counts or (whole[0] and not whole.all()):
        raise AmbiguousInput(
            name,
            "the first column may be a number of the point, and not x",
            f"line {rows.numbers[0]}, {make_one_line(rows.lines[0][:40])!r}",
            _NAMING,
        )


def _check_commas(name: str, rows: _Rows, points: FloatArray) -> None:
    """Raises AmbiguousInput if whole numbers between commas may be numbers with decimal commas."""
    if rows.mark != "," or not (points == np.round(points)).all():
        return
    widths = {line.count(",") + 1 for line in rows.lines}
    if len(widths) == 1 and max(widths) < _LEAST_PAIRED:
        return
    raise AmbiguousInput(
        name,
        f"the commas of {make_one_line(rows.lines[0][:40])!r} may be decimal ones",
        f"line {rows.numbers[0]}",
        "put semicolons between the columns, or name them in a first line",
    )
