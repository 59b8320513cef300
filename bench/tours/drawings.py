"""Travel of real drawings with the pen up, and a million segments.

    python -m bench.tours.drawings FOLDER ...
    python -m bench.tours.drawings million [CHAINS, 100000]

Every DXF of the folders is traced: as drawn, with the default search, and with a second of the
search and networks merged. vpype (VPYPE, or from the path) sorts the same
contours, as lines within 0.01 mm. There is no home, so that all count the same links.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bench.support.runner import Table, find_files, machine
from bench.support.timing import measure_process, peak_mb, timed

if TYPE_CHECKING:
    from camgen.model.part import Contour, Note
    from camgen.model.path import ToolPath
    from camgen.read.pieces import DrawnPieces

#: Chains of the large drawing, and segments of each; as many segments as chains are drawn twice.
CHAINS, LINKS = 100_000, 9


def million(chains: int) -> None:
    """Loose segments in no order, some drawn twice, joined to chains and ordered."""
    from camgen.model.job import Job, OperationTable, TourTable  # noqa: PLC0415
    from camgen.model.part import Part  # noqa: PLC0415
    from camgen.order.arrange import order_paths  # noqa: PLC0415
    from camgen.plan.trace import trace, with_few_lifts  # noqa: PLC0415
    from camgen.read.join import make_contours  # noqa: PLC0415

    print(machine())
    soup = loose(np.random.default_rng(1), chains)
    job = Job(operation=OperationTable(kind="trace"))

    def plan(contours: tuple[Contour, ...]) -> tuple[tuple[ToolPath, ...], tuple[Note, ...]]:
        part, merged = with_few_lifts(Part("", "", "mm", contours, notes), job)
        return trace(part, job), merged

    (joined, notes), joining = timed(lambda: make_contours(soup, job.input.join))
    (paths, merged), planning = timed(lambda: plan(joined))
    tour, ordering = timed(lambda: order_paths(paths, TourTable("best"), None, True))
    seconds = joining, planning, ordering, joining + planning + ordering
    remarks = "; ".join(note.what for note in (*notes, *merged))
    table = Table(
        "segments {:,} | chains {:,} | joined, s {:.1f} | planned, s {:.1f} | ordered, s {:.1f} "
        "| in all, s {:.1f} | peak MB {:.0f} | travel, m {:.1f} | order | notes"
    )
    size = len(soup), len(joined)
    table.add(*size, *seconds, peak_mb(), tour.travel / 1000, tour.method, remarks)


def loose(rng: np.random.Generator, chains: int) -> DrawnPieces:
    """Segments of random walks over a square, mixed, each drawn either way."""
    from camgen.read.pieces import DrawnPieces  # noqa: PLC0415

    begin = rng.uniform(0, 10 * chains**0.5, (chains, 1, 2))
    walk = np.cumsum(
        np.concatenate([begin, rng.uniform(-2, 2, (chains, LINKS, 2))], axis=1), axis=1
    )
    ends = np.stack([walk[:, :-1], walk[:, 1:]], axis=2).reshape(-1, 2, 2)
    ends = np.concatenate([ends, ends[rng.choice(len(ends), chains, replace=False)]])
    ends = rng.permutation(ends)
    turned = rng.random(len(ends)) < 0.5
    ends[turned] = ends[turned][:, ::-1]
    none = np.zeros(len(ends), dtype=np.intp)
    first = np.arange(0, 2 * len(ends) + 1, 2)
    bulges = np.zeros(2 * len(ends))
    places, flags = ends.reshape(-1, 2), none.astype(bool)
    return DrawnPieces(places, bulges, first, flags, none, none, none, ("0",), ("LINE",), ("",))


def measure(file: Path, tool: str | None) -> list[object] | None:
    """The cells of a drawing; None for one with fewer than five contours or nothing to trace."""
    from bench.tours.scenes import write_svg  # noqa: PLC0415
    from bench.tours.search import measure_svg  # noqa: PLC0415
    from camgen.model.errors import CamgenError  # noqa: PLC0415
    from camgen.model.job import Job, OperationTable, TourTable  # noqa: PLC0415
    from camgen.order.arrange import measure_travel, order_paths  # noqa: PLC0415
    from camgen.plan.trace import trace, with_few_lifts  # noqa: PLC0415
    from camgen.read import read  # noqa: PLC0415

    job = Job(operation=OperationTable(kind="trace", inside_first=False))
    try:
        part = read(file, job)
    except CamgenError:
        return None
    if len(part.contours) < 5:
        return None
    paths, merged = trace(part, job), trace(with_few_lifts(part, job)[0], job)
    best = TourTable("best")
    longer = TourTable("best", seconds=1.0)
    travel = [measure_travel(paths, None), order_paths(paths, best, None, False).travel]
    travel.append(order_paths(merged, longer, None, False).travel)
    if tool:
        with tempfile.TemporaryDirectory() as folder:
            scene, result = Path(folder) / "scene.svg", Path(folder) / "result.svg"
            write_svg(paths, scene)
            for options in ([], ["--two-opt"]):
                sort = [tool, "read", "--no-crop", str(scene), "linesort", *options]
                measure_process([*sort, "write", str(result)])
                # vpype writes px of 1/96 inch as it read them.
                travel.append(measure_svg(result))
    return [file.name, len(paths), *travel, order_paths(merged, best, None, False).bound]


def main(folders: list[str]) -> None:
    tool = os.environ.get("VPYPE") or shutil.which("vpype")
    print(machine(), "" if tool else "; vpype is not installed: its columns are left out")
    peers = "| vpype {:.0f} | --two-opt {:.0f} " if tool else ""
    table = Table(
        "drawing | paths | as drawn {:.0f} | default {:.0f} | seconds = 1 {:.0f} "
        f"{peers}| bound {{:.0f}}"
    )
    for folder in sorted(folders):
        for file in find_files(Path(folder), (".dxf",)):
            cells = measure(file, tool)
            if cells:
                table.add(*cells)


if __name__ == "__main__":
    if sys.argv[1:2] == ["million"]:
        million(int(sys.argv[2]) if len(sys.argv) > 2 else CHAINS)
    else:
        main(sys.argv[1:])
