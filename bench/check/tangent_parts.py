"""Parts by chance with tangent joints and small radii, milled by an arm: are their corners cut off?

    python -m bench.check.tangent_parts [PARTS, 100] [FIRST, 0]

`bench.render.tangent_parts` draws the parts and says how each is milled. The judge reads the text
itself and walks the executed path with formulas of its own (`tests.support.rounded_paths`). It
measures the depth of the mill in the part there. Exits with 1 where the depth exceeds the tolerance
of corners by more than the digits of the text.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator

import numpy as np
import shapely

import camgen
from bench.render.tangent_parts import LANGUAGES, TangentPart, tangent_part
from bench.support.runner import Cells, Scenario, read_words, run, verdict
from camgen.model.pose import frozen
from tests.support.rounded_paths import list_corners, trace

#: mm: half of the last digit moves both ends of a motion, and the polygon leaves its arcs.
DIGITS = 0.001
#: mm that is milled off.
DEPTH = 2.0
COLUMNS = (
    "post | parts {:,} | left out {:,} | corners {:,} | stops avoided, % {:.1f} "
    "| rounded at most, mm {:.4f} | into the part, programmed, mm {:.4f} "
    "| into the part, executed, mm {:.4f} | beyond the tolerance {:,} | goal"
)


def mill(part: TangentPart) -> camgen.Result:
    """The program that mills a part."""
    contours = [
        camgen.Contour(frozen(rows[:, :2]), frozen(rows[:, 2]), True, "0") for rows in part.contours
    ]
    job = {
        "tool": {"kind": "end mill", "diameter": part.diameter},
        "operation": {"depth": DEPTH},
        "tolerance": {"corner": part.tolerance},
        "process": {"feed": part.feed, "max_feed_factor": 1.0},
    }
    return camgen.build(camgen.part(contours), post=part.language, job=job)


def measure(post: str, numbers: Iterable[int]) -> Iterator[Cells]:
    """The row of a post."""
    parts = left_out = passed = corners = beyond = 0
    rounded = programmed = executed = 0.0
    for number in numbers:
        part = tangent_part(number)
        if part.language != post:
            continue
        result = mill(part)
        text = "".join(file.text for file in result.files)
        parts += 1
        left_out += any(note.kind == "skipped" for note in result.notes)
        paths = trace(post, text)
        rounding = list_corners(post, text)
        passed += len(rounding)
        corners += paths.joints
        rounded = max([rounded, *(corner.mm for corner in rounding)])
        programmed = max(programmed, measure_depth(part, paths.programmed))
        depth = measure_depth(part, paths.executed)
        executed = max(executed, depth)
        beyond += depth > part.tolerance + DIGITS
    share = 100 * passed / max(corners, 1)
    depths = (rounded, programmed, executed, beyond, verdict(beyond == 0))
    yield (post, parts, left_out, corners, share, *depths)


def measure_depth(part: TangentPart, points: np.ndarray) -> float:
    """The largest depth, mm, of the mill in the part with its middle at points (N,); 0 if none."""
    shapely.prepare(part.material)
    places = shapely.points(points.real, points.imag)
    inside = shapely.contains(part.material, places)
    edges = shapely.boundary(part.material)
    shapely.prepare(edges)
    gap = shapely.distance(edges, places)
    return float((part.diameter / 2 - np.where(inside, -gap, gap)).max(initial=0.0))


def main(count: int, first: int) -> int:
    numbers = range(first, first + count)
    return run(Scenario(COLUMNS, [(post, numbers) for post in LANGUAGES], measure))


if __name__ == "__main__":
    sys.exit(main(*read_words(100, 0)[:2]))
