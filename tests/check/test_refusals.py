"""A drawing that a controller or an arm refuses is named with its file, its unit and a remedy."""

import ezdxf
import pytest

from camgen.model.errors import NoSafeProgram, Refused
from camgen.pipeline import build


def write_rectangle(folder, size, units, x=0.0):
    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = units
    corners = [(x, 0), (x + size, 0), (x + size, size / 2), (x, size / 2)]
    document.modelspace().add_lwpolyline(corners, close=True)
    document.saveas(folder / "large.dxf")
    return folder / "large.dxf"


@pytest.mark.parametrize(
    ("post", "reason"),
    [
        ("gcode", "a coordinate is beyond 99999 mm (instruction 10)"),
        (
            "rapid",
            "a coordinate of more than 8388 mm, which a num does not carry exactly (instruction 7)",
        ),
        (
            "vplus",
            "at (-3, 60000, 0) mm is beyond 8192 mm, where a V+ real is too coarse "
            "(instruction 7); move the origin nearer",
        ),
    ],
)
def test_a_drawing_beyond_the_machine_is_refused_with_unit_and_remedy(tmp_path, post, reason):
    with pytest.raises(Refused) as caught:
        build(write_rectangle(tmp_path, 120, units=6), post=post)
    assert str(caught.value) == (
        f"large.dxf: {post} refuses path c1: {reason}; drawn in m it lies at x 0 to 120000, "
        "y 0 to 60000 mm: set input.units if that is not meant"
    )


def test_a_small_drawing_far_from_the_origin_is_refused_with_its_unit(tmp_path):
    with pytest.raises(
        Refused,
        match=r"it lies at x 90000 to 90050, y 0 to 25 mm: set input\.units .*input\.origin",
    ):
        build(write_rectangle(tmp_path, 50, units=4, x=90000), post="rapid")


def test_a_drawing_out_of_reach_is_refused_with_its_unit_if_it_is_large(tmp_path):
    job = {"cell": {"robot": "IRB 120"}}
    with pytest.raises(NoSafeProgram, match=r"IRB 120 .*; drawn in m it lies at x 0 to 6000"):
        build(write_rectangle(tmp_path, 6, units=6), post="rapid", job=job)
    with pytest.raises(NoSafeProgram, match=r"cell\.base_from_work$"):
        build(write_rectangle(tmp_path, 1500, units=4), post="rapid", job=job)


def test_a_feed_out_of_range_is_refused_by_the_post(tmp_path):
    """The plunge is the first motion with a feed.

    Without a feed of its own it runs at a third of the feed. The message is in mm/min.
    """
    for process, feed in (({"feed": 0.0001}, "0.002"), ({"feed": 0.0001, "plunge": 5.0}, "0.006")):
        with pytest.raises(
            Refused,
            match=rf"^gcode: a feed of {feed} mm/min is not 0\.01 to 999999 mm/min; change process",
        ):
            build(write_rectangle(tmp_path, 50, units=4), post="gcode", job={"process": process})


REPLAYED = "G21 G90 G94\nG0 Z5\nM3 S900\nM7\nG0 X0 Y0\nG1 Z0 F300\nG1 X50\nG0 Z5\nM9\nM5\nM2\n"


@pytest.mark.parametrize(
    ("post", "signals", "message"),
    [
        ("rapid", {}, "line 3: no output is named for spindle"),
        ("rapid", {"spindle": "aoRpm"}, "line 4: no output is named for mist"),
        ("pacscript", {}, "line 3: the signal spindle has no IO number"),
        ("gcode", {}, "line 4: signal mist has no output"),
        ("grbl", {}, "line 4: signal mist has no output"),
    ],
)
def test_an_unassigned_output_is_refused_with_the_line_that_first_sets_it(
    tmp_path, post, signals, message
):
    """An earlier instruction switches it off, but it comes from no line of the program read."""
    (tmp_path / "old.nc").write_text(REPLAYED)
    with pytest.raises(
        Refused, match=rf"^old\.nc: {post} refuses {message} .*; (set|add|give).* post\.signals"
    ):
        build(tmp_path / "old.nc", post=post, job={"post": {"signals": signals}})
