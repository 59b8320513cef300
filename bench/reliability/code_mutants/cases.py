"""The jobs that each mutant builds: small drawings, and the jobs of `cases.toml`."""

from __future__ import annotations

import math
import tomllib
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
    Shape("hook", ((0.0, 20.0, 0.0), (30.0, 20.0, _QUARTER), (40.0, 30.0, 0.0)), is_closed=False),
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


_DRAWINGS = {
    "plate": _PLATE,
    "lines": _LINES,
    "network": _NETWORK,
    "holes": _HOLES,
    "tray": _TRAY,
    "pair": _PAIR,
}


def _read_cases() -> tuple[Case, ...]:
    """The cases of `cases.toml`, which says how their tables are put together."""
    tables = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
    cases = []
    for row in tables["cases"]:
        job = {"tolerance": tables["tolerance"], **row["job"]}
        job["process"] = tables["process"][row["process"]] | row["job"].get("process", {})
        if "tools" not in job:
            job.setdefault("tool", {"diameter": 6.0})
        if row.get("arm"):
            job["cell"] = tables["cell"]
        kind = job["operation"]["kind"] if "operation" in job else "operations"
        outputs = row.get("signal", ""), row.get("spindle", "")
        drawing = _DRAWINGS[row["drawing"]]
        cases.append(Case(row["name"], row["post"], kind, drawing, job, *outputs))
    return tuple(cases)


CASES = _read_cases()
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
