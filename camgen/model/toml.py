"""Values as TOML."""

from __future__ import annotations

import json
import math
from datetime import date, time


def format_toml(value: object) -> str:
    """`value` as TOML: texts, numbers, lists and inline tables."""
    if isinstance(value, dict):
        return (
            "{ "
            + ", ".join(f"{format_toml(str(k))} = {format_toml(v)}" for k, v in value.items())
            + " }"
            if value
            else "{}"
        )
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(format_toml(item) for item in value) + "]"
    if isinstance(value, (date, time)):
        return value.isoformat()
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    # TOML escapes the control character DEL, JSON does not.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
