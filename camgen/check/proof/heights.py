"""Depths of the passes, and the heights between which a tool may go down on a slope."""

from __future__ import annotations

import math

import numpy as np

from camgen.check.proof.findings import Findings
from camgen.check.proof.motions import Motions
from camgen.check.proof.pieces import IntArray
from camgen.check.proof.tasks import Task
from camgen.model.job import OperationTable
from camgen.model.pose import FloatArray


def find_levels(task: Task, motions: Motions, rows: IntArray, slack: float) -> IntArray:
    """(W,) index of the pass at whose depth each of the motions `rows` runs, -1 for a slope.

    The top of a tab follows a slope upwards. It does not count, though it may be as high as a pass.
    """
    start, end = motions.start[rows, 2], motions.end[rows, 2]
    heights = -np.array(task.depths)
    index = np.abs(end[:, None] - heights).argmin(axis=1)
    level = heights[index]
    exact = (np.abs(end - level) <= slack) & (np.abs(start - level) <= slack)
    sloped = np.flatnonzero(np.abs(end - start) > slack)
    last = np.searchsorted(sloped, np.arange(len(rows)), side="right") - 1
    rises = np.append(end[sloped] > start[sloped], False)[last]
    exact &= ~(rises & (np.abs(end - tab_top(task)) <= slack))
    return np.where(exact, index, -1)


def tab_top(task: Task) -> float:
    """Height of the top of the tabs in the work frame, mm; negative infinity without tabs."""
    operation = task.operation
    if not (operation.tabs or operation.tab_spacing):
        return -np.inf
    return operation.tab_height - operation.depth


def tab_slopes(operation: OperationTable) -> tuple[float, float]:
    """Lengths of the slopes before and after a tab, mm: up by 45 degrees, down as an entry."""
    angle = 45.0 if operation.entry == "plunge" else operation.entry_angle
    return operation.tab_height, operation.tab_height / math.tan(math.radians(angle))


def check_heights(
    task: Task, motions: Motions, rows: IntArray, levels: IntArray, slack: float, findings: Findings
) -> None:
    """Finds working motions at a depth that is not one of the passes."""
    start, end = motions.start[rows, 2], motions.end[rows, 2]
    deepest = -max(task.depths)
    low = np.minimum(start, end)
    for index in np.flatnonzero(low < deepest - slack)[:1].tolist():
        what = f"is {deepest - low[index]:.4g} mm deeper than the job asks for"
        findings.add(motions, int(rows[index]), what)
    allowed = (levels >= 0) | (low < deepest - slack)
    if task.operation.entry != "plunge":
        allowed |= np.maximum(start, end) <= slack
    allowed |= np.maximum(start, end) <= tab_top(task) + slack
    if task.job.process.force:
        lift = min(task.job.process.retract, task.job.process.clearance)
        allowed |= _are_at(start, end, lift + np.append(0.0, -np.array(task.depths)), slack)
    for index in np.flatnonzero(~allowed)[:1].tolist():
        what = f"works at a height of {end[index]:.4g} mm, where no pass is"
        findings.add(motions, int(rows[index]), what)


def _are_at(start: FloatArray, end: FloatArray, heights: FloatArray, slack: float) -> FloatArray:
    deviation = np.maximum(np.abs(start[:, None] - heights), np.abs(end[:, None] - heights))
    return np.asarray(deviation.min(axis=1) <= slack)
