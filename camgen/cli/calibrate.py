"""The command `calibrate`: a camera from photos of a chessboard or ChArUco board."""

from __future__ import annotations

import re
from argparse import Namespace
from pathlib import Path

from camgen.batch.writing import check_targets, list_paths, write_all
from camgen.cli.inputs import check_suffix, to_path
from camgen.cli.say import Row, Terminal, format_table, label_rows, rows_of_notes
from camgen.model.errors import JobError
from camgen.model.text import counted, short
from camgen.read.files import Files
from camgen.vision.boards.corners import Target, make_charuco, make_chessboard
from camgen.vision.boards.sheet import DICTIONARY
from camgen.vision.camera.calibrate import Calibration, calibrate
from camgen.vision.camera.camera import format_camera_info
from camgen.vision.camera.residuals import draw_residuals

_COUNTS = re.compile(r"([0-9]{1,4})x([0-9]{1,4})")


def run(arguments: Namespace, terminal: Terminal) -> None:
    """Write the camera, print the error of each photo, and report the photos that were left out."""
    target = _target(arguments)
    paths = list(map(Path, arguments.photos))
    camera_file = Path(arguments.output)
    preview = to_path(arguments.preview)
    check_suffix(
        preview,
        (".svg",),
        "is not a kind of picture that camgen calibrate draws",
        "end the name in .svg",
    )
    check_targets([camera_file, preview], paths)
    files = Files()
    photos = list(map(files.read, paths))
    calibration = calibrate(photos, target, camera_file.stem, terminal.stage)
    written = [(camera_file, format_camera_info(calibration.camera).encode())]
    if preview is not None:
        drawing = draw_residuals(calibration, f"{target.label}: {camera_file.name}")
        written.append((preview, drawing.encode()))
    write_all(written, files.opened)
    if not terminal.quiet:
        terminal.out(_errors(calibration))
    terminal.rows(_summary(calibration, target))
    terminal.rows(label_rows("written", list_paths(written), "good"))


def _target(arguments: Namespace) -> Target:
    counts = _COUNTS.fullmatch(arguments.board)
    if counts is None:
        raise JobError(
            "--board",
            f"{arguments.board!r} is not the size of a board",
            remedy="give columns x rows: inner corners of a chessboard (9x6), "
            "squares of a ChArUco board",
        )
    columns, rows = int(counts[1]), int(counts[2])
    if arguments.marker is not None:
        dictionary = arguments.dictionary or DICTIONARY
        return make_charuco(columns, rows, arguments.square, arguments.marker, dictionary)
    if arguments.dictionary is not None:
        raise JobError(
            "--dictionary",
            "a chessboard has no markers",
            remedy="give --marker, the width of a marker in mm",
        )
    return make_chessboard(columns, rows, arguments.square)


def _errors(calibration: Calibration) -> str:
    rows = [("photo", "corners", "rms px", "worst px")]
    for photo in calibration.used:
        corners = f"{len(photo.errors)} of {photo.seen.corner_count}"
        rows.append((photo.name, corners, f"{photo.rms:.3f}", f"{photo.worst:.3f}"))
    return format_table(rows)


def _summary(calibration: Calibration, target: Target) -> list[Row]:
    camera, used, left_out = calibration.camera, calibration.used, calibration.left_out
    corners = sum(len(photo.errors) for photo in used)
    (fx, _, cx), (_, fy, cy), _ = camera.matrix
    sfx, sfy, scx, scy = calibration.deviations[:4].tolist()
    total = counted(len(used) + len(left_out), "photo")
    photos = f"{len(used)} of {total}, {counted(corners, 'corner')}"
    return [
        ("board", f"{target.label}, squares of {short(target.square, 3)} mm", "plain"),
        ("photos", photos, "plain"),
        *(("left out", f"{photo.name}: {photo.why}", "look") for photo in left_out),
        ("error", f"{calibration.rms:.3f} px rms", "plain"),
        ("focal", f"{fx:.2f} +- {sfx:.2f} px across, {fy:.2f} +- {sfy:.2f} px down", "plain"),
        ("principal", f"{cx:.2f} +- {scx:.2f} px, {cy:.2f} +- {scy:.2f} px", "plain"),
        ("lens", " ".join(f"{value:.5g}" for value in camera.distortion.tolist()), "plain"),
        *rows_of_notes(calibration.notes),
    ]
