"""The modal state of a three-axis machine, and what each code but a motion does to it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from camgen.model.program import Force, Instruction, Output, Wait
from camgen.post import Fault, Remark
from camgen.read.gcode.words import Wrong

from .lexis import Rules

_INCH = 25.4


@dataclass(frozen=True, slots=True)
class Expect:
    """What the options of the post say about the text.

    work: the work offset. tool: the tool that is changed to, 0: none. path: most mm of G64, None where
    the controller has none. names: signal by output word. force: analog output and value per N, None without force.
    """

    work: str
    tool: int = 0
    path: float | None = None
    names: dict[str, str] = field(default_factory=dict)
    force: tuple[int, float] | None = None


@dataclass(slots=True)
class Machine:
    """The modal state, and what was written down so far. Lengths mm, feed mm/s; None: not said yet.

    line: 1-based, the one being read. started: a motion was read. placed: the position is known in all axes.
    back: G98 or G99. sticky: what the lines of a drilling cycle share, level: where it began.
    next_newtons, waiting: what M67 sets with the next motion, and the line of a word that waits for one.
    unread: the first line with a word that no post writes.
    """

    rules: Rules
    expect: Expect
    line: int = 0
    body: list[Instruction] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)
    faults: list[Fault] = field(default_factory=list)
    started: bool = False
    at: tuple[float | None, float | None, float | None] = (None, None, None)
    placed: bool = False
    unit: float | None = None
    incremental: bool = False
    absolute_centre: bool = False
    plane: str = "G17"
    motion: str = ""
    work: str = ""
    length: str = ""
    path: str = ""
    back: str = ""
    sticky: dict[str, float] = field(default_factory=dict)
    level: float = 0.0
    feed: float = 0.0
    speed: float | None = None
    spindle: str = "M5"
    coolants: set[str] = field(default_factory=set)
    tool: int | None = None
    changed: bool = False
    pressing: bool = False
    newtons: float = 0.0
    next_newtons: float | None = None
    waiting: int = 0
    ended: bool = False
    unread: int = 0

    def add(self, item: Instruction) -> None:
        """Writes ``item`` down for the line that is read."""
        self.body.append(item)
        self.lines.append(self.line)

    def fault(self, what: str) -> None:
        """Notes a fault of the line that is read."""
        self.faults.append(Fault(self.line, what))

    def remark(self, what: str) -> None:
        """Notes what the line leaves open."""
        self.faults.append(Remark(self.line, what))


def feed(m: Machine, value: float, codes: dict[str, str]) -> None:
    """F in the unit that holds before the line's own G20 or G21."""
    if value < 0:
        raise Wrong(f"feed F{value:g} is negative")
    if codes.get("units", "") == ("G20" if (m.unit or 1.0) == 1.0 else "G21"):
        raise Wrong("a feed in the line that changes the unit")
    m.feed = value * (m.unit or 1.0) / 60.0


def speed_and_tool(m: Machine, words: dict[str, float], codes: dict[str, str]) -> None:
    """S and T; a speed alone changes a spindle that turns."""
    if "T" in words:
        number = words.pop("T")
        if number < 0 or number != int(number):
            raise Wrong(f"T{number:g} is no tool")
        m.tool = int(number)
    if "S" in words:
        value = words.pop("S")
        if value < 0:
            raise Wrong(f"spindle speed S{value:g} is negative")
        m.speed = value
        if m.spindle != "M5" and "spindle" not in codes:
            m.add(Output("spindle", value if m.spindle == "M3" else -value))


def _input_output(m: Machine, code: str, words: dict[str, float]) -> None:
    """M62 to M65 digital, M67 and M68 analog; M62, M63 and M67 act with the next motion."""
    index = words.pop("E" if code in ("M67", "M68") else "P", -1.0)
    if index < 0 or index != int(index):
        raise Wrong(f"{code} without the number of its output")
    if code in ("M62", "M63", "M67"):
        m.waiting = m.line
    if code not in ("M67", "M68"):
        word = f"P{int(index)}"
        m.add(Output(m.expect.names.get(word, word), 1.0 if code in ("M62", "M64") else 0.0))
        return
    if "Q" not in words:
        raise Wrong(f"{code} without its value (Q)")
    value = words.pop("Q")
    if m.expect.force is None or m.expect.force[0] != index:
        m.add(Output(f"E{int(index)}", value))
    else:
        _press(m, value / m.expect.force[1], code == "M67" and m.pressing)


def _press(m: Machine, newtons: float, later: bool) -> None:
    if newtons < 0:
        raise Wrong(f"a force of {newtons:g} N")
    if later:
        m.next_newtons = newtons
        return
    m.pressing, m.newtons, m.next_newtons = newtons > 0, newtons, None
    m.add(Force(newtons))


def _change(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001 (as all handlers)
    if m.tool is None:
        raise Wrong("M6 without a tool (T)")
    if m.placed:
        raise Wrong("a tool change after the first motion is not read")
    if m.tool != m.expect.tool:
        raise Wrong(f"tool T{m.tool}, but post.tool is {m.expect.tool}")
    m.changed = True


def _spindle(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    m.spindle = code
    if code == "M5":
        m.add(Output("spindle", 0.0))
    elif m.speed is None:
        raise Wrong(f"{code} without a speed (S)")
    else:
        m.add(Output("spindle", m.speed if code == "M3" else -m.speed))


def _coolant(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    names = m.expect.names
    if code != "M9":
        m.coolants.add(code)
        m.add(Output(names.get(code, _COOLANTS[code]), 1.0))
        return
    # With none on, M9 still says that the one in use is off.
    for word in sorted(m.coolants) or [w for w in _COOLANTS if w in names] or ["M8"]:
        m.add(Output(names.get(word, _COOLANTS[word]), 0.0))
    m.coolants.clear()


_COOLANTS = {"M7": "mist", "M8": "flood"}


def _dwell(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    seconds = words.pop("P", -1.0)
    if seconds < 0:
        raise Wrong("G4 without its seconds (P)")
    m.add(Wait(seconds))


def _units(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    m.unit = _INCH if code == "G20" else 1.0


def _plane(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    m.plane = code


def _length(m: Machine, code: str, words: dict[str, float]) -> None:
    if code == "G43":
        number = words.pop("H", m.expect.tool)
        if not m.expect.tool or number != m.expect.tool:
            raise Wrong(f"G43 shifts z by the length of a tool, but post.tool is {m.expect.tool}")
    if m.placed and code != m.length:
        raise Wrong(f"{code} after the first motion shifts the origin")
    m.length = code


def _work(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    if m.placed and code != m.work:
        raise Wrong(f"{code}: another work offset after the first motion is not read")
    m.work = code


def _path(m: Machine, code: str, words: dict[str, float]) -> None:
    m.path = code
    if code != "G64":
        return
    tolerance = words.pop("P", 0.0)
    joined = words.pop("Q", tolerance)
    allowed = m.expect.path or 0.0
    if tolerance <= 0:
        raise Wrong("G64 without P rounds corners by any amount")
    if max(tolerance, joined) * (m.unit or 1.0) > allowed * (1 + 1e-9):
        raise Wrong(f"G64 may leave the path by {max(tolerance, joined):g}, post.path_tolerance is {allowed:g}")


def _distance(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    m.incremental = code == "G91"


def _centre_distance(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    m.absolute_centre = code == "G90.1"


def _back(m: Machine, code: str, words: dict[str, float]) -> None:  # noqa: ARG001
    m.back = code


HANDLERS: tuple[tuple[str, Callable[[Machine, str, dict[str, float]], None]], ...] = (
    ("input/output", _input_output),
    ("tool change", _change),
    ("spindle", _spindle),
    ("coolant", _coolant),
    ("dwell", _dwell),
    ("plane", _plane),
    ("units", _units),
    ("length offset", _length),
    ("work offset", _work),
    ("path", _path),
    ("distance", _distance),
    ("arc distance", _centre_distance),
    ("return level", _back),
)
