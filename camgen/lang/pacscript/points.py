"""Reads files of variables of a controller, as DENSO's tools export them or with one per line."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping

from camgen.lang.pacscript.values import Unreadable, Value, homogeneous, joints, position, vector

_NAMED = re.compile(
    r"\s*([pjtvifds])\s*\[?\s*(\d{1,9})\s*\]?\s*(?:[,;=\t]|$)\s*(?:[pjtv]\s*\()?(.*?)\)?\s*",
    re.IGNORECASE,
)
_NUMBERED = re.compile(r"\s*\"?(\d{1,9})\"?\s*[,;\t]\s*(.*)")
_LETTER = re.compile(
    r"(?:^|[_\W])([pjtvifd])(?:$|[_\W])|var[_\W]?([pjtvifd])\b|\b([pjtvifd])[_\W]?var",
    re.IGNORECASE,
)
_NUMBER = re.compile(r"\s*\"?\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?)(?=$|[^\w.])")
_FIELDS = re.compile(r"[,;\t]")


def read_points(files: Mapping[str, str]) -> tuple[dict[tuple[str, int], Value], list[str]]:
    """Read the variables of files.

    A line is `P[1], x, y, z, rx, ry, rz, fig` or `P1 = P(...)`. In the lists that DENSO's tools
    export it begins with the number, and the letter is in the name of the file (`P_Var.csv`). All
    other lines are headings.

    Returns the values by letter and number, and texts about lines that cannot be read.
    """
    values: dict[tuple[str, int], Value] = {}
    faulty: list[str] = []
    for name, text in files.items():
        letter = _letter(name)
        for row, (kind, at, rest) in _rows(text, letter):
            try:
                values[(kind, at)] = _read(kind, rest)
            except Unreadable as error:
                if len(faulty) < 20:
                    faulty.append(f"{name}, line {row}: {error}")
    return values, faulty


def _letter(name: str) -> str:
    match = _LETTER.search(re.split(r"[\\/]", name)[-1].rsplit(".", 1)[0])
    return next((letter for letter in match.groups() if letter), "p").lower() if match else "p"


def _rows(text: str, letter: str) -> Iterator[tuple[int, tuple[str, int, str]]]:
    for row, line in enumerate(text.replace("\r", "\n").split("\n"), start=1):
        plain = line.split("'", 1)[0].strip() if not line.lstrip().startswith('"') else line.strip()
        if len(plain) > 2000:
            continue
        if match := _NAMED.fullmatch(plain):
            yield row, (match[1].lower(), int(match[2]), match[3])
        elif match := _NUMBERED.fullmatch(plain):
            yield row, (letter, int(match[1]), match[2])


def _read(kind: str, rest: str) -> Value:
    values: list[float] = []
    for field in _FIELDS.split(rest):
        match = _NUMBER.match(field)
        if match is None:
            break
        values.append(float(match[1]))
    if kind == "s":
        return rest.strip().strip('"')
    if not values:
        raise Unreadable(f"{kind.upper()} without numbers")
    if kind in _MAKES:
        return _MAKES[kind](values)
    return values[0]


_MAKES: dict[str, Callable[[list[float]], Value]] = {
    "p": lambda values: position(values[:7]),
    "j": lambda values: joints(values[:8]),
    "v": lambda values: vector(values[:3]),
    "t": lambda values: homogeneous(values[:10]),
}
