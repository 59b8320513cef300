"""Speeds of motions that a time or a rotational speed limits: formulas and three languages."""

import math
from pathlib import Path

import pytest

import camgen
from camgen.check.report import sum_up
from camgen.lang.motion_speed import Extent, Limit, limit_speed, measure_arc, measure_line
from camgen.lang.programs import Executed, RunRequest, find_language
from camgen.model.pose import Pose, rotation_about, translation
from camgen.model.program import Columns, MoveC, MoveJ, MoveL

#: A tool straight down, and one that is tilted by 90 deg, as quaternions of RAPID.
DOWN, TILTED = "[0,0,1,0]", "[0,0.7071068,0.7071068,0]"


def run_rapid(*statements: str) -> Executed:
    """The run of statements after a joint motion to the origin of the work object."""
    text = f"""MODULE m
  PERS tooldata tA:=[TRUE,[[0,0,100],[1,0,0,0]],[1,[0,0,50],[1,0,0,0],0,0,0]];
  PERS wobjdata wA:=[FALSE,TRUE,"",[[350,0,150],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
  PROC main()
    MoveJ {point()},v200,fine,tA\\WObj:=wA;
    {" ".join(statements)}
  ENDPROC
ENDMODULE
"""
    return find_language("rapid").run({"m.mod": text}, RunRequest())


def point(x: float = 0, y: float = 0, turn: str = DOWN) -> str:
    """A robtarget."""
    return f"[[{x},{y},0],{turn},[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"


def line(x: float, speed: str, turn: str = TILTED) -> str:
    """A straight motion along x."""
    return f"MoveL {point(x, turn=turn)},{speed},fine,tA\\WObj:=wA;"


def last_motion(executed: Executed) -> MoveJ | MoveL | MoveC:
    """The last motion of a program without findings."""
    assert executed.findings == ()
    return Columns(executed.body).moves[-1]


@pytest.mark.parametrize(
    ("extent", "limit", "expected"),
    [
        # 30 mm at 100 mm/s take 0.3 s, 90 deg at 9 deg/s take 10 s: 3 mm/s.
        (Extent(30, math.pi / 2), Limit(100, math.radians(9)), (3, 0)),
        # The turn takes 0.18 s: the TCP is slower.
        (Extent(30, math.pi / 2), Limit(100, math.radians(500)), (100, 0)),
        # 30 mm in 12 s.
        (Extent(30, 0), Limit(100, 0, 12), (2.5, 0)),
        # The least time is shorter than the motion: no effect.
        (Extent(30, 0), Limit(10, 0, 2), (10, 0)),
        # An exact time makes a motion faster too.
        (Extent(30, 0), Limit(10, 0, 2, is_exact=True), (15, 0)),
        # 90 deg in place in 12 s are 7.5 deg/s.
        (Extent(0, math.pi / 2), Limit(100, 1, 12, is_exact=True), (100, math.radians(7.5))),
        (Extent(0, math.pi / 2), Limit(100, math.radians(5), 12), (100, math.radians(5))),
        (Extent(0, math.pi / 2), Limit(100, 2), (100, 2)),
    ],
)
def test_the_slower_of_two_speeds_sets_the_time(extent, limit, expected):
    assert limit_speed(extent, limit) == pytest.approx(expected)


def test_the_extent_of_a_motion_is_its_length_and_its_rotation():
    start, end = translation(0, -30, 0), Pose(rotation_about(0, 0.5), (0, 30, 0))
    assert measure_line(start, end) == Extent(60.0, pytest.approx(0.5))
    assert measure_arc(start, translation(30, 0, 0), end).length == pytest.approx(30 * math.pi)
    assert measure_arc(start, translation(0, 5, 0), end).length == pytest.approx(60)


@pytest.mark.parametrize(
    ("statements", "speed", "turn"),
    [
        # A reorientation at a given speed, and in a time: 90 deg in 12 s.
        ([line(0, "[100,9,5000,1000]")], 100, 9),
        ([line(0, "v100\\T:=12")], 100, 7.5),
        # A motion of 30 mm that turns by 90 deg: 10 s, 12 s, and as fast as the TCP.
        ([line(30, "[100,9,5000,1000]")], 3, 0),
        ([line(30, "[100,9,5000,1000]\\T:=12")], 2.5, 0),
        ([line(30, "v100")], 100, 0),
        # V is for the TCP alone.
        ([line(30, "[100,9,5000,1000]\\V:=20")], 3, 0),
        # VelSet halves both speeds and doubles the time; its maximum is for the TCP alone.
        (["VelSet 50,800;", line(0, "[100,9,5000,1000]")], 50, 4.5),
        (["VelSet 50,800;", line(30, "v100\\T:=6")], 2.5, 0),
        (["VelSet 100,20;", line(0, "[100,9,5000,1000]")], 20, 9),
        (["VelSet 100,20;", line(30, "v100", DOWN)], 20, 0),
        # A joint motion in place.
        ([f"MoveJ {point(0, turn=TILTED)},v100\\T:=12,fine,tA\\WObj:=wA;"], 100, 7.5),
        # Half a circle of radius 15 with half a right angle: 10 s at 9 deg/s.
        (
            [f"MoveC {point(15, 15)},{point(30, 0, TILTED)},[100,9,5000,1000],fine,tA\\WObj:=wA;"],
            1.5 * math.pi,
            0,
        ),
    ],
)
def test_rapid_limits_motions_by_rotational_speeds_and_times(statements, speed, turn):
    motion = last_motion(run_rapid(*statements))
    assert motion.speed == pytest.approx(speed, rel=1e-6)
    assert math.degrees(getattr(motion, "turn", 0.0)) == pytest.approx(turn, rel=1e-6)


def test_a_time_of_0_s_is_refused():
    executed = run_rapid(line(30, "v100\\T:=0"))
    assert [(finding.level, finding.what) for finding in executed.findings] == [
        ("refused", "movel in \\T:=0 s")
    ]


def test_the_time_of_a_motion_to_joint_values_is_omitted():
    home = "[[0,0,0,0,30,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
    executed = run_rapid(f"MoveAbsJ {home},v100\\T:=5,fine,tA\\WObj:=wA;")
    assert executed.omitted == (
        (6, "moveabsj \\T:=5: the time of a motion to joint values; it runs at 100 mm/s"),
    )


def run_vplus(*lines: str) -> Executed:
    """The run of lines after a motion to x 350."""
    text = "\n".join([".PROGRAM a()", "MOVES TRANS(350,0,250,0,180,0)", *lines, ".END", ""])
    return find_language("vplus").run({"a.v2": text}, RunRequest())


@pytest.mark.parametrize(
    ("lines", "speeds", "turn"),
    [
        # DURATION holds for one motion: 80 mm in 9 s.
        (
            ["DURATION 9", "MOVES TRANS(430,0,250,0,180,0)", "MOVES TRANS(350,0,250,0,180,0)"],
            (80 / 9, 100),
            0,
        ),
        (
            [
                "DURATION 4 ALWAYS",
                "MOVES TRANS(430,0,250,0,180,0)",
                "MOVES TRANS(350,0,250,0,180,0)",
            ],
            (20, 20),
            0,
        ),
        # A shorter one has no effect, 0 ends it.
        (["DURATION 0.1", "MOVES TRANS(430,0,250,0,180,0)"], (100,), 0),
        (["DURATION 4 ALWAYS", "DURATION 0 ALWAYS", "MOVES TRANS(430,0,250,0,180,0)"], (100,), 0),
        # The monitor speed scales it.
        (["SPEED 50 MONITOR", "DURATION 4", "MOVES TRANS(430,0,250,0,180,0)"], (10,), 0),
        # 90 deg in place: 9 s are 10 deg/s; 1 % of 1200 deg/s are 12 deg/s.
        (["DURATION 9", "MOVES TRANS(350,0,250,0,90,0)"], (100,), 10),
        (["SPEED 100, 1 MMPS", "MOVES TRANS(350,0,250,0,90,0)"], (100,), 12),
        # 80 mm with 90 deg at 12 deg/s: 7.5 s.
        (["SPEED 100, 1 MMPS", "MOVES TRANS(430,0,250,0,90,0)"], (80 / 7.5,), 0),
    ],
)
def test_vplus_limits_motions_by_durations_and_rotational_speeds(lines, speeds, turn):
    executed = run_vplus("SPEED 100 MMPS ALWAYS", *lines)
    moves = Columns(executed.body).moves[1:]
    assert [move.speed for move in moves] == pytest.approx(speeds)
    assert math.degrees(moves[-1].turn) == pytest.approx(turn)


def test_the_duration_of_a_motion_to_joint_values_is_omitted():
    executed = run_vplus("DURATION 9", "MOVE #PPOINT(0,0,0,0,30,0)")
    assert [(number, what[:11]) for number, what in executed.omitted] == [(4, "DURATION 9:")]


@pytest.mark.parametrize(
    ("statement", "speed", "turn"),
    [
        # 2 % of 500 deg/s are 10 deg/s: 90 deg take 9 s, in place and along 18 mm.
        ("Move L, @0 P(300, 0, 250, 90, 0, 0), Speed = 2", 20, 10),
        ("Move L, @0 P(318, 0, 250, 90, 0, 0), Speed = 2", 2, 0),
        # A speed of the TCP does not limit the turn.
        ("Move L, @0 P(318, 0, 250, 90, 0, 0), Speed = Mps(20)", 20, 0),
    ],
)
def test_pacscript_limits_a_rotation_by_its_share_of_the_speed(statement, speed, turn):
    text = f"Sub Main\n  TakeArm\n  Move P, @0 P(300, 0, 250, 180, 0, 0)\n  {statement}\nEnd Sub\n"
    motion = last_motion(find_language("pacscript").run({"a.pcs": text}, RunRequest()))
    assert motion.speed == pytest.approx(speed)
    assert math.degrees(motion.turn) == pytest.approx(turn)


def test_the_summary_counts_the_time_of_a_reorientation():
    executed = run_rapid(line(0, "[100,9,5000,1000]"))
    assert sum_up(Columns(executed.body)).seconds == pytest.approx(10)


@pytest.mark.parametrize(
    ("post", "words"),
    [
        ("rapid", "vCam100t7_5:=[100,7.5,5000,1000]"),
        ("vplus", "SPEED 100, 0.625 MMPS ALWAYS"),
        ("pacscript", "Speed = 1.5"),
    ],
)
def test_each_post_prints_the_speed_of_a_reorientation(
    tmp_path: Path, post: str, words: str
) -> None:
    """90 deg in 12 s are 7.5 deg/s, out of 1200 deg/s in V+ and 500 deg/s in PacScript."""
    home = "[[0,0,0,0,30,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
    file = tmp_path / "turn.mod"
    yaw = "[0,-0.7071068,0.7071068,0]"
    turn = line(0, "v100\\T:=12", yaw)
    file.write_text(f"""MODULE m
  PERS tooldata tA:=[TRUE,[[0,0,100],[1,0,0,0]],[1,[0,0,50],[1,0,0,0],0,0,0]];
  PERS wobjdata wA:=[FALSE,TRUE,"",[[350,0,150],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
  PROC main()
    MoveAbsJ {home},v200,fine,tA\\WObj:=wA;
    MoveJ {point()},v200,fine,tA\\WObj:=wA;
    {turn}
    MoveAbsJ {home},v200,fine,tA\\WObj:=wA;
  ENDPROC
ENDMODULE
""")
    result = camgen.build(file, post=post, name="turn")
    assert words in "".join(each.text for each in result.files)
    assert result.cycle.total > 12


def test_an_unknown_value_of_a_speed_or_a_time_is_reported():
    statements = [
        "VelSet nOverride,500;",
        "MoveL " + point(30) + ",v100,z10\\Z:=nZone,tA\\WObj:=wA;",
        line(60, "v100\\T:=nTime", DOWN),
    ]
    executed = run_rapid(*statements)
    assert [what for _, what in executed.omitted] == [
        "velset: a value that is not known (nOverride): the speeds stay",
        "movel \\T: the time is not known (nTime)",
    ]
    assumed = [assumption.what for assumption in executed.assumed]
    assert assumed == ["a zone is not known (nZone): a stop is taken"]


@pytest.mark.parametrize("values", ["0,500", "50,0", "-10,500"])
def test_a_speed_of_0_or_less_is_refused(values: str) -> None:
    executed = run_rapid(f"VelSet {values};")
    assert [finding.level for finding in executed.findings] == ["refused"]


def test_a_reorientation_without_a_speed_is_a_note(tmp_path: Path) -> None:
    """Mps is a speed of the TCP, which does not limit a reorientation."""
    file = tmp_path / "turn.pcs"
    file.write_text(
        "Sub Main\n  TakeArm Keep = 1\n  Tool 1, P(0, 0, 100)\n  ChangeTool 1\n"
        "  Move P, @0 P(350, 0, 250, 180, 0, 0)\n"
        "  Move L, @0 P(350, 0, 250, 150, 0, 0), Speed = Mps(20)\nEnd Sub\n"
    )
    result = camgen.build(file, post="rapid", job={"operation": {"taught_on": "VS-060"}})
    notes = [note.what for note in result.notes]
    assert "1 motion only turns the tool: at 60 deg/s" in notes
    assert "t60:=[20,60,5000,1000]" in result.files[0].text


def test_a_motion_to_joint_values_keeps_a_slow_rotational_speed():
    home = "[[0,0,0,0,30,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
    executed = run_rapid(f"MoveAbsJ {home},[100,9,5000,1000],fine,tA\\WObj:=wA;")
    assert math.degrees(last_motion(executed).turn) == pytest.approx(9)
    executed = run_rapid(f"MoveAbsJ {home},v100,fine,tA\\WObj:=wA;")
    assert last_motion(executed).turn == 0


def test_a_slow_rotation_from_an_unknown_pose_is_reported():
    home = "[[0,0,0,0,30,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
    joints = f"MoveAbsJ {home},v100,fine,tA\\WObj:=wA;"
    executed = run_rapid(joints, line(30, "[100,9,5000,1000]"))
    assert executed.omitted == ((6, "movel with v_ori 9 deg/s: where it begins is not known"),)
    assert run_rapid(joints, line(30, "v100")).omitted == ()
    swing = f"MoveJ {point(30)},[100,9,5000,1000],fine,tA\\WObj:=wA;"
    executed = run_rapid(joints, swing)
    assert executed.omitted == ()
    assert math.degrees(last_motion(executed).turn) == pytest.approx(9)
    slow = ["MOVE #PPOINT(0,0,0,0,30,0)", "SPEED 100, 1 MMPS", "MOVES TRANS(350,0,250,0,180,0)"]
    assert [text for _, text in run_vplus(*slow).omitted] == [
        "SPEED with 1 % of turning: where the motion begins is not known"
    ]
    assert run_vplus(slow[0], slow[2]).omitted == ()


def track(x: float, at: str) -> str:
    """A straight motion along x of an arm on a track at the position `at`, mm."""
    axes = f"[{at},9E9,9E9,9E9,9E9,9E9]"
    return f"MoveL [[{x},0,0],{DOWN},[0,0,0,0],{axes}],v100,fine,tA\\WObj:=wA;"


@pytest.mark.parametrize(
    ("lines", "untimed"),
    [
        ([track(0, "0"), track(100, "0")], 1),
        ([track(0, "0"), track(0, "500")], 2),
        ([line(10, "v100"), line(20, "v100")], 0),
    ],
)
def test_motions_of_external_axes_of_rapid_are_counted(lines: list[str], untimed: int) -> None:
    # The joint motion at the start has no external axes, so that the first value moves the track.
    assert run_rapid(*lines).untimed == untimed


def test_an_independent_axis_has_an_unknown_time() -> None:
    assert run_rapid("IndAMove STN_1,1\\ToAbsPos:=90,20;").untimed == 1
