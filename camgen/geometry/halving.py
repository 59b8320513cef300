"""Bisection of many ranges at once, for tests that are cheaper together than one by one."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import TypeVar

_Key = TypeVar("_Key", bound=Hashable)


def find_first(
    counts: Mapping[_Key, int], passes: Callable[[Mapping[_Key, int]], Sequence[bool]]
) -> dict[_Key, int]:
    """Find, for each key, the first index from 0 to `counts[key]` - 1 that passes a test.

    Bisection of all keys at once. If an index passes, all later ones of its key must pass too.
    Keys without a passing index are left out of the result.

    passes: the test. It gets one index for each of some keys and returns a bool for each, in their
        order. It is called once per halving of the longest range.
    """
    ranges = {key: (0, count) for key, count in counts.items() if count}
    while True:
        middles = {key: (low + high) // 2 for key, (low, high) in ranges.items() if low < high}
        if not middles:
            break
        for (key, middle), result in zip(middles.items(), passes(middles), strict=True):
            low, high = ranges[key]
            ranges[key] = (low, middle) if result else (middle + 1, high)
    return {key: low for key, (low, _) in ranges.items() if low < counts[key]}
