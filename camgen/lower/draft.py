"""A program in the making: instructions are put at places, a kind at a time for all paths, and merged once.

Where a path has a row of the table that ``lower`` works on, its instructions have a place. Those of one place stand in
the order in which they are put there, so that what is written first in the source comes first in the program.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from camgen.model.body import merge, pack
from camgen.model.program import Body, Indices, Instruction


class Draft:
    """A body in the making. Places are counted from where ``open`` was called last."""

    def __init__(self) -> None:
        self._pieces: list[tuple[Indices, Body]] = []
        self._begin = self._end = 0

    def open(self, count: int) -> None:
        """So many more places, behind all others."""
        self._begin, self._end = self._end, self._end + count

    def put(self, places: Indices, items: Sequence[Instruction]) -> None:
        """An instruction at each of ``places`` (K,), behind what is there."""
        if len(items):
            self._pieces.append((places + self._begin, pack(items)))

    def add(self, *items: Instruction) -> None:
        """Instructions behind all others."""
        self.open(1)
        self.put(np.zeros(len(items), np.intp), items)

    def body(self) -> Body:
        """All that was put there, in order; the draft is empty again."""
        return merge(self._pieces)
