"""Pictures from a camera, for which video files stand in. OpenCV writes and reads them."""

import socket
import threading
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from bench.render import photos
from bench.render.board import markers
from bench.render.optics import Lens, Shot, aim_camera
from bench.render.scene import Scene, render
from camgen.cli import main
from camgen.model.job import CameraTable, Job
from camgen.read.capture import capture, name_picture, note_marks
from camgen.vision.boards.sheet import DICTIONARY, make_sheet
from camgen.vision.frames import measure_blur, note_faults

SIZE = (320, 240)


def write_video(file: Path, frames: Sequence[np.ndarray], codec: str = "MJPG") -> Path:
    """Writes a video of 10 frames a second. codec: FFV1 is lossless, MJPG is not."""
    height, width = frames[0].shape[:2]
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter_fourcc(*codec), 10.0, (width, height))
    assert writer.isOpened()
    for frame in frames:
        writer.write(frame if frame.ndim == 3 else cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
    writer.release()
    return file


def draw_plate(
    blur: float = 0.8, shift: float = 0.0, grey: tuple[float, float] = (50.0, 170.0)
) -> np.ndarray:
    """A dark rectangle on a light bench, without noise.

    blur: standard deviation, px.
    shift: distance to the right, px.
    grey: grey values of rectangle and bench.
    """
    dark, light = grey
    picture = np.full(SIZE[::-1], light, np.float32)
    picture[60:180, 80:240] = dark
    moved = np.float32([[1, 0, shift], [0, 1, 0]])
    picture = cv2.warpAffine(picture, moved, SIZE, borderMode=cv2.BORDER_REPLICATE)
    return cv2.GaussianBlur(picture, (0, 0), blur)


def add_noise(picture: np.ndarray, count: int, sigma: float = 6.0) -> list[np.ndarray]:
    """Copies of a picture with normal noise of `sigma` grey values."""
    rng = np.random.default_rng(5)
    return [
        np.clip(picture + rng.normal(0, sigma, picture.shape), 0, 255).astype(np.uint8)
        for _ in range(count)
    ]


@cache
def render_sheet(last: int | None = None) -> np.ndarray:
    """An A4 marker sheet from above. Only its markers before the index `last` are printed."""
    paper = make_sheet("A4")
    lens = Lens(
        np.array([[1800.0, 0, 480], [0, 1800, 340], [0, 0, 1]]), (0, 0, 0, 0, 0), (960, 680)
    )
    middle = complex(*paper.free) / 2
    shot = Shot(
        lens,
        *aim_camera(lens, middle, 480 + 340j, 0.34, (6, 30, 3)),
        blur=0.7,
        exposure=0.85,
        read=1.0,
    )
    x, y = paper.origin
    page = (-x, -y, paper.page[0] - x, paper.page[1] - y)
    layers = markers(page, paper.ids[:last], paper.corners[:last], DICTIONARY)
    return render(Scene(0.45, layers), shot)


# -- averaging


def test_the_noise_falls_with_the_root_of_the_frames(tmp_path: Path) -> None:
    """The variance of a mean of n frames is 1/n of that of a frame, plus 1/12 for the rounding."""
    picture = draw_plate()
    clip = write_video(tmp_path / "clip.avi", add_noise(picture, 25), "FFV1")
    flat = np.s_[70:170, 90:230]
    for frames in (1, 4, 25):
        shot = capture(str(clip), frames)
        assert shot.frames == frames
        noise = float(shot.pixels[flat][..., 1].std())
        assert noise == pytest.approx(np.sqrt(6.0**2 / frames + 1 / 12), rel=0.04)
        # Frames are truncated to whole grey values, which costs 0.5; the mean is rounded.
        assert float(shot.pixels[flat].mean()) == pytest.approx(50.0 - 0.5, abs=0.2)


def test_a_video_gives_the_same_bytes_again(tmp_path: Path) -> None:
    clip = write_video(tmp_path / "clip.avi", add_noise(draw_plate(), 6))
    for name in ("a.png", "b.png"):
        assert main(["capture", str(clip), "-o", str(tmp_path / name), "-q"]) == 0
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert cv2.imread(str(tmp_path / "a.png")).shape == (SIZE[1], SIZE[0], 3)


def test_skipped_and_missing_frames_are_not_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frames = [np.full((240, 320, 3), 40, np.uint8)] * 3 + add_noise(draw_plate(), 4)
    clip = write_video(tmp_path / "clip.avi", frames, "FFV1")
    kept = capture(f"camera:{clip}", skip=3)
    assert kept.frames == 4
    assert kept.pixels[10, 10, 0] == pytest.approx(170, abs=8)
    assert main(["capture", str(clip), "-o", str(tmp_path / "a.png"), "--skip", "3"]) == 0
    assert "320 x 240 px, mean of 4 frames" in capsys.readouterr().err


# -- faults of a picture


def find_faults(tmp_path: Path, frames: Sequence[np.ndarray]) -> list[str]:
    """The messages about a video of these frames."""
    return [
        note.what
        for note in note_faults(capture(str(write_video(tmp_path / "clip.avi", frames, "FFV1"))))
    ]


@pytest.mark.parametrize("blur", [0.8, 1.5, 2.6, 4.0])
def test_blur_is_measured(blur: float) -> None:
    assert measure_blur(draw_plate(blur).astype(np.uint8)) == pytest.approx(
        blur, rel=0.06, abs=0.12
    )


def test_a_good_picture_has_no_fault(tmp_path: Path) -> None:
    assert find_faults(tmp_path, add_noise(draw_plate(), 16)) == []


def test_a_blurred_picture_has_a_note(tmp_path: Path) -> None:
    (message,) = find_faults(tmp_path, add_noise(draw_plate(3.5), 8))
    assert message.startswith("edges are blurred by 3.")


def test_a_part_that_moves_has_a_note(tmp_path: Path) -> None:
    (message,) = find_faults(
        tmp_path, [draw_plate(0.8, shift).astype(np.uint8) for shift in np.linspace(0, 6, 12)]
    )
    assert message.startswith("camera or part moved: 12 frames have edges blurred by ")


def test_glare_has_a_note_with_its_fraction(tmp_path: Path) -> None:
    picture = draw_plate()
    picture[:36] = 300  # 36 of 240 rows
    (message,) = find_faults(tmp_path, add_noise(picture, 8, 3.0))
    assert message == "15.0 % of the picture is at full white, 255"


def test_a_dark_picture_has_a_note(tmp_path: Path) -> None:
    (message,) = find_faults(tmp_path, add_noise(draw_plate(grey=(8, 45)), 8, 2.0))
    assert message.startswith("the picture is dark: its brightest parts have 4")


def test_a_covered_lens_has_a_note(tmp_path: Path) -> None:
    assert "the picture shows no edges" in find_faults(
        tmp_path, add_noise(np.full((240, 320), 120.0), 4, 2.0)
    )


def test_missing_markers_are_listed_by_their_numbers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole, without_two = render_sheet(), render_sheet(-2)
    ids = make_sheet("A4").ids
    job = Job(camera=CameraTable(markers="A4"))
    assert note_marks(capture(str(write_video(tmp_path / "a.avi", [whole] * 3))), job)[1] == ()
    clip = write_video(tmp_path / "b.avi", [without_two] * 3)
    (note,) = note_marks(capture(str(clip)), job)[1]
    assert note.what == f"2 markers missing of the {make_sheet('A4').label}: {ids[-2]}, {ids[-1]}"
    command = ["capture", str(clip), "-o", str(tmp_path / "b.png"), "--set", "camera.markers=A4"]
    assert main(command) == 0
    assert (
        f"{len(ids) - 2} of {len(ids)} of the {make_sheet('A4').label} seen"
        in capsys.readouterr().err
    )
    (tmp_path / "b.png").unlink()
    assert main([*command, "--strict"]) == 3
    assert not (tmp_path / "b.png").exists()


# -- sources without a picture


@pytest.fixture
def silent() -> Iterator[int]:
    """The port of a server that accepts a connection and never sends anything."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        connections: list[socket.socket] = []
        thread = threading.Thread(
            target=lambda: connections.append(server.accept()[0]), daemon=True
        )
        thread.start()
        yield int(server.getsockname()[1])
        for connection in connections:
            connection.close()


def read_error(capsys: pytest.CaptureFixture[str], folder: Path, *words: str) -> str:
    """The one line that a command prints which fails and leaves the folder unchanged."""
    before = sorted(folder.iterdir())
    assert main([*words]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert sorted(folder.iterdir()) == before
    (line,) = printed.err.splitlines()
    return line


def test_a_source_without_a_picture_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], silent: int
) -> None:
    target = str(tmp_path / "a.png")
    text = tmp_path / "text.avi"
    text.write_text("no video\n" * 100)
    (tmp_path / "empty.avi").touch()
    clip = write_video(tmp_path / "clip.avi", add_noise(draw_plate(), 3))
    cut_off = tmp_path / "cut.avi"
    cut_off.write_bytes(clip.read_bytes()[:300])
    cv2.imwrite(str(tmp_path / "photo.png"), draw_plate())
    nothing = "cannot be opened as a camera or a video"
    for source, what, options in (
        ("989", nothing, ()),
        (str(text), nothing, ()),
        (str(tmp_path / "empty.avi"), "is empty", ()),
        (str(tmp_path / "none.avi"), "no such file", ()),
        (str(tmp_path / "photo.png"), "is a picture, not a video", ()),
        (str(tmp_path), "is a folder", ()),
        (str(clip), "ends before frame 10", ("--skip", "9")),
        (str(clip), "--frames: cannot be 0", ("--frames", "0")),
        (
            f"http://127.0.0.1:{silent}/stream",
            "gives no 16 frames within 0.5 s",
            ("--timeout", "0.5"),
        ),
    ):
        line = read_error(capsys, tmp_path, "capture", source, "-o", target, *options)
        assert what in line, line
    assert read_error(capsys, tmp_path, "capture", str(cut_off), "-o", target).startswith(
        f"camgen: error: {cut_off}: "
    )
    assert "lose nothing" in read_error(
        capsys, tmp_path, "capture", str(clip), "-o", str(tmp_path / "a.jpg")
    )


def test_the_video_is_not_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    clip = write_video(tmp_path / "clip.avi", add_noise(draw_plate(), 3))
    source = clip.rename(tmp_path / "clip.png")
    assert "clip.png" in read_error(capsys, tmp_path, "capture", str(source), "-o", str(source))


# -- capture and build in one step


def test_build_from_a_camera_is_capture_and_build(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    photo = photos.photos(1, 1)[0]
    lens = replace(photo.shot.lens, size=(1200, 858))  # codecs want even numbers
    photo = replace(photo, shot=replace(photo.shot, lens=lens))
    photos.write(tmp_path, photo)
    frames = [render(photo.scene, replace(photo.shot, seed=k)) for k in range(3)]
    write_video(tmp_path / "clip.avi", frames, "FFV1")
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
    job = ["--post", "pacscript", "--job", f"{photo.name}.toml", "-q"]
    assert (
        main(["build", "camera:clip.avi", *job, "-o", "one/part.pcs", "--report", "one.json"]) == 0
    )
    assert main(["capture", "clip.avi", "-o", "clip.png", "-q"]) == 0
    assert main(["build", "clip.png", *job, "-o", "two/part.pcs"]) == 0
    assert Path("one/part.pcs").read_text() == Path("two/part.pcs").read_text()
    assert "camera:clip.avi: 1200 x 858 px, mean of 3 frames" in Path("one.json").read_text()


def test_a_build_names_the_camera_as_on_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clip = write_video(tmp_path / "dark.avi", add_noise(draw_plate(3.5), 3))
    line = read_error(
        capsys,
        tmp_path,
        "build",
        f"camera:{clip}",
        "--post",
        "rapid",
        "-o",
        str(tmp_path / "a.mod"),
    )
    assert line.startswith(f"camgen: error: camera:{clip}: ")
    job = ["--post", "rapid", "--set", "image.mm_per_px=0.2", "-o", str(tmp_path / "a.mod")]
    assert main(["build", f"camera:{clip}", *job, "--strict"]) == 3
    assert "--strict and edges are blurred by 3." in capsys.readouterr().err
    assert main(["inspect", f"camera:{clip}", "--set", "image.mm_per_px=0.2"]) == 0
    assert "picture of 320 x 240 px" in capsys.readouterr().out


def test_pictures_are_named_after_their_camera() -> None:
    assert name_picture("camera:0") == name_picture("/dev/video0") == "camera0.png"
    assert name_picture("camera:films/clip.avi") == "clip.png"
    assert name_picture("camera:rtsp://host/live") == "stream.png"
