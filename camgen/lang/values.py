"""Values that all languages share."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeVar

from msgspec import Struct

_Value = TypeVar("_Value")


class Unknown(Struct, frozen=True, gc=False):
    """A value that the text does not determine.

    what: its source in words, such as "IO[24]".
    key: name under which the user sets it (`--assume`), empty if no name sets it.
    guess: truth of a condition if inputs are off until the program hears them, None without one.
    """

    what: str = ""
    key: str = ""
    guess: bool | None = None


def find_first_unknown(values: Iterable[object]) -> Unknown | None:
    """The first of the values that is unknown, None if all are known."""
    return next((value for value in values if isinstance(value, Unknown)), None)


def require(value: _Value | None, fault: Exception) -> _Value:
    """Return a value that is not None. Raises `fault` for None."""
    if value is None:
        raise fault
    return value
