"""``camgen capture``: a picture from a camera, a video file or a stream, and what is wrong with it."""

from __future__ import annotations

import math
from argparse import Namespace
from pathlib import Path

from camgen.batch.writing import check_targets, write_all
from camgen.cli.say import Voice
from camgen.model.errors import JobError, NoSafeProgram
from camgen.read.capture import MOST_FRAMES, capture, encode, format_shot, note_marks
from camgen.read.files import Files
from camgen.read.job_file import load_job
from camgen.vision.frames import note_faults

#: Kinds of picture files that lose nothing.
_SUFFIXES = (".png", ".tif", ".tiff", ".bmp")


def run(arguments: Namespace, says: Voice) -> int:
    """Writes the picture and says what it shows of the markers, how sharp it is and what to do about it."""
    target, source = Path(arguments.output), arguments.source
    _insist(arguments, target)
    files = Files()
    job_file = Path(arguments.job) if arguments.job else None
    read = [Path(source), *([job_file] if job_file else [])]
    check_targets([target], read)
    job = load_job(job_file, arguments.sets, files)
    says.stage(f"looking at {source}")
    shot = capture(source, arguments.frames, arguments.skip, arguments.timeout)
    seen, missing = note_marks(shot, job)
    notes = (*note_faults(shot), *missing)
    says.clear()
    if arguments.strict and notes:
        raise NoSafeProgram(source, f"--strict and {notes[0].what}", remedy=notes[0].why)
    write_all([(target, encode(shot, target.suffix.lower()))], files.opened)
    rows = [
        ("camera", f"{source}: {format_shot(shot)}", "plain"),
        *(("markers", line, "plain") for line in seen),
    ]
    rows += [("warning", f"{note.what} ({note.why})", "look") for note in notes]
    says.rows([*rows, ("written", str(target), "good")])
    return 0


def _insist(arguments: Namespace, target: Path) -> None:
    """JobError for what cannot be meant."""
    if target.suffix.lower() not in _SUFFIXES:
        remedy = "end the name in .png, .tif or .bmp, which lose nothing"
        raise JobError(str(target), "is no kind of picture that capture writes", remedy=remedy)
    for name, value, least in (
        ("--frames", arguments.frames, 1),
        ("--skip", arguments.skip or 0, 0),
    ):
        if not least <= value <= MOST_FRAMES:
            raise JobError(name, f"cannot be {value}", remedy=f"give {least} to {MOST_FRAMES}")
    if not (math.isfinite(arguments.timeout) and arguments.timeout > 0):
        raise JobError(
            "--timeout", f"cannot be {arguments.timeout:g} s", remedy="give a time above 0 s"
        )
