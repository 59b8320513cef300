"""The functions of V+ of numbers, bits and strings, and the assumed values of external functions.

Sources: V+ Language Reference Guide and User's Guide, version 17 (docs/languages/vplus.md). Angles
are degrees.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping, Sequence

from .text import Impossible

#: V+ integers have 32 bits.
_MASK = 0xFFFFFFFF
#: Maximum length of a string. V+ allows 128; the limit stops programs that build them in a loop.
LONGEST = 1000


def whole(value: float) -> int:
    """Return `value` without its fraction, for operations on bits."""
    if not abs(value) < 2**53:
        raise Impossible("a number too large for its bits")
    return int(value)


def signed(bits: int) -> float:
    """Convert 32 bits to a signed integer."""
    bits &= _MASK
    return float(bits - (_MASK + 1) if bits > _MASK >> 1 else bits)


def divide(a: float, b: float) -> float:
    """Compute `a / b`."""
    if b == 0:
        raise Impossible("a division by zero")
    return a / b


def remainder(a: float, b: float) -> float:
    """Compute `a MOD b`, which has the sign of `a`."""
    if b == 0:
        raise Impossible("a division by zero")
    return math.fmod(a, b)


def truth(value: bool) -> float:
    """Convert a bool to TRUE (-1) or FALSE (0)."""
    return -1.0 if value else 0.0


def _root(value: float) -> float:
    if value < 0:
        raise Impossible("the root of a negative number")
    return math.sqrt(value)


def _from_bcd(value: float) -> float:
    digits = f"{abs(whole(value)):x}"
    return float(int(digits)) if digits.isdigit() else 0.0


def _mask(*bits: float) -> float:
    total = 0
    for bit in bits:
        if not 1 <= bit <= 32:
            raise Impossible("BMASK has bits 1 to 32")
        total |= 1 << (int(bit) - 1)
    return signed(total)


#: Functions of numbers, by name: minimum and maximum number of arguments, and the function.
NUMBERS: Mapping[str, tuple[int, int, Callable[..., float]]] = {
    "ABS": (1, 1, abs),
    "ATAN2": (2, 2, lambda y, x: math.degrees(math.atan2(y, x))),
    "BCD": (1, 1, lambda x: float(int(str(abs(whole(x))), 16))),
    "BMASK": (1, 32, _mask),
    "COS": (1, 1, lambda deg: math.cos(math.radians(deg))),
    "DCB": (1, 1, _from_bcd),
    "FRACT": (1, 1, lambda x: math.fmod(x, 1.0)),
    "INT": (1, 2, lambda x, _=0.0: float(math.trunc(x))),
    "MAX": (1, 32, max),
    "MIN": (1, 32, min),
    "OUTSIDE": (3, 3, lambda low, x, high: truth(not low <= x <= high)),
    "SIGN": (1, 1, lambda x: -1.0 if x < 0 else 1.0),
    "SIN": (1, 1, lambda deg: math.sin(math.radians(deg))),
    "SQR": (1, 1, lambda x: x * x),
    "SQRT": (1, 1, _root),
    "TAN": (1, 1, lambda deg: math.tan(math.radians(deg))),
}  # fmt: skip


def _bytes(code: str, text: str, first: float = 1.0) -> float:
    size = struct.calcsize(code)
    start = max(0, int(first) - 1)
    raw = bytes(ord(c) & 0xFF for c in text[start : start + size]).ljust(size, b"\0")
    value = float(struct.unpack(code, raw)[0])
    return value if math.isfinite(value) else 0.0


def _number(text: str) -> float:
    """Compute VAL: the number at the start of a text, 0 without one."""
    digits = text.strip()
    for end in range(min(len(digits), 40), 0, -1):
        try:
            value = float(digits[:end])
        except ValueError:
            continue
        return value if math.isfinite(value) and "_" not in digits[:end] else 0.0
    return 0.0


def _code(text: str, index: float = 1.0) -> float:
    place = int(index) - 1
    return float(ord(text[place])) if 0 <= place < len(text) else -1.0


#: Functions of strings with a number as value, by name: the kinds of the arguments ($ for a string,
#: a dot for a number), the minimum number of them, and the function.
OF_STRINGS: Mapping[str, tuple[str, int, Callable[..., float]]] = {
    "ASC": ("$.", 1, _code),
    "DBLB": ("$.", 1, lambda s, first=1.0: _bytes(">d", s, first)),
    "FLTB": ("$.", 1, lambda s, first=1.0: _bytes(">f", s, first)),
    "INTB": ("$.", 1, lambda s, first=1.0: _bytes(">h", s, first)),
    "LEN": ("$", 1, lambda s: float(len(s))),
    "LNGB": ("$.", 1, lambda s, first=1.0: _bytes(">i", s, first)),
    "POS": (
        "$$.",
        2,
        lambda text, part, start=1.0: float(
            text.lower().find(part.lower(), max(0, int(start) - 1)) + 1
        ),
    ),
    "STRDIF": ("$$", 2, lambda a, b: float((a > b) - (a < b))),
    "VAL": ("$", 1, _number),
}


def _to_bytes(code: str, value: float) -> str:
    if code in ("i", "h"):
        bits = 8 * struct.calcsize(">" + code)
        number = whole(value) & ((1 << bits) - 1)
        return "".join(map(chr, number.to_bytes(bits // 8, "big")))
    try:
        return "".join(map(chr, struct.pack(">" + code, value)))
    except OverflowError:
        raise Impossible("a number too large for four bytes") from None


def _middle(text: str, first: float = 1.0, count: float = float(LONGEST)) -> str:
    start = max(0, int(first) - 1)
    return text[start : start + max(0, int(count))]


#: Functions with a string as value, in the form of `OF_STRINGS`.
TEXTS: Mapping[str, tuple[str, int, Callable[..., str]]] = {
    "$CHR": (".", 1, lambda x: chr(whole(x) & 0xFF)),
    "$DBLB": (".", 1, lambda x: _to_bytes("d", x)),
    "$FLTB": (".", 1, lambda x: _to_bytes("f", x)),
    "$INTB": (".", 1, lambda x: _to_bytes("h", x)),
    "$LNGB": (".", 1, lambda x: _to_bytes("i", x)),
    "$MID": ("$..", 1, _middle),
    "$TRUNCATE": ("$", 1, lambda s: s.split("\0")[0]),
}

#: External functions, with the assumed value of each: the one with which a program continues.
ASKED: Mapping[str, float] = {
    "AIO.IN": 0.0, "BELT": 0.0, "BSTAT": 0.0, "CONFIG": 0.0, "DEVICE": 0.0, "DIN": 0.0,
    "DURATION": 0.0, "ERROR": 0.0, "FREE": 1.0, "GETC": 0.0, "GETEVENT": 0.0, "HAND": -1.0,
    "HOUR.METER": 0.0, "ID": 1.0, "INRANGE": 0.0, "INTEGRATE": 0.0, "IOSTAT": 1.0, "IOTAS": 0.0,
    "KEYMODE": 0.0, "LASTERR": 0.0, "LATCHED": 0.0, "MSG": 0.0, "NETWORK": 1.0, "PENDANT": 0.0,
    "PRIORITY": 0.0, "RANDOM": 0.5, "ROBOT": 1.0, "SELECT": 1.0, "SIG.INS": 1.0,
    "SOLVE.FLAGS": 0.0, "SPEED": 100.0, "STATE": 0.0, "STATUS": 0.0, "STRUCT": 0.0,
    "SWITCH": -1.0, "SYSTEM": 1.0, "TAS": 0.0, "TASK": 0.0, "TIME": 0.0, "TPS": 62.5,
    "VFEATURE": 1.0, "VLAST": 0.0, "VQUEUE": 0.0, "VRESULT": 1.0, "VSTATE": 0.0, "WINDOW": 0.0,
}  # fmt: skip


def format_number(value: float, form: str = "") -> str:
    """Format a number like TYPE and $ENCODE.

    form: such as F0.3 or I5. Empty for the free format, which begins with a blank.
    """
    if form[:1] == "F" and "." in form:
        width, _, digits = form[1:].partition(".")
        if width.isdigit() and digits.isdigit():
            places = min(int(digits), 20)
            return (
                f"{value:{min(int(width), 80)}.{places}f}" if int(width) else f"{value:.{places}f}"
            )
    if form[:1] == "I":
        width = form[1:]
        if width.isdigit() and int(width):
            return f"{whole(value):{min(int(width), 80)}d}"
        return f"{whole(value)}"
    return f" {value:.7g}" if not form else f"{value:.7g}"


def decode(text: str, delimiters: str, mode: float) -> tuple[str, str]:
    """Split a text like $DECODE. Returns the front and the rest.

    mode: up to 0 for the text before the first delimiter, above 0 for the delimiters at the front.
    """
    at = 0
    while at < len(text) and (text[at] in delimiters) == (mode > 0):
        at += 1
    return text[:at], text[at:]


def join(parts: Sequence[str]) -> str:
    """Concatenate strings, up to `LONGEST` characters."""
    return "".join(parts)[:LONGEST]
