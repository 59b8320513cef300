"""Robot programs from controller to controller and back: python -m bench.read.translate [CASE...]

Every golden program of a robot is posted anew for every other robot, and that for its own again. The motion of the last
is compared with that of the first: the places of its tool both ways, and the seconds at its speeds. Controllers without
arcs, or with coarser digits, are in the tolerance. A case that another arm cannot reach is told with its reason. Then
the same by way of G-code, and of G-code by way of robots (``bench/read/mills.py``).
"""

from __future__ import annotations

import math
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import camgen
from bench.read import mills
from bench.read.goldens import (
    ARMS,
    CASES,
    CHORD,
    POSTS,
    along,
    apart,
    execute,
    frames_of,
    read_robot,
)  # fmt: skip
from bench.support.runner import Cells, Scenario, run
from camgen.model.pose import Pose, Vec3, fixed_xyz
from camgen.model.program import MoveC, MoveJ, MoveL, Output

COLUMNS = "case | from | by way of | mm apart {:.4f} | s apart {:.3f} | "
MILL_COLUMNS = (
    "case | from | by way of | mm apart {:.4f} | s apart {:.3f} | rapids, mm apart {:.4f} | "
)
#: mm: nearer ones are one.
_SAME = 1e-6
WITHIN = CHORD + 0.002


class Way(NamedTuple):
    """points: (N, 3) on the way at feed, base frame, mm. seconds: at its speeds. outputs: names and values, those that
    switch off before the first motion left out.
    """

    points: NDArray[np.float64]
    seconds: float
    outputs: list[tuple[str, float]]


def way_of(file: Path, language: str, frames: tuple[Pose, Pose]) -> Way:
    """What a program does between its motions of the joints, but for lines that begin at home. frames: where the text
    says none.
    """
    body, base = read_robot(file, language, frames)
    points: list[Vec3] = []
    outputs: list[tuple[str, float]] = []
    seconds, here = 0.0, None
    for item in body:
        if isinstance(item, Output):
            outputs.append((item.signal, item.value))
        if not isinstance(item, MoveJ | MoveL | MoveC):
            continue
        if here is not None and not isinstance(item, MoveJ):
            some, length = along(here, item)
            points += some
            seconds += length / item.speed
        here = item.target.origin if isinstance(item.target, Pose) else None
    moved = np.array(points or [(0.0, 0.0, 0.0)])
    # Where one motion ends another begins.
    moved = moved[np.append(True, np.abs(np.diff(moved, axis=0)).max(axis=1) > _SAME)]
    return Way(moved @ base.rotation.T + base.origin, seconds, outputs)


def post_again(
    file: Path, source: str, target: str, folder: Path, frames: tuple[Pose, Pose]
) -> Path:
    """The program ``file`` of the controller ``source`` for another one; CamgenError where that cannot be."""
    body = execute(file, source).body
    names = dict.fromkeys(item.signal for item in body if isinstance(item, Output))
    suffix, name = POSTS[target]
    signals = {one: _number(name.format(_digits(one))) for one in names}
    job: dict[str, object] = {
        "operation": {"taught_on": ARMS[source]},
        "tolerance": {"chord": CHORD},
    }
    job["cell"] = {"base_from_work": _values(frames[0]), "flange_from_tool": _values(frames[1])}
    job |= {"post": {"signals": signals}} if signals else {}
    result = camgen.build(file, post=target, job=job, name="part")
    made = folder / f"part{suffix}"
    made.write_text("".join(one.text for one in result.files), encoding="latin-1")
    return made


def _values(pose: Pose) -> list[float]:
    return [*pose.origin, *map(math.degrees, fixed_xyz(pose.rotation))]


def _digits(name: str) -> str:
    return "".join(c for c in name if c.isdigit()) or "33"


def _number(name: str) -> str | int:
    return int(name) if name.isdigit() else name


def pairs(case: Path) -> list[tuple[Path, str, str]]:
    """A golden program of a case, its controller, and another one."""
    files = {source: case / "expected" / f"part{suffix}" for source, (suffix, _) in POSTS.items()}
    there = {source: file for source, file in files.items() if file.exists()}
    return [(file, a, b) for a, file in there.items() for b in POSTS if a != b]


def there_and_back(file: Path, source: str, target: str) -> tuple[Way, Way]:
    """What a golden program does, and what it does after there and back. CamgenError where it cannot go there."""
    with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as two:
        frames = frames_of(file.parents[1], source)
        there = post_again(file, source, target, Path(one), frames)
        back = post_again(there, target, source, Path(two), frames)
        return way_of(file, source, frames), way_of(back, source, frames)


def judge(file: Path, source: str, target: str) -> Iterator[Cells]:
    """The row of a golden program and a controller by way of which it goes and comes back."""
    names = file.parents[1].name, source, target
    try:
        a, b = there_and_back(file, source, target)
    except camgen.CamgenError as error:
        yield *names, *"--", str(error)
        return
    same = [value for _, value in a.outputs] == [value for _, value in b.outputs]
    off, seconds = apart(a.points, b.points), abs(a.seconds - b.seconds)
    yield *names, off, seconds, "" if same else "outputs differ"


if __name__ == "__main__":
    cases = [CASES / name for name in sys.argv[1:]]
    cases = cases or sorted(path for path in CASES.iterdir() if path.is_dir())
    robots, others = [], []
    for case in cases:
        robots += pairs(case)
        others += [(case, *pair) for pair in mills.pairs(case)]
    title = "By way of G-code, and G-code by way of the others:"
    sys.exit(
        run(
            Scenario(COLUMNS, robots, judge),
            Scenario(MILL_COLUMNS, others, mills.judge, title),
        )
    )
