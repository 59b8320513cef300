"""Ink that joins what the artwork keeps apart, and what gets none: said with the place, shown, refused by --strict."""

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

#: mm of a pixel; a marker of 10 px.
PX, TOOL = 0.1, 1.0
JOB = {"operation": {"kind": "fill"}, "tool": {"diameter": TOOL}, "image": {"mm_per_px": PX}}


def picture(folder: Path, *boxes: tuple[int, int, int, int]) -> Path:
    """Black boxes (from row, to row, from column, to column) on white, 120 x 200 px."""
    pixels = np.full((120, 200), 255, np.uint8)
    for top, bottom, left, right in boxes:
        pixels[top:bottom, left:right] = 0
    cv2.imwrite(str(folder / "board.png"), pixels)
    return folder / "board.png"


def two_tracks(folder: Path, apart: int) -> Path:
    """Two tracks of 3 px with so many between them, and a pad far away."""
    return picture(
        folder, (40, 43, 20, 180), (43 + apart, 46 + apart, 20, 180), (90, 110, 100, 160)
    )


def told(notes: tuple[Note, ...]) -> list[Note]:
    return [note for note in notes if note.places]


def test_two_tracks_under_one_marker_are_a_warning_with_the_place(tmp_path: Path) -> None:
    result = camgen.build(two_tracks(tmp_path, 4), post="vplus", job=JOB)
    (note,) = told(result.notes)
    assert note.kind == "warning"
    ((x, y),) = note.places
    # Half-way along the tracks, between them: rows 43 to 46 of 120, columns 20 to 179.
    assert (x, y) == pytest.approx((10.0, 7.55), abs=0.11)
    assert f"({x:g}, {y:g}) mm" in note.what.replace("(9.95, 7.55)", f"({x:g}, {y:g})")
    with pytest.raises(
        camgen.NoSafeProgram,
        match=r"board\.png: --strict and ink joins .* 1 place: \(9\.95, 7\.55\) mm",
    ):
        camgen.build(two_tracks(tmp_path, 4), post="vplus", job=JOB, strict=True)


@pytest.mark.parametrize(("apart", "joins"), [(4, True), (6, True), (9, False), (20, False)])
def test_tracks_are_joined_where_their_ink_meets(tmp_path: Path, apart: int, joins: bool) -> None:
    """The centre lines are apart + 3 px apart, the marker is 10 px wide."""
    notes = camgen.build(two_tracks(tmp_path, apart), post="vplus", job=JOB).notes
    assert bool(told(notes)) is joins


def test_the_same_from_a_drawing(tmp_path: Path) -> None:
    drawing = tmp_path / "tracks.svg"
    bars = "".join(f'<rect x="2" y="{y}" width="16" height="0.3"/>' for y in (4.0, 4.7))
    drawing.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" width="20mm" height="10mm" viewBox="0 0 20 10">{bars}</svg>'
    )
    (note,) = told(
        camgen.build(drawing, post="gcode", job={k: JOB[k] for k in ("operation", "tool")}).notes
    )
    assert note.places[0] == pytest.approx((10.0, 5.5), abs=0.1)


def drawn(folder: Path, *shapes: str) -> Path:
    head = '<svg xmlns="http://www.w3.org/2000/svg" width="80mm" height="40mm" viewBox="0 0 80 40">'
    (folder / "plate.svg").write_text(
        f'{head}<rect x="2" y="2" width="40" height="25"/>{"".join(shapes)}</svg>'
    )
    return folder / "plate.svg"


MARKER = {"operation": {"kind": "fill"}, "tool": {"diameter": 6.0}}


@pytest.mark.parametrize("radius", [0.02, 0.05, 0.2])
def test_a_region_without_ink_is_skipped_with_its_place(tmp_path: Path, radius: float) -> None:
    """A speck so small that the marker has no business there, with a hole in the plate that is as small."""
    file = drawn(
        tmp_path,
        f'<circle cx="60" cy="12.1" r="{radius}"/>',
        f'<circle cx="20" cy="12" r="{radius}"/>',
    )
    found = camgen.build(file, post="vplus", job=MARKER)
    (note,) = told(found.notes)
    assert note.kind == "skipped"
    assert note.what == "1 region not inked at all: (60, 27.9) mm"
    assert note.places[0] == pytest.approx((60.0, 27.9), abs=0.01)
    with pytest.raises(camgen.NoSafeProgram, match="1 region not inked at all"):
        camgen.build(file, post="vplus", job=MARKER, strict=True)


@pytest.mark.parametrize("gap", [0.05, 0.2, 0.45, 1.0, 2.9])
def test_a_gap_that_the_marker_runs_over_is_told_however_narrow(tmp_path: Path, gap: float) -> None:
    """A slip of 1 mm beside the plate, 20 mm long: the marker inks 2.5 mm on either side of it."""
    file = drawn(tmp_path, f'<rect x="{42 + gap}" y="5" width="1" height="20"/>')
    notes = told(camgen.build(file, post="vplus", job=MARKER).notes)
    assert [note.kind for note in notes] == (["warning"] if gap < 2.5 else [])
    for note in notes:
        assert note.places[0][0] == pytest.approx(42 + gap / 2, abs=0.6)
        assert 14.9 <= note.places[0][1] <= 35.1


def test_contours_that_cross_are_not_kept_apart(tmp_path: Path) -> None:
    file = drawn(tmp_path, '<rect x="40" y="5" width="20" height="15"/>')
    assert not told(camgen.build(file, post="vplus", job=MARKER).notes)


@pytest.mark.parametrize("suffix", ["html", "svg", "png"])
def test_the_place_is_a_red_spot_in_the_preview(
    tmp_path: Path, suffix: str, capsys: pytest.CaptureFixture[str]
) -> None:
    pages = []
    for apart in (4, 20):
        file = two_tracks(tmp_path, apart)
        out = tmp_path / f"{apart}.{suffix}"
        words = ["operation.kind=fill", f"tool.diameter={TOOL}", f"image.mm_per_px={PX}"]
        sets = [word for one in words for word in ("--set", one)]
        assert (
            main(
                [
                    "build",
                    str(file),
                    "--post",
                    "vplus",
                    "-o",
                    str(tmp_path / "b.pg"),
                    "--preview",
                    str(out),
                    *sets,
                ]
            )
            == 0
        )
        pages.append(out.read_bytes())
    capsys.readouterr()
    if suffix == "png":
        red = [
            int((cv2.imdecode(np.frombuffer(p, np.uint8), 1) == (46, 16, 200)).all(axis=2).sum())
            for p in pages
        ]
        assert red[0] > 100
        assert red[1] == 0
    else:
        mark = b"<circle" if suffix == "svg" else b'"state":"wrong"'
        assert [mark in page for page in pages] == [True, False]


def test_the_view_has_a_ring_of_the_tools_size(tmp_path: Path) -> None:
    shown = make_view(camgen.build(two_tracks(tmp_path, 4), post="vplus", job=JOB))
    points = np.split(shown.chains.points, np.cumsum(shown.chains.counts)[:-1])
    (ring,) = [p for line, p in zip(shown.lines, points, strict=True) if line.state == "wrong"]
    assert np.hypot(*(ring[:, :2] - (9.95, 7.55)).T) == pytest.approx(TOOL / 2, abs=1e-6)


def test_strict_on_the_command_line_is_exit_code_3(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = two_tracks(tmp_path, 4)
    words = ["operation.kind=fill", f"tool.diameter={TOOL}", f"image.mm_per_px={PX}"]
    sets = [word for one in words for word in ("--set", one)]
    assert (
        main(
            ["build", str(file), "--post", "vplus", "--strict", "-o", str(tmp_path / "b.pg"), *sets]
        )
        == 3
    )
    assert "ink joins what the artwork keeps apart" in capsys.readouterr().err
    assert not (tmp_path / "b.pg").exists()


def grid(rows: list[str], mark: str) -> np.ndarray:
    return np.array([[letter in mark for letter in row] for row in rows])


def test_bridges_by_hand() -> None:
    """1, 2, 3: regions; #: ink outside; lower case: without ink. The blot on the left joins 1 and 2, 3 is by itself."""
    rows = ["11##22..33", "11##22..33", "11..22...."]
    region = np.array([[int(letter) if letter.isdigit() else 0 for letter in row] for row in rows])
    ink = (grid(rows, "123#") * 255).astype(np.uint8)
    ((u, v),) = find_bridges(ink, region)
    assert 1 <= u <= 4
    assert v <= 1
    ink[:, 2:4] = 0
    assert not len(find_bridges(ink, region))


def test_ink_that_meets_at_a_corner_only_joins_nothing() -> None:
    region = np.array([[1, 0], [0, 2]])
    assert not len(find_bridges(np.array([[255, 0], [0, 255]], np.uint8), region))


def test_bare_by_hand() -> None:
    region = np.array([[1, 1, 0, 2, 2, 2], [1, 1, 0, 2, 2, 2]])
    ink = np.zeros((2, 6), np.uint8)
    ink[0, 0] = 255
    assert find_bare(ink, region)[:, 0].tolist() == [4.0]
