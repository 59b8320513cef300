"""Points of a V+ program in a data file, and the program that reads them (`points = "file"`).

A record is nine whole numbers: kind, stop, six values, check. V+ reals are single precision, exact
for whole numbers below 2**24. So coordinates are in 0.001 mm and angles in 0.0001 deg, and the
check sums are the same everywhere.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Sequence
from zlib import crc32

from camgen.model.pose import Pose
from camgen.model.program import Instruction, Joints, MoveJ, Stop, Wait
from camgen.model.text import short

from . import rules
from .lines import ANGLE_DIGITS, IN, SLIDE_DIGITS
from .rules import SPEED_DIGITS

#: Largest number of a record: a real of V+ holds it exactly with `_SHIFT` added.
_LARGEST = 2**23 - 1
_SHIFT, _PRIME, _FACTOR = 2**23, 65521, 31
#: The format of the file, in its first record.
_FORMAT = 1
#: Kinds of records. The kinds of posture words follow from 11 on.
_STRAIGHT, _JOINT, _FOUR, _SIX, _PERCENT, _MMPS, _SIGNAL, _WAIT = range(1, 9)
_WORDS = {
    word: 11 + k
    for k, word in enumerate(
        ("LEFTY", "RIGHTY", "ABOVE", "BELOW", "FLIP", "NOFLIP", "SINGLE", "MULTIPLE")
    )
}
#: Variables of the reader program: no tool or work frame may be called so.
_CONTROL = ("cg.lun", "cg.pass", "cg.n", "cg.sum", "cg.kind", "cg.stop")
_VALUES = ("cg.a", "cg.b", "cg.c", "cg.d", "cg.e", "cg.f")
_CHECK = "cg.check"
VARIABLES = frozenset((*_CONTROL, *_VALUES, _CHECK))
#: Maximum length of file names on disks of V+, without the suffix of 3.
_DISK_NAME = 8


class Records:
    """Records without their check, which ``data`` adds. decimals: digits of mm, 3 at most."""

    def __init__(self, decimals: int) -> None:
        self._decimals = decimals
        self._angles: dict[bytes, str] = {}

    def percent(self, value: float) -> str:
        """As ``Lines.percent``: whole and ten-thousandths."""
        return _record(_PERCENT, *_parts(value, SPEED_DIGITS))

    def straight(self, speed: float, turn: float) -> str:
        """As ``Lines.straight``, both numbers in two parts."""
        return _record(_MMPS, *_parts(speed, SPEED_DIGITS), *_parts(turn, SPEED_DIGITS))

    def word(self, word: str) -> str:
        """A posture."""
        return _record(_WORDS[word])

    def to_joints(self, joints: Joints, stops: bool) -> tuple[str, ...]:
        """A sliding joint is in 0.001 mm with the hundredths of it as the fifth value."""
        values = [_scaled(math.degrees(v), ANGLE_DIGITS) for v in joints.values]
        if len(values) == 6:
            return (_record(_SIX, *values, stop=stops),)
        whole, rest = divmod(_scaled(joints.values[2], SLIDE_DIGITS), 100)
        return (_record(_FOUR, values[0], values[1], whole, values[3], rest, stop=stops),)

    def to_pose(self, word: str, pose: Pose, stops: bool) -> tuple[str, ...]:
        """``MOVE`` or ``MOVES`` to a pose in the work frame."""
        key = pose.rotation.tobytes()
        angles = self._angles.get(key)
        if angles is None:
            values = (math.degrees(a) for a in rules.yaw_pitch_roll(pose.rotation))
            angles = self._angles[key] = ",".join(str(_scaled(v, ANGLE_DIGITS)) for v in values)
        x, y, z = (_scaled(float(short(v, self._decimals)), 3) for v in pose.origin)
        return (f"{_STRAIGHT if word == 'MOVES' else _JOINT},{int(stops)},{x},{y},{z},{angles}",)

    def signal(self, number: int) -> str:
        """An output; negative: off."""
        return _record(_SIGNAL, number)

    def wait(self, seconds: float) -> str:
        """A dwell: seconds and milliseconds."""
        return _record(_WAIT, *_parts(seconds, 3))


def _record(kind: int, *values: int, stop: bool = False) -> str:
    return ",".join(map(str, (kind, int(stop), *values, *(0,) * (len(_VALUES) - len(values)))))


def _scaled(value: float, digits: int) -> int:
    scale: int = 10**digits
    return round(float(short(value, digits)) * scale)


def _parts(value: float, digits: int) -> tuple[int, int]:
    scale: int = 10**digits
    return divmod(_scaled(value, digits), scale)


def too_large(item: Instruction) -> str:
    """Return why a record cannot hold `item`, with the remedy; empty if it can."""
    remedy = 'set post.points to "program"'
    if isinstance(item, MoveJ) and isinstance(item.target, Joints):
        limit = _LARGEST / 10**ANGLE_DIGITS
        values = [math.degrees(v) for v in item.target.values]
        if len(values) == 4:
            values[2] = item.target.values[2] / 10
        if any(abs(v) > limit for v in values):
            return (
                f"a joint beyond {limit:g} deg or {10 * limit:g} mm"
                f" has no room in a record; {remedy}"
            )
    if isinstance(item, Stop):
        return f"a stop for the operator has no record; {remedy}"
    if isinstance(item, Wait) and item.seconds > _LARGEST:
        return f"a wait beyond {_LARGEST} s has no room in a record; {remedy}"
    return ""


def data_name(name: str) -> str:
    """Name the data file: by the program if a disk of V+ takes the name, else with a check sum."""
    clean = re.sub(r"[^a-z0-9_]", "_", name.lower())
    if clean != name or len(clean) > _DISK_NAME:
        clean = f"{clean[: _DISK_NAME - 4]}{crc32(name.encode()) & 0xFFFF:04x}"
    return f"{clean}.dat"


def identify(settings: Sequence[str], records: Sequence[str]) -> tuple[int, int]:
    """Compute two numbers that identify a job: 46 bits of the SHA-256 of settings and records."""
    digest = hashlib.sha256("\n".join((*settings, *records)).encode()).digest()
    return int.from_bytes(digest[:3]) >> 1, int.from_bytes(digest[3:6]) >> 1


def data(identity: tuple[int, int], records: Sequence[str]) -> str:
    """Print the file: format, identification and number of records, then records with checks."""
    total = identity[0] % _PRIME
    lines = [f"{_FORMAT},{identity[0]},{identity[1]},{len(records)}"]
    for record in records:
        for number in map(int, record.split(",")):
            total = (_FACTOR * total + (number + _SHIFT) % _PRIME) % _PRIME
        lines.append(f"{record},{total}")
    return "\n".join(lines) + "\n"


def signals_of(records: Sequence[str]) -> list[int]:
    """List the numbers of all outputs that the records set."""
    return sorted(
        {abs(int(record.split(",")[2])) for record in records if record.startswith(f"{_SIGNAL},")}
    )


def declarations() -> list[str]:
    """Declare the variables of the reader."""
    return [f"{IN}AUTO REAL {', '.join(names)}" for names in (_CONTROL, (*_VALUES, _CHECK))]


def reader(
    file: str, identity: tuple[int, int], count: int, work: str, signals: Sequence[int]
) -> list[str]:
    """Print the reader after its head: it reads the file twice, the first time only to check it."""
    body = [
        'ATTACH (cg.lun, 4) "DISK"', *_unless("IOSTAT(cg.lun) < 0"),
        "cg.pass = 1",
        "WHILE cg.pass <= 2 DO",
        f'FOPENR (cg.lun) "{file}"', *_unless("IOSTAT(cg.lun) < 0"),
        "READ (cg.lun) cg.a, cg.b, cg.c, cg.d", *_unless("IOSTAT(cg.lun) < 0"),
        *_unless(f"(cg.a <> {_FORMAT}) OR (cg.b <> {identity[0]})"),
        *_unless(f"(cg.c <> {identity[1]}) OR (cg.d <> {count})"),
        f"cg.sum = cg.b MOD {_PRIME}",
        "cg.n = 1",
        f"WHILE cg.n <= {count} DO",
        f"READ (cg.lun) cg.kind, cg.stop, {', '.join(_VALUES)}, {_CHECK}",
        *_unless("IOSTAT(cg.lun) < 0"),
        *(f"cg.sum = ({_FACTOR}*cg.sum+(({name}+{_SHIFT}) MOD {_PRIME})) MOD {_PRIME}"
          for name in ("cg.kind", "cg.stop", *_VALUES)),
        *_unless(f"cg.sum <> {_CHECK}"),
        "IF cg.pass == 2 THEN", *_act(work), "END",
        "cg.n = cg.n+1", "END",
        "FCLOSE (cg.lun)", "cg.pass = cg.pass+1", "END",
        "DETACH (cg.lun)", "DETACH ()", "RETURN",
        "100",
        "BREAK",
        *(f"SIGNAL -{number}" for number in signals),
        'TYPE "the data file is missing, damaged or of another job: stopped"',
        "FCLOSE (cg.lun)", "DETACH (cg.lun)", "DETACH ()", "STOP",
    ]  # fmt: skip
    return [*_indented(body), ".END"]


def _unless(wrong: str) -> list[str]:
    return [f"IF {wrong} THEN", "GOTO 100", "END"]


def _act(work: str) -> list[str]:
    mm, deg = 10**3, 10**ANGLE_DIGITS
    a, b, c, d, e, f = _VALUES
    pose = f"{work}:TRANS({a}/{mm},{b}/{mm},{c}/{mm},{d}/{deg},{e}/{deg},{f}/{deg})"
    cases = {
        _STRAIGHT: f"MOVES {pose}",
        _JOINT: f"MOVE {pose}",
        _FOUR: f"MOVE #PPOINT({a}/{deg},{b}/{deg},{c}/{mm}+{e}/{10**SLIDE_DIGITS},{d}/{deg})",
        _SIX: f"MOVE #PPOINT({','.join(f'{name}/{deg}' for name in _VALUES)})",
        _PERCENT: f"SPEED {a}+{b}/{10**SPEED_DIGITS} ALWAYS",
        _MMPS: f"SPEED {a}+{b}/{10**SPEED_DIGITS}, {c}+{d}/{10**SPEED_DIGITS} MMPS ALWAYS",
        _SIGNAL: f"SIGNAL {a}",
        _WAIT: f"WAIT.EVENT , {a}+{b}/1000",
        **{number: word for word, number in _WORDS.items()},
    }
    lines = ["CASE cg.kind OF"]
    for number, does in cases.items():
        lines += [f"VALUE {number}:", does]
    return [*lines, "ANY", "GOTO 100", "END", "IF cg.stop == 1 THEN", "BREAK", "END"]


def _indented(body: Sequence[str]) -> list[str]:
    lines: list[str] = []
    depth = 1
    for text in body:
        word = text.split()[0]
        depth -= word == "END"
        lines.append(text if word.isdigit() else IN * (depth - (word in ("VALUE", "ANY"))) + text)
        depth += word in ("IF", "WHILE", "CASE")
    return lines
