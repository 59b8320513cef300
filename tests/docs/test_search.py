"""Words that a reader searches for lead to the right page of the site.

The index of the site has an entry for each section. A word in its heading counts most there.
"""

import re
from collections.abc import Iterator

import pytest

from tests.docs.test_docs import DOCS, FILES

#: Pages for words of readers, relative to docs/.
PAGES = {
    "kerf": "follow.md",
    "origin": "first-day.md",
    "cutter": "several-operations.md",
    "tool change": "several-operations.md",
    "safe height": "safety.md",
    "corner rounding": "safety.md",
    "calibration": "inputs/image.md",
    "singularity": "safety.md",
}
#: Results that a reader sees at the first glance.
FIRST_RESULTS = 3


def list_headings() -> Iterator[tuple[str, str]]:
    """Page and text of each heading, without code blocks. README.md is not on the site."""
    for file in FILES[1:]:
        text = re.sub(r"^```.*?^```", "", file.read_text(encoding="utf-8"), flags=re.S | re.M)
        for heading in re.findall(r"^#+ +(.*)$", text, re.M):
            yield file.relative_to(DOCS).as_posix(), heading.lower()


def search(words: str) -> list[str]:
    """Pages whose headings have all words. Short headings come first, as in the index."""
    hits = []
    for page, heading in list_headings():
        if all(re.search(rf"\b{word}", heading) for word in words.split()):
            hits.append((len(heading.split()), page))
    return [page for _, page in sorted(hits)]


@pytest.mark.parametrize(("words", "page"), PAGES.items())
def test_a_word_leads_to_its_page(words: str, page: str) -> None:
    assert page in search(words)[:FIRST_RESULTS]


def test_all_words_must_be_in_one_heading() -> None:
    assert search("tool calibration") == []
