"""``camgen verify PROGRAM --part DRAWING``: what a program does to the material that the part is cut from."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from camgen.check.stock import (
    Clearance,
    Cut,
    Fault,
    Stated,
    StockProof,
    Task,
    design,
    examine_fixtures,
    prove,
    task_on,
)
from camgen.cli.proven import Proven
from camgen.lower.runs import plunge
from camgen.model.errors import InputError, JobError, NoSafeProgram
from camgen.model.job import Job
from camgen.model.part import Part
from camgen.model.program import Columns, MoveJ, ToolChange
from camgen.model.text import counted, short
from camgen.motion.corners import corner_tolerance
from camgen.pipeline.stock import REMEDY_FOR_PIECES
from camgen.plan.page import on_page
from camgen.plan.steps import job_of, name_drills, share_out
from camgen.post import Reading
from camgen.read.programs import Executed

#: mm: a smaller depth does not count.
_NO_BITE_MM = 0.0001
#: So many faults of a kind are listed.
_LISTED = 20
_MEND = "mend the program, or say with --job what it is meant to do"


class StockSays(Struct, frozen=True):
    """rows: of the summary. told: a line for each fault. error: for which the program is refused, None without one."""

    rows: tuple[tuple[str, str], ...]
    told: str
    error: NoSafeProgram | None


def judge(
    program: str,
    drawn: Part,
    job: Job,
    proven: Proven,
    place: Callable[[int], str],
) -> StockSays:
    """The stock proof of a program that was read.

    drawn: the drawing of the part.
    place: names file and line of a line that is counted through all files.

    With a depth the job says what is done to the contours of the drawing; without one they are the part, cut around
    as deep as the program goes.
    """
    part = on_page(drawn, job)
    if part.solid is not None or part.curves or not part.contours:
        remedy = "give the drawing of the part"
        raise InputError(
            part.source, "has no flat contours to prove a program against", remedy=remedy
        )
    reading = proven.reading
    columns = Columns(reading.body)
    if job.operations:
        tasks = [task_on(part, job_of(job, one.step), one.part) for one in share_out(part, job)[0]]
    else:
        tasks = [_task(part, job, columns)]
    cuts = _list_cuts(program, reading, columns, job)
    if proven.states_job:
        cuts = [replace(cut, stated=_state(cut, job)) for cut in cuts]
    designed = design(tasks, job.stock)
    proof = prove(cuts, designed, proven.dynamics, job.stock, proven.fixtures, on_arm=proven.on_arm)
    warnings = [
        f"{place(breach.line)}: warning: {breach.what} ({breach.remedy})\n"
        for breach in proof.set_up.breaches
    ]
    lines = "".join([_tell(proof.faults, place), *warnings])
    return StockSays(tuple(_rows(proof, tasks, cuts, job)), lines, _refuse(program, proof, place))


def judge_fixtures(
    program: str, job: Job, proven: Proven, place: Callable[[int], str]
) -> StockSays:
    """The distances of a program that was read from the fixtures, without a drawing."""
    assert proven.fixtures is not None
    cuts = _list_cuts(program, proven.reading, Columns(proven.reading.body), job)
    clearance, faults = examine_fixtures(cuts, proven.fixtures)
    rows = [(label, text) for label, text, _ in rows_of_fixtures(clearance, job)]
    rows += [("not judged", note) for note in clearance.notes]
    error = None
    if faults:
        what = f"{counted(len(faults), 'fault')} beside the fixtures, first: {faults[0].text}"
        error = NoSafeProgram(program, what, place(faults[0].line), _MEND)
    return StockSays(tuple(rows), _tell(faults, place), error)


def _list_cuts(program: str, reading: Reading | Executed, columns: Columns, job: Job) -> list[Cut]:
    """The cuts of each tool of a program."""
    if job.operations:
        return _cuts_by_tool(program, reading, columns, job)
    return [_cut(program, reading, columns, replace(job, tool=name_drills([job])[0]))]


def _state(cut: Cut, job: Job) -> Stated:
    """The feeds and speeds that a job states for the tool of a cut."""
    jobs = [job_of(job, step) for step in job.operations] or [job]
    steps = [
        step
        for step, tool in zip(jobs, name_drills(jobs), strict=True)
        if tool == cut.tool or not job.operations
    ]
    feeds = [step.process.feed * step.process.max_feed_factor for step in steps]
    down = [
        step.process.feed if step.operation.kind == "drill" else plunge(step.process)
        for step in steps
    ]
    speeds = {step.process.spindle for step in steps if step.process.spindle > 0}
    return Stated(max(feeds), max(down), tuple(sorted(speeds)))


def _task(part: Part, job: Job, columns: Columns) -> Task:
    if job.operation.depth:
        return Task(job, part)
    cutting = ~columns.moves_are(MoveJ) & columns.posed
    depth = max(0.0, float(-columns.ends[cutting, 2].min(initial=0.0)))
    return Task(replace(job, operation=replace(job.operation, kind="follow", depth=depth)), part)


def _cuts_by_tool(
    program: str, reading: Reading | Executed, columns: Columns, job: Job
) -> list[Cut]:
    """What each tool of a program does. JobError where it does not say which tools of the job it has."""
    used = name_drills([job_of(job, step) for step in job.operations])
    changes = np.flatnonzero(columns.are(ToolChange)).tolist()
    whole = _cut(program, reading, columns, replace(job, tool=used[0]))
    if not changes:
        if any(tool != used[0] for tool in used):
            what = "the job has several tools, and the program changes none"
            raise JobError(
                "job", what, "[[tools]]", "give a job with the operations of this program alone"
            )
        return [whole]
    cuts = []
    for start, end in zip(changes, [*changes[1:], len(reading.body)], strict=True):
        change = reading.body[start]
        assert isinstance(change, ToolChange)
        tool = next((tool for tool in used if tool.number == change.number), None)
        if tool is None:
            what = f"line {reading.lines[start]} changes to tool {change.number}, which no operation names"
            raise JobError("job", what, "[[tools]]", "give its number to one of them")
        body, lines = reading.body[start:end], reading.lines[start:end]
        cuts.append(replace(whole, body=body, lines=lines, tool=tool, name=f"tool {change.number}"))
    return cuts


def _cut(program: str, reading: Reading | Executed, columns: Columns, job: Job) -> Cut:
    """Controllers without a rapid motion travel at process.travel on straight lines."""
    rapid = columns.moves_are(MoveJ) & columns.posed
    process = job.process
    slower = process.feed * process.max_feed_factor < process.travel_speed
    travel = process.travel_speed if slower and not rapid[1:].any() else np.inf
    return Cut(
        reading.body,
        reading.lines,
        job.tool,
        Path(program).name,
        travel=float(travel),
        chord=job.tolerance.chord,
        corner=corner_tolerance(job, job.operation.kind),
    )


def rows_of_build(proof: StockProof) -> list[tuple[str, str, str]]:
    """The summary of a build says what its program does to the material."""
    tone = "look" if proof.bite is None else "good"
    rows = [("stock", f"{_sum(proof)}; {volume(proof.volume)} removed", tone)]
    rows += [("excess", text, "plain") for text in _excess(proof)]
    rows += [("loose", one.text, "look") for one in proof.loose if one.serious]
    rows += [("stock", note, "look") for note in proof.notes]
    return rows + [("set-up", text, "look") for text in _tell_examined(proof)]


def volume(mm3: float) -> str:
    """In mm3 below 1 cm3."""
    return f"{short(mm3 / 1000, 1)} cm3" if mm3 >= 1000 else f"{short(mm3, 0)} mm3"


def rows_of_fixtures(clearance: Clearance | None, job: Job) -> list[tuple[str, str, str]]:
    """The row of the summary on the distances from the fixtures, and on unknown holders."""
    if clearance is None:
        return []
    names = counted(clearance.fixtures, "fixture")
    if clearance.hits:
        return [("fixtures", f"{names}, {counted(len(clearance.hits), 'motion')} too near", "bad")]
    least = [
        f"{short(mm, 2)} mm {where}"
        for mm, where in ((clearance.aside, "beside"), (clearance.above, "above"))
        if mm < math.inf
    ]
    distances = f"keeps {' and '.join(least)} them" if least else "is nowhere near"
    tools = [step.tool for step in job.operations] or [job.tool]
    bodies, tone = "the tool with its holder", "good"
    if any(tool.holder is None for tool in tools):
        bodies, tone = "the tool", "look"
        distances += "; its holder is not judged, tool.holder is not set"
    return [("fixtures", f"{names}: {bodies} {distances}", tone)]


def _rows(
    proof: StockProof, tasks: Sequence[Task], cuts: Sequence[Cut], job: Job
) -> list[tuple[str, str]]:
    tools = dict.fromkeys(f"{cut.tool.kind} of {short(cut.tool.diameter, 3)} mm" for cut in cuts)
    depth = short(max(task.job.operation.depth for task in tasks), 3)
    rows = [("stock", f"{', '.join(tools)}, {depth} mm deep: {_sum(proof)}")]
    rows.append(("removed", volume(proof.volume)))
    rows += [("excess", text) for text in _excess(proof)]
    rows += [("not judged" if "not" in note else "note", note) for note in proof.notes]
    rows += [(label, text) for label, text, _ in rows_of_fixtures(proof.clearance, job)]
    return rows + [("set-up", text) for text in _tell_examined(proof)]


def _tell_examined(proof: StockProof) -> list[str]:
    """The examined limits of tools and stock, and the others."""
    set_up = proof.set_up
    if not set_up.examined:
        return []
    exceeded = counted(len(set_up.breaches), "limit") if set_up.breaches else "no limit"
    text = f"{exceeded} exceeded: {', '.join(set_up.examined)}"
    if set_up.unexamined:
        text += f"; not examined, for keys that are not set: {', '.join(set_up.unexamined)}"
    return [text]


def _sum(proof: StockProof) -> str:
    kinds = (
        ("gouge", "gouges", proof.gouges),
        ("rounded corner that cuts the part", "rounded corners that cut the part", proof.corners),
        ("rapid motion in material", "rapid motions in material", proof.rapids),
        (
            "motion with the holder in material",
            "motions with the holder in material",
            proof.holders,
        ),
        ("cut with a wrong spindle", "cuts with a wrong spindle", proof.spindles),
        ("motion too near to a fixture", "motions too near to a fixture", proof.fixtures),
        ("part or bridge that does not hold", "parts or bridges that do not hold", proof.unheld),
    )
    found = [counted(len(faults), one, many) for one, many, faults in kinds if faults]
    faults = ", ".join(found) or "no gouge, no rapid motion in material"
    if proof.bite is None:
        return f"{faults}, of the programmed path only"
    if proof.bite < _NO_BITE_MM:
        return f"{faults}, rounded corners included"
    return f"{faults}; rounded corners cut at most {short(proof.bite, 4)} mm into the part"


def _excess(proof: StockProof) -> list[str]:
    """A line for each level at which something is left, the same ones together."""
    found: dict[str, list[float]] = {}
    for level in proof.levels:
        left = level.excess
        if left.area < 0.01:
            continue
        parts = (
            [f"{short(left.corners, 2)} mm2 in inner corners and narrow places"]
            if left.corners >= 0.01
            else []
        )
        parts += [f"{short(left.tabs, 2)} mm2 in tabs"] if left.tabs >= 0.01 else []
        parts += (
            [f"{short(left.untaken, 2)} mm2 of paths that are left out"]
            if left.untaken >= 0.01
            else []
        )
        if left.unexplained.area >= 0.01 and left.place is not None:
            at = " ".join(short(v, 2) for v in left.place)
            parts.append(
                f"{short(left.unexplained.area, 2)} mm2 else, up to {short(left.size, 2)} mm wide at {at}"
            )
        found.setdefault(", ".join(parts), []).append(level.bottom)
    return [
        f"at z {' '.join(short(z, 3) for z in depths)}: {text}" for text, depths in found.items()
    ]


def _tell(faults: Sequence[Fault], place: Callable[[int], str]) -> str:
    lines = [
        f"{place(one.line)}: {'' if one.serious else 'remark: '}{one.text}\n"
        for one in faults[:_LISTED]
    ]
    more = len(faults) - _LISTED
    return "".join(lines) + (
        f"and {counted(more, 'more fault')} of the stock proof\n" if more > 0 else ""
    )


def _refuse(program: str, proof: StockProof, place: Callable[[int], str]) -> NoSafeProgram | None:
    refused = proof.refused
    if not refused:
        return None
    first = refused[0]
    where = "in the material" if len(refused) > len(proof.fixtures) else "beside the fixtures"
    what = f"{counted(len(refused), 'fault')} {where}, first: {first.text}"
    remedy = REMEDY_FOR_PIECES if first.kind == "unheld" else _MEND
    return NoSafeProgram(program, what, place(first.line), remedy)
