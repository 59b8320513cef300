"""The short way of the PacScript read-back against its long one: both read the same from any text, to the last bit."""

from collections.abc import Callable
from unittest.mock import patch

import pytest
from camgen_posts.readback import pacscript
from camgen_posts.readback.pacscript import read
from camgen_posts.readback.pacscript import text as pacscript_text
from camgen_posts.readback.pacscript.machine import Machine
from camgen_posts.readback.pacscript.motion import LINE, PIECE, Plain
from hypothesis import given
from hypothesis import strategies as st

from camgen.model.program import Force, MoveC, MoveJ, MoveL
from tests.support.pacscript_ways import (
    BY_HAND,
    CALLED,
    LONG_S,
    MOVED,
    PARTS,
    PERCENT,
    SIGNED,
    TEXTS,
    check,
    printed,
    short_lines,
    the_long_way,
)


@pytest.mark.parametrize(("text", "options"), TEXTS)
def test_texts_as_they_are(text: str, options: dict[str, object]) -> None:
    reading = check({"a.pcs": text}, options)
    assert short_lines(text) > 4
    assert sum(isinstance(item, (MoveJ, MoveL, MoveC)) for item in reading.body) > 4


def test_the_pieces_are_the_whole_text() -> None:
    line = "Move L, P(1.0, 2.0, 3.0)"
    for text in [
        *(text for text, _ in TEXTS),
        "",
        "\n",
        "a",
        "\r\n\r\r\na\x0b\x85b",
        line,
        line + "\r",
        line + "\r\r\n",
    ]:
        pieces = [piece[0] for piece in PIECE.finditer(text)]
        assert "".join(pieces) == text
        assert (
            len(pieces)
            == len(LINE.findall(text))
            == text.count("\n") + (text != "" and text[-1] != "\n")
        )


def test_turns_on_the_spot_are_read_the_short_way() -> None:
    """Two at the start of each of the five pieces, of 1 and 0.5 rad/s, 11.4592 and 5.7296 % of 500 deg/s."""
    text = printed(5, {}, turning=True)
    assert text.count(", Speed = 11.4592\n") == text.count(", Speed = 5.7296\n") == 5
    turns = [
        item.turn
        for item in check({"a.pcs": text}, {}).body
        if isinstance(item, MoveL) and item.turn
    ]
    assert turns == pytest.approx([1.0, 0.5] * 5, abs=1e-5)
    assert all(
        match.lastindex
        for match in PIECE.finditer(text)
        if "Speed = 11" in match[0] or "Speed = 5." in match[0]
    )


@given(st.lists(st.from_regex(r"\A-?[0-9]{1,9}(\.[0-9]{1,9})?\Z"), min_size=6, max_size=6))
def test_numbers_to_the_last_bit(numbers: list[str]) -> None:
    one, two = ", ".join(numbers[:3]), ", ".join(numbers[3:])
    moves = f"Move P, P({one})\nMove L, @P P({one}, {two})\nMove C, P({two}), @0 P({two}, {one})\n"
    reading = check({"a.pcs": f"Sub Main\nTakeArm\n{moves}GiveArm\nEnd Sub\n"}, PERCENT)
    origins = [
        item.target.origin for item in reading.body if isinstance(item, (MoveJ, MoveL, MoveC))
    ]  # type: ignore[union-attr]
    assert origins == [tuple(map(float, numbers[k : k + 3])) for k in (0, 0, 3)]


def counted(calls: list[int]) -> Callable[[Machine, Plain], None]:
    whole = pacscript.carry_out

    def carry_out(machine: Machine, item: Plain) -> None:
        calls.append(item.line)
        whole(machine, item)

    return carry_out


@pytest.mark.parametrize(
    ("options", "open_"),
    [({}, True), (SIGNED, True), (CALLED, True), (MOVED, False), (LONG_S, False)],
)
def test_the_short_way_is_open_and_the_long_way_shuts_it(
    options: dict[str, object], open_: bool
) -> None:
    """Without this the comparison could hold the long way against itself. A template for motions shuts it, too."""
    calls: list[int] = []
    with patch(PARTS + "pacscript.carry_out", counted(calls)):
        read({"a.pcs": BY_HAND}, options)
        assert (len(calls) > 10) is open_
        calls.clear()
        with the_long_way():
            read({"a.pcs": BY_HAND}, options)
        assert calls == []
    assert pacscript_text.PIECE is PIECE


@pytest.mark.parametrize(
    ("template", "line"),
    [
        ("{n} {x} {y} {z}", "2 3.0 4.0 0"),
        ("{n}{x}{y}{z}", "-2+3.0 -4.0+0"),
        ("PRESS {n} {x} {y} {z}", "press 2 3.0 4.0 0"),
        (" * {n} {x} {y} {z}", "*2 3.0 4.0 0"),
        ("ſtop {n} {x} {y} {z}", "Stop 2 3.0 4.0 0"),
        ("Stop {n} {x} {y} {z}", "ſtop 2 3.0 4.0 0"),
        ("{n} {x} {y} {z}", "٢ 3.0 4.0 0"),
    ],
)
def test_lines_of_a_template_are_found_by_their_first_sign(template: str, line: str) -> None:
    text = BY_HAND.replace("    ForceCtrl True, 1\n", f"    {line}\n")
    assert text != BY_HAND
    reading = check({"a.pcs": text}, {"force_on": [template]})
    (force, _) = (item for item in reading.body if isinstance(item, Force))
    assert force.newtons == pytest.approx(5.0)
