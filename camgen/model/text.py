"""Numbers and names as text: the one float formatter, numbers with their nouns, the cleaner for text from a file."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

#: What may stand in a comment of any dialect: no bracket, quote, semicolon, percent sign, comma (LinuxCNC's active
#: comments are ``(MSG,..)``), nor GRBL's real-time characters ``! ~ ?``.
_UNSAFE = re.compile(r"[^A-Za-z0-9 _.+\-=/:#@*]")

#: Three times as fast as a format whose digits are worked out again for every number.
_FORMS = tuple(f"%.{decimals}f" for decimals in range(18))
_THREE = tuple(",".join([form] * 3) for form in _FORMS)


def fixed(value: float, decimals: int) -> str:
    """``value`` with exactly ``decimals`` digits, never ``-0``, never an exponent.

    >>> fixed(-0.0004, 3), fixed(12.5, 3)
    ('0.000', '12.500')
    """
    text = _FORMS[decimals] % value
    if text[0] == "-" and not text.strip("-0."):
        return text[1:]
    return text


def fixed_each(values: tuple[float, float, float], decimals: int) -> str:
    """Three numbers as ``fixed`` prints them, with commas between them: twice as fast as one by one.

    >>> fixed_each((-0.0004, 12.5, -3.0), 3)
    '0.000,12.500,-3.000'
    """
    text = _THREE[decimals] % values
    if "-0" in text:
        return ",".join(fixed(value, decimals) for value in values)
    return text


def short(value: float, decimals: int) -> str:
    """``value`` rounded to ``decimals`` digits without trailing zeros, never ``-0``.

    >>> short(12.50, 3), short(-0.0001, 3), short(100.0, 0)
    ('12.5', '0', '100')
    """
    text = _FORMS[decimals] % value
    if decimals:
        text = text.rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def harmless(text: str, limit: int = 72) -> str:
    """``text`` as ASCII that can neither end a comment nor start an instruction in any dialect.

    >>> harmless("holes) M3 (x")
    'holes_ M3 _x'
    """
    return _UNSAFE.sub("_", text)[:limit].rstrip()


def escape(text: str) -> str:
    """Any text as that of an XML element. What the library has for it loads all that the web needs.

    >>> escape("a < b & c")
    'a &lt; b &amp; c'
    """
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def counted(number: int, one: str, many: str = "") -> str:
    """A number and its noun; what else depends on the number, such as the verb, goes with the noun.

    >>> counted(1, "hole"), counted(1200, "hole"), counted(2, "edge is", "edges are")
    ('1 hole', '1 200 holes', '2 edges are')
    """
    return f"{grouped(number)} {one if number == 1 else many or one + 's'}"


def grouped(number: int) -> str:
    """A whole number in groups of three digits.

    >>> grouped(12345)
    '12 345'
    """
    return f"{number:,}".replace(",", " ")


#: Names of which none is near are listed, so many at most.
_LISTED = 12


def suggest(word: str, names: Iterable[str]) -> str:
    """What may have been meant by ``word``, as a remedy: the nearest of ``names``, or all of them where none is near.

    >>> suggest("HOLE", ["Outline", "Holes"]), suggest("kuka", ["gcode", "rapid"])
    ('nearest is Holes', 'one of gcode, rapid')
    """
    import difflib  # noqa: PLC0415 (2 ms, only for what is wrong)

    folded: dict[str, str] = {}
    for name in names:
        folded.setdefault(name.casefold(), name)
    near = difflib.get_close_matches(word.casefold(), folded, 1)
    if near:
        return f"nearest is {folded[near[0]]}"
    more = ", ..." if len(folded) > _LISTED else ""
    return f"one of {', '.join(list(folded.values())[:_LISTED])}{more}" if folded else ""


def name_first(ids: Sequence[str]) -> str:
    """The first eight of ``ids``.

    >>> name_first(["c1", "c2"])
    'c1, c2'
    """
    return ", ".join(ids[:8]) + (" ..." if len(ids) > 8 else "")


def name_ranges(ids: list[str]) -> list[str]:
    """``c1, c2, c3, c7`` as ``c1-c3, c7``; ids of another form stay as they are."""
    runs: list[list[str]] = []
    for name in ids:
        follows = runs and name[1:].isdigit() and runs[-1][-1] == f"c{int(name[1:]) - 1}"
        if follows:
            runs[-1].append(name)
        else:
            runs.append([name])
    return [run[0] if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in runs]


def duration(seconds: float) -> str:
    """A duration for people."""
    if seconds < 10:
        return f"{seconds:.1f} s"
    whole = round(seconds)
    minutes, rest = divmod(whole, 60)
    hours, left = divmod(minutes, 60)
    if hours:
        return f"{hours} h {left:02d} min"
    return f"{minutes} min {rest:02d} s" if minutes else f"{whole} s"
