"""Halving for many searches at once, where one question costs nearly as much as a hundred asked together."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import TypeVar

_Key = TypeVar("_Key", bound=Hashable)


def find_first(
    counts: Mapping[_Key, int], hold: Callable[[Mapping[_Key, int]], Sequence[bool]]
) -> dict[_Key, int]:
    """By key the first of the places 0 to ``counts`` - 1 that holds, where all behind one that holds do too; not those
    of which none holds. hold: whether these places of some keys do, in the order of the keys; it is asked as often as
    the longest search is halved.
    """
    left = {key: (0, count) for key, count in counts.items() if count}
    while asked := {key: (low + high) // 2 for key, (low, high) in left.items() if low < high}:
        for (key, at), holds in zip(asked.items(), hold(asked), strict=True):
            low, high = left[key]
            left[key] = (low, at) if holds else (at + 1, high)
    return {key: low for key, (low, _) in left.items() if low < counts[key]}
