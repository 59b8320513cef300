"""What will be done with a part: the tour of its contours, the route over its edges, or the motions that it holds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

from msgspec import Struct
from msgspec.structs import replace

from camgen.errors import InputError, JobError, NoSafeProgram
from camgen.gcode.recorded import Recorded
from camgen.idle import no_idle
from camgen.ir import Program
from camgen.lower import lower
from camgen.paths import ToolPath, Tour
from camgen.planners import plan
from camgen.planners.coverage import Coverage
from camgen.pose import Pose
from camgen.post import Cell
from camgen.settings import Job
from camgen.shapes import Note, Part
from camgen.tour import order, travel

if TYPE_CHECKING:
    from camgen.robots.models import Robot
    from camgen.surroundings import Surroundings

#: What is called when a stage begins: its name as the user sees it.
Watch = Callable[[str], None]


def unwatched(_: str) -> None:
    """Nobody watches: then nobody can stop a search but with all the rest."""


class Planned(Struct, frozen=True, eq=False):
    """What will be done. arm: the robot that the program is checked with. lowered: the program, from its name and
    header. coverage: of a fill.
    """

    tour: Tour
    notes: tuple[Note, ...]
    arm: Robot | None
    lowered: Callable[[str, tuple[str, ...]], Program]
    where: Surroundings | None = None
    coverage: Coverage | None = None


def _flat(part: Part, job: Job, cell: Cell, strict: bool, watch: Watch) -> Planned:
    """The tour of the paths of a flat part."""
    watch("planning")
    no_idle(job, "a drawing" if part.raster is None else "a picture")
    planned = plan(part, job)
    notes = part.notes + planned.notes
    _insist(part, notes, bool(planned.paths), strict)
    watch("ordering")
    tour, lead_notes = _toured(planned.paths, part, job, cell, watch)
    notes += lead_notes
    _insist(part, notes, bool(tour.paths), strict)
    arm = _arm(job.cell.robot)
    run = partial(lower, tour, cell, job)
    return Planned(tour, notes, arm, run, coverage=planned.coverage)


def _arm(name: str) -> Robot | None:
    """The robot of this name, none without one."""
    if not name:
        return None
    from camgen.robots.models import robot  # noqa: PLC0415 (only jobs with a robot load it)

    return robot(name)


def way(part: Part, job: Job) -> Callable[[Part, Job, Cell, bool, Watch], Planned]:
    """How a part becomes a program: by contours, by edges, or by the motions that it holds."""
    if isinstance(part, Recorded):
        return _replay
    if job.operation.kind == "replay":
        raise JobError("job", f'"replay" is for G-code, {part.source} is none', "operation.kind", "leave it out")
    return _flat if part.solid is None else _edges


def _replay(part: Part, job: Job, cell: Cell, strict: bool, watch: Watch) -> Planned:
    """The motions of a program that was read, as they stand in it."""
    from camgen.replay import check, replayed, tour_of  # noqa: PLC0415 (the interpreter, only for what needs it)

    assert isinstance(part, Recorded)
    watch("planning")
    check(job)
    tour = tour_of(part)
    _insist(part, part.notes, bool(tour.paths), strict)
    arm = _arm(job.cell.robot)
    return Planned(tour, part.notes, arm, lambda title, header: replayed(part, cell, job, title, header))


def _edges(part: Part, job: Job, cell: Cell, strict: bool, watch: Watch) -> Planned:
    """The route over the edges of a 3-D part."""
    from camgen.finishing import finished  # noqa: PLC0415 (fcl is loaded only by what needs it)
    from camgen.lower_edges import lower_edges  # noqa: PLC0415

    watch("planning")
    assert part.solid is not None
    if not cell.robot:
        raise JobError("job", "edges of 3-D parts need an arm", "--post", "give rapid, pacscript or vplus")
    arm = _arm(cell.robot)
    assert arm is not None
    done = finished(part.solid, job, arm, cell, watch)
    notes = part.notes + done.notes
    _insist(part, notes, True, strict)
    route, lengths = done.route, done.lengths
    return Planned(
        done.tour, notes, arm, lambda title, header: lower_edges(route, lengths, cell, job, title, header), done.where
    )


def _toured(paths: Sequence[ToolPath], part: Part, job: Job, cell: Cell, watch: Watch) -> tuple[Tour, tuple[Note, ...]]:
    """The paths in order from and back to home, with their leads."""
    from camgen.leads import add_leads  # noqa: PLC0415 (shapely is loaded only by what needs it)
    from camgen.stay_down import staying_down  # noqa: PLC0415

    start = cell.home.origin[:2] if isinstance(cell.home, Pose) else None
    choice, inside = job.tour, job.operation.inside_first

    def tell(part: float) -> None:
        watch(f"ordering {part:.0%}, Ctrl-C takes the best tour so far")

    told = None if watch is unwatched else tell
    found = order(paths, choice.method, start, inside, choice.seconds, choice.seed, choice.layers, choice.seam, told)
    led, notes = add_leads(found.paths, part, job)
    if found.stopped:
        why = "the best tour so far is used; the same job gives another one when its search is not interrupted"
        notes = [*notes, Note("warning", "the search for a short tour was stopped", why)]
    # Leads move the ends of a path by no more than their lengths.
    moved = len(paths) * (job.operation.lead_in + job.operation.lead_out + job.operation.overlap)
    bound = None if found.bound is None else max(0.0, found.bound - moved)
    tour = replace(found, paths=tuple(led), travel=travel(led, start), bound=bound)
    tour, saved = staying_down(tour, part, job)
    return tour, (*notes, *saved)


def _insist(part: Part, notes: Sequence[Note], something: bool, strict: bool) -> None:
    """NoSafeProgram when nothing is left to do, or, where ``strict``, when something was left out."""
    skipped = [note for note in notes if note.kind == "skipped"]
    if not part.contours and part.solid is None and not isinstance(part, Recorded):
        raise InputError(part.source, "nothing to work on", remedy="camgen inspect shows what the file holds")
    if not something:
        # What the planner left out comes last; what the reader left out is not why the contours have no path.
        last = next((note for note in reversed(skipped) if note not in part.notes), Note("skipped", "nothing fits"))
        raise NoSafeProgram(part.source, f"no path is left: {last.what}", last.why)
    if strict and skipped:
        what = f"--strict and {len(skipped)} left out, first: {skipped[0].what}"
        raise NoSafeProgram(part.source, what, skipped[0].why, "mend the input, or build without --strict")
