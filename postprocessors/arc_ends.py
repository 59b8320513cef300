"""Ends of arcs that LinuxCNC does not run within `G64 P`.

LinuxCNC 2.9 leaves the path by far more than P where an arc is followed by a line that turns by
0.24 to 3 degrees towards the centre of the arc: with P of 10 um by 103 um at a radius of 2 mm, by
33 um at 7.2 mm, by 18 um at 20 mm (executed by its planner, docs/posts/gcode.md). Between two
lines it keeps P. So the last piece of such an arc becomes a chord.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec.structs import replace

from camgen.geometry.arcs import circle, spans_through
from camgen.geometry.vectors import angles, dots
from camgen.model.program import (
    Columns,
    Comment,
    Indices,
    MoveC,
    MoveL,
    Program,
    splice,
)
from camgen.post.passes import along

#: rad: turns of the line behind an arc that are not run within P, with a margin.
_LEAST, _MOST = math.radians(0.1), math.radians(4.0)
#: rad: sweep of the chord. The arc turns into it by half of that, which LinuxCNC runs within P.
_CHORD = math.radians(0.15)


def end_in_chords(program: Program) -> Program:
    """The program with a chord at the end of each arc that LinuxCNC would leave by more than P."""
    columns = program.columns
    rows = find_ends(columns)
    changed: dict[int, Sequence[MoveC | MoveL]] = {}
    for row in rows.tolist():
        arc = columns.moves[row]
        start = columns.moves[row - 1].target
        _, _, _, sweep = circle(start.origin, arc.via.origin, arc.target.origin)
        share = 1 - _CHORD / sweep
        via, end = along(start, arc, (share / 2, share))
        line = MoveL(
            arc.target,
            arc.speed,
            arc.blend,
            arc.force,
            arc.force_direction,
            path=arc.path,
            work=arc.work,
        )
        changed[int(columns.at[row])] = (replace(arc, via=via, target=end), line)
    return program.with_body(splice(tuple(program.body), changed)) if changed else program


def find_ends(columns: Columns) -> Indices:
    """The motions, arcs, that LinuxCNC would leave at their planned ends by more than P."""
    done = np.cumsum(~columns.are(Comment))[columns.at]
    arcs = columns.arcs[(columns.arcs > 0) & (columns.arcs + 1 < len(columns.at))]
    follows = (done[arcs + 1] - done[arcs] == 1) & columns.moves_are(MoveL)[arcs + 1]
    arcs = arcs[follows & columns.posed[arcs - 1] & columns.posed[arcs + 1]]
    if not len(arcs):
        return arcs
    shapes = spans_through(columns.ends[arcs - 1], columns.vias_of(arcs), columns.ends[arcs])
    line = columns.ends[arcs + 1] - columns.ends[arcs]
    turn = angles(shapes.tangents()[1], line)
    centre = shapes.via - shapes.radius[:, None] * shapes.towards
    inwards = dots(line, centre - shapes.end) > 0
    wide = shapes.curved & (shapes.sweep > 2 * _CHORD)
    return arcs[wide & inwards & (turn > _LEAST) & (turn < _MOST)]
