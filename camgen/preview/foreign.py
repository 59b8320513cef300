"""What a page shows of a program that nobody planned here: its motion, its text, and what is wrong in which line."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from camgen.check.report import clean, motion_lengths, path_sums
from camgen.lang.programs import CERTAIN, LEVELS, Executed
from camgen.lang.taught import Carried
from camgen.model.pose import IDENTITY, FloatArray, Pose
from camgen.model.program import Columns, Instruction, MoveC, MoveJ, MoveL, Wait
from camgen.plan.taught import paths_of, stretches
from camgen.preview.curves import SpaceChains
from camgen.preview.listing import list_texts
from camgen.preview.notes import ViewNote
from camgen.preview.stock import Cutter
from camgen.preview.track import IntArray, events, find_ends, switches_of, way_of
from camgen.preview.view import Row, View

#: mm: the tool as it is drawn, which nobody knows. Arcs are drawn to this part of the size of what is shown, and to so
#: many mm at least.
_THIN, _FINE, _LEAST = 2.0, 2e-5, 1e-4
#: A program that is so low against its width is looked at from above, where its tool stands upright.
_FLAT, _UPRIGHT = 0.2, 1e-9
_HERE = Pose(IDENTITY, (0.0, 0.0, 0.0))


def view_program(
    title: str,
    texts: Mapping[str, str],
    executed: Executed,
    told: Carried,
    facts: Sequence[tuple[str, str]],
    place: Callable[[int], str],
) -> View:
    """The view of a program that was run. told: its body in one frame. facts: labels and texts of what the page tells
    first. place: file and line of a line counted through all files.
    """
    body, lines = told.body, told.lines
    if not any(isinstance(item, MoveJ | MoveL | MoveC | Wait) for item in body):
        body, lines = (Wait(0.0), *body), (1, *lines)  # a page shows a moment at least
    columns = Columns(body)
    lengths = motion_lengths(columns)
    paths, _ = paths_of(body, lines)
    ends = columns.ends[~np.isnan(columns.ends[:, 0])]
    sag = max(float(np.linalg.norm(np.ptp(ends, axis=0))) * _FINE, _LEAST) if len(ends) else _LEAST
    seconds = lengths / columns.speed
    found = events(columns, *find_ends(columns), _owners(body), seconds)
    way = way_of(found, sag)
    sums, spent = path_sums(paths)
    rows = [
        Row(
            path.id,
            path.layer,
            length,
            length / time if time > 0 else float(path.feed[0]),
            0.0,
            time,
            1,
        )
        for path, length, time in zip(paths, sums.tolist(), spent.tolist(), strict=True)
    ]
    tool = Cutter("tool", "end mill", _THIN, (), _HERE)
    return View(
        title=clean(title),
        facts=tuple((label[:1].upper() + label[1:], clean(text)) for label, text in facts),
        lines=(),
        chains=SpaceChains(np.zeros((0, 3)), np.zeros(0, dtype=np.int64)),
        solid=None,
        flat=_is_flat(ends) and bool((found.last_axis[:, 2] < -1 + _UPRIGHT).all()),
        rows=tuple(rows),
        track=way,
        arm=None,
        base_from_work=_HERE,
        flange_from_tool=_HERE,
        diameter=_THIN,
        bodies=(),
        standing=(),
        meshes=(),
        notes=tuple(_notes(executed, place)),
        listing=list_texts(list(texts.items()), np.array(lines, dtype=np.int64)[found.instruction]),
        tools=(tool,),
        tool_of=np.zeros(len(found.kind), dtype=np.int64),
        stock=None,
        switches=switches_of(columns, found),
    )


def _is_flat(ends: FloatArray) -> bool:
    """Whether a program is best looked at from above."""
    size = np.ptp(ends, axis=0) if len(ends) else np.zeros(3)
    return bool(size[2] < _FLAT * size[:2].max())


def _owners(body: Sequence[Instruction]) -> IntArray:
    """(M,) the path that each motion runs along, -1: a motion of the joints."""
    moves = [item for item in body if isinstance(item, MoveJ | MoveL | MoveC)]
    owner = np.full(len(moves), -1)
    for k, (low, high) in enumerate(stretches(moves)):
        owner[low + 1 : high] = k
    return owner


def _notes(executed: Executed, place: Callable[[int], str]) -> list[ViewNote]:
    """Why it could not be run on, the findings, the gravest first, and what was assumed."""
    found = []
    if executed.stopped:
        line, what = executed.stopped
        found.append(
            ViewNote(
                "refused", f"{clean(place(line))}: cannot be run on", clean(what), True, text=line
            )
        )
    for level in LEVELS:
        own = [one for one in executed.findings if one.level == level]
        strict = level in CERTAIN
        found += [
            ViewNote(level, clean(place(one.line)), clean(one.what), strict, text=one.line)
            for one in own
        ]
    for one in executed.assumed:
        key = f"--assume {one.key}=VALUE says it otherwise" if one.key else ""
        found.append(
            ViewNote(
                "assumed",
                f"{clean(place(one.line))}: {clean(one.what)}",
                clean(key),
                False,
                text=one.line,
            )
        )
    return found
