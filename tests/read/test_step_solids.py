"""STEP solids of other programs are read: names, faces without common edges, touching bodies."""

import random
import re
from importlib.util import find_spec

import numpy as np
import pytest

import camgen
from bench.read import step_shapes, step_solids
from camgen.read.solid import kernel

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


def list_notes(solid):
    return [str(note) for note in solid.notes if note.kind != "joined"]


SPELLING = step_solids.Spelling("shared", "mm", 1e-3, 0.0, "''")


def test_missing_names_are_read_as_empty(tmp_path):
    """Two instances of a box have `$` for names, also in complex entities and for identifiers."""
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
    assert [note.kind for note in solid.notes if "read as empty" in note.what] == ["assumed"]


def arrange(*bodies):
    return step_shapes.Arrangement([step_shapes.place(*body) for body in bodies], 0, 0)


def count(solid):
    """Number of edges, of concave edges and of borders."""
    return len(solid.edges), sum(not edge.convex for edge in solid.edges), len(solid.borders)


#: A plate of 60 x 40 x 20 mm with a hole of radius 6. Its edges are 12 lines and 2 circles.
PLATE = BOX._replace(loops=[*BOX.loops, step_shapes.make_circle((20.0, 15.0), 6.0, False)])


@pytest.mark.parametrize(
    ("sharing", "sewn"), [("shared", 0), ("unshared", 14), ("one face apart", 5)]
)
@pytest.mark.parametrize(("unit", "gap"), [("mm", 0.0), ("m", 0.0009), ("inch", 0.001)])
def test_faces_without_common_edges_are_sewn(sharing, sewn, unit, gap, tmp_path):
    """The face without common edges is the top, which has 4 lines and a circle."""
    spelling = {"sharing": sharing, "unit": unit, "gap": gap}
    solid = read(tmp_path / "plate.step", write(arrange((PLATE, ORIGIN)), SPELLING, **spelling))
    assert count(solid) == (14, 0, 0)
    assert solid.bodies == ("",)
    notes = list_notes(solid)
    assert len(notes) == (sewn > 0)
    for note in notes:
        match = re.fullmatch(
            r"repaired: (\d+) edges .* sewn \(.* no more than (.*) mm apart\)", note
        )
        assert int(match[1]) == sewn
        assert float(match[2]) <= max(1.1 * gap, 1e-6)


def test_faces_with_a_gap_above_the_uncertainty_stay_separate(tmp_path):
    """The top is shifted by 0.01 mm, and the file states 0.001 mm. Its 5 edges are there twice."""
    text = write(arrange((PLATE, ORIGIN)), SPELLING, sharing="one face apart", gap=0.02)
    solid = read(tmp_path / "plate.step", text)
    assert count(solid) == (14 - 5, 0, 10)
    assert list_notes(solid) == [
        "warning: 10 edges have a face on one side only "
        "(borders, not edges; faces 0.001 mm apart are sewn)"
    ]


def test_a_file_without_uncertainty_is_sewn_within_a_tenth_of_a_micrometre(tmp_path):
    text = write(arrange((PLATE, ORIGIN)), SPELLING, sharing="unshared", gap=0.9e-4)
    text, changes = re.subn(r"GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT\(\(#\d+\)\)", "", text)
    assert changes == 1
    text = re.sub(r"#\d+=UNCERTAINTY[^;]*;\n", "", text)
    assert count(read(tmp_path / "plate.step", text)) == (14, 0, 0)


def test_an_implausible_uncertainty_is_bounded(tmp_path):
    """The bound is a thousandth of the diagonal: 0.0748 mm for 60 x 40 x 20 mm."""
    text = write(arrange((PLATE, ORIGIN)), SPELLING, sharing="unshared", uncertainty=10.0)
    solid = read(tmp_path / "plate.step", text)
    assert count(solid) == (14, 0, 0)
    assert list_notes(solid)[0] == (
        "assumed: faces no more than 0.0748 mm apart belong together "
        "(the file states an uncertainty of 10 mm, too much for its size)"
    )


def test_separate_faces_are_one_body_with_outward_normals(tmp_path):
    """A box of six surfaces, of which the last one has the reversed winding."""
    text = write(arrange((BOX, ORIGIN)), SPELLING, sharing="unshared")
    last = text.rindex("ADVANCED_FACE")
    text = text[:last] + text[last:].replace(".T.)", ".F.)", 1)
    faces = re.search(r"CLOSED_SHELL\('',\(([^)]*)\)\)", text)[1].split(",")
    numbers = [f"#{9000 + k}" for k in range(len(faces))]
    shells = "".join(
        f"{n}=OPEN_SHELL('',({face}));\n" for n, face in zip(numbers, faces, strict=True)
    )
    text = re.sub(r"#\d+=CLOSED_SHELL[^;]*;\n", "", text)
    model = f"SHELL_BASED_SURFACE_MODEL('skin',({','.join(numbers)}));\n"
    text = re.sub(r"MANIFOLD_SOLID_BREP[^;]*;\n", model, text)
    text = text.replace("ADVANCED_BREP_SHAPE", "MANIFOLD_SURFACE_SHAPE")
    solid = read(tmp_path / "box.step", text.replace("ENDSEC;\nEND", f"{shells}ENDSEC;\nEND"))
    assert count(solid) == (12, 0, 0)
    assert len(solid.bodies) == 1
    assert "repaired: 1 face was wound against the others of the body and turned" in list_notes(
        solid
    )
    corners = solid.vertices[solid.faces]
    volume = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    assert volume.sum() == pytest.approx(60 * 40 * 20)


SMALL = step_shapes.make_box(20.0, 20.0, 10.0)
#: Bodies, number of edges and of concave edges, and whether the bodies are joined.
CONTACTS = {
    "equal faces: one box of 12": ([(BOX, ORIGIN), (BOX, (60.0, 0.0, 0.0))], (12, 0), True),
    "three in a row": (
        [(BOX, ORIGIN), (BOX, (60.0, 0.0, 0.0)), (BOX, (120.0, 0.0, 0.0))],
        (12, 0),
        True,
    ),
    "a foot: 12 + 8, 4 concave": ([(BOX, ORIGIN), (SMALL, (20.0, 10.0, 20.0))], (24, 4), True),
    # The fronts are flush. They divide the upper front edge, and the foot has three other sides.
    "a foot at the front": ([(BOX, ORIGIN), (SMALL, (20.0, 0.0, 20.0))], (13 + 8 + 3, 3), True),
    # Two upper edges are shorter, the foot has two other sides, and an upright edge is longer.
    "a foot in a corner": ([(BOX, ORIGIN), (SMALL, (0.0, 0.0, 20.0))], (12 + 7 + 2, 2), True),
    "1 mm apart": ([(BOX, ORIGIN), (BOX, (61.0, 0.0, 0.0))], (24, 0), False),
    "beside in one plane": ([(BOX, ORIGIN), (BOX, (100.0, 0.0, 0.0))], (24, 0), False),
    "edge to edge": ([(BOX, ORIGIN), (BOX, (60.0, 40.0, 0.0))], (24, 0), False),
}


@pytest.mark.parametrize("name", CONTACTS)
def test_bodies_that_touch_have_no_seam(name, tmp_path):
    bodies, edges, is_joined = CONTACTS[name]
    solid = read(tmp_path / "bodies.step", write(arrange(*bodies), SPELLING, name="'A 1'"))
    assert count(solid) == (*edges, 0)
    assert solid.bodies == ("A 1",) * len(bodies)
    joined = [str(note) for note in solid.notes if "touch" in note.what]
    assert bool(joined) == is_joined
    for note in joined:
        assert note.startswith(f"joined: {len(bodies)} bodies that touch are worked as 1: A 1, A 1")


def test_bodies_that_overlap_are_a_warning(tmp_path):
    """The common part is 10 x 40 x 20 mm."""
    bodies = arrange((BOX, ORIGIN), (BOX, (50.0, 0.0, 0.0)))
    solid = read(tmp_path / "bodies.step", write(bodies, SPELLING))
    assert count(solid) == (24, 0, 0)
    assert list_notes(solid) == [
        "warning: 2 bodies overlap by 8000 mm3: one without a name, one without a name "
        "(each has its edges as if it stood alone)"
    ]


def test_bodies_beside_an_overlap_are_joined(tmp_path):
    """Two boxes overlap by 10 mm, two others touch each other."""
    places = [(0.0, 0.0, 0.0), (50.0, 0.0, 0.0), (10.0, 40.0, 0.0), (70.0, 40.0, 0.0)]
    bodies = arrange(*((BOX, place) for place in places))
    solid = read(tmp_path / "bodies.step", write(bodies, SPELLING))
    assert count(solid) == (12 + 12 + 12, 0, 0)
    assert len(solid.bodies) == 4
    kinds = [(note.kind, note.what.partition(":")[0]) for note in solid.notes]
    assert ("warning", "2 bodies overlap by 8000 mm3") in kinds
    assert ("joined", "2 bodies that touch are worked as 1") in kinds


def test_a_pin_that_fills_a_hole_leaves_no_rim(tmp_path):
    """The plate and a cylinder that is as high, in its hole of radius 6, are a box."""
    pin = step_shapes.Shape([step_shapes.make_circle((6.0, 6.0), 6.0, True)], 20.0, 0, 0)
    text = write(arrange((PLATE, ORIGIN), (pin, (14.0, 9.0, 0.0))), SPELLING)
    solid = read(tmp_path / "pin.step", text)
    assert count(solid) == (12, 0, 0)


def test_bodies_that_cannot_be_joined_are_a_warning(tmp_path, monkeypatch):
    monkeypatch.setattr(kernel, "unite", lambda *_: None)
    bodies = arrange((BOX, ORIGIN), (BOX, (60.0, 0.0, 0.0)))
    solid = read(tmp_path / "bodies.step", write(bodies, SPELLING, name="'A 1'"))
    assert count(solid) == (24, 0, 0)
    assert list_notes(solid) == [
        "warning: 2 bodies that may touch cannot be joined: A 1, A 1 "
        "(where they are flush, their seam is an edge)"
    ]


def test_the_edges_of_a_void_are_concave(tmp_path):
    """A box of 60 x 40 x 20 mm has a void of 10 mm, with 12 edges each. Faces share no edges."""
    inner = step_shapes.make_box(10.0, 10.0, 10.0)
    both = arrange((BOX, ORIGIN), (inner, (5.0, 5.0, 5.0)))
    text = write(both, SPELLING, sharing="unshared", gap=0.0005)
    (outer, shell), (void, hollow) = re.findall(r"(#\d+)=MANIFOLD_SOLID_BREP\('',(#\d+)\)", text)
    text = text.replace(
        f"{outer}=MANIFOLD_SOLID_BREP('',{shell})", f"{outer}=BREP_WITH_VOIDS('',{shell},({void}))"
    )
    text = text.replace(
        f"{void}=MANIFOLD_SOLID_BREP('',{hollow})",
        f"{void}=ORIENTED_CLOSED_SHELL('',*,{hollow},.F.)",
    )
    solid = read(tmp_path / "hollow.step", text.replace(f",{outer},{void})", f",{outer})"))
    assert count(solid) == (24, 12, 0)
    assert len(solid.bodies) == 1
