"""Runs V+ programs: motions, speeds, tools, frames, outputs and assumptions for unknown values."""

import math

import numpy as np
import pytest
from camgen_posts.vplus import VPlus

from camgen.lang.programs import RunRequest
from camgen.lang.vplus.language import recognise, run
from camgen.model.pose import TOOL_DOWN, Pose
from camgen.model.program import Joints, MoveJ, MoveL, Output, Program, Wait
from camgen.post.plugins import make_post
from tests.support.whole import whole


def execute(*lines, **options):
    return run({"a.v2": "\n".join([".PROGRAM a()", *lines, ".END", ""])}, RunRequest(**options))


def list_motions(executed):
    return [item for item in executed.body if isinstance(item, MoveJ | MoveL)]


def list_origins(executed):
    return [motion.target.origin for motion in list_motions(executed)]


def list_findings(executed, level):
    return [(finding.line, finding.what) for finding in executed.findings if finding.level == level]


def test_a_speed_holds_for_one_motion_or_always_and_the_monitor_speed_scales_it():
    executed = execute(
        "MOVE TRANS(1)",
        "SPEED 50",
        "MOVE TRANS(2)",
        "MOVE TRANS(3)",
        "SPEED 20 MMPS ALWAYS",
        "MOVES TRANS(4)",
        "SPEED 1 IPS",
        "MOVES TRANS(5)",
        "MOVES TRANS(6)",
        "SPEED 10 MONITOR",
        "MOVES TRANS(7)",
    )
    # 100 % is 7500 mm/s.
    assert [motion.speed for motion in list_motions(executed)] == pytest.approx(
        [7500, 3750, 7500, 20, 25.4, 20, 2]
    )
    assert [motion.share for motion in list_motions(executed)[:3]] == [1, 0.5, 1]
    assert ("speed", "100 % is assumed to be 7500 mm/s of the TCP") in executed.facts


def test_a_corner_is_rounded_unless_a_break_or_the_cp_switch_stops_there():
    executed = execute(
        "MOVE TRANS(1)",
        "MOVES TRANS(2)",
        "BREAK",
        "MOVES TRANS(3)",
        "DISABLE CP",
        "MOVES TRANS(4)",
        "ENABLE CP",
        "CPOFF",
        "MOVES TRANS(5)",
        "MOVES TRANS(6)",
        "CPOFF ALWAYS",
        "MOVES TRANS(7)",
        "CPON ALWAYS",
        "MOVES TRANS(8)",
        "MOVES TRANS(9)",
    )
    # The last motion stops because the program ends.
    assert tuple(motion.blend for motion in list_motions(executed)) == (1, 0, 1, 0, 0, 1, 0, 1, 0)


def test_approach_and_depart_move_along_the_tool_axis():
    """The tool points down."""
    executed = execute(
        "SET p = TRANS(1,2,3,0,180,0)", "APPRO p, 50", "MOVES p", "DEPARTS 20", "APPROS p, -5"
    )
    assert np.allclose(list_origins(executed), [(1, 2, 53), (1, 2, 3), (1, 2, 23), (1, 2, -2)])
    assert [type(motion) for motion in list_motions(executed)] == [MoveJ, MoveL, MoveL, MoveL]


def test_joint_values_are_set_together_or_one_by_one():
    executed = execute(
        "MOVE #PPOINT(0,-90,90,0,10,0)",
        "DRIVE 1, 30, 50",
        "JMOVE 1,2,3,4,5,6",
        "HERE #p",
        "MOVES #p",
    )
    joints = [motion.target.values for motion in list_motions(executed)]
    assert np.round(np.degrees(joints), 6).tolist() == [
        [0, -90, 90, 0, 10, 0],
        [30, -90, 90, 0, 10, 0],
        [1, 2, 3, 4, 5, 6],
        [1, 2, 3, 4, 5, 6],
    ]
    assert list_motions(executed)[1].speed == 3750


def test_here_and_dest_are_the_position_of_the_robot():
    executed = execute(
        "MOVE TRANS(1,2,3)", "BREAK", "HERE p", "MOVES SHIFT(p BY 10)", "MOVES SHIFT(DEST BY 10)"
    )
    assert list_origins(executed) == [(1, 2, 3), (11, 2, 3), (21, 2, 3)]


def test_a_location_that_only_the_controller_knows_is_a_frame_with_its_name():
    executed = execute(
        "MOVE #safe", "APPRO pick, 50", "MOVES pick", "DEPARTS 30", "MOVES SHIFT(pick BY 0,0,5)"
    )
    assert [frame.work for frame in executed.frames] == ["#safe", "pick", "SHIFT(pick BY 0,0,5)"]
    assert all(frame.base_from_work is None for frame in executed.frames)
    assert executed.frame == (0, 1, 1, 1, 2)
    assert list_origins(executed) == [
        (0, 0, 0),
        (0, 0, -50),
        (0, 0, 0),
        (0, 0, -30),
        (0, 0, 0),
    ]
    assert [assumption.what.partition(" is only")[0] for assumption in executed.assumed] == [
        "precision point #safe",
        "location pick",
    ]
    assert not list_findings(executed, "refused")


POINTS = """\
.LOCATIONS
pick  300.5 20 -10  0 180 90
#safe  0, -90, 90, 0, 0, 0
slot[1,2] 1 2 3
.END
.REALS
dz  15
.END
.STRINGS
$name "box"
.END
"""


@pytest.mark.parametrize("source", ["file", "text"])
def test_points_are_read_from_a_file_or_from_sections_of_the_text(source):
    lines = [
        "MOVE #safe",
        "MOVES SHIFT(pick BY 0,0,dz)",
        "MOVE slot[1,2]",
        'IF $name == "box" THEN',
        "MOVE pick",
        "END",
    ]
    text = "\n".join([".PROGRAM a()", *lines, ".END", ""])
    executed = (
        run({"a": text}, RunRequest(points={"p.lc": POINTS}))
        if source == "file"
        else run({"a": text + POINTS}, RunRequest())
    )
    assert not executed.findings
    assert not executed.assumed
    assert isinstance(list_motions(executed)[0].target, Joints)
    assert [motion.target.origin for motion in list_motions(executed)[1:]] == [
        (300.5, 20, 5),
        (1, 2, 3),
        (300.5, 20, -10),
    ]


def test_a_file_of_points_may_have_assignments_and_other_lines_are_counted():
    executed = execute("MOVE p", points={"p.txt": "SET p = TRANS(1,2,3)\nwhat is this\n"})
    assert list_motions(executed)[0].target.origin == (1, 2, 3)
    assert ("of p.txt", "1 line without a location") in executed.facts


def test_each_motion_has_the_tool_and_frame_that_the_program_names():
    executed = execute(
        "SET t = TRANS(0,0,100)",
        "TOOL t",
        "SET wf = TRANS(10,20,30)",
        "MOVE wf:TRANS(1)",
        "TOOL NULL",
        "MOVE wf:TRANS(2)",
        "MOVE TRANS(3)",
        "TOOL grip",
        "MOVE TRANS(4)",
    )
    assert [(frame.tool, frame.work) for frame in executed.frames] == [
        ("t", "wf"),
        ("", "wf"),
        ("", ""),
        ("grip", ""),
    ]
    assert executed.frames[0].flange_from_tool.origin == (0, 0, 100)
    assert executed.frames[0].base_from_work.origin == (10, 20, 30)
    assert executed.frames[3].flange_from_tool is None
    assert executed.frame == (0, 1, 2, 3)


def test_base_moves_the_frame_of_the_robot():
    """A point at x 100 mm of the world is then 90 mm away from the robot, here along -y."""
    executed = execute("BASE 10, 0, 0, 90", "MOVE TRANS(100,0,0)")
    (origin,) = list_origins(executed)
    assert np.allclose(executed.frames[0].base_from_work.apply(origin), (0, -90, 0))


def test_motions_in_many_frames_are_converted_to_the_base():
    lines = ["FOR i = 1 TO 20", "SET p = TRANS(i)", "MOVE p:TRANS(0,5)", "END"]
    executed = execute(*lines)
    assert list_origins(executed) == [(i, 5, 0) for i in range(1, 21)]
    assert len(executed.frames) == 1


def test_an_output_during_a_motion_is_dangerous():
    executed = execute("SIGNAL 5", "MOVE TRANS(1)", "SIGNAL -5, 2005", "BREAK", "SIGNAL 6")
    what = "signal 5 switches while the motion before it still runs: BREAK is missing"
    assert list_findings(executed, "dangerous") == [(4, what)]
    outputs = [(item.signal, item.value) for item in executed.body if isinstance(item, Output)]
    assert outputs == [("5", 1), ("5", 0), ("2005", 1), ("6", 1)]
    assert list_motions(executed)[0].blend == 0


def test_an_output_that_has_its_value_already_does_not_switch():
    executed = execute("SIGNAL -5", "MOVE TRANS(1)", "SIGNAL -5", "SIGNAL -6", "BREAK")
    what = "signal 6 switches while the motion before it still runs: BREAK is missing"
    assert list_findings(executed, "dangerous") == [(5, what)]


def test_bits_sets_single_outputs_and_reset_clears_them():
    executed = execute("BITS 1,3 = 5", "RESET")
    assert [(item.signal, item.value) for item in executed.body] == [
        ("1", 1),
        ("2", 0),
        ("3", 1),
        ("1", 0),
        ("3", 0),
    ]


def test_a_wait_for_a_timer_takes_its_seconds():
    executed = execute(
        "MOVE TRANS(1)", "WAIT.EVENT , 0.5", "TIMER 1 = 0", "WAIT TIMER(1) > 2", "WAIT.EVENT 1, 3"
    )
    assert [item.seconds for item in executed.body if isinstance(item, Wait)] == [0.5, 2, 3]
    assert not list_findings(executed, "dangerous")


@pytest.mark.parametrize(
    ("lines", "assume", "expected"),
    [
        (["WAIT SIG(1001)", "IF SIG(1001) THEN", "MOVE TRANS(1)", "END"], {}, [1]),
        (["WAIT SIG(-1001)", "IF SIG(1001) THEN", "MOVE TRANS(1)", "END"], {}, []),
        (["IF SIG(1002) THEN", "MOVE TRANS(1)", "END"], {}, []),
        (["IF SIG(1002) THEN", "MOVE TRANS(1)", "END"], {"sig1002": 1}, [1]),
        (["IF SIG(1002) THEN", "MOVE TRANS(1)", "END"], {"1002": 1}, [1]),
        # The branch that continues is taken.
        (["IF NOT SIG(1003) THEN", "HALT", "END", "MOVE TRANS(1)"], {}, [1]),
        (["IF NOT SIG(1003) THEN", "HALT", "END", "MOVE TRANS(1)"], {"sig1003": 0}, []),
        (["IF SIG(-1003) GOTO 9", "MOVE TRANS(1)", "9"], {}, [1]),
        # An output that the program sets is known.
        (["SIGNAL 2001", "IF SIG(2001) THEN", "MOVE TRANS(1)", "END"], {}, [1]),
        (["FOR i = 1 TO n", "MOVE TRANS(i)", "END"], {}, [1]),
        (["FOR i = 1 TO n", "MOVE TRANS(i)", "END"], {"n": 2}, [1, 2]),
        (['PROMPT "how many? ", n', "MOVE TRANS(n)"], {"n": 7}, [7]),
        (["READ (5) a, b[1]", "MOVE TRANS(a+b[1])"], {"a": 2, "b": 3}, [5]),
        (["MOVE TRANS(10*iostat(5))"], {"iostat": 4}, [40]),
        (["IF DEFINED(taught) THEN", "MOVE TRANS(1)", "END"], {}, [1]),
    ],
)
def test_external_values_are_assumed_or_given_by_the_user(lines, assume, expected):
    executed = execute(*lines, assume=assume)
    assert not list_findings(executed, "refused")
    assert [motion.target.origin[0] for motion in list_motions(executed)] == expected


def test_assumptions_have_keys():
    executed = execute("WAIT SIG(1001)", "x = count+1", "READ (5) y")
    assert [(entry.line, entry.key, entry.value) for entry in executed.assumed] == [
        (2, "sig1001", 1),
        (3, "count", 1),
        (4, "y", 1),
    ]


def test_a_reorientation_has_a_speed_in_rad_per_second():
    executed = execute("MOVE TRANS(1)", "SPEED 10, 50 MMPS ALWAYS", "MOVES TRANS(1,0,0,90)")
    assert math.degrees(list_motions(executed)[1].turn) == pytest.approx(600)


@pytest.mark.parametrize(
    ("text", "is_vplus"),
    [
        (".PROGRAM a()\nMOVES p\n.END\n", True),
        ("; old\n.program a\n    set p = trans(1)\n.end\n", True),
        # A program of Kawasaki AS.
        (".PROGRAM a()\nLMOVE p\nACCURACY 5 ALWAYS\n.END\n", False),
        (".PROGRAM a()\n  JMOVE #[1,2,3]\n.END\n", False),
        ("G1 X5\n", False),
        ("MODULE m\nENDMODULE\n", False),
    ],
)
def test_a_text_is_recognised_as_vplus(text, is_vplus):
    assert recognise(text) is is_vplus


def test_here_during_a_motion_is_unusual():
    executed = execute("MOVE TRANS(1)", "HERE p", "BREAK", "HERE q", "MOVES SHIFT(q BY 1)")
    what = "HERE while the robot may still move: BREAK is missing; the end of that motion is taken"
    assert list_findings(executed, "unusual") == [(3, what)]
    assert [motion.target.origin[0] for motion in list_motions(executed)] == [1, 2]


def test_each_change_of_an_input_is_an_assumption():
    executed = execute("WAIT SIG(1001)", "WAIT SIG(-1001)", "WAIT SIG(1001)")
    assert [assumption.what for assumption in executed.assumed] == [
        "signal 1001 is on",
        "WAIT SIG(-1001) is over at once",
        "signal 1001 is off",
        "WAIT SIG(1001) is over at once",
    ]


def test_shifts_of_a_location_add_up_and_a_shift_of_zero_is_the_location():
    assert [frame.work for frame in execute("MOVES SHIFT(pick BY 0,0,0)").frames] == ["pick"]
    twice = ["SET p = SHIFT(pick BY 1,2,3)", "MOVES SHIFT(p BY 1)", "MOVES SHIFT(p BY -1,-2,-3)"]
    assert [frame.work for frame in execute(*twice).frames] == ["SHIFT(pick BY 2,2,3)", "pick"]


READER = r""".PROGRAM main()
AUTO lun, n, i, x, y, $s
ATTACH (lun, 4) "DISK"
FOPENR (lun) "D:\\jobs\\way.dat"
IF IOSTAT(lun) < 0 THEN
HALT
END
READ (lun) n
FOR i = 1 TO n
READ (lun) x, y
MOVES TRANS(x,y)
END
READ (lun) $s
IF $s == "the end" THEN
MOVES TRANS(7)
END
READ (lun) x
IF IOSTAT(lun) < 0 THEN
MOVES TRANS(8)
END
FCLOSE (lun)
DETACH (lun)
.END
"""


def test_a_program_reads_a_data_file_that_is_given_with_it():
    executed = run({"a.v2": READER, "way.dat": "2\n1.5, 2\n 3 4\nthe end\n"}, RunRequest())
    assert not executed.findings
    assert not executed.assumed
    assert [origin[:2] for origin in list_origins(executed)] == [(1.5, 2), (3, 4), (7, 0), (8, 0)]
    without_file = run({"a.v2": READER}, RunRequest())
    assert [entry.key for entry in without_file.assumed] == ["iostat", "n", "x", "y", ""]
    assert [origin[:2] for origin in list_origins(without_file)] == [(1, 1)]


def test_the_motions_of_a_data_file_of_the_post_are_read():
    post = make_post(VPlus, {"points": "file"})
    work = [MoveL(Pose(TOOL_DOWN, (x, 5.25, 1)), 20.0, 1.0 if x < 4 else 0.0) for x in range(1, 5)]
    home = MoveJ(VPlus.cell().home, 100.0)
    start = MoveJ(Pose(TOOL_DOWN, (0, 0, 20)), 125.0)
    body = (home, start, *work, Output("process", 1.0), Wait(0.5), home)
    plan = Program("part", VPlus.cell().base_from_work, VPlus.cell().flange_from_tool, whole(body))
    files = {file.name: file.text for file in post.render(post.prepare(plan, 0.01))}
    executed = run(files, RunRequest())
    assert not list_findings(executed, "refused")
    assert executed.stopped is None
    kinds = [MoveJ, MoveJ, MoveL, MoveL, MoveL, MoveL, Output, Wait, MoveJ]
    body = [item for item in executed.body if not (isinstance(item, Output) and item.value == 0)]
    assert [type(item) for item in body] == kinds
    assert [motion.target.origin for motion in list_motions(executed)[1:-1]] == [
        (0, 0, 20),
        *[(x, 5.25, 1) for x in range(1, 5)],
    ]
    assert [motion.blend for motion in list_motions(executed)[2:6]] == [1, 1, 1, 0]


def test_a_motion_after_detach_is_refused():
    executed = execute(
        'ATTACH (lun, 4) "TCP"',
        "MOVE TRANS(1)",
        "DETACH (lun)",
        "MOVE TRANS(2)",
        "DETACH ()",
        "MOVE TRANS(3)",
    )
    assert list_findings(executed, "refused") == [
        (7, "a motion after DETACH: the robot is not attached to this program")
    ]
    assert not list_findings(execute("DETACH ()", "ATTACH ()", "MOVE TRANS(3)"), "refused")


def test_motions_in_the_spelling_of_the_post_are_run_one_by_one_if_the_fast_path_cannot():
    """The fast path needs a known frame, and no open hand or speed that holds for one motion."""
    lines = ["MOVES wf:TRANS(1,2,3,0,180,180)", "MOVES wf:TRANS(4,2,3,0,180,180)"]
    refused = execute("wf = 5", *lines)
    assert [line for line, _ in list_findings(refused, "refused")] == [3, 4]
    assert refused.lines == ()
    unknown = execute(*lines)
    assert (unknown.lines, [frame.work for frame in unknown.frames]) == ((2, 3), ["wf"])
    with_hand = execute("SET wf = NULL", "OPEN", *lines)
    assert [type(item) for item in with_hand.body] == [Output, MoveL, MoveL]
    with_speed = execute("SET wf = NULL", "SPEED 5 MMPS", *lines)
    assert [item.speed for item in with_speed.body] == [5, 7500]
