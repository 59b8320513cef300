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
    find_fault = _FAULTS.get(kind)
    return find_fault(numbers(value)) if find_fault else ""


@lru_cache(maxsize=1000)
def posture_fault(parts: tuple[tuple[float, ...], ...]) -> str:
    """The fault of the configuration or the external axes of a robtarget, empty without one."""
    conf, external = parts
    return _quarters(conf) or _external(external)


def orient_fault(q: tuple[float, ...]) -> str:
    """The fault of a quaternion, empty without one."""
    w, x, y, z = q
    deviation = abs(w * w + x * x + y * y + z * z - 1)
    if deviation <= 1e-5:
        return ""
    return f"a quaternion is not normalised (its square differs from 1 by {deviation:.2g})"


def _external(axes: tuple[float, ...]) -> str:
    return "external axes are not read" if any(v != UNUSED for v in axes) else ""


def _quarters(conf: tuple[float, ...]) -> str:
    return "confdata must be whole numbers" if any(v != int(v) for v in conf) else ""


def _speed(speed: tuple[float, ...]) -> str:
    return "a speed that is not positive" if min(speed[:2]) <= 0 or min(speed) < 0 else ""


def _zone(zone: tuple[float, ...]) -> str:
    return (
        "a zone that is not a stop point must have a radius" if not zone[0] and zone[1] <= 0 else ""
    )


_FAULTS: dict[str, Callable[[tuple[float, ...]], str]] = {
    "orient": orient_fault,
    "extjoint": _external,
    "confdata": _quarters,
    "speeddata": _speed,
    "zonedata": _zone,
}
