"""The checks of the set-up on real drawings: python -m bench.check.set_up [FOLDER]

The drawings and the jobs are chosen by a rule that was written down before the checks:

- `DRAWINGS` are all drawings of the shared data for which `camgen init --operations` proposes a
  job.
- The job of a drawing is that proposal, once as it is, and once for each of aluminium and plywood.
- A line of the checks is false if a reader of the G-code that shares no code with camgen finds
  that the program keeps the limit which the line states.

At most one false line is allowed for ten drawings.
"""

from __future__ import annotations

import math
import re
import sys
import tomllib
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import camgen
from bench.check.cells import carve
from bench.support.gcode_text import Move, read_moves
from bench.support.runner import SHARED, Cells, Missed, Scenario, run
from camgen.cli.init import Chosen, write_template
from camgen.plan.propose import propose
from camgen.read import read
from camgen.read.files import Files

#: Drawings below the folder `dxf` of the shared data.
DRAWINGS = (
    "SofleKeyboard/OLED_Cover.dxf",
    "SofleKeyboard/SofleKeyboardTopPlate_ShapeOnly.dxf",
    "SofleKeyboard/sofle_pico_key_plate_v3.5.5.dxf",
    "cad-viewer/block-color.dxf",
    "cadquery/1001.dxf",
    "cadquery/MC 12x31.dxf",
    "cadquery/gear.dxf",
    "cadquery/genshi.dxf",
    "cadquery/three_layers.dxf",
    "dxf/arrayed-holes.dxf",
    "dxf/issue27c.dxf",
    "dxf/issue39.dxf",
    "dxf/issue42.dxf",
    "dxf/squircle2.dxf",
    "dxf/testModelPaperSpace.dxf",
    "dxf-parser/polylines.dxf",
    "ezdxf/1_polylines.dxf",
    "ezdxf/2_polylines.dxf",
    "ezdxf/5_us_states.dxf",
    "ezdxf/AC1003_LINE_Example.dxf",
    "ezdxf/R12_with_trash_beyond_EOF.dxf",
    "ezdxf/dimension_in_nested_blocks.dxf",
    "ezdxf/duplicate_handles.dxf",
    "ezdxf/empty_handles.dxf",
    "ezdxf/forms.dxf",
    "ezdxf/hatches_2.dxf",
    "ezdxf/issue_1359_1.dxf",
    "ezdxf/recover02.dxf",
    "ezdxf/uncommon.dxf",
    "ezdxf/wipeout_door.dxf",
    "redox-keyboard/redox_rev1-brd.dxf",
    "trimesh/1002_tray_bottom.DXF",
    "trimesh/125_cycloidal.DXF",
    "trimesh/ChuteHolderPrint.DXF",
    "trimesh/LM2.dxf",
    "trimesh/apu-mount.DXF",
    "trimesh/insert.dxf",
    "trimesh/sliding-base.dxf",
    "trimesh/spline.DXF",
    "trimesh/uc.r12a.dxf",
    "trimesh/uc.r12b.dxf",
    "trimesh/uc.r14a.dxf",
    "trimesh/uc.r14b.dxf",
    "trimesh/uc.r2000b.dxf",
    "trimesh/uc.r2013a.dxf",
    "trimesh/uc.r2013b.dxf",
)

COLUMNS = "drawing | lines | not judged | false | kinds | which are false"
MATERIALS = (None, "aluminium", "plywood")
_EIGHTHS = (1 / 8, 1 / 4, 3 / 8, 1 / 2)
_SIXTEENTHS = (1 / 8, 3 / 16, 1 / 4, 3 / 8, 1 / 2)
#: Largest feeds of a tooth by the diameter, both inch, as printed in the charts; of all for None.
TOOTH: dict[str | None, tuple[tuple[float, ...], tuple[float, ...]]] = {
    "aluminium": (_SIXTEENTHS, (0.0012, 0.0018, 0.0022, 0.0035, 0.0045)),
    "plywood": (_EIGHTHS, (0.005, 0.009, 0.018, 0.021)),
    None: (_EIGHTHS, (0.007, 0.015, 0.019, 0.025)),
}
#: Feeds of a turn of drills in aluminium, inch.
DRILL = (_SIXTEENTHS, (0.004, 0.005, 0.006, 0.0087, 0.0087))
#: Cutting speeds in aluminium, feet a minute.
MILL_SPEED, DRILL_SPEED = 2200.0, 300.0
#: Texts are printed in digits.
NEARLY = 1.005
#: Depth that a judge in cells does not see, mm.
_SLACK_MM = 0.02
_LIMIT = re.compile(r"(?:the stock is|edges are) ([0-9.]+) mm")
_KIND = re.compile("straight down|one pass|a tooth|a turn|turns at|below it|edges are")


class Judge:
    """The limits of a program by its text and the published charts.

    moves: motions of the text.
    tools: rows of the job's tools by their numbers.
    before: depth below the axis half-way along each motion, before it, mm; empty for a part that
        is too large for a grid.
    """

    def __init__(self, text: str, rows: list[dict[str, Any]]) -> None:
        self.moves = list(read_moves(text))
        self.tools = {row["number"]: row for row in rows}
        radii = {number: row["diameter"] / 2 for number, row in self.tools.items()}
        try:
            self.before = carve(self.moves, radii, min(radii.values()) / 4)[1]
        except ValueError:
            self.before = []

    def is_true(self, what: str, material: str | None) -> bool:
        """Whether a line of the checks holds."""
        row = next(row for row in self.tools.values() if what.startswith(f"{row['name']} "))
        pairs = [
            (move, move.deepest - bare)
            for move, bare in zip(self.moves, self.before, strict=True)
            if move.tool == row["number"] and not move.rapid and move.deepest > 0
        ]
        load = measure_load([move for move, _ in pairs], row)
        if "mm deep" in what:
            return load.depth > float(_LIMIT.findall(what)[0]) + 0.5 * ("thick" in what)
        if "goes straight down" in what:
            return any(move.is_straight_down and bite > _SLACK_MM for move, bite in pairs)
        if "one pass" in what:
            limit = (1.0 if material == "aluminium" else 3.0) * row["diameter"]
            return any(bite > limit for _, bite in pairs)
        if "a tooth" in what or "a turn" in what:
            return load.tooth > read_chart(row, material) * NEARLY
        if "turns at" in what:
            return load.speed > find_fastest(row) * NEARLY
        raise ValueError(what)


class Load(NamedTuple):
    """The load of a tool.

    depth: depth below the top face, mm, without the tip of a drill.
    tooth: feed of a tooth of a mill, or of a turn of a drill, mm.
    speed: cutting speed, feet a minute.
    """

    depth: float
    tooth: float
    speed: float


def measure_load(moves: Sequence[Move], tool: Mapping[str, Any]) -> Load:
    """The largest load of a tool in its motions in material."""
    is_drill, diameter = tool["kind"] == "drill", tool["diameter"]
    tip = diameter / 2 / math.tan(math.radians(59)) if is_drill else 0.0
    edges = 1 if is_drill else tool.get("flutes", 2)
    cutting = [move for move in moves if move.is_straight_down == is_drill and move.speed]
    tooth = max((move.feed / move.speed / edges for move in cutting), default=0.0)
    speed = max(move.speed for move in moves) * math.pi * diameter / 304.8
    return Load(max(move.deepest for move in moves) - tip, tooth, speed)


def find_fastest(tool: Mapping[str, Any]) -> float:
    """The largest cutting speed of a tool in aluminium, feet a minute."""
    return DRILL_SPEED if tool["kind"] == "drill" else MILL_SPEED


def read_chart(row: Mapping[str, Any], material: str | None) -> float:
    """The largest feed of a tooth or of a turn for a tool, mm."""
    sizes, feeds = DRILL if row["kind"] == "drill" else TOOTH[material]
    size = row["diameter"] / 25.4
    return 25.4 * float(np.interp(size, (0.0, *sizes), (0.0, *feeds)))


def measure(name: str, folder: Path) -> Iterator[Cells]:
    """The row of a drawing."""
    part = read(folder / name, camgen.Job(), Files())
    proposal = propose(part)
    tables = tomllib.loads(
        write_template(part.source, part.units, Chosen(proposal=proposal, active=True))
    )
    judged: Judge | None = None
    lines, wrong, unjudged = Counter[str](), [], 0
    for material in MATERIALS:
        job = {**tables, "stock": {**tables["stock"]}}
        if material:
            job["stock"]["material"] = material
        result = camgen.build(part, post="gcode", job=job)
        judged = judged or Judge(result.text, tables["tools"])
        assert result.proof is not None
        for breach in result.proof.set_up.breaches:
            lines[_KIND.findall(breach.what)[0]] += 1
            if not judged.before:
                unjudged += 1
            elif not judged.is_true(breach.what, material):
                wrong.append(f"{material}: {breach.what}")
    kinds = ", ".join(f"{count} {kind}" for kind, count in lines.items())
    false = Missed("; ".join(wrong)) if wrong else "-"
    yield name, lines.total(), unjudged, len(wrong), kinds, false


def inputs(words: list[str]) -> list[tuple[str, Path]]:
    """The drawings in a folder."""
    folder = Path(words[0]) if words else SHARED / "dxf"
    return [(name, folder) for name in words[1:] or DRAWINGS]


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    sys.exit(run(Scenario(COLUMNS, inputs(sys.argv[1:]), measure, may_refuse=True)))
