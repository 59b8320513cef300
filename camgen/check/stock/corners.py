"""Corners that the controller rounds: how deep the executed path cuts material that must stay."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from camgen.check.executed import allow_chords, find_transitions, pick_transitions
from camgen.check.stock.design import Design
from camgen.check.stock.gouge import measure_bites
from camgen.check.stock.moves import TOLERANCE_MM, Cut, Moves, find_depths, find_rapid
from camgen.geometry.ragged import find_run_starts
from camgen.geometry.segments import make_segments
from camgen.model.cell import Dynamics
from camgen.model.part import BoolArray, IntArray
from camgen.model.pose import FloatArray, Vec3, to_vec3
from camgen.model.program import Columns
from camgen.motion.rounding import measure_rounding, round_off

#: Every fourth point of a rounded path is examined, with chords between them. They leave the path
#: by a 64th of its distance from the corner, towards the inside.
_STRIDE = 4
#: Paths that are nearer to each other, mm, are the same.
_SAME_MM = 1e-6
#: Corners that are examined together.
_BLOCK = 4096


class Bite(Struct, frozen=True):
    """A rounded corner that cuts material that must stay.

    cut: number of its `Cut`.
    line: line of the motion before the corner, from 1.
    place: place of the corner, mm.
    mm: largest depth in the material.
    allowed: depth, mm, that the tolerances of corners and chords allow.
    """

    cut: int
    line: int
    place: Vec3
    mm: float
    allowed: float

    @property
    def excess(self) -> float:
        """Depth, mm, beyond the allowed one; negative within it."""
        return self.mm - self.allowed


class _Corners(Struct, frozen=True, eq=False):
    """K corners of a cut that are rounded by more than the tolerance of the stock proof.

    columns: motions of the cut.
    rows: (K,) motions before the corners.
    depth: (M, 2) depth below the top face at both ends of each motion, mm.
    """

    columns: Columns
    rows: IntArray
    depth: FloatArray


def find_bites(cuts: Sequence[Cut], design: Design, dynamics: Dynamics) -> list[Bite]:
    """The rounded corners that cut material that must stay, in order.

    LinuxCNC rounds each corner within the distance that its program states, at a place that is not
    modelled. One `Bite` of that depth stands for all its corners.
    """
    bites = []
    for number, cut in enumerate(cuts):
        columns = Columns(cut.body)
        rapid = find_rapid(columns, cut.travel)
        rows = find_transitions(columns, ~rapid, dynamics)
        depth = find_depths(cut, columns, np.roll(columns.ends, 1, axis=0), columns.ends, rapid)
        rows = rows[depth[rows, 1] > TOLERANCE_MM]
        if not len(rows) or dynamics.corner == "junction":
            continue
        if dynamics.corner == "arc":
            if not dynamics.deviation:
                continue
            line, place = int(cut.lines[columns.at[rows[0]]]), to_vec3(columns.ends[rows[0]])
            bites.append(Bite(number, line, place, dynamics.deviation, cut.corner))
            continue
        for low in range(0, len(rows), _BLOCK):
            corners = _Corners(columns, rows[low : low + _BLOCK], depth)
            bites += _measure(corners, cuts, number, design, dynamics)
    return bites


def _measure(
    corners: _Corners, cuts: Sequence[Cut], number: int, design: Design, dynamics: Dynamics
) -> list[Bite]:
    cut, columns = cuts[number], corners.columns
    transitions = pick_transitions(columns, corners.rows)
    distance = measure_rounding(transitions, dynamics)
    # A path within the tolerance of the programmed one cuts no deeper than that.
    far = np.flatnonzero(distance > TOLERANCE_MM)
    if not len(far):
        return []
    rows, distance = corners.rows[far], distance[far]
    transitions = pick_transitions(columns, rows)
    allowed = cut.corner + allow_chords(transitions, cut.chord)
    deepest = np.zeros(len(rows))
    beam = np.where(np.isfinite(corners.depth[rows, 1]), np.nan, corners.depth[rows, 1])
    examined = np.zeros((0, len(rows), 1, 3))
    for curve in round_off(transitions, dynamics):
        points = curve[:, ::_STRIDE]
        new = np.flatnonzero(~_is_same(points, examined))
        examined = points[None]
        if not len(new):
            continue
        moves = _tabulate(points[new], beam[new], distance[new], number)
        bites = measure_bites(moves, cuts, design)
        bites = np.maximum.reduceat(bites, find_run_starts(moves.line))
        deepest[new] = np.maximum(deepest[new], bites)
    places, lines = columns.ends[rows], columns.at[rows]
    measured = []
    for k in np.flatnonzero(deepest > 0).tolist():
        line, mm, limit = int(cut.lines[lines[k]]), float(deepest[k]), float(allowed[k])
        measured.append(Bite(number, line, to_vec3(places[k]), mm, limit))
    return measured


def _is_same(points: FloatArray, examined: FloatArray) -> BoolArray:
    """(K,) whether paths (K, P, 3), mm, are one of those that are examined already (E, K, P, 3)."""
    difference = np.abs(points - examined).max(axis=(2, 3), initial=0.0)
    return np.asarray((difference < _SAME_MM).any(axis=0))


def _tabulate(curve: FloatArray, beam: FloatArray, distance: FloatArray, number: int) -> Moves:
    """Rounded paths (K, P, 3), mm, as chords; the line of each is the number of its corner.

    beam: (K,) depth of a beam or a blade in each corner; NaN for a tool with a tip.
    distance: (K,) distance, mm, of each path from the programmed one.
    number: number of the cut.
    """
    start, end = curve[:, :-1].reshape(-1, 3), curve[:, 1:].reshape(-1, 3)
    corner = np.repeat(np.arange(len(curve)), curve.shape[1] - 1)
    total = len(corner)
    plane = make_segments(start[:, :2], end[:, :2], np.zeros(total), np.arange(total))
    depth = np.column_stack([-start[:, 2], -end[:, 2]])
    through = beam[corner][:, None]
    depth = np.where(np.isnan(through), depth, through)
    cuts, strokes = np.full(total, number), np.zeros(total, dtype=np.intp)
    rapid = np.zeros(total, dtype=np.bool_)
    chord = distance[corner]
    return Moves(
        start, end, plane, depth, rapid, cuts, corner, corner, strokes, chord, tilted=0, lost=0
    )
