"""Replay of G-code on another machine. LinuxCNC decides which motions the G-code has."""

import math
import random
from pathlib import Path

import pytest

import camgen
from bench.read.replay import compare_motions
from camgen.lang.gcode import interpret
from camgen.model.errors import InputError, JobError, NoSafeProgram
from camgen.model.pose import Pose
from camgen.model.program import Joints, MoveC, MoveJ, MoveL, Output, Wait
from tests.support import canon
from tests.support.rs274 import needs_rs274

SHARED = Path(__file__).parents[2].parent / "shared" / "data" / "gcode"
needs_shared = pytest.mark.skipif(
    not SHARED.is_dir(), reason="the folder shared/data/gcode is not beside the repository"
)

OLD = """\
%
(a pocket)
G21 G90 G64
S1000 M3
G0 X10 Y10 Z5
G1 Z-1 F300
G1 X20
X20 Y20
G3 X10 Y30 I-10
G4 P0.5
G0 Z5
M5
%
"""


def replay(tmp_path, text=OLD, post="gcode", name="old.nc", options=None, **tables):
    path = tmp_path / name
    path.write_text(text, encoding="latin-1")
    return camgen.build(path, post=post, job={**tables, "post": options or {}})


def test_a_mill_moves_between_its_home_positions(tmp_path):
    """The order is home, above the first position, the motions of the program, up, home."""
    result = replay(tmp_path)
    moves = [i for i in result.program.body if isinstance(i, MoveJ | MoveL | MoveC)]
    assert [(type(i).__name__, *i.target.origin) for i in moves] == [
        ("MoveJ", 0, 0, 50),
        ("MoveJ", 10, 10, 20),
        ("MoveJ", 10, 10, 5),
        ("MoveL", 10, 10, -1),
        ("MoveL", 20, 10, -1),
        ("MoveL", 20, 20, -1),
        ("MoveC", 10, 30, -1),
        ("MoveJ", 10, 30, 5),
        ("MoveJ", 10, 30, 20),
        ("MoveJ", 0, 0, 50),
    ]
    assert moves[6].via.origin == pytest.approx(
        (10 + 10 * math.sqrt(0.5), 20 + 10 * math.sqrt(0.5), -1)
    )
    assert {m.speed for m in moves[3:7]} == {5.0}
    others = [i for i in result.program.body if isinstance(i, Output | Wait)]
    assert others == [
        Output("spindle", 0.0),
        Output("spindle", 1000.0),
        Wait(0.5),
        Output("spindle", 0.0),
    ]
    assert result.deviation.max_mm < 1e-3


def test_an_output_that_the_program_leaves_on_is_switched_off_before_home(tmp_path):
    """M2 of LinuxCNC stops spindle and coolant. A digital output is off after the retract."""
    text = OLD.replace("M5\n%", "%").replace("S1000 M3", "S1000 M3\nM64 P3\nM8")
    options = {"signals": {"flood": "M8", "dout3": "P3"}}
    body = replay(tmp_path, text, options=options).program.body
    used = ["spindle", "dout3", "flood"]
    assert body[:3] == tuple(Output(name, 0.0) for name in used)
    up, last, home = body[-3:]
    assert last == Output("dout3", 0.0)
    outputs = [item for item in body if isinstance(item, Output)]
    values = {item.signal: item.value for item in body[:-3] if isinstance(item, Output)}
    assert values == {"spindle": 0.0, "dout3": 1.0, "flood": 0.0}
    assert (up.target.origin, home.target.origin) == ((10, 30, 20), (0, 0, 50))
    assert [item.value for item in outputs if item.signal == "dout3"] == [0.0, 1.0, 0.0]


@pytest.mark.parametrize("post", ["rapid", "vplus", "pacscript"])
def test_the_links_of_a_robot_are_straight_lines(tmp_path, post):
    text = OLD.replace("S1000 M3", "").replace("M5", "")
    result = replay(tmp_path, text, post, process={"travel": 80.0})
    moves = [i for i in result.program.body if isinstance(i, MoveJ | MoveL | MoveC)]
    assert isinstance(moves[0].target, Joints)
    assert isinstance(moves[-1].target, Joints)
    assert [type(m) for m in moves[1:3]] == [MoveJ, MoveL]
    assert [(*m.target.origin, m.speed) for m in moves[1:3]] == [(10, 10, 20, 80), (10, 10, 5, 80)]
    assert sum(isinstance(m, MoveJ) for m in moves) == 3
    assert result.report["tour"] == {
        "method": "as-drawn",
        "work_mm": round(26 + 5 * math.pi, 3),
        "travel_mm": 6.0,
        "bound_mm": None,
    }


def test_corners_are_blended_if_the_program_allows_it(tmp_path):
    text = OLD.replace("X20\nX20", "X15\nX20\nX20")
    result = replay(tmp_path, text, "rapid", options={"signals": {"spindle": "aoSpindle"}})
    moves = [i for i in result.program.body if isinstance(i, MoveL | MoveC)]
    cut = [m for m in moves if m.target.origin[2] == -1]
    # Two halves of a line and a tangent arc are blended. The plunge and a right angle stop.
    assert [m.blend > 0 for m in cut] == [False, True, False, True, False]
    exact = OLD.replace("G64", "G61")
    stops = [i for i in replay(tmp_path, exact).program.body if isinstance(i, MoveL | MoveC)]
    assert not any(m.blend for m in stops)


def test_an_assumed_start_is_reached_at_the_feed(tmp_path):
    result = replay(tmp_path, "G21\nG0 X5 Y5\nG1 Z-1 F120\nX9\nM2\n", "rapid")
    moves = [i for i in result.program.body if isinstance(i, MoveJ | MoveL)]
    assert [(*m.target.origin, m.speed) for m in moves[1:4]] == [
        (5, 5, 20, 100),
        (5, 5, 0, 2.0),
        (5, 5, -1, 2.0),
    ]
    notes = [str(n) for n in result.notes if "placeholder" not in n.what]
    assert notes == ["assumed: line 3: the program begins at Z0 (it does not say where)"]


def test_a_motion_of_length_0_is_left_out(tmp_path):
    once = replay(tmp_path, OLD)
    twice = replay(tmp_path, OLD.replace("X20 Y20", "X20 Y20\nX20 Y20"))
    assert twice.program.columns.ends.tolist() == once.program.columns.ends.tolist()


def test_a_skipped_word_is_an_error_with_strict(tmp_path):
    text = OLD.replace("S1000 M3", "M1")
    notes = replay(tmp_path, text.replace("M5\n", "")).notes
    # The acceleration of the mill is assumed.
    assert [note.kind for note in notes] == ["skipped", "assumed"]
    with pytest.raises(NoSafeProgram, match="M1 stops where the operator wants it"):
        camgen.build(tmp_path / "old.nc", post="gcode", strict=True)


@pytest.mark.parametrize(
    ("tables", "key"),
    [
        ({"operation": {"depth": 2.0}}, "operation.depth"),
        ({"process": {"feed": 5.0}}, "process.feed"),
        ({"process": {"plunge": 5.0}}, "process.plunge"),
        ({"process": {"switch": "air"}}, "process.switch"),
        ({"process": {"retract": 9.0}}, "process.retract"),
        ({"process": {"turn": 30.0}}, "process.turn"),
        ({"tool": {"orient": "follow"}}, "tool.orient"),
    ],
)
def test_a_setting_without_effect_on_a_replay_is_refused(tmp_path, tables, key):
    with pytest.raises(JobError) as error:
        replay(tmp_path, **tables)
    assert str(error.value) == f"job: has no effect on a replay ({key}); leave it out"


def test_another_operation_than_a_replay_is_refused(tmp_path):
    with pytest.raises(JobError, match="G-code is replayed, it cannot be used to trace"):
        replay(tmp_path, operation={"kind": "trace"})


def test_a_replay_of_a_drawing_is_refused(tmp_path):
    drawing = Path(__file__).parents[2] / "fixtures" / "parts" / "bracket.dxf"
    with pytest.raises(JobError, match='"replay" is for G-code'):
        camgen.build(drawing, post="gcode", job={"operation": {"kind": "replay"}})
    path = tmp_path / "a.nc"
    path.write_text(OLD)
    with pytest.raises(InputError, match="build it alone"):
        camgen.build([path, drawing], post="gcode")


def test_a_program_of_camgen_is_replayed_with_the_same_motions(tmp_path):
    drawing = Path(__file__).parents[2] / "fixtures" / "parts" / "bracket.dxf"
    first = camgen.build(drawing, post="gcode")
    signals = {"signals": {"process": "P1", "dout0": "P0"}}
    again = replay(tmp_path, first.text, "gcode", "again.ngc", signals)
    old, new = (r.program.columns for r in (first, again))
    work = [~c.moves_are(MoveJ) for c in (old, new)]
    assert new.ends[work[1]] == pytest.approx(old.ends[work[0]], abs=1e-3)
    assert new.speed[work[1]] == pytest.approx(old.speed[work[0]], rel=1e-3)


def test_a_stop_for_the_operator_is_kept(tmp_path):
    text = replay(tmp_path, "G21 G90\nG0 X0 Y0 Z5\nG1 X9 F60\nM0\nG1 X5\nM2\n", "gcode").text
    lines = text.split("\n")
    assert lines[lines.index("M0") - 1].startswith("G1 X9")
    assert lines[lines.index("M0") + 1].startswith("G1 X5")


def test_a_stored_position_becomes_a_motion_to_the_highest_z(tmp_path):
    """G28 between two cuts lifts the tool to the highest z so far."""
    old = "G21 G90\nG0 X0 Y0 Z9\nG1 Z-1 F60\nX9\nG91 G28 Z0\nG90 G0 X20 Y5\nZ2\nG1 Z-1\nX25\nM2\n"
    result = replay(tmp_path, old, "gcode")
    assert "G0 Z9\nG0 X20 Y5\nG0 Z2\n" in result.text
    assert any("G28: Z goes up" in note.what for note in result.notes)


@needs_rs274
@needs_shared
@pytest.mark.parametrize(
    "path", sorted([*SHARED.rglob("*.ngc"), *SHARED.rglob("*.gcode")]), ids=lambda p: p.name
)
def test_a_shared_program_moves_as_in_linuxcnc_or_is_refused_by_both(path):
    text = path.read_text(encoding="latin-1").replace("\r\n", "\n")
    run, reference = interpret(text.split("\n")), canon.run(text, timeout=20.0)
    if run.stopped:
        assert reference.error
        return
    comparison = compare_motions(run, reference)
    assert comparison.fault == ""
    assert comparison.deviation <= 0.001 + 2 * reference.hidden
    assert comparison.moves == len(reference.moves) - run.held or comparison.moves > 0


def program(chance: random.Random) -> list[str]:
    """A random program of motions, arcs and helices in all planes, cycles, and origin shifts."""
    lines = [chance.choice(["G21", "G20"]) + " G90 G64", "F100 S100 M3", "G0 X0 Y0 Z30"]
    for _ in range(chance.randint(3, 12)):
        lines += chance.choice([_line, _polar, _arc, _holes, _holes, _shift])(chance)
    return [*lines, "M2"]


def _axes(chance, letters="XYZ"):
    return (
        " ".join(f"{a}{chance.uniform(-20, 20):.3f}" for a in letters if chance.random() < 0.6)
        or letters[0] + "1"
    )


def _line(chance):
    return [chance.choice(["G0 ", "G1 "]) + _axes(chance)]


def _polar(chance):
    radius, angle = f"@{chance.uniform(-5, 5):.3f}", f"^{chance.uniform(-400, 400):.3f}"
    return [
        f"{chance.choice(['G0', 'G1'])} {radius} {angle}",
        f"G1 {chance.choice([radius, angle])} Z1",
    ]


def _shift(chance):
    return [
        chance.choice(
            [
                "G92 " + _axes(chance),
                "G10 L20 P1 " + _axes(chance),
                "G92.1",
                "G90",
                "G91",
                "G98",
                "G99",
            ]
        )
    ]


def _arc(chance):
    plane, (a, i, up) = chance.choice([("G17", "XIZ"), ("G18", "ZKY"), ("G19", "YJX")])
    size = chance.uniform(1, 9)
    line = f"{plane} {chance.choice(['G2', 'G3'])} "
    if chance.random() < 0.5:
        line += f"{i}{size:.3f}" + (f" P{chance.randint(1, 3)}" if chance.random() < 0.4 else "")
    else:
        distance, radius = chance.uniform(0.1, 1.9) * size, chance.choice([-1, 1]) * size
        line = f"G91 {line}{a}{distance:.3f} R{radius:.3f}"
    return [line + (f" {up}{chance.uniform(-9, 9):.3f}" if chance.random() < 0.5 else ""), "G17"]


def _holes(chance):
    plane, up, others = chance.choice(
        [("G17", "Z", "XY"), ("G17", "Z", "XY"), ("G18", "Y", "XZ"), ("G19", "X", "YZ")]
    )
    code = chance.choice(["G81", "G82", "G83", "G73", "G85", "G89"])
    more = {"G82": " P0.5", "G89": " P0.5", "G83": " Q4.5", "G73": " Q4.5"}.get(code, "")
    high = chance.uniform(-5, 30)
    distance = chance.choice(["G90", "G91"])
    low = high - chance.uniform(0.1, 20) if distance == "G90" else -chance.uniform(0.1, 20)
    first = (
        f"{code} {_axes(chance, others)} {up}{low:.3f} R{high:.3f}{more} L{chance.randint(1, 2)}"
    )
    again = [
        chance.choice([_axes(chance, others), f"{code} {_axes(chance, others)}", "G98", "G99"])
        for _ in range(2)
    ]
    return [f"{plane} {distance}", first, *again, "G80 G90 G17"]


@needs_rs274
@pytest.mark.parametrize("seed", range(40))
def test_a_random_program_moves_as_in_linuxcnc(seed):
    lines = program(random.Random(seed))
    run, reference = interpret(lines), canon.run("\n".join(lines) + "\n")
    assert (run.stopped, reference.error) == (None, "")
    comparison = compare_motions(run, reference)
    assert comparison.fault == "", lines
    assert comparison.moves > 2


def test_the_tool_points_down(tmp_path):
    body = replay(tmp_path).program.body
    assert len({i.target.rotation.tobytes() for i in body if isinstance(i, MoveL)}) == 1
    (item,) = [i for i in body if isinstance(i, MoveC)]
    assert isinstance(item.target, Pose)
    assert item.target.rotation @ [0, 0, 1] == pytest.approx([0, 0, -1])


FAST = OLD.replace("X20 Y20", "X20 Y20 F1000000")


def test_a_feed_that_no_machine_runs_is_refused_with_its_line(tmp_path):
    for post in ("rapid", "vplus", "pacscript", "gcode", "grbl"):
        with pytest.raises(InputError) as caught:
            replay(tmp_path, FAST, post)
        assert str(caught.value) == (
            "old.nc: asks for a feed of 16667 mm/s, and no machine here runs above 7000 (line 8); "
            "fix this line, or set process.max_feed, mm/s: feeds above it become that"
        )


def test_a_feed_above_max_feed_is_lowered_with_a_note(tmp_path):
    result = replay(tmp_path, FAST, process={"max_feed": 50.0})
    lines = [item.speed for item in result.program.body if isinstance(item, MoveL | MoveC)]
    assert lines == [5.0, 5.0, 50.0, 50.0]
    assert [str(note) for note in result.notes if "max_feed" in note.why] == [
        (
            "assumed: 2 motions run at 50 mm/s instead of up to 16667 (process.max_feed; the "
            "first is line 8)"
        )
    ]
    # A feed below the limit stays, without a note.
    slow = replay(tmp_path, OLD, process={"max_feed": 50.0})
    assert slow.program.columns.speed.max() == 100
    assert not any("max_feed" in note.why for note in slow.notes)
    with pytest.raises(JobError, match=r"has no effect on a drawing \(process\.max_feed\)"):
        camgen.build(
            camgen.part([(0, 0), (30, 0)]), post="gcode", job={"process": {"max_feed": 50.0}}
        )


@pytest.mark.parametrize(
    ("post", "options", "index", "message"),
    [
        (
            "gcode",
            {},
            3,
            "the spindle is to turn backwards (M4, 1000 rpm), and this post prints M3 alone",
        ),
        (
            "grbl",
            {},
            3,
            "the spindle is to turn backwards (M4, 1000 rpm), and this post prints M3 alone",
        ),
        (
            "pacscript",
            {"signals": {"spindle": 25}, "spindle": "on-off"},
            3,
            "the spindle is to turn backwards (1000 rpm), and an IO is on or off",
        ),
        (
            "rapid",
            {"signals": {"spindle": "aoSpindle"}},
            3,
            "the spindle is to turn backwards (1000 rpm), and its output has the speed alone",
        ),
    ],
)
def test_a_spindle_that_turns_backwards_is_refused_with_its_line(
    tmp_path, post, options, index, message
):
    with pytest.raises(NoSafeProgram) as caught:
        replay(tmp_path, OLD.replace("M3", "M4"), post, options=options)
    reason = f"{message} (instruction {index})"
    assert str(caught.value) == f"old.nc: {post} refuses line 4: {reason}; correct this line"


def test_a_refusal_names_the_setting_that_would_help_or_the_line(tmp_path):
    with pytest.raises(
        NoSafeProgram,
        match=r"old\.nc: rapid refuses line 4: no output .*; set post\.signals, e\.g\. spin",
    ):
        replay(tmp_path, OLD, "rapid")
    with pytest.raises(
        NoSafeProgram, match=r"refuses line 6: a feed of 0\.006 mm/min .*\); correct this line$"
    ):
        replay(tmp_path, OLD.replace("F300", "F.006"))
