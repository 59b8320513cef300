"""Changes of the job by clicks on the page: layers, contours, edges, the order and the seams.

They become globs of `input.layers`, ids of `[[operations]]`, words of `input.select`, and `[tour]`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Container, Iterable, Sequence
from itertools import chain, pairwise
from typing import Any

from camgen.model.errors import JobError
from camgen.model.sequences import find_first_places
from camgen.workbench.perform import MOVABLE, InputSummary
from camgen.workbench.session import Tables, get_table, list_rows, set_value

_SPECIAL = re.compile(r"[\[*?]")
#: Distance below which two start points are the same, mm.
_SAME_MM = 0.01


def switch_layer(tables: Tables, name: str, on: bool) -> Tables:
    """The job with or without a layer, by `input.layers`."""
    glob = _SPECIAL.sub(lambda match: f"[{match[0]}]", name)
    replaced = (f"!{glob}".casefold(), glob.casefold())
    globs = [other for other in _list_globs(tables) if other.casefold() not in replaced]
    if not on:
        return set_value(tables, ["input", "layers"], [*(globs or ["*"]), f"!{glob}"])
    if all(other.startswith("!") for other in globs):
        globs = ["*", *globs]
    elif "*" not in globs:
        globs.append(glob)
    return set_value(tables, ["input", "layers"], globs)


def _list_globs(tables: Tables) -> list[str]:
    globs = get_table(tables, "input").get("layers", ["*"])
    return list(map(str, globs)) if isinstance(globs, list) else ["*"]


def leave_out(tables: Tables, summary: InputSummary, names: Sequence[str], row: int) -> Tables:
    """The job without contours, or edges, in an operation.

    row: row of `[[operations]]`; -1 for all rows that work on them.

    Raises JobError if the job cannot express it, or if nothing would be left.
    """
    if summary.kind == "solid":
        words = _remove_names(_list_words(tables), names, negated=False)
        for name in names:
            words += ["not", name]
        return set_value(tables, ["input", "select"], _join_words(words))
    _check_contours(summary)
    rows = list_rows(tables, "operations")
    kept: list[dict[str, Any]] = []
    for number, operation in enumerate(rows):
        worked = summary.worked[number] if number < len(summary.worked) else ()
        if row not in (-1, number) or not set(worked) & set(names):
            kept.append(operation)
        elif remaining := _drop(worked, names):
            kept.append({**operation, "ids": remaining})
    if not rows and (remaining := _drop(dict(summary.contours), names)):
        kept = [{"ids": remaining}]
    if not kept:
        raise JobError(
            "job",
            "nothing would be left to work on",
            ", ".join(names),
            "leave out the layer instead",
        )
    return set_value(tables, ["operations"], kept)


def restore(tables: Tables, summary: InputSummary, names: Sequence[str]) -> Tables:
    """The job with contours, or edges, that it leaves out.

    Contours are added to the last row of `[[operations]]` that names contours.
    """
    if summary.kind == "solid":
        words = _list_words(tables)
        kept = _remove_names(words, names, negated=True)
        # Without a "not" to remove, the names are added to the selection.
        added = [] if kept != words else names
        return set_value(tables, ["input", "select"], _join_words([*kept, *added]))
    _check_contours(summary)
    rows = list_rows(tables, "operations")
    number = next((k for k in reversed(range(len(rows))) if rows[k].get("ids")), None)
    if number is None:
        raise JobError(
            "job",
            "no operation names its contours",
            ", ".join(names),
            "add an operation for them",
        )
    order = dict(summary.contours)
    wanted = {*rows[number]["ids"], *names}
    if len(rows) == 1 and set(rows[0]) == {"ids"} and wanted >= set(order):
        return set_value(tables, ["operations"], None)
    return set_value(
        tables, ["operations", number, "ids"], [name for name in order if name in wanted]
    )


def list_left_out(tables: Tables, summary: InputSummary) -> list[str]:
    """The contours, or edges, that can be restored."""
    if summary.kind == "solid":
        words = _list_words(tables)
        return [word for before, word in pairwise(words) if before == "not" and word != "bottom"]
    ids = [row.get("ids", []) for row in list_rows(tables, "operations")]
    if not any(ids):
        return []
    return _drop(dict(summary.contours), set(chain(*ids, *summary.worked)))


def move_path(tables: Tables, summary: InputSummary, path: int, to: int) -> Tables:
    """The job that runs a path at the position of another one of its operation, by `tour.order`.

    path, to: indices of the paths.

    `tour.order` then names all paths of the operation up to the moved one, and those that it named
    before. Raises JobError if the operations determine the order of the two paths.
    """
    _check_moves(summary, path, to)
    runs = summary.runs
    same_row = [k for k, run in enumerate(runs) if run.row == runs[path].row]
    if runs[to].row != runs[path].row:
        raise JobError(
            "page",
            f"path {to + 1} belongs to another operation, which keeps its place in the order of "
            "the operations",
            remedy="move the path within its operation",
        )
    moved = [k for k in same_row if k != path]
    moved.insert(same_row.index(to), path)
    last = max([moved.index(path), *(place for place, k in enumerate(moved) if runs[k].ordered)])
    first = _list_names(summary, moved[: last + 1])
    rank = find_first_places(first)
    path_rank = min((rank.get(name, len(first)) for name in runs[path].contours), default=-1)
    to_rank = min((rank.get(name, len(first)) for name in runs[to].contours), default=-1)
    if path_rank == to_rank or (path_rank < to_rank) == (path < to):
        raise JobError(
            "page",
            f"paths {path + 1} and {to + 1} work on the same contours; the operation orders them",
            remedy="move another path",
        )
    ordered = [k for k, run in enumerate(runs) if run.ordered and run.row != runs[path].row]
    others = _drop(_list_names(summary, ordered), rank)
    late = _drop(others, _list_names(summary, range(same_row[0])))
    return set_value(tables, ["tour", "order"], [*_drop(others, late), *first, *late])


def move_seam(
    tables: Tables, summary: InputSummary, path: int, place: tuple[float, float] | None
) -> Tables:
    """The job that starts a closed path at a place, by `tour.seams`.

    path: index of the path.
    place: x, y, mm; None lets camgen choose the start point.

    Raises JobError for an open path.
    """
    _check_moves(summary, path)
    run = summary.runs[path]
    if run.seam is None:
        raise JobError(
            "page", f"path {path + 1} is not closed", remedy="it starts at one of its ends"
        )
    listed = tables.get("tour", {}).get("seams", [])
    seams = [[*point] for point in listed] if isinstance(listed, list) else []
    replaced = len(seams)
    if run.point is not None and [*run.point] in seams:
        # Other paths along the contour may need the point. Paths that start there move along.
        others = [other for other in summary.runs if other is not run and other.point == run.point]
        is_alone = all(
            other.seam and math.dist(other.seam[:2], run.seam[:2]) < _SAME_MM for other in others
        )
        if place is None or is_alone:
            replaced = seams.index([*run.point])
    seams[replaced : replaced + 1] = [[round(value, 3) for value in place]] if place else []
    return set_value(tables, ["tour", "seams"], seams)


def _check_moves(summary: InputSummary, *paths: int) -> None:
    """Raise JobError for paths whose order and start a job cannot set."""
    if summary.kind not in MOVABLE:
        raise JobError(
            "page",
            "only paths of drawings and pictures have an order and seams",
            remedy="see [tour]",
        )
    if not all(0 <= path < len(summary.runs) for path in paths):
        raise JobError("page", "the picture is of an older program", remedy="wait for the new one")


def _drop(names: Iterable[str], dropped: Container[str]) -> list[str]:
    return [name for name in names if name not in dropped]


def _list_names(summary: InputSummary, paths: Sequence[int]) -> list[str]:
    return list(dict.fromkeys(chain.from_iterable(summary.runs[k].contours for k in paths)))


def _check_contours(summary: InputSummary) -> None:
    """Raise JobError for a part of which a job cannot leave out single contours."""
    what = {
        "curves": "selects curves by layer alone",
        "program": "has no setting to leave out a part of a program",
    }
    if summary.kind in what:
        raise JobError("job", what[summary.kind], remedy="leave out a layer, or correct the input")


def _list_words(tables: Tables) -> list[str]:
    return str(get_table(tables, "input").get("select", "convex")).replace(",", " ").split()


def _remove_names(words: Sequence[str], names: Sequence[str], negated: bool) -> list[str]:
    """The words of a selection without names.

    negated: remove the names after a "not", and the "not"; otherwise remove all other names.
    """
    kept: list[str] = []
    for before, word in zip(["", *words], words, strict=False):
        is_removed = word in names and (before == "not") == negated
        if is_removed and negated:
            kept.pop()
        if not is_removed:
            kept.append(word)
    return kept


def _join_words(words: Sequence[str]) -> str:
    """The text of a selection as a user would write it."""
    return re.sub(r" (?=not )", ", ", " ".join(words or ["convex"]))
