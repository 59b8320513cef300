"""The page of a third-party program: its motion, its text, and the lines with findings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from camgen.check.report import clean, motion_lengths, path_sums
from camgen.lang.programs import CERTAIN, LEVELS, Executed
from camgen.lang.taught import OneFrameBody
from camgen.model.pose import IDENTITY, FloatArray, Pose
from camgen.model.program import Columns, Instruction, MoveC, MoveJ, MoveL, Wait
from camgen.plan.taught import find_stretches, make_paths
from camgen.preview.curves import SpaceChains, choose_sag
from camgen.preview.listing import list_texts
from camgen.preview.notes import ViewNote
from camgen.preview.stock import Cutter
from camgen.preview.track import IntArray, find_ends, list_switches, make_events, make_tool_track
from camgen.preview.view import Row, View

#: Diameter with which the tool is drawn, mm. The tool of the program is not known.
_DRAWN_DIAMETER = 2.0
#: A program with a lower height, as a fraction of its width, is shown from above if its tool axis
#: is vertical: 1 - cos of the angle that is still vertical.
_FLAT_FRACTION, _UPRIGHT = 0.2, 1e-9
_NO_OFFSET = Pose(IDENTITY, (0.0, 0.0, 0.0))


def view_program(
    title: str,
    texts: Mapping[str, str],
    executed: Executed,
    carried: OneFrameBody,
    facts: Sequence[tuple[str, str]],
    place: Callable[[int], str],
) -> View:
    """The view of a program that was run.

    title: title of the page.
    texts: texts of the files, by name.
    executed: the run of the program.
    carried: its body in one frame.
    facts: labels and texts at the top of the page.
    place: names file and line of a line that is counted through all files.
    """
    body, lines = carried.body, carried.lines
    if not any(isinstance(instruction, MoveJ | MoveL | MoveC | Wait) for instruction in body):
        # A page needs at least one event.
        body, lines = (Wait(0.0), *body), (1, *lines)
    columns = Columns(body)
    paths, _ = make_paths(body, lines)
    ends = columns.ends[~np.isnan(columns.ends[:, 0])]
    seconds = motion_lengths(columns) / columns.speed
    events = make_events(columns, *find_ends(columns), _assign_paths(body), seconds)
    rows = []
    for path, length, time in zip(
        paths, *(sums.tolist() for sums in path_sums(paths)), strict=True
    ):
        feed = length / time if time > 0 else float(path.feed[0])
        rows.append(Row(path.id, path.layer, length, feed, 0.0, time, 1))
    return View(
        title=clean(title),
        facts=tuple((label[:1].upper() + label[1:], clean(text)) for label, text in facts),
        lines=(),
        chains=SpaceChains(np.zeros((0, 3)), np.zeros(0, dtype=np.int64)),
        solid=None,
        flat=_is_flat(ends) and bool((events.last_axis[:, 2] < -1 + _UPRIGHT).all()),
        rows=tuple(rows),
        track=make_tool_track(events, choose_sag(ends)),
        arm=None,
        base_from_work=_NO_OFFSET,
        flange_from_tool=_NO_OFFSET,
        diameter=_DRAWN_DIAMETER,
        bodies=(),
        standing=(),
        meshes=(),
        notes=tuple(_list_notes(executed, place)),
        listing=list_texts(
            list(texts.items()), np.array(lines, dtype=np.int64)[events.instruction]
        ),
        tools=(Cutter("tool", "end mill", _DRAWN_DIAMETER, (), _NO_OFFSET),),
        tool_of=np.zeros(len(events.kind), dtype=np.int64),
        stock=None,
        switches=list_switches(columns, events),
    )


def _is_flat(ends: FloatArray) -> bool:
    size = np.ptp(ends, axis=0) if len(ends) else np.zeros(3)
    return bool(size[2] < _FLAT_FRACTION * size[:2].max())


def _assign_paths(body: Sequence[Instruction]) -> IntArray:
    """The path of each motion, shape (M,); -1 for a joint motion."""
    moves = [move for move in body if isinstance(move, MoveJ | MoveL | MoveC)]
    owner = np.full(len(moves), -1)
    for k, (low, high) in enumerate(find_stretches(moves)):
        owner[low + 1 : high] = k
    return owner


def _list_notes(executed: Executed, place: Callable[[int], str]) -> list[ViewNote]:
    """Notes on the line where the run stopped, on the findings by severity, and on assumptions."""
    notes = []
    if executed.stopped:
        line, reason = executed.stopped
        what = f"{clean(place(line))}: the run stops here"
        notes.append(ViewNote("refused", what, clean(reason), True, text=line))
    for level in LEVELS:
        for finding in executed.findings:
            if finding.level == level:
                where, what = clean(place(finding.line)), clean(finding.what)
                notes.append(ViewNote(level, where, what, level in CERTAIN, text=finding.line))
    for assumed in executed.assumed:
        what = f"{clean(place(assumed.line))}: {clean(assumed.what)}"
        remedy = f"--assume {assumed.key}=VALUE sets it" if assumed.key else ""
        notes.append(ViewNote("assumed", what, clean(remedy), False, text=assumed.line))
    return notes
