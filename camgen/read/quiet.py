"""Libraries that read files say what they think of them in logs; what a user must know of it is in the notes."""

from __future__ import annotations

from functools import cache


@cache
def silence(library: str) -> None:
    """What ``library`` logs ends up on stderr no more, as it would where nobody has set up a handler."""
    import logging  # noqa: PLC0415 (2 ms, only for those who have such a library)

    logging.getLogger(library).addHandler(logging.NullHandler())
