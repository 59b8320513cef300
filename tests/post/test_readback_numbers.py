"""Numbers by column are what ``float`` makes of them, to the last bit, and those that its pattern has."""

import re

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from camgen.lang.gcode.strict_runs import DECIMAL, MOTION, REMARK, Lines, cut

usual = st.builds("{}{}{}".format, st.sampled_from(["", "-"]), st.from_regex(r"\A[0-9]{1,6}\Z"),
                  st.from_regex(r"\A(\.[0-9]{1,8})?\Z"))  # fmt: skip
odd = st.one_of(
    st.text("0123456789.-", max_size=18), st.text("0 9.-+eE_\u0663\u00e9/:", max_size=6)
)


@given(st.lists(st.one_of(usual, odd), min_size=1, max_size=12))
def test_numbers_are_what_float_says(texts: list[str]) -> None:
    """A line that asks for more than numbers leaves the others to be read one by one."""
    for rows in (texts, *([text] for text in texts)):
        chunk = cut(Lines(["".join(f"G1 X{text}\n" for text in rows)]), 0, lambda *_: None)
        usual_spelling = all(re.fullmatch(DECIMAL, text) for text in rows)
        assert chunk.is_motion.tolist() == [usual_spelling] * len(rows)
        if usual_spelling:
            values = [value.hex() for value in chunk.words[:, 0].tolist()]
            assert values == [float(text).hex() for text in rows]


WORDS = re.compile(rf"[A-Z]{DECIMAL}(?: [A-Z]{DECIMAL})*")
words = st.builds("{}{}".format, st.sampled_from("XYZIJFXYZGM"), st.one_of(usual, usual, odd))
rows = st.one_of(
    st.builds("{} {}".format, st.sampled_from(["G0", "G1", "G3", "G4", "g1", "G01", "X1"]),
              st.lists(words, max_size=4).map(sorted).map(" ".join)),
    st.builds("G{} X{} Y{} F{}".format, st.integers(0, 3), usual, usual, usual),
    st.builds("G1 X1 {}Y2".format, st.sampled_from([" ", "\t", "\r", "", "Z"])),
    st.builds("({})".format, st.text("ab (,)%\x00\u00e9\r=", max_size=6)),
    st.builds("({})".format, st.sampled_from(["a" * 68, "a" * 69, "a" * 70])),
    st.builds("G1 X{}".format, st.sampled_from(["0" * 64, "1" * 65, "1.5 " * 16])),
    st.sampled_from(["", " ", "G0", "G1 ", "M64 P0", "M65 P63", "M64 P123", "M64 P", "M63 P1", "(", ")", "()"]),
)  # fmt: skip


@given(st.lists(rows, min_size=1, max_size=12))
def test_lines_are_those_of_the_patterns(texts: list[str]) -> None:
    check_lines(texts)
    for text in texts:
        check_lines([text])


def check_lines(texts: list[str]) -> None:
    """The motions are left to the reader of single lines if one line has more than numbers."""
    said: list[tuple[str, str]] = []
    chunk = cut(Lines(["\n".join(texts) + "\n"]), 0, lambda *one: said.append(one))
    by_column = all(WORDS.fullmatch(text) for text in texts if text[:1] == "G" and len(text) <= 70)
    moves = [by_column and re.fullmatch(MOTION, text) is not None for text in texts]
    assert chunk.is_motion.tolist() == moves
    # An output that the machine has not is another line.
    read = [move or re.fullmatch(REMARK, text) for move, text in zip(moves, texts, strict=True)]
    assert chunk.is_other.tolist() == [not row for row in read]
    assert set(said) == {
        (one[1], one[2]) for text in texts if (one := re.fullmatch("M6([45]) P([0-9]{1,2})", text))
    }
    for row, text in enumerate(texts):
        if moves[row] and (found := re.fullmatch(MOTION, text)):
            expected = [float(word) if word else np.nan for word in found.groups()[1:]]
            np.testing.assert_array_equal(chunk.words[row], expected)
            assert chunk.digit[row] == int(found[1])
