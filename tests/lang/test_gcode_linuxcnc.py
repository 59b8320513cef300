"""Compares G-code programs with the interpreter of LinuxCNC.

The programs have threads, taps, stored positions, subprograms and tools.
"""

import random

import pytest

from bench.read.replay import compare_motions
from camgen.lang.gcode.language import run_gcode
from camgen.lang.programs import RunRequest
from camgen.lang.recorded import ProgramRun
from tests.support import canon
from tests.support.rs274 import needs_rs274

#: Two tools without a length, diameters of 0.1 and 0.05 inches: the unit of rs274's machine.
TOOLS = "T1 P1 Z0 D0.1 ;a\nT2 P2 Z0 D0.05 ;b\n"
#: The stored positions of the machine of rs274, at its zero, which is that of the program.
ASSUMED = {
    **dict.fromkeys(("g28.x", "g28.y", "g28.z"), 0.0),
    **dict.fromkeys(("g30.x", "g30.y", "g30.z"), 0.0),
    **dict.fromkeys(("machine.x", "machine.y", "machine.z"), 0.0),
    "t1.diameter": 2.54,
    "t2.diameter": 1.27,
}
LEAD = ("G21 G90 G64 G17", "F100 S100 M3", "G0 X0 Y0 Z30")

#: Programs, one per row, with "|" between their lines.
PROGRAMS = """
G28
G28 X5
G91 G28 Z3 | G90 G1 X1 Z2
G30 Y2 Z40
G1 X3 Y4 Z5 | G28.1 | G0 X9 | G28 Z7 | G28
G53 G0 Z1
G53 G1 X5 Y6 | X7
G92 X5 | G53 G0 X1 | G1 X2
G52 X5 | G1 X1 | G52 X0 | G1 X2
G92 X5 Y5 | G92.2 | G1 X1 | G92.3 | G1 X2 | G92.1 | G1 X3
G92 X5 | G92.1 | G92.3 | G1 X2
G92 X5 | G92.3 | G1 X2
G92 X5 Y5 | G92.2 | G92 X1 | G92.3 | G1 X1 Y1
G52 X5 | G92.2 | G92.3 | G1 X1
G10 L2 P1 X5 | G1 X1
G10 L20 P1 X5 | G1 X1 | G54 | X2
G10 L2 P2 X5 Y1 Z2 | G10 L2 P1 X0 Y0 Z0 | G55 | G1 X1 | G54 | X1
G43 H1 | G1 Z5 | G49 | G1 Z6
T2 M6 | G43 | M3 S100 | G1 Z5 | T1 M6 | G1 X5
G43 H2 Z5 | G1 X1
M70 | G91 G20 | G1 X1 | M72 | G1 X1
M70 | G91 | M71 | M72 | G1 X1
M72
G7 | G1 X10 | G8 | X10
M0 | M1 | G1 X1
M52 P1 | M50 P0 | M53 P1 | G1 X1
G33 Z5 K1
G33 X3 Z5 K1
M5 | G33 Z5 K1
G84 X1 Y2 Z-1 R5
G98 G84 X1 Y2 Z-1 R5 P0.5 | X4
G84 X1 Z-1 R5 L2 | G80
M4 | G74 X1 Y1 Z-2 R3
M4 | G84 X1 Y1 Z-2 R3
G87 X1 Y1 Z-1 R2 I1 J1 K1
G18 G0 X30 Z5 | G76 P1 Z-10 I-2 J0.5 K2 R1 Q29 H1 E1 L2
G18 G0 X30 Z5 | G76 P1.5 Z-10 I2 J0.4 K2 R2 Q29.5 H2 E1 L3
G18 G0 X30 Z5 | G76 P1.5 Z-10 I-1 J0.4 K1.2 R1.5 Q0 L1 E0.5 | G1 X1
G18 G0 X30 Z5 | G76 P1 Z-10 I-2 J0.5 K2
G18 G0 X30 Z5 | G76 P1 Z-10 I-1 J0.5 K1 H101
G18 G0 X30 Z5 | G76 P1 Z-10 I-1 J0.5 K1 H1.5
G18 G0 X30 Z5 | G76 P1 Z-10 I-1 J0.5 K1 L1.5 E0.1
o1 repeat [1.5] | G91 G1 X1 | o1 endrepeat
o1 repeat [2.5] | G91 G1 X1 | o1 endrepeat
o1 repeat [2.51] | G91 G1 X1 | o1 endrepeat
o1 repeat [-1] | G91 G1 X1 | o1 endrepeat
o1 if [0] | G1 X1 | o1 endif | o1 if [1] | G1 X2 | o1 endif
o1 if [1] | G1 X1 | o1 endif | o1 repeat [2] | G1 X2 | o1 endrepeat
o1 while [#1 LT 1] | #1=[#1+1] | o1 endwhile | o1 while [#1 LT 2] | #1=[#1+1] | o1 endwhile
o2 repeat [3] | o1 if [1] | G1 X1 | o1 endif | o2 endrepeat
o5 sub | o1 if [1] | G1 X1 | o1 endif | o5 endsub | o1 if [1] | G1 X2 | o1 endif | o5 call
M98 P100 L2.5 | M2 | O100 | G91 G1 X1 | G90 | M99
M98 P100 L2 | G1 X9 | M2 | O100 | G91 G1 X1 | G90 | M99
G91 G81 X1 R-5 Z-2 L3 F60
G81 @10 ^30 Z-1 R2 | ^60
G0 X10 | G91 G81 ^60 R-5 Z-1 L6
G0 @10 ^30 | G91 G81 ^20 Z-1 R-5 L3 | ^10
F600 | G20 F60 | G1 X1
G1 X1 D1
H3
M5 $0 | G1 X1
G5 X1
G5.2 P1 L3 X5 Y5 | X9 Y5 | X9 Y0 | G5.3
G5.2 P1 X5 | X9 Y5 P1 | X9 Y0 P1 | G5.3
G5.2 P1 | P1 | X9 Y5 P1 | X9 Y0 P1 | G5.3
G5.2 P1 X5 Y5 | X9 Y5 P1 L4 | G5.3
G5.1 X1
G5.1 X5 Y0 I2 J3 P1
G54 P1
G10
G10 P1 R2
G18 G5.1 X1 I1
G96 D1000 S100 | G1 X1
G95 F1 | G1 X5 | G81 X1 Y1 Z-1 R1
M61 Q2 | G1 X1
M6
M20
G22
M62 P0 | G1 X1
#5070=1 | G1 X1
#5220=1
#5400=1
#5161=4 | G1 X#5161
G54 G55 G1 X1
G10 L2 P12 X1
G28.5
G0 G28 X1
G0 G92 X1
G2 X10 Y0 I5 J0 | I-15 J0
G2 X10 Y0 I5 J0 | X5
M70 | M71 | G1 X1
M99
M97 P1
G4
G4 P-1
G38.6 X1
G0 I1
G73 X1 Z-1 R2
G83 X1 Z-1 R2 Q0.5 P1
G81 X1 Z-1 R2 Q1
G81 X1 Z-1 R2 L0
(a (b) c)
(open
G42 D1 G1 X10 Y0 | X20 | Y10 | X0 | Y-10 | G40 G1 X0 Y0
G41 D1 G1 X10 Y0 | X20 | Y10 | X0 | Y-10 | G40 G1 X0 Y0
G41 D1 G1 X10 Y0 | X20 | Z5 | Y10 | G1 X0 Z3 | G40 G1 X0 Y-5
G42 D1 G1 X10 Y0 | X20 | Z5 | Y10 | G1 X0 Z3 | G40 G1 X0 Y-5
G41 D1 G1 X10 | G2 X20 Y0 I5 J0 | G1 X30 | G40 X35
G42 D1 G1 X10 | G2 X20 Y0 I5 J0 | G1 X30 | G40 X35
G41 D1 G1 X10 | G3 X20 Y0 I5 J0 | G1 X30 | G40 X35
G41 D1 G1 X10 | X20 | G3 X30 Y10 I0 J10 | G1 Y20 | G40 Y25
G42 D1 G1 X10 | X20 | G3 X30 Y10 I0 J10 | G1 Y20 | G40 Y25
G42 D1 G1 X10 | X20 | G2 X20 Y0 I0 J-5 | G1 X30 | G40 X35
G41 D1 G1 X10 | G3 X20 Y0 R6 | G3 X30 Y0 R7 | G1 X40 | G40 X45
G42 D1 G1 X10 | G3 X20 Y0 R6 | G3 X30 Y0 R7 | G1 X40 | G40 X45
G41 D1 G0 X10 | G0 X20 Y5 | G1 X30 Y3 | G40 X35
G41.1 D3 G1 X10 | X20 | Y10 | G40 X35
G41 D1 G1 X1 | X20
G41 D1 G2 X10 Y0 I5 J0 | G1 X20
G42 D1 G2 X10 Y0 I5 J0 | G1 X20 | G40 X30
G41 D1 G3 X10 Y0 R6 | G3 I-3 | G1 X20
G41 D1 G3 X1 Y0 I0.5
G41 D1 G1 X10 | G3 X12 Y0 I1 J0
G41 D1 G1 X10 | X20 | X20 Y0.5 | X10 | G40 X5
G41 D1 G1 X10 | X20 | X30 Y0.3 | X40 Y0 | X50 Y-0.3 | G40 X55
G41 D1 G1 X10 | X20 Y0 | X10 Y0 | G40 X0
G18 G41 D1 G1 X10 | Z20 | X0 | Z30 | G40 X5
G18 G42 D1 G1 X10 | Z20 | G2 X0 Z10 I-5 K-5 | G1 X-10 | G40 X-15
G19 G41 D1 G1 Y10 | Y20
G41 D1 G1 X10 | X20 | G40 | G2 X30 Y0 I5 J0
G41 D1 G1 X10 | G91 X10 | Y10 | X-20 | G90 G40 X5
G41 D1 G1 X10 | X20 | G42 D1 | X30
G41 D1 G1 X10 | X20 | G41 D2 | X30
G41 D1 G1 X10 | M62 P0 | X20 | G4 P1 | Y10 | M0 | X0 | G40 X-5 Y-5
G41 D1 G1 X10 | X20 | M2
G41 D1 G1 X10 | X20 | G81 X5 Y5 Z-1 R1
G41 D1 | G1 Z5 | X10 | X20 | G40 | Z30 | X0
G41 D1 G1 X10 | X20 Y10 | X30 Y0 | G2 X40 Y0 I5 J0 Z5 | G1 X50 | G40 X55
""".strip().split("\n")


def describe_difference(lines):
    """The first difference to the motions of LinuxCNC, "" without one; refusals must agree."""
    text = "\n".join(lines) + "\n"
    executed, reference = (
        run_gcode({"a.ngc": text}, RunRequest("linuxcnc", ASSUMED)),
        canon.run(text, TOOLS),
    )
    assert executed.stopped is None
    refused = [finding.what for finding in executed.findings if finding.level == "refused"]
    if refused or reference.error:
        return "" if refused and reference.error else f"here {refused}, there {reference.error!r}"
    run = ProgramRun(tuple(executed.body), executed.lines, (), 0, 0.0, None, True, "mm")
    return compare_motions(run, reference).fault


@needs_rs274
@pytest.mark.parametrize("program", PROGRAMS)
def test_a_program_has_the_motions_of_linuxcnc(program):
    assert describe_difference([*LEAD, *program.split(" | "), "M2"]) == ""


def make_axes(chance, letters="XYZ"):
    """Words of some of the axes, at least of one."""
    return (
        " ".join(
            f"{axis}{chance.uniform(-20, 20):.3f}" for axis in letters if chance.random() < 0.6
        )
        or letters[0] + "1"
    )


def make_stored_position(chance):
    return [
        chance.choice(["G28 ", "G30 ", "G53 G0 ", "G53 G1 ", "G52 ", "G10 L2 P1 ", "G92 "])
        + make_axes(chance)
    ]


MODES = "M70 M72 M71 G92.1 G92.2 G92.3 G28.1 G91 G90 G98 G99 M0 G43 G49".split()  # noqa: SIM905


def make_mode(chance):
    return [chance.choice(MODES), "G1 " + make_axes(chance)]


def make_tap(chance):
    high, pause = chance.uniform(-5, 30), chance.choice(["", " P0.5"])
    return [
        "G90",
        f"G84 {make_axes(chance, 'XY')} Z{high - 5:.3f} R{high:.3f}{pause}",
        make_axes(chance, "XY"),
        "G80",
    ]


def make_thread(chance):
    code, pitch = chance.choice(["G33", "G33"]), chance.uniform(0.2, 2)
    return [f"{code} {make_axes(chance, 'XZ')} K{pitch:.3f}"]


def make_thread_passes(chance):
    taper = (
        f" L{chance.randint(0, 3)} E{chance.uniform(0.1, 2):.2f}" if chance.random() < 0.6 else ""
    )
    peak = chance.choice([-1, 1]) * chance.uniform(0.5, 2)
    first, last = chance.uniform(0.2, 0.5), chance.uniform(0.6, 2)
    depths = f"I{peak:.3f} J{first:.3f} K{last:.3f}"
    more = f"R{chance.uniform(1, 2.5):.2f} Q{chance.uniform(0, 30):.1f} H{chance.randint(0, 2)}"
    return [
        "G90 G18 G0 X30 Y0 Z5",
        f"G76 P{chance.uniform(0.3, 2):.2f} Z{chance.uniform(-20, 0):.3f} {depths} {more}{taper}",
        "G17",
    ]


def make_compensated_path(chance):
    """A path of lines and arcs with G41 or G42, with corners that the tool may not reach."""
    entry = chance.choice(["G1 X10 Y0", "G2 X10 Y0 I5 J0", "G3 X10 Y0 R7", "G0 X10 Y0"])
    lines = ["G90 G40 G0 X0 Y0", f"{chance.choice(['G41', 'G42'])} D{chance.randint(1, 2)} {entry}"]
    x, y = 10.0, 0.0
    for _ in range(chance.randint(2, 8)):
        next_x, next_y = x + chance.uniform(-15, 15), y + chance.uniform(-15, 15)
        if chance.random() < 0.6:
            line = f"G{chance.choice('011')} X{next_x:.3f} Y{next_y:.3f}"
            lines.append(line + (" Z3" if chance.random() < 0.2 else ""))
        else:
            line = f"G{chance.choice('23')} X{next_x:.3f} Y{next_y:.3f}"
            radius = chance.uniform(0.6, 3) * abs(complex(next_x - x, next_y - y))
            lines.append(f"{line} R{radius:.3f}")
        x, y = next_x, next_y
    return [*lines, "G40 G0 X-30 Y-30"]


#: Makers of random lines. Paths with compensation are chosen twice as often as the others.
MAKERS = (
    *(make_stored_position, make_mode, make_tap, make_thread, make_thread_passes),
    *(make_compensated_path, make_compensated_path),
)


@needs_rs274
@pytest.mark.parametrize("seed", range(60))
def test_a_random_program_has_the_motions_of_linuxcnc(seed):
    chance = random.Random(seed)
    lines = []
    for _ in range(chance.randint(1, 5)):
        lines += chance.choice(MAKERS)(chance)
    assert describe_difference([*LEAD, "M70", *lines, "M2"]) == "", lines
