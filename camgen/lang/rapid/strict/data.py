"""Faults of records in RAPID programs of a post (RAPID system data types manual)."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import cast

from camgen.lang.rapid.types import UNUSED, Value


def numbers(value: Value) -> tuple[float, ...]:
    """A value whose type was checked to be numbers only."""
    return cast(tuple[float, ...], value)


def record_fault(kind: str, value: Value) -> str:
    """The fault of the numbers of a record, empty without one."""
    if kind == "orient":
        return orient_fault(numbers(value))
    return _find_fault(kind, numbers(value))


@lru_cache(maxsize=1000)
def posture_fault(parts: tuple[tuple[float, ...], ...]) -> str:
    """The fault of the configuration or the external axes of a robtarget, empty without one."""
    conf, external = parts
    return _find_fault("confdata", conf) or _find_fault("extjoint", external)


def orient_fault(q: tuple[float, ...]) -> str:
    """The fault of a quaternion, empty without one."""
    w, x, y, z = q
    deviation = abs(w * w + x * x + y * y + z * z - 1)
    if deviation <= 1e-5:
        return ""
    return f"a quaternion is not normalised (its square differs from 1 by {deviation:.2g})"


def _find_fault(kind: str, parts: tuple[float, ...]) -> str:
    is_wrong, fault = _FAULTS.get(kind, (None, ""))
    if is_wrong is not None and is_wrong(parts):
        return fault
    return ""


#: Test of the numbers of a record for the fault after it.
_FAULTS: dict[str, tuple[Callable[[tuple[float, ...]], bool], str]] = {
    "extjoint": (lambda axes: any(v != UNUSED for v in axes), "external axes are not read"),
    "confdata": (lambda conf: any(v != int(v) for v in conf), "confdata must be whole numbers"),
    "speeddata": (
        lambda speed: min(speed[:2]) <= 0 or min(speed) < 0,
        "a speed that is not positive",
    ),
    "zonedata": (
        lambda zone: not zone[0] and zone[1] <= 0,
        "a zone that is not a stop point must have a radius",
    ),
}
