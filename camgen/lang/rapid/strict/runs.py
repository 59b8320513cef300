"""What a RAPID program does in runs of statements: by column where all is as usual, else statement by statement."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby

import numpy as np
from msgspec import Struct

from camgen.geometry.ragged import each_once, stretches
from camgen.lang.rapid.ways import is_half_turn, judge_arc, judge_arcs
from camgen.model.body import NUMBER, Body, Packed
from camgen.model.pose import FloatArray, Pose, to_vec3
from camgen.model.program import Indices, Mask, MoveC, MoveJ, MoveL, Output

from .rows import Columns, Rows
from .state import Bound, State
from .statements import check_supervision, find_bound, inline, is_usual, switch, switch_signal
from .syntax import Inline, Wrong

_KINDS = {"movej": NUMBER[MoveJ], "movel": NUMBER[MoveL], "movec": NUMBER[MoveC]}


def perform(state: State) -> None:
    """Does what waits to be done, run after run."""
    waiting, state.waiting = state.waiting, []
    scope = state.scope
    for _, group in groupby(waiting, key=lambda one: (id(one.rows), id(one.scope))):
        runs = list(group)
        rows, state.scope = runs[0].rows, runs[0].scope
        first = np.array([run.first for run in runs], np.intp)
        last = np.array([run.last for run in runs], np.intp)
        _perform_rows(state, rows, stretches(first, last - first))
    state.scope = scope


def _perform_rows(state: State, rows: Rows, some: Indices) -> None:
    """The statements ``some`` of a file, in order."""
    done = 0
    # From where the arm stands at joint values the way is not known.
    while done < len(some) and state.here is None:
        _one(state, rows, int(some[done]))
        done += 1
    if done < len(some) and not _together(state, rows, some[done:]):
        for row in some[done:].tolist():
            _one(state, rows, row)


def _one(state: State, rows: Rows, row: int) -> None:
    statement = rows.statement(row)
    try:
        if isinstance(statement, Inline):
            inline(state, statement)
        else:
            switch_signal(state, statement)
    except Wrong as wrong:
        state.log.find("refused", wrong.what, line=wrong.line)


class _Effects(Struct, frozen=True, eq=False):
    """What the shapes of a file do, by their numbers: kind, as in ``body.NUMBER``; speed, blend: of motions, mm/s and
    mm. outputs: of those that switch.
    """

    kind: Indices
    speed: FloatArray
    blend: FloatArray
    outputs: dict[int, Output]


def _together(state: State, rows: Rows, some: Indices) -> bool:
    """Does all of ``some`` at once, unless there is anything about them that is not as usual."""
    columns = rows.columns.take(some)
    effects = _find_effects(state, rows, some, columns)
    if effects is None or state.pressing is not None or state.here is None:
        return False
    kind, blend = effects.kind[columns.shape], effects.blend[columns.shape]
    moves, arcs = kind != NUMBER[Output], kind == NUMBER[MoveC]
    before = np.append(bool(state.blending), (blend > 0)[:-1])
    point = columns.point[moves]
    ends, vias = rows.points[point], rows.points[columns.point[arcs] - 1]
    starts = np.concatenate([[state.here.origin], ends[:-1]])
    turned = {
        number: state.turned(rows.spellings.turns[number])
        for number in each_once(rows.turn).tolist()
    }
    table = [rotation for rotation in turned.values() if rotation is not None]
    if (before & ~moves).any() or len(table) < len(turned):
        return False
    where = np.zeros(len(rows.spellings.turns), np.int32)
    where[list(turned)] = np.arange(len(turned))
    rotation = where[rows.turn[point]]
    lines = kind[moves] == NUMBER[MoveL]
    curved = kind[moves] == NUMBER[MoveC]
    still = (starts == ends).all(axis=1)
    if (still & lines).any() or not _are_arcs(starts[curved], vias, ends[curved]):
        return False
    here = Pose(table[rotation[-1]], to_vec3(ends[-1]))
    poses = [Pose(one, here.origin) for one in table]
    turned_lines = [(poses[a], poses[b]) for a, b in _turns(rotation, lines)]
    if lines[0]:
        turned_lines.append((state.here, poses[rotation[0]]))
    if any(is_half_turn(start, end) for start, end in turned_lines):
        return False
    state.body.extend_body(
        Body(
            Packed(
                kind=kind.astype(np.int8),
                end=ends,
                rotation=rotation,
                speed=effects.speed[columns.shape[moves]],
                blend=blend[moves],
                path=np.broadcast_to(np.intp(-1), len(point)),
                work=np.broadcast_to(np.bool_(False), len(point)),
                via=vias,
                via_rotation=where[rows.turn[columns.point[arcs] - 1]],
                kept=~moves,
            ),
            table,
            [effects.outputs[number] for number in columns.shape[~moves].tolist()],
        )
    )
    state.lines.frombytes(columns.line.astype(np.int64).tobytes())
    state.here, state.settled = here, False
    state.note_way(ends)
    state.blending = int(columns.line[-1]) if blend[-1] > 0 else 0
    return True


def _find_effects(state: State, rows: Rows, some: Indices, columns: Columns) -> _Effects | None:
    """What each shape among ``some`` does, each looked at where it comes first; None where one is not as usual."""
    shapes = rows.spellings.shapes
    kind = np.full(len(shapes), NUMBER[Output])
    speed, blend = np.zeros(len(shapes)), np.zeros(len(shapes))
    outputs: dict[int, Output] = {}
    numbers, first = np.unique(columns.shape, return_index=True)
    bounds: list[tuple[int, Bound]] = []
    for number, row in sorted(
        zip(numbers.tolist(), first.tolist(), strict=True), key=lambda one: one[1]
    ):
        statement = rows.statement(int(some[row]))
        try:
            if not isinstance(statement, Inline):
                outputs[number] = switch(state, statement)
                continue
            bound = find_bound(state, statement)
        except Wrong:
            return None
        if not is_usual(bound, statement):
            return None
        kind[number], speed[number], blend[number] = _KINDS[bound.name], bound.speed, bound.blend
        bounds.append((statement.line, bound))
    for line, bound in bounds:
        check_supervision(state, line, bound)
    return _Effects(kind, speed, blend, outputs)


def _are_arcs(starts: FloatArray, vias: FloatArray, ends: FloatArray) -> bool:
    """Whether there is nothing to say of any of the arcs."""
    doubtful = np.flatnonzero(~judge_arcs(starts, vias, ends))
    points = (side[doubtful].tolist() for side in (starts, vias, ends))
    return all(judge_arc(*map(tuple, arc)) == ("", "") for arc in zip(*points, strict=True))


def _turns(rotation: Indices, lines: Mask) -> Iterator[tuple[int, int]]:
    """The rotations at the ends of straight motions that turn the tool, each pair once."""
    rows = np.flatnonzero(lines[1:] & (rotation[1:] != rotation[:-1]))
    yield from dict.fromkeys(zip(rotation[rows].tolist(), rotation[rows + 1].tolist(), strict=True))
