"""How the interpreter stops."""

from __future__ import annotations


class Wrong(Exception):
    """A line that cannot be right, or cannot be read; its text names the word and the reason."""


class Unread(Wrong):
    """A line that may be right, but that the reader does not know."""
