"""Each picture of the shared data gives a program or a message of one line."""

from functools import cache
from pathlib import Path

import pytest

import camgen
from camgen.model.errors import CamgenError
from camgen.pipeline import Result
from tests.read.test_dxf import area

IMAGES = Path(__file__).parents[2].parent / "shared" / "data" / "image"
SUFFIXES = {".png", ".jpg", ".jpeg", ".tif", ".bmp"}
FILES = (
    sorted(path for path in IMAGES.rglob("*") if path.suffix.lower() in SUFFIXES)
    if IMAGES.is_dir()
    else []
)
needs_shared = pytest.mark.skipif(
    not FILES, reason="the shared pictures are not beside the repository"
)

#: Number of outer outlines, counted by eye: coins, objects on a table, a gear, a saw blade.
PARTS = {
    "coins.png": 24,
    "stuff.jpg": 7,
    "horse.png": 1,
    "shape14.png": 1,
    "shape18.png": 1,
    "3.jpg": 1,
}

#: Job without a search for the order of the paths, which does not depend on the picture.
JOB = {
    "image": {"mm_per_px": 0.1, "accept": ["specks"]},
    "tool": {"diameter": 0.4},
    "tour": {"method": "nearest"},
}


@cache
def built(path: Path) -> Result | str:
    try:
        return camgen.build(path, post="gcode", job=JOB)
    except CamgenError as error:
        return str(error)


@needs_shared
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_a_picture_gives_a_program_or_a_message_of_one_line(path: Path) -> None:
    result = built(path)
    if isinstance(result, str):
        assert len(result.splitlines()) == 1
        assert len(result) < 300
        assert path.name not in PARTS
    elif path.name in PARTS:
        # An outer outline runs counter-clockwise, so that its area is positive.
        assert sum(area(contour) > 0 for contour in result.part.contours) == PARTS[path.name]


@needs_shared
def test_an_outline_is_noted_where_no_line_or_arc_fits() -> None:
    """The outline of a saw blade touches itself at slits of one pixel. Its rest is fitted."""
    blade = built(next(path for path in FILES if path.name == "3.jpg"))
    assert not isinstance(blade, str)
    kept = next(note for note in blade.notes if "kept as lines" in note.what)
    assert kept.places
    assert sum(len(c.points) for c in blade.part.contours) < 600
