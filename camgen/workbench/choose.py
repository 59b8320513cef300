"""Layers and contours switched on and off in the job's own words: globs, ids of rows, words of input.select."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from camgen.model.errors import JobError
from camgen.workbench.perform import MOVABLE, Looked
from camgen.workbench.session import Tables, put, rows_of

_SPECIAL = re.compile(r"[\[*?]")
#: Seams that are nearer to each other than this, mm, are one.
_SAME_MM = 0.01


def switch_layer(tables: Tables, name: str, on: bool) -> Tables:
    """The job with or without a layer, by ``input.layers``."""
    glob = _SPECIAL.sub(lambda found: f"[{found[0]}]", name)
    globs = [
        one
        for one in _globs(tables)
        if one.casefold() not in (f"!{glob}".casefold(), glob.casefold())
    ]
    if not on:
        return put(tables, ["input", "layers"], [*(globs or ["*"]), f"!{glob}"])
    if not any(one == "*" for one in globs) and any(not one.startswith("!") for one in globs):
        globs.append(glob)
    elif not globs or all(one.startswith("!") for one in globs):
        globs = ["*", *globs]
    return put(tables, ["input", "layers"], globs)


def _globs(tables: Tables) -> list[str]:
    found = _input(tables).get("layers", ["*"])
    return [str(one) for one in found] if isinstance(found, list) else ["*"]


def leave_out(tables: Tables, looked: Looked, names: Sequence[str], row: int) -> Tables:
    """The job without contours, or edges, in an operation. row: of ``[[operations]]``, -1: in all that work on them.
    JobError where the job has no words for it.
    """
    if looked.kind == "solid":
        words = _words(tables)
        more = [word for name in names for word in ("not", name)]
        return put(
            tables, ["input", "select"], _join_words(_without(words, names, negated=False) + more)
        )
    _insist_on_contours(looked)
    rows = rows_of(tables, "operations")
    if not rows:
        left = [name for name, _ in looked.contours if name not in names]
        if not left:
            raise JobError(
                "job",
                "nothing would be left to work on",
                ", ".join(names),
                "leave out the layer instead",
            )
        return put(tables, ["operations"], [{"ids": left}])
    kept: list[dict[str, Any]] = []
    for number, one in enumerate(rows):
        worked = looked.worked[number] if number < len(looked.worked) else ()
        if row not in (-1, number) or not set(worked) & set(names):
            kept.append(one)
        elif left := [name for name in worked if name not in names]:
            kept.append({**one, "ids": left})
    if not kept:
        raise JobError(
            "job",
            "nothing would be left to work on",
            ", ".join(names),
            "leave out the layer instead",
        )
    return put(tables, ["operations"], kept)


def take_in(tables: Tables, looked: Looked, names: Sequence[str]) -> Tables:
    """The job with contours, or edges, that it leaves out: in the last row that names contours."""
    if looked.kind == "solid":
        words = _words(tables)
        kept = _without(words, names, negated=True)
        # What was taken away is there again; what no word chose is named.
        more = [] if kept != words else names
        return put(tables, ["input", "select"], _join_words([*kept, *more]))
    _insist_on_contours(looked)
    rows = rows_of(tables, "operations")
    number = next((k for k in reversed(range(len(rows))) if rows[k].get("ids")), None)
    if number is None:
        raise JobError(
            "job", "no operation names its contours", ", ".join(names), "add an operation for them"
        )
    order = [name for name, _ in looked.contours]
    wanted = {*rows[number]["ids"], *names}
    if len(rows) == 1 and set(rows[0]) == {"ids"} and wanted >= set(order):
        return put(tables, ["operations"], None)
    return put(tables, ["operations", number, "ids"], [name for name in order if name in wanted])


def left_out(tables: Tables, looked: Looked) -> list[str]:
    """The contours, or edges, that could be taken in again."""
    if looked.kind == "solid":
        words = _words(tables)
        return [word for before, word in pairwise(words) if before == "not" and word != "bottom"]
    if not any(one.get("ids") for one in rows_of(tables, "operations")):
        return []
    worked = {name for row in rows_of(tables, "operations") for name in row.get("ids", [])}
    worked |= {name for ids in looked.worked for name in ids}
    return [name for name, _ in looked.contours if name not in worked]


def order_layers(tables: Tables, names: Sequence[str]) -> Tables:
    """The job that runs its layers in this order, by ``tour.layers``."""
    return put(tables, ["tour", "layers"], list(names))


def move_path(tables: Tables, looked: Looked, path: int, to: int) -> Tables:
    """The job that runs the path of a number at the place of another one, by ``tour.order``: of their operation it
    names all paths up to the one that is moved, and those that were named before. JobError where operations decide.
    """
    _insist_on_moves(looked, path, to)
    runs = looked.runs
    own = [k for k, run in enumerate(runs) if run.row == runs[path].row]
    if runs[to].row != runs[path].row:
        what = "is of another operation, which keeps its place in the order of the operations"
        raise JobError("page", f"path {to + 1} {what}", remedy="move the path within its operation")
    moved = [k for k in own if k != path]
    moved.insert(own.index(to), path)
    last = max([moved.index(path), *(place for place, k in enumerate(moved) if runs[k].ordered)])
    first = _names(looked, moved[: last + 1])
    place = {name: number for number, name in enumerate(first)}
    one, two = (
        min((place.get(name, len(first)) for name in runs[k].contours), default=-1)
        for k in (path, to)
    )
    if one == two or (one < two) == (path < to):
        what = f"paths {path + 1} and {to + 1} work on the same contours, whose order follows from the operation"
        raise JobError("page", what, remedy="move another path")
    others = _names(
        looked, [k for k, run in enumerate(runs) if run.ordered and run.row != runs[path].row]
    )
    before, named = set(_names(looked, range(own[0]))), set(first)
    early = [name for name in others if name not in named and name in before]
    late = [name for name in others if name not in named and name not in before]
    return put(tables, ["tour", "order"], [*early, *first, *late])


def move_seam(
    tables: Tables, looked: Looked, path: int, place: tuple[float, float] | None
) -> Tables:
    """The job that begins the closed path of a number at ``place`` (mm), by ``tour.seams``; None: where camgen likes.
    JobError for a path that is not closed.
    """
    _insist_on_moves(looked, path)
    run = looked.runs[path]
    if run.seam is None:
        raise JobError(
            "page", f"path {path + 1} is not closed", remedy="it begins at one of its ends"
        )
    found = tables.get("tour", {}).get("seams", [])
    seams = [[*one] for one in found] if isinstance(found, list) else []
    held = [k for k, one in enumerate(seams) if run.point is not None and tuple(one) == run.point]
    sharing = [
        other
        for other in looked.runs
        if other is not run and run.point and other.point == run.point
    ]
    # A point on a contour stays for the other paths along it; paths in one place have one.
    alone = all(
        other.seam and math.dist(other.seam[:2], run.seam[:2]) < _SAME_MM for other in sharing
    )
    at = held[0] if held and (place is None or alone) else len(seams)
    seams[at : at + 1] = [[round(value, 3) for value in place]] if place else []
    return put(tables, ["tour", "seams"], seams)


def _insist_on_moves(looked: Looked, *paths: int) -> None:
    """JobError for paths that a job has no words for."""
    if looked.kind not in MOVABLE:
        raise JobError(
            "page",
            "only paths of drawings and pictures have an order and seams",
            remedy="see [tour]",
        )
    if not all(0 <= path < len(looked.runs) for path in paths):
        raise JobError("page", "the picture is of an older program", remedy="wait for the new one")


def _names(looked: Looked, paths: Sequence[int]) -> list[str]:
    return list(dict.fromkeys(name for path in paths for name in looked.runs[path].contours))


def _insist_on_contours(looked: Looked) -> None:
    if looked.kind in ("curves", "program"):
        what = (
            "has no words to leave out a part of it"
            if looked.kind == "program"
            else "chooses curves by layer alone"
        )
        raise JobError("job", what, remedy="leave out a layer, or mend the input")


def _words(tables: Tables) -> list[str]:
    return str(_input(tables).get("select", "convex")).replace(",", " ").split()


def _input(tables: Tables) -> dict[str, Any]:
    found = tables.get("input", {})
    return found if isinstance(found, dict) else {}


def _without(words: Sequence[str], names: Sequence[str], negated: bool) -> list[str]:
    """The words of a selection without names; negated: without those that follow "not", else without the others."""
    kept: list[str] = []
    for before, word in zip(["", *words], words, strict=False):
        drop = word in names and (before == "not") == negated
        if drop and negated:
            kept.pop()
        if not drop:
            kept.append(word)
    return kept


def _join_words(words: Sequence[str]) -> str:
    """Words of a selection as a user would write them."""
    text = " ".join(words or ["convex"])
    return re.sub(r" (?=not )", ", ", text)
