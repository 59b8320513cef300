"""LinuxCNC's own interpreter, run without a machine: the canonical calls of a program.

`rs274` belongs to the Debian package linuxcnc-uspace. It prints these calls instead of moving. This
module imports nothing of camgen, so that an independent judge can use it.
"""

from __future__ import annotations

import fcntl
import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

from tests.support.waiting import LONG

RS274 = shutil.which("rs274")
#: Index of the argument that is the value of a call.
_SWITCHES = {
    "DWELL": 0,
    "SET_AUX_OUTPUT_BIT": 0,
    "CLEAR_AUX_OUTPUT_BIT": 0,
    "SET_AUX_OUTPUT_VALUE": 1,
    "SET_MOTION_OUTPUT_VALUE": 1,
    "START_SPINDLE_CLOCKWISE": 0,
    "STOP_SPINDLE_TURNING": 0,
}
_MOVES = ("STRAIGHT_TRAVERSE", "STRAIGHT_FEED", "ARC_FEED")
#: Index of the argument that is the x of an offset.
_OFFSETS = {"SET_G5X_OFFSET": 1, "SET_G92_OFFSET": 0}
_PLANES = {"XY": (0, 1, 2), "XZ": (2, 0, 1), "YZ": (1, 2, 0)}
_LIFT = re.compile(r"\bG53 G0 Z0$", re.M)
_CALL = re.compile(r"\s*\d+ N\S+\s+(\w+)\((.*)\)\s*$")

Point = tuple[float, float, float]


@dataclass(frozen=True)
class Call:
    """A canonical call that moves, waits or switches.

    end: mm.
    feed: mm/min.
    centre: centre of an arc in its plane, mm.
    turns: turns of an arc, positive counter-clockwise.
    value: seconds, number of an output or rpm.
    axes: indices of the two axes of the plane, and of the axis across it.
    """

    kind: str
    end: Point = (0.0, 0.0, 0.0)
    feed: float = 0.0
    centre: tuple[float, float] = (0.0, 0.0)
    turns: int = 0
    value: float = 0.0
    axes: tuple[int, int, int] = (0, 1, 2)


@dataclass(frozen=True)
class Canon:
    """The calls of a program.

    calls: calls of a kind that `Call` describes, in order.
    names: names of all calls.
    error: message of the interpreter, empty if it accepted the program.
    lead: number of motions up and across before the position is known in all axes.
    hidden: half of the last digit of the coordinates, mm.
    is_shifted: whether the program sets an offset.
    """

    calls: tuple[Call, ...]
    names: tuple[str, ...]
    error: str
    lead: int = 1
    hidden: float = 0.0
    is_shifted: bool = False

    @property
    def moves(self) -> list[Call]:
        """The calls that move."""
        return [call for call in self.calls if call.kind in _MOVES]


def run(text: str, tools: str = "T1 P1 Z0 D3.0 ;cutter\n", timeout: float = LONG) -> Canon:
    """Runs a program with a tool table. timeout: s, after which it counts as an error."""
    with tempfile.TemporaryDirectory() as folder:
        for name, content in (("in.ngc", text), ("tool.tbl", tools), ("my.var", "")):
            Path(folder, name).write_text(content, encoding="latin-1")
        command = [str(RS274), "-g", "-v", "my.var", "-t", "tool.tbl", "in.ngc", "out"]
        try:
            # Two interpreters at once share memory with a fixed key, and fail sometimes.
            with (Path(tempfile.gettempdir()) / "camgen-rs274.lock").open("w") as lock:
                fcntl.flock(lock, fcntl.LOCK_EX)
                done = subprocess.run(
                    command, cwd=folder, capture_output=True, timeout=timeout, check=False
                )
        except subprocess.TimeoutExpired:
            return Canon((), (), "rs274 does not end")
        out = Path(folder, "out")
        output = out.read_text(encoding="latin-1") if out.is_file() else ""
    error = ""
    if done.returncode:
        message = done.stderr.decode("latin-1").replace("executing\n", "").strip()
        error = message or "rs274 failed"
    return replace(_parse(output, error), lead=2 if _LIFT.search(text) else 1)


def _parse(output: str, error: str) -> Canon:
    """Converts the calls to mm, without the offsets of the program.

    Coordinates and feeds are printed in the unit of the program.
    """
    calls: list[Call] = []
    names: list[str] = []
    feed = speed = hidden = 0.0
    unit = 1.0
    axes = (0, 1, 2)
    offsets = dict.fromkeys(_OFFSETS, (0.0, 0.0, 0.0))
    is_shifted = False
    for match in filter(None, map(_CALL.match, output.splitlines())):
        name, arguments = match.groups()
        names.append(name)
        v = [float(n) for n in re.findall(r"-?\d+\.?\d*", arguments)] if name != "COMMENT" else []
        if name == "USE_LENGTH_UNITS":
            unit = 25.4 if "INCH" in arguments else 1.0
        elif name == "SELECT_PLANE":
            axes = _PLANES[arguments[-2:]]
        elif name in _OFFSETS:
            first = _OFFSETS[name]
            offsets[name] = (v[first] * unit, v[first + 1] * unit, v[first + 2] * unit)
            is_shifted = is_shifted or any(offsets[name])
        elif name == "SET_FEED_RATE":
            feed = v[0] * unit
        elif name == "SET_SPINDLE_SPEED":
            speed = v[1]
        elif name in _MOVES:
            calls.append(replace(_move(name, v, unit, axes, offsets), feed=feed))
            hidden = max(hidden, 0.5e-4 * unit)
        elif name in _SWITCHES:
            value = speed if name == "START_SPINDLE_CLOCKWISE" else v[_SWITCHES[name]]
            calls.append(Call(name, value=value))
    return Canon(tuple(calls), tuple(names), error, hidden=hidden, is_shifted=is_shifted)


def _move(
    kind: str, v: list[float], unit: float, axes: tuple[int, int, int], offsets: dict[str, Point]
) -> Call:
    """A motion without its feed. v: coordinates in the unit; of an arc those of its plane first."""
    shift = [sum(values) for values in zip(*offsets.values(), strict=True)]
    if kind != "ARC_FEED":
        x, y, z = (v[k] * unit + shift[k] for k in range(3))
        return Call(kind, (x, y, z), axes=axes)
    first, second, _ = axes
    end = dict(zip(axes, (v[0], v[1], v[5]), strict=True))
    x, y, z = (end[k] * unit + shift[k] for k in range(3))
    centre = (v[2] * unit + shift[first], v[3] * unit + shift[second])
    return Call(kind, (x, y, z), centre=centre, turns=round(v[4]), axes=axes)
