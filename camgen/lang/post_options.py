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
