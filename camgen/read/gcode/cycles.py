"""Drilling cycles as the motions that they stand for (LinuxCNC manual, canned cycles; levels as its interpreter's)."""

from __future__ import annotations

import math
from collections.abc import Callable

from camgen.read.gcode.codes import given
from camgen.read.gcode.state import AXES, Machine
from camgen.read.gcode.words import Wrong

CODES = frozenset({"G73", "G81", "G82", "G83", "G85", "G86", "G89"})
#: Where a peck begins again above the last one, mm, in LinuxCNC.
_AGAIN = 0.254
#: More holes, or more pecks in one, are not meant.
_MOST = 20_000
_NORMAL = {"G17": 2, "G18": 1, "G19": 0}


def drill(m: Machine, words: dict[str, float]) -> None:
    """The holes of one line. Takes out the words used."""
    normal = _NORMAL[m.plane]
    depth = AXES[normal]
    needed = (depth, "R", *_NEEDS.get(m.motion, ()))
    for letter in needed:
        if letter in words:
            scale = 1.0 if letter == "P" else m.scale
            m.sticky[letter] = words.pop(letter) * scale
    count = words.pop("L", 1.0)
    if count < 1 or count != int(count) or count > _MOST:
        raise Wrong(f"L{count:g} is no number of holes")
    for letter in needed:
        if letter not in m.sticky:
            raise Wrong(f"{m.motion} without {letter}")
    if m.feed <= 0:
        raise Wrong(f"{m.motion} without a feed (F)")
    if m.feed_mode != "G94":
        raise Wrong(f"{m.motion} with {m.feed_mode}: a cycle has a feed per minute here")
    m.start()
    if m.level is None:
        m.level = m.at[normal]
    _holes(m, normal, given(m, words), int(count))


_NEEDS = {"G73": ("Q",), "G83": ("Q",), "G82": ("P",), "G86": ("P",), "G89": ("P",)}


def _holes(m: Machine, normal: int, words: dict[int, float], count: int) -> None:
    place, level = list(m.at), m.level or 0.0
    retract, bottom = m.sticky["R"], m.sticky[AXES[normal]]
    if m.incremental:
        retract += level
        bottom += retract
    else:
        retract, bottom = retract + m.shift[normal], bottom + m.shift[normal]
        for axis, value in words.items():
            place[axis] = value + m.shift[axis]
    if retract < bottom:
        raise Wrong(f"{m.motion} begins (R) below its end")
    if m.to_start is None and level > retract:
        m.remark("assumed", "a cycle retracts to R", "the program says neither G98 nor G99; so does LinuxCNC")
    clear = max(level, retract) if m.to_start else retract
    if level < retract:
        _to(m, normal, retract)
    height = max(m.at[normal], clear)
    for _ in range(count):
        for axis, value in words.items() if m.incremental else ():
            place[axis] += value
        place[normal] = height
        if place != m.at:
            m.rapid(place)
        if height != retract:
            _to(m, normal, retract)
        _ONE[m.motion](m, normal, retract, bottom, clear)
        height = clear


def _to(m: Machine, axis: int, value: float) -> None:
    end = list(m.at)
    end[axis] = value
    m.rapid(end)


def _in(m: Machine, axis: int, value: float) -> None:
    end = list(m.at)
    end[axis] = value
    m.pieces([(None, (end[0], end[1], end[2]))], m.feed)


def _plain(m: Machine, axis: int, retract: float, bottom: float, clear: float) -> None:  # noqa: ARG001
    _in(m, axis, bottom)
    _to(m, axis, clear)


def _dwelling(m: Machine, axis: int, retract: float, bottom: float, clear: float) -> None:  # noqa: ARG001
    _in(m, axis, bottom)
    m.wait(_seconds(m))
    _to(m, axis, clear)


def _bored(m: Machine, axis: int, retract: float, bottom: float, clear: float) -> None:
    _in(m, axis, bottom)
    _in(m, axis, retract)
    if clear != retract:
        _to(m, axis, clear)


def _bored_dwelling(m: Machine, axis: int, retract: float, bottom: float, clear: float) -> None:  # noqa: ARG001
    _in(m, axis, bottom)
    m.wait(_seconds(m))
    _in(m, axis, clear)


def _stopped(m: Machine, axis: int, retract: float, bottom: float, clear: float) -> None:  # noqa: ARG001
    if m.spindle == "M5":
        raise Wrong("G86 while the spindle stands")
    _in(m, axis, bottom)
    m.wait(_seconds(m))
    name = "process" if m.on_off else "spindle"
    m.switch(name, 0.0)
    _to(m, axis, clear)
    m.switch(name, 1.0 if m.on_off else -m.speed if m.spindle == "M4" else m.speed)


def _pecked(m: Machine, axis: int, retract: float, bottom: float, clear: float) -> None:
    step = m.sticky["Q"]
    if step <= 0:
        raise Wrong(f"{m.motion} with a peck of Q{step:g}")
    count = math.ceil((retract - bottom) / step - 1e-9)
    if count > _MOST:
        raise Wrong(f"{m.motion} with more than {_MOST} pecks cannot be meant")
    for peck in range(1, count):
        reached = retract - peck * step
        _in(m, axis, reached)
        if m.motion == "G83":
            _to(m, axis, retract)
        _to(m, axis, reached + _AGAIN)
    _in(m, axis, bottom)
    _to(m, axis, clear)


def _seconds(m: Machine) -> float:
    seconds = m.sticky["P"]
    if seconds < 0:
        raise Wrong(f"{m.motion} with a wait of P{seconds:g}")
    return seconds


_ONE: dict[str, Callable[[Machine, int, float, float, float], None]] = {
    "G73": _pecked, "G81": _plain, "G82": _dwelling, "G83": _pecked, "G85": _bored, "G86": _stopped,
    "G89": _bored_dwelling,
}  # fmt: skip
