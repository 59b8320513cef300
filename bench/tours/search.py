"""Travel, seconds and memory of the search for a tour beside vpype's: `python -m bench.tours.search [paths ...]`.

Scenes: evenly scattered, half open, half closed, without a home, so that both programs count the same ways. Every run
is a process of its own. vpype is taken from the environment variable VPYPE or from the path, LKH from the package elkai
(``bench.tours.lkh``); without them their rows are left out. "best known" is the shortest of all rows, one of which is a
long search.
"""

from __future__ import annotations

import os
import random
import re
import shutil
import sys
import tempfile
import time
import xml.etree.ElementTree as ET
from importlib.util import find_spec
from pathlib import Path

from bench.support.runner import Table, machine
from bench.support.timing import measure_process, python

#: Paths; 20 is a size for a try, and only taken when asked for.
SIZES = (100, 1_000, 10_000, 100_000)
#: tour.seconds of both searches, and of the long one, compiled, by size; 0: none.
BUDGETS = {
    20: (0.5, 0.0),
    100: (0.5, 5.0),
    1_000: (0.5, 5.0),
    10_000: (2.0, 60.0),
    100_000: (15.0, 60.0),
}
#: Above this many paths vpype is not asked to improve its order.
TWO_OPT = 1_000
#: By number of paths, how many starts of a closed one LKH is given and how often it begins anew.
LKH = {100: (8, 10)}
#: Name, travel (mm), seconds, seconds of the processor, memory (MB), bound (mm).
Row = tuple[str, float, float, float | None, float, float | None]


def child(count: int, method: str, seconds: float, plain: bool) -> None:
    """One order of one scene; prints travel, seconds and processor seconds of the call, bound."""
    from bench.tours.order import scattered  # noqa: PLC0415 (numpy is not to be held by the parent)
    from camgen.order import search  # noqa: PLC0415
    from camgen.order.arrange import TourSettings, order_paths  # noqa: PLC0415
    from camgen.order.solver import speed  # noqa: PLC0415

    if plain:
        speed.available = search.available = lambda: False
    elif speed.available():
        order_paths(
            scattered(50, random.Random(1)),
            TourSettings("best", None, inside_first=False, seconds=0.3),
        )  # loads what is compiled
    paths = scattered(count, random.Random(count))
    begun, worked = time.perf_counter(), time.process_time()
    tour = order_paths(paths, TourSettings(method, None, inside_first=False, seconds=seconds))
    print(tour.travel, time.perf_counter() - begun, time.process_time() - worked, tour.bound)


def camgen(name: str, count: int, method: str, seconds: float, plain: bool = False) -> Row:
    words = "child", count, method, seconds, int(plain)
    process = measure_process(python("bench.tours.search", *words))
    travel, taken, worked, bound = process.text.splitlines()[-1].split()
    floor = None if bound == "None" else float(bound)
    return name, float(travel), float(taken), float(worked), process.peak, floor


def draw(file: str, count: int) -> None:
    """The scene as SVG, px; circles as 64 lines, which leaves 0.006 mm."""
    import numpy as np  # noqa: PLC0415

    from bench.tours.order import scattered  # noqa: PLC0415

    with open(file, "w") as out:
        out.write('<svg xmlns="http://www.w3.org/2000/svg" width="9000" height="9000">')
        for path in scattered(count, random.Random(count)):
            xy = path.position[:, :2]
            if not np.isnan(path.via[1:, 0]).all():
                middle, turn = (xy[0] + xy[1]) / 2, np.linspace(0, 2 * np.pi, 65)
                ring = np.linalg.norm(xy[0] - middle) * np.stack(
                    [np.cos(turn), np.sin(turn)], axis=1
                )
                xy = np.concatenate([middle + ring[:-1], middle + ring[:1]])
            points = " ".join(f"{x:.4f},{y:.4f}" for x, y in xy.tolist())
            out.write(f'<polyline fill="none" stroke="black" points="{points}"/>')
        out.write("</svg>")


def between(file: Path) -> float:
    """The ways between the paths of an SVG, px."""
    total, here = 0.0, None
    for shape in ET.parse(file).getroot().iter():
        kind = shape.tag.rsplit("}")[-1]
        if kind == "line":
            ends = [
                complex(float(shape.get(f"x{k}", 0)), float(shape.get(f"y{k}", 0))) for k in (1, 2)
            ]
        elif kind in ("polyline", "polygon"):
            numbers = [float(word) for word in re.findall(r"[-+.\deE]+", shape.get("points", ""))]
            points = [complex(x, y) for x, y in zip(numbers[::2], numbers[1::2], strict=True)]
            ends = [points[0], points[0] if kind == "polygon" else points[-1]]
        else:
            continue
        total += abs(ends[0] - here) if here is not None else 0.0
        here = ends[1]
    return total


def vpype(tool: str, folder: Path, options: list[str]) -> Row:
    scene, result = folder / "scene.svg", folder / "result.svg"
    common = [tool, "read", "--no-crop", str(scene)]
    # Reading and writing alone, the second time: what the first one loads is not part of it.
    alone = [measure_process([*common, "write", str(result)]).seconds for _ in range(2)][1]
    drawn = between(result)
    process = measure_process([*common, "linesort", *options, "write", str(result)])
    assert between(result) < drawn
    name = " ".join(["vpype linesort", *options])
    return name, between(result), max(process.seconds - alone, 0.0), None, process.peak, None


def lkh(count: int) -> Row:
    points, runs = LKH[count]
    process = measure_process(python("bench.tours.lkh", count, points, runs))
    travel, taken = process.text.split()[-2:]
    name = f"LKH, {points} starts of a closed path"
    return name, float(travel), float(taken), None, process.peak, None


def rows(count: int, tool: str | None) -> list[Row]:
    budget, long = BUDGETS[count]
    found = [
        camgen("camgen, nearest", count, "nearest", 0.0),
        camgen("camgen, default, without fast", count, "best", 0.0, plain=True),
        camgen(f"camgen, seconds = {budget:g}, without fast", count, "best", budget, plain=True),
    ]
    if find_spec("numba"):
        found.append(camgen("camgen, default, fast", count, "best", 0.0))
        found += [
            camgen(f"camgen, seconds = {one:g}, fast", count, "best", one)
            for one in (budget, long)
            if one
        ]
    if tool:
        with tempfile.TemporaryDirectory() as name:
            scene = Path(name) / "scene.svg"
            measure_process(python("bench.tours.search", "draw", scene, count))
            found.append(vpype(tool, Path(name), []))
            if count <= TWO_OPT:
                found.append(vpype(tool, Path(name), ["--two-opt"]))
    if count in LKH and find_spec("elkai"):
        found.append(lkh(count))
    return found


def main(sizes: list[int]) -> None:
    tool = os.environ.get("VPYPE") or shutil.which("vpype")
    print(machine(), "" if tool else "; vpype is not installed: its rows are left out")
    if not find_spec("elkai"):
        print("elkai is not installed: the rows of LKH are left out")
    table = Table(
        "paths {:,} | program | travel, m {:.3f} | above best known {:.1f} % | seconds {:.2f} "
        "| of a processor {:.2f} | peak MB {:.0f} | bound, m {:.3f}"
    )
    for count in sizes:
        found = rows(count, tool)
        best = min(row[1] for row in found)
        for name, travel, seconds, worked, memory, bound in found:
            floor = None if bound is None else bound / 1000
            above = 100 * (travel / best - 1)
            table.add(count, name, travel / 1000, above, seconds, worked, memory, floor)


if __name__ == "__main__":
    if sys.argv[1:2] == ["child"]:
        child(int(sys.argv[2]), sys.argv[3], float(sys.argv[4]), sys.argv[5] == "1")
    elif sys.argv[1:2] == ["draw"]:
        draw(sys.argv[2], int(sys.argv[3]))
    else:
        main([int(word) for word in sys.argv[1:]] or list(SIZES))
