"""Ends of arcs that LinuxCNC does not run within `G64 P`.

LinuxCNC 2.9 has four ways through the joint of two motions: straight on at a low speed, an arc that
touches both, two motions that overlap, or a stop. It takes the fastest. Only where they overlap
does it leave the path by more than P, and only after an arc: by 94 um with P of 10 um at a radius
of 2 mm, by up to 0.7 mm at 100 mm/s. So it runs where a line turns towards the centre of the arc
by up to 5 degrees, and where a line after an arc goes up or down (executed by its planner,
docs/posts/gcode.md). Between two lines it keeps P. So the last piece of such an arc becomes a
chord. The angles are those of the printed numbers, which may turn a joint that was planned tangent.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec.structs import replace

from camgen.geometry.arcs import compute_circle, make_spans_through
from camgen.geometry.vectors import measure_angles, measure_lengths, multiply_rows
from camgen.model.pose import FloatArray, Pose
from camgen.model.program import (
    Columns,
    Comment,
    Indices,
    Mask,
    MoveC,
    MoveL,
    Program,
    splice,
)
from camgen.post.passes import along

from .rs274 import FLAT, print_arcs

#: mm/s2 and s: acceleration and servo period of the machine. `ARC_BLEND_KINK_RATIO` of that
#: acceleration may turn a motion in one period, half of it beside an arc.
_ACCELERATION, _PERIOD, _KINK_RATIO = 500.0, 1e-3, 0.1
#: mm/s rad: product of the turn of a joint and the speed at which the planner runs straight on.
_STRAIGHT_ON = _KINK_RATIO / 2 * _ACCELERATION * _PERIOD
#: Speeds of overlapping motions are multiplied by it: a machine may be slower to accelerate.
_MARGIN = 2.0
#: rad: turns above it, level and towards the centre, are run within P.
_MOST = math.radians(8.0)
#: rad: sweep of the chord. The arc turns into it by half of that, which LinuxCNC runs within P.
_CHORD = math.radians(0.15)
#: Factors by which a chord is longer that is tried.
_LONGER = (1.0, 1.5, 2.0, 3.0, 4.0)
#: Digits of the text that the chord is long at least, so that these do not turn it much.
_DIGITS = 10.0


def end_in_chords(program: Program, decimals: int) -> Program:
    """The program with a chord at the end of each arc that LinuxCNC would leave by more than P.

    decimals: digits after the point of a printed coordinate in mm.
    """
    columns = program.columns
    changed: dict[int, Sequence[MoveC | MoveL]] = {}
    for row in find_ends(columns, decimals).tolist():
        arc = columns.moves[row]
        start = columns.moves[row - 1].target
        via, end = _choose_chord(start, arc, decimals)
        first, middle, last = np.array([[pose.origin] for pose in (start, via, end)])
        fault = print_arcs(first, middle, last, decimals).fault[0]
        if fault not in (0, FLAT):
            continue
        rest = _line_to(end, arc) if fault else replace(arc, via=via, target=end)
        changed[int(columns.at[row])] = (rest, _line_to(arc.target, arc))
    return program.with_body(splice(tuple(program.body), changed)) if changed else program


def _choose_chord(start: Pose, arc: MoveC, decimals: int) -> tuple[Pose, Pose]:
    """The middle and the end of the piece of an arc before its chord.

    A chord of a few digits may turn by printing. Then a longer one is tried.
    """
    _, radius, _, sweep = compute_circle(start.origin, arc.via.origin, arc.target.origin)
    shortest = float(_sweep_chord(radius, decimals)) / sweep
    pieces: list[tuple[Pose, Pose]] = []
    for factor in _LONGER:
        share = 1 - factor * shortest
        if share < 0.5:
            break
        via, end = along(start, arc, (share / 2, share))
        pieces.append((via, end))
        places = np.array([pose.origin for pose in (start, via, end, arc.target)])
        if not _is_left(places, share * sweep * radius, arc.speed, decimals):
            return via, end
    if not pieces:
        via, end = along(start, arc, ((1 - shortest) / 2, 1 - shortest))
        return via, end
    return pieces[0]


def _is_left(places: FloatArray, length: float, feed: float, decimals: int) -> bool:
    """Whether LinuxCNC leaves the joint of an arc and its chord, by their printed numbers.

    places: (4, 3) start, middle and end of the arc, and end of the chord, mm.
    length: length of the arc, mm.
    feed: mm/s.
    """
    printed = print_arcs(places[:1], places[1:2], places[2:3], decimals)
    rounded = np.round(places, decimals)
    spoke = rounded[2] - rounded[0]
    spoke[:2] -= printed.centre[0]
    line = rounded[3] - rounded[2]
    across = np.array([-spoke[1], spoke[0], 0.0])
    turn = float(measure_angles((across if printed.left[0] else -across)[None], line[None])[0])
    speeds = np.array([feed])
    speed = _overlap_speed(np.array([length]), measure_lengths(line[None]), speeds, speeds)[0]
    return bool(turn * speed > _STRAIGHT_ON and line @ spoke < 0 and turn < _MOST)


def _line_to(target: Pose, arc: MoveC) -> MoveL:
    return MoveL(
        target,
        arc.speed,
        arc.blend,
        arc.force,
        arc.force_direction,
        path=arc.path,
        work=arc.work,
    )


def _sweep_chord(radius: float | FloatArray, decimals: int) -> FloatArray:
    """Sweep, rad, of the chord of an arc of a radius, mm, or of many."""
    return np.maximum(_CHORD, _DIGITS * 10.0**-decimals / radius)


def find_ends(columns: Columns, decimals: int) -> Indices:
    """The motions, arcs, that LinuxCNC would leave at their printed ends by more than P."""
    done = np.cumsum(~columns.are(Comment))[columns.at]
    printed_ends = np.round(columns.ends, decimals)
    # LinuxCNC drops a motion to the place where the tool is.
    moves = np.flatnonzero((np.diff(printed_ends, axis=0) != 0).any(axis=1)) + 1
    arcs = columns.arcs[(columns.arcs > 0) & (columns.arcs < (moves[-1] if len(moves) else 0))]
    after = moves[np.searchsorted(moves, arcs, "right")]
    follows = (done[after] - done[arcs] == after - arcs) & columns.moves_are(MoveL)[after]
    follows &= columns.posed[arcs - 1] & columns.posed[after]
    arcs, after = arcs[follows], after[follows]
    if not len(arcs):
        return arcs
    start, end = columns.ends[arcs - 1], columns.ends[arcs]
    shapes = make_spans_through(start, columns.vias_of(arcs), end)
    printed = print_arcs(start, columns.vias_of(arcs), end, decimals)
    spoke = printed_ends[arcs] - printed_ends[arcs - 1]
    spoke[:, :2] -= printed.centre
    line = printed_ends[after] - printed_ends[arcs]
    across = np.column_stack([-spoke[:, 1], spoke[:, 0], np.zeros(len(spoke))])
    turn = measure_angles(np.where(printed.left[:, None], across, -across), line)
    is_level = line[:, 2] == 0
    is_inward = multiply_rows(line, spoke) < 0
    wide = shapes.curved & (shapes.sweep > 2 * _sweep_chord(shapes.radius, decimals))
    speed = _overlap_speed(
        shapes.length, measure_lengths(line), columns.speed[arcs], columns.speed[after]
    )
    bad = turn * speed * _MARGIN > _STRAIGHT_ON
    chosen: Mask = wide & bad & (~is_level | (is_inward & (turn < _MOST)))
    return arcs[chosen]


def _overlap_speed(
    arc: FloatArray, line: FloatArray, arc_feed: FloatArray, line_feed: FloatArray
) -> FloatArray:
    """The speed, mm/s, with which the planner rates the overlap of arcs and lines, at most.

    arc: (K,) lengths of the arcs, mm.
    line: (K,) lengths of the lines, mm.
    arc_feed: (K,) speeds of the arcs, mm/s.
    line_feed: (K,) speeds of the lines, mm/s.
    """
    # Motions that overlap share the acceleration, and an arc has half of it along its path.
    gains = _ACCELERATION / 4, _ACCELERATION / 2
    fast = np.minimum(arc_feed, np.sqrt(gains[0] * arc))
    after = np.minimum(line_feed, np.sqrt(gains[1] * line))
    seconds = np.minimum(arc / fast, line / after)
    both = np.minimum(fast, gains[0] * seconds) + np.minimum(after, gains[1] * seconds)
    return np.asarray(both / 4)
