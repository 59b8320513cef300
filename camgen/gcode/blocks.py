"""O-words: which line opens what, and where it ends. Found once, before anything runs."""

from __future__ import annotations

import re
from collections.abc import Sequence

from msgspec import Struct, field

from camgen.gcode.words import bare
from camgen.gcode.wrong import Wrong

_START = re.compile(r"[ \t]*/?[ \t]*(?:[nN][ \t]*[0-9.]+)?[ \t]*[oO]")
_OWORD = re.compile(
    r"o(?:<([^<>]*)>|([0-9]+))"
    r"(sub|endsub|call|return|if|elseif|else|endif|while|endwhile|do|repeat|endrepeat|break|continue)?(.*)"
)
#: What closes, or goes on with, what.
_CLOSES = {"endsub": "sub", "endif": "if", "endwhile": "while", "endrepeat": "repeat"}


class Block(Struct):
    """One O-word. word: what it does. rest: the text after it. places: lines (from 0) of the parts of its structure,
    first to last: sub and endsub; if, elseif, else, endif; while and endwhile; do and while; repeat and endrepeat.
    """

    label: str
    word: str
    rest: str
    places: list[int] = field(default_factory=list)


class Blocks(Struct):
    """at: the O-words by line, from 0. subs: the line of each sub by its label."""

    at: dict[int, Block]
    subs: dict[str, int]


def blocks(lines: Sequence[str]) -> Blocks:
    """The O-words of a program. Raises Wrong with ``line`` (1-based) in its arguments."""
    found = Blocks({}, {})
    opened: list[Block] = []
    for number, raw in enumerate(lines):
        if ("o" in raw or "O" in raw) and _START.match(raw):
            try:
                _enter(found, opened, number, raw)
            except Wrong as wrong:
                raise Wrong(str(wrong), number + 1) from wrong
    if opened:
        block = opened[-1]
        raise Wrong(f"o{block.label} {block.word} has no end", block.places[0] + 1)
    return found


def _enter(found: Blocks, opened: list[Block], number: int, raw: str) -> None:
    text = bare(raw)
    match = _OWORD.fullmatch(text)
    if not match:
        raise Wrong(f"cannot read the O-word {text[:16]!r}")
    name, digits, word, rest = match.groups()
    block = Block(f"<{name}>" if name is not None else str(int(digits)), word or "", rest)
    found.at[number] = block
    top = opened[-1] if opened else None
    if word == "while" and top and top.word == "do" and top.label == block.label:
        block.places = top.places
        block.word = "until"
        block.places.append(number)
        opened.pop()
    elif word in ("sub", "if", "while", "do", "repeat"):
        block.places = [number]
        opened.append(block)
        if word == "sub":
            if block.label in found.subs:
                raise Wrong(f"o{block.label} sub is there twice")
            found.subs[block.label] = number
    elif word in ("elseif", "else") or word in _CLOSES:
        _go_on(opened, block, number, _CLOSES.get(word, "if"))
    elif word in ("break", "continue"):
        loop = [b for b in opened if b.label == block.label and b.word in ("while", "do", "repeat")]
        if not loop:
            raise Wrong(f"o{block.label} {word} stands in no such loop")
        block.places = loop[-1].places


def _go_on(opened: list[Block], block: Block, number: int, opener: str) -> None:
    top = opened[-1] if opened else None
    if top is None or top.word != opener or top.label not in (block.label, ""):
        inside = f"; o{top.label} {top.word} is open" if top else ""
        raise Wrong(f"o{block.label} {block.word} has no {opener} before it{inside}")
    block.places = top.places
    block.places.append(number)
    if block.word in _CLOSES:
        opened.pop()
