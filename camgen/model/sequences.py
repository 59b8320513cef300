"""Selections from sequences."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from typing import TypeVar

_Item = TypeVar("_Item")
_Key = TypeVar("_Key", bound=Hashable)


def pick(items: Sequence[_Item], indices: Iterable[int]) -> list[_Item]:
    """The items of these indices, in the order of the indices."""
    return [items[k] for k in indices]


def find_first_places(keys: Sequence[_Key]) -> dict[_Key, int]:
    """The index of the first of equal keys, by key; the last key comes first."""
    return dict(zip(reversed(keys), reversed(range(len(keys))), strict=True))
