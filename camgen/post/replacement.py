"""Replaces the arcs that a controller lacks by motions that it has, in the columns of a program.

`Post.prepare` calls `replace_refused`. A long program has half a million instructions, so most of
them are decided by column: `accepts` and `refuses` of a post give masks. `why_not` decides on the
others, one instruction after the other. A replaced arc becomes the motions of the first pass
(`passes.PASSES`) whose motions are all accepted.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Protocol

import numpy as np
from msgspec import Struct

from camgen.geometry.arcs import is_arc
from camgen.geometry.ragged import compute_first_rows, count_rows, list_range_numbers
from camgen.model.errors import Refused
from camgen.model.pose import Pose
from camgen.model.program import (
    Body,
    BodyBuilder,
    Columns,
    Indices,
    Instruction,
    Mask,
    Motion,
    MoveC,
    MoveJ,
    MoveL,
    Program,
    join,
    pack,
    replace_at,
)
from camgen.post.passes import PASSES, halve_each
from camgen.post.values import end_of

#: Number of instructions that are objects at a time. As objects they take more memory than the
#: whole program by column.
_BLOCK = 8192


class Controller(Protocol):
    """The members of a post that decide which instructions its controller has. See `Post`."""

    name: ClassVar[str]
    passes: ClassVar[tuple[str, ...]]

    def accepts(self, columns: Columns) -> Mask:
        """(N,): the instructions that the controller surely has."""

    def refuses(self, columns: Columns) -> Mask:
        """(M,): the motions that are arcs which the controller surely lacks."""

    def why_not(self, item: Instruction, before: Motion | None, after: Motion | None) -> str:
        """The reason why the controller lacks `item`; empty if it has it."""


class _RefusedArc(Struct, frozen=True, eq=False):
    """An arc that the controller cannot do.

    index: its place in the body.
    start: the pose at which it starts.
    arc: the motion.
    before, after: the motions before and after it, None without one.
    """

    index: int
    start: Pose
    arc: MoveC
    before: Motion | None
    after: Motion | None


def replace_refused(controller: Controller, program: Program, chord: float) -> Program:
    """The program with each refused arc replaced; the program itself if nothing is refused.

    chord: mm that a replacement may deviate from its arc.

    Raises Refused with index and reason of the first refused instruction without a replacement.
    """
    body, columns = program.body, program.columns
    accepted = controller.accepts(columns)
    halved_at, halved = _halve_by_column(controller, columns, accepted, chord)
    accepted[halved_at] = True
    undecided = np.flatnonzero(~accepted)
    indices: list[int] = []
    sizes: list[int] = []
    replaced = BodyBuilder()
    for low in range(0, len(undecided), _BLOCK):
        arcs, refusal = _find_refused(controller, columns, undecided[low : low + _BLOCK])
        for arc, pieces in zip(arcs, _replace_arcs(controller, arcs, chord), strict=True):
            indices.append(arc.index)
            sizes.append(len(pieces))
            replaced.extend(pieces)
        if refusal is not None:
            raise refusal
    if not indices and not len(halved_at):
        return program
    counts = np.append(np.full(len(halved_at), 2), np.array(sizes, np.intp))
    places = np.append(halved_at, np.array(indices, np.intp))
    order = np.argsort(places)
    rows = list_range_numbers(compute_first_rows(counts)[order], counts[order])
    pieces_in_order = join(halved, replaced.body()).take(rows)
    return program.with_body(replace_at(pack(body), places[order], counts[order], pieces_in_order))


def _halve_by_column(
    controller: Controller, columns: Columns, accepted: Mask, tolerance: float
) -> tuple[Indices, Body]:
    """The arcs that are halved by column: their indices (K,), and the two halves of each.

    A controller whose first pass is not `halves` has no such arcs. Both halves are
    accepted.
    """
    if controller.passes[:1] != ("halves",):
        return np.zeros(0, np.intp), pack(())
    arcs = np.flatnonzero(controller.refuses(columns) & ~accepted[columns.at])
    arcs, tried = halve_each(columns, arcs, tolerance)
    sound = controller.accepts(Columns(tried)).reshape(-1, 3)[:, 1:].all(axis=1)
    rows = 3 * np.flatnonzero(sound)[:, None] + (1, 2)
    return columns.at[arcs[sound]], tried.take(rows.ravel())


def _find_refused(
    controller: Controller, columns: Columns, undecided: Indices
) -> tuple[list[_RefusedArc], Refused | None]:
    """The refused arcs at the indices `undecided` that may have a replacement.

    The list ends before the first refused instruction without one, which is the second value.
    """
    arcs: list[_RefusedArc] = []
    items = columns.pick(undecided)
    neighbours = zip(*columns.neighbours(undecided), strict=True)
    for index, item, (before, after) in zip(undecided.tolist(), items, neighbours, strict=True):
        start = end_of(before)
        if (
            isinstance(item, MoveC)
            and start is not None
            and not is_arc(start.origin, item.via.origin, item.target.origin)
        ):
            return arcs, Refused(
                controller.name,
                index,
                "the three points of the arc are on one line",
                "give the arc a via point beside its chord, or plan a line",
            )
        reason = controller.why_not(item, before, after)
        if not reason:
            continue
        if not isinstance(item, MoveC) or start is None or not controller.passes:
            return arcs, Refused(controller.name, index, reason)
        arcs.append(_RefusedArc(index, start, item, before, after))
    return arcs, None


def _replace_arcs(
    controller: Controller, arcs: Sequence[_RefusedArc], chord: float
) -> list[list[MoveL | MoveC]]:
    """The motions that replace each arc. Raises Refused for the first arc without a replacement."""
    if not arcs:
        return []
    replace = PASSES[controller.passes[0]]
    tried = [replace(refused.start, refused.arc, chord) for refused in arcs]
    # The columns need the start of each arc, so a motion to it stands before its pieces.
    body: list[Instruction] = []
    for refused, pieces in zip(arcs, tried, strict=True):
        body += [MoveJ(refused.start, refused.arc.speed), *pieces]
    accepted = controller.accepts(Columns(body))
    counts = count_rows(tried)
    ends, sums = np.cumsum(counts + 1), np.append(0, np.cumsum(accepted))
    for k in np.flatnonzero(sums[ends] - sums[ends - counts] < counts).tolist():
        tried[k] = _replace_arc(controller, arcs[k], chord)
    return tried


def _replace_arc(controller: Controller, refused: _RefusedArc, chord: float) -> list[MoveL | MoveC]:
    """The motions of the first pass that are all accepted. Raises Refused if no pass has such."""
    reason = ""
    for name in controller.passes:
        pieces = PASSES[name](refused.start, refused.arc, chord)
        around = [refused.before, *pieces, refused.after]
        for place, piece in enumerate(pieces):
            reason = controller.why_not(piece, around[place], around[place + 2])
            if reason:
                break
        else:
            return pieces
    raise Refused(controller.name, refused.index, reason)
