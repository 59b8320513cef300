"""Nearly valid programs: G-code of others, and texts of the five languages that camgen writes."""

from __future__ import annotations

from functools import cache

from hypothesis import strategies as st

from bench.reliability.fuzzing.odd import edited, numbers, plain_numbers, rarely
from bench.reliability.mutations import LANGUAGES, list_tokens

# G-code as LinuxCNC takes it: words, parameters, expressions, flow of control.

_CODES = (
    *LANGUAGES["gcode"].words, "G33", "G38.2", "G5", "G5.1", "G5.2", "G5.3", "G10L2P1", "G10L20P2", "G52", "G68", "G73",
    "G76", "G82", "G84", "G85", "G86", "G87", "G88", "G89", "G92.1", "G92.2", "G92.3", "G43H1", "G43.1", "G41.1D6",
    "G42", "G61.1", "G64P0.1", "G96", "G97", "G18.1", "G30", "G28.1", "M48", "M50", "M60", "M61Q1", "M70", "M71", "M72",
    "M98P1", "M99", "M100", "M19", "G1.5", "G999", "G", "M-1", "G0.0", "T-1", "H2", "D1", "$0", "@5", "^30",
)  # fmt: skip
_LETTERS = "XYZIJKRABCPQFSLEUVWDHXYZXYZIJ"
_PARAMETERS = (
    "#1", "#2", "#<a>", "#<_g>", "#5221", "#5420", "#[1]", "#[#1]", "#0", "#31", "#99999", "#<_x>",
    "##1", "#-1",
)  # fmt: skip
_FUNCTIONS = (
    "sin", "cos", "tan", "sqrt", "abs", "round", "fix", "fup", "ln", "exp", "asin", "acos",
    "exists", "frob",
)  # fmt: skip
_OPERATORS = (
    "+", "-", "*", "/", "**", "mod", "and", "or", "xor", "eq", "ne", "lt", "gt", "le", "ge", "atan",
    "",
)  # fmt: skip


@st.composite
def _expression(draw: st.DrawFn, depth: int = 0) -> str:
    """A value: a number, a parameter, or brackets."""
    kind = draw(st.integers(0, 5 if depth < 2 else 2))
    if kind <= 1:
        return draw(numbers)
    if kind == 2:
        return draw(st.sampled_from(_PARAMETERS))
    if kind == 3:
        function = draw(st.sampled_from(_FUNCTIONS))
        inner = draw(_expression(depth + 1))
        return (
            f"atan[{inner}]/[{draw(plain_numbers)}]"
            if function == "frob" and draw(st.booleans())
            else f"{function}[{inner}]"
        )
    left, right = draw(_expression(depth + 1)), draw(_expression(depth + 1))
    return f"[{left} {draw(st.sampled_from(_OPERATORS))} {right}]"


@st.composite
def _block(draw: st.DrawFn) -> str:
    """A line of words: mostly a motion that runs, since nothing is read after what does not."""
    kind = draw(st.integers(0, 59))
    if kind >= 20:
        axes = draw(st.lists(st.sampled_from("XYZ"), min_size=1, max_size=3, unique=True))
        return " ".join(
            (
                draw(st.sampled_from(("G0", "G1", "G1", ""))),
                *(axis + draw(plain_numbers) for axis in axes),
            )
        )
    if kind <= 1:
        return f"{draw(st.sampled_from(_PARAMETERS))} = {draw(_expression())}"
    if kind == 2:
        return draw(st.sampled_from(
            ("(a comment)", "; x", "(debug, #1)", "(msg, x", "%", "/G1 X1", "", "N10", "N9999999 G1X0", "\xb5",
             "(print, %f#1)", "G1 X1 (a) Y2", "g1x1y2", "G 1 X 1 0", "G1X1Y1Z1A1", "G1 X1 X2", "G2 G3 X1", "M3 M4 M5")
        ))  # fmt: skip
    words = draw(st.lists(st.sampled_from(_CODES), max_size=2))
    if kind < 16:
        words = [draw(st.sampled_from(("G0", "G1", "G2", "G3", "G1", "G81", "G83", "")))]
    for letter in draw(st.lists(st.sampled_from(_LETTERS), max_size=4, unique=not draw(rarely))):
        words.append(letter + (draw(_expression()) if draw(rarely) else draw(numbers)))
    return draw(st.sampled_from((" ", " ", ""))).join(words)


_BLOCKS = st.lists(_block(), max_size=4)


@st.composite
def _flow(draw: st.DrawFn, depth: int = 0) -> list[str]:
    """Some blocks, at times in a loop, a condition or a subroutine."""
    kind = draw(st.integers(0, 8 if depth < 2 else 3)) if not draw(rarely) else 9
    inner = draw(_BLOCKS) if kind < 4 or depth > 1 else draw(_BLOCKS) + draw(_flow(depth + 1))
    odd = draw(rarely)
    number = (
        draw(st.sampled_from(("1", "", "-1", "[1+1]", "x")))
        if odd
        else f"<a{draw(st.integers(0, 99))}>"
    )
    condition = (
        draw(_expression()) if odd else draw(st.sampled_from(("1", "0", "#1", "3", "#1 lt 2")))
    )
    # A loop without an end is read until its bound, which takes seconds.
    step = [f"#1 = [#1 + {draw(plain_numbers) if odd and draw(rarely) else '1'}]"]
    return {
        4: [f"o{number} repeat [{draw(numbers) if odd else 3}]", *inner, f"o{number} endrepeat"],
        5: [
            "#1 = 0",
            f"o{number} while [#1 lt [{condition}]]",
            *inner,
            *step,
            f"o{number} endwhile",
        ],
        6: [
            f"o{number} if [{condition}]",
            *inner,
            f"o{number} else",
            *inner[:1],
            f"o{number} endif",
        ],
        7: [
            f"o{number} sub",
            *inner,
            f"o{number} return [{condition}]",
            f"o{number} endsub",
            f"o{number} call [{condition}]",
        ],
        8: [f"o{number} do", *inner, *step, f"o{number} break", f"o{number} while [{condition}]"],
        9: [
            *inner,
            f"o{number} {draw(st.sampled_from(('call', 'endsub', 'continue', 'break', 'elseif [1]', 'sub', 'x')))}",
        ],
    }.get(kind, inner)


@st.composite
def gcode(draw: st.DrawFn) -> bytes:
    """A program."""
    head = "G21 G90 G17 G94 F100 S1000 G0 X0"
    lines = [head[: draw(st.integers(0, len(head)))] if draw(rarely) else head]
    for _ in range(draw(st.integers(1, 4))):
        lines += draw(_flow())
    lines += draw(st.sampled_from((["G1 X1 Y1", "M2"], ["M2"], ["M30"], ["%"], [])))
    if draw(rarely):
        del lines[draw(st.integers(0, len(lines) - 1))]
    return "\n".join(lines).encode("latin-1", "replace")


# The languages of the posts: programs that camgen wrote, with changes, and lines of them among words of the language.


@cache
def _texts(post: str) -> tuple[str, ...]:
    from bench.reliability.programs import SOURCES, make  # noqa: PLC0415 (it posts a program each)

    return tuple(make(post, k).text for k in range(len(SOURCES[post])))


@cache
def _lines(post: str) -> tuple[str, ...]:
    return tuple(dict.fromkeys(line for text in _texts(post) for line in text.splitlines()))


@cache
def _words(post: str) -> tuple[str, ...]:
    """Of the language, and those that stand in the programs."""
    found = dict.fromkeys(LANGUAGES[post].words)
    for line in _lines(post):
        found |= dict.fromkeys(
            one.text
            for one in list_tokens(line, LANGUAGES[post])
            if one.kind in ("word", "sign", "text")
        )
    return tuple(found)


@st.composite
def _statement(draw: st.DrawFn, post: str) -> str:
    """A line of a program with changes, or any words."""
    if draw(st.integers(0, 2)):
        return draw(edited(_lines(post), _words(post), 3))
    some = st.lists(st.sampled_from(_words(post)) | numbers, max_size=6)
    return draw(st.sampled_from((" ", " ", "", ", "))).join(draw(some))


@st.composite
def _soup(draw: st.DrawFn, post: str) -> str:
    """Statements in the place of some lines of a program."""
    lines = draw(st.sampled_from(_texts(post))).splitlines()
    at = draw(st.integers(0, len(lines)))
    lines[at : at + draw(st.integers(0, 6))] = draw(
        st.lists(_statement(post), min_size=1, max_size=4)
    )
    return "\n".join(lines) + "\n"


def program(post: str) -> st.SearchStrategy[bytes]:
    """A text for the read-back of ``post``."""
    made = st.deferred(lambda: st.one_of(edited(_texts(post), _words(post), 6), _soup(post)))
    return made.map(lambda text: text.encode("latin-1", "replace"))
