"""Selections from sequences."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from typing import Any, TypeVar, overload

_Item = TypeVar("_Item")
_Key = TypeVar("_Key", bound=Hashable)


@overload
def take_rows(items: Sequence[_Item], rows: Iterable[int]) -> list[_Item]: ...


@overload
def take_rows(items: Mapping[_Key, _Item], rows: Iterable[_Key]) -> list[_Item]: ...


def take_rows(items: Any, rows: Any) -> Any:
    """The items in `rows`, in the order of `rows`; of a mapping the items of these keys."""
    return [items[row] for row in rows]


def find_first_places(keys: Sequence[_Key]) -> dict[_Key, int]:
    """The index of the first of equal keys, by key; the last key comes first."""
    return dict(zip(reversed(keys), reversed(range(len(keys))), strict=True))
