"""Feed, force and tool axis of the motions that work, as the job asks for them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from camgen.check.proof.contours import (
    SHORT_MM,
    ContourChecker,
    Matched,
    find_rolling,
    may_roll,
)
from camgen.check.proof.findings import Findings
from camgen.check.proof.motions import Motions, Rounding
from camgen.check.proof.outputs import plunge_speed
from camgen.check.proof.pieces import (
    BoolArray,
    IntArray,
    dot,
    find_ways_to,
    normals_along,
)
from camgen.check.proof.tasks import Drawing, Task
from camgen.model.job import Job
from camgen.model.pose import FloatArray

#: The tool's centre is never slower than this share of the feed (docs/follow.md).
_SLOWEST = 0.02
#: From this turn on, an outer corner is rolled about without a force (docs/follow.md).
_SHARP = math.radians(15.0)
#: A feed may differ by this share: a text gives it with a few digits.
_FEED_SHARE = 1e-3
#: Angle, rad, by which the digits of a text may turn a direction, and a chord at most.
_TURN, _MOST_TURN = 0.02, 0.35
#: The orientation and the direction of a force may differ by this angle, rad.
_ANGLE = 1e-3


def check_orientation(job: Job, motions: Motions, rows: IntArray, findings: Findings) -> None:
    """Finds motions whose tool axis is not straight down, or whose tool is turned."""
    down = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
    wrong = np.zeros(len(motions.axes) + 1, np.bool_)
    turns = job.tool.orient == "follow" or job.tool.symmetric or job.tool.turn is not None
    for index, rotation in enumerate(motions.axes):
        difference = rotation[:, 2] - down[:, 2] if turns else rotation - down
        wrong[index] = float(np.abs(difference).max()) > _ANGLE
    what = "works with the tool not straight down"
    if not turns:
        what += ", or turned about its axis"
    findings.add_first(motions, rows[wrong[motions.rotation[rows]]], what)


def check_feeds(
    checker: ContourChecker, matched: Matched, rounding: Rounding, findings: Findings
) -> None:
    """Finds motions along a contour at another feed than the job asks for."""
    task, motions, process = checker.task, checker.motions, checker.task.job.process
    rows = matched.rows[matched.follows]
    low, high = np.ones(len(rows)), np.ones(len(rows))
    if task.kind in ("follow", "chamfer"):
        low, high = _contact_factors(checker.drawing, motions, matched, task.job, rounding.mm)
    speed = motions.speed[rows]
    slack = rounding.speed + _FEED_SHARE * process.feed
    is_wrong = (speed < process.feed * low - slack) | (speed > process.feed * high + slack)
    slope = np.abs(motions.end[rows, 2] - motions.start[rows, 2]) > 1e-4
    # Down from a tab the speed may be lower (docs/follow.md): it is compared with the plunge.
    is_wrong &= ~(slope & (speed <= process.feed * high + slack))
    if task.operation.entry != "plunge" or task.operation.tabs or process.force:
        is_wrong &= ~(np.abs(speed - min(plunge_speed(process), process.feed)) <= slack)
    if task.operation.corner_radius:
        # The rounding of a shallow inner corner follows the contour too, at the plain feed.
        is_wrong &= ~(np.abs(speed - process.feed) <= slack)
    # Between two walls the tool's centre has the plain feed.
    plain = np.flatnonzero(is_wrong & (np.abs(speed - process.feed) <= slack))
    piece = matched.piece[matched.follows][plain]
    is_wrong[plain] = ~checker.are_between(rows[plain], piece, ends=True)
    for index in np.flatnonzero(is_wrong)[:1].tolist():
        wanted = process.feed * np.clip(speed[index] / process.feed, low[index], high[index])
        what = f"has a feed of {speed[index]:.4g} mm/s, the job asks for {wanted:.4g}"
        findings.add(motions, int(rows[index]), what)


def _contact_factors(
    drawing: Drawing, motions: Motions, matched: Matched, job: Job, digit: float
) -> tuple[FloatArray, FloatArray]:
    """Speed of the tool's centre per speed of the contact: lowest and highest, (F,) each.

    The tool's centre runs on an arc of radius R', the contact on one of radius R: the factor is
    R' / R (PIST, eq. 11). Around an outer corner R is 0, and the factor is the largest allowed.
    digit: rounding of a coordinate of the text, mm.
    """
    largest = job.process.max_feed_factor
    rows = matched.rows[matched.follows]
    piece, side = matched.piece[matched.follows], matched.side[matched.follows]
    distance = matched.distance[matched.follows]
    plane, arc = motions.plane, motions.plane.turn[rows] != 0
    contact = drawing.pieces.radius[piece]
    # The inside of a counter-clockwise arc is on its left.
    bend = drawing.pieces.turn[piece] * side
    factor = np.ones(len(rows))
    drawn = bend != 0
    factor[drawn] = 1 - bend[drawn] * distance[drawn] / contact[drawn]
    rolls = find_rolling(motions, matched)[matched.follows]
    factor[arc & rolls] = largest
    slack = np.zeros(len(rows))
    # An arc beside short lines stands for an arc that was drawn by them.
    fitted = np.flatnonzero(arc & ~drawn & ~rolls)
    radius = plane.radius[rows[fitted]]
    outside = _is_outside(drawing, motions, rows[fitted], piece[fitted])
    shift = np.where(outside, -distance[fitted], distance[fitted])
    factor[fitted] = radius / np.maximum(radius + shift, 1e-9)
    sagitta = radius * (1 - np.cos(plane.half[rows[fitted]]))
    slack[fitted] = factor[fitted] * 8 * digit / np.maximum(sagitta, digit)
    low, high = factor - slack, factor + slack
    high[may_roll(motions, matched, drawing.pieces)[matched.follows]] = largest
    # A short motion may lie beside two pieces of different radius.
    short = plane.length[rows] < SHORT_MM
    low[short], high[short] = _SLOWEST, largest
    # A short line may stand for a chord of an arc that was drawn by short lines.
    chord = ~arc & ~drawn & _is_short(motions, rows, job)
    low[chord], high[chord] = _SLOWEST, largest
    return np.clip(low, _SLOWEST, largest), np.clip(high, _SLOWEST, largest)


def _is_outside(drawing: Drawing, motions: Motions, rows: IntArray, piece: IntArray) -> BoolArray:
    """Whether an arc of the tool's centre lies farther from its own centre than the piece."""
    to_piece = drawing.pieces.middle[piece] - motions.plane.centre[rows]
    return np.asarray((to_piece**2).sum(axis=1) < motions.plane.radius[rows] ** 2)


def _is_short(motions: Motions, rows: IntArray, job: Job) -> BoolArray:
    """Whether a line is no longer than a chord of the largest arc that a job would replace."""
    return np.asarray(motions.plane.length[rows] <= math.sqrt(8 * job.tolerance.chord * 1e3))


def check_forces(task: Task, motions: Motions, matched: Matched, findings: Findings) -> None:
    """Finds motions that press with another force, or in another direction, than they should."""
    rows = matched.rows[matched.follows]
    newtons = task.job.process.force
    if newtons and "force" in task.job.post and not motions.force.any():
        option = task.job.post["force"]
        findings.leave("force", f'post.force = "{option}", no motion of the text has a force')
        return
    wanted = np.full(len(rows), newtons)
    force = motions.force[rows]
    if task.kind == "follow":
        rolls = find_rolling(motions, matched)[matched.follows]
        wanted[rolls & (2 * motions.plane.half[rows] > _SHARP)] = 0.0
        # The text may divide a sharp corner into arcs or chords that each turn by less.
        wanted[rolls & (force == 0)] = 0.0
    is_wrong = np.abs(force - wanted) > 0.01 + 1e-3 * newtons
    if task.operation.corner_radius:
        is_wrong &= force != 0
    for index in np.flatnonzero(is_wrong)[:1].tolist():
        what = f"presses with {force[index]:g} N, the job asks for {wanted[index]:g} N"
        findings.add(motions, int(rows[index]), what)


class Towards(NamedTuple):
    """Directions to the contour at the ends of N motions.

    rows: (N,) indices of the motions.
    direction: (N, 2) unit vectors.
    least: (N,) cosine of the largest angle that is within limits.
    """

    rows: IntArray
    direction: FloatArray
    least: FloatArray


def find_directions(drawing: Drawing, motions: Motions, matched: Matched, limit: float) -> Towards:
    """The directions to the contour at the end of each motion along one that is not short.

    limit: distance, mm, that a motion may have from its place in the drawing.
    """
    plane, pieces = motions.plane, drawing.pieces
    places = np.flatnonzero(matched.follows & (plane.length[matched.rows] >= SHORT_MM))
    rows, piece = matched.rows[places], matched.piece[places]
    to_contour = find_ways_to(plane.middle[rows], pieces, piece)
    on_left = np.sign(dot(normals_along(plane, rows, np.full(len(rows), 0.5)), to_contour))
    direction = normals_along(plane, rows, np.ones(len(rows))) * on_left[:, None]
    # A chord that leaves its arc by s turns away from it by 4 s / length.
    turn = _TURN + np.minimum(4 * limit / plane.length[rows], _MOST_TURN)
    return Towards(rows, direction, np.cos(turn))


def check_tool_turns(motions: Motions, towards: Towards, findings: Findings) -> None:
    """Finds motions at whose end tool x does not point at the contour (`tool.orient`)."""
    rotation = motions.rotation[towards.rows]
    tool_x = motions.axes[np.maximum(rotation, 0), :2, 0]
    wrong = (rotation >= 0) & (dot(tool_x, towards.direction) < towards.least)
    for row in towards.rows[wrong][:1].tolist():
        findings.add(motions, row, "ends with tool x away from the contour")


def check_force_directions(motions: Motions, towards: Towards, findings: Findings) -> None:
    """Finds motions that press in another direction than that of the contour."""
    pressed = motions.force_direction[towards.rows, :2]
    wrong = (motions.force[towards.rows] > 0) & (dot(pressed, towards.direction) < towards.least)
    for row in towards.rows[wrong][:1].tolist():
        findings.add(motions, row, "presses away from the contour")
