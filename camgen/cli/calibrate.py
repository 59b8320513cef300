"""The command `calibrate`: a camera from photos of a chessboard or ChArUco board."""

from __future__ import annotations

import re
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path

from camgen.batch.writing import check_targets, write_all
from camgen.cli.say import Terminal, format_table
from camgen.model.errors import JobError
from camgen.model.text import counted, short
from camgen.read.files import Files
from camgen.vision.boards.corners import Target, make_charuco, make_chessboard
from camgen.vision.boards.sheet import DICTIONARY
from camgen.vision.camera.calibrate import Calibration, calibrate
from camgen.vision.camera.camera import format_camera_info
from camgen.vision.camera.residuals import draw_residuals

_COUNTS = re.compile(r"([0-9]{1,4})x([0-9]{1,4})")


def run(arguments: Namespace, terminal: Terminal) -> int:
    """Write the camera, print the error of each photo, and report the photos that were left out."""
    target = _target(arguments)
    paths = [Path(name) for name in arguments.photos]
    camera_file = Path(arguments.output)
    preview = Path(arguments.preview) if arguments.preview else None
    if preview is not None and preview.suffix.lower() != ".svg":
        what = "is not a kind of picture that camgen calibrate draws"
        raise JobError(str(preview), what, remedy="end the name in .svg")
    check_targets([camera_file, *([preview] if preview else [])], paths)
    files = Files()
    photos = [files.read(path) for path in paths]
    calibration = calibrate(photos, target, camera_file.stem, terminal.stage)
    terminal.clear()
    written = [(camera_file, format_camera_info(calibration.camera).encode())]
    if preview is not None:
        drawing = draw_residuals(calibration, f"{target.label}: {camera_file.name}")
        written.append((preview, drawing.encode()))
    write_all(written, files.opened)
    if not terminal.quiet:
        terminal.out(_errors(calibration))
    terminal.rows(_summary(calibration, target))
    terminal.rows([("written", str(path), "good") for path, _ in written])
    return 0


def _target(arguments: Namespace) -> Target:
    counts = _COUNTS.fullmatch(arguments.board)
    if counts is None:
        what = f"{arguments.board!r} is not the size of a board"
        remedy = (
            "give columns x rows: inner corners of a chessboard (9x6), squares of a ChArUco board"
        )
        raise JobError("--board", what, remedy=remedy)
    columns, rows = int(counts[1]), int(counts[2])
    if arguments.marker is not None:
        dictionary = arguments.dictionary or DICTIONARY
        return make_charuco(columns, rows, arguments.square, arguments.marker, dictionary)
    if arguments.dictionary is not None:
        remedy = "give --marker, the width of a marker in mm"
        raise JobError("--dictionary", "a chessboard has no markers", remedy=remedy)
    return make_chessboard(columns, rows, arguments.square)


def _errors(calibration: Calibration) -> str:
    rows = [
        (
            photo.name,
            f"{len(photo.errors)} of {photo.seen.corner_count}",
            f"{photo.rms:.3f}",
            f"{photo.worst:.3f}",
        )
        for photo in calibration.used
    ]
    return format_table([("photo", "corners", "rms px", "worst px"), *rows])


def _summary(calibration: Calibration, target: Target) -> Sequence[tuple[str, str, str]]:
    camera, used, left_out = calibration.camera, calibration.used, calibration.left_out
    corners = sum(len(photo.errors) for photo in used)
    fx, fy, cx, cy = (camera.matrix[i, j] for i, j in ((0, 0), (1, 1), (0, 2), (1, 2)))
    sfx, sfy, scx, scy = calibration.deviations[:4].tolist()
    total = counted(len(used) + len(left_out), "photo")
    photos = f"{len(used)} of {total}, {counted(corners, 'corner')}"
    rows = [
        ("board", f"{target.label}, squares of {short(target.square, 3)} mm", "plain"),
        ("photos", photos, "plain"),
    ]
    rows += [("left out", f"{photo.name}: {photo.why}", "look") for photo in left_out]
    rows += [
        ("error", f"{calibration.rms:.3f} px rms", "plain"),
        ("focal", f"{fx:.2f} +- {sfx:.2f} px across, {fy:.2f} +- {sfy:.2f} px down", "plain"),
        ("principal", f"{cx:.2f} +- {scx:.2f} px, {cy:.2f} +- {scy:.2f} px", "plain"),
        ("lens", " ".join(f"{value:.5g}" for value in camera.distortion.tolist()), "plain"),
    ]
    return rows + [(note.kind, f"{note.what} ({note.why})", "look") for note in calibration.notes]
