"""Programs are made of rendered photos whose true part is known, and of pictures to scale."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest

import camgen
from bench.render.board import markers
from bench.render.optics import Lens, Shot, aim_camera, photo_from_work
from bench.render.parts import NAMED
from bench.render.scene import Layer, Scene, render, write_photo
from bench.render.truth import offset_truth, path_error
from camgen.cli import main
from camgen.model.errors import CamgenError, NoSafeProgram
from camgen.model.program import Joints, MoveC, MoveL
from camgen.pipeline import Result
from camgen.read import image
from camgen.read.files import Files
from camgen.read.image import read
from camgen.read.job_file import from_mapping
from camgen.vision.boards.sheet import DICTIONARY, make_sheet

LENS = Lens(
    np.array([[1300.0, 0, 402], [0, 1300, 297], [0, 0, 1]]),
    (-0.12, 0.05, 8e-4, -5e-4, 0),
    (800, 600),
)
PART, BENCH = 0.25, 0.75
PLATE = tuple(replace(loop, points=loop.points + (45 + 40j)) for loop in NAMED["plate"]())
#: Corners of the part's box, and two further points, in the work frame, mm.
MARKS = [(-10, -10), (90, -10), (90, 75), (-10, 75), (40, -5), (-5, 35)]


def shot(tilt: float = 10.0, seed: int = 1, **more: Any) -> Shot:
    """A photo of the surroundings of (45, 40) mm, with 0.2 mm per pixel."""
    rotation, origin = aim_camera(LENS, 45 + 40j, 402 + 297j, 0.2, (tilt, 30, 15))
    return Shot(LENS, rotation, origin, blur=0.7, read=1.5, seed=seed, **more)


def photo(folder: Path, name: str, scene: Scene, seen: Shot) -> Path:
    file = folder / name
    write_photo(file, render(scene, seen))
    return file


def scene(part: float = PART, bench: float = BENCH, *more: Layer) -> Scene:
    return Scene(bench, (*more, Layer(PLATE, part)))


def camera_file(folder: Path) -> str:
    """Writes the file of the camera, and returns its name."""
    matrix = ", ".join(map(str, LENS.matrix.ravel()))
    distortion = ", ".join(map(str, LENS.distortion))
    (folder / "camera.yaml").write_text(
        "image_width: 800\nimage_height: 600\ncamera_name: test\n"
        f"camera_matrix:\n  rows: 3\n  cols: 3\n  data: [{matrix}]\n"
        "distortion_model: plumb_bob\n"
        f"distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [{distortion}]\n"
    )
    return str(folder / "camera.yaml")


def pairs(seen: Shot) -> dict[str, Any]:
    """Settings of the camera: the points `MARKS` in the photo and in the work frame."""
    mm = np.array(MARKS, float)
    px = [photo_from_work(seen, np.array(x), np.array(y)) for x, y in mm]
    return {"points_px": np.array(px, float).tolist(), "points_mm": mm.tolist()}


def tool_path(result: Result) -> np.ndarray:
    """Start and middle of each line and arc of the tour as x + i y of the tool centre, mm."""
    points = []
    for path in result.tour.paths:
        start, via, end = path.position[:-1], path.via[1:], path.position[1:]
        is_arc = ~np.isnan(via[:, 0])
        points += [start, np.where(is_arc[:, None], via, (start + end) / 2)]
    x, y = np.concatenate(points).T[:2]
    return x + 1j * y


def errors(result: Result, tool: float = 6.0) -> tuple[float, float]:
    """Maximum and rms of the distances to the true path of a tool of this diameter, mm."""
    error = path_error(tool_path(result), offset_truth(PLATE, tool / 2))
    return error.largest, error.rms


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("photos")


@pytest.fixture(scope="module")
def plain(folder: Path) -> tuple[Path, dict[str, Any]]:
    """A photo, and the job with its point pairs."""
    seen = shot()
    job = {"camera": {"file": camera_file(folder), **pairs(seen)}}
    return photo(folder, "plate.png", scene(), seen), job


@pytest.mark.parametrize("planner", ["geometric", "image"])
def test_the_path_is_exact_to_a_quarter_of_a_pixel(
    plain: tuple[Path, dict[str, Any]], planner: str
) -> None:
    """A pixel is 0.2 mm wide. The rms error is a sixteenth of a pixel."""
    source, job = plain
    result = camgen.build(source, post="rapid", job={**job, "operation": {"planner": planner}})
    largest, rms = errors(result)
    assert largest < 0.05
    assert rms < 0.0125
    assert len(result.part.contours) == len(PLATE)


def test_contours_have_about_as_many_lines_and_arcs_as_the_part(
    plain: tuple[Path, dict[str, Any]],
) -> None:
    result = camgen.build(plain[0], post="gcode", job=plain[1])
    pieces = sum(len(c.points) for c in result.part.contours)
    assert pieces <= 1.5 * sum(len(loop.points) for loop in PLATE)


def test_markers_give_the_work_plane(folder: Path) -> None:
    paper = make_sheet("A4", 20.0)
    rotation, origin = aim_camera(LENS, 110 + 62j, 402 + 297j, 0.38, (8, 40, 5))
    seen = Shot(LENS, rotation, origin, blur=0.6, read=1.0, seed=3)
    left, low = paper.origin
    page = (-left, -low, paper.page[0] - left, paper.page[1] - low)
    layers = markers(page, paper.ids, paper.corners, DICTIONARY)
    file = photo(folder, "sheet.png", Scene(0.45, (*layers, Layer(PLATE, PART))), seen)
    job = {"camera": {"file": camera_file(folder), "markers": "A4"}}
    result = camgen.build(file, post="rapid", job=job)
    largest, rms = errors(result)
    assert largest < 0.1
    assert rms < 0.03


def test_a_charuco_board_gives_the_work_plane(tmp_path: Path) -> None:
    """The board has 7 x 5 squares of 20 mm at 10 px/mm. To its right is a square part of 40 mm.

    The part begins 160 mm to the right of the lower left corner of the board, and 20 mm above it.
    """
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    board = cv2.aruco.CharucoBoard((7, 5), 20.0, 15.0, dictionary)
    pixels = np.full((1200, 2400), 205, np.uint8)
    pixels[100:1100, 100:1500] = board.generateImage((1400, 1000), marginSize=0)
    pixels[500:900, 1700:2100] = 50
    cv2.imwrite(str(tmp_path / "board.png"), pixels)
    table = {"markers": "7x5", "marker": 15.0, "square": 20.0}
    with pytest.raises(CamgenError, match="a board on the bench looks like a part"):
        camgen.build(tmp_path / "board.png", post="gcode", job={"camera": table})
    job = {"camera": table, "image": {"region": [145.0, 5.0, 220.0, 90.0]}}
    (contour,) = camgen.build(tmp_path / "board.png", post="gcode", job=job).part.contours
    assert contour.points.min(axis=0) == pytest.approx([160, 20], abs=0.02)
    assert contour.points.max(axis=0) == pytest.approx([200, 60], abs=0.02)


def test_a_photo_of_the_empty_bench_shows_the_part(folder: Path) -> None:
    seen, dim = shot(seed=5), shot(seed=6, exposure=0.85)
    file = photo(folder, "with.png", scene(PART, BENCH), seen)
    empty = photo(folder, "empty.png", Scene(BENCH), dim)
    job = {
        "camera": {"file": camera_file(folder), **pairs(seen)},
        "image": {"background": str(empty)},
    }
    result = camgen.build(file, post="rapid", job=job)
    assert any("background" in note.what for note in result.notes)
    assert errors(result)[1] < 0.0125


def test_a_second_photo_with_the_lamp_moved_leaves_no_shadow(folder: Path) -> None:
    """The shadows of 4 mm lie on opposite sides of a part without holes."""
    seen, outer = shot(), PLATE[:1]
    photos = []
    for name, shift in (("left", -4), ("right", 4)):
        shadow = Layer((outer[0].moved(0.0, complex(shift)),), 0.5)
        drawn = Scene(BENCH, (shadow, Layer(outer, PART)))
        photos.append(photo(folder, f"{name}.png", drawn, seen))
    camera = {**pairs(seen), "file": camera_file(folder)}

    def build(**image: str) -> Result:
        return camgen.build(photos[0], post="pacscript", job={"camera": camera, "image": image})

    assert any("part or bench by the method" in note.what for note in build().notes)
    result = build(lamp_moved=str(photos[1]))
    assert not any("part or bench by the method" in note.what for note in result.notes)
    assert path_error(tool_path(result), offset_truth(outer, 3.0)).largest < 0.05
    square(folder / "square.png", 0.1)
    with pytest.raises(CamgenError, match=r"square.png: differs in size from the photo"):
        build(lamp_moved=str(folder / "square.png"))


def test_coded_tones_are_turned_into_light(folder: Path) -> None:
    """The mean of two coded values is not the mean of their light: the part would shrink."""
    seen = shot(seed=9, coding="srgb")
    file = photo(folder, "srgb.png", scene(), seen)
    job = {"camera": {"file": camera_file(folder), **pairs(seen)}}
    coded, light = (
        errors(camgen.build(file, post="rapid", job={**job, "image": {"tones": tones}}))[1]
        for tones in ("linear", "srgb")
    )
    assert coded > 0.02
    assert light < 0.0125


def square(file: Path, mm_per_px: float, grey: int = 60) -> None:
    """A square of 30 mm whose lower left corner is at (10, 10) mm, seen straight from above."""
    pixels = np.full((round(50 / mm_per_px), round(60 / mm_per_px)), 200, np.uint8)
    low, high = round(10 / mm_per_px), round(40 / mm_per_px)
    pixels[pixels.shape[0] - high : pixels.shape[0] - low, low:high] = grey
    cv2.imwrite(str(file), pixels)


@pytest.mark.parametrize(
    "scale", [{"mm_per_px": 0.1}, {"width_mm": 60.0}], ids=["mm_per_px", "width"]
)
def test_a_picture_to_scale_needs_no_other_setting(tmp_path: Path, scale: dict[str, float]) -> None:
    square(tmp_path / "square.png", 0.1)
    result = camgen.build(tmp_path / "square.png", post="gcode", job={"image": scale})
    (contour,) = result.part.contours
    assert contour.points.min(axis=0) == pytest.approx([10, 10], abs=0.01)
    assert contour.points.max(axis=0) == pytest.approx([40, 40], abs=0.01)
    assert len(contour.points) == 4


def test_a_large_picture_is_examined_in_full_resolution_around_the_part_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, plain: tuple[Path, dict[str, Any]]
) -> None:
    square(tmp_path / "square.png", 0.1)
    for file, job in ((tmp_path / "square.png", {"image": {"mm_per_px": 0.1}}), plain):
        whole = camgen.build(file, post="gcode", job=job)
        with monkeypatch.context() as patch:
            patch.setattr(image, "_LARGE", 1000)
            cropped = camgen.build(file, post="gcode", job=job)
        assert any("examined in full resolution" in note.what for note in cropped.notes)
        assert not any("examined in full resolution" in note.what for note in whole.notes)
        assert cropped.part.raster is not None
        assert whole.part.raster is not None
        assert cropped.part.raster.mask.size < 0.9 * whole.part.raster.mask.size
        for a, b in zip(whole.part.contours, cropped.part.contours, strict=True):
            assert np.ptp(a.points, axis=0) == pytest.approx(np.ptp(b.points, axis=0), abs=0.02)


def test_force_and_its_direction_reach_the_program(plain: tuple[Path, dict[str, Any]]) -> None:
    source, job = plain
    settings = {"process": {"force": 2.0, "feed": 5.0}, "tool": {"orient": "follow"}}
    job_with_force = {**job, **settings, "post": {"force_load": "lTool"}}
    result = camgen.build(source, post="rapid", job=job_with_force)
    motions = [m for m in result.program.body if isinstance(m, (MoveL, MoveC)) and m.force > 0]
    assert motions
    for motion in motions:
        assert not isinstance(motion.target, Joints)
        x_axis = tuple(motion.target.rotation[:, 0])
        assert motion.force_direction == pytest.approx(x_axis, abs=1e-9)
    assert "FCPressL" in result.text
    template = {"process": {"force": 2.0}, "post": {"force": "template"}}
    assert "2.0" in camgen.build(source, post="pacscript", job={**job, **template}).text


def test_the_same_photo_gives_the_same_bytes_wherever_its_files_are(
    tmp_path: Path, plain: tuple[Path, dict[str, Any]]
) -> None:
    source, job = plain
    texts = []
    for name in ("a", "b"):
        place = tmp_path / name
        place.mkdir()
        camera_file(place)
        picture, program = place / "plate.png", place / "plate.mod"
        picture.write_bytes(source.read_bytes())
        camera = {**job["camera"], "file": "camera.yaml"}
        lines = [f"{key} = {json.dumps(value)}" for key, value in camera.items()]
        (place / "plate.toml").write_text("\n".join(["[camera]", *lines]) + "\n")
        assert main(["build", str(picture), "--post", "rapid", "-q", "-o", str(program)]) == 0
        texts.append(program.read_text())
    assert texts[0] == texts[1]


def test_the_preview_of_a_picture_shows_its_seven_stages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    square(tmp_path / "square.png", 0.1)
    words = ["build", "square.png", "--post", "gcode", "--set", "image.mm_per_px=0.1"]
    assert main([*words, "--preview", "s.svg", "-q"]) == 0
    root = ElementTree.parse("s.svg").getroot()
    space = "{http://www.w3.org/2000/svg}"
    texts = [text.text or "" for text in root.iter(f"{space}text")]
    assert sum(text[:1].isdigit() for text in texts) == 7
    assert len(list(root.iter(f"{space}image"))) == 7


def test_an_unsharp_photo_is_a_warning(tmp_path: Path) -> None:
    x, y = np.meshgrid(np.arange(240), np.arange(200))
    sharp = np.where((np.abs(x - 120) < 60) & (np.abs(y - 100) < 50), 60, 200).astype(np.uint8)
    job = from_mapping({"image": {"mm_per_px": 0.1}})
    for blur, is_warned in ((1.0, False), (3.0, True)):
        write_photo(tmp_path / "part.png", cv2.GaussianBlur(sharp, (0, 0), blur))
        files = Files()
        part = read(files.read(tmp_path / "part.png"), job, files)
        assert any("unsharp" in note.what for note in part.notes) == is_warned


def test_an_outline_without_an_edge_is_refused_unless_accepted(tmp_path: Path) -> None:
    """The threshold draws a circle in a spot of light that has no edge."""
    x, y = np.meshgrid(np.arange(400), np.arange(300))
    grey = 100 + 60 * np.exp(-((x - 200) ** 2 + (y - 150) ** 2) / (2 * 60**2))
    grey += np.random.default_rng(4).normal(0, 0.5, grey.shape)
    write_photo(tmp_path / "part.png", np.rint(grey).astype(np.uint8))
    files = Files()
    table = {"mm_per_px": 0.1, "threshold": 130.0}
    with pytest.raises(NoSafeProgram, match="shows no edge along 1 of 1 outline"):
        read(files.read(tmp_path / "part.png"), from_mapping({"image": table}), files)
    accepts = {"image": {**table, "accept": ["edges"]}}
    part = read(files.read(tmp_path / "part.png"), from_mapping(accepts), files)
    assert any("taken from the mask alone" in note.what for note in part.notes)


def test_a_shadow_without_its_part_is_refused_unless_accepted(tmp_path: Path) -> None:
    """The plate has the tone of its bench. Its shadow has the same outline, moved by 2 mm."""
    plate = np.zeros((300, 400), np.float32)
    plate[60:220, 80:300] = 1
    shadow = cv2.GaussianBlur(np.roll(plate, (20, 20), axis=(0, 1)), (0, 0), 6)
    grey = cv2.GaussianBlur(np.where(plate > 0, 245, 247 - 70 * shadow), (0, 0), 0.8)
    grey += np.random.default_rng(7).normal(0, 0.8, grey.shape)
    write_photo(tmp_path / "part.png", np.rint(grey).astype(np.uint8))
    files = Files()
    table: dict[str, object] = {"mm_per_px": 0.1}
    with pytest.raises(NoSafeProgram, match="shows a shadow alone"):
        read(files.read(tmp_path / "part.png"), from_mapping({"image": table}), files)
    accepts = {"image": {**table, "accept": ["edges"]}}
    part = read(files.read(tmp_path / "part.png"), from_mapping(accepts), files)
    assert any("outlines are soft" in note.what for note in part.notes)


def test_inspect_lists_the_size_of_picture_and_part(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    square(tmp_path / "square.png", 0.1)
    assert main(["inspect", str(tmp_path / "square.png"), "--set", "image.mm_per_px=0.1"]) == 0
    page = capsys.readouterr().out
    assert "picture of 600 x 500 px, grey" in page
    assert "part: 30 x 30 mm" in page
    assert main(["inspect", str(tmp_path / "square.png")]) == 0
    assert "has no scale" in capsys.readouterr().out


PAIR = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
REFUSED = [
    ({}, "square.png: has no scale"),
    (
        {"image": {"mm_per_px": 0.1, "width_mm": 60.0}},
        "[image]: mm_per_px and width_mm are both given",
    ),
    (
        {"camera": {"points_px": PAIR, "points_mm": PAIR, "markers": "A4"}},
        "points_px and markers are both given",
    ),
    ({"camera": {"points_px": PAIR}}, "points_px and points_mm belong together"),
    ({"camera": {"plane_from": [0, 0, 500, 180, 0, 0]}}, "a pose needs the camera"),
    ({"camera": {"file": "CAMERA"}}, "a lens without a work plane"),
    (
        {"image": {"mm_per_px": 0.1}, "camera": {"markers": "A4"}},
        "[image] mm_per_px: has no effect",
    ),
    ({"image": {"mm_per_px": 0.1}, "camera": {"height": 2.0}}, "[camera] height: has no effect"),
    (
        {"image": {"mm_per_px": 0.1}, "camera": {"printed_length": 99.0}},
        "[camera] printed_length: has no effect",
    ),
    (
        {"image": {"mm_per_px": 0.1, "mask": "otsu", "background": "SELF"}},
        "[image] background: has no effect",
    ),
    ({"camera": {"file": "no.yaml"}}, "no.yaml: no such file"),
    ({"camera": {"markers": "A4"}}, "shows 0 of the"),
    ({"camera": {"markers": "A9"}}, "no size 'A9'"),
    ({"image": {"mm_per_px": 0.1, "region": [0.0, 0.0, 5.0]}}, "[image] region: has 3 values"),
    (
        {"image": {"mm_per_px": 0.1, "region": [900.0, 900.0, 950.0, 950.0]}},
        "does not show the region",
    ),
    ({"image": {"mm_per_px": 0.1, "background": "none.png"}}, "none.png: no such file"),
    (
        {"image": {"mm_per_px": 0.1}, "operation": {"planner": "image", "kind": "trace"}},
        "cannot trace",
    ),
    (
        {"image": {"mm_per_px": 0.1}, "operation": {"planner": "image", "side": "left"}},
        '"left" is not known',
    ),
]


@pytest.mark.parametrize(("job", "line"), REFUSED, ids=[line for _, line in REFUSED])
def test_a_job_that_cannot_be_run_is_refused_in_one_line(
    tmp_path: Path, job: dict[str, Any], line: str
) -> None:
    square(tmp_path / "square.png", 0.1)
    if job.get("camera", {}).get("file") == "CAMERA":
        job = {"camera": {"file": camera_file(tmp_path)}}
    if job.get("image", {}).get("background") == "SELF":
        job = {"image": {**job["image"], "background": str(tmp_path / "square.png")}}
    with pytest.raises(CamgenError) as refused:
        camgen.build(tmp_path / "square.png", post="gcode", job=job)
    assert line in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_picture_with_a_drawing_and_a_drawing_in_image_space_are_refused(tmp_path: Path) -> None:
    square(tmp_path / "square.png", 0.1)
    drawing = Path(__file__).parents[2] / "fixtures" / "parts" / "bracket.dxf"
    with pytest.raises(CamgenError, match=r"square\.png: a picture makes a program by itself"):
        camgen.build(
            [tmp_path / "square.png", drawing], post="gcode", job={"image": {"mm_per_px": 0.1}}
        )
    with pytest.raises(CamgenError, match='"image" plans in a picture'):
        camgen.build(drawing, post="gcode", job={"operation": {"planner": "image"}})
