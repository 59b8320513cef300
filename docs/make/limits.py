"""The limits of inputs as a table in Markdown."""

from __future__ import annotations

from typing import get_args, get_type_hints

from msgspec.structs import asdict

from camgen.model.limits import Limits, format_limit


def format_limits() -> str:
    """A table with the value and the description of each limit."""
    hints = get_type_hints(Limits, include_extras=True)
    rows = ["| limit | value | of what |", "|---|---|---|"]
    for name, value in asdict(Limits()).items():
        description = get_args(hints[name])[1].description
        rows.append(f"| `{name}` | {format_limit(value)} | {description} |")
    return "\n".join(rows) + "\n"
