"""Formats numbers and names as text: floats, numbers with their nouns, and text from files."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

#: Characters that a comment cannot have in every dialect: brackets, quotes, semicolons, percent
#: signs, commas (LinuxCNC runs comments such as `(MSG,..)`) and the real-time characters ! ~ ? of
#: GRBL.
_UNSAFE = re.compile(r"[^A-Za-z0-9 _.+\-=/:#@*]")

#: Formats by decimals. They are three times as fast as a format with a variable number of digits.
_FORMS = tuple(f"%.{decimals}f" for decimals in range(18))
_TRIPLE_FORMS = tuple(",".join([form] * 3) for form in _FORMS)


def fixed(value: float, decimals: int) -> str:
    """`value` with exactly `decimals` digits, never -0, never an exponent.

    >>> fixed(-0.0004, 3), fixed(12.5, 3)
    ('0.000', '12.500')
    """
    text = _FORMS[decimals] % value
    if text[0] == "-" and not text.strip("-0."):
        return text[1:]
    return text


def fixed_each(values: tuple[float, float, float], decimals: int) -> str:
    """Three numbers as by `fixed`, joined by commas: twice as fast as one by one.

    >>> fixed_each((-0.0004, 12.5, -3.0), 3)
    '0.000,12.500,-3.000'
    """
    text = _TRIPLE_FORMS[decimals] % values
    if "-0" in text:
        return ",".join(fixed(value, decimals) for value in values)
    return text


def short(value: float, decimals: int) -> str:
    """`value` rounded to `decimals` digits without trailing zeros, never -0.

    >>> short(12.50, 3), short(-0.0001, 3), short(100.0, 0)
    ('12.5', '0', '100')
    """
    text = _FORMS[decimals] % value
    if decimals:
        text = text.rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def short_each(values: Iterable[float], decimals: int) -> list[str]:
    """Numbers as by `short`.

    >>> " ".join(short_each((1.50, -0.0001), 2))
    '1.5 0'
    """
    return [short(value, decimals) for value in values]


def join_short(values: Iterable[float], decimals: int) -> str:
    """Numbers as by `short`, with blanks between them.

    >>> join_short((12.50, -0.0001, 3.0), 3)
    '12.5 0 3'
    """
    return " ".join([short(value, decimals) for value in values])


def harmless(text: str, limit: int = 72) -> str:
    """`text` as ASCII that can neither end a comment nor start an instruction in any dialect.

    >>> harmless("holes) M3 (x")
    'holes_ M3 _x'
    """
    return _UNSAFE.sub("_", text)[:limit].rstrip()


def escape(text: str) -> str:
    """`text` for an XML element. The function of the standard library loads all web modules.

    >>> escape("a < b & c")
    'a &lt; b &amp; c'
    """
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def counted(number: int, singular: str, plural: str = "") -> str:
    """A number and its noun. Other words that depend on the number, such as a verb, are part of it.

    >>> counted(1, "hole"), counted(1200, "hole"), counted(2, "edge is", "edges are")
    ('1 hole', '1 200 holes', '2 edges are')
    """
    noun = singular if number == 1 else plural or singular + "s"
    return f"{grouped(number)} {noun}"


def grouped(number: int) -> str:
    """A whole number in groups of three digits.

    >>> grouped(12345)
    '12 345'
    """
    return f"{number:,}".replace(",", " ")


#: Names that are listed if none is similar, at most.
_LISTED = 12


def suggest(word: str, names: Iterable[str]) -> str:
    """A remedy for the unknown name `word`: the nearest of `names`, or the first 12 of them.

    "" without names.

    >>> suggest("HOLE", ["Outline", "Holes"]), suggest("kuka", ["gcode", "rapid"])
    ('nearest is Holes', 'one of gcode, rapid')
    """
    import difflib  # noqa: PLC0415 (2 ms, only for an unknown name)

    folded: dict[str, str] = {}
    for name in names:
        folded.setdefault(name.casefold(), name)
    near = difflib.get_close_matches(word.casefold(), folded, 1)
    if near:
        return f"nearest is {folded[near[0]]}"
    more = ", ..." if len(folded) > _LISTED else ""
    return f"one of {', '.join(list(folded.values())[:_LISTED])}{more}" if folded else ""


def name_first(ids: Sequence[str]) -> str:
    """The first eight of `ids`, joined by commas.

    >>> name_first(["c1", "c2"])
    'c1, c2'
    """
    return ", ".join(ids[:8]) + (" ..." if len(ids) > 8 else "")


def name_ranges(ids: Iterable[str]) -> list[str]:
    """`ids` with ranges in place of consecutive ones: c1, c2, c3, c7 becomes c1-c3, c7.

    Ids of another form stay as they are.
    """
    runs: list[list[str]] = []
    for name in ids:
        if runs and name[1:].isdigit() and runs[-1][-1] == f"c{int(name[1:]) - 1}":
            runs[-1].append(name)
        else:
            runs.append([name])
    return [run[0] if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in runs]


def duration(seconds: float) -> str:
    """A duration as text, with the precision that a user needs: s, min and s, or h and min."""
    if seconds < 10:
        return f"{seconds:.1f} s"
    whole_seconds = round(seconds)
    whole_minutes, second = divmod(whole_seconds, 60)
    hours, minute = divmod(whole_minutes, 60)
    if hours:
        return f"{hours} h {minute:02d} min"
    return f"{whole_minutes} min {second:02d} s" if whole_minutes else f"{whole_seconds} s"
