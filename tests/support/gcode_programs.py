"""Programs of tests for G-code, and calls of the post and of the read-back."""

import math

from camgen.model.program import Comment, Force, MoveC, MoveJ, MoveL, Output, Wait
from camgen.post.plugins import find_post, find_readback, make_post
from tests.support.rs274 import at, program

#: End of a remark about modes that a program does not set before it moves.
UNSAID = "not set before the first motion: the program before may have left it otherwise"
#: Coordinates of a point at 45 deg on a circle of radius 10.
S = 10 / math.sqrt(2)
#: The modes that a program sets before it moves.
SAFE = "G17 G21 G40 G54 G80 G90 G91.1 G94"


def gcode(**options):
    return make_post(find_post("gcode"), options)


def read(text, **options):
    return find_readback("gcode")({"part.ngc": text}, options)


def list_faults(*lines, **options):
    """Line and message of each finding; the first of `lines` is line 1."""
    text = "\n".join([f"{SAFE} G64 P0.01 Q0", "G0 Z5", "G0 X0 Y0", *lines, "M2", ""])
    return [(fault.line - 3, fault.what) for fault in read(text, **options).findings]


# The arcs are two quarters of a circle about (45, 15), counter-clockwise from (45, 5) to (45, 25).
PART = program(
    Output("spindle", 12000.0),
    Wait(1.5),
    MoveJ(at(5, 5, 10), 100.0),
    MoveL(at(5, 5, -1.5), 2.0),
    Output("process", 1.0),
    MoveL(at(45, 5, -1.5), 10.0, 1.0),
    MoveC(at(45 + S, 15 - S, -1.5), at(55, 15, -1.5), 10.0, 1.0),
    MoveC(at(45 + S, 15 + S, -1.5), at(45, 25, -1.5), 10.0),
    MoveL(at(5, 5, -1.5), 100 / 3),
    Output("process", 0.0),
    Comment("lift"),
    MoveL(at(5, 5, 10), 100 / 3),
    Output("spindle", 0.0),
    MoveJ(at(0, 0, 50), 100.0),
    header=("part bracket.dxf",),
)


PRESSED = program(
    MoveL(at(0, 0, 0), 10.0),
    Force(10.0, (1.0, 0.0, 0.0)),
    MoveL(at(10, 0, 0), 10.0, 1.0, 10.0, (1.0, 0.0, 0.0)),
    MoveL(at(20, 0, 0), 10.0, 0.0, 12.5, (1.0, 0.0, 0.0)),
    MoveL(at(30, 0, 0), 10.0),
    Force(0.0),
    MoveL(at(30, 0, 9), 10.0),
)
