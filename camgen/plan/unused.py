"""Settings that would have no effect on a kind of input: an error, not a belief."""

from __future__ import annotations

import re

from msgspec.structs import asdict

from camgen.model.errors import JobError
from camgen.model.job import Job

_ALL = ("*",)
_SETTING = re.compile(r"\b[a-z]+\.[a-z_]+\b")
#: How a tool stands along a curve in space.
_STAND = ("axis", "angles")
_EDGES = {
    "input": ("select",),
    "operation": ("offset", "trim", "offset_along", "last_face"),
    "tool": ("axis_tilt", "symmetric", *_STAND),
}
_PICTURES = {"image": _ALL, "camera": _ALL}
_REPLAYS = {"process": ("max_feed",)}
_CONTOURS = (
    "side", "planner", "waypoint_spacing", "waypoint_turn", "direction", "corner_radius", "inside_first", "stepover",
    "holes", "depth", "passes", "lead_in", "lead_out", "overlap", "width", "finish", "entry", "entry_angle", "tabs",
    "tab_spacing", "tab_width", "tab_height",
)  # fmt: skip
_CURVES: dict[str, tuple[str, ...]] = {
    **_PICTURES,
    "page": _ALL,
    "input": ("min_length", "select"),
    "tool": ("orient",),
    "tolerance": ("arc_fit", "simplify"),
}
_WAYPOINTS = ("waypoint_spacing", "waypoint_turn")
#: By what is built from: the settings that nothing reads.
_IDLE: dict[str, dict[str, tuple[str, ...]]] = {
    "a drawing": _EDGES | _PICTURES | _REPLAYS | {"operation": (*_EDGES["operation"], *_WAYPOINTS)},
    "a picture": _EDGES | _REPLAYS,
    "a 3-D part": {
        **_PICTURES,
        "page": _ALL,
        "input": ("layers", "join", "min_length"),
        "operation": _CONTOURS,
        "tool": ("orient", *_STAND),
        "tolerance": ("corner",),
        "process": ("clearance", "retract", "stay_down", *_REPLAYS["process"]),
    },
    "curves in space": _CURVES
    | {
        "operation": (*_CONTOURS, "offset", "offset_along", "last_face"),
        "process": ("clearance", "retract", "stay_down", *_REPLAYS["process"]),
        "tour": ("layers", "seam"),
    },
    "curves in space on a machine without an arm": _CURVES
    | {
        "operation": (
            *(name for name in _CONTOURS if name not in ("depth", "passes")),
            *("offset", "trim", "offset_along", "last_face"),
        ),
        "tool": ("orient", "axis_tilt", "symmetric"),
        "process": ("retract", "stay_down", *_REPLAYS["process"]),
        "tour": ("seam",),
    },
    "the geometric planner": {"operation": _WAYPOINTS},
    "a replay": {
        **_PICTURES,
        "page": _ALL,
        "input": ("units", "layers", "select", "join", "min_length"),
        "operation": (*_CONTOURS, "offset", "trim", "offset_along", "last_face"),
        "tool": ("orient", "axis_tilt", "symmetric", *_STAND),
        "process": (
            *("feed", "force", "plunge", "max_feed_factor", "turn", "retract", "stay_down"),
            *("spindle", "signal", "switch", "dwell"),
        ),
    },
}


def no_idle(job: Job, source: str) -> None:
    """JobError for a setting of ``job`` that is not its default and that nothing reads for ``source``, a key of
    the table: "a drawing", "a 3-D part".
    """
    for table, keys in _IDLE[source].items():
        given, default = asdict(getattr(job, table)), asdict(getattr(Job(), table))
        for key in given if keys is _ALL else keys:
            if given[key] != default[key]:
                raise JobError("job", f"has no effect on {source}", f"{table}.{key}", "leave it out")


#: What holds parts that are cut out, for operations that cut none out.
TABS = ("tabs", "tab_spacing", "tab_width", "tab_height")
#: How a tool gets into the material, for those that go straight down into it.
ENTRIES = ("entry", "entry_angle")
#: Settings of a cut, each with the one that it says more of.
_MORE = {"entry_angle": ("entry",), "tab_width": ("tabs", "tab_spacing"), "tab_height": ("tabs", "tab_spacing")}


def no_idle_cut(job: Job, idle: tuple[str, ...] = ()) -> None:
    """JobError for what is said of entries and tabs of ``job`` and has no effect: on an operation that has none of
    ``idle``, without a depth, or without entries and tabs.
    """
    given, default = asdict(job.operation), asdict(Job().operation)
    changed = [key for key in (*ENTRIES, *TABS) if given[key] != default[key]]
    for key in changed:
        where = f"operation.{key}"
        if key in idle:
            raise JobError("job", "has no effect on this operation", where, "leave it out")
        if not any(one in changed for one in _MORE.get(key, (key,))):
            raise JobError("job", f"has no effect without operation.{_MORE[key][0]}", where, "leave it out")
        if not given["depth"]:
            raise JobError("job", "has no effect without a depth", where, "set operation.depth, or leave it out")


def is_idle(text: str, source: str) -> bool:
    """Whether ``text`` names a setting that nothing reads for ``source``."""
    found = (name.split(".") for name in _SETTING.findall(text))
    return any(keys is _ALL or key in keys for table, key in found for keys in [_IDLE[source].get(table, ())])
