"""Every drawing of the shared data: the length of what is used is the measured one, or the refusal is a good one."""

import json
import math
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from camgen.model.errors import InputError
from camgen.model.job import Job
from camgen.model.part import Contour, Part
from camgen.read import dxf
from camgen.read.files import Files
from camgen.read.units import INSUNITS, MM
from tests.support.files import source

DATA = Path(__file__).parents[2].parent / "shared" / "data"
FILES = sorted(p for p in DATA.glob("dxf/*/*") if p.suffix.lower() == ".dxf")
pytestmark = pytest.mark.skipif(
    not FILES, reason="the folder shared/data beside the repository is absent"
)

#: Nothing in them can be machined; the start of the reason.
REFUSED = {
    "invisible-lwpolylines-in-block.dxf": "nothing to machine",  # its only curve is invisible (group 60)
    "tables.dxf": "nothing to machine",  # no entity in it
    "bin_dxf_r2000.dxf": "nothing to machine (1 TEXT",
    "circle_radius_le_0.dxf": "nothing to machine (dropped: 2 CIRCLE",  # radius 0 and -1
    "BlockClippedBasicTransform.dxf": "nothing to machine (6 INSERT",  # all clipped
    "TransformedBlockClipped.dxf": "nothing to machine (4 INSERT",  # all clipped
    "Leica_Disto_S910.dxf": "nothing to machine (11 TEXT",  # lines in space
    "POLI-ALL210_12.DXF": "nothing to machine (1 3DFACE",  # polylines in tilted planes
    "cc_dxflib.dxf": "nothing to machine (3-D POLYLINE #B",  # not flat
    "cycloidal.dxf": "damaged beyond repair: missing 'AcDbSpline'",
}
#: Length of the duplicates in drawing units: first that of LINEs with equal ends, measured from the
#: LINEs alone; then that of partial overlaps, by the union of all curves that shapely makes on a
#: grid of 0.02 mm for the states, of 0.001 mm for the others.
TWICE = {
    "5_us_states.dxf": 111.642412 + 4.965,
    # Its closed contours have 166 of common edges, which stay with both.
    "wipeout_door.dxf": 432.0 + 1268.0 - 166.0,
    "uncommon.dxf": 10.0,
    "broken_pair.dxf": 0.25,
}
#: Lengths that the measurement lacks, in drawing units, each worked out from the numbers in the file.
MISSING = {
    # A block whose six lines were measured, but neither its three quarter rounds of radius 1/4 nor the array of 14
    # circles of radius 0.13 in it.
    "arrayed-holes.dxf": 3 * math.pi / 8 + 14 * 2 * math.pi * 0.13,
    # 2 of its 111 lines, 8 long each, share a handle with another and were dropped before the measurement.
    "duplicate_handles.dxf": 16.0,
}


class Look(NamedTuple):
    """A drawing read and inspected; error: the refusal of reading it."""

    part: Part | None
    error: str
    counts: dict[str, int]


@cache
def look(path: Path) -> Look:
    """Loading takes most of the time: a drawing is loaded once for both."""
    opened = source(path)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(dxf, "load_document", cache(dxf.load_document))
        try:
            counts = dict(dxf.inspect(opened, Job(), Files()).counts)
        except InputError:
            counts = {}
        try:
            return Look(dxf.read(opened, Job(), Files()), "", counts)
        except InputError as error:
            return Look(None, str(error), counts)


def truth() -> dict[str, Any]:
    lines = (DATA / "truth.jsonl").read_text().splitlines() if DATA.exists() else []
    return {entry["file"]: entry for entry in map(json.loads, lines) if "file" in entry}


TRUTH = truth()


def length(contour: Contour) -> float:
    chords = np.hypot(*(np.roll(contour.points, -1, axis=0) - contour.points).T)
    sweeps = 4 * np.arctan(np.abs(contour.bulges))
    lengths = chords / np.sinc(sweeps / (2 * math.pi))
    return float(lengths.sum() if contour.closed else lengths[:-1].sum())


def scale(entry: dict[str, Any]) -> float:
    """mm per unit. The measured unit of a text without $INSUNITS is the default of the measuring program."""
    code = entry["insunits"] if entry["binary"] else entry["insunits_raw"]
    return MM[INSUNITS.get(code or 0, "mm")]


def test_all_drawings_are_there() -> None:
    assert len(FILES) == sum(name.startswith("dxf/") for name in TRUTH) > 50


@pytest.mark.parametrize("path", [p for p in FILES if p.name not in REFUSED], ids=lambda p: p.name)
def test_length_is_the_measured_one(path: Path) -> None:
    entry = TRUTH[str(path.relative_to(DATA))]
    part = look(path).part
    assert part is not None
    expected = (
        entry["visible_exact"] - TWICE.get(path.name, 0) + MISSING.get(path.name, 0)
    ) * scale(entry)
    assert sum(map(length, part.contours)) == pytest.approx(expected, rel=0.005)
    assert all(str(n).isprintable() for n in part.notes)


@pytest.mark.parametrize("path", [p for p in FILES if p.name in REFUSED], ids=lambda p: p.name)
def test_refused_in_one_line(path: Path) -> None:
    error = look(path).error
    assert error.startswith(f"{path.name}: {REFUSED[path.name]}")
    assert error.isprintable()


#: No reading at all, or measured with clipped references expanded, which are not used (see REFUSED).
NOT_COUNTED = {"cycloidal.dxf", "BlockClippedBasicTransform.dxf", "TransformedBlockClipped.dxf"}


@pytest.mark.parametrize(
    "path", [p for p in FILES if p.name not in NOT_COUNTED], ids=lambda p: p.name
)
def test_inspect_counts_at_least_what_was_measured(path: Path) -> None:
    """At least: the measurement leaves out what is damaged and what it cannot expand."""
    counts = look(path).counts
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
def test_loops(name: str, loops: int) -> None:
    path = next(p for p in FILES if p.name == name)
    part = look(path).part
    assert part is not None
    assert [c.closed for c in part.contours] == [True] * loops
