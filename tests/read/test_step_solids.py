"""STEP solids of other programs: names, faces without common edges, bodies that touch."""

import random
from importlib.util import find_spec

import pytest

import camgen
from bench.read import step_shapes, step_solids

pytestmark = pytest.mark.skipif(
    find_spec("OCP") is None, reason="the extra step (the package OCP) is not installed"
)
BOX = step_shapes.make_box(60.0, 40.0, 20.0)
ORIGIN = (0.0, 0.0, 0.0)


def write(arrangement, spelling, **changes):
    rng = random.Random(1)
    return step_solids.write(arrangement, spelling._replace(**changes), rng)


def read(path, text):
    path.write_text(text)
    return camgen.read(path).solid


def say(solid):
    return [str(note) for note in solid.notes if note.kind != "joined"]


SPELLING = step_solids.Spelling("shared", "mm", 1e-3, 0.0, "''")


def test_a_name_that_is_not_given_is_no_damage(tmp_path):
    """Two instances of a box: `$` also in records of complex entities, and for the identifiers."""
    moved = step_shapes.place(BOX, (100.0, 0.0, 0.0))
    box = step_shapes.place(BOX, ORIGIN)
    pair = step_shapes.Arrangement([box], 24, 0, (box, moved))
    text = write(pair, SPELLING, name="$")
    assert "REPRESENTATION_RELATIONSHIP($,$," in text
    assert "REPRESENTATION_CONTEXT('','')" in text
    text = text.replace("REPRESENTATION_CONTEXT('','')", "REPRESENTATION_CONTEXT($,$)")
    text = text.replace("SI_UNIT(.MILLI.", "SI_UNIT($").replace("'design'", "$")
    solid = read(tmp_path / "names.step", text)
    assert solid.units == "m"
    assert len(solid.edges) == 24
    extent = solid.vertices.max(axis=0) - solid.vertices.min(axis=0)
    assert extent.tolist() == pytest.approx([160e3, 40e3, 20e3])
    assert [note.kind for note in solid.notes if "taken as empty" in note.what] == ["assumed"]
