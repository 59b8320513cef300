"""G-code: the fast path by column finds the words of the reader of single lines, bit by bit."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.lang.gcode.columns import Chunk, cut
from camgen.lang.gcode.strict import REMARK
from camgen.lang.gcode.words import LineError, Parameters, bare, words_of
from camgen.model.program import Output

LETTERS = "NGXYZIJF"
#: A motion that has to be read by column: a code and words in their order, with short numbers.
USUAL = re.compile(
    r"(?:N[0-9]{1,5} )?G[0-3]"
    + "".join(rf"(?: {letter}-?[0-9]{{1,6}}(?:\.[0-9]{{1,8}})?)?" for letter in "XYZIJ")
    + r"(?: F[0-9]{1,6}(?:\.[0-9]{1,8})?)?"
)

usual = st.builds(
    "{}{}{}".format,
    st.sampled_from(["", "-"]),
    st.from_regex(r"\A[0-9]{1,6}\Z"),
    st.from_regex(r"\A(\.[0-9]{1,8})?\Z"),
)
odd = st.one_of(
    st.text("0123456789.-", max_size=18), st.text("0 9.-+eE_\u0663\u00e9/:", max_size=6)
)
words = st.builds("{}{}".format, st.sampled_from("XYZIJFXYZGMn"), st.one_of(usual, usual, odd))
rows = st.one_of(
    st.builds(
        "{} {}".format,
        st.sampled_from(["G0", "G1", "G3", "G4", "g1", "G01", "X1", "N5G2"]),
        st.lists(words, max_size=4).map(sorted).map(" ".join),
    ),
    st.builds("G{} X{} Y{} F{}".format, st.integers(0, 3), usual, usual, usual),
    st.builds("G{}X{}Y{}".format, st.integers(0, 4), usual, odd),
    st.builds("G1 X1 {}Y2".format, st.sampled_from([" ", "\t", "\r", "", "Z"])),
    st.builds("({})".format, st.text("ab (,)%\x00\u00e9\r=", max_size=6)),
    st.builds("G1 X{}".format, st.sampled_from(["0" * 64, "1" * 65, "1.5 " * 16])),
    st.sampled_from(
        ["", " ", "G0", "G1 ", "G1 X1\r", "M64 P0", "M63 P1", "(", ")", "()", "5 X1", "G1 X1 (a)"]
    ),
)


def read_line(text: str) -> dict[str, float] | None:
    """The words of one line with its number as N and its code as G, None for other lines."""
    number = re.match("[ \t]*[nN][ \t]*([0-9 \t]+[0-9. \t]*)", text)
    try:
        codes, words = words_of(bare(text), Parameters(lambda _: None))
    except LineError:
        return None
    if codes:
        if codes.keys() != {"motion"} or codes["motion"] not in ("G0", "G1", "G2", "G3"):
            return None
        words["G"] = float(codes["motion"][1:])
    if number:
        words["N"] = float(number[1].replace(" ", "").replace("\t", ""))
    return words


def check_lines(texts: list[str]) -> Chunk:
    chunk = cut(texts, 0, lambda text: Output(text, 1.0) if text.startswith("M64") else None)
    for row, text in enumerate(texts):
        words_of_line = read_line(text)
        if chunk.is_motion[row]:
            assert words_of_line is not None
            columns = zip(LETTERS, chunk.words[row].tolist(), strict=True)
            read = {letter: value.hex() for letter, value in columns if not np.isnan(value)}
            assert read == {letter: value.hex() for letter, value in words_of_line.items()}
            assert row not in chunk.others
        elif USUAL.fullmatch(text) and len(text) <= 70:
            # A line in the usual spelling is left to the other reader if it has no target.
            line = words_of_line or {}
            assert not line.keys() & set("XYZ") or line.get("F", 0.0) >= 1e6
        elif not chunk.outputs.get(row):
            assert (row in chunk.others) == bool(text)
    return chunk


@given(st.lists(rows, min_size=1, max_size=12))
def test_a_line_has_the_words_of_the_other_reader(texts: list[str]) -> None:
    together = check_lines(texts)
    for row, text in enumerate(texts):
        # Neighbouring lines change nothing.
        assert check_lines([text]).is_motion[0] == together.is_motion[row]


@given(st.lists(st.one_of(usual, odd), min_size=1, max_size=12))
def test_a_number_is_the_one_of_float(texts: list[str]) -> None:
    chunk = check_lines([f"G1 X{text}" for text in texts])
    for row, text in enumerate(texts):
        if re.fullmatch(r"-?[0-9]{1,6}(\.[0-9]{1,8})?", text):
            assert chunk.words[row, 2].hex() == float(text).hex()


def test_outputs_are_found() -> None:
    assert dict(check_lines(["G1 X1", "M64 P0", "M63 P1"]).outputs) == {1: Output("M64 P0", 1.0)}


@pytest.mark.parametrize("line", ["G1 X1 (a)", "G1X1;a", "x1 (a b)", "N1 G1 X1 ; a"])
def test_a_comment_after_a_motion_has_no_effect(line: str) -> None:
    assert cut([line], 0, None).is_motion[0]
    assert not cut([line], 0, lambda _: None).is_motion[0]


@pytest.mark.parametrize("line", ["G1 X1 (a,b)", "G1 X1 ; py,1", "G1 X1 (a", "(a) (b)"])
def test_an_unusual_comment_is_left_to_the_other_reader(line: str) -> None:
    assert not cut([line], 0, None).is_motion[0]


def test_a_comment_of_a_post_is_short_and_inactive() -> None:
    """It has neither a comma nor a character that a controller may act on."""
    for comment, is_usual in (("(path c1 layer 0)", True), ("(x,y)", False), ("(a!)", False)):
        assert (REMARK.fullmatch(comment) is not None) == is_usual
    lengths = [REMARK.fullmatch(f"({'a' * length})") is not None for length in (68, 69, 70)]
    assert lengths == [True, True, False]
