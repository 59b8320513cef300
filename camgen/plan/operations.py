"""The operations of camgen, as the entry points `camgen.operations` name them."""

from __future__ import annotations

from collections.abc import Callable

from msgspec.structs import replace

from camgen.model.cell import Cell
from camgen.model.job import Job
from camgen.model.part import Note, Part
from camgen.model.path import ToolPath
from camgen.plan import Coverage, Operation, Plan, Watch, find_part_kind
from camgen.plan.unused import check_clearance, check_idle, check_roll, check_rules, check_use

#: The paths of a part, with notes, and their coverage if they fill it.
_Planned = tuple[tuple[ToolPath, ...], tuple[Note, ...], Coverage | None]


def _plan_flat(
    name: str, make: Callable[[Part, Job], _Planned], *, with_arcs: bool = False
) -> Callable[[Part, Job, Cell | None, Watch], Plan]:
    """The plan function of the operation `name`, which needs only the part and its job.

    with_arcs: `make` gets arcs in place of the many short lines by which they were drawn.
    """

    def plan_part(part: Part, job: Job, cell: Cell | None, _watch: Watch) -> Plan:
        check_idle(job, f"a {find_part_kind(part)}")
        check_use(job, name)
        check_roll(job, cell)
        check_clearance(job, name)
        if job.operation.planner == "image":
            return _plan_in_image(part, job)
        check_idle(job, "the geometric planner")
        drawn, notes = _recover(part, job) if with_arcs else (part, ())
        paths, more, coverage = make(drawn, job)
        return Plan(part, paths, (*part.notes, *notes, *more), coverage)

    return plan_part


def _plan_in_image(part: Part, job: Job) -> Plan:
    raster = part.raster
    check_rules(
        [
            (
                raster is None,
                '"image" plans in a picture, and this is not one',
                "operation.planner",
                'set operation.planner to "geometric"',
            ),
            (
                job.operation.kind not in ("auto", "follow"),
                f"the image-space planner follows contours, it cannot {job.operation.kind}",
                "operation.planner",
                'set operation.planner to "geometric"',
            ),
            (
                job.operation.finish != 0,
                "the image-space planner makes no last passes",
                "operation.finish",
                'leave it out, or set operation.planner to "geometric"',
            ),
        ]
    )
    from camgen.plan.image_space import image_space  # noqa: PLC0415 (it loads OpenCV)

    assert raster is not None
    paths, notes = image_space(raster.mask, raster.work_from_view, job, borders=raster.borders)
    return Plan(part, paths, (*part.notes, *notes))


def _follow(part: Part, job: Job) -> _Planned:
    if job.operation.side == "on":
        check_use(job, "trace")
        return _trace(part, job)
    from camgen.plan.follow import follow  # noqa: PLC0415 (shapely is loaded only by what needs it)

    return *follow(part, job), None


def _trace(part: Part, job: Job) -> _Planned:
    # shapely takes long to import.
    from camgen.plan.trace import share_edges, trace, with_few_lifts  # noqa: PLC0415

    shared, edges = share_edges(part, job)
    merged, lifts = with_few_lifts(shared, job)
    return trace(merged, job), (*edges, *lifts), None


def _trace_any(part: Part, job: Job, cell: Cell | None, watch: Watch) -> Plan:
    if not part.curves:
        return _plan_flat("trace", _trace, with_arcs=True)(part, job, cell, watch)
    from camgen.plan.space import plan_space  # noqa: PLC0415 (only for what needs it)

    return plan_space(part, job, cell, watch)


def _recover(part: Part, job: Job) -> tuple[Part, tuple[Note, ...]]:
    from camgen.plan.recover import recover_arcs  # noqa: PLC0415 (only for what needs it)

    contours, notes = recover_arcs(part.contours, job.tolerance.arc_fit)
    return replace(part, contours=contours), notes


def _fill(part: Part, job: Job) -> _Planned:
    from camgen.plan.fill import fill  # noqa: PLC0415 (OpenCV is loaded only by what needs it)

    return fill(part, job)


def _pocket(part: Part, job: Job) -> _Planned:
    from camgen.plan.pocket import pocket  # noqa: PLC0415 (shapely is loaded only by what needs it)

    return *pocket(part, job), None


def _bore(part: Part, job: Job) -> _Planned:
    from camgen.plan.bore import bore  # noqa: PLC0415 (shapely is loaded only by what needs it)

    return *bore(part, job), None


def _chamfer(part: Part, job: Job) -> _Planned:
    from camgen.plan.chamfer import chamfer  # noqa: PLC0415 (it loads shapely)

    return *chamfer(part, job), None


def _drill(part: Part, job: Job) -> _Planned:
    from camgen.plan.drill import drill  # noqa: PLC0415 (only for what needs it)

    return *drill(part, job), None


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
    _plan_flat("follow", _follow, with_arcs=True),
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
    _plan_flat("pocket", _pocket, with_arcs=True),
)
BORE = Operation(
    "bore", "circles larger than the tool, on a helix", ("drawing",), _plan_flat("bore", _bore)
)
CHAMFER = Operation(
    "chamfer",
    "a bevel of a given width along edges, with a V tool",
    ("drawing",),
    _plan_flat("chamfer", _chamfer, with_arcs=True),
)
DRILL = Operation(
    "drill", "down at marks, rings and circles", ("drawing", "picture"), _plan_flat("drill", _drill)
)
EDGES = Operation("edges", "along the sharp edges of a 3-D part", ("solid",), _edges)
REPLAY = Operation("replay", "the motions of a program that was read", ("program",), _replay)
