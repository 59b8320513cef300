"""What an OpenCV FileStorage says, as plain values: YAML 1.0, XML or JSON (OpenCV, "File Input and Output using XML /
YAML / JSON files").

Parsed by the libraries of the formats. OpenCV's own reader ends the process on some damaged files (double free).
"""

from __future__ import annotations

import json
from xml.etree import ElementTree

import numpy as np

from camgen.model.errors import InputError
from camgen.model.pose import FloatArray
from camgen.model.text import counted

#: Text, a list or named values: what all three formats consist of.
Stored = str | list["Stored"] | dict[str, "Stored"]
AGAIN = "copy it again, or calibrate with camgen calibrate"
#: More numbers than these are no matrix of a camera; an alias of YAML may stand for many.
_MOST_NUMBERS = 100
_MATRIX = ("rows", "cols", "data")


def parse_stored(file: str, text: str) -> dict[str, Stored]:
    """The named values of a FileStorage. InputError for text that is none of its formats, or holds no named values."""
    start = text.lstrip()[:1]
    read = _xml if start == "<" else _json if start == "{" else parse_yaml
    try:
        root = read(file, text)
    except RecursionError as error:
        raise InputError(file, "cannot be read: nested too deep", remedy=AGAIN) from error
    if not isinstance(root, dict) or not root or not all(isinstance(key, str) for key in root):
        raise InputError(file, "holds no named values", remedy=AGAIN)
    return root


def parse_yaml(file: str, text: str) -> Stored:
    """YAML as strings, lists and maps, with whatever tag. InputError with the line for what is none."""
    import yaml  # noqa: PLC0415 (loaded only by what needs it)

    # OpenCV writes "%YAML:1.0" for YAML's own "%YAML 1.0". The line stays, for the numbers of the others.
    head, _, rest = text.partition("\n")
    plain = f"#\n{rest}" if head.lstrip().startswith("%YAML") else text
    try:
        found: Stored = yaml.load(plain, Loader=yaml.BaseLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        where = f"line {mark.line + 1}" if mark else ""
        raise InputError(
            file, f"is no YAML: {error.problem or error.context}", where, AGAIN
        ) from error
    except (yaml.YAMLError, RecursionError) as error:
        reason = "nested too deep" if isinstance(error, RecursionError) else str(error)
        raise InputError(file, f"is no YAML: {reason}", remedy=AGAIN) from error
    except (TypeError, ValueError) as error:  # a list or a map for a key
        raise InputError(file, "is no YAML: a key that is no name", remedy=AGAIN) from error
    return found


def _json(file: str, text: str) -> Stored:
    try:
        return _plain(json.loads(text, parse_int=str, parse_float=str, parse_constant=str))
    except json.JSONDecodeError as error:
        raise InputError(file, f"is no JSON: {error.msg}", f"line {error.lineno}", AGAIN) from error


def _plain(value: object) -> Stored:
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items()}
    return [_plain(one) for one in value] if isinstance(value, list) else str(value)


def _xml(file: str, text: str) -> Stored:
    if "<!" in text.replace("<!--", ""):
        raise InputError(
            file, "holds a document type or an entity, which no camera file needs", remedy=AGAIN
        )
    try:
        root = ElementTree.fromstring(text.lstrip())
    except ElementTree.ParseError as error:
        line = error.position[0]
        raise InputError(
            file, f"is no XML: {str(error).partition(':')[0]}", f"line {line}", AGAIN
        ) from error
    return _element(root)


def _element(node: ElementTree.Element) -> Stored:
    """Named children, a list of those called _, or text: of several words a list."""
    if len(node):
        if all(child.tag == "_" for child in node):
            return [_element(child) for child in node]
        return {child.tag: _element(child) for child in node}
    text = (node.text or "").strip()
    words = text.split()
    return text.strip('"') if len(words) < 2 or text.startswith('"') else list[Stored](words)


def find_numbers(file: str, key: str, value: Stored) -> FloatArray:
    """The numbers of a matrix of OpenCV (2-D), of plain lists (1-D or 2-D) or of one number (0-D). InputError where
    they are none, or not as many as their matrix says.
    """
    if isinstance(value, dict) and all(name in value for name in _MATRIX):
        rows, columns = (_count(file, f"{key}: {name}", value[name]) for name in _MATRIX[:2])
        data = value["data"]
        numbers = (
            find_numbers(file, key, [data] if isinstance(data, str) else data)
            if data
            else np.zeros(0)
        )
        if numbers.size != rows * columns:
            what = f"{key} says {rows} x {columns} and holds {counted(numbers.size, 'number')}"
            raise InputError(file, what, remedy=AGAIN)
        return numbers.reshape(rows, columns)
    if isinstance(value, list):
        rows_of = [one if isinstance(one, list) else [one] for one in value[: _MOST_NUMBERS + 1]]
        lengths = {len(row) for row in rows_of}
        flat = (
            [one for row in rows_of for one in row[: _MOST_NUMBERS + 1]]
            if len(lengths) == 1
            else []
        )
        if not flat or len(flat) > _MOST_NUMBERS:
            raise InputError(file, f"{key} is no matrix of numbers", remedy=AGAIN)
        found = np.array([_number(file, key, one) for one in flat])
        return found.reshape(len(rows_of), -1) if isinstance(value[0], list) else found
    if isinstance(value, dict):
        raise InputError(file, f"{key} is no matrix of numbers", remedy=AGAIN)
    return np.array(_number(file, key, value))


def _count(file: str, key: str, value: Stored) -> int:
    number = find_numbers(file, key, value) if isinstance(value, str) else np.array(-1.0)
    if not (0 <= number <= _MOST_NUMBERS) or number % 1:
        raise InputError(file, f"{key} is no number of rows or columns", remedy=AGAIN)
    return int(number)


def _number(file: str, key: str, value: Stored) -> float:
    """A float of these formats. Python's float takes more than that (1_000): what is no plain number is named."""
    text = value if isinstance(value, str) else "a list"
    if text.lower().lstrip("+-") in (".inf", ".nan", "inf", "nan", "infinity"):
        return float("nan")
    try:
        if "_" in text:
            raise ValueError
        return float(text)
    except ValueError as error:
        raise InputError(file, f"{key} holds {cut(text)}, not a number", remedy=AGAIN) from error


def cut(text: str) -> str:
    """A text for a message, quoted, not too long."""
    return repr(text if len(text) <= 40 else text[:40] + "...")
