"""Nearly valid programs: third-party G-code, and texts of the five languages that camgen writes."""

from __future__ import annotations

from functools import cache

from hypothesis import strategies as st

from bench.reliability.fuzzing.odd import change_text, numbers, plain_numbers, rarely, split_words
from bench.reliability.mutations import LANGUAGES, list_tokens
from bench.reliability.programs import SOURCES, make

# G-code as LinuxCNC takes it: words, parameters, expressions, flow of control.

_CODES = (
    *LANGUAGES["gcode"].words,
    *split_words(
        "G33 G38.2 G5 G5.1 G5.2 G5.3 G10L2P1 G10L20P2 G52 G68 G73 G76 G82 G84 G85 G86 G87"
    ),
    *split_words(
        "G88 G89 G92.1 G92.2 G92.3 G43H1 G43.1 G41.1D6 G42 G61.1 G64P0.1 G96 G97 G18.1 G30"
    ),
    *split_words(
        "G28.1 M48 M50 M60 M61Q1 M70 M71 M72 M98P1 M99 M100 M19 G1.5 G999 G M-1 G0.0 T-1 H2"
    ),
    *split_words("D1 $0 @5 ^30"),
)
_LETTERS = "XYZIJKRABCPQFSLEUVWDHXYZXYZIJ"
_PARAMETERS = split_words("#1 #2 #<a> #<_g> #5221 #5420 #[1] #[#1] #0 #31 #99999 #<_x> ##1 #-1")
_FUNCTIONS = split_words("sin cos tan sqrt abs round fix fup ln exp asin acos exists frob")
_OPERATORS = split_words("+ - * / ** mod and or xor eq ne lt gt le ge atan")
#: Lines of comments, marks and words that exclude each other.
_LINES = (
    *("(a comment)", "; x", "(debug, #1)", "(msg, x", "%", "/G1 X1", "", "N10", "N9999999 G1X0"),
    *("\xb5", "(print, %f#1)", "G1 X1 (a) Y2", "g1x1y2", "G 1 X 1 0", "G1X1Y1Z1A1", "G1 X1 X2"),
    *("G2 G3 X1", "M3 M4 M5"),
)


@st.composite
def _expression(draw: st.DrawFn, depth: int = 0) -> str:
    """A number, a parameter, a function or an operation in brackets."""
    kind = draw(st.integers(0, 5 if depth < 2 else 2))
    if kind <= 1:
        return draw(numbers)
    if kind == 2:
        return draw(st.sampled_from(_PARAMETERS))
    left = draw(_expression(depth + 1))
    if kind == 3:
        function = draw(st.sampled_from([*_FUNCTIONS, "atan"]))
        divisor = f"/[{draw(plain_numbers)}]" if function == "atan" else ""
        return f"{function}[{left}]{divisor}"
    return f"[{left} {draw(st.sampled_from(_OPERATORS))} {draw(_expression(depth + 1))}]"


@st.composite
def _block(draw: st.DrawFn) -> str:
    """A line of words: mostly a motion that runs, since nothing is read after a line that fails."""
    kind = draw(st.integers(0, 59))
    if kind >= 20:
        axes = draw(st.lists(st.sampled_from("XYZ"), min_size=1, max_size=3, unique=True))
        words = [draw(st.sampled_from(("G0", "G1", "G1", "")))]
        words += [axis + draw(plain_numbers) for axis in axes]
        return " ".join(words)
    if kind <= 1:
        return f"{draw(st.sampled_from(_PARAMETERS))} = {draw(_expression())}"
    if kind == 2:
        return draw(st.sampled_from(_LINES))
    words = draw(st.lists(st.sampled_from(_CODES), max_size=2))
    if kind < 16:
        words = [draw(st.sampled_from(("G0", "G1", "G2", "G3", "G1", "G81", "G83", "")))]
    for letter in draw(st.lists(st.sampled_from(_LETTERS), max_size=4, unique=not draw(rarely))):
        words.append(letter + draw(_expression() if draw(rarely) else numbers))
    return draw(st.sampled_from((" ", " ", ""))).join(words)


#: Lines before and after the lines of a loop, a condition or a subroutine. `o` is its number, `c`
#: a condition, and `step` counts.
_FLOWS = (
    ("o{o} repeat [3]", "o{o} endrepeat"),
    ("o{o} repeat [{c}]", "o{o} endrepeat"),
    ("#1 = 0\no{o} while [#1 lt [{c}]]", "{step}\no{o} endwhile"),
    ("o{o} if [{c}]", "o{o} else\nG1 X1\no{o} endif"),
    ("o{o} sub", "o{o} return [{c}]\no{o} endsub\no{o} call [{c}]"),
    ("o{o} do", "{step}\no{o} break\no{o} while [{c}]"),
    *(
        ("", f"o{{o}} {word}")
        for word in ("call", "endsub", "continue", "break", "elseif [1]", "sub", "x")
    ),
)


@st.composite
def _flow(draw: st.DrawFn, depth: int = 0) -> list[str]:
    """Some blocks, at times in a loop, a condition or a subroutine."""
    lines = draw(st.lists(_block(), max_size=4))
    if depth > 1 or draw(st.integers(0, 8)) < 4:
        return lines
    lines += draw(_flow(depth + 1))
    number, step = f"<a{draw(st.integers(0, 99))}>", "1"
    if draw(rarely):
        number = draw(st.sampled_from(("1", "", "-1", "[1+1]", "x")))
        condition = draw(_expression())
        # A loop without an end is read until its bound, which takes seconds.
        step = draw(plain_numbers) if draw(rarely) else "1"
    else:
        condition = draw(st.sampled_from(("1", "0", "#1", "3", "#1 lt 2")))
    values = {"o": number, "c": condition, "step": f"#1 = [#1 + {step}]"}
    before, after = draw(st.sampled_from(_FLOWS))
    return [before.format(**values), *lines, *after.format(**values).split("\n")]


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


# The languages of the posts: programs that camgen wrote, with changed tokens and lines.


@cache
def _list_texts(post: str) -> tuple[str, ...]:
    return tuple(make(post, number).text for number in range(len(SOURCES[post])))


@cache
def _list_words(post: str) -> tuple[str, ...]:
    """Words of the language, and those of the programs."""
    words = dict.fromkeys(LANGUAGES[post].words)
    for text in _list_texts(post):
        for token in list_tokens(text, LANGUAGES[post]):
            if token.kind in ("word", "sign", "text"):
                words[token.text] = None
    return tuple(words)


@st.composite
def _statement(draw: st.DrawFn, post: str, lines: list[str]) -> str:
    """A line of a program with changes, or any words."""
    words = _list_words(post)
    if draw(st.integers(0, 2)):
        return draw(change_text(lines, words, 3))
    chosen = draw(st.lists(st.sampled_from(words) | numbers, max_size=6))
    return draw(st.sampled_from((" ", " ", "", ", "))).join(chosen)


@st.composite
def program(draw: st.DrawFn, post: str) -> bytes:
    """A text for the read-back of a post: changed tokens, or other statements for some lines."""
    if draw(st.booleans()):
        text = draw(change_text(_list_texts(post), _list_words(post), 6))
        return text.encode("latin-1", "replace")
    lines = draw(st.sampled_from(_list_texts(post))).splitlines()
    place = draw(st.integers(0, len(lines)))
    statements = st.lists(_statement(post, lines), min_size=1, max_size=4)
    lines[place : place + draw(st.integers(0, 6))] = draw(statements)
    return ("\n".join(lines) + "\n").encode("latin-1", "replace")
