"""What a controller or an arm refuses of a drawing is told with the file, the unit and what can be done."""

import ezdxf
import pytest

from camgen.model.errors import NoSafeProgram, Refused
from camgen.pipeline import build


def rectangle(folder, size, units, x=0.0):
    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = units
    corners = [(x, 0), (x + size, 0), (x + size, size / 2), (x, size / 2)]
    document.modelspace().add_lwpolyline(corners, close=True)
    document.saveas(folder / "large.dxf")
    return folder / "large.dxf"


@pytest.mark.parametrize(
    ("post", "what"),
    [
        ("gcode", "a coordinate is beyond 99999 mm (instruction 10)"),
        (
            "rapid",
            "a coordinate of more than 8388 mm, which a num does not carry exactly (instruction 7)",
        ),
        (
            "vplus",
            "at (-3, 60000, 0) mm is beyond 8192 mm, where a V+ real is too coarse (instruction 7); "
            "move the origin nearer",
        ),
    ],
)
def test_a_drawing_that_leaves_the_machine_names_file_unit_and_remedy(tmp_path, post, what):
    with pytest.raises(Refused) as caught:
        build(rectangle(tmp_path, 120, units=6), post=post)
    assert str(caught.value) == (
        f"large.dxf: {post} refuses path c1: {what}; drawn in m it lies at x 0 to 120000, "
        "y 0 to 60000 mm: set input.units if that is not meant"
    )


def test_a_small_drawing_far_away_does_so_too(tmp_path):
    with pytest.raises(
        Refused,
        match=r"it lies at x 90000 to 90050, y 0 to 25 mm: set input\.units .*input\.origin",
    ):
        build(rectangle(tmp_path, 50, units=4, x=90000), post="rapid")


def test_an_arm_that_does_not_reach_names_the_unit_of_what_is_large(tmp_path):
    job = {"cell": {"robot": "IRB 120"}}
    with pytest.raises(NoSafeProgram, match=r"IRB 120 .*; drawn in m it lies at x 0 to 6000"):
        build(rectangle(tmp_path, 6, units=6), post="rapid", job=job)
    with pytest.raises(NoSafeProgram, match=r"cell\.base_from_work$"):
        build(rectangle(tmp_path, 1500, units=4), post="rapid", job=job)


def test_another_refusal_is_told_by_the_post(tmp_path):
    """In mm/min; the way down to the contact, which comes first, runs at a third of the feed unless it has its own."""
    for process, feed in (({"feed": 0.0001}, "0.002"), ({"feed": 0.0001, "plunge": 5.0}, "0.006")):
        with pytest.raises(
            Refused,
            match=rf"^gcode: a feed of {feed} mm/min is not 0\.01 to 999999 mm/min; change process",
        ):
            build(rectangle(tmp_path, 50, units=4), post="gcode", job={"process": process})


REPLAYED = "G21 G90 G94\nG0 Z5\nM3 S900\nM7\nG0 X0 Y0\nG1 Z0 F300\nG1 X50\nG0 Z5\nM9\nM5\nM2\n"


@pytest.mark.parametrize(
    ("post", "signals", "says"),
    [
        ("rapid", {}, "line 3: no output is named for spindle"),
        ("rapid", {"spindle": "aoRpm"}, "line 4: no output is named for mist"),
        ("pacscript", {}, "line 3: the signal spindle has no IO number"),
        ("gcode", {}, "line 4: signal mist has no output"),
        ("grbl", {}, "line 4: signal mist has no output"),
    ],
)
def test_an_output_that_is_none_names_the_line_that_first_switches_it(
    tmp_path, post, signals, says
):
    """Though it is put off before, by an instruction that stands on no line of what was read."""
    (tmp_path / "old.nc").write_text(REPLAYED)
    with pytest.raises(
        Refused, match=rf"^old\.nc: {post} refuses {says} .*; (set|add|give).* post\.signals"
    ):
        build(tmp_path / "old.nc", post=post, job={"post": {"signals": signals}})
