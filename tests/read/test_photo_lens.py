"""Rendered photos of a part on camgen's sheet are read without a calibration file."""

import re
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.photo.lenses import PAPER, SIZE, Photo, draw, errors, read_photo
from bench.render.board import markers
from bench.render.optics import photo_from_work
from bench.render.scene import render, write_photo
from camgen.model.job import CameraTable, ImageTable, Job
from camgen.model.part import Note, Part
from camgen.read import read
from camgen.vision.boards.sheet import DICTIONARY
from tests.vision.test_image import app1, exif, jpeg


def note_of(part: Part, words: str) -> Note:
    (match,) = [note for note in part.notes if words in note.what]
    return match


def photo(name: str, k: int) -> Photo:
    """Photo k of eight: tilted by 2, 7, 11, 15, 20, 24, 28 or 33 deg."""
    return draw(name, k, 8, 0)


@pytest.mark.parametrize(("name", "limit"), [("mild lens", 0.02), ("strong lens", 0.03)])
def test_the_sheet_calibrates_the_lens(name: str, limit: float, tmp_path: Path) -> None:
    """Without the fit of the lens, the error is 0.1 to 1 mm, or the photo is refused."""
    shot = photo(name, 1)
    part = read_photo(tmp_path, shot, 0.0)
    lens, placed = note_of(part, "lens from the photo: k1 -"), note_of(part, "placed to within")
    assert lens.kind == placed.kind == "assumed"
    # The plate with its hole may look like one of the markers, which is then ignored.
    assert re.match(r"1(08|12) corners lie within", lens.why)
    assert "f from the tilt" in lens.why
    error = errors(part, shot.part).max()
    assert error < min(limit, float(placed.what.split()[-2]))
    warned = [note.what for note in part.notes if note.kind == "warning"]
    assert not [what for what in warned if "marker 17 ignored" not in what]


def test_a_height_needs_no_calibration_file(tmp_path: Path) -> None:
    shot = photo("strong lens, 5 mm", 6)
    part = read_photo(tmp_path, shot, 5.0)
    error = errors(part, shot.part).max()
    assert error < 0.05
    placed = note_of(part, "placed to within")
    assert "by the height and the focal length" in placed.why
    assert error < float(placed.what.split()[-2])
    assert "f from the tilt" in note_of(part, "lens from the photo").why


def test_a_height_in_a_photo_without_distortion_is_a_warning(tmp_path: Path) -> None:
    shot = photo("no lens, 5 mm", 5)
    part = read_photo(tmp_path, shot, 5.0)
    assert errors(part, shot.part).max() < 0.1
    assert "no distortion" in note_of(part, "lens from the photo: f ").what
    warning = note_of(part, "the height may move the part by")
    assert (warning.kind, warning.strict) == ("warning", True)


def test_a_height_seen_from_straight_above_has_the_focal_length_of_an_ordinary_camera(
    tmp_path: Path,
) -> None:
    """The bound covers the whole range of focal lengths, and a warning states the movement."""
    shot = photo("mild lens, 5 mm", 0)
    part = read_photo(tmp_path, shot, 5.0)
    assert "among those of ordinary cameras" in note_of(part, "lens from the photo").why
    warning = note_of(part, "the height may move the part by")
    assert (warning.kind, warning.strict) == ("warning", True)
    bound = float(note_of(part, "placed to within").what.split()[-2])
    assert bound > 0.4
    assert errors(part, shot.part).max() < bound


def test_a_height_above_points_needs_no_calibration_file(tmp_path: Path) -> None:
    """The job has eight pairs without noise. The photo is tilted by 28 deg."""
    shot = photo("no lens, 5 mm", 6)
    file = tmp_path / "photo.png"
    write_photo(file, render(shot.scene, shot.shot))
    mm = PAPER.corners[::4].reshape(-1, 2)[:8]
    px = np.column_stack(photo_from_work(shot.shot, *mm.T, -5.0))
    camera = CameraTable(points_px=px.tolist(), points_mm=mm.tolist(), height=5.0)
    image = ImageTable(region=[0, 0, *PAPER.free], accept=["outside"])
    part = read(file, Job(camera=camera, image=image))
    bound = float(note_of(part, "placed to within").what.split()[-2])
    assert errors(part, shot.part).max() < min(bound, 0.2)
    assert "f from the tilt" in note_of(part, "lens from the photo").why
    assert note_of(part, "the height may move the part by").strict


def test_the_focal_length_in_the_file_is_used(tmp_path: Path) -> None:
    """Tag 41989 of Exif 2.3 holds a whole number of mm. The photo is from straight above."""
    shot = photo("mild lens, 5 mm", 0)
    film = round(shot.shot.lens.matrix[0, 0] / np.hypot(*SIZE) * 43.267)
    entry = struct.pack("<HHHIHHI", 1, 41989, 3, 1, film, 0, 0)
    file = tmp_path / "phone.jpg"
    pixels = render(shot.scene, shot.shot)
    file.write_bytes(jpeg([app1(exif([(0x8769, 4, 26)]) + entry)], pixels))
    part = read(file, Job(camera=CameraTable(markers="A4", height=5.0)))
    assert errors(part, shot.part).max() < 0.1
    assert "the 35 mm focal length in the file" in note_of(part, "lens from the photo").why


def test_a_flat_photo_without_distortion_has_no_note_about_a_lens(tmp_path: Path) -> None:
    part = read_photo(tmp_path, photo("no lens", 4), 0.0)
    assert not [note for note in part.notes if "lens" in note.what]


def test_a_marker_in_a_wrong_place_is_left_out_with_a_strong_lens(tmp_path: Path) -> None:
    """Marker 3 is printed 1 mm too far to the right. The lens moves the corners by 6 px."""
    shot = photo("strong lens", 4)
    corners = PAPER.corners.copy()
    corners[3, :, 0] += 1.0
    _, ink = markers((0, 0, 1, 1), PAPER.ids, corners, DICTIONARY)
    page, _, top = shot.scene.layers
    scene = replace(shot.scene, layers=(page, ink, top))
    part = read_photo(tmp_path, shot._replace(scene=scene), 0.0)
    assert note_of(part, "marker 3 left out").kind == "warning"
    assert errors(part, shot.part).max() < 0.03


def test_a_cropped_photo_of_a_flat_part_is_read(tmp_path: Path) -> None:
    """The left sixth of the photo is missing. The corners show the axis of a strong lens."""
    shot = photo("strong lens", 2)
    file = tmp_path / "cut.png"
    write_photo(file, np.ascontiguousarray(render(shot.scene, shot.shot)[:, 400:]))
    part = read(file, Job(camera=CameraTable(markers="A4")))
    assert errors(part, shot.part).max() < 0.03
    assert "f is a guess" in note_of(part, "lens from the photo").why
