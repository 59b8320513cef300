"""Notes on what a build takes for granted about the set-up."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from camgen.lang.recorded import Recorded
from camgen.model.job import Job
from camgen.model.part import Note, Part
from camgen.model.pose import Pose
from camgen.model.program import Joints, Program
from camgen.model.text import counted, short, short_each
from camgen.plan import name_operation
from camgen.plan.close_positions import CLOSE_MM, count_close_positions
from camgen.plan.steps import make_step_jobs, name_drills
from camgen.robots.workcell import Workcell

if TYPE_CHECKING:
    from camgen.check.feeds import SlowPath
    from camgen.check.stock import StockProof
    from camgen.check.stock.pieces import Piece
    from camgen.model.path import Tour

#: Kinds of tools and of operations that remove material below the top face.
_CUTTERS = ("end mill", "ball mill", "bull nose", "drill")
_CUTTING = ("follow", "pocket", "bore", "drill")
#: Least area of excess at one level, mm2: a smaller one is rounding of the polygons.
LEFT_MM2 = 0.01


def note_arm(part: Part, job: Job, cell: Workcell) -> tuple[Note, ...]:
    """The arm of a part in space, if the job names none."""
    if cell.arm is None or job.cell.robot or isinstance(part, Recorded):
        return ()
    what = f"the arm is the {cell.arm.name} of the built-in cell"
    return (Note("assumed", what, "set cell.robot to yours; camgen robots lists the arms"),)


def note_set_up(proof: StockProof | None) -> tuple[Note, ...]:
    """Limits of tools and stock that the program exceeds."""
    if proof is None:
        return ()
    return tuple(
        Note(
            "warning",
            f"{breach.what}; {breach.file} line {breach.line}",
            breach.remedy,
            places=(breach.place[:2],),
            strict=True,
        )
        for breach in proof.set_up.breaches
    )


def note_pieces(proof: StockProof | None, job: Job) -> tuple[Note, ...]:
    """Pieces that the program cuts free, and material that it should have removed."""
    if proof is None:
        return ()
    pieces = [piece for piece in proof.pieces.loose if not piece.drops]
    slugs = [piece for piece in pieces if piece.kind == "slug"]
    notes = _note_excess(proof)
    if job.stock.held != "frame" and pieces:
        parts = counted(len(pieces) - len(slugs), "part")
        what = f"{parts} and {counted(len(slugs), 'slug')} are cut free"
        why = f'stock.held = "{job.stock.held}" holds them'
        notes.append(Note("assumed", what, why, _ids(pieces), _places(pieces)))
    elif slugs:
        largest = max(slugs, key=lambda piece: piece.shape.area)
        length, width = largest.size
        x, y = largest.place
        verb = "comes" if len(slugs) == 1 else "come"
        what = (
            f"{counted(len(slugs), 'slug')} {verb} loose, the largest {short(length, 1)} x "
            f"{short(width, 1)} mm at {short(x, 1)} {short(y, 1)} within {largest.contour}"
        )
        why = (
            "take them out, or hold them: an operation with tabs on these contours alone, "
            'a "pocket" that clears them, or stock.held'
        )
        notes.append(Note("warning", what, why, _ids(slugs), _places(slugs)))
    return tuple(notes)


def _ids(pieces: Sequence[Piece]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(piece.contour for piece in pieces if piece.contour))


def _places(pieces: Sequence[Piece]) -> tuple[tuple[float, float], ...]:
    return tuple(piece.place for piece in pieces)


def _note_excess(proof: StockProof) -> list[Note]:
    """Excess that neither inner corners nor bridges explain."""
    left = [level for level in proof.levels if level.excess.unexplained.area >= LEFT_MM2]
    if not left:
        return []
    worst = max(left, key=lambda level: level.excess.unexplained.area)
    excess = worst.excess
    place = excess.place or (0.0, 0.0)
    what = (
        f"{short(excess.unexplained.area, 2)} mm2 not cut at z {short(worst.bottom, 3)}, "
        f"up to {short(excess.size, 2)} mm wide at {short(place[0], 2)} {short(place[1], 2)}"
    )
    why = "a tool of this radius reaches it; see the excess by level"
    return [Note("skipped", what, why, places=(place,))]


def note_close_positions(part: Part, program: Program, cell: Workcell) -> tuple[Note, ...]:
    """Positions that are closer than the controller of an arm likes."""
    if not isinstance(cell.home, Joints):
        return ()
    count = count_close_positions(program.columns)
    if not count:
        return ()
    key = "tolerance.chord" if isinstance(part, Recorded) else "tolerance.simplify"
    what = f"{count} positions at a feed are less than {CLOSE_MM} mm apart"
    return (Note("warning", what, f"an arm may slow down or stop there; raise {key}"),)


def note_slow_paths(slow: Sequence[SlowPath], tour: Tour) -> tuple[Note, ...]:
    """Paths whose feed the joints of the arm cannot keep."""
    if not slow:
        return ()
    from camgen.check.feeds import describe_slow_path  # noqa: PLC0415 (kinematics, only for an arm)

    why = "lower process.feed, or turn the part or the tool: cell.base_from_work"
    notes = []
    for row in slow:
        path = tour.paths[row.path]
        what = describe_slow_path(row, path.id)
        notes.append(Note("warning", what, why, (path.id,), (row.place[:2],), strict=True))
    return tuple(notes)


def note_drills(part: Part, job: Job) -> tuple[Note, ...]:
    """End mills that only drill. They are judged as drills, whose tips may go below the stock."""
    if part.solid is not None or part.curves or isinstance(part, Recorded):
        return ()
    jobs = make_step_jobs(job)
    named = zip(jobs, name_drills(jobs), strict=True)
    drills = [step.tool.diameter for step, tool in named if tool != step.tool]
    if not drills:
        return ()
    sizes = ", ".join(short_each(dict.fromkeys(drills), 3))
    why = 'set tool.kind = "drill"; an end mill has no tip that may go below the stock'
    return (Note("assumed", f"the tool of {sizes} mm only drills and is judged as a drill", why),)


def note_depth(part: Part, job: Job, cell: Workcell) -> tuple[Note, ...]:
    """Mills and drills that turn without a depth, on a flat part.

    A tool that is pressed against the part works without one. The tool of a machine turns, the tool
    of an arm only if the job states its speed.
    """
    idle = [
        step.tool.kind
        for step in make_step_jobs(job)
        if step.tool.kind in _CUTTERS
        and name_operation(part, step) in _CUTTING
        and (step.process.spindle or isinstance(cell.home, Pose))
        and not (step.operation.depth or step.process.force)
    ]
    if not idle:
        return ()
    what = f"the {idle[0]} runs at the top face and cuts nothing: operation.depth is 0"
    why = "set operation.depth, or tool.kind for a tool that works at the face"
    return (Note("warning", what, why, strict=True),)
