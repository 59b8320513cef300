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
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import camgen
from bench.machine import machine
from bench.read import mills
from bench.read.goldens import ARMS, CASES, CHORD, POSTS, along, apart, frames_of, pose_of
from camgen.model.pose import Pose, fixed_xyz
from camgen.model.program import Joints, MoveC, MoveJ, MoveL, Output
from camgen.read.programs import Ask, find_language
from camgen.read.taught import in_one_frame
from camgen.robots.catalogue import robot

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
    executed = find_language(language).run({file.name: file.read_text(encoding="latin-1")}, Ask())
    if executed.stopped or any(one.level == "refused" for one in executed.findings):
        raise ValueError(f"{file.name}: {executed.stopped or executed.findings}")
    told = in_one_frame(executed, file.name, 0.001)
    base, tool = told.frames.base_from_work or frames[0], told.frames.flange_from_tool or frames[1]
    arm = robot(ARMS[language])
    joints = [
        item.target.values
        for item in told.body
        if isinstance(item, MoveJ) and isinstance(item.target, Joints)
    ]
    homes = {*joints[:1], *joints[-1:]}
    points: list[tuple[float, float, float]] = []
    outputs: list[tuple[str, float]] = []
    seconds, here = 0.0, None
    for item in told.body:
        if isinstance(item, Output):
            outputs.append((item.signal, item.value))
        if not isinstance(item, MoveJ | MoveL | MoveC):
            continue
        if here is not None and not isinstance(item, MoveJ):
            some, length = along(here, item)
            points += some
            seconds += length / item.speed
        target = item.target
        if not isinstance(target, Pose) and target.values in homes:
            here = None  # another arm's is elsewhere
            continue
        if not isinstance(target, Pose):
            target = pose_of(arm, target, base, tool)
        here = target.origin
    moved = np.array(points or [(0.0, 0.0, 0.0)])
    # Where one motion ends another begins.
    moved = moved[np.append(True, np.abs(np.diff(moved, axis=0)).max(axis=1) > _SAME)]
    return Way(moved @ base.rotation.T + base.origin, seconds, outputs)


def post_again(
    file: Path, source: str, target: str, folder: Path, frames: tuple[Pose, Pose]
) -> Path:
    """The program ``file`` of the controller ``source`` for another one; CamgenError where that cannot be."""
    executed = find_language(source).run({file.name: file.read_text(encoding="latin-1")}, Ask())
    names = dict.fromkeys(item.signal for item in executed.body if isinstance(item, Output))
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


def rows(case: Path) -> list[str]:
    """A row of a Markdown table for each pair of controllers."""
    files = {source: case / "expected" / f"part{suffix}" for source, (suffix, _) in POSTS.items()}
    pairs = [
        (source, target) for source, file in files.items() for target in POSTS if file.exists()
    ]
    return [f"| {case.name} | {a} | {b} | {tell(files[a], a, b)} |" for a, b in pairs if a != b]


def there_and_back(file: Path, source: str, target: str) -> tuple[Way, Way]:
    """What a golden program does, and what it does after there and back. CamgenError where it cannot go there."""
    with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as two:
        frames = frames_of(file.parents[1], source)
        there = post_again(file, source, target, Path(one), frames)
        back = post_again(there, target, source, Path(two), frames)
        return way_of(file, source, frames), way_of(back, source, frames)


def tell(file: Path, source: str, target: str) -> str:
    """How far the motion is off after there and back, and how its time differs, or why it cannot be."""
    try:
        a, b = there_and_back(file, source, target)
    except camgen.CamgenError as error:
        return f"- | - | {error}"
    same = [value for _, value in a.outputs] == [value for _, value in b.outputs]
    return f"{apart(a.points, b.points):.4f} | {abs(a.seconds - b.seconds):.3f} | {'' if same else 'outputs differ'}"


def main() -> None:
    """The table."""
    print(machine(), end="\n\n")
    print("| case | from | by way of | mm apart | s apart | |")
    print("|---|---|---|---|---|---|")
    listed = [CASES / name for name in sys.argv[1:]] or sorted(
        p for p in CASES.iterdir() if p.is_dir()
    )
    for case in listed:
        for row in rows(case):
            print(row, flush=True)
    print("\nBy way of G-code, and G-code by way of the others:\n")
    print("| case | from | by way of | mm apart | s apart | rapids, mm apart | |")
    print("|---|---|---|---|---|---|---|")
    for case in listed:
        for pair in mills.pairs(case):
            print(
                f"| {case.name} | {pair[0]} | {pair[1]} | {mills.tell(case, *pair)} |", flush=True
            )


if __name__ == "__main__":
    main()
