"""G-code: LinuxCNC runs printed texts as planned, and other texts as the read-back reads them."""

import math
import re
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given

from camgen.geometry.arcs import compute_circle
from camgen.model.program import Comment, MoveC, MoveJ, MoveL, Output
from tests.support.examples import fewer
from tests.support.gcode_programs import PART, PRESSED, UNSAID, gcode, read
from tests.support.rs274 import (
    assert_moves,
    at,
    difference,
    moves,
    needs_rs274,
    posted,
    program,
    programs,
    run,
)

DATA = Path(__file__).parents[2].parent / "shared" / "data" / "gcode"
#: A program that ends at a low height with the tool length, 30 mm, still applied.
BEFORE = "G21 G90 G40\nT1 M6\nG43\nG0 X70 Y80 Z2\n"
LONG_TOOL = "T1 P1 Z30 D3.0 ;cutter\n"


@needs_rs274
def test_a_tool_length_that_is_applied_is_cancelled_at_the_top_of_the_machine():
    """The tool is lifted before the length is cancelled.

    Without the lift its height would be wrong.
    """
    ready, text = posted(gcode(), PART)
    canon = run(BEFORE + text, LONG_TOOL)
    assert canon.error == ""
    traverses = [call for call in canon.calls if call.kind == "STRAIGHT_TRAVERSE"]
    start, top, across, home = traverses[:4]
    assert start.end == (70, 80, 2)
    # With the length applied, the zero of the machine is lower in the work frame by that length.
    assert top.end[:2] == (70, 80)
    assert top.end[2] < -29
    assert across.end == (0, 0, 0)
    assert home.end == (0, 0, 50)
    assert canon.names.index("USE_TOOL_LENGTH_OFFSET") < canon.names.index("STRAIGHT_FEED")
    assert_moves(ready, run(text, LONG_TOOL))


@needs_rs274
@pytest.mark.parametrize(
    ("before", "refused"),
    [("G91\n", True), ("G91 ", True), ("", False), ("G90 ", False), ("G91\nG90 ", False)],
)
def test_the_reader_refuses_machine_coordinates_where_linuxcnc_does(before, refused):
    """LinuxCNC refuses G53 among increments, also those of the same line."""
    text = f"G21 G61\n{before}G53 G0 Z0\nG49 G90\nG0 X1 Y2\nG0 Z3\nM2\n"
    canon = run(text)
    assert bool(canon.error) == refused
    faults = [f.what for f in read(text).findings if f.level != "unusual"]
    assert faults[:1] == (["G53 among increments (G91)"] if refused else [])
    if not refused:
        (home,) = read(text).body
        (reached,) = moves(canon)
        assert home.target.origin == reached.end == (1, 2, 3)


@needs_rs274
@pytest.mark.parametrize("options", [{}, {"tool": 1}, {"path_tolerance": 0.0}, {"lift": False}])
def test_linuxcnc_moves_as_planned(options):
    ready, text = posted(gcode(**options), PART)
    canon = run(text)
    assert canon.error == ""
    assert_moves(ready, canon)
    switches = [
        (c.kind, c.value) for c in canon.calls if not c.kind.startswith(("STRAIGHT", "ARC"))
    ]
    stops = [("STOP_SPINDLE_TURNING", 0.0)] if "tool" in options else []  # M6 stops the spindle
    assert switches == [
        ("STOP_SPINDLE_TURNING", 0.0),
        ("CLEAR_AUX_OUTPUT_BIT", 0.0),
        *stops,
        ("START_SPINDLE_CLOCKWISE", 12000.0),
        ("DWELL", 1.5),
        ("SET_AUX_OUTPUT_BIT", 0.0),
        ("CLEAR_AUX_OUTPUT_BIT", 0.0),
        ("STOP_SPINDLE_TURNING", 0.0),
        ("STOP_SPINDLE_TURNING", 0.0),  # M2 itself
    ]


@needs_rs274
def test_linuxcnc_sets_the_forces_as_planned():
    canon = run(posted(gcode(force="analog", force_scale=0.2), PRESSED)[1])
    presses = [(i, c.kind, c.value) for i, c in enumerate(canon.calls) if "OUTPUT_VALUE" in c.kind]
    assert canon.error == ""
    assert presses == [
        (0, "SET_AUX_OUTPUT_VALUE", 0.0),
        (5, "SET_AUX_OUTPUT_VALUE", 2.0),
        (7, "SET_MOTION_OUTPUT_VALUE", 2.5),
        (9, "SET_MOTION_OUTPUT_VALUE", 0.0),
        (11, "SET_AUX_OUTPUT_VALUE", 0.0),
    ]


HOSTILE = [
    "MSG, stop",
    "DEBUG,#1",
    "print,x",
    " log,x",
    "PROBEOPEN a",
    "a) G0 Z-50 (b",
    "a\nG0 Z-50",
    "!~?%",
    "Größe ö\x18",
    "",
]


@needs_rs274
def test_a_comment_is_never_executed():
    body = [Comment(text) for text in HOSTILE]
    plan = program(*body, MoveL(at(1, 0, 0), 10.0), name="p) M3 (x", header=("MSG, h",))
    ready, text = posted(gcode(), plan)
    assert text.isascii()
    assert not set(text) & set("!~?%")
    canon = run(text)
    assert canon.error == ""
    assert not {"MESSAGE", "LOG", "LOGOPEN"} & set(canon.names)
    assert_moves(ready, canon)
    assert difference(ready, read(text), gcode().tolerance()) == ""
    assert "(- MSG_ stop)" in text


@needs_rs274
@fewer(12, [HealthCheck.too_slow])
@given(programs())
def test_linuxcnc_and_the_read_back_run_a_generated_program_as_planned(plan):
    ready, text = posted(gcode(), plan)
    assert difference(ready, read(text), gcode().tolerance()) == ""
    canon = run(text)
    assert canon.error == ""
    assert_moves(ready, canon)
    bits = [c.kind == "SET_AUX_OUTPUT_BIT" for c in canon.calls if "OUTPUT_BIT" in c.kind]
    assert bits == [item.value == 1 for item in ready.body if isinstance(item, Output)]


# Lines that the reader and LinuxCNC know, in every spelling. LinuxCNC decides what they mean.

SPELLINGS = {
    "blanks and case": "g 2 1\ng 0 z 5\n g0 x1. y+.5\nG01 X 1 0 f1 00\nm02",
    "numbers and comments": (
        "N10 G21 (a ; b)\nN20 G0 Z5 ; x ( y\nN30 G0 X1 (p) Y2 (q)\n(only)\n\nM30"
    ),
    "inches": "G20\nG0 Z1\nG0 X1 Y0\nF10 G1 X2\nG2 X3 Y1 I1 J0\nG21 G1 X0\nM2",
    "increments": "G21\nG0 X1 Y1 Z1\nG91 G1 X1 F60\nY2 Z-1\nG90 X0\nM2",
    "modal arcs": "G21\nG0 X0 Y0 Z0\nF60 G2 X2 I1\nX4 I1\nG3 X2 R1\nM2",
    "absolute centre": "G21\nG0 X0 Y0 Z0\nG90.1 F60 G3 X0 Y4 I0 J2\nM2",
    "radius short": "G21\nG0 X0 Y0 Z0\nF60 G3 X3 Y3 R3\nG2 X0 Y0 R3\nM2",
    "radius long": "G21\nG0 X0 Y0 Z0\nF60 G3 X3 Y3 R-3\nG2 X0 Y0 R-3\nM2",
    "radius half": "G21\nG0 X0 Y0 Z0\nF60 G3 X4 R1.999\nM2",
    "circles": "G21\nG0 X0 Y0 Z0\nF60 G2 I2\nG3 X0 Y0 J1\nG3 I1 P3\nM2",
    "xz plane": "G21 G18\nG0 X0 Y0 Z0\nF60 G2 X2 I1\nG3 X4 Z1 I1 K0.5\nG2 K3\nM2",
    "yz plane": "G21 G19\nG0 X0 Y0 Z0\nF60 G2 Y2 J1\nG3 Y4 Z1 J1 K0.5\nG3 Y6 Z1 R-4\nM2",
    "helix": "G21\nG0 X0 Y0 Z0\nF60 G2 X2 Z-1 I1\nG3 I2 Z3 P2\nM2",
    "per cent": "%\nG21\nG0 X0 Y0 Z0\n%\n",
    "order in a line": "G21\nG0 X0 Y0 Z0\nG1 X1 F60 M3 S500 G4 P1\nX2 S600 M8\nM9 M5 X3\nM2",
}


@needs_rs274
@pytest.mark.parametrize("text", SPELLINGS.values(), ids=SPELLINGS)
def test_the_reader_reads_a_text_as_linuxcnc_runs_it(text):
    reading = read(text)
    allowed = [
        "neither G49 nor G43 before the first motion: a tool length that is on shifts Z",
        "neither G61 nor G64 P before the first motion: corners may be rounded by any amount",
    ]
    unusual = re.compile(
        f"{UNSAID}|where posts write in|posts write M2|Z moves together with X or Y"
    )
    assert [f.what for f in reading.findings if not unusual.search(f.what)] == allowed
    canon = run(text)
    assert canon.error == ""
    calls = [call for call in canon.calls if call.kind.startswith(("STRAIGHT", "ARC"))]
    lines = {}
    for line, item in zip(reading.lines, reading.body, strict=True):
        if isinstance(item, (MoveJ, MoveL, MoveC)):
            lines.setdefault(line, []).append(item)
    lifts = len(calls) - len(lines)
    assert lifts in (0, 1)
    start = calls[0].end
    for items, call in zip(lines.values(), calls[lifts:], strict=True):
        assert math.dist(items[-1].target.origin, call.end) < 3e-3
        if call.kind == "ARC_FEED":
            assert_on_arc(start, items, call)
        else:
            kind = MoveJ if call.kind == "STRAIGHT_TRAVERSE" else MoveL
            assert [type(item) for item in items] == [kind]
        if not isinstance(items[0], MoveJ):
            assert all(abs(item.speed * 60 - call.feed) < 3e-3 for item in items)
        start = call.end


def assert_on_arc(start, items, call):
    """The points of `items` are on the arc of LinuxCNC, and their sweeps add up to its sweep.

    Each arc of `items` sweeps at most half a circle.
    """
    a, b, _ = call.axes
    normal = 3 - a - b
    radius = math.hypot(call.end[a] - call.centre[0], call.end[b] - call.centre[1])
    points = [start]
    for item in items:
        if isinstance(item, MoveC):
            points.append(item.via.origin)
        points.append(item.target.origin)
    angles = [math.atan2(p[b] - call.centre[1], p[a] - call.centre[0]) for p in points]
    steps = [math.remainder(q - p, math.tau) for p, q in pairwise(angles)]
    least = math.copysign((abs(call.turns) - 1) * math.tau, call.turns)
    rest = (math.copysign(1, call.turns) * (angles[-1] - angles[0])) % math.tau
    rest = math.tau if min(rest, math.tau - rest) < 1e-4 else rest
    assert sum(steps) == pytest.approx(least + math.copysign(rest, call.turns), abs=2e-3)
    assert max(map(abs, steps)) < math.pi / 2 + 1e-3
    lift = 0.0
    for point, step in zip(points[1:], steps, strict=True):
        lift += (call.end[normal] - start[normal]) * step / sum(steps)
        assert abs(math.hypot(point[a] - call.centre[0], point[b] - call.centre[1]) - radius) < 3e-3
        assert abs(point[normal] - start[normal] - lift) < 3e-3


def measure_read(body):
    """Length of the feed motions and arcs of a reading, mm."""
    position, length = (0.0, 0.0, 0.0), 0.0
    for item in body:
        if isinstance(item, MoveL):
            length += math.dist(position, item.target.origin)
        elif isinstance(item, MoveC):
            _, radius, _, sweep = compute_circle(position, item.via.origin, item.target.origin)
            length += radius * sweep
        if isinstance(item, (MoveJ, MoveL, MoveC)):
            position = item.target.origin
    return length


def measure_run(calls):
    """Length of the feed motions and arcs that LinuxCNC runs, mm."""
    position, length = (0.0, 0.0, 0.0), 0.0
    for call in calls:
        if call.kind == "STRAIGHT_FEED":
            length += math.dist(position, call.end)
        elif call.kind == "ARC_FEED":
            (cx, cy), sense = call.centre, math.copysign(1, call.turns)
            begin, end = (math.atan2(p[1] - cy, p[0] - cx) for p in (position, call.end))
            sweep = (sense * (end - begin)) % math.tau or math.tau
            length += math.hypot(position[0] - cx, position[1] - cy) * sweep
        if call.kind.startswith(("STRAIGHT", "ARC")):
            position = call.end
    return length


@pytest.mark.skipif(not DATA.is_dir(), reason="no shared/data/gcode beside the repository")
@needs_rs274
@pytest.mark.parametrize(
    "name",
    [
        "bCNC/sample",
        "cncjs/circle",
        "cncjs/circle-inch",
        "cncjs/jsdc",
        "cncjs/tball-engrave-laser",
        "svg2gcode/shapes",
        "svg2gcode/smooth_curves_circular_interpolation",
    ],
)
def test_a_third_party_program_has_the_length_that_linuxcnc_runs(name):
    text = (DATA / f"{name}.gcode").read_text()
    assert measure_read(read(text).body) == pytest.approx(measure_run(run(text).calls), rel=1e-4)
