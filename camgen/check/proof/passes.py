"""The order of passes and paths, and contours that are run more often than the job asks for."""

from __future__ import annotations

import numpy as np

from camgen.check.proof.contours import ContourChecker, Matched
from camgen.check.proof.findings import Findings
from camgen.check.proof.heights import tab_top
from camgen.check.proof.matching import Covered
from camgen.check.proof.motions import Motions
from camgen.check.proof.pieces import IntArray
from camgen.check.proof.tasks import BESIDE, Task
from camgen.check.proof.visits import followed_part
from camgen.model.pose import FloatArray

#: The index of a motion that is not there.
_NEVER = np.iinfo(np.intp).max
#: Depths that differ by less, mm, may be one: a text has three digits.
_SAME_DEPTH_MM = 5e-3
#: A contour may be run again for this length, mm, and this share of it.
_AGAIN_MM, _AGAIN_SHARE = 0.2, 0.01


def check_pass_order(
    checker: ContourChecker, matched: Matched, levels: IntArray, findings: Findings
) -> None:
    """Finds a pass that begins before the pass above it, on the same path beside the same piece.

    levels: (W,) index of the pass at whose depth a motion runs, -1 for a slope.
    """
    depths = np.array(checker.task.depths)
    if len(depths) < 2:
        return
    covered = matched.covered
    path = checker.motions.path[covered.motion]
    far = matched.distance[matched.place] > checker.task.distances[-1] + 1e-9
    group = (path + 1) * 2 * len(checker.pieces) + 2 * covered.piece + far
    _find_early(
        checker.motions,
        covered.motion,
        group,
        levels[matched.place],
        (depths, checker.limit),
        findings,
    )


def check_path_order(
    task: Task, motions: Motions, rows: IntArray, levels: IntArray, slack: float, findings: Findings
) -> None:
    """Finds a path that runs a pass before the pass above it.

    rows: (W,) the working motions.
    levels: (W,) index of the pass at whose depth a motion runs, -1 for a slope.
    slack: deviation of a height, mm.
    """
    depths = np.array(task.depths)
    if len(depths) > 1:
        _find_early(motions, rows, motions.path[rows], levels, (depths, slack), findings)


def _find_early(
    motions: Motions,
    rows: IntArray,
    group: IntArray,
    levels: IntArray,
    passes: tuple[FloatArray, float],
    findings: Findings,
) -> None:
    """Finds the first pass of a group of motions that begins before the pass above it.

    passes: depths, mm, and the difference by which the digits of the text distinguish them.
    """
    depths, slack = passes
    kept = np.flatnonzero(levels >= 0)
    keys, number = np.unique(group[kept], return_inverse=True)
    first = np.full((len(keys), len(depths)), _NEVER)
    np.minimum.at(first, (number, levels[kept]), rows[kept])
    early = (first[:, 1:] < first[:, :-1]) & (first[:, :-1] < _NEVER)
    early &= np.diff(depths) > slack
    for key, index in np.argwhere(early)[:1].tolist():
        what = f"runs pass {index + 2} before the pass above it"
        findings.add(motions, int(first[key, index + 1]), what)


def check_repeats(
    checker: ContourChecker, covered: Covered, depth: float, findings: Findings
) -> None:
    """Finds contours that are run again at one depth, by more than the overlap.

    covered: stretches at this depth, at one distance from the contours.
    """
    task, pieces = checker.task, checker.pieces
    if task.kind not in BESIDE:
        return
    count = len(checker.drawing.contours)
    share = np.bincount(covered.piece, covered.high - covered.low, len(pieces))
    run = np.bincount(covered.piece, covered.length, len(pieces))
    # Several passes may have one height, as far as the digits of the text show.
    times = int((np.abs(np.array(task.depths) - depth) <= _SAME_DEPTH_MM).sum())
    again = run * np.maximum(share - times, 0) / np.maximum(share, 1)
    total = np.bincount(pieces.owner, again, count)
    whole = np.bincount(pieces.owner, run, count)
    allowed = task.operation.overlap + _AGAIN_MM + _AGAIN_SHARE * whole
    for lead in (task.operation.lead_in, task.operation.lead_out):
        allowed = allowed + followed_part(lead, checker.limit)
    if abs(tab_top(task) + depth) <= _SAME_DEPTH_MM and task.operation.entry != "plunge":
        # A ramp that begins over a tab runs level there, at the depth of the pass before.
        allowed = allowed + task.operation.tab_width + task.job.tool.diameter
        allowed = allowed + 2 * task.operation.tab_height
    repeated = total > allowed
    if repeated.any():
        # A channel a little wider than the tool is run along both walls, nearly in one line.
        both = checker.are_between(covered.motion, covered.piece)
        twice = np.bincount(pieces.owner[covered.piece], covered.length * both, count)
        repeated &= total - twice / 2 > allowed
    for index in np.flatnonzero(repeated)[:1].tolist():
        name = checker.drawing.contours[index].id
        findings.miss(f"contour {name} is run again for {total[index]:.3f} mm, depth {depth:g} mm")


def check_inside_first(checker: ContourChecker, matched: Matched, findings: Findings) -> None:
    """Finds a contour that is worked before one inside it (`operation.inside_first`)."""
    task, tour = checker.task, checker.task.job.tour
    decided = tour.method == "as-drawn" or tour.layers or tour.order
    if decided or not task.operation.inside_first or not len(task.enclosed):
        return
    contour = checker.pieces.owner[matched.piece[matched.follows]]
    motion = matched.rows[matched.follows]
    first = np.full(len(checker.drawing.contours), _NEVER)
    last = np.full(len(first), -1)
    np.minimum.at(first, contour, motion)
    np.maximum.at(last, contour, motion)
    inner, outer = task.enclosed[:, 0], task.enclosed[:, 1]
    early = (last[outer] >= 0) & (last[outer] < first[inner]) & (first[inner] < _NEVER)
    # One path may run beside both, where the tool does not pass between them.
    path = checker.motions.path
    early[early] = path[last[outer[early]]] != path[first[inner[early]]]
    for index in np.flatnonzero(early)[:1].tolist():
        name = checker.drawing.contours[int(inner[index])].id
        what = f"works around contour {name}, which is worked later"
        findings.add(checker.motions, int(first[outer[index]]), what)
