"""``camgen place``: where a 3-D part should stand before an arm, as a job file with its cell."""

from __future__ import annotations

import json
import math
import os
from argparse import Namespace
from pathlib import Path

from msgspec.structs import asdict

from camgen.batch.writing import check_targets, write_all
from camgen.cli.say import Voice
from camgen.model.errors import JobError, rename_errors
from camgen.model.job import CellTable, Job
from camgen.model.text import counted, duration, harmless, short
from camgen.model.version import __version__
from camgen.pipeline import poster_of
from camgen.pipeline.inputs import read_inputs
from camgen.pipeline.memory import no_collector
from camgen.pipeline.place import Found, Search, search_place
from camgen.read.files import Files
from camgen.read.job_file import beside, load

#: The keys of [cell] that hold names of files.
_FILES = ("fixtures", "robot")


def run(arguments: Namespace, says: Voice) -> int:
    """Searches, writes the cell, and says what was found."""
    source, target = Path(arguments.input), Path(arguments.output)
    if arguments.height is not None and not math.isfinite(arguments.height):
        raise JobError(
            "--height",
            f"{arguments.height} is no height",
            remedy="give mm above the base of the robot",
        )
    job_file = beside(arguments.job, source)
    check_targets([target], [source, *([job_file] if job_file else [])])
    files = Files()
    with no_collector(), rename_errors("job", str(job_file or "job")):
        job = load(job_file, arguments.sets, files)
        poster = poster_of(arguments.post, job, str(job_file or "job"))
        says.stage("reading")
        read = read_inputs([source], job, poster.cell(), files.within(job.limits))
        found = search_place(
            read.part, job, read.cell, arguments.post, arguments.height, says.stage
        )
    says.clear()
    text = job_text(job, found, source.name, target.parent)
    write_all([(target, text.encode())], files.opened)
    if not says.quiet:
        says.out(f"base_from_work = {list(found.best[0].base_from_work)}\n")
    says.rows(
        [
            *((label, words, "plain") for label, words in _describe(found)),
            ("written", str(target), "good"),
        ]
    )
    return 0


def job_text(job: Job, found: Search, part: str, folder: Path) -> str:
    """The job file: the cell with the place that was found, and as comments what it rests on. Files that the cell names
    are told from ``folder``.
    """
    told = [f"{label}: {words}" for label, words in _describe(found)]
    head = [f"camgen {__version__}: where {harmless(part)} should stand", *told]
    given, default = asdict(job.cell), asdict(CellTable())
    keys = {key: value for key, value in given.items() if value != default[key] and key != "file"}
    keys["base_from_work"] = list(found.best[0].base_from_work)
    if isinstance(keys.get("fixtures"), list):
        keys["fixtures"] = [
            _from(folder, one) if isinstance(one, str) else one for one in keys["fixtures"]
        ]
    if ".urdf" in str(keys.get("robot", "")).lower():
        keys["robot"] = _from(folder, keys["robot"])
    lines = [f"{key} = {json.dumps(value)}" for key, value in keys.items()]
    return (
        "".join(f"# {line}\n" for line in head)
        + "\n[cell]\n"
        + "".join(f"{line}\n" for line in lines)
    )


def _from(folder: Path, name: str) -> str:
    return name if os.path.isabs(name) else os.path.relpath(name, folder)


def _describe(found: Search) -> list[tuple[str, str]]:
    grid, near = found.looked
    best, *others = found.best
    rows = [
        (
            "place",
            _tell(best, found.edges) + (", where the job has it" if best is found.here else ""),
        )
    ]
    rows += [("next best", _tell(one, found.edges)) for one in others if one is not found.here]
    if best is not found.here:
        rows.append(("the job's", _tell(found.here, found.edges)))
    rows.append(
        ("searched", f"{counted(grid, 'place')} by the joints alone, {near} with collisions")
    )
    return rows


def _tell(one: Found, edges: int) -> str:
    spot = one.spot
    where = (
        f"{short(spot.distance, 1)} mm from axis 1, "
        f"{short(spot.height, 1)} mm up, turned by {short(spot.turn, 2)} deg"
    )
    time = f", about {duration(one.seconds)}" if one.edges else ""
    return f"{where}: {one.edges} of {counted(edges, 'edge')}, {one.nominal} with the nominal tool{time}"
