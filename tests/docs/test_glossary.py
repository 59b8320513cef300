"""The types that the glossary names exist, and each term has one row."""

import re
from importlib import import_module
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "glossary.md"
TEXT = PAGE.read_text(encoding="utf-8")
TYPES = sorted(set(re.findall(r"`(camgen\.[\w.]+(?::\w+)?)`", TEXT)))


@pytest.mark.parametrize("name", TYPES)
def test_a_type_exists(name: str) -> None:
    module, _, attribute = name.partition(":")
    loaded = import_module(module)
    assert not attribute or hasattr(loaded, attribute)


def test_each_term_has_one_row() -> None:
    terms = re.findall(r"^\| ([^|]+?) \|", TEXT, re.M)
    rows = [term for term in terms if term not in ("term", "---")]
    assert len(rows) > 40
    assert len(set(rows)) == len(rows)
