"""Options of a post as its strict read-back reads them."""

from __future__ import annotations

from collections.abc import Mapping

from camgen.model.errors import JobError


def read_number(options: Mapping[str, object], key: str, default: float) -> float:
    """The option `key` as a number. Raises JobError if it is something else."""
    value = options.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise JobError(f"[post] {key}", f"{value!r} is not a number")
    return value


def read_positive(options: Mapping[str, object], key: str, default: float) -> float:
    """The option `key` as a number above 0, the default if it is something else.

    A post refuses other values itself.
    """
    value = options.get(key, default)
    return float(value) if isinstance(value, int | float) and value > 0 else default


def read_signals(options: Mapping[str, object], default: Mapping[str, int]) -> dict[int, str]:
    """The option `signals`: name of a signal by number of its output.

    Values that are not whole numbers are ignored, as a post refuses them itself.
    """
    table = options.get("signals", default)
    if not isinstance(table, Mapping):
        return {}
    return {number: str(name) for name, number in table.items() if isinstance(number, int)}
