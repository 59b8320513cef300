"""Parses an OpenCV FileStorage into plain values: YAML 1.0, XML or JSON.

See OpenCV, "File Input and Output using XML / YAML / JSON files". The files are parsed by the
libraries of the formats, as OpenCV's own reader ends the process on some damaged files (double
free).
"""

from __future__ import annotations

import json
from itertools import chain
from xml.etree import ElementTree

import numpy as np

from camgen.model.errors import InputError
from camgen.model.pose import FloatArray
from camgen.model.text import counted

#: A value of a file: text, a list, or named values. All three formats consist of these.
Stored = str | list["Stored"] | dict[str, "Stored"]
AGAIN = "copy it again, or calibrate with camgen calibrate"
#: Numbers of a matrix, at most. A matrix of a camera has fewer; aliases of YAML may make millions.
_MAX_NUMBERS = 100
_MATRIX_KEYS = ("rows", "cols", "data")
#: Numbers that are not finite, in lower case and without a sign: of YAML, JSON and XML.
_NOT_FINITE = (".inf", ".nan", "inf", "nan", "infinity")
#: Characters of a text that a message quotes, at most.
_MAX_QUOTED = 40


def parse_stored(file: str, text: str) -> dict[str, Stored]:
    """Parse a FileStorage in any of its formats into its named values.

    Raises InputError for text in none of the formats, and for text without named values.
    """
    parse = {"<": _parse_xml, "{": _parse_json}.get(text.lstrip()[:1], parse_yaml)
    try:
        root = parse(file, text)
    except RecursionError as error:
        raise InputError(file, "cannot be read: nested too deep", remedy=AGAIN) from error
    if not isinstance(root, dict) or not root or not all(isinstance(key, str) for key in root):
        raise InputError(file, "holds no named values", remedy=AGAIN)
    return root


def parse_yaml(file: str, text: str) -> Stored:
    """Parse YAML into strings, lists and maps; tags are ignored.

    Raises InputError for invalid YAML, with the line.
    """
    import yaml  # noqa: PLC0415 (loaded only by what needs it)

    # OpenCV writes "%YAML:1.0" for "%YAML 1.0". A comment in its place keeps the line numbers.
    head, _, rest = text.partition("\n")
    plain = f"#\n{rest}" if head.lstrip().startswith("%YAML") else text
    try:
        value: Stored = yaml.load(plain, Loader=yaml.BaseLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        where = f"line {mark.line + 1}" if mark else ""
        raise InputError(
            file, f"is not YAML: {error.problem or error.context}", where, AGAIN
        ) from error
    except (yaml.YAMLError, RecursionError) as error:
        reason = "nested too deep" if isinstance(error, RecursionError) else str(error)
        raise InputError(file, f"is not YAML: {reason}", remedy=AGAIN) from error
    except (TypeError, ValueError) as error:  # A list or a map is used as a key.
        raise InputError(file, "is not YAML: a key is not a name", remedy=AGAIN) from error
    return value


def _parse_json(file: str, text: str) -> Stored:
    """Parse JSON; numbers stay text. Raises InputError for invalid JSON, with the line."""
    try:
        value = json.loads(text, parse_int=str, parse_float=str, parse_constant=str)
    except json.JSONDecodeError as error:
        raise InputError(
            file, f"is not JSON: {error.msg}", f"line {error.lineno}", AGAIN
        ) from error
    return _convert_json(value)


def _convert_json(value: object) -> Stored:
    if isinstance(value, dict):
        return {key: _convert_json(child) for key, child in value.items()}
    if isinstance(value, list):
        return [_convert_json(child) for child in value]
    return str(value)


def _parse_xml(file: str, text: str) -> Stored:
    """Parse XML. Raises InputError for invalid XML, with the line.

    A document type or an entity is refused: entities could make a short text very long.
    """
    if "<!" in text.replace("<!--", ""):
        raise InputError(
            file, "holds a document type or an entity, which no camera file needs", remedy=AGAIN
        )
    try:
        root = ElementTree.fromstring(text.lstrip())
    except ElementTree.ParseError as error:
        what = f"is not XML: {str(error).partition(':')[0]}"
        raise InputError(file, what, f"line {error.position[0]}", AGAIN) from error
    return _convert_element(root)


def _convert_element(node: ElementTree.Element) -> Stored:
    """Convert an element to its named children, or to a list if all are called `_`.

    An element without children is its text, or a list if the text has several words and no quotes.
    """
    if len(node):
        if all(child.tag == "_" for child in node):
            return [_convert_element(child) for child in node]
        return {child.tag: _convert_element(child) for child in node}
    text = (node.text or "").strip()
    words = text.split()
    if len(words) < 2 or text.startswith('"'):
        return text.strip('"')
    return list[Stored](words)


def find_numbers(file: str, key: str, value: Stored) -> FloatArray:
    """Convert a value to an array of floats.

    key: name of the value, for errors.
    value: a matrix of OpenCV with rows, cols and data (2-D result), a list of numbers (1-D), a list
        of lists of equal length (2-D), or a single number (0-D).

    A number that is not finite becomes nan. Raises InputError for anything else, for more than
    `_MAX_NUMBERS`, and for a matrix whose size is not rows times cols.
    """
    if isinstance(value, dict) and all(name in value for name in _MATRIX_KEYS):
        return _convert_matrix(file, key, value)
    if isinstance(value, list):
        return _convert_list(file, key, value)
    if isinstance(value, dict):
        raise InputError(file, f"{key} is not a matrix of numbers", remedy=AGAIN)
    return np.array(_convert_number(file, key, value))


def _convert_matrix(file: str, key: str, value: dict[str, Stored]) -> FloatArray:
    rows = _convert_count(file, f"{key}: rows", value["rows"])
    columns = _convert_count(file, f"{key}: cols", value["cols"])
    data = value["data"]
    numbers = np.zeros(0)
    if data:
        # XML has a single number as text, without a list.
        numbers = find_numbers(file, key, [data] if isinstance(data, str) else data)
    if numbers.size != rows * columns:
        raise InputError(
            file,
            f"{key} says {rows} x {columns} and holds {counted(numbers.size, 'number')}",
            remedy=AGAIN,
        )
    return numbers.reshape(rows, columns)


def _convert_list(file: str, key: str, value: list[Stored]) -> FloatArray:
    # One number more than allowed is enough to find out that there are too many.
    limit = _MAX_NUMBERS + 1
    rows = [row if isinstance(row, list) else [row] for row in value[:limit]]
    flat = list(chain.from_iterable(row[:limit] for row in rows))
    if len({len(row) for row in rows}) != 1 or not 0 < len(flat) <= _MAX_NUMBERS:
        raise InputError(file, f"{key} is not a matrix of numbers", remedy=AGAIN)
    numbers = np.array([_convert_number(file, key, number) for number in flat])
    return numbers.reshape(len(rows), -1) if isinstance(value[0], list) else numbers


def _convert_count(file: str, key: str, value: Stored) -> int:
    number = find_numbers(file, key, value) if isinstance(value, str) else np.array(-1.0)
    if not (0 <= number <= _MAX_NUMBERS) or number % 1:
        raise InputError(file, f"{key} is not a number of rows or columns", remedy=AGAIN)
    return int(number)


def _convert_number(file: str, key: str, value: Stored) -> float:
    """A float as these formats spell it; nan for one that is not finite.

    Raises InputError for anything else, also for 1_000, which Python's `float` accepts.
    """
    text = value if isinstance(value, str) else "a list"
    if text.lower().lstrip("+-") in _NOT_FINITE:
        return float("nan")
    try:
        if "_" in text:
            raise ValueError
        return float(text)
    except ValueError as error:
        raise InputError(
            file, f"{key} holds {quote_shortened(text)}, not a number", remedy=AGAIN
        ) from error


def quote_shortened(text: str) -> str:
    """Quote a text for a message, shortened to `_MAX_QUOTED` characters."""
    return repr(text if len(text) <= _MAX_QUOTED else text[:_MAX_QUOTED] + "...")
