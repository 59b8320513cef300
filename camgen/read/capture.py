"""A picture from a camera, a video file or a stream (continuous-path.md, 3, the second option): frames, averaged.

OpenCV reads the frames in a process of its own. A stream that falls silent, a driver that waits for ever and a decoder
that dies on a damaged file take that process with them and no other, and what they print goes nowhere.
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
from camgen.read.image import find_target
from camgen.vision.boards.find import list_marks
from camgen.vision.frames import Shot, Sum, note_faults
from camgen.vision.image import read_header

#: How an input says that it is a camera and no file: camera:0, camera:clip.avi, camera:rtsp://host/stream.
PREFIX = "camera:"
FRAMES, MOST_FRAMES, SECONDS = 16, 1000, 10.0
#: Frames that a camera is given to settle its exposure; a video file is taken from its first.
WARM_UP = 10
#: What the process needs until it has imported OpenCV, s, on the slowest machine.
_START = 120.0
_DEVICE = re.compile(r"(?:/dev/video)?(\d{1,3})")
_STREAM = re.compile(r"[a-z][a-z0-9+.-]+://", re.IGNORECASE)
#: The beginning of a file that may be a picture.
_HEAD = 65_536


def name_picture(name: str) -> str:
    """What the picture of ``name`` is called: camera0.png, of a video file or a stream its own name."""
    where = name.removeprefix(PREFIX)
    if device := _DEVICE.fullmatch(where):
        return f"camera{device[1]}.png"
    stem = "stream" if _STREAM.match(where) else Path(where).stem
    return f"{stem or 'camera'}.png"


def capture(
    name: str, frames: int = FRAMES, skip: int | None = None, seconds: float = SECONDS
) -> Shot:
    """The mean of ``frames`` frames of a camera, by its number, a video file or a stream; fewer where a file ends.

    skip: frames left out before, by default ``WARM_UP`` of a camera or a stream, none of a file. seconds: what all of
    it may take. InputError where no picture comes: nothing there, no video, silence.
    """
    where = name.removeprefix(PREFIX)
    if not where:
        raise JobError(
            name, "names no camera", remedy=f"give {PREFIX}0, {PREFIX}FILE or {PREFIX}URL"
        )
    device = _DEVICE.fullmatch(where)
    live = bool(device or _STREAM.match(where))
    if not live:
        _insist_on_video(name, Path(where))
    what: int | str = int(device[1]) if device else where
    skipped = (WARM_UP if live else 0) if skip is None else skip
    found = _ask(what, frames, skipped, seconds)
    if isinstance(found, Shot):
        return found
    raise InputError(name, found, remedy=_REMEDIES["live" if live else "file"])


_REMEDIES = {
    "live": "see that it is plugged in or running, that its number or address is right, and that nobody else uses it",
    "file": "give a video that OpenCV can decode, e.g. MJPG in .avi or H.264 in .mp4",
}


def _insist_on_video(name: str, path: Path) -> None:
    """InputError for what is no file, or one that is a picture already."""
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
        remedy = "give the number of a camera, a video file, or the address of a stream"
        raise InputError(name, "no such file", remedy=remedy) from error
    except (OSError, ValueError) as error:
        raise InputError(
            name, f"cannot be read: {getattr(error, 'strerror', None) or error}"
        ) from error
    if not head:
        raise InputError(name, "is empty")
    if read_header(head) is not None:
        raise InputError(name, "is a picture, no video", remedy="build or inspect it as it is")


def _ask(what: int | str, frames: int, skip: int, seconds: float) -> Shot | str:
    """The shot, or why there is none, from a process that is ended when its time is over."""
    context = get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_grab, args=(theirs, what, frames, skip), daemon=True)
    process.start()
    theirs.close()
    try:
        for limit in (_START, seconds):
            if not ours.poll(limit):
                return f"gives no {counted(frames, 'frame')} within {seconds:g} s"
            said: Shot | str | None = ours.recv()
            if said is not None:
                return said
        return "gives no picture"
    except (EOFError, OSError):
        return "ends the process that decodes it: it is damaged"
    except InputError as error:
        return error.what
    finally:
        process.kill()
        process.join()
        ours.close()


def _grab(link: Connection, what: int | str, frames: int, skip: int) -> None:
    """Runs in the process: says that it begins, then what it found."""
    silent = os.open(os.devnull, os.O_RDWR)
    for stream in (1, 2):
        os.dup2(silent, stream)
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    link.send(None)
    try:
        link.send(_grab_frames(cv2.VideoCapture(what), frames, skip))
    except InputError as error:
        link.send(error.what)
    except cv2.error as error:
        link.send(f"cannot be decoded: {error.err}")


def _grab_frames(camera: object, frames: int, skip: int) -> Shot | str:
    """camera: a cv2.VideoCapture."""
    if not camera.isOpened():  # type: ignore[attr-defined]
        return "cannot be opened as a camera or a video"
    total = Sum()
    for number in range(skip + frames):
        there, frame = camera.read()  # type: ignore[attr-defined]
        if not there:
            break
        if number >= skip:
            total.add(frame if frame.ndim == 3 else frame[:, :, None].repeat(3, axis=2))
    if not total.frames:
        return f"ends before frame {skip + 1}" if skip else "has no frame that can be decoded"
    return total.shot()


# The picture as a file that was never written.


def make_source(name: str, path: Path, shot: Shot) -> Source:
    """The shot of the camera ``name`` as the picture file ``path``, with what is wrong with it."""
    taken = Note("assumed", f"{name}: {tell(shot)}")
    return Source(path, encode(shot, ".png"), notes=(taken, *note_faults(shot)))


def tell(shot: Shot) -> str:
    """What the picture is made of, for a line of the summary."""
    height, width = shot.pixels.shape[:2]
    size = f"{width} x {height} px, mean of {counted(shot.frames, 'frame')}"
    return size if shot.blur is None else f"{size}, edges blurred by {shot.blur:.1f} px"


def encode(shot: Shot, suffix: str) -> bytes:
    """The picture as the bytes of a file without loss: .png, .tif or .bmp. The same every time."""
    import cv2  # noqa: PLC0415 (loaded only by what needs it)

    return bytes(cv2.imencode(suffix, shot.pixels)[1])


def judge_marks(shot: Shot, job: Job) -> tuple[tuple[str, ...], tuple[Note, ...]]:
    """What is seen of the markers that ``[camera] markers`` names, in words, and what is missing of them."""
    if not job.camera.markers:
        return (), ()
    target = find_target(job.camera)
    seen, missing = list_marks(shot.pixels, target)
    told = f"{len(seen)} of {len(seen) + len(missing)} of the {target.label} seen"
    if not missing:
        return (told,), ()
    listed = ", ".join(map(str, missing[:12])) + (" ..." if len(missing) > 12 else "")
    noun = "marker" if hasattr(target, "ids") else "corner"
    what = f"{counted(len(missing), noun)} missing of the {target.label}: {listed}"
    why = "bring all of them into view, flat and free of glare; camgen markers draws the sheet"
    return (told,), (Note("warning", what, why, strict=True),)
