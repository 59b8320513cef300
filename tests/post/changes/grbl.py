"""GRBL: changes of a program, and what the read-back finds after each."""

from tests.support.changes import fault, remark
from tests.support.samples import Sample

TEXT = """\
(program demo)
(post grbl mm work G54)
G17 G21 G40 G54 G80 G90 G94
G91.1
M5
G49
G0 Z50
G0 X0 Y0
G0 X5 Y5 Z10
G1 Z-1.5 F120
M3 S1000
G4 P0.25
G1 X45 F600
G3 X55 Y15 I0 J10
G3 X45 Y25 I-10 J0
G1 X5 Y5 F2000
M5
(lift_)
G1 Z10
G0 X0 Y0 Z50
M2
"""
PROGRAMS = {"part": Sample("grbl", TEXT)}

CHANGES = [
    fault("part", "G0 X5", "T300\nG0 X5", "T300: GRBL has tools to T255", 0),
    fault("part", "G0 X5", "T256\nG0 X5", "T256: GRBL has tools to T255", 0),
    fault("part", "G1 Z10", "N10000001 G1 Z10", "N10000001: GRBL numbers lines to 10000000", 0),
    remark("part", "G0 X5", "G61\nG0 X5",
           "G61 changes nothing: GRBL rounds corners by its own setting", 0),
    fault("part", "M2\n", "", "the program has no end (M2 or M30)", -1),
    fault("part", "G1 X45", "G53 G0 Z0\nG1 X45",
          "G53 is not read: goes to machine coordinates, which are not known here", 0),
]  # fmt: skip
