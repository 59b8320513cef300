"""The command `capture`: a picture from a camera, a video file or a stream, and its faults."""

from __future__ import annotations

import math
from argparse import Namespace
from pathlib import Path

from camgen.batch.writing import check_targets, write_all
from camgen.cli.inputs import check_suffix, to_path
from camgen.cli.say import Terminal, label_rows
from camgen.model.errors import JobError, NoSafeProgram
from camgen.read.capture import MOST_FRAMES, capture, encode, format_shot, note_marks
from camgen.read.files import Files
from camgen.read.job_file import load_job
from camgen.vision.frames import note_faults

#: Kinds of picture files that lose nothing.
_SUFFIXES = (".png", ".tif", ".tiff", ".bmp")


def run(arguments: Namespace, terminal: Terminal) -> None:
    """Write the picture, and report its markers, its sharpness and the remedies for its faults."""
    target, source = Path(arguments.output), arguments.source
    _check_arguments(arguments, target)
    files = Files()
    job_file = to_path(arguments.job)
    check_targets([target], [Path(source), job_file])
    job = load_job(job_file, arguments.sets, files)
    terminal.stage(f"looking at {source}")
    shot = capture(source, arguments.frames, arguments.skip, arguments.timeout)
    seen, missing = note_marks(shot, job)
    notes = (*note_faults(shot), *missing)
    if arguments.strict and notes:
        raise NoSafeProgram(source, f"--strict and {notes[0].what}", remedy=notes[0].why)
    write_all([(target, encode(shot, target.suffix.lower()))], files.opened)
    rows = [("camera", f"{source}: {format_shot(shot)}", "plain"), *label_rows("markers", seen)]
    rows += [("warning", f"{note.what} ({note.why})", "look") for note in notes]
    terminal.rows([*rows, ("written", str(target), "good")])


def _check_arguments(arguments: Namespace, target: Path) -> None:
    """Raise JobError for values that are out of range."""
    check_suffix(
        target,
        _SUFFIXES,
        "is not a kind of picture that camgen capture writes",
        "end the name in .png, .tif or .bmp, which lose nothing",
    )
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
