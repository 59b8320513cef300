"""Where the origin is: work offsets, G92 and G10, as far as the program itself decides it.

Where a work offset lies is known to the machine alone. What a program does can still be told as long as it keeps to the
offset in which it begins, or says itself how far another one is from it.
"""

from __future__ import annotations

from camgen.gcode.state import AXES, Machine
from camgen.gcode.wrong import Wrong

_WORKS = ("G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3")


def work_offset(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001 (as all handlers)
    """G54 to G59.3."""
    before, m.work = m.work or "G54", code
    if code == before or not any(m.known):
        return
    old, new = _table(m, before), _table(m, code)
    for axis in range(3):
        a, b = old[axis], new[axis]
        if m.known[axis] and (a is None or b is None):
            raise Wrong(f"{code} after motions in {before}: how far apart they are is known to the machine alone")
        m.shift[axis] += (b or 0.0) - (a or 0.0)


def _table(m: Machine, code: str) -> list[float | None]:
    return m.works.setdefault(code, [None, None, None])


def given(m: Machine, words: dict[str, float]) -> dict[int, float]:
    """The axis words of a line in mm, taken out, by axis."""
    return {k: words.pop(name) * m.scale for k, name in enumerate(AXES) if name in words}


def set_offsets(m: Machine, code: str, words: dict[str, float]) -> None:
    """G10 L2 and L20, G92 and what cancels it."""
    if code in ("G92.1", "G92.2"):
        _cancel(m, code)
        return
    if code == "G92":
        axes = given(m, words)
        if not axes:
            raise Wrong("G92 without an axis")
        for axis, value in axes.items():
            moved = _read_as(m, axis, value)
            total = m.shifted[axis]
            m.shifted[axis] = None if moved is None or total is None else total + moved
        return
    kind, number = words.pop("L", 0.0), words.pop("P", -1.0)
    if kind not in (2.0, 20.0):
        raise Wrong(f"G10 L{kind:g} changes the tool table, which is not known here")
    if "R" in words:
        raise Wrong("G10 with R turns the work offset")
    if number not in range(10):
        raise Wrong(f"G10 P{number:g} is no work offset")
    target = _WORKS[int(number) - 1] if number else (m.work or "G54")
    for axis, value in given(m, words).items():
        _set(m, kind == 20.0, target, axis, value)


def _set(m: Machine, by_position: bool, target: str, axis: int, value: float) -> None:
    table, active = _table(m, target), target == (m.work or "G54")
    if by_position:
        if not active:
            raise Wrong("G10 L20 of a work offset that is not the one in use")
        moved, old = _read_as(m, axis, value), table[axis]
        table[axis] = None if moved is None or old is None else old + moved
        return
    old, table[axis] = table[axis], value
    if not active or not m.known[axis]:
        return
    if old is None:
        raise Wrong(f"G10 L2 moves {target} after a motion in it: where it was is known to the machine alone")
    m.shift[axis] += value - old


def _read_as(m: Machine, axis: int, value: float) -> float | None:
    """Makes the position of an axis read as ``value``; how far that moved the origin, None where it is not known."""
    if not m.known[axis]:
        m.known[axis] = True
        m.at[axis] = value + m.shift[axis]
        m.remark("assumed", f"the tool stands at {AXES[axis]}{value:g} mm of the work frame", "the line says so")
        return None
    moved = m.at[axis] - value - m.shift[axis]
    m.shift[axis] += moved
    return moved


def _cancel(m: Machine, code: str) -> None:
    for axis, by in enumerate(m.shifted):
        if by is None:
            raise Wrong(f"{code} after a G92 at a position that the program does not say")
        m.shift[axis] -= by
    m.shifted[:] = [0.0, 0.0, 0.0]
