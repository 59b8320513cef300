"""`camgen verify PROGRAM --part DRAWING`: the stock proof of a program that was read.

The proof cuts the stock by the motions of the program and compares it with the part.
"""

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
    make_task,
    prove,
)
from camgen.cli.proven import Proven
from camgen.cli.say import Row, label_rows
from camgen.lang.programs import Executed
from camgen.lower.runs import plunge
from camgen.model.errors import InputError, JobError, NoSafeProgram
from camgen.model.job import Job
from camgen.model.part import Part
from camgen.model.program import Columns, MoveJ, ToolChange
from camgen.model.text import counted, join_short, short
from camgen.motion.corners import compute_corner_tolerance
from camgen.pipeline.stock import REMEDY_FOR_PIECES
from camgen.plan.page import place_on_page
from camgen.plan.steps import make_step_jobs, name_drills, split_part

#: mm: a smaller depth does not count.
_NO_BITE_MM = 0.0001
#: Maximum number of faults in the printed list.
_MAX_LISTED = 20
#: mm2: smaller areas of excess material are not listed.
_MIN_EXCESS = 0.01
_REMEDY = "correct the program, or say with --job what it is meant to do"


class StockVerdict(Struct, frozen=True):
    """The result of a stock proof for the terminal.

    rows: label and text of each row of the summary.
    fault_lines: a line for each fault and each warning, as one text.
    error: reason to refuse the program, None without one.
    """

    rows: tuple[tuple[str, str], ...]
    fault_lines: str
    error: NoSafeProgram | None


def check_stock(
    program: str,
    drawn: Part,
    job: Job,
    proven: Proven,
    place: Callable[[int], str],
) -> StockVerdict:
    """The stock proof of a program that was read.

    With a depth, the job says how the contours of the drawing are cut. Without one, the contours
    are the part, which is cut out as deep as the program goes.

    drawn: the drawing of the part.
    place: names file and line of a line that is counted through all files.

    Raises InputError if the drawing has no flat contours.
    """
    part = place_on_page(drawn, job)
    if part.solid is not None or part.curves or not part.contours:
        raise InputError(
            part.source,
            "has no flat contours to prove a program against",
            remedy="give the drawing of the part",
        )
    columns = Columns(proven.executed.body)
    if job.operations:
        step_parts, _ = split_part(part, job)
        pairs = zip(make_step_jobs(job), step_parts, strict=True)
        tasks = [make_task(part, step_job, step_part) for step_job, step_part in pairs]
    else:
        tasks = [_task(part, job, columns)]
    cuts = _list_cuts(program, proven.executed, columns, job)
    if proven.states_job:
        cuts = [replace(cut, stated=_state(cut, job)) for cut in cuts]
    designed = design(tasks, job.stock)
    proof = prove(cuts, designed, proven.dynamics, job.stock, proven.fixtures, on_arm=proven.on_arm)
    lines = _format_faults(proof.faults, place)
    for breach in proof.set_up.breaches:
        lines += f"{place(breach.line)}: warning: {breach.what} ({breach.remedy})\n"
    rows = _drop_tones(_rows(proof, tasks, cuts, job))
    return StockVerdict(rows, lines, _refuse(program, proof, place))


def _drop_tones(rows: Sequence[Row]) -> tuple[tuple[str, str], ...]:
    return tuple((label, text) for label, text, _ in rows)


def check_fixtures(
    program: str, job: Job, proven: Proven, place: Callable[[int], str]
) -> StockVerdict:
    """The distances of a program that was read from the fixtures, without a drawing."""
    assert proven.fixtures is not None
    cuts = _list_cuts(program, proven.executed, Columns(proven.executed.body), job)
    clearance, faults = examine_fixtures(cuts, proven.fixtures)
    rows = [*rows_of_fixtures(clearance, job), *label_rows("not judged", clearance.notes)]
    error = None
    if faults:
        what = f"{counted(len(faults), 'fault')} beside the fixtures, first: {faults[0].text}"
        error = NoSafeProgram(program, what, place(faults[0].line), _REMEDY)
    return StockVerdict(_drop_tones(rows), _format_faults(faults, place), error)


def _list_cuts(program: str, executed: Executed, columns: Columns, job: Job) -> list[Cut]:
    """The cuts of each tool of a program."""
    if job.operations:
        return _cuts_by_tool(program, executed, columns, job)
    return [_cut(program, executed, columns, replace(job, tool=name_drills([job])[0]))]


def _state(cut: Cut, job: Job) -> Stated:
    """The feeds and speeds that a job states for the tool of a cut."""
    jobs = make_step_jobs(job)
    feeds: list[float] = []
    down: list[float] = []
    speeds: set[float] = set()
    for step, tool in zip(jobs, name_drills(jobs), strict=True):
        process = step.process
        if job.operations and tool != cut.tool:
            continue
        feeds.append(process.feed * process.max_feed_factor)
        down.append(process.feed if step.operation.kind == "drill" else plunge(process))
        speeds.add(process.spindle)
    return Stated(max(feeds), max(down), tuple(sorted(speeds - {0.0})))


def _task(part: Part, job: Job, columns: Columns) -> Task:
    if job.operation.depth:
        return Task(job, part)
    cutting = ~columns.moves_are(MoveJ) & columns.posed
    depth = max(0.0, float(-columns.ends[cutting, 2].min(initial=0.0)))
    return Task(replace(job, operation=replace(job.operation, kind="follow", depth=depth)), part)


def _cuts_by_tool(program: str, executed: Executed, columns: Columns, job: Job) -> list[Cut]:
    """The cuts of each tool of a program.

    Raises JobError if the program does not show which tools of the job it uses.
    """
    used = name_drills(make_step_jobs(job))
    changes = np.flatnonzero(columns.are(ToolChange)).tolist()
    whole = _cut(program, executed, columns, replace(job, tool=used[0]))
    if not changes:
        if used.count(used[0]) < len(used):
            raise JobError(
                "job",
                "the job has several tools, and the program changes none",
                "[[tools]]",
                "give a job with the operations of this program alone",
            )
        return [whole]
    cuts = []
    for start, end in zip(changes, [*changes[1:], len(executed.body)], strict=True):
        change = executed.body[start]
        assert isinstance(change, ToolChange)
        tool = next((tool for tool in used if tool.number == change.number), None)
        if tool is None:
            line = executed.lines[start]
            raise JobError(
                "job",
                f"line {line} changes to tool {change.number}, which no operation names",
                "[[tools]]",
                "give its number to one of them",
            )
        body, lines = executed.body[start:end], executed.lines[start:end]
        cuts.append(replace(whole, body=body, lines=lines, tool=tool, name=f"tool {change.number}"))
    return cuts


def _cut(program: str, executed: Executed, columns: Columns, job: Job) -> Cut:
    """The cut of a whole program with the tool of the job.

    A program without rapid motions travels at `process.travel` on straight lines.
    """
    rapid = columns.moves_are(MoveJ) & columns.posed
    process = job.process
    slower = process.feed * process.max_feed_factor < process.travel_speed
    travel = process.travel_speed if slower and not rapid[1:].any() else math.inf
    return Cut(
        executed.body,
        executed.lines,
        job.tool,
        Path(program).name,
        travel=travel,
        chord=job.tolerance.chord,
        corner=compute_corner_tolerance(job, job.operation.kind),
    )


def rows_of_build(proof: StockProof) -> list[Row]:
    """Rows of the summary of a build: stock, excess material, loose parts and set-up."""
    tone = "look" if proof.bite is None else "good"
    loose = [fault.text for fault in proof.loose if fault.serious]
    return [
        ("stock", f"{_format_result(proof)}; {volume(proof.volume)} removed", tone),
        *label_rows("excess", _list_excess(proof)),
        *label_rows("loose", loose, "look"),
        *label_rows("stock", proof.notes, "look"),
        *label_rows("set-up", _list_examined(proof), "look"),
    ]


def volume(mm3: float) -> str:
    """A volume as text: in cm3, or in mm3 below 1 cm3."""
    return f"{short(mm3 / 1000, 1)} cm3" if mm3 >= 1000 else f"{short(mm3, 0)} mm3"


def rows_of_fixtures(clearance: Clearance | None, job: Job) -> list[Row]:
    """The row of the summary on the distances from the fixtures, and on unknown holders."""
    if clearance is None:
        return []
    names = counted(clearance.fixtures, "fixture")
    if clearance.hits:
        return [("fixtures", f"{names}, {counted(len(clearance.hits), 'motion')} too near", "bad")]
    aside = f"{short(clearance.aside, 2)} mm beside" if clearance.aside < math.inf else ""
    above = f"{short(clearance.above, 2)} mm above" if clearance.above < math.inf else ""
    least = list(filter(None, (aside, above)))
    distances = f"keeps {' and '.join(least)} them" if least else "is nowhere near"
    bodies, tone = "the tool with its holder", "good"
    if any(step.tool.holder is None for step in make_step_jobs(job)):
        bodies, tone = "the tool", "look"
        distances += "; its holder is not judged, tool.holder is not set"
    return [("fixtures", f"{names}: {bodies} {distances}", tone)]


def _rows(proof: StockProof, tasks: Sequence[Task], cuts: Sequence[Cut], job: Job) -> list[Row]:
    tools = dict.fromkeys(f"{cut.tool.kind} of {short(cut.tool.diameter, 3)} mm" for cut in cuts)
    depth = short(max(task.job.operation.depth for task in tasks), 3)
    rows = [
        ("stock", f"{', '.join(tools)}, {depth} mm deep: {_format_result(proof)}", "plain"),
        ("removed", volume(proof.volume), "plain"),
        *label_rows("excess", _list_excess(proof)),
    ]
    for note in proof.notes:
        rows.append(("not judged" if "not" in note else "note", note, "plain"))
    rows += rows_of_fixtures(proof.clearance, job)
    return rows + label_rows("set-up", _list_examined(proof))


def _list_examined(proof: StockProof) -> list[str]:
    """A line on the limits of tools and stock that were examined, and on those that were not."""
    set_up = proof.set_up
    if not set_up.examined:
        return []
    exceeded = counted(len(set_up.breaches), "limit") if set_up.breaches else "no limit"
    text = f"{exceeded} exceeded: {', '.join(set_up.examined)}"
    if set_up.unexamined:
        text += f"; not examined, for keys that are not set: {', '.join(set_up.unexamined)}"
    return [text]


def _format_result(proof: StockProof) -> str:
    """Numbers of faults, and the largest cut of rounded corners into the part."""
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
    counts = [counted(len(faults), noun, plural) for noun, plural, faults in kinds if faults]
    text = ", ".join(counts) or "no gouge, no rapid motion in material"
    if proof.bite is None:
        return f"{text}, of the programmed path only"
    if proof.bite < _NO_BITE_MM:
        return f"{text}, rounded corners included"
    return f"{text}; rounded corners cut at most {short(proof.bite, 4)} mm into the part"


def _list_excess(proof: StockProof) -> list[str]:
    """A line for each depth layer with excess material; layers with equal areas share a line."""
    depths_of: dict[str, list[float]] = {}
    for level in proof.levels:
        excess = level.excess
        if excess.area < _MIN_EXCESS:
            continue
        areas = (
            (excess.corners, "in inner corners and narrow places"),
            (excess.tabs, "in tabs"),
            (excess.untaken, "of paths that are left out"),
        )
        parts = [f"{short(mm2, 2)} mm2 {cause}" for mm2, cause in areas if mm2 >= _MIN_EXCESS]
        if excess.unexplained.area >= _MIN_EXCESS and excess.place is not None:
            size = f"{short(excess.unexplained.area, 2)} mm2 else, up to {short(excess.size, 2)} mm"
            parts.append(f"{size} wide at {join_short(excess.place, 2)}")
        depths_of.setdefault(", ".join(parts), []).append(level.bottom)
    return [f"at z {join_short(depths, 3)}: {text}" for text, depths in depths_of.items()]


def _format_faults(faults: Sequence[Fault], place: Callable[[int], str]) -> str:
    """A line for each of the first `_MAX_LISTED` faults, and one for the number of others."""
    lines = ""
    for fault in faults[:_MAX_LISTED]:
        remark = "" if fault.serious else "remark: "
        lines += f"{place(fault.line)}: {remark}{fault.text}\n"
    more = len(faults) - _MAX_LISTED
    if more > 0:
        lines += f"and {counted(more, 'more fault')} of the stock proof\n"
    return lines


def _refuse(program: str, proof: StockProof, place: Callable[[int], str]) -> NoSafeProgram | None:
    refused = proof.refused
    if not refused:
        return None
    first = refused[0]
    where = "in the material" if len(refused) > len(proof.fixtures) else "beside the fixtures"
    what = f"{counted(len(refused), 'fault')} {where}, first: {first.text}"
    remedy = REMEDY_FOR_PIECES if first.kind == "unheld" else _REMEDY
    return NoSafeProgram(program, what, place(first.line), remedy)
