"""``camgen calibrate``: the camera from photos of a chessboard or ChArUco board."""

from __future__ import annotations

import re
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path

from camgen.batch.writing import check_targets, write_all
from camgen.cli.say import Voice, table
from camgen.model.errors import JobError
from camgen.model.text import counted, short
from camgen.read.files import Files
from camgen.vision.boards.corners import Target, make_charuco, make_chessboard
from camgen.vision.boards.sheet import DICTIONARY
from camgen.vision.camera.calibrate import Calibration, calibrate
from camgen.vision.camera.camera import format_camera_info
from camgen.vision.camera.residuals import draw_residuals

_COUNTS = re.compile(r"([0-9]{1,4})x([0-9]{1,4})")


def run(arguments: Namespace, says: Voice) -> int:
    """Writes the camera, prints the error of each photo, and says what was left out."""
    target = _target(arguments)
    paths = [Path(name) for name in arguments.photos]
    camera_file = Path(arguments.output)
    preview = Path(arguments.preview) if arguments.preview else None
    if preview is not None and preview.suffix.lower() != ".svg":
        raise JobError(
            str(preview),
            "is no kind of picture that camgen calibrate draws",
            remedy="end the name in .svg",
        )
    check_targets([camera_file, *([preview] if preview else [])], paths)
    files = Files()
    found = calibrate([files.read(path) for path in paths], target, camera_file.stem, says.stage)
    says.clear()
    written = [(camera_file, format_camera_info(found.camera).encode())]
    if preview is not None:
        written.append(
            (preview, draw_residuals(found, f"{target.label}: {camera_file.name}").encode())
        )
    write_all(written, files.opened)
    if not says.quiet:
        says.out(_errors(found))
    says.rows(_summary(found, target))
    says.rows([("written", str(path), "good") for path, _ in written])
    return 0


def _target(arguments: Namespace) -> Target:
    said = _COUNTS.fullmatch(arguments.board)
    if said is None:
        remedy = (
            "give columns x rows: inner corners of a chessboard (9x6), squares of a ChArUco board"
        )
        raise JobError("--board", f"{arguments.board!r} is no board", remedy=remedy)
    columns, rows = int(said[1]), int(said[2])
    if arguments.marker is not None:
        dictionary = arguments.dictionary or DICTIONARY
        return make_charuco(columns, rows, arguments.square, arguments.marker, dictionary)
    if arguments.dictionary is not None:
        raise JobError(
            "--dictionary",
            "a chessboard has no markers",
            remedy="give --marker, the side of one in mm",
        )
    return make_chessboard(columns, rows, arguments.square)


def _errors(found: Calibration) -> str:
    rows = [
        (
            one.name,
            f"{len(one.errors)} of {one.seen.corner_count}",
            f"{one.rms:.3f}",
            f"{one.worst:.3f}",
        )
        for one in found.used
    ]
    return table([("photo", "corners", "rms px", "worst px"), *rows])


def _summary(found: Calibration, target: Target) -> Sequence[tuple[str, str, str]]:
    camera = found.camera
    corners = sum(len(one.errors) for one in found.used)
    fx, fy, cx, cy = (camera.matrix[i, j] for i, j in ((0, 0), (1, 1), (0, 2), (1, 2)))
    sfx, sfy, scx, scy = found.deviations[:4].tolist()
    photos = (
        f"{len(found.used)} of {counted(len(found.used) + len(found.left_out), 'photo')}, "
        f"{counted(corners, 'corner')}"
    )
    rows = [
        ("board", f"{target.label}, squares of {short(target.square, 3)} mm", "plain"),
        ("photos", photos, "plain"),
    ]
    rows += [("left out", f"{one.name}: {one.why}", "look") for one in found.left_out]
    rows += [
        ("error", f"{found.rms:.3f} px rms", "plain"),
        ("focal", f"{fx:.2f} +- {sfx:.2f} px across, {fy:.2f} +- {sfy:.2f} px down", "plain"),
        ("principal", f"{cx:.2f} +- {scx:.2f} px, {cy:.2f} +- {scy:.2f} px", "plain"),
        ("lens", " ".join(f"{value:.5g}" for value in camera.distortion.tolist()), "plain"),
    ]
    return rows + [(note.kind, f"{note.what} ({note.why})", "look") for note in found.notes]
