"""G-code: changes of a program, and what the read-back finds after each."""

from tests.support.changes import fault, remark
from tests.support.samples import Sample

TEXT = """\
(program demo)
(post gcode mm work G54)
(part bracket.dxf)
G17 G21 G40 G54 G80 G90 G94
G91.1
G64 P0.01 Q0
M5
M65 P0
G53 G0 Z0
G49
G0 X0 Y0
G0 Z50
S12000 M3
G4 P1.5
G0 X5 Y5 Z10
G1 Z-1.5 F120
M64 P0
G1 X45 F600
G3 X55 Y15 I0 J10
G3 X45 Y25 I-10 J0
G1 X5 Y5 F2000
M65 P0
(lift)
G1 Z10
M5
G0 X0 Y0 Z50
M2
"""
IDLE = """\
G17 G21 G40 G54 G80 G90 G94
G91.1
G64 P0.01 Q0
G53 G0 Z0
G49
G0 X0 Y0
G0 Z50
G1 X5 F100
G1 Z2
M2
"""
PROGRAMS = {"part": Sample("gcode", TEXT), "idle": Sample("gcode", IDLE)}

CHANGES = [
    remark("part", "G0 X5", "G61\nG0 X5",
           "G61 where post.path_tolerance asks for G64 P0.01: corners take another time", 0),
    fault("part", "M64 P0", "M64 P99",
          "M64 P99: the machine has 4 such outputs from P0 (post.outputs)", 0),
    fault("part", "M64 P0", "M62 P4",
          "M62 P4: the machine has 4 such outputs from P0 (post.outputs)", 0),
    fault("part", "M64 P0", "M64 P0\nM68 E4 Q1",
          "M68 E4: the machine has 4 such outputs from E0 (post.outputs)", 1),
    fault("part", "M2\n", "", "the program has no end (M2 or M30)", -1),
    fault("part", "G1 X45", "G53 G0 Z0\nG1 X45",
          "G53 is not read: goes to machine coordinates, which are not known here", 0),
    remark("idle", "G1 Z2", "T1 Z2", "T1 selects a tool that no M6 changes to", 0),
    remark("idle", "G1 Z2", "S1 Z2", "S1 without M3 or M4", 0),
    remark("idle", "G1 Z2", "T0 Z2", "T0 selects a tool that no M6 changes to", 0),
    remark("idle", "G1 Z2", "G18 Z2", "G18 where posts write in G17", 0),
    remark("idle", "G1 Z2", "G90.1 Z2", "G90.1 where posts write in G91.1", 0),
    remark("idle", "G53 G0 Z0\n", "G53 G0 Z0\nM5\n",
           "an output is switched when the machine has moved already (G53)", 1),
    remark("idle", " Q0", "", "G64 without Q joins lines within P", 0),
    remark("idle", "G0 X0 Y0\nG0 Z50", "G0 Z50\nG0 X0 Y0",
           "Z comes down from the top of the machine before X and Y are over the part", 0),
]  # fmt: skip
