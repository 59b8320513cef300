"""Golden programs by way of G-code, and of G-code by way of robots and back (bench/read/translate.py prints them).

G-code has no motion of the joints, and robots have no G0: a rapid motion becomes a line of travel. Compared is what
both have: the way at feed and its seconds, outputs, waits; rapid motions by the places where they end.
"""

from __future__ import annotations

import math
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import camgen
from bench.read.goldens import (
    ARMS,
    CHORD,
    POSTS,
    along,
    apart,
    execute,
    execute_whole,
    frames_of,
    read_robot,
    to_lines,
)  # fmt: skip
from bench.support.runner import Cells
from camgen.model.pose import Pose, Vec3
from camgen.model.program import Instruction, MoveC, MoveJ, MoveL, Output, Wait

#: The controllers of mills, as ``POSTS``; GRBL has a coolant for one signal.
MILLS = {"gcode": (".ngc", "P{}"), "grbl": (".nc", "M8")}
_EVERY = POSTS | MILLS
#: mm/s of travel: what is as fast is no work.
_TRAVEL = 100.0
#: What the robots whose outputs are on or off print for a spindle.
_ON_OFF = ("vplus", "pacscript")


class Kept(NamedTuple):
    """points: (N, 3) on the way at feed, work frame, mm. seconds: at its speeds. rapids: from where to where rapid
    motions lead. outputs: the values to which one changes. waits: s.
    """

    points: NDArray[np.float64]
    seconds: float
    rapids: list[tuple[Vec3, Vec3]]
    outputs: list[float]
    waits: list[float]


def pairs(case: Path) -> list[tuple[str, str]]:
    """From, and by way of: one of the two at least is a mill's."""
    there = [source for source in _EVERY if files_of(case, source)]
    return [(a, b) for a in there for b in _EVERY if a != b and not {a, b} <= POSTS.keys()]


def files_of(case: Path, source: str) -> list[Path]:
    """The golden programs of a controller: several where it changes no tool."""
    suffix = _EVERY[source][0]
    return sorted((case / "expected").glob(f"part{suffix}")) or sorted(
        (case / "expected").glob(f"part_*{suffix}")
    )


def kept_of(case: Path, files: Sequence[Path], language: str) -> Kept:
    """What programs do one after the other. case: whose frames hold where a text says none."""
    points: list[Vec3] = []
    found = Kept(np.zeros((0, 3)), 0.0, [], [], [])
    on: dict[str, float] = {}
    seconds = 0.0
    for file in files:
        here: Vec3 | None = None
        for item in _body_of(case, file, language):
            if isinstance(item, Output):
                found.outputs.extend([item.value] if item.value != on.get(item.signal, 0.0) else [])
                on[item.signal] = item.value
            elif isinstance(item, Wait):
                found.waits.append(item.seconds)
            elif isinstance(item, MoveJ | MoveL | MoveC):
                if _is_rapid(item) and isinstance(item.target, Pose):
                    found.rapids.append((here or item.target.origin, item.target.origin))
                elif here is not None and not isinstance(item, MoveJ):
                    some, length = along(here, item)
                    points += some
                    seconds += length / item.speed
                here = item.target.origin if isinstance(item.target, Pose) else None
    return found._replace(points=np.array(points or [(0.0, 0.0, 0.0)]), seconds=seconds)


def _is_rapid(item: MoveJ | MoveL | MoveC) -> bool:
    return isinstance(item, MoveJ) or math.isclose(item.speed, _TRAVEL, rel_tol=1e-4)


def _body_of(case: Path, file: Path, language: str) -> Sequence[Instruction]:
    if language in MILLS:
        return execute_whole(file, language).body
    return read_robot(file, language, frames_of(case, language))[0]


def post_again(
    file: Path, source: str, target: str, folder: Path, tables: dict[str, object]
) -> list[Path]:
    """The programs of the controller ``target`` for the program ``file`` of ``source``. CamgenError where it has none.

    tables: of the job of the golden program.
    """
    suffix, form = _EVERY[target]
    outputs = [item for item in execute(file, source).body if isinstance(item, Output)]
    used = dict.fromkeys(item.signal for item in outputs)
    old: dict[str, str] = {}
    if source in POSTS and target in MILLS:
        # An analog output of a robot is the spindle of a mill.
        old = {name: "spindle" for name in used if "pindle" in name}
    job: dict[str, object] = {"tolerance": {"chord": CHORD}}
    if source in ARMS:
        job["operation"] = {"taught_on": ARMS[source]}
    if source in MILLS:
        job |= {"process": {"travel": _TRAVEL}, "input": {"signals": old}}
        job |= {"tools": tables["tools"]} if "tools" in tables else {}
    elif old:
        job["input"] = {"signals": old}
    named = [name for name in used if name not in old and (name, target) not in _BUILT_IN]
    signals = {name: _word(name, target, form) for name in named}
    if target in MILLS and not signals:
        signals = {"process": form.format(0)}
    job["post"] = {"signals": signals}
    if target in _ON_OFF and "spindle" in used:
        job["post"]["spindle"] = "on-off"  # type: ignore[index]  # set above
    result = camgen.build(file, post=target, job=job, name=file.stem)
    for one in result.files:
        (folder / one.name).write_text(one.text, encoding="latin-1")
    return [folder / one.name for one in result.files if one.name.endswith(suffix)]


_BUILT_IN = {("spindle", "gcode"), ("spindle", "grbl")}
_COOLANTS = {"flood": "M8", "mist": "M7"}


def _word(name: str, target: str, form: str) -> str | int:
    if target in MILLS and name in _COOLANTS:
        return _COOLANTS[name]
    if target == "rapid" and name == "spindle":
        return "aoSpindle"
    digits = "".join(c for c in name if c.isdigit()) or "32"
    word = form.format(int(digits) + (target in POSTS))
    return int(word) if word.isdigit() else word


def there_and_back(case: Path, source: str, target: str) -> tuple[Kept, Kept]:
    """What golden programs do, and what they do after there and back. CamgenError where they cannot go there."""
    tables = tomllib.loads((case / "job.toml").read_text())
    with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as two:
        files = files_of(case, source)
        there = [
            made for file in files for made in post_again(file, source, target, Path(one), tables)
        ]
        back = [
            made for file in there for made in post_again(file, target, source, Path(two), tables)
        ]
        return kept_of(case, files, source), kept_of(case, back, source)


def rapids_apart(before: Kept, after: Kept) -> float:
    """How far a place at which a rapid motion ended is at most from the rapid motions after, mm: cycles join them."""
    if not before.rapids:
        return 0.0
    ends = np.array([end for _, end in before.rapids])
    starts, stops = (
        np.array([pair[k] for pair in after.rapids] or [(math.inf,) * 3]) for k in (0, 1)
    )
    return float(max(to_lines(end, starts, stops).min() for end in ends))


def differ(before: Kept, after: Kept) -> str:
    """What of outputs and waits is not the same, "" where all is."""
    what = []
    if before.outputs != after.outputs:
        on_off = [float(value != 0) for value in before.outputs] == [
            float(value != 0) for value in after.outputs
        ]
        what.append("the spindle is on or off" if on_off else "outputs differ")
    if len(before.waits) != len(after.waits) or not np.allclose(
        before.waits, after.waits, atol=0.005
    ):
        what.append("waits differ")
    return ", ".join(what)


def judge(case: Path, source: str, target: str) -> Iterator[Cells]:
    """The row of a golden program and a controller by way of which it goes and comes back."""
    names = case.name, source, target
    try:
        a, b = there_and_back(case, source, target)
    except camgen.CamgenError as error:
        yield *names, *"---", str(error)
        return
    off, seconds = apart(a.points, b.points), abs(a.seconds - b.seconds)
    yield *names, off, seconds, rapids_apart(a, b), differ(a, b)
