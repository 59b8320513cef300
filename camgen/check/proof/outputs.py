"""Outputs, the spindle and the waits for them; motions to joint values."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from camgen.check.proof.findings import Findings
from camgen.check.proof.motions import Motions
from camgen.check.proof.pieces import BoolArray, IntArray
from camgen.model.job import Job, ProcessTable
from camgen.model.program import Columns, Instruction, Output, Wait

if TYPE_CHECKING:
    from camgen.check.proof.tasks import Task

#: A wait may differ by this, s: a text gives it with a few digits.
_DWELL_S = 1e-2


def process_signal(process: ProcessTable) -> str:
    """Name of the output that is on along a path, or ""."""
    if process.signal == "auto":
        return "" if process.spindle > 0 else "process"
    return process.signal


def plunge_speed(process: ProcessTable) -> float:
    """Speed of going down to the contact, mm/s."""
    return process.plunge or process.feed / 3


def check_outputs(task: Task, motions: Motions, rows: IntArray, findings: Findings) -> None:
    """Finds motions that work with the process output off, or at another spindle speed."""
    signal = process_signal(task.job.process)
    if signal:
        findings.add_first(motions, rows[~motions.on[rows]], f"works with output {signal} off")
    check_spindle(task, motions, rows, findings)


def check_spindle(task: Task, motions: Motions, rows: IntArray, findings: Findings) -> None:
    """Finds motions during which the spindle does not turn at the speed of the job."""
    process = task.job.process
    if process.spindle > 0:
        turning = np.abs(motions.spindle[rows] - process.spindle) <= 1e-3 * process.spindle
        switched = (motions.spindle[rows] == 1.0) & ~turning
        if switched.any():
            findings.leave("spindle speed", "the text only switches the spindle on and off")
            turning |= switched
        for row in rows[~turning][:1].tolist():
            what = f"works at {motions.spindle[row]:g} rpm, process.spindle is {process.spindle:g}"
            findings.add(motions, row, what)


def check_switches(
    job: Job, body: Sequence[Instruction], of_task: BoolArray, findings: Findings
) -> None:
    """Finds an output or spindle that is on at the end, or on without the wait of `process.dwell`.

    of_task: (M,) which motions belong to the task; an output belongs to the motion after it.
    """
    columns = Columns(body)
    names = {process_signal(job.process)} - {""}
    if job.process.spindle > 0:
        names.add("spindle")
    for name in sorted(names):
        switches = columns.alike(Output, partial(_sets, name))
        for output in columns.pick(np.flatnonzero(switches)[-1:]):
            if output.value != 0:
                findings.miss(f"output {name} is on at the end of the program")
    on = columns.alike(Output, lambda item: item.signal in names and item.value > 0)
    places = np.flatnonzero(on)
    following = np.searchsorted(columns.at, places)
    kept = np.append(of_task, False)[following]
    places, following = places[kept], following[kept]
    # Waits between the output and the motion after it.
    waits = np.flatnonzero(columns.are(Wait))
    total = np.cumsum([0.0, *(item.seconds for item in columns.pick(waits))])
    waited = total[np.searchsorted(waits, columns.at[following])]
    waited -= total[np.searchsorted(waits, places)]
    for index in np.flatnonzero(np.abs(waited - job.process.dwell) > _DWELL_S)[:1].tolist():
        name = body[int(places[index])].signal  # type: ignore[union-attr]
        what = f"output {name} is switched on with a wait of {waited[index]:g} s"
        findings.miss(f"{what}, process.dwell is {job.process.dwell:g} s")


def _sets(signal: str, output: Output) -> bool:
    return output.signal == signal


def is_switched_in_air(job: Job) -> bool:
    """Whether the process output is switched above the part, and not in contact with it."""
    if job.process.switch == "auto":
        return bool(job.operation.depth or job.process.force)
    return job.process.switch == "air"


def check_joint_motions(job: Job, motions: Motions, unknown: BoolArray, findings: Findings) -> None:
    """Finds motions to or from joint values, `unknown` (M,), that press or have the process on.

    Their way is not known from the text. Reach and collision of the arm are proven elsewhere.
    """
    works = motions.force > 0
    if not is_switched_in_air(job):
        works = works | motions.on
    for row in np.flatnonzero(unknown & motions.joint & works)[:1].tolist():
        findings.add(motions, row, "goes to joint values with the process on")
