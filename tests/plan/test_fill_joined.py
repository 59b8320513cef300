"""Ink that joins separate regions and regions without ink: notes, previews and --strict."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

import camgen
from camgen.cli import main
from camgen.model.part import Note
from camgen.plan.fill.joined import find_bare, find_bridges
from camgen.preview.view import make_view

#: mm of a pixel, and diameter of the marker, mm: 10 px.
PX, TOOL = 0.1, 1.0
JOB = {"operation": {"kind": "fill"}, "tool": {"diameter": TOOL}, "image": {"mm_per_px": PX}}
#: The same job as options of the command line.
SETTINGS = [
    *("--set", "operation.kind=fill"),
    *("--set", f"tool.diameter={TOOL}"),
    *("--set", f"image.mm_per_px={PX}"),
]


def write_picture(folder: Path, *boxes: tuple[int, int, int, int]) -> Path:
    """Black boxes (from row, to row, from column, to column) on white, 120 x 200 px."""
    pixels = np.full((120, 200), 255, np.uint8)
    for top, bottom, left, right in boxes:
        pixels[top:bottom, left:right] = 0
    cv2.imwrite(str(folder / "board.png"), pixels)
    return folder / "board.png"


def write_two_tracks(folder: Path, gap_px: int) -> Path:
    """Two tracks of 3 px with a gap of `gap_px` px between them, and a pad far away."""
    return write_picture(
        folder, (40, 43, 20, 180), (43 + gap_px, 46 + gap_px, 20, 180), (90, 110, 100, 160)
    )


def select_placed(notes: tuple[Note, ...]) -> list[Note]:
    """The notes with places."""
    return [note for note in notes if note.places]


def test_a_warning_gives_the_place_of_two_tracks_that_one_marker_joins(tmp_path: Path) -> None:
    result = camgen.build(write_two_tracks(tmp_path, 4), post="vplus", job=JOB)
    (note,) = select_placed(result.notes)
    assert note.kind == "warning"
    ((x, y),) = note.places
    # The place is half-way along the tracks and between them: rows 43 to 46, columns 20 to 179.
    assert (x, y) == pytest.approx((10.0, 7.55), abs=0.11)
    assert f"({x:g}, {y:g}) mm" in note.what.replace("(9.95, 7.55)", f"({x:g}, {y:g})")
    with pytest.raises(
        camgen.NoSafeProgram,
        match=r"board\.png: --strict and ink joins .* 1 place: \(9\.95, 7\.55\) mm",
    ):
        camgen.build(write_two_tracks(tmp_path, 4), post="vplus", job=JOB, strict=True)


@pytest.mark.parametrize(("gap_px", "joins"), [(4, True), (6, True), (9, False), (20, False)])
def test_tracks_are_joined_if_their_ink_meets(tmp_path: Path, gap_px: int, joins: bool) -> None:
    """The distance of the centre lines is the gap plus 3 px, and the marker is 10 px wide."""
    notes = camgen.build(write_two_tracks(tmp_path, gap_px), post="vplus", job=JOB).notes
    assert bool(select_placed(notes)) is joins


def test_two_tracks_of_a_drawing_are_joined_too(tmp_path: Path) -> None:
    drawing = tmp_path / "tracks.svg"
    bars = "".join(f'<rect x="2" y="{y}" width="16" height="0.3"/>' for y in (4.0, 4.7))
    head = '<svg xmlns="http://www.w3.org/2000/svg" width="20mm" height="10mm" viewBox="0 0 20 10">'
    drawing.write_text(f"{head}{bars}</svg>")
    job = {key: JOB[key] for key in ("operation", "tool")}
    (note,) = select_placed(camgen.build(drawing, post="gcode", job=job).notes)
    assert note.places[0] == pytest.approx((10.0, 5.5), abs=0.1)


def write_plate(folder: Path, *shapes: str) -> Path:
    head = '<svg xmlns="http://www.w3.org/2000/svg" width="80mm" height="40mm" viewBox="0 0 80 40">'
    (folder / "plate.svg").write_text(
        f'{head}<rect x="2" y="2" width="40" height="25"/>{"".join(shapes)}</svg>'
    )
    return folder / "plate.svg"


MARKER = {"operation": {"kind": "fill"}, "tool": {"diameter": 6.0}}


@pytest.mark.parametrize("radius", [0.02, 0.05, 0.2])
def test_a_region_without_ink_is_skipped_with_its_place(tmp_path: Path, radius: float) -> None:
    """The region is a speck too small for the marker. The plate has a hole of the same size."""
    file = write_plate(
        tmp_path,
        f'<circle cx="60" cy="12.1" r="{radius}"/>',
        f'<circle cx="20" cy="12" r="{radius}"/>',
    )
    (note,) = select_placed(camgen.build(file, post="vplus", job=MARKER).notes)
    assert note.kind == "skipped"
    assert note.what == "1 region not inked at all: (60, 27.9) mm"
    assert note.places[0] == pytest.approx((60.0, 27.9), abs=0.01)
    with pytest.raises(camgen.NoSafeProgram, match="1 region not inked at all"):
        camgen.build(file, post="vplus", job=MARKER, strict=True)


@pytest.mark.parametrize("gap", [0.05, 0.2, 0.45, 1.0, 2.9])
def test_a_warning_names_a_gap_of_any_width_that_the_marker_inks(
    tmp_path: Path, gap: float
) -> None:
    """A strip of 1 x 20 mm lies next to the plate. The marker inks 2.5 mm on both sides of it."""
    file = write_plate(tmp_path, f'<rect x="{42 + gap}" y="5" width="1" height="20"/>')
    notes = select_placed(camgen.build(file, post="vplus", job=MARKER).notes)
    assert [note.kind for note in notes] == (["warning"] if gap < 2.5 else [])
    for note in notes:
        assert note.places[0][0] == pytest.approx(42 + gap / 2, abs=0.6)
        assert 14.9 <= note.places[0][1] <= 35.1


def test_contours_that_cross_are_not_reported_as_joined(tmp_path: Path) -> None:
    file = write_plate(tmp_path, '<rect x="40" y="5" width="20" height="15"/>')
    assert not select_placed(camgen.build(file, post="vplus", job=MARKER).notes)


@pytest.mark.parametrize("suffix", ["html", "svg", "png"])
def test_the_preview_shows_the_place_as_a_red_spot(
    tmp_path: Path, suffix: str, capsys: pytest.CaptureFixture[str]
) -> None:
    pages = []
    for gap_px in (4, 20):
        file = write_two_tracks(tmp_path, gap_px)
        out = tmp_path / f"{gap_px}.{suffix}"
        command = ["build", str(file), "--post", "vplus", "-o", str(tmp_path / "b.pg")]
        assert main([*command, "--preview", str(out), *SETTINGS]) == 0
        pages.append(out.read_bytes())
    capsys.readouterr()
    if suffix == "png":
        pictures = [cv2.imdecode(np.frombuffer(page, np.uint8), 1) for page in pages]
        red = [int((pixels == (46, 16, 200)).all(axis=2).sum()) for pixels in pictures]
        assert red[0] > 100
        assert red[1] == 0
    else:
        mark = b"<circle" if suffix == "svg" else b'"state":"wrong"'
        assert [mark in page for page in pages] == [True, False]


def test_the_view_has_a_ring_of_the_size_of_the_tool(tmp_path: Path) -> None:
    shown = make_view(camgen.build(write_two_tracks(tmp_path, 4), post="vplus", job=JOB))
    points = np.split(shown.chains.points, np.cumsum(shown.chains.counts)[:-1])
    (ring,) = [p for line, p in zip(shown.lines, points, strict=True) if line.state == "wrong"]
    assert np.hypot(*(ring[:, :2] - (9.95, 7.55)).T) == pytest.approx(TOOL / 2, abs=1e-6)


def test_a_joined_region_with_strict_gives_exit_code_3(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = write_two_tracks(tmp_path, 4)
    command = ["build", str(file), "--post", "vplus", "--strict", "-o", str(tmp_path / "b.pg")]
    assert main([*command, *SETTINGS]) == 3
    assert "ink joins what the artwork keeps apart" in capsys.readouterr().err
    assert not (tmp_path / "b.pg").exists()


def test_a_bridge_of_ink_joins_two_of_three_regions() -> None:
    """Digits are the numbers of regions, all with ink, and # is ink outside of them."""
    rows = np.array([[*"11##22..33"], [*"11##22..33"], [*"11..22...."]])
    region = np.where(np.isin(rows, [*"123"]), rows, "0").astype(int)
    ink = np.where(rows == ".", 0, 255).astype(np.uint8)
    ((u, v),) = find_bridges(ink, region)
    assert 1 <= u <= 4
    assert v <= 1
    ink[:, 2:4] = 0
    assert not len(find_bridges(ink, region))


def test_ink_that_meets_only_at_a_corner_does_not_join_regions() -> None:
    region = np.array([[1, 0], [0, 2]])
    assert not len(find_bridges(np.array([[255, 0], [0, 255]], np.uint8), region))


def test_a_region_without_ink_is_found_at_its_middle() -> None:
    region = np.array([[1, 1, 0, 2, 2, 2], [1, 1, 0, 2, 2, 2]])
    ink = np.zeros((2, 6), np.uint8)
    ink[0, 0] = 255
    assert find_bare(ink, region)[:, 0].tolist() == [4.0]
