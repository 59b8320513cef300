"""Settings that would have no effect on a kind of input: an error, not a belief."""

from __future__ import annotations

import re

from msgspec.structs import asdict

from camgen.model.errors import JobError
from camgen.model.job import Job

_ALL = ("*",)
_SETTING = re.compile(r"\b[a-z]+\.[a-z_]+\b")
_EDGES = {
    "input": ("select",),
    "operation": ("offset", "trim", "offset_along"),
    "tool": ("axis_tilt", "symmetric"),
}
_PICTURES = {"image": _ALL, "camera": _ALL}
_REPLAYS = {"process": ("max_feed",)}
_CONTOURS = (
    "side", "planner", "direction", "corner_radius", "inside_first", "stepover", "holes", "depth", "passes", "lead_in",
    "lead_out", "overlap",
)  # fmt: skip
#: By what is built from: the settings that nothing reads.
_IDLE: dict[str, dict[str, tuple[str, ...]]] = {
    "a drawing": _EDGES | _PICTURES | _REPLAYS,
    "a picture": _EDGES | _REPLAYS,
    "a 3-D part": {
        **_PICTURES,
        "page": _ALL,
        "input": ("layers", "join", "min_length"),
        "operation": _CONTOURS,
        "tool": ("orient",),
        "process": ("clearance", "retract", "stay_down", *_REPLAYS["process"]),
    },
    "a replay": {
        **_PICTURES,
        "page": _ALL,
        "input": ("units", "layers", "select", "join", "min_length"),
        "operation": (*_CONTOURS, "offset", "trim", "offset_along"),
        "tool": ("orient", "axis_tilt", "symmetric"),
        "process": (
            *("feed", "force", "plunge", "max_feed_factor", "turn", "retract", "stay_down"),
            *("spindle", "signal", "switch", "dwell"),
        ),
    },
}


def no_idle(job: Job, source: str) -> None:
    """JobError for a setting of ``job`` that is not its default and that nothing reads for ``source``, "a drawing", "a
    picture", "a 3-D part" or "a replay".
    """
    for table, keys in _IDLE[source].items():
        given, default = asdict(getattr(job, table)), asdict(getattr(Job(), table))
        for key in given if keys is _ALL else keys:
            if given[key] != default[key]:
                raise JobError("job", f"has no effect on {source}", f"{table}.{key}", "leave it out")


def is_idle(text: str, source: str) -> bool:
    """Whether ``text`` names a setting that nothing reads for ``source``."""
    found = (name.split(".") for name in _SETTING.findall(text))
    return any(keys is _ALL or key in keys for table, key in found for keys in [_IDLE[source].get(table, ())])
