"""The operations of camgen, as the entry points `camgen.operations` name them."""

from __future__ import annotations

from collections.abc import Callable

from msgspec.structs import replace

from camgen.model.cell import Cell
from camgen.model.errors import JobError
from camgen.model.job import Job
from camgen.model.part import Note, Part
from camgen.plan import Operation, Plan, Watch, find_part_kind
from camgen.plan.unused import check_clearance, check_idle, check_roll, check_use


def _plan_flat(
    name: str, make: Callable[[Part, Job], Plan]
) -> Callable[[Part, Job, Cell | None, Watch], Plan]:
    """The plan function of the operation `name`, which needs only the part and its job."""

    def plan_part(part: Part, job: Job, cell: Cell | None, _watch: Watch) -> Plan:
        check_idle(job, f"a {find_part_kind(part)}")
        check_use(job, name)
        check_roll(job, cell)
        check_clearance(job, name)
        if job.operation.planner == "image":
            return _plan_in_image(part, job)
        check_idle(job, "the geometric planner")
        return make(part, job)

    return plan_part


def _plan_in_image(part: Part, job: Job) -> Plan:
    if part.raster is None:
        raise JobError(
            "job",
            '"image" plans in a picture, and this is not one',
            "operation.planner",
            'set operation.planner to "geometric"',
        )
    if job.operation.kind not in ("auto", "follow"):
        raise JobError(
            "job",
            f"the image-space planner follows contours, it cannot {job.operation.kind}",
            "operation.planner",
            'set operation.planner to "geometric"',
        )
    if job.operation.finish != 0:
        raise JobError(
            "job",
            "the image-space planner makes no last passes",
            "operation.finish",
            'leave it out, or set operation.planner to "geometric"',
        )
    from camgen.plan.image_space import image_space  # noqa: PLC0415 (it loads OpenCV)

    raster = part.raster
    paths, notes = image_space(raster.mask, raster.work_from_view, job, borders=raster.borders)
    return Plan(part, paths, (*part.notes, *notes))


def _follow(part: Part, job: Job) -> Plan:
    if job.operation.side == "on":
        check_use(job, "trace")
        return _trace(part, job)
    from camgen.plan.follow import follow  # noqa: PLC0415 (shapely is loaded only by what needs it)

    recovered, notes = _recover(part, job)
    paths, more = follow(recovered, job)
    return Plan(part, paths, (*part.notes, *notes, *more))


def _trace(part: Part, job: Job) -> Plan:
    # shapely takes long to import.
    from camgen.plan.trace import share_edges, trace, with_few_lifts  # noqa: PLC0415

    recovered, notes = _recover(part, job)
    shared, edges = share_edges(recovered, job)
    merged, lifts = with_few_lifts(shared, job)
    return Plan(part, trace(merged, job), (*part.notes, *notes, *edges, *lifts))


def _trace_any(part: Part, job: Job, cell: Cell | None, watch: Watch) -> Plan:
    if not part.curves:
        return _plan_flat("trace", _trace)(part, job, cell, watch)
    from camgen.plan.space import plan_space  # noqa: PLC0415 (only for what needs it)

    return plan_space(part, job, cell, watch)


def _recover(part: Part, job: Job) -> tuple[Part, tuple[Note, ...]]:
    """The part with arcs in place of the many short lines by which they were drawn."""
    from camgen.plan.recover import recover_arcs  # noqa: PLC0415 (only for what needs it)

    contours, notes = recover_arcs(part.contours, job.tolerance.arc_fit)
    return replace(part, contours=contours), notes


def _fill(part: Part, job: Job) -> Plan:
    from camgen.plan.fill import fill  # noqa: PLC0415 (OpenCV is loaded only by what needs it)

    paths, notes, coverage = fill(part, job)
    return Plan(part, paths, (*part.notes, *notes), coverage)


def _pocket(part: Part, job: Job) -> Plan:
    from camgen.plan.pocket import pocket  # noqa: PLC0415 (shapely is loaded only by what needs it)

    recovered, notes = _recover(part, job)
    paths, more = pocket(recovered, job)
    return Plan(part, paths, (*part.notes, *notes, *more))


def _bore(part: Part, job: Job) -> Plan:
    from camgen.plan.bore import bore  # noqa: PLC0415 (shapely is loaded only by what needs it)

    paths, notes = bore(part, job)
    return Plan(part, paths, (*part.notes, *notes))


def _chamfer(part: Part, job: Job) -> Plan:
    from camgen.plan.chamfer import chamfer  # noqa: PLC0415 (it loads shapely)

    recovered, notes = _recover(part, job)
    paths, more = chamfer(recovered, job)
    return Plan(part, paths, (*part.notes, *notes, *more))


def _drill(part: Part, job: Job) -> Plan:
    from camgen.plan.drill import drill  # noqa: PLC0415 (only for what needs it)

    paths, notes = drill(part, job)
    return Plan(part, paths, (*part.notes, *notes))


def _edges(part: Part, job: Job, cell: Cell | None, watch: Watch) -> Plan:
    from camgen.plan.edges import plan_edges  # noqa: PLC0415 (fcl is loaded only by what needs it)

    return plan_edges(part, job, cell, watch)


def _replay(part: Part, job: Job, cell: Cell | None, _watch: Watch) -> Plan:
    from camgen.lang.taught import TaughtProgram  # noqa: PLC0415
    from camgen.plan.replay import plan_replay  # noqa: PLC0415 (it loads the interpreter)
    from camgen.plan.taught import plan_taught  # noqa: PLC0415

    if isinstance(part, TaughtProgram):
        return plan_taught(part, job, cell)
    return plan_replay(part, job, cell)


FOLLOW = Operation(
    "follow",
    "beside the contours, outer loops outside, holes inside",
    ("drawing", "picture"),
    _plan_flat("follow", _follow),
)
TRACE = Operation("trace", "on the drawn lines", ("drawing", "picture", "curves"), _trace_any)
FILL = Operation(
    "fill",
    "strokes that cover what closed contours enclose",
    ("drawing", "picture"),
    _plan_flat("fill", _fill),
)
POCKET = Operation(
    "pocket",
    "passes that clear what closed contours enclose",
    ("drawing", "picture"),
    _plan_flat("pocket", _pocket),
)
BORE = Operation(
    "bore", "circles larger than the tool, on a helix", ("drawing",), _plan_flat("bore", _bore)
)
CHAMFER = Operation(
    "chamfer",
    "a bevel of a given width along edges, with a V tool",
    ("drawing",),
    _plan_flat("chamfer", _chamfer),
)
DRILL = Operation(
    "drill", "down at marks, rings and circles", ("drawing", "picture"), _plan_flat("drill", _drill)
)
EDGES = Operation("edges", "along the sharp edges of a 3-D part", ("solid",), _edges)
REPLAY = Operation("replay", "the motions of a program that was read", ("program",), _replay)
