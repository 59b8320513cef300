"""Runs sequences of RAPID statements: by column if all are usual, else one by one."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby

import numpy as np

from camgen.geometry.ragged import list_range_numbers, select_distinct
from camgen.lang.rapid.machine import RobotPosition
from camgen.lang.rapid.rows import Columns, Rows
from camgen.lang.rapid.tokens import Wrong
from camgen.lang.rapid.tree import Inline
from camgen.lang.rapid.ways import find_arc_faults, is_half_turn, is_usual_arc
from camgen.model.body import NUMBER, Body, Packed
from camgen.model.pose import FloatArray, Pose, to_vec3
from camgen.model.program import Indices, Mask, MoveC, MoveJ, MoveL, Output

from .state import Bound, State
from .statements import check_supervision, find_bound, inline, is_usual, switch, switch_signal

_KINDS = {"movej": NUMBER[MoveJ], "movel": NUMBER[MoveL], "movec": NUMBER[MoveC]}


def perform(state: State) -> None:
    """Runs the statements that wait."""
    waiting, state.waiting = state.waiting, []
    scope, line = state.scope, state.line
    for _, group in groupby(waiting, key=lambda item: (id(item[0].rows), id(item[1]))):
        runs, scopes = zip(*group, strict=True)
        state.scope = scopes[0]
        first = np.array([run.first for run in runs], np.intp)
        indices = list_range_numbers(first, np.array([len(run) for run in runs], np.intp))
        _perform_rows(state, runs[0].rows, indices)
    state.scope, state.line = scope, line


def _perform_rows(state: State, rows: Rows, indices: Indices) -> None:
    done = 0
    # The path of a motion that starts at joint values is unknown.
    while done < len(indices) and state.position.pose is None:
        _run_row(state, rows, int(indices[done]))
        done += 1
    if done < len(indices) and not _run_columns(state, rows, indices[done:]):
        for row in indices[done:].tolist():
            _run_row(state, rows, row)


def _run_row(state: State, rows: Rows, row: int) -> None:
    statement = rows.statement(row)
    state.line = statement.line
    try:
        if isinstance(statement, Inline):
            inline(state, statement)
        else:
            switch_signal(state, statement)
    except Wrong as wrong:
        state.log.find("refused", wrong.what, line=wrong.line)


def _run_columns(state: State, rows: Rows, indices: Indices) -> bool:
    """Runs statements by column. Returns False, and runs none, if one of them is not usual."""
    columns = rows.columns.take(indices)
    effects = _find_effects(state, rows, indices, columns)
    if effects is None or state.pressing is not None or state.position.pose is None:
        return False
    kinds, speeds, blends, outputs = effects
    kind, blend = kinds[columns.shape], blends[columns.shape]
    moves, arcs = kind != NUMBER[Output], kind == NUMBER[MoveC]
    before = np.append(bool(state.blending), (blend > 0)[:-1])
    point = columns.point[moves]
    ends, vias = rows.points[point], rows.points[columns.point[arcs] - 1]
    starts = np.concatenate([[state.position.pose.origin], ends[:-1]])
    turn, via_turn = rows.turn[point], rows.turn[columns.point[arcs] - 1]
    turned = {
        number: state.turned(rows.spellings.turns[number])
        for number in select_distinct(np.append(turn, via_turn)).tolist()
    }
    table = [rotation for rotation in turned.values() if rotation is not None]
    if (before & ~moves).any() or len(table) < len(turned):
        return False
    index_of = np.zeros(len(rows.spellings.turns), np.int32)
    index_of[list(turned)] = np.arange(len(turned))
    rotation = index_of[turn]
    is_line = kind[moves] == NUMBER[MoveL]
    is_arc = kind[moves] == NUMBER[MoveC]
    is_still = (starts == ends).all(axis=1)
    if (is_still & is_line).any() or not _are_arcs(starts[is_arc], vias, ends[is_arc]):
        return False
    last_pose = Pose(table[rotation[-1]], to_vec3(ends[-1]))
    poses = [Pose(matrix, last_pose.origin) for matrix in table]
    turned_lines = [(poses[a], poses[b]) for a, b in _turns(rotation, is_line)]
    if is_line[0]:
        turned_lines.append((state.position.pose, poses[rotation[0]]))
    if any(is_half_turn(start, end) for start, end in turned_lines):
        return False
    state.packing.extend_body(
        Body(
            Packed(
                kind=kind.astype(np.int8),
                end=ends,
                rotation=rotation,
                speed=speeds[columns.shape[moves]],
                blend=blend[moves],
                path=np.broadcast_to(np.intp(-1), len(point)),
                work=np.broadcast_to(np.bool_(False), len(point)),
                via=vias,
                via_rotation=index_of[via_turn],
                kept=~moves,
            ),
            table,
            [outputs[number] for number in columns.shape[~moves].tolist()],
        )
    )
    state.lines.frombytes(columns.line.astype(np.int64).tobytes())
    state.position, state.is_settled = RobotPosition(last_pose), False
    state.note_target(ends)
    state.blending = int(columns.line[-1]) if blend[-1] > 0 else 0
    return True


def _find_effects(
    state: State, rows: Rows, indices: Indices, columns: Columns
) -> tuple[Indices, FloatArray, FloatArray, dict[int, Output]] | None:
    """The effects of the S shapes of a file, each read at its first statement.

    Returns four values, or None if a shape is not usual:
    (S,) kinds of instructions, numbers of `camgen.model.body`;
    (S,) speeds of motions, mm/s;
    (S,) blend radii of motions, mm;
    the outputs by number of the shape.
    """
    shapes = rows.spellings.shapes
    kind = np.full(len(shapes), NUMBER[Output])
    speed, blend = np.zeros(len(shapes)), np.zeros(len(shapes))
    outputs: dict[int, Output] = {}
    numbers, first = np.unique(columns.shape, return_index=True)
    bounds: list[tuple[int, Bound]] = []
    for k in np.argsort(first).tolist():
        number = int(numbers[k])
        statement = rows.statement(int(indices[first[k]]))
        state.line = statement.line
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
    for state.line, bound in bounds:
        check_supervision(state, bound)
    return kind, speed, blend, outputs


def _are_arcs(starts: FloatArray, vias: FloatArray, ends: FloatArray) -> bool:
    doubtful = np.flatnonzero(~is_usual_arc(starts, vias, ends))
    points = (side[doubtful].tolist() for side in (starts, vias, ends))
    return all(find_arc_faults(*map(tuple, arc)) == ("", "") for arc in zip(*points, strict=True))


def _turns(rotation: Indices, lines: Mask) -> Iterator[tuple[int, int]]:
    rows = np.flatnonzero(lines[1:] & (rotation[1:] != rotation[:-1]))
    yield from dict.fromkeys(zip(rotation[rows].tolist(), rotation[rows + 1].tolist(), strict=True))
