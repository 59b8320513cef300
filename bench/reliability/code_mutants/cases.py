"""The jobs that each mutant builds: small drawings, every number given, all five posts."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

from bench.reliability.code_mutants.shapes import Shape, circle
from fixtures import make_dxf

#: Bulge of a quarter circle, counter-clockwise.
_QUARTER = math.tan(math.pi / 8.0)

#: An outline with sharp corners, one of them inner, and one that an arc of 8 mm rounds; two holes.
_OUTLINE = Shape(
    "outline",
    (
        (0.0, 0.0, 0.0),
        (60.0, 0.0, 0.0),
        (60.0, 32.0, _QUARTER),
        (52.0, 40.0, 0.0),
        (30.0, 40.0, 0.0),
        (30.0, 30.0, 0.0),
        (0.0, 30.0, 0.0),
    ),
)
_PLATE = (_OUTLINE, circle("large hole", 15.0, 15.0, 8.0), circle("small hole", 45.0, 18.0, 5.0))
#: A line, an arc tangent to a line, and a zigzag with sharp corners.
_LINES = (
    Shape("line", ((0.0, 0.0, 0.0), (40.0, 10.0, 0.0)), is_closed=False),
    Shape(
        "hook",
        ((0.0, 20.0, 0.0), (30.0, 20.0, _QUARTER), (40.0, 30.0, 0.0)),
        is_closed=False,
    ),
    Shape(
        "zigzag",
        ((0.0, 40.0, 0.0), (10.0, 50.0, 0.0), (20.0, 40.0, 0.0), (30.0, 50.0, 0.0)),
        is_closed=False,
    ),
)
#: Lines that meet three at a time, which tracing joins into fewer strokes, and a closed square.
_NETWORK = (
    Shape("bar", ((0.0, 0.0, 0.0), (20.0, 0.0, 0.0)), is_closed=False),
    Shape("bar on", ((20.0, 0.0, 0.0), (40.0, 0.0, 0.0)), is_closed=False),
    Shape("stem", ((20.0, 0.0, 0.0), (20.0, 25.0, 0.0)), is_closed=False),
    Shape("roof", ((0.0, 25.0, 0.0), (20.0, 25.0, 0.0)), is_closed=False),
    Shape("roof on", ((20.0, 25.0, 0.0), (40.0, 25.0, 0.0)), is_closed=False),
    Shape("square", ((50.0, 0.0, 0.0), (60.0, 0.0, 0.0), (60.0, 10.0, 0.0), (50.0, 10.0, 0.0))),
)
_HOLES = (
    circle("first", 5.0, 5.0, 1.5),
    circle("second", 35.0, 8.0, 1.5),
    circle("third", 20.0, 25.0, 1.5),
    circle("fourth", 40.0, 30.0, 1.5),
)
_TRAY = (Shape("wall", ((0.0, 0.0, 0.0), (30.0, 0.0, 0.0), (30.0, 20.0, 0.0), (0.0, 20.0, 0.0))),)
#: Two plates with a gap of 12 mm, between which a tool of 6 mm may stay down.
_PAIR = (
    Shape("left", ((0.0, 0.0, 0.0), (20.0, 0.0, 0.0), (20.0, 20.0, 0.0), (0.0, 20.0, 0.0))),
    Shape("right", ((32.0, 0.0, 0.0), (52.0, 0.0, 0.0), (52.0, 20.0, 0.0), (32.0, 20.0, 0.0))),
)

_PROCESS = {
    "feed": 20.0,
    "plunge": 5.0,
    "travel": 90.0,
    "approach": 2.0,
    "clearance": 15.0,
    "max_feed_factor": 1.5,
    "acceleration": 1000.0,
}
_SPINNING = {**_PROCESS, "spindle": 8000.0, "dwell": 0.5, "signal": "", "switch": "contact"}
#: A drill goes down at the feed.
_DRILLING = {key: value for key, value in _SPINNING.items() if key != "plunge"}
_PECKING = {key: value for key, value in _PROCESS.items() if key != "plunge"}
_TOLERANCE = {"chord": 0.01, "arc_fit": 0.01, "corner": 0.05}
_CELL = {
    "base_from_work": [310.0, -40.0, 120.0, 0.0, 0.0, 0.0],
    "flange_from_tool": [0.0, 0.0, 110.0, 0.0, 0.0, 0.0],
}


#: The mark between the files of a program.
FILE_MARK = "\f"


class Case(NamedTuple):
    """A job and the drawing that it works on.

    kind: operation that the judge expects: follow, trace, pocket, drill or operations.
    signal: name of the output along contours as a trace has it; empty without one.
    spindle: name of the output of the spindle, "S" for G-code; empty without one.
    """

    name: str
    post: str
    kind: str
    shapes: tuple[Shape, ...]
    job: dict[str, dict[str, object]]
    signal: str = ""
    spindle: str = ""

    def setting(self, table: str, key: str, default: float = 0.0) -> float:
        """A number of the job."""
        value = self.job.get(table, {}).get(key, default)
        assert isinstance(value, int | float)
        return float(value)


def _job(process: dict[str, object], **tables: dict[str, object]) -> dict[str, dict[str, object]]:
    return {
        "process": process,
        "tolerance": dict(_TOLERANCE),
        "tool": {"diameter": 6.0},
        **tables,
    }


CASES = (
    Case(
        "leads",
        "rapid",
        "follow",
        _PLATE,
        _job(
            _PROCESS,
            operation={"kind": "follow", "lead_in": 2.0, "lead_out": 1.5, "overlap": 1.0},
            cell=_CELL,
        ),
        signal="doprocess",
    ),
    Case(
        "conventional",
        "vplus",
        "follow",
        _PLATE,
        _job(
            {**_PROCESS, "dwell": 0.25},
            operation={"kind": "follow", "direction": "conventional"},
            cell=_CELL,
        ),
        signal="signal 33",
    ),
    Case(
        "passes",
        "gcode",
        "follow",
        _PLATE,
        _job(
            _SPINNING,
            operation={"kind": "follow", "depth": 3.0, "passes": 2, "lead_in": 2.0},
            tour={"method": "nearest"},
        ),
        spindle="S",
    ),
    Case(
        "tabs",
        "grbl",
        "follow",
        _PLATE,
        _job(
            _SPINNING,
            operation={
                "kind": "follow",
                "depth": 4.0,
                "passes": 2,
                "entry": "ramp",
                "entry_angle": 10.0,
                "tabs": 3,
                "tab_width": 4.0,
                "tab_height": 1.5,
            },
        ),
        spindle="S",
    ),
    Case(
        "lines",
        "pacscript",
        "trace",
        _LINES,
        _job({**_PROCESS, "dwell": 0.2}, operation={"kind": "trace"}, cell=_CELL),
        signal="io 24",
    ),
    Case(
        "open passes",
        "gcode",
        "trace",
        _LINES,
        _job(_SPINNING, operation={"kind": "trace", "depth": 1.0, "passes": 2}),
        spindle="S",
    ),
    Case(
        "network",
        "vplus",
        "trace",
        _NETWORK,
        _job(_PROCESS, operation={"kind": "trace"}, cell=_CELL),
        signal="signal 33",
    ),
    Case(
        "pecks",
        "gcode",
        "drill",
        _HOLES,
        _job(
            _DRILLING,
            operation={"kind": "drill", "depth": 4.0, "passes": 3},
            tool={"kind": "drill", "diameter": 3.0},
        ),
        spindle="S",
    ),
    Case(
        "holes",
        "pacscript",
        "drill",
        _HOLES,
        _job(
            {**_PECKING, "switch": "air"},
            operation={"kind": "drill", "depth": 2.0},
            tool={"kind": "drill", "diameter": 3.0},
            cell=_CELL,
        ),
        signal="io 24",
    ),
    Case(
        "pocket",
        "gcode",
        "pocket",
        _TRAY,
        _job(
            _SPINNING,
            operation={
                "kind": "pocket",
                "depth": 2.0,
                "passes": 2,
                "stepover": 0.5,
                "engagement": 1.0,
            },
        ),
        spindle="S",
    ),
    Case(
        "pressing",
        "rapid",
        "follow",
        _PLATE,
        _job(
            {**_PROCESS, "force": 5.0, "retract": 4.0, "switch": "contact"},
            operation={"kind": "follow", "lead_in": 1.5},
            tool={"diameter": 6.0, "orient": "follow"},
            post={"force_load": "lTool"},
            cell=_CELL,
        ),
        signal="doprocess",
    ),
    Case(
        "stay down",
        "rapid",
        "follow",
        _PAIR,
        _job(
            {**_PROCESS, "stay_down": True},
            operation={"kind": "follow"},
            tour={"method": "nearest"},
            cell=_CELL,
        ),
        signal="doprocess",
    ),
    Case(
        "two tools",
        "gcode",
        "operations",
        _PLATE,
        {
            "process": _SPINNING,
            "tolerance": dict(_TOLERANCE),
            "tools": [
                {"name": "fine", "number": 1, "diameter": 4.0, "speed": 9000.0},
                {"name": "coarse", "number": 2, "diameter": 6.0, "speed": 7000.0},
            ],
            "operations": [
                {"kind": "follow", "tool": "fine", "nesting": "inner", "depth": 2.0},
                {"kind": "follow", "tool": "coarse", "nesting": "outer", "depth": 3.0},
            ],
        },
        spindle="S",
    ),
)
BY_NAME = {case.name: case for case in CASES}


def write_drawing(case: Case, folder: Path) -> Path:
    """Writes the drawing of a case into a folder."""
    entities = []
    for shape in case.shapes:
        if shape.is_hole:
            left, right = shape.vertices[0][0], shape.vertices[1][0]
            centre = ((left + right) / 2.0, shape.vertices[0][1])
            entities.append(make_dxf.circle(centre, (right - left) / 2.0))
        else:
            entities.append(make_dxf.polyline(list(shape.vertices), closed=shape.is_closed))
    path = folder / f"{case.name.replace(' ', '-')}.dxf"
    path.write_bytes(make_dxf.ascii_dxf(make_dxf.drawing(entities, make_dxf.MM)))
    return path
