"""Outputs of old G-code: the position of the tool when they go on, and beams in rapid motions."""

import random

import pytest

import camgen
from camgen.lang.gcode.language import run_gcode
from camgen.lang.programs import RunRequest
from camgen.model.errors import InputError
from camgen.model.program import MoveJ, Output, Wait

#: The clearance height of the motion from home, mm.
CLEARANCE = 20.0


def build_events(tmp_path, text, kind="laser", dialect=""):
    """The motions, outputs and waits of the program for an ABB after its motion to home.

    A motion is (x, y, z), an output its value, a wait a text in seconds.
    """
    path = tmp_path / "old.nc"
    path.write_text(text)
    job = {
        "tool": {"kind": kind},
        "input": {"dialect": dialect},
        "post": {"signals": {"spindle": "aoBeam", "flood": "doAir"}},
    }
    result = camgen.build(path, post="rapid", job=job)
    body = list(result.program.body)
    home = next(k for k, item in enumerate(body) if isinstance(item, MoveJ))
    assert not any(isinstance(item, Output) and item.value for item in body[:home])
    return result, list(map(event, body[home + 1 : -1]))


def event(item):
    if isinstance(item, Output):
        return item.value
    if isinstance(item, Wait):
        return f"{item.seconds:g} s"
    x, y, z = item.target.origin
    return (round(x, 3), round(y, 3), round(z, 3))


def test_a_torch_in_a_program_without_heights_goes_on_at_its_hole(tmp_path):
    """The program has no Z, so all of it runs at Z0."""
    text = (
        "G21 G90\nG0 X10 Y10\nM3\nG4 P0.8\nG1 X30 F1500\nM5\nG0 X50\nM3\nG4 P0.8\nG1 X70\nM5\nM2\n"
    )
    result, steps = build_events(tmp_path, text, kind="plasma")
    assert steps == [
        (10, 10, CLEARANCE), (10, 10, 0), 1, "0.8 s", (30, 10, 0), 0,
        (50, 10, 0), 1, "0.8 s", (70, 10, 0), 0, (70, 10, CLEARANCE),
    ]  # fmt: skip
    assert "assumed: line 2: the program begins at Z0 (it does not say where)" in map(
        str, result.notes
    )


def test_a_program_without_heights_may_choose_its_work_offset(tmp_path):
    text = "G21 G90 G55\nG0 X10 Y10\nM3\nG4 P0.8\nG1 X30 F1500\nM5\nM2\n"
    _, steps = build_events(tmp_path, text, kind="plasma")
    assert steps[:4] == [(10, 10, CLEARANCE), (10, 10, 0), 1, "0.8 s"]


def test_holes_without_a_cut_between_them_are_pierced_at_their_positions(tmp_path):
    text = "G21 G90\nG0 X1 Y2\nM3\nG4 P1\nM5\nG0 X3\nM3\nG4 P1\nG1 X9 F600\nM5\nM2\n"
    _, steps = build_events(tmp_path, text, kind="plasma")
    assert steps[1:8] == [(1, 2, 0), 1, "1 s", 0, (3, 2, 0), 1, "1 s"]


@pytest.mark.parametrize(
    ("kind", "leading"),
    [
        # A spindle is switched on above the part, any other tool on it.
        ("end mill", [(10, 10, CLEARANCE), 900.0, "2 s", (10, 10, 5)]),
        ("plasma", [(10, 10, CLEARANCE), (10, 10, 5), 900.0, "2 s"]),
    ],
)
def test_no_output_is_on_before_the_first_known_position(tmp_path, kind, leading):
    text = "G21 G90\nM3 S900\nG4 P2\nG0 Z5\nG0 X10 Y10\nG1 Z-1 F600\nX20\nG0 Z5\nM5\nM2\n"
    _, steps = build_events(tmp_path, text, kind=kind)
    assert steps[:4] == leading


def test_a_hole_before_the_first_height_is_refused(tmp_path):
    text = "G21 G90\nG0 X1 Y2\nM3\nG4 P1\nM5\nG0 X3\nG0 Z5\nG1 Z0 F600\nX9\nM2\n"
    with pytest.raises(InputError) as error:
        build_events(tmp_path, text, kind="plasma")
    assert str(error.value).endswith(
        "process is on and off again where Z is not known (line 5); "
        "begin the program with its height (G0 Z5)"
    )


SQUARES = """\
G21 G90
{mode} S0
G0 X10 Y10 Z0
G1 X30 S300 F1200
G1 Y30
G0 X60
G4 P1
G1 X80 S250
G4 P2
M5
M2
"""


@pytest.mark.parametrize(
    ("mode", "at_rest"),
    # Laser mode of GRBL 1.1: at rest in G1 the beam is on with M3 and off with M4; it is off in G0.
    [("M3", ["2 s", 0]), ("M4", [0, "2 s"])],
)
def test_laser_mode_switches_the_beam_off_in_rapid_motions(tmp_path, mode, at_rest):
    result, steps = build_events(tmp_path, SQUARES.format(mode=mode), dialect="grbl")
    is_named = any("M4 lowers the power" in note.what for note in result.notes)
    assert is_named == (mode == "M4")
    assert steps == [
        (10, 10, CLEARANCE), (10, 10, 0), 300, (30, 10, 0), (30, 30, 0), 0,
        (60, 30, 0), "1 s", 250, (80, 30, 0), *at_rest, (80, 30, CLEARANCE),
    ]  # fmt: skip


def test_a_setting_in_the_text_switches_laser_mode_on():
    text = "$32=1\n" + SQUARES.format(mode="M3")
    executed = run_gcode({"a.nc": text}, RunRequest())
    assert [item.value for item in executed.body if isinstance(item, Output)] == [300, 0, 250, 0]
    spindle = run_gcode({"a.nc": "$32=0\n" + SQUARES.format(mode="M3")}, RunRequest())
    assert [item.value for item in spindle.body if isinstance(item, Output)] == [0, 300, 250, 0]


@pytest.mark.parametrize("kind", ["laser", "end mill"])
def test_a_beam_that_stays_on_in_rapid_motions_is_a_note(tmp_path, kind):
    """Without a dialect it is unknown whether the controller switches the beam off."""
    result, steps = build_events(tmp_path, SQUARES.format(mode="M3"), kind=kind)
    assert steps[steps.index((60, 30, 0)) - 1] == (30, 30, 0)
    notes = [note for note in result.notes if "in laser mode" in str(note)]
    assert [note.kind for note in notes] == ["warning" if kind == "laser" else "assumed"]
    assert "line 6" in notes[0].what


def test_a_laser_does_not_turn_backwards(tmp_path):
    _, steps = build_events(tmp_path, SQUARES.format(mode="M4"), dialect="linuxcnc")
    assert [value for value in steps if isinstance(value, float)] == [0, 300, 250, 0]


def write_random(rng):
    """A program of a laser, and its motions and waits with the power of the beam in GRBL."""
    mode, power = rng.choice(["M3", "M4"]), 0
    lines, expected = ["G21 G90", f"{mode} S0"], []
    work, x, y = False, 0, 0
    for k in range(12):
        x, y = (v + rng.choice([-7, 5, 9]) for v in (x, y))
        work = k > 0 and rng.random() < 0.6
        words = f"X{x} Y{y}"
        if work and rng.random() < 0.5:
            power = rng.choice([0, 100, 250])
            words += f" S{power}"
        lines.append(f"G1 {words} F900" if work else f"G0 {words}")
        expected.append(((x, y), power if work else 0))
        if rng.random() < 0.3:
            lines.append("G4 P0.5")
            expected.append(("0.5 s", power if work and mode == "M3" else 0))
    lines += ["G1 X0 Y0 S100 F900", "M5", "M2"]
    return "\n".join(lines) + "\n", [*expected, ((0, 0), 100)]


@pytest.mark.parametrize("seed", range(20))
def test_each_motion_has_the_beam_of_its_line(tmp_path, seed):
    text, expected = write_random(random.Random(seed))
    _, steps = build_events(tmp_path, text, dialect="grbl")
    level, levels = 0, []
    for step in steps[1:-1]:
        if isinstance(step, int | float):
            level = step
            continue
        position = step[:2] if isinstance(step, tuple) else step
        levels.append((position, level))
    assert levels == expected


RAPID = """\
MODULE m
  PERS tooldata tA:=[TRUE,[[0,0,100],[1,0,0,0]],[1,[0,0,50],[1,0,0,0],0,0,0]];
  CONST robtarget a:=[[350,0,250],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST robtarget b:=[[350,40,250],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  PROC main()
    SetDO doTorch,1;
    WaitTime 0.5;
    MoveJ a,v200,fine,tA;
    MoveL b,v50,fine,tA;
    SetDO doTorch,0;
  ENDPROC
ENDMODULE
"""


def test_a_robot_program_sets_no_output_before_its_first_motion(tmp_path):
    path = tmp_path / "old.mod"
    path.write_text(RAPID)
    job = {"post": {"signals": {"doTorch": "doTorch"}}}
    result = camgen.build(path, post="rapid", job=job)
    steps = [event(item) for item in result.program.body[2:]]
    assert steps == [(350, 0, 250), 1, "0.5 s", (350, 40, 250), 0]
