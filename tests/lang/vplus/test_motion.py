"""Motions, speeds, tools, frames and outputs of foreign V+ programs, and what is taken for what no text holds."""

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


def execute(*lines, **asked):
    return run({"a.v2": "\n".join([".PROGRAM a()", *lines, ".END", ""])}, RunRequest(**asked))


def moves(found):
    return [item for item in found.body if isinstance(item, MoveJ | MoveL)]


def told(found, level):
    return [(finding.line, finding.what) for finding in found.findings if finding.level == level]


def test_speeds():
    found = execute(
        "MOVE TRANS(1)", "SPEED 50", "MOVE TRANS(2)", "MOVE TRANS(3)", "SPEED 20 MMPS ALWAYS", "MOVES TRANS(4)",
        "SPEED 1 IPS", "MOVES TRANS(5)", "MOVES TRANS(6)", "SPEED 10 MONITOR", "MOVES TRANS(7)",
    )  # fmt: skip
    # 100 % is 7500 mm/s; without ALWAYS a speed holds once; the monitor speed scales all.
    assert [m.speed for m in moves(found)] == pytest.approx([7500, 3750, 7500, 20, 25.4, 20, 2])
    assert [m.share for m in moves(found)[:3]] == [1, 0.5, 1]
    assert ("speed", "100 % is assumed to be 7500 mm/s of the TCP") in found.facts


def test_corners():
    found = execute(
        "MOVE TRANS(1)", "MOVES TRANS(2)", "BREAK", "MOVES TRANS(3)", "DISABLE CP", "MOVES TRANS(4)", "ENABLE CP",
        "CPOFF", "MOVES TRANS(5)", "MOVES TRANS(6)", "CPOFF ALWAYS", "MOVES TRANS(7)", "CPON ALWAYS", "MOVES TRANS(8)",
        "MOVES TRANS(9)",
    )  # fmt: skip
    assert [m.blend for m in moves(found)] == [
        1,
        0,
        1,
        0,
        0,
        1,
        0,
        1,
        0,
    ]  # the last one: the program ends


def test_approaches_and_departures_go_along_the_tool():
    found = execute(
        "SET p = TRANS(1,2,3,0,180,0)", "APPRO p, 50", "MOVES p", "DEPARTS 20", "APPROS p, -5"
    )
    ends = [m.target.origin for m in moves(found)]
    assert np.allclose(
        ends, [(1, 2, 53), (1, 2, 3), (1, 2, 23), (1, 2, -2)]
    )  # the tool points down
    assert [type(m) for m in moves(found)] == [MoveJ, MoveL, MoveL, MoveL]


def test_joints_and_single_ones():
    found = execute(
        "MOVE #PPOINT(0,-90,90,0,10,0)",
        "DRIVE 1, 30, 50",
        "JMOVE 1,2,3,4,5,6",
        "HERE #p",
        "MOVES #p",
    )
    values = [tuple(round(math.degrees(v), 6) for v in m.target.values) for m in moves(found)]
    assert values == [
        (0, -90, 90, 0, 10, 0),
        (30, -90, 90, 0, 10, 0),
        (1, 2, 3, 4, 5, 6),
        (1, 2, 3, 4, 5, 6),
    ]
    assert moves(found)[1].speed == 3750


def test_where_the_robot_is():
    found = execute(
        "MOVE TRANS(1,2,3)", "BREAK", "HERE p", "MOVES SHIFT(p BY 10)", "MOVES SHIFT(DEST BY 10)"
    )
    assert [m.target.origin for m in moves(found)] == [(1, 2, 3), (11, 2, 3), (21, 2, 3)]


def test_what_is_only_known_to_the_controller_stays_a_name():
    found = execute(
        "MOVE #safe", "APPRO pick, 50", "MOVES pick", "DEPARTS 30", "MOVES SHIFT(pick BY 0,0,5)"
    )
    assert [frame.work for frame in found.frames] == ["#safe", "pick", "SHIFT(pick BY 0,0,5)"]
    assert all(frame.base_from_work is None for frame in found.frames)
    assert found.frame == (0, 1, 1, 1, 2)
    assert [m.target.origin for m in moves(found)] == [
        (0, 0, 0),
        (0, 0, -50),
        (0, 0, 0),
        (0, 0, -30),
        (0, 0, 0),
    ]
    assert [a.what.partition(" is only")[0] for a in found.assumed] == [
        "precision point #safe",
        "location pick",
    ]
    assert not told(found, "refused")


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


@pytest.mark.parametrize("where", ["file", "text"])
def test_points_from_a_file_and_from_sections(where):
    lines = [
        "MOVE #safe",
        "MOVES SHIFT(pick BY 0,0,dz)",
        "MOVE slot[1,2]",
        'IF $name == "box" THEN',
        "MOVE pick",
        "END",
    ]
    text = "\n".join([".PROGRAM a()", *lines, ".END", ""])
    found = (
        run({"a": text}, RunRequest(points={"p.lc": POINTS}))
        if where == "file"
        else run({"a": text + POINTS}, RunRequest())
    )
    assert not found.findings
    assert not found.assumed
    assert isinstance(moves(found)[0].target, Joints)
    assert [m.target.origin for m in moves(found)[1:]] == [
        (300.5, 20, 5),
        (1, 2, 3),
        (300.5, 20, -10),
    ]


def test_points_as_assignments_and_lines_that_are_none():
    found = execute("MOVE p", points={"p.txt": "SET p = TRANS(1,2,3)\nwhat is this\n"})
    assert moves(found)[0].target.origin == (1, 2, 3)
    assert ("of p.txt", "1 line without a location") in found.facts


def test_tools_and_frames():
    found = execute(
        "SET t = TRANS(0,0,100)", "TOOL t", "SET wf = TRANS(10,20,30)", "MOVE wf:TRANS(1)", "TOOL NULL",
        "MOVE wf:TRANS(2)", "MOVE TRANS(3)", "TOOL grip",
        "MOVE TRANS(4)",
    )  # fmt: skip
    assert [(f.tool, f.work) for f in found.frames] == [
        ("t", "wf"),
        ("", "wf"),
        ("", ""),
        ("grip", ""),
    ]
    assert found.frames[0].flange_from_tool.origin == (0, 0, 100)
    assert found.frames[0].base_from_work.origin == (10, 20, 30)
    assert found.frames[3].flange_from_tool is None
    assert found.frame == (0, 1, 2, 3)


def test_the_base_is_moved():
    """BASE moves the robot's own frame: what lies at x 100 of the world is then 10 less away."""
    found = execute("BASE 10, 0, 0, 90", "MOVE TRANS(100,0,0)")
    assert np.allclose(
        found.frames[0].base_from_work.apply(moves(found)[0].target.origin), (0, -90, 0)
    )


def test_many_frames_are_told_in_the_base():
    lines = ["FOR i = 1 TO 20", "SET p = TRANS(i)", "MOVE p:TRANS(0,5)", "END"]
    found = execute(*lines)
    assert [m.target.origin for m in moves(found)] == [(i, 5, 0) for i in range(1, 21)]
    assert len(found.frames) == 1


def test_an_output_during_a_motion_is_dangerous():
    found = execute("SIGNAL 5", "MOVE TRANS(1)", "SIGNAL -5, 2005", "BREAK", "SIGNAL 6")
    what = "signal 5 switches while the motion before it still runs: BREAK is missing"
    assert told(found, "dangerous") == [(4, what)]
    outputs = [(i.signal, i.value) for i in found.body if isinstance(i, Output)]
    assert outputs == [("5", 1), ("5", 0), ("2005", 1), ("6", 1)]
    assert moves(found)[0].blend == 0


def test_an_output_that_has_its_value_already_does_not_switch():
    executed = execute("SIGNAL -5", "MOVE TRANS(1)", "SIGNAL -5", "SIGNAL -6", "BREAK")
    what = "signal 6 switches while the motion before it still runs: BREAK is missing"
    assert told(executed, "dangerous") == [(5, what)]


def test_bits_and_reset():
    found = execute("BITS 1,3 = 5", "RESET")
    assert [(i.signal, i.value) for i in found.body] == [
        ("1", 1),
        ("2", 0),
        ("3", 1),
        ("1", 0),
        ("3", 0),
    ]


def test_waits():
    found = execute(
        "MOVE TRANS(1)", "WAIT.EVENT , 0.5", "TIMER 1 = 0", "WAIT TIMER(1) > 2", "WAIT.EVENT 1, 3"
    )
    assert [i.seconds for i in found.body if isinstance(i, Wait)] == [0.5, 2, 3]
    assert not told(found, "dangerous")


@pytest.mark.parametrize(
    ("lines", "assume", "expected"),
    [
        (["WAIT SIG(1001)", "IF SIG(1001) THEN", "MOVE TRANS(1)", "END"], {}, [1]),
        (["WAIT SIG(-1001)", "IF SIG(1001) THEN", "MOVE TRANS(1)", "END"], {}, []),
        (["IF SIG(1002) THEN", "MOVE TRANS(1)", "END"], {}, []),
        (["IF SIG(1002) THEN", "MOVE TRANS(1)", "END"], {"sig1002": 1}, [1]),
        (["IF SIG(1002) THEN", "MOVE TRANS(1)", "END"], {"1002": 1}, [1]),
        (
            ["IF NOT SIG(1003) THEN", "HALT", "END", "MOVE TRANS(1)"],
            {},
            [1],
        ),  # the way that goes on
        (["IF NOT SIG(1003) THEN", "HALT", "END", "MOVE TRANS(1)"], {"sig1003": 0}, []),
        (["IF SIG(-1003) GOTO 9", "MOVE TRANS(1)", "9"], {}, [1]),
        (
            ["SIGNAL 2001", "IF SIG(2001) THEN", "MOVE TRANS(1)", "END"],
            {},
            [1],
        ),  # what the program sets is known
        (["FOR i = 1 TO n", "MOVE TRANS(i)", "END"], {}, [1]),
        (["FOR i = 1 TO n", "MOVE TRANS(i)", "END"], {"n": 2}, [1, 2]),
        (['PROMPT "how many? ", n', "MOVE TRANS(n)"], {"n": 7}, [7]),
        (["READ (5) a, b[1]", "MOVE TRANS(a+b[1])"], {"a": 2, "b": 3}, [5]),
        (["MOVE TRANS(10*iostat(5))"], {"iostat": 4}, [40]),
        (["IF DEFINED(taught) THEN", "MOVE TRANS(1)", "END"], {}, [1]),
    ],
)
def test_what_is_asked_of_the_surroundings(lines, assume, expected):
    found = execute(*lines, assume=assume)
    assert not told(found, "refused")
    assert [m.target.origin[0] for m in moves(found)] == expected


def test_assumptions_have_keys():
    found = execute("WAIT SIG(1001)", "x = count+1", "READ (5) y")
    assert [(a.line, a.key, a.value) for a in found.assumed] == [
        (2, "sig1001", 1),
        (3, "count", 1),
        (4, "y", 1),
    ]


def test_motions_in_place_have_a_speed_of_turning():
    found = execute("MOVE TRANS(1)", "SPEED 10, 50 MMPS ALWAYS", "MOVES TRANS(1,0,0,90)")
    assert math.degrees(moves(found)[1].turn) == pytest.approx(600)


@pytest.mark.parametrize(
    ("text", "sure"),
    [
        (".PROGRAM a()\nMOVES p\n.END\n", True),
        ("; old\n.program a\n    set p = trans(1)\n.end\n", True),
        (".PROGRAM a()\nLMOVE p\nACCURACY 5 ALWAYS\n.END\n", False),  # Kawasaki AS
        (".PROGRAM a()\n  JMOVE #[1,2,3]\n.END\n", False),
        ("G1 X5\n", False),
        ("MODULE m\nENDMODULE\n", False),
    ],
)
def test_what_is_surely_this_language(text, sure):
    assert recognise(text) is sure


def test_here_while_the_robot_moves_is_told():
    found = execute("MOVE TRANS(1)", "HERE p", "BREAK", "HERE q", "MOVES SHIFT(q BY 1)")
    what = "HERE while the robot may still move: BREAK is missing; the end of that motion is taken"
    assert told(found, "unusual") == [(3, what)]
    assert [m.target.origin[0] for m in moves(found)] == [1, 2]


def test_an_input_that_changes_is_told_twice():
    found = execute("WAIT SIG(1001)", "WAIT SIG(-1001)", "WAIT SIG(1001)")
    assert [a.what for a in found.assumed] == [
        "signal 1001 is on",
        "WAIT SIG(-1001) is over at once",
        "signal 1001 is off",
        "WAIT SIG(1001) is over at once",
    ]


def test_a_shift_by_nothing_is_the_location_itself():
    assert [f.work for f in execute("MOVES SHIFT(pick BY 0,0,0)").frames] == ["pick"]
    twice = ["SET p = SHIFT(pick BY 1,2,3)", "MOVES SHIFT(p BY 1)", "MOVES SHIFT(p BY -1,-2,-3)"]
    assert [f.work for f in execute(*twice).frames] == ["SHIFT(pick BY 2,2,3)", "pick"]


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


def test_a_file_that_the_program_reads_may_stand_beside_it():
    found = run({"a.v2": READER, "way.dat": "2\n1.5, 2\n 3 4\nthe end\n"}, RunRequest())
    assert not found.findings
    assert not found.assumed
    assert [m.target.origin[:2] for m in moves(found)] == [(1.5, 2), (3, 4), (7, 0), (8, 0)]
    alone = run({"a.v2": READER}, RunRequest())
    assert [a.key for a in alone.assumed] == ["iostat", "n", "x", "y", ""]
    assert [m.target.origin[:2] for m in moves(alone)] == [(1, 1)]


def test_the_motions_of_a_data_file_of_ours_are_told():
    post = make_post(VPlus, {"points": "file"})
    work = [MoveL(Pose(TOOL_DOWN, (x, 5.25, 1)), 20.0, 1.0 if x < 4 else 0.0) for x in range(1, 5)]
    home = MoveJ(VPlus.cell().home, 100.0)
    start = MoveJ(Pose(TOOL_DOWN, (0, 0, 20)), 125.0)
    body = (home, start, *work, Output("process", 1.0), Wait(0.5), home)
    plan = Program("part", VPlus.cell().base_from_work, VPlus.cell().flange_from_tool, whole(body))
    files = {file.name: file.text for file in post.render(post.prepare(plan, 0.01))}
    found = run(files, RunRequest())
    assert not told(found, "refused")
    assert found.stopped is None
    kinds = [MoveJ, MoveJ, MoveL, MoveL, MoveL, MoveL, Output, Wait, MoveJ]
    assert [type(i) for i in found.body if not (isinstance(i, Output) and i.value == 0)] == kinds
    assert [m.target.origin for m in moves(found)[1:-1]] == [
        (0, 0, 20),
        *[(x, 5.25, 1) for x in range(1, 5)],
    ]
    assert [m.blend for m in moves(found)[2:6]] == [1, 1, 1, 0]


def test_a_motion_after_detach_is_refused():
    found = execute(
        'ATTACH (lun, 4) "TCP"',
        "MOVE TRANS(1)",
        "DETACH (lun)",
        "MOVE TRANS(2)",
        "DETACH ()",
        "MOVE TRANS(3)",
    )
    assert told(found, "refused") == [
        (7, "a motion after DETACH: the robot is not attached to this program")
    ]
    assert not told(execute("DETACH ()", "ATTACH ()", "MOVE TRANS(3)"), "refused")


def test_motions_that_stand_alike_one_by_one():
    """Lines of the form that the post writes are read at once; where that cannot be, each for itself."""
    lines = ["MOVES wf:TRANS(1,2,3,0,180,180)", "MOVES wf:TRANS(4,2,3,0,180,180)"]
    wrong = execute("wf = 5", *lines)
    assert [line for line, _ in told(wrong, "refused")] == [3, 4]
    assert wrong.lines == ()
    unknown = execute(*lines)
    assert (unknown.lines, [f.work for f in unknown.frames]) == ((2, 3), ["wf"])
    opened = execute("SET wf = NULL", "OPEN", *lines)
    assert [type(i) for i in opened.body] == [Output, MoveL, MoveL]
    slow = execute("SET wf = NULL", "SPEED 5 MMPS", *lines)
    assert [i.speed for i in slow.body] == [5, 7500]
