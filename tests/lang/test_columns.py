"""The fast path cuts lines in the usual spelling out of a text and decodes them by column."""

import re
from collections import Counter
from itertools import chain

from hypothesis import given
from hypothesis import strategies as st

from camgen.lang import columns
from camgen.lang.columns import Run, Template, find_distinct, read_numbers
from tests.support.fast_paths import patched

THREE = r"-?[0-9]{1,4}\.[0-9],-?[0-9]{1,4}\.[0-9],-?[0-9]{1,4}\.[0-9]"
LINE = (
    rf" *(?P<verb>GO|RUN) (?:THROUGH (?P<via>{THREE}) )?(?P<end>{THREE})"
    r"(?: AT (?P<speed>[0-9a-z]+))?\r?(?:\n|\Z)"
)
SPLIT = re.compile(r"[^\n]*\n|[^\n]+")
USUAL = "GO 1.0,2.0,-3.5 AT 20"
ARC = "  RUN THROUGH 0.0,0.5,0.0 1.0,0.0,-0.0"


def read_place(text: str) -> tuple[float, ...]:
    return tuple(map(float, text.split(",")))


def read_speed(text: str) -> float:
    return float(text)


MOTIONS = Template(LINE, places=("via", "end"), words={"speed": read_speed}, alike=("verb",))


def write(piece: Run | str) -> str:
    return piece if isinstance(piece, str) else piece.source.text


def list_runs(text: str, template: Template = MOTIONS) -> list[Run]:
    return [piece for piece in template.cut(text) if isinstance(piece, Run)]


def test_each_column_of_a_run_has_a_value_per_line() -> None:
    (run,) = list_runs(f"RUN 1.0,2.0,3.0 AT 5\n{ARC}\r\n{ARC} AT 20\n")
    assert len(run) == 3
    assert run["verb"] == ["RUN"] * 3
    assert run["via"] == [None, (0.0, 0.5, 0.0), (0.0, 0.5, 0.0)]
    assert run["end"] == [(1.0, 2.0, 3.0), (1.0, 0.0, 0.0), (1.0, 0.0, 0.0)]
    assert run["speed"] == [5.0, None, 20.0]


def test_a_sign_of_zero_is_kept() -> None:
    (run,) = list_runs(ARC)
    assert repr(run["end"]) == "[(1.0, 0.0, -0.0)]"


def test_other_lines_separate_runs() -> None:
    text = f"% head\n\n{USUAL}\n{USUAL}\nSTOP\n{ARC}\n{USUAL}\nEND"
    pieces = list(MOTIONS.cut(text))
    assert [piece if isinstance(piece, str) else len(piece) for piece in pieces] == [
        "% head\n\n", 2, "STOP\n", 1, 1, "END",
    ]  # fmt: skip


def test_a_line_with_more_characters_is_not_in_the_usual_spelling() -> None:
    for line in (f"{USUAL} AT 3", f"x{USUAL}", f"{USUAL};", f"{USUAL}\r\r", USUAL.lower()):
        assert list(MOTIONS.cut(f"{line}\n")) == [f"{line}\n"]


def test_a_line_with_a_word_that_its_decoder_refuses_stays_a_text() -> None:
    text = f"{USUAL}\nGO 1.0,2.0,3.0 AT fast\n{USUAL}\n"
    pieces = list(MOTIONS.cut(text))
    assert [isinstance(piece, Run) for piece in pieces] == [True, False, True]
    assert pieces[1] == "GO 1.0,2.0,3.0 AT fast\n"


def test_a_decoder_is_called_once_for_each_text() -> None:
    calls = Counter[str]()

    def decode(text: str) -> str:
        calls[text] += 1
        return text

    template = Template(LINE, places=("via", "end"), words={"speed": decode})
    rows = [f"GO {k}.0,0.0,0.0 AT {k % 3}\n" for k in range(600)]
    words = chain.from_iterable(run["speed"] for run in list_runs("".join(rows), template))
    assert list(words) == [str(k % 3) for k in range(600)]
    assert calls == {"0": 1, "1": 1, "2": 1}


def test_a_run_has_at_most_256_lines() -> None:
    runs = list_runs(f"{USUAL}\n" * 600)
    assert [len(run) for run in runs] == [256, 256, 88]


def test_an_empty_text_has_no_runs() -> None:
    assert list(MOTIONS.cut("")) == []
    assert list(MOTIONS.cut("\n")) == ["\n"]


PIECES = [
    USUAL, ARC, "GO 7.5,8.0,9.0", "RUN 7.5,8.0,9.0 AT x1", "GO", "STOP", "", " ", "GO 1.0,2.0",
    "\r", "\x85", "\v", "GO 1.0,2.0,3", "é",
]  # fmt: skip


@given(
    st.lists(st.tuples(st.sampled_from(PIECES), st.sampled_from(["\n", "\r\n", "\r", "", " "]))),
    st.sampled_from([1, 30, 1 << 16]),
)
def test_a_text_is_cut_into_the_lines_that_match_one_by_one(
    rows: list[tuple[str, str]], block: int
) -> None:
    text = "".join(row + end for row, end in rows)
    usual = re.compile(LINE)
    expected = []
    for line in SPLIT.findall(text):
        match = usual.fullmatch(line)
        if match is not None and "x" not in (match["speed"] or ""):
            via, end = (match[name] and read_place(match[name]) for name in ("via", "end"))
            speed = match["speed"] and float(match["speed"])
            expected.append((line, match["verb"], via, end, speed))
    with patched([("camgen.lang.columns._BLOCK", block)]):
        pieces = list(MOTIONS.cut(text))
    assert "".join(map(write, pieces)) == text
    rows_read = []
    for run in pieces:
        if isinstance(run, Run):
            lines = SPLIT.findall(run.source.text)
            values = (run[name] for name in ("verb", "via", "end", "speed"))
            rows_read += zip(lines, *values, strict=True)
            assert len(set(run["verb"])) == 1
            assert len(run) <= columns._LONGEST
    assert rows_read == expected


@given(st.lists(st.sampled_from(["a", "b", "", "c "])))
def test_each_text_has_the_index_of_its_distinct_text(texts: list[str]) -> None:
    distinct, number = find_distinct(texts)
    assert [distinct[index] for index in number.tolist()] == texts
    assert len(distinct) == len(set(texts))


@given(st.lists(st.from_regex(r"\A-?(0\.|[1-9][0-9]{0,15}\.)[0-9]{1,16}\Z"), max_size=8))
def test_numbers_are_those_of_float(texts: list[str]) -> None:
    numbers = read_numbers(",".join(texts).encode())
    assert numbers is not None
    assert [number.hex() for number in numbers.tolist()] == [float(text).hex() for text in texts]


def test_other_spellings_of_numbers_are_not_read() -> None:
    for text in (b"1,", b"01", b".5", b"1.", b"+1", b"1 2", b"[1]", b"nan", b"1e400", b"?"):
        assert read_numbers(text) is None
