"""Selects edges of a part by words such as `convex`, `all`, `e3`, `e5-e9` and `not bottom`."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from camgen.model.errors import JobError
from camgen.model.part import Edge, Solid, index_by_id, keep_ids, list_ids
from camgen.model.text import suggest

#: Height above the lowest point that counts as the bottom, mm: single precision, rounded values.
_LEVEL = 1e-3
_ID = re.compile(r"e([1-9][0-9]*)")


def select_edges(solid: Solid, words: Sequence[str]) -> tuple[str, ...]:
    """The ids of the edges that `words` select, in the order of the part.

    A word is `all`, `convex` (edges with burrs), `bottom` (edges on the lowest plane), an id, or a
    range of ids. It adds its edges; with `not` before it, it removes them, in any order. If no word
    adds edges, `convex` is the default. Raises JobError for an unknown word.
    """
    known = index_by_id(solid.edges)
    added: set[str] = set()
    removed: set[str] = set()
    adds, negated = False, False
    for word in " ".join(words).replace(",", " ").split():
        if word == "not" and not negated:
            negated = True
            continue
        (removed if negated else added).update(_resolve(solid, known, word))
        adds, negated = adds or not negated, False
    if negated:
        raise JobError(
            "input.select",
            'nothing follows "not"',
            remedy='write what to leave out, like "not bottom"',
        )
    if not adds:
        added = _resolve(solid, known, "convex")
    return list_ids(keep_ids(solid.edges, added - removed))


def _resolve(solid: Solid, known: dict[str, Edge], word: str) -> set[str]:
    if word == "all":
        return set(known)
    if word == "convex":
        return {name for name, edge in known.items() if edge.convex}
    if word == "bottom":
        return _find_bottom(solid)
    first, dash, last = word.partition("-")
    low = high = _parse_number(known, solid, first, word)
    if dash:
        high = _parse_number(known, solid, last, word)
    if low > high:
        raise JobError(
            "input.select", f'the range "{word}" runs backwards', remedy=f'write "{last}-{first}"'
        )
    return {f"e{number}" for number in range(low, high + 1)}


def _parse_number(known: dict[str, Edge], solid: Solid, name: str, word: str) -> int:
    if name in known:
        return int(name[1:])
    if _ID.fullmatch(name) and known:
        raise JobError(
            "input.select",
            f"{solid.source} has no edge {name}",
            remedy=f"its edges are e1 to e{len(known)}",
        )
    raise JobError(
        "input.select",
        f'"{word}" is neither an id nor one of all, convex, bottom, not',
        remedy=suggest(word, ["all", "convex", "bottom", "not", *known]),
    )


def _find_bottom(solid: Solid) -> set[str]:
    if not solid.edges:
        return set()
    level = float(solid.vertices[:, 2].min()) + _LEVEL
    return {e.id for e in solid.edges if max(np.max(e.points[:, 2]), np.max(e.via[:, 2])) <= level}
