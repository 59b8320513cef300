"""Programs from controller to controller and back: python -m bench.read.translate [CASE...]

Every golden program is posted for every other controller, and the result for its own again.
The motion of the last program is compared with that of the first: the places of its tool both ways,
and the seconds at its speeds. Controllers without arcs, or with coarser digits, are in the
tolerance. A program that the other controller cannot have stands with the reason.

The first table is of robots. In the second a mill is one of the two. G-code has no motion of the
joints, and robots have no G0: a rapid motion becomes a line of travel. Both sides have the motion
at feed, outputs and waits; rapid motions are compared by the places where they end.
"""

from __future__ import annotations

import math
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import camgen
from bench.read.goldens import (
    ARMS,
    CASES,
    CHORD,
    MILLS,
    POSTS,
    execute,
    execute_whole,
    frames_of,
    measure_apart,
    read_robot,
    sample_between,
)  # fmt: skip
from bench.support.motions import measure_from_lines
from bench.support.runner import Cells, Scenario, run
from camgen.model.pose import Pose, Vec3, compute_fixed_xyz, translation

COLUMNS = "case | from | by way of | mm apart {:.4f} | s apart {:.3f} | "
MILL_COLUMNS = (
    "case | from | by way of | mm apart {:.4f} | s apart {:.3f} | rapids, mm apart {:.4f} | "
)
WITHIN = CHORD + 0.002
#: Points that are nearer are one, mm.
_SAME = 1e-6
#: Speed of travel, mm/s: beside a mill a motion of this speed is rapid.
_TRAVEL = 100.0
#: The robots whose outputs are on or off, and so is a spindle.
_ON_OFF = ("vplus", "pacscript")
_COOLANTS = {"flood": "M8", "mist": "M7"}
_EVERY = POSTS | MILLS


class Motion(NamedTuple):
    """The motion and the events of programs that run one after the other.

    points: places at feed, (N, 3) mm, in the base frame; beside a mill in the work frame.
    seconds: duration at the programmed speeds, s.
    rapids: ends of the rapid motions beside a mill, mm.
    outputs: values of the outputs, in order.
    changes: values to which an output changes.
    waits: s.
    """

    points: NDArray[np.float64]
    seconds: float
    rapids: list[tuple[Vec3, Vec3]]
    outputs: list[float]
    changes: list[float]
    waits: list[float]


def list_files(case: Path, controller: str) -> list[Path]:
    """The golden programs of a controller: several if it changes no tool."""
    suffix, folder = _EVERY[controller][0], case / "expected"
    return sorted(folder.glob(f"part{suffix}")) or sorted(folder.glob(f"part_*{suffix}"))


def list_routes(case: Path, mills: bool) -> list[tuple[Path, str, str]]:
    """Case, controller and another controller: two robots, or at least one mill."""
    routes = []
    for source in _EVERY if mills else POSTS:
        names = [file.stem for file in list_files(case, source)]
        for target in _EVERY:
            is_robots = {source, target} <= POSTS.keys()
            has_files = names == ["part"] if is_robots else bool(names)
            if source != target and is_robots != mills and has_files:
                routes.append((case, source, target))
    return routes


def follow(case: Path, files: Sequence[Path], language: str, mills: bool) -> Motion:
    """The motion of programs, without lines that begin at home.

    case: the case whose frames hold if a text has none.
    mills: whether the motion is compared with that of a mill.
    """
    points: list[NDArray[np.float64]] = [np.zeros((0, 3))]
    motion = Motion(np.zeros((0, 3)), 0.0, [], [], [], [])
    on: dict[str, float] = {}
    seconds = 0.0
    for file in files:
        base = translation(0, 0, 0)
        if language in MILLS:
            body = execute_whole(file, language).body
        else:
            body, base = read_robot(file, language, frames_of(case, language))
        position: Vec3 | None = None
        for item in body:
            if isinstance(item, camgen.Output):
                motion.outputs.append(item.value)
                motion.changes.extend(
                    [item.value] if item.value != on.get(item.signal, 0.0) else []
                )
                on[item.signal] = item.value
            elif isinstance(item, camgen.Wait):
                motion.waits.append(item.seconds)
            elif isinstance(item, camgen.MoveJ | camgen.MoveL | camgen.MoveC):
                target = item.target.origin if isinstance(item.target, Pose) else None
                if mills and target and _is_rapid(item):
                    motion.rapids.append((position or target, target))
                elif position is not None and not isinstance(item, camgen.MoveJ):
                    places, length = sample_between(position, item)
                    points.append(np.array(places))
                    seconds += length / item.speed
                position = target
    moved = np.concatenate(points) if len(points) > 1 else np.zeros((1, 3))
    if not mills:
        # Where one motion ends another begins.
        moved = moved[np.append(True, np.abs(np.diff(moved, axis=0)).max(axis=1) > _SAME)]
        moved = moved @ base.rotation.T + base.origin
    return motion._replace(points=moved, seconds=seconds)


def _is_rapid(item: camgen.MoveJ | camgen.MoveL | camgen.MoveC) -> bool:
    return isinstance(item, camgen.MoveJ) or math.isclose(item.speed, _TRAVEL, rel_tol=1e-4)


def post_again(
    file: Path, source: str, target: str, folder: Path, tables: Mapping[str, object]
) -> list[Path]:
    """The programs of the controller `target` for a program of `source`. CamgenError without one.

    folder: the place of the programs.
    tables: tables of the job: the cell between robots, the tools of a program of a mill.
    """
    is_robots = {source, target} <= POSTS.keys()
    outputs = [item for item in execute(file, source).body if isinstance(item, camgen.Output)]
    names = list(dict.fromkeys(item.signal for item in outputs))
    job: dict[str, dict[str, object]] = {"tolerance": {"chord": CHORD}, "post": {}}
    if source in ARMS:
        job["operation"] = {"taught_on": ARMS[source]}
    if is_robots or source in MILLS:
        job |= tables
    if source in MILLS:
        job |= {"process": {"travel": _TRAVEL}, "input": {"signals": {}}}
    if source in MILLS and target in _ON_OFF and "spindle" in names:
        job["post"]["spindle"] = "on-off"
    if source in POSTS and target in MILLS:
        # An analog output of a robot is the spindle of a mill.
        renamed = {name: "spindle" for name in names if "pindle" in name}
        job |= {"input": {"signals": renamed}} if renamed else {}
        names = [name for name in names if name not in renamed]
    if target in MILLS:
        names = [name for name in names if name != "spindle"]
    signals = {name: _word(name, source, target) for name in names}
    if target in MILLS and not signals:
        signals = {"process": MILLS[target][1].format(0)}
    job["post"] |= {"signals": signals} if signals or not is_robots else {}
    result = camgen.build(file, post=target, job=job, name=file.stem)
    for each in result.files:
        (folder / each.name).write_text(each.text, encoding="latin-1")
    suffix = _EVERY[target][0]
    return [folder / each.name for each in result.files if each.name.endswith(suffix)]


def _values(pose: Pose) -> list[float]:
    return [*pose.origin, *map(math.degrees, compute_fixed_xyz(pose.rotation))]


def _word(name: str, source: str, target: str) -> str | int:
    """The word of the controller `target` for an output: its number, and 1 for P0 of a mill."""
    if target in MILLS and name in _COOLANTS:
        return _COOLANTS[name]
    if target == "rapid" and name == "spindle":
        return "aoSpindle"
    is_numbered_from_0 = source in MILLS and target in POSTS
    other = 33 if {source, target} <= POSTS.keys() else 32
    digits = "".join(mark for mark in name if mark.isdigit()) or str(other)
    word = _EVERY[target][1].format(int(digits) + is_numbered_from_0)
    return int(word) if word.isdigit() else word


def translate_twice(case: Path, source: str, target: str) -> tuple[Motion, Motion]:
    """The motion of golden programs, and their motion after there and back. Raises CamgenError."""
    mills = not {source, target} <= POSTS.keys()
    files = list_files(case, source)
    if mills:
        golden = tomllib.loads((case / "job.toml").read_text())
        tables = {"tools": golden["tools"]} if "tools" in golden else {}
    else:
        base, tool = frames_of(case, source)
        cell = {"base_from_work": _values(base), "flange_from_tool": _values(tool)}
        tables = {"cell": cell}
    with tempfile.TemporaryDirectory() as first, tempfile.TemporaryDirectory() as second:
        others, back = [], []
        for file in files:
            others += post_again(file, source, target, Path(first), tables)
        for file in others:
            back += post_again(file, target, source, Path(second), tables)
        return follow(case, files, source, mills), follow(case, back, source, mills)


def measure_rapids(before: Motion, after: Motion) -> float:
    """The distance of ends of rapid motions from the rapid motions after, mm: cycles join them."""
    if not before.rapids:
        return 0.0
    starts, stops = np.array(after.rapids or [[(math.inf,) * 3] * 2]).transpose(1, 0, 2)
    ends = np.array(before.rapids)[:, 1]
    return max(float(measure_from_lines(end, starts, stops).min()) for end in ends)


def find_difference(before: Motion, after: Motion) -> str:
    """The difference of outputs and waits, empty without one."""
    faults = []
    if before.changes != after.changes:
        switched = [float(value != 0) for value in before.changes]
        is_on_off = switched == [float(value != 0) for value in after.changes]
        faults.append("the spindle is on or off" if is_on_off else "outputs differ")
    has_waits = len(before.waits) == len(after.waits)
    if not has_waits or not np.allclose(before.waits, after.waits, atol=0.005):
        faults.append("waits differ")
    return ", ".join(faults)


def measure(case: Path, source: str, target: str) -> Iterator[Cells]:
    """The row of golden programs and of the controller by way of which they go and come back."""
    mills = not {source, target} <= POSTS.keys()
    names = case.name, source, target
    try:
        before, after = translate_twice(case, source, target)
    except camgen.CamgenError as error:
        yield *names, *("---" if mills else "--"), str(error)
        return
    differences = measure_apart(before.points, after.points), abs(before.seconds - after.seconds)
    if mills:
        yield *names, *differences, measure_rapids(before, after), find_difference(before, after)
    else:
        yield *names, *differences, "" if before.outputs == after.outputs else "outputs differ"


if __name__ == "__main__":
    cases = [CASES / name for name in sys.argv[1:]]
    cases = cases or sorted(path for path in CASES.iterdir() if path.is_dir())
    robots, others = [], []
    for case in cases:
        robots += list_routes(case, mills=False)
        others += list_routes(case, mills=True)
    title = "By way of G-code, and G-code by way of the others:"
    sys.exit(
        run(Scenario(COLUMNS, robots, measure), Scenario(MILL_COLUMNS, others, measure, title))
    )
