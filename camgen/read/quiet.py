"""Keeps libraries that read files from printing: what the user must know is in the notes."""

from __future__ import annotations

from functools import cache


@cache
def silence(library: str) -> None:
    """Give the logger of a library a handler, so that its messages do not go to stderr."""
    import logging  # noqa: PLC0415 (2 ms, only for readers with such a library)

    logging.getLogger(library).addHandler(logging.NullHandler())
