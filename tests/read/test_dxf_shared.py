"""Each drawing of the shared data has the measured length, or is refused as expected."""

import json
import math
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from camgen.model.errors import InputError
from camgen.model.job import Job
from camgen.model.part import Part
from camgen.read import dxf
from camgen.read.files import Files
from camgen.read.units import INSUNITS, MM
from tests.read.test_dxf import length
from tests.support.files import source

DATA = Path(__file__).parents[2].parent / "shared" / "data"
FILES = sorted(p for p in DATA.glob("dxf/*/*") if p.suffix.lower() == ".dxf")
pytestmark = pytest.mark.skipif(
    not FILES, reason="the folder shared/data beside the repository is absent"
)

#: Drawings without curves for machining, with the start of the refusal.
REFUSED = {
    # The only curve is invisible (group 60).
    "invisible-lwpolylines-in-block.dxf": "nothing to machine",
    "tables.dxf": "nothing to machine",  # without entities
    "bin_dxf_r2000.dxf": "nothing to machine (1 TEXT",
    "circle_radius_le_0.dxf": "nothing to machine (dropped: 2 CIRCLE",  # radius 0 and -1
    "BlockClippedBasicTransform.dxf": "nothing to machine (6 INSERT",  # all clipped
    "TransformedBlockClipped.dxf": "nothing to machine (4 INSERT",  # all clipped
    "Leica_Disto_S910.dxf": "nothing to machine (11 TEXT",  # lines in space
    "POLI-ALL210_12.DXF": "nothing to machine (1 3DFACE",  # polylines in tilted planes
    "cc_dxflib.dxf": "nothing to machine (3-D POLYLINE #B",  # not flat
    "cycloidal.dxf": "damaged beyond repair: missing 'AcDbSpline'",
}
#: Length of the duplicates, in drawing units. The first summand is the length of LINEs with equal
#: ends. The second one is the length of partial overlaps, from the union of all curves by shapely,
#: on a grid of 0.02 mm for the states and 0.001 mm for the others.
TWICE = {
    "5_us_states.dxf": 111.642412 + 4.965,
    # Common edges of closed contours, 166 long, stay in both contours.
    "wipeout_door.dxf": 432.0 + 1268.0 - 166.0,
    "uncommon.dxf": 10.0,
    "broken_pair.dxf": 0.25,
}
#: Lengths that the measurement lacks, in drawing units, calculated from the numbers in the file.
MISSING = {
    # Six lines of a block were measured, but not its three quarter circles of radius 1/4 and its
    # array of 14 circles of radius 0.13.
    "arrayed-holes.dxf": 3 * math.pi / 8 + 14 * 2 * math.pi * 0.13,
    # 2 of the 111 lines, each 8 long, share a handle with another line and were not measured.
    "duplicate_handles.dxf": 16.0,
}


class ReadDrawing(NamedTuple):
    """A drawing that was read and inspected.

    part: the part, None if reading is refused.
    error: message of the refusal, or empty.
    counts: number of entities of each kind.
    """

    part: Part | None
    error: str
    counts: dict[str, int]


@cache
def read_drawing(path: Path) -> ReadDrawing:
    """Reads and inspects a drawing, which is loaded once: loading takes most of the time."""
    opened = source(path)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dxf, "load_document", cache(dxf.load_document))
        try:
            counts = dict(dxf.inspect(opened, Job(), Files()).counts)
        except InputError:
            counts = {}
        try:
            return ReadDrawing(dxf.read(opened, Job(), Files()), "", counts)
        except InputError as error:
            return ReadDrawing(None, str(error), counts)


def truth() -> dict[str, Any]:
    lines = (DATA / "truth.jsonl").read_text().splitlines() if DATA.exists() else []
    return {entry["file"]: entry for entry in map(json.loads, lines) if "file" in entry}


TRUTH = truth()


def scale(entry: dict[str, Any]) -> float:
    """Size of a drawing unit, mm.

    The raw unit counts for a text: the measuring program replaces a missing $INSUNITS by a default.
    """
    code = entry["insunits"] if entry["binary"] else entry["insunits_raw"]
    return MM[INSUNITS.get(code or 0, "mm")]


def test_each_measured_drawing_is_in_the_shared_data() -> None:
    assert len(FILES) == sum(name.startswith("dxf/") for name in TRUTH) > 50


@pytest.mark.parametrize(
    "path", [file for file in FILES if file.name not in REFUSED], ids=lambda path: path.name
)
def test_the_length_of_a_drawing_is_the_measured_length(path: Path) -> None:
    entry = TRUTH[str(path.relative_to(DATA))]
    part = read_drawing(path).part
    assert part is not None
    units = entry["visible_exact"] - TWICE.get(path.name, 0) + MISSING.get(path.name, 0)
    assert sum(map(length, part.contours)) == pytest.approx(units * scale(entry), rel=0.005)
    assert all(str(note).isprintable() for note in part.notes)


@pytest.mark.parametrize(
    "path", [file for file in FILES if file.name in REFUSED], ids=lambda path: path.name
)
def test_a_drawing_without_curves_is_refused_in_one_line(path: Path) -> None:
    error = read_drawing(path).error
    assert error.startswith(f"{path.name}: {REFUSED[path.name]}")
    assert error.isprintable()


#: Drawings that cannot be loaded, or that were measured with their clipped references, which
#: camgen does not use (see `REFUSED`).
NOT_COUNTED = {"cycloidal.dxf", "BlockClippedBasicTransform.dxf", "TransformedBlockClipped.dxf"}


@pytest.mark.parametrize(
    "path", [file for file in FILES if file.name not in NOT_COUNTED], ids=lambda path: path.name
)
def test_inspect_counts_at_least_the_measured_entities(path: Path) -> None:
    """The measurement leaves out damaged entities and references that it cannot expand."""
    counts = read_drawing(path).counts
    measured = TRUTH[str(path.relative_to(DATA))].get("curves", {})
    assert all(counts.get(kind, 0) >= count for kind, count in measured.items())


@pytest.mark.parametrize(
    ("name", "loops"),
    [
        ("gear.dxf", 2),
        ("forms.dxf", 40),
        ("LM2.dxf", 40),
        ("ChuteHolderPrint.DXF", 43),
        ("redox_rev1-brd.dxf", 41),
    ],
)
def test_all_contours_of_a_drawing_of_loops_are_closed(name: str, loops: int) -> None:
    path = next(file for file in FILES if file.name == name)
    part = read_drawing(path).part
    assert part is not None
    assert [c.closed for c in part.contours] == [True] * loops
