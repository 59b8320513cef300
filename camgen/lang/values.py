"""Values that all languages share."""

from __future__ import annotations

from msgspec import Struct


class Unknown(Struct, frozen=True, gc=False):
    """A value that the text does not determine.

    what: its source in words, such as "IO[24]".
    key: name under which the user sets it (`--assume`), empty if no name sets it.
    guess: truth of a condition if inputs are off until the program hears them, None without one.
    """

    what: str = ""
    key: str = ""
    guess: bool | None = None
