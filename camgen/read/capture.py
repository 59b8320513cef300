"""Takes a picture from a camera, a video file or a stream, as the mean of several frames.

OpenCV reads the frames in a process of its own. A stream without data, a driver that waits forever
and a decoder that crashes on a damaged file end only that process, and its output is discarded.
"""

from __future__ import annotations

import os
import re
import stat
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

from camgen.model.errors import InputError, JobError
from camgen.model.files import Source
from camgen.model.job import Job
from camgen.model.part import Note
from camgen.model.text import counted
from camgen.read.files import reason
from camgen.read.image import find_target
from camgen.vision.boards.find import list_marks
from camgen.vision.frames import Shot, Sum, note_faults
from camgen.vision.image import read_header

#: Prefix of an input that is a camera: camera:0, camera:clip.avi, camera:rtsp://host/stream.
PREFIX = "camera:"
#: Frames of a picture by default, and at most.
FRAMES, MOST_FRAMES = 16, 1000
#: s: time for all frames by default.
SECONDS = 10.0
#: Frames of a camera or a stream that are skipped by default, until its exposure is steady.
WARM_UP = 10
#: s: time in which the slowest machine imports OpenCV.
_START = 120.0
_DEVICE = re.compile(r"(?:/dev/video)?(\d{1,3})")
_STREAM = re.compile(r"[a-z][a-z0-9+.-]+://", re.IGNORECASE)
#: Bytes of a file by which a picture is recognised.
_HEAD = 65_536


def name_picture(name: str) -> str:
    """File name of a picture: camera0.png for camera 0, stream.png, or the name of a video."""
    address = name.removeprefix(PREFIX)
    if device := _DEVICE.fullmatch(address):
        return f"camera{device[1]}.png"
    stem = "stream" if _STREAM.match(address) else Path(address).stem
    return f"{stem or 'camera'}.png"


def capture(
    name: str, frames: int = FRAMES, skip: int | None = None, seconds: float = SECONDS
) -> Shot:
    """The mean of frames of a camera, a video file or a stream.

    name: number of a camera, path of a file or address of a stream.
    frames: number of frames; fewer are used if the file or the stream ends.
    skip: number of frames that are skipped before; None is `WARM_UP` for a camera or a stream and 0
        for a file.
    seconds: time limit for all frames, s.

    Raises JobError for an empty name, and InputError if there is no picture: no such device or
    file, not a video, or no frames in time.
    """
    address = name.removeprefix(PREFIX)
    if not address:
        raise JobError(
            name, "names no camera", remedy=f"give {PREFIX}0, {PREFIX}FILE or {PREFIX}URL"
        )
    device = _DEVICE.fullmatch(address)
    is_live = bool(device or _STREAM.match(address))
    if is_live:
        remedy = (
            "see that it is plugged in or running, that its number or address is right, "
            "and that no other program uses it"
        )
    else:
        remedy = "give a video that OpenCV can decode, e.g. MJPG in .avi or H.264 in .mp4"
        _check_video(name, Path(address))
    if skip is None:
        skip = WARM_UP if is_live else 0
    result = _run_process(int(device[1]) if device else address, frames, skip, seconds)
    if isinstance(result, Shot):
        return result
    raise InputError(name, result, remedy=remedy)


def _check_video(name: str, path: Path) -> None:
    try:
        mode = path.stat().st_mode
        if not stat.S_ISREG(mode):
            what = "is a folder" if stat.S_ISDIR(mode) else "is not a regular file"
            raise InputError(
                name, what, remedy="give a number, a video file or the address of a stream"
            )
        with path.open("rb") as stream:
            head = stream.read(_HEAD)
    except FileNotFoundError as error:
        raise InputError(
            name,
            "no such file",
            remedy="give the number of a camera, a video file, or the address of a stream",
        ) from error
    except (OSError, ValueError) as error:
        raise InputError(name, f"cannot be read: {reason(error)}") from error
    if not head:
        raise InputError(name, "is empty")
    if read_header(head) is not None:
        raise InputError(name, "is a picture, not a video", remedy="build or inspect it as it is")


def _run_process(device: int | str, frames: int, skip: int, seconds: float) -> Shot | str:
    """The shot from a process that is killed after `seconds`, or the reason why it is missing."""
    context = get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_grab, args=(theirs, device, frames, skip), daemon=True)
    process.start()
    theirs.close()
    try:
        for limit in (_START, seconds):
            if not ours.poll(limit):
                return f"gives no {counted(frames, 'frame')} within {seconds:g} s"
            message: Shot | str | None = ours.recv()
            if message is not None:
                return message
        return "gives no picture"
    except (EOFError, OSError):
        return "ends the process that decodes it: it is damaged"
    except InputError as error:
        return error.what
    finally:
        process.kill()
        process.join()
        ours.close()


def _grab(link: Connection, device: int | str, frames: int, skip: int) -> None:
    """Sends None when OpenCV is loaded, and then the shot or the reason why it is missing.

    This runs in the process of its own.
    """
    silent = os.open(os.devnull, os.O_RDWR)
    for stream in (1, 2):
        os.dup2(silent, stream)
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    link.send(None)
    try:
        link.send(_grab_frames(cv2.VideoCapture(device), frames, skip))
    except InputError as error:
        link.send(error.what)
    except cv2.error as error:
        link.send(f"cannot be decoded: {error.err}")


def _grab_frames(camera: object, frames: int, skip: int) -> Shot | str:
    """The shot, or the reason why it is missing. camera: a cv2.VideoCapture."""
    if not camera.isOpened():  # type: ignore[attr-defined]
        return "cannot be opened as a camera or a video"
    total = Sum()
    for number in range(skip + frames):
        is_frame, frame = camera.read()  # type: ignore[attr-defined]
        if not is_frame:
            break
        if number >= skip:
            total.add(frame if frame.ndim == 3 else frame[:, :, None].repeat(3, axis=2))
    if not total.frames:
        return f"ends before frame {skip + 1}" if skip else "has no frame that can be decoded"
    return total.shot()


# The shot as a picture file.


def make_source(name: str, path: Path, shot: Shot) -> Source:
    """The shot of the camera `name` as the picture file `path`, with notes on its quality."""
    taken = Note("assumed", f"{name}: {format_shot(shot)}")
    return Source(path, encode(shot, ".png"), notes=(taken, *note_faults(shot)))


def format_shot(shot: Shot) -> str:
    """Size, number of frames and blur of a shot, for a line of the summary."""
    height, width = shot.pixels.shape[:2]
    size = f"{width} x {height} px, mean of {counted(shot.frames, 'frame')}"
    return size if shot.blur is None else f"{size}, edges blurred by {shot.blur:.1f} px"


def encode(shot: Shot, suffix: str) -> bytes:
    """The bytes of a lossless picture file. Equal shots give equal bytes.

    suffix: .png, .tif or .bmp.
    """
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    return bytes(cv2.imencode(suffix, shot.pixels)[1])


def note_marks(shot: Shot, job: Job) -> tuple[tuple[str, ...], tuple[Note, ...]]:
    """A line on the markers of `[camera] markers` that are visible, and a note on missing ones.

    Both are empty if the job names no markers.
    """
    if not job.camera.markers:
        return (), ()
    target = find_target(job.camera)
    seen, missing = list_marks(shot.pixels, target)
    line = f"{len(seen)} of {len(seen) + len(missing)} of the {target.label} seen"
    if not missing:
        return (line,), ()
    listed = ", ".join(map(str, missing[:12])) + (" ..." if len(missing) > 12 else "")
    noun = "marker" if hasattr(target, "ids") else "corner"
    return (line,), (
        Note(
            "warning",
            f"{counted(len(missing), noun)} missing of the {target.label}: {listed}",
            "bring all of them into view, flat and free of glare; camgen markers draws the sheet",
            strict=True,
        ),
    )
