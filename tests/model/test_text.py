"""Numbers and names as text."""

import math
import re
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.model.text import counted, fixed, harmless, short

NUMBERS = st.floats(-1e9, 1e9) | st.sampled_from([0.0, -0.0, -1e-12, 5e-324, -5e-324])


@given(NUMBERS, st.integers(0, 9))
def test_fixed_is_the_nearest_number_with_its_digits(value, decimals):
    text = fixed(value, decimals)
    assert re.fullmatch(r"-?\d+" + (rf"\.\d{{{decimals}}}" if decimals else ""), text)
    assert not re.fullmatch(r"-0(\.0*)?", text)
    assert abs(Decimal(text) - Decimal(value)) <= Decimal(5).scaleb(-decimals - 1)


@given(NUMBERS, st.integers(0, 9))
def test_short_is_fixed_without_trailing_zeros(value, decimals):
    text = short(value, decimals)
    assert Decimal(text) == Decimal(fixed(value, decimals))
    assert re.fullmatch(r"-?\d+(\.\d*[1-9])?", text)
    assert text != "-0"


@pytest.mark.parametrize(
    ("value", "text"), [(100.0, "100"), (0.5, "0"), (1.5, "2"), (-0.4, "0"), (-0.6, "-1")]
)
def test_short_keeps_the_zeros_of_whole_numbers(value, text):
    assert short(value, 0) == text


def test_a_number_that_is_not_finite_has_no_digits():
    assert not re.search(r"\d", fixed(math.nan, 3) + fixed(math.inf, 3))


@given(st.text(max_size=200), st.integers(1, 100))
def test_a_harmless_text_has_no_character_that_a_dialect_acts_on(text, limit):
    cleaned = harmless(text, limit)
    assert cleaned.isascii()
    assert len(cleaned) <= limit
    assert set(cleaned).isdisjoint("()[]{}<>\"'`;%,!~?&$\\|^\n\r\t\x00\x18")
    assert harmless(cleaned, limit) == cleaned


def test_a_harmless_text_keeps_the_characters_of_names():
    name = "Layer_2 cut-out 3.5 +x a/b c:d #1 @2 *3 =4"
    assert harmless(name) == name


def test_a_number_and_its_noun_agree() -> None:
    assert [counted(n, "path") for n in (1, 0, 2, 12345)] == [
        "1 path",
        "0 paths",
        "2 paths",
        "12 345 paths",
    ]
    assert [counted(n, "stretch", "stretches") for n in (1, 2)] == ["1 stretch", "2 stretches"]
    assert [counted(n, "edge is", "edges are") for n in (1, 2)] == ["1 edge is", "2 edges are"]
