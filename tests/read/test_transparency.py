"""Transparency separates a cut-out from its surroundings, in pictures with an alpha channel."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import camgen
from camgen.model.errors import InputError, JobError
from camgen.pipeline import Result
from camgen.vision.mask.part_mask import is_cut_out

CASES = Path(__file__).parents[2].parent / "shared" / "data" / "cases"


def cut_out(grey: int = 255) -> np.ndarray:
    """A picture of 60 x 40 mm at 0.1 mm/px, opaque in 10..50 x 10..30 mm.

    It has a hole of 20..30 x 15..25 mm. The column of pixels to the right of the opaque area has an
    alpha of 128 of 255, which is half a pixel.
    """
    pixels = np.full((400, 600, 4), grey, np.uint8)
    pixels[..., 3] = 0
    pixels[100:300, 100:500, 3] = 255
    pixels[100:300, 500, 3] = 128
    pixels[150:250, 200:300, 3] = 0
    return pixels


def build(folder: Path, pixels: np.ndarray, **image: Any) -> Result:
    file = folder / "part.png"
    cv2.imwrite(str(file), pixels)
    return camgen.build(file, post="gcode", job={"image": {"mm_per_px": 0.1, **image}})


def method(result: Result) -> str:
    (note,) = [note for note in result.notes if note.what.startswith("part by ")]
    return note.what.removeprefix("part by ")


@pytest.mark.parametrize("grey", [0, 128, 255])
@pytest.mark.parametrize("mask", ["auto", "alpha"])
def test_a_cut_out_is_its_opaque_part(tmp_path: Path, grey: int, mask: str) -> None:
    """The grey value of the part does not matter. Half of alpha is half a pixel, 0.05 mm."""
    result = build(tmp_path, cut_out(grey), mask=mask)
    assert method(result) == "alpha"
    outer, inner = sorted(result.part.contours, key=lambda c: -np.ptp(c.points[:, 0]))
    assert outer.points.min(axis=0) == pytest.approx([10, 10], abs=0.01)
    assert outer.points.max(axis=0) == pytest.approx([50.05, 30], abs=0.015)
    assert inner.points.min(axis=0) == pytest.approx([20, 15], abs=0.01)
    assert inner.points.max(axis=0) == pytest.approx([30, 25], abs=0.01)


def test_another_method_uses_the_picture_on_white(tmp_path: Path) -> None:
    assert method(build(tmp_path, cut_out(60), mask="otsu")) == "otsu"
    with pytest.raises(InputError, match="shows no part"):
        build(tmp_path, cut_out(255), mask="otsu")


def opaque_with(is_clear: np.ndarray) -> np.ndarray:
    """A dark part of 10..50 x 10..30 mm on white, transparent where `is_clear` (400, 600)."""
    pixels = np.full((400, 600, 4), 255, np.uint8)
    pixels[100:300, 100:500, :3] = 40
    pixels[..., 3] = np.where(is_clear, 0, 255)
    return pixels


NOWHERE = np.zeros((400, 600), bool)
CORNERS = np.zeros((400, 600), bool)
CORNERS[:20, :20] = CORNERS[-20:, -20:] = True


@pytest.mark.parametrize("is_clear", [NOWHERE, CORNERS], ids=["opaque", "round corners"])
def test_transparency_that_is_not_a_cut_out_is_not_used(
    tmp_path: Path, is_clear: np.ndarray
) -> None:
    result = build(tmp_path, opaque_with(is_clear))
    assert method(result) == "otsu"
    (contour,) = result.part.contours
    assert contour.points.max(axis=0) == pytest.approx([50, 30], abs=0.01)


def test_alpha_without_transparency_is_refused(tmp_path: Path) -> None:
    with pytest.raises(JobError, match=r'"alpha" needs transparency, part\.png is opaque'):
        build(tmp_path, opaque_with(NOWHERE), mask="alpha")
    with pytest.raises(JobError, match="threshold: has no effect"):
        build(tmp_path, cut_out(), mask="alpha", threshold=100)


def test_a_cut_out_is_transparent_along_most_of_its_border() -> None:
    """The border has 2 (6 + 4) - 4 = 16 pixels. More than eight are transparent."""
    alpha = np.zeros((4, 6), np.uint8)
    assert not is_cut_out(alpha)
    alpha[1:3, 1:5] = 255
    assert is_cut_out(alpha)
    alpha[0] = 255
    assert is_cut_out(alpha)
    alpha[3, :2] = 255
    assert not is_cut_out(alpha)


def test_the_shared_white_cut_out_gives_its_size() -> None:
    """The part is a white L of 5..65 x 5..45 mm with a hole."""
    file = CASES / "img_white_alpha.png"
    if not file.is_file():
        pytest.skip("img_white_alpha.png: the folder shared/data/cases is not there")
    result = camgen.build(file, post="gcode", job={"image": {"mm_per_px": 0.1}})
    points = np.concatenate([contour.points for contour in result.part.contours])
    assert len(result.part.contours) == 2
    assert points.min(axis=0) == pytest.approx([5, 5], abs=0.03)
    assert points.max(axis=0) == pytest.approx([65, 45], abs=0.03)
