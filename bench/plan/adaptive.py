"""Pockets beside FreeCAD's adaptive clearing: python -m bench.plan.adaptive [FOLDER] [AREA]

With an area camgen runs alone.

The rule. Five areas, see `areas`: all closed contours of a drawing, or of a layer of it, by the
even-odd rule. A mill of 6 mm clears 4 mm in two passes, 20 mm/s, 5 mm/s down, on a helix of 5 deg,
travel at 100 mm/s, clearance 5 mm and approach 1 mm. The stepover of both is 0.45 of the diameter:
`operation.stepover` of camgen, with its default bound of engagement, and `StepOver` of FreeCAD.
FreeCAD's other settings are its defaults, with a finishing profile.

The judge reads both texts (`bench.support.swept_text`). Its columns: seconds without acceleration
and with it (500 mm/s2, by the model of camgen), the bare area within reach of the tool without its
outer 0.005 mm, the area beyond the walls by more than 0.005 mm, rapid motions in material, and the
share of the feed in air. Goals: 1.05 of FreeCAD's seconds, nothing beyond the walls, no rapid
motion in material. Exits with 1 if one is missed.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import camgen
from bench.check.peer import FREECAD_PYTHON, LACKING, measure_minutes
from bench.support.runner import PARTS, SHARED, Cells, Scenario, run, verdict
from bench.support.swept_text import cleared, count_struck, feed_in_air, read_cut, seconds
from camgen.geometry.nesting import find_nesting
from camgen.geometry.segments import make_contour_segments
from camgen.lang.gcode import interpret
from camgen.model.pose import frozen
from camgen.model.program import Instruction, MoveL
from tests.support.swept import enclosed, reachable

_SCRIPT = Path(__file__).with_name("peer_adaptive.py")
_LONGEST = 240.0
COLUMNS = (
    "area | by | s {:.1f} | of FreeCAD's {:.2f} | s, accelerated {:.1f} | bare mm2 {:.3f} "
    "| gouged mm2 {:.4f} | rapids in material | feed in air {:.0f} % | "
)
DIAMETER, DEPTH, PASSES = 6.0, 4.0, 2
FEED, PLUNGE, TRAVEL = 20.0, 5.0, 100.0
CLEARANCE, APPROACH, ANGLE = 5.0, 1.0, 5.0
STEPOVER = 0.45
#: Seconds of camgen per second of FreeCAD, at most.
GOAL = 1.05
#: Side of the cells in which removal is counted, mm.
_CELL = 0.1
_JOB: dict[str, Any] = {
    "tool": {"diameter": DIAMETER},
    "operation": {
        "kind": "pocket",
        "depth": DEPTH,
        "passes": PASSES,
        "entry": "helix",
        "entry_angle": ANGLE,
        "stepover": STEPOVER,
    },
    "process": {
        "feed": FEED,
        "plunge": PLUNGE,
        "travel": TRAVEL,
        "clearance": CLEARANCE,
        "approach": APPROACH,
        "spindle": 12000.0,
    },
}


class Judged(NamedTuple):
    """The figures of one text.

    seconds: time without acceleration.
    accelerated: time with acceleration, s.
    bare: area within reach that is not cut, mm2.
    gouged: area beyond the walls, mm2.
    struck: number of rapid motions in material.
    air: share of the feed in air.
    """

    seconds: float
    accelerated: float
    bare: float
    gouged: float
    struck: int
    air: float


def islands() -> camgen.Part:
    """A pocket of 90 x 60 mm with an island of 8 mm radius and a square one of 14 mm."""
    outline = [(0, 0), (90, 0), (90, 60), (0, 60)]
    square = [(55, 25), (69, 25), (69, 39), (55, 39)]
    disc = ([(36, 30), (20, 30)], [1.0, 1.0])
    loops = [(outline, [0.0] * 4), disc, (square, [0.0] * 4)]
    contours = [
        camgen.Contour(frozen(points), frozen(bulges), True, "0", f"c{k}")
        for k, (points, bulges) in enumerate(loops, 1)
    ]
    return camgen.Part("islands", "islands", "mm", tuple(contours), ())


def drawn(file: Path, layer: str = "") -> camgen.Part:
    """The closed contours of a drawing, or of one of its layers."""
    part = camgen.read(file)
    chosen = [c for c in part.contours if c.closed and layer in ("", c.layer)]
    return camgen.Part(part.name, part.source, part.units, tuple(chosen), ())


def areas(words: list[str]) -> Iterator[tuple[str, Callable[[], camgen.Part]]]:
    """Names and readers of the areas. words: the folder of the two drawings of others."""
    folder = Path(words[0]) if words else SHARED / "cases"
    yield "bracket", lambda: drawn(PARTS / "bracket.dxf")
    yield "motor plate", lambda: drawn(PARTS / "motor.dxf", "POCKET")
    for name in ("c-shape", "waves"):
        if (folder / f"{name}.dxf").exists():
            yield name, lambda name=name: drawn(folder / f"{name}.dxf")
    yield "islands", islands


def chosen(words: list[str]) -> Iterator[tuple[str, Callable[[], camgen.Part], bool]]:
    """The areas, or the one that is named, with whether FreeCAD clears them too."""
    for name, reader in areas(words):
        if name in (words[1:] or [name]):
            yield name, reader, len(words) < 2 and not LACKING


def measure_text(text: str, region: Any, result: camgen.Result) -> Judged:
    """Judges one text.

    result: a build of camgen, whose model of the machine is used.
    """
    motions = read_cut(text)
    slow = 60 * measure_minutes(without_ends(interpret(text.splitlines()).body), result)
    radius = DIAMETER / 2
    bare = gouged = 0.0
    for number in range(PASSES):
        swept = cleared(motions, radius, -DEPTH * (number + 1) / PASSES)
        bare += reachable(region, radius).difference(swept).buffer(-0.005).area
        gouged += swept.difference(region.buffer(0.005)).area
    struck = count_struck(motions, radius)
    air = feed_in_air(motions, radius, _CELL)
    return Judged(seconds(motions, TRAVEL), slow, bare, gouged, struck, air)


def without_ends(body: Sequence[Instruction]) -> list[list[Instruction]]:
    """The motions from the first feed to the last, as one run, without those from and to home."""
    feeds = [k for k, item in enumerate(body) if isinstance(item, MoveL)]
    return [list(body[feeds[0] - 1 : feeds[-1] + 1])]


def by_freecad(part: camgen.Part, folder: Path) -> str:
    """The text of FreeCAD's adaptive clearing of the area, "" if it makes none."""
    depth = find_nesting(make_contour_segments(part.contours), len(part.contours)).depth
    loops = [
        {"points": c.points.tolist(), "bulges": c.bulges.tolist(), "depth": int(level)}
        for c, level in zip(part.contours, depth.tolist(), strict=True)
    ]
    work = {
        "loops": loops,
        "diameter": DIAMETER,
        "depth": DEPTH,
        "passes": PASSES,
        "feed": FEED,
        "plunge": PLUNGE,
        "clearance": CLEARANCE,
        "approach": APPROACH,
        "angle": ANGLE,
        "stepover": round(100 * STEPOVER),
    }
    source, target = folder / "work.json", folder / "adaptive.ngc"
    source.write_text(json.dumps(work), encoding="utf-8")
    command = [str(FREECAD_PYTHON), str(_SCRIPT), str(source), str(target)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=_LONGEST, check=False)
    if done.returncode or not target.exists():
        print((done.stderr or done.stdout).strip()[-400:], file=sys.stderr)
        return ""
    return target.read_text(encoding="utf-8")


def measure(name: str, read_part: Callable[[], camgen.Part], with_peer: bool) -> Iterator[Cells]:
    """The row of camgen for an area, and a row of FreeCAD if it is asked for."""
    part = read_part()
    region = enclosed(part.contours)
    result = camgen.build(part, post="gcode", job=_JOB)
    ours = measure_text(result.text, region, result)
    peer = None
    if with_peer:
        with tempfile.TemporaryDirectory() as folder:
            other = by_freecad(part, Path(folder))
        peer = measure_text(other, region, result) if other else None
    ratio = ours.seconds / peer.seconds if peer else None
    is_met = ours.gouged <= 1e-3 and not ours.struck and (ratio is None or ratio <= GOAL)
    yield _list_cells(name, "camgen", ours, ratio, verdict(is_met))
    if peer:
        yield _list_cells(name, "FreeCAD", peer, None, "")


def _list_cells(
    name: str, maker: str, judged: Judged, ratio: float | None, goal: str
) -> Sequence[object]:
    figures = judged.bare, judged.gouged, judged.struck, 100 * judged.air, goal
    return name, maker, judged.seconds, ratio, judged.accelerated, *figures


if __name__ == "__main__":
    np.seterr(invalid="ignore")
    sys.exit(run(Scenario(COLUMNS, chosen(sys.argv[1:]), measure)))
