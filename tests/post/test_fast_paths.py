"""The fast paths of the read-backs: from any text they read the same as the general parser."""

import random
import re
from collections import Counter
from collections.abc import Callable
from pkgutil import resolve_name

import pytest
from hypothesis import given
from hypothesis import strategies as st

from camgen.model.program import MoveC, MoveJ, MoveL
from tests.post.fast_paths import pacscript, vplus
from tests.support.damage import damaged
from tests.support.examples import fewer
from tests.support.fast_paths import FastPath, patched
from tests.support.samples import Options

MOTIONS = (MoveJ, MoveL, MoveC)
LANGUAGES = {"pacscript": pacscript, "vplus": vplus}
EACH_PATH = pytest.mark.parametrize("path", [pacscript.PATH, vplus.PATH], ids=LANGUAGES)
TEXTS, STATEMENTS, SPELLINGS = [], [], []
for name, language in LANGUAGES.items():
    for number, (text, options) in enumerate(language.TEXTS):
        TEXTS.append(pytest.param(language.PATH, text, options, id=f"{name}-{number}"))
    for statement in language.STATEMENTS:
        STATEMENTS.append(pytest.param(language, statement, id=f"{name}-{statement}"))
    for spelling in language.SPELLINGS:
        SPELLINGS.append(pytest.param(language, spelling, id=f"{name}-{spelling}"))


@pytest.mark.parametrize(("path", "text", "options"), TEXTS)
def test_a_text_is_read_the_same(path: FastPath, text: str, options: Options) -> None:
    motions = [item for item in path.check(text, options).body if isinstance(item, MOTIONS)]
    assert path.count_fast(text) > 4
    assert len(motions) > 4


@EACH_PATH
def test_the_pieces_are_the_whole_text(path: FastPath) -> None:
    line = "Move L, P(1.0, 2.0, 3.0)"
    written = [text for text, _ in path.texts]
    ends = ["", "\n", "a", "\r\n\r\r\na\x0b\x85b", line, f"{line}\r", f"{line}\r\r\n"]
    for text in (*written, *ends, "MOVE f:TRANS(1,2,3,4,5,6)"):
        pieces = path.template.cut(text)
        assert "".join(p if isinstance(p, str) else p.source.text for p in pieces) == text
        rows = re.split(path.line_end, text)
        assert len(path.lines.findall(text)) == len(rows) - (not rows[-1])


@EACH_PATH
@given(st.lists(st.from_regex(r"\A-?[0-9]{1,9}(\.[0-9]{1,9})?\Z"), min_size=12, max_size=12))
def test_numbers_are_read_to_the_last_bit(path: FastPath, numbers: list[str]) -> None:
    text, firsts = path.numbers
    reading = path.check(text.format(*numbers), {"rated": 2000.0})
    origins = [item.target.origin for item in reading.body if isinstance(item, MOTIONS)]
    assert origins == [tuple(map(float, numbers[first : first + 3])) for first in firsts]


def count_calls(path: FastPath, read: Callable[..., object], options: Options) -> list[int]:
    """Number of calls of each function of the fast path while `read` runs."""
    calls = Counter[str]()

    def counted(name: str) -> Callable[..., object]:
        function = resolve_name(name)

        def call(*arguments: object) -> object:
            calls[name] += 1
            return function(*arguments)

        return call

    with patched([(name, counted(name)) for name in path.functions]):
        read({path.files[0]: path.by_hand}, options)
    return [calls[name] for name in path.functions]


@pytest.mark.parametrize(
    ("path", "options", "fewest"),
    [
        (pacscript.PATH, {}, 11),
        (pacscript.PATH, pacscript.SIGNED, 11),
        (pacscript.PATH, pacscript.CALLED, 11),
        (pacscript.PATH, pacscript.MOVED, 0),
        (pacscript.PATH, pacscript.LONG_S, 0),
        (vplus.PATH, {}, 5),
    ],
)
def test_the_general_parser_closes_an_open_fast_path(
    path: FastPath, options: Options, fewest: int
) -> None:
    """Otherwise the comparison could compare the general parser with itself.

    fewest: number of calls of each function of the fast path; 0 if the options close the path.
    """
    for _ in range(2):
        calls = count_calls(path, path.read, options)
        assert min(calls) >= fewest
        assert any(calls) == (fewest > 0)
        assert not any(count_calls(path, path.read_generally, options))


@EACH_PATH
def test_a_difference_of_the_paths_is_found(path: FastPath) -> None:
    name, limits = path.limit
    least = min(limit for limit in limits if limit is not None)
    other = path._replace(closed=[(name, least)])
    with pytest.raises(AssertionError):
        other.check(path.by_hand, {})


@EACH_PATH
@fewer(12)
@given(st.randoms(use_true_random=True), st.data())
def test_a_damaged_text_is_read_the_same(
    path: FastPath, chance: random.Random, data: st.DataObject
) -> None:
    text, options = data.draw(st.sampled_from(path.texts))
    name, limits = path.limit
    limit = data.draw(st.sampled_from(limits))
    files = path.cut(damaged(text, chance, path.damage.statements, path.damage.change_line), chance)
    with patched([] if limit is None else [(name, limit)]):
        path.check_files(files, options)


@pytest.mark.parametrize(("language", "statement"), STATEMENTS)
def test_a_statement_among_motions_is_read_the_same(language, statement: str) -> None:
    for text, options in language.list_around_motions(statement):
        assert text != language.BY_HAND
        language.PATH.check(text, options)


@pytest.mark.parametrize(("language", "spelling"), SPELLINGS)
def test_a_spelling_within_a_motion_is_read_the_same(language, spelling: str) -> None:
    for text, options in language.list_within_motions(spelling):
        language.PATH.check(text, options)
