"""The error of mesh files that are sound and hold a shape that is not read."""

from __future__ import annotations


class UnreadShape(Exception):
    """A shape that is not read; the text names it."""
