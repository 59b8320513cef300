"""Refuses settings that exclude each other, or have no effect on an operation or an input."""

from __future__ import annotations

import re
from collections.abc import Iterable

from msgspec.structs import asdict, replace

from camgen.model.cell import Cell
from camgen.model.errors import JobError
from camgen.model.job import Job, OperationTable
from camgen.model.pose import Pose
from camgen.robots.workcell import Workcell

_ALL = ("*",)
_SETTING = re.compile(r"\b[a-z]+\.[a-z_]+\b")
#: Settings of programs that are read.
_PROGRAMS = ("dialect", "assume", "signals")
#: Settings of the tool axis along a curve in space.
_TOOL_AXIS = ("axis", "angles")
_EDGES = {
    "input": ("select", *_PROGRAMS),
    "operation": ("offset", "trim", "offset_along", "last_face", "taught_on", "compensation"),
    "tool": ("axis_tilt", *_TOOL_AXIS),
}
_PICTURES = {"image": _ALL, "camera": _ALL}
_REPLAYS = {"process": ("max_feed",)}
_CONTOURS = (
    "side", "planner", "waypoint_spacing", "waypoint_turn", "direction", "corner_radius",
    "inside_first", "stepover", "holes", "rest", "depth", "passes", "lead_in", "lead_out",
    "overlap", "width", "finish", "entry", "entry_angle", "tabs", "tab_spacing", "tab_width",
    "tab_height", "taught_on", "compensation", "shared",
)  # fmt: skip
_CURVES: dict[str, tuple[str, ...]] = {
    **_PICTURES,
    "page": _ALL,
    "input": ("min_length", "select", *_PROGRAMS),
    "tool": ("orient",),
    "tolerance": ("arc_fit", "simplify"),
}
_WAYPOINTS = ("waypoint_spacing", "waypoint_turn")
#: Settings without effect for each kind of input.
_IDLE: dict[str, dict[str, tuple[str, ...]]] = {
    "a drawing": _EDGES | _PICTURES | _REPLAYS | {"operation": (*_EDGES["operation"], *_WAYPOINTS)},
    "a picture": _EDGES | _REPLAYS | {"input": (*_EDGES["input"], "origin")},
    "a 3-D part": {
        **_PICTURES,
        "page": _ALL,
        "input": ("layers", "origin", "join", "min_length", *_PROGRAMS),
        "operation": _CONTOURS,
        "tour": ("seams", "order"),
        "tool": ("orient", *_TOOL_AXIS),
        "process": ("clearance", "retract", "stay_down", *_REPLAYS["process"]),
    },
    "curves in space": _CURVES
    | {
        "operation": (*_CONTOURS, "offset", "offset_along", "last_face"),
        "process": ("clearance", "retract", "stay_down", *_REPLAYS["process"]),
        "tour": ("layers", "seam", "seams", "order"),
    },
    "curves in space on a machine without an arm": _CURVES
    | {
        "operation": (
            *(name for name in _CONTOURS if name not in ("depth", "passes")),
            *("offset", "trim", "offset_along", "last_face"),
        ),
        "tool": ("orient", "axis_tilt", "symmetric", "turn"),
        "process": ("retract", "stay_down", *_REPLAYS["process"]),
        "tour": ("seam", "seams"),
    },
    "the geometric planner": {"operation": _WAYPOINTS},
    "a replay": {
        **_PICTURES,
        "page": _ALL,
        "input": ("units", "layers", "origin", "select", "join", "min_length"),
        "operation": (
            *(name for name in _CONTOURS if name != "compensation"),
            *("offset", "trim", "offset_along", "last_face"),
        ),
        "tool": ("orient", "axis_tilt", "symmetric", "turn", *_TOOL_AXIS),
        "process": (
            *("feed", "force", "plunge", "max_feed_factor", "turn", "retract", "stay_down"),
            *("spindle", "signal", "switch", "dwell"),
        ),
        "tour": ("seams", "order"),
    },
}
#: A robot program states more settings itself, and may name its arm.
_IDLE["a taught program"] = _IDLE["a replay"] | {
    "input": (*_IDLE["a replay"]["input"], "dialect"),
    "operation": (
        "compensation",
        *(name for name in _IDLE["a replay"]["operation"] if name != "taught_on"),
    ),
    "tolerance": ("corner",),
    "process": (*_IDLE["a replay"]["process"], "clearance", *_REPLAYS["process"]),
}

# Only a 3-D part rests on a face; there may be one beside curves in space.
for _kind, _tables in _IDLE.items():
    if _kind not in ("a 3-D part", "curves in space", "the geometric planner"):
        _tables["cell"] = ("rests_on",)

#: Operations that read a setting; all others do not.
_READERS: dict[str, tuple[str, ...]] = {
    "entry": ("follow", "trace", "fill", "pocket", "bore"),
    "entry_angle": ("follow", "trace", "fill", "pocket", "bore"),
    "tabs": ("follow",),
    "tab_spacing": ("follow",),
    "tab_width": ("follow",),
    "tab_height": ("follow",),
    "width": ("chamfer",),
    "finish": ("follow", "pocket", "bore"),
    "stepover": ("fill", "pocket"),
    "engagement": ("pocket",),
    "rest": ("follow", "pocket"),
    "holes": ("drill", "bore"),
    "shared": ("trace",),
}
#: Settings that have no effect without one of the others.
_PARTNERS: dict[str, tuple[str, ...]] = {
    "entry_angle": ("entry",),
    "tab_width": ("tabs", "tab_spacing"),
    "tab_height": ("tabs", "tab_spacing"),
}
#: Settings that have no effect without a depth.
_DEEP = ("entry", "tabs", "tab_spacing")


#: A rule for a job: whether it is broken, the fault, the setting, and the remedy.
Rule = tuple[bool, str, str, str]


def check_rules(rules: Iterable[Rule]) -> None:
    """Raise JobError for the first rule that is broken."""
    for is_broken, what, where, remedy in rules:
        if is_broken:
            raise JobError("job", what, where, remedy)


def check_use(job: Job, operation: str) -> None:
    """Raise JobError for a changed setting of [operation] that `operation` does not read."""
    given, default = asdict(job.operation), asdict(Job().operation)
    changed = [key for key in given if given[key] != default[key]]
    for key in changed:
        where = f"operation.{key}"
        readers = _READERS.get(key, (operation,))
        partners = _PARTNERS.get(key, (key,))
        check_rules(
            [
                (
                    operation not in readers,
                    f"has no effect on {operation}",
                    where,
                    f"leave it out; it is for {' and '.join(readers)}",
                ),
                (
                    operation != "bore" and set(changed).isdisjoint(partners),
                    f"has no effect without operation.{partners[0]}",
                    where,
                    "leave it out",
                ),
                (
                    key in _DEEP and not given["depth"],
                    "has no effect without a depth",
                    where,
                    "set operation.depth, or leave it out",
                ),
            ]
        )


def check_roll(job: Job, cell: Cell | None) -> None:
    """Raise JobError for `tool.symmetric` or `tool.turn` unless an arm may choose the roll."""
    tool = job.tool
    if not tool.symmetric and tool.turn is None:
        return
    key = "tool.symmetric" if tool.symmetric else "tool.turn"
    check_rules(
        [
            (
                cell is not None and isinstance(cell.home, Pose),
                "has no effect on a machine, which turns no tool",
                key,
                "leave it out",
            ),
            (
                not isinstance(cell, Workcell) or cell.arm is None,
                "has no effect without an arm that is checked",
                key,
                "set cell.robot, or leave it out",
            ),
            (
                tool.orient == "follow",
                "a tool that turns with the contour has no turn to choose",
                key,
                "leave out one of the two",
            ),
            (
                job.process.stay_down,
                "a tool that is turned between the paths is lifted",
                "process.stay_down",
                f"leave it out, or {key}",
            ),
        ]
    )


def check_clearance(job: Job, operation: str) -> None:
    """Raise JobError for a clearance height of 0 if the tool touches the part."""
    if job.process.clearance == 0 and (operation != "drill" or job.operation.depth):
        raise JobError(
            "job",
            "the tool travels at the height of the part",
            "process.clearance",
            "raise it; 0 is for drill without a depth: marks that the tool does not touch",
        )


def drop_inherited(row: OperationTable, common: OperationTable) -> OperationTable:
    """Set the settings that a row of [[operations]] inherits and does not read to their defaults.

    common: [operation], from which the row inherits settings that other rows read.
    """
    default, unread = OperationTable(), dict[str, object]()
    for key, readers in _READERS.items():
        is_inherited = getattr(row, key) == getattr(common, key)
        is_read = row.kind in (*readers, "auto")
        partners = _PARTNERS.get(key, ())
        if partners and all(getattr(row, name) == getattr(default, name) for name in partners):
            is_read = False
        if is_inherited and not is_read:
            unread[key] = getattr(default, key)
    return replace(row, **unread)


def check_idle(job: Job, source: str) -> None:
    """Raise JobError for a changed setting that nothing reads for `source`.

    source: kind of input, a key of the table: "a drawing", "a 3-D part".
    """
    if job.tools and not job.operations and source != "a replay":
        raise JobError(
            "job",
            "has tools and no operation that names one",
            "[[tools]] or tool.file",
            "write [[operations]]",
        )
    for table, keys in _IDLE[source].items():
        given, default = asdict(getattr(job, table)), asdict(getattr(Job(), table))
        for key in given if keys is _ALL else keys:
            if given[key] != default[key]:
                raise JobError(
                    "job", f"has no effect on {source}", f"{table}.{key}", "leave it out"
                )


def is_idle(text: str, source: str) -> bool:
    """True if `text` names a setting that nothing reads for `source`."""
    for name in _SETTING.findall(text):
        table, key = name.split(".")
        if key in _IDLE[source].get(table, ()) or _IDLE[source].get(table) is _ALL:
            return True
    return False
