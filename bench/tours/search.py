"""Travel, seconds and memory of the search for a tour, beside vpype and LKH.

    python -m bench.tours.search [PATHS ...]

The scenes are those of ``bench.tours.scenes``, without a home, so that all programs count the same
links. Every run is a process of its own. vpype is taken from the environment variable VPYPE or from
the path, LKH from the package elkai (`lkh`); without them their rows are left out.
"best known" is the shortest of all rows, one of which is a long search.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
import tempfile
import time
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from bench.support.runner import Table, machine
from bench.support.timing import measure_process, python

#: For each number of paths tour.seconds of the long search, compiled; 0 for none. 20 paths are a
#: size for a try.
BUDGETS = {20: 0.0, 100: 5.0, 1_000: 5.0, 10_000: 60.0, 100_000: 60.0}
#: Most paths for which vpype improves its order.
TWO_OPT = 1_000
#: For a number of paths, starts of a closed one that LKH is given, and its runs.
LKH = {100: (8, 10)}


class Row(NamedTuple):
    """The result of a program.

    program: its name.
    travel: mm.
    seconds: time by the clock, s.
    processor: time of the processor, s, None if it is unknown.
    peak: largest resident memory, MB.
    bound: lower bound of the travel, mm, None without one.
    """

    program: str
    travel: float
    seconds: float
    processor: float | None
    peak: float
    bound: float | None = None


def order_scene(count: int, method: str, seconds: float, is_plain: bool) -> None:
    """Prints travel, seconds and processor seconds of an order, and its bound."""
    from bench.tours.scenes import draw_paths  # noqa: PLC0415 (the parent does not hold numpy)
    from camgen.model.job import TourTable  # noqa: PLC0415
    from camgen.order import search  # noqa: PLC0415
    from camgen.order.arrange import order_paths  # noqa: PLC0415
    from camgen.order.solver import speed  # noqa: PLC0415

    settings = TourTable("best", seconds=0.3)
    if is_plain:
        speed.available = search.available = lambda: False
    elif speed.available():
        order_paths(draw_paths(50), settings, None, inside_first=False)  # loads compiled code
    paths = draw_paths(count)
    settings = TourTable(method, seconds=seconds)
    start, worked = time.perf_counter(), time.process_time()
    tour = order_paths(paths, settings, None, inside_first=False)
    print(tour.travel, time.perf_counter() - start, time.process_time() - worked, tour.bound)


def run_camgen(name: str, count: int, method: str, seconds: float, is_plain: bool = False) -> Row:
    words = "order", count, method, seconds, int(is_plain)
    process = measure_process(python("bench.tours.search", *words))
    travel, clock, worked, bound = process.text.splitlines()[-1].split()
    floor = None if bound == "None" else float(bound)
    return Row(name, float(travel), float(clock), float(worked), process.peak, floor)


def measure_svg(file: Path) -> float:
    """The length of the links between the paths of an SVG, px."""
    total, position = 0.0, None
    for shape in ET.parse(file).getroot().iter():
        kind = shape.tag.rsplit("}")[-1]
        if kind == "line":
            numbers = [shape.get(key, "0") for key in ("x1", "y1", "x2", "y2")]
        elif kind in ("polyline", "polygon"):
            numbers = re.findall(r"[-+.\deE]+", shape.get("points", ""))
        else:
            continue
        values = list(map(float, numbers))
        start, end = complex(*values[:2]), complex(*values[-2:])
        if position is not None:
            total += abs(start - position)
        position = start if kind == "polygon" else end
    return total


def run_vpype(tool: str, folder: Path, options: list[str]) -> Row:
    """The linesort of vpype, without the time of reading and writing."""
    scene, result = folder / "scene.svg", folder / "result.svg"
    command = [tool, "read", "--no-crop", str(scene)]
    # Reading and writing alone, the second time: the first one loads modules.
    alone = [measure_process([*command, "write", str(result)]).seconds for _ in range(2)][1]
    process = measure_process([*command, "linesort", *options, "write", str(result)])
    seconds = max(process.seconds - alone, 0.0)
    name = " ".join(["vpype linesort", *options])
    return Row(name, measure_svg(result), seconds, None, process.peak)


def run_lkh(count: int) -> Row:
    points, runs = LKH[count]
    process = measure_process(python("bench.tours.search", "lkh", count, points, runs))
    travel, seconds = map(float, process.text.split()[-2:])
    return Row(f"LKH, {points} starts of a closed path", travel, seconds, None, process.peak)


def list_rows(count: int, tool: str | None) -> Iterator[Row]:
    """The rows of a scene."""
    yield run_camgen("camgen, nearest", count, "nearest", 0.0)
    yield run_camgen("camgen, default, without fast", count, "best", 0.0, is_plain=True)
    if find_spec("numba"):
        yield run_camgen("camgen, default, fast", count, "best", 0.0)
        if BUDGETS[count]:
            name = f"camgen, seconds = {BUDGETS[count]:g}, fast"
            yield run_camgen(name, count, "best", BUDGETS[count])
    if tool:
        with tempfile.TemporaryDirectory() as name:
            scene = Path(name) / "scene.svg"
            measure_process(python("bench.tours.search", "draw", scene, count))
            yield run_vpype(tool, Path(name), [])
            if count <= TWO_OPT:
                yield run_vpype(tool, Path(name), ["--two-opt"])
    if count in LKH and find_spec("elkai"):
        yield run_lkh(count)


def main(sizes: list[int]) -> None:
    """Prints the table."""
    tool = os.environ.get("VPYPE") or shutil.which("vpype")
    print(machine(), "" if tool else "; vpype is not installed: its rows are left out")
    table = Table(
        "paths {:,} | program | travel, m {:.3f} | above best known {:.1f} % | seconds {:.2f} "
        "| of a processor {:.2f} | peak MB {:.0f} | bound, m {:.3f}"
    )
    for count in sizes:
        rows = list(list_rows(count, tool))
        best = min(row.travel for row in rows)
        for row in rows:
            bound = None if row.bound is None else row.bound / 1000
            above = 100 * (row.travel / best - 1)
            spent = row.seconds, row.processor, row.peak
            table.add(count, row.program, row.travel / 1000, above, *spent, bound)


if __name__ == "__main__":
    if sys.argv[1:2] == ["order"]:
        order_scene(int(sys.argv[2]), sys.argv[3], float(sys.argv[4]), sys.argv[5] == "1")
    elif sys.argv[1:2] == ["draw"]:
        from bench.tours.scenes import draw_paths, write_svg

        write_svg(draw_paths(int(sys.argv[3])), Path(sys.argv[2]))
    elif sys.argv[1:2] == ["lkh"]:
        from bench.tours import lkh

        lkh.order_scene(*map(int, sys.argv[2:]))
    else:
        main([int(word) for word in sys.argv[1:]] or [size for size in BUDGETS if size > 20])
