"""A program while it is made: instructions are put at places, a kind at a time, and merged once.

Each row of the table of paths has a place for its instructions. The instructions of a place are in
the order in which they were added, so the first ones in the source come first in the program.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camgen.model.body import merge, pack
from camgen.model.program import Body, Indices, Instruction


class Draft:
    """A body while it is made. Places are counted from the last call of `open`."""

    def __init__(self) -> None:
        self._pieces: list[tuple[Indices, Body]] = []
        self._begin = self._end = 0

    def open(self, count: int) -> None:
        """Adds `count` places after all others."""
        self._begin, self._end = self._end, self._end + count

    def insert(self, places: Indices, items: Sequence[Instruction]) -> None:
        """Adds an instruction at each of `places` (K,), after those that are there."""
        if len(items):
            self._pieces.append((places + self._begin, pack(items)))

    def add(self, *items: Instruction) -> None:
        """Adds instructions after all others."""
        self.open(1)
        self.insert(np.zeros(len(items), np.intp), items)

    def body(self) -> Body:
        """All instructions in order; the draft is empty again."""
        return merge(self._pieces)
