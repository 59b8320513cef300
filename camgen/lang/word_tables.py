"""Tables of the words of a language: groups of words, each with what they have in common."""

from __future__ import annotations

from collections.abc import Mapping


def by_word(groups: Mapping[str, str]) -> dict[str, str]:
    """The text of each word.

    groups: words of each group with blanks between them, by the text of the group.

    Raises ValueError for a word that stands in two groups.
    """
    table: dict[str, str] = {}
    for text, words in groups.items():
        for word in words.split():
            if word in table:
                raise ValueError(f"{word} stands in two groups")
            table[word] = text
    return table
