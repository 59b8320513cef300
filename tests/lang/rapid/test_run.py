"""Runs RAPID programs as the manual describes them, with assumptions for unknown values."""

import math
from collections.abc import Mapping

import numpy as np
import pytest

from camgen.lang.alternatives import run_alternatives
from camgen.lang.programs import Executed, RunRequest, find_language
from camgen.lang.rapid.language import LANGUAGE, recognise, run
from camgen.model.pose import Pose
from camgen.model.program import Force, Instruction, Joints, MoveC, MoveJ, MoveL, Output, Stop, Wait

E9 = "[9E9,9E9,9E9,9E9,9E9,9E9]"
HEAD = f"""MODULE m
PERS tooldata tG:=[TRUE,[[0,0,100],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];
PERS wobjdata wT:=[FALSE,TRUE,"",[[1000,0,0],[1,0,0,0]],[[0,0,50],[1,0,0,0]]];
CONST robtarget p0:=[[0,0,0],[0,1,0,0],[0,0,0,0],{E9}];
CONST robtarget p1:=[[100,0,0],[0,1,0,0],[0,0,0,0],{E9}];
CONST robtarget p2:=[[100,50,0],[0,1,0,0],[0,0,0,0],{E9}];
VAR num n;
VAR num a{{3}}:=[10,20,30];
VAR robtarget p;
VAR bool b;
VAR string s;
"""
TAIL = "v100,fine,tG;"


def make_module(body: str, more: str = "") -> str:
    return f"{HEAD}PROC main()\n{body}\nENDPROC\n{more}\nENDMODULE\n"


def run_main(body: str, more: str = "", **assume: float) -> Executed:
    return run({"m.mod": make_module(body, more)}, RunRequest(assume=assume))


def run_without_assumptions(body: str, more: str = "", **assume: float) -> list[Instruction]:
    """The instructions of a main that has no findings and needs no assumptions."""
    executed = run_main(body, more, **assume)
    assert (executed.findings, executed.assumed, executed.stopped) == ((), (), None)
    return list(executed.body)


def positions(items: list[Instruction] | Executed) -> list[tuple[float, ...]]:
    """The target positions of all motions to a pose, mm."""
    return [
        tuple(np.round(item.target.origin, 6) + 0.0)
        for item in (items.body if isinstance(items, Executed) else items)
        if isinstance(item, (MoveJ, MoveL, MoveC)) and isinstance(item.target, Pose)
    ]


def compute_num(expression: str, head: str = "") -> float:
    """The value of a num expression, taken from the seconds of a wait."""
    (item,) = run_without_assumptions(f"{head}\nWaitTime {expression};")
    assert isinstance(item, Wait)
    return item.seconds


def wait_seconds(executed: Executed) -> list[float]:
    return [item.seconds for item in executed.body if isinstance(item, Wait)]


# Motions ------------------------------------------------------------------------------------------


def test_a_language_is_found_by_the_name_of_its_post() -> None:
    assert find_language("rapid").about == LANGUAGE.about
    assert recognise("%%%\n VERSION:1\n%%%\n! x\nMODULE a\n")
    assert not recognise("G0 X1\nMODULE a\n")


def test_motions_have_their_joint_values_in_rad_their_line_and_their_frames() -> None:
    executed = run_main(
        f"MoveAbsJ [[90,0,0,0,45,0],{E9}],v200,z10,tG;\nMoveJ p1,v50,z5,tG\\WObj:=wT;\n"
        f"MoveL p2,{TAIL}"
    )
    to_joints, to_pose, line = executed.body
    assert isinstance(to_joints, MoveJ)
    assert isinstance(to_pose, MoveJ)
    assert isinstance(line, MoveL)
    assert isinstance(to_joints.target, Joints)
    assert to_joints.target.values == pytest.approx((math.pi / 2, 0, 0, 0, math.pi / 4, 0))
    assert (to_joints.speed, to_joints.blend) == (200, 10)
    assert (to_pose.speed, to_pose.blend) == (50, 5)
    assert (line.speed, line.blend) == (100, 0)
    assert executed.lines == (13, 14, 15)
    assert [(frame.tool, frame.work) for frame in executed.frames] == [("tG", ""), ("tG", "wT")]
    assert executed.frame == (0, 1, 0)
    tool, work = executed.frames[1].flange_from_tool, executed.frames[1].base_from_work
    assert tool is not None
    assert work is not None
    assert tool.origin == (0, 0, 100)
    assert work.origin == (1000, 0, 50)


@pytest.mark.parametrize(
    ("target", "position"),
    [
        ("Offs(p1,1,2,3)", (101, 2, 3)),
        # The tool points down: its y and z axes are opposite to those of the work object.
        ("RelTool(p1,1,2,3)", (101, -2, -3)),
        ("[[1,2,3],p1.rot,p1.robconf,p1.extax]", (1, 2, 3)),
    ],
)
def test_a_target_is_computed(target: str, position: tuple[float, float, float]) -> None:
    assert positions(run_without_assumptions(f"MoveL {target},{TAIL}")) == [position]


def test_reltool_turns_about_the_axes_of_the_tool() -> None:
    (motion,) = run_without_assumptions(f"MoveL RelTool(p1,0,0,0\\Rz:=90),{TAIL}")
    assert isinstance(motion, MoveL)
    assert motion.target.rotation == pytest.approx(
        np.array([[0, -1, 0], [-1, 0, 0], [0, 0, -1]]), abs=1e-7
    )


def test_an_arc_of_more_than_half_a_circle_is_halved() -> None:
    """An arc of 210 deg about (0, 0) from (100, 0) over (0, 100) becomes two arcs of 105 deg."""
    x, y = 100 * math.cos(math.radians(210)), 100 * math.sin(math.radians(210))
    via = "[[0,100,0],[0,1,0,0],[0,0,0,0],p1.extax]"
    _, first, second = run_without_assumptions(
        f"MoveL p1,{TAIL}\nMoveC {via},[[{x:.6f},{y:.6f},0],[0,1,0,0],[0,0,0,0],p1.extax],{TAIL}"
    )
    assert isinstance(first, MoveC)
    assert isinstance(second, MoveC)
    for arc, angle in ((first, 52.5), (second, 157.5)):
        via_point = (100 * math.cos(math.radians(angle)), 100 * math.sin(math.radians(angle)), 0)
        assert arc.via.origin == pytest.approx(via_point, abs=1e-4)
    assert first.target.origin == pytest.approx(
        (100 * math.cos(math.radians(105)), 100 * math.sin(math.radians(105)), 0), abs=1e-4
    )
    assert second.target.origin == pytest.approx((x, y, 0), abs=1e-4)


def test_options_of_a_motion_replace_its_speed_and_zone() -> None:
    body = run_without_assumptions(
        "MoveL p0,v100\\V:=30,z10\\Z:=3,tG;\nMoveL p1,v100\\T:=5,fine,tG;\n"
        "MoveL p2,v100,z10\\Inpos:=inpos50,tG;"
    )
    assert [(motion.speed, motion.blend) for motion in body if isinstance(motion, MoveL)] == [
        (30, 3),
        (20, 0),
        (100, 0),
    ]


def test_velset_scales_and_limits_the_speed() -> None:
    body = run_without_assumptions(
        "VelSet 50,40;\nMoveL p0,v60,fine,tG;\nMoveL p1,v1000,fine,tG;\nVelSet 100,5000;\n"
        "MoveL p0,vmax,fine,tG;"
    )
    assert [motion.speed for motion in body if isinstance(motion, MoveL)] == [30, 40, 5000]


def test_a_program_displacement_moves_the_targets() -> None:
    body = (
        f"PDispSet [[0,0,7],[0.7071068,0,0,0.7071068]];\nMoveL p1,{TAIL}\nPDispOff;\n"
        f"MoveL p1,{TAIL}"
    )
    assert positions(run_without_assumptions(body)) == [(0, 100, 7), (100, 0, 0)]
    body = f"MoveL p1,{TAIL}\nPDispOn p0,tG;\nMoveL p2,{TAIL}"
    assert positions(run_without_assumptions(body)) == [(100, 0, 0), (200, 50, 0)]
    body = f"PDispOn\\Rot\\ExeP:=RelTool(p1,0,0,0\\Rz:=-90),p0,tG;\nMoveL p1,{TAIL}"
    assert positions(run_without_assumptions(body)) == [(100, 100, 0)]


def test_crobt_is_known_after_a_motion_to_a_pose_and_unknown_after_joint_values() -> None:
    assert positions(
        run_without_assumptions(
            "MoveL p1,v100,fine,tG\\WObj:=wT;\np:=CRobT(\\Tool:=tG\\WObj:=wT);\n"
            "MoveL Offs(p,0,0,9),v5,fine,tG\\WObj:=wT;"
        )
    )[1] == (100, 0, 9)
    # The work object is at 1000, 0, 50 of the world.
    assert positions(
        run_without_assumptions(
            f"MoveL p1,v100,fine,tG\\WObj:=wT;\np:=CRobT(\\Tool:=tG\\WObj:=wobj0);\nMoveL p,{TAIL}"
        )
    )[1] == (1100, 0, 50)
    unknown = run_main(f"MoveAbsJ [[0,0,0,0,9,0],{E9}],{TAIL}\nMoveL Offs(CRobT(),0,0,9),{TAIL}")
    assert positions(unknown) == [(0, 0, 9)]
    assert unknown.frames[unknown.frame[1]].work == "where the arm is in line 14"
    assert "where the arm is is not known" in unknown.assumed[0].what


def test_a_trigger_sets_its_output_along_a_motion_and_moveldo_at_its_end() -> None:
    trigger = "VAR triggdata t;\n"
    body = f"{trigger}TriggIO t,30\\DOp:=doGlue,1;\nMoveL p0,{TAIL}\n"
    body += "TriggL p1,v100,t,fine,tG;\nMoveLDO p2,v10,z10,tG,doGlue,0;"
    items = run_without_assumptions(body)
    assert positions(items) == [(0, 0, 0), (70, 0, 0), (100, 0, 0), (100, 50, 0)]
    assert [(k, item.value) for k, item in enumerate(items) if isinstance(item, Output)] == [
        (2, 1.0),
        (5, 0.0),
    ]


def test_a_search_runs_to_its_end() -> None:
    executed = run_main(
        f"MoveL p0,{TAIL}\nSearchL\\Stop,diHit,p,p1,v10,tG;\nMoveL Offs(p,0,0,5),{TAIL}"
    )
    assert positions(executed) == [(0, 0, 0), (100, 0, 0), (100, 0, 5)]
    assert [assumption.what for assumption in executed.assumed] == [
        "diHit: a search does not stop before its end point"
    ]


def test_welds_move_at_the_speed_of_their_data() -> None:
    data = f"MoveL p0,{TAIL}\nArcLStart p1,v100,sm,wd,fine,tG;\nArcL p2,v100,sm,wd,z1,tG;\n"
    data += "ArcLEnd p0,v100,sm,wd,fine,tG;"
    more = (
        "PERS welddata wd:=[8,0,[0,0,0,0,0,0,0,0,0],[0,0,0,0,0,0,0,0,0]];\n"
        "PERS seamdata sm:=[0,0];\n"
    )
    executed = run(
        {"m.mod": make_module(data).replace("PROC main", f"{more}PROC main")}, RunRequest()
    )
    assert [m.speed for m in executed.body if isinstance(m, MoveL)] == [100, 100, 8, 8]
    assert dict(executed.facts)["process"] == "arc welding"
    assert executed.findings == ()


def test_force_control_presses_along_the_tool_axis_until_it_ends() -> None:
    body = (
        f"MoveL p0,{TAIL}\nFCPress1LStart p1,v10,\\Fz:=5,50,fine,tG;\n"
        "FCPressL p2,v10,5,z1,tG;\nFCPressEnd p1,v10,tG;"
    )
    items = run_without_assumptions(body)
    assert [type(item) for item in items] == [MoveL, Force, MoveL, MoveL, Force, MoveL]
    assert items[3].force == 5  # type: ignore[union-attr]
    assert items[1].force_direction == pytest.approx((0, 0, -1))  # type: ignore[union-attr]


# Outputs and waits --------------------------------------------------------------------------------


def test_outputs_are_set_pulsed_and_inverted_in_order() -> None:
    items = run_without_assumptions(
        "SetDO do1,1;\nSet do2;\nReset do2;\nSetDO do1,low;\nInvertDO do1;\nSetAO ao1,2.5;\n"
        "SetGO go1,7;\n"
        "PulseDO\\PLength:=0.5,do3;\nStop;"
    )
    assert [(item.signal, item.value) for item in items if isinstance(item, Output)] == [
        ("do1", 1),
        ("do2", 1),
        ("do2", 0),
        ("do1", 0),
        ("do1", 1),
        ("ao1", 2.5),
        ("go1", 7),
        ("do3", 1),
        ("do3", 0),
    ]
    assert isinstance(items[-1], Stop)


@pytest.mark.parametrize(
    ("body", "state", "values"),
    [
        ("PulseDO\\High,do3;", "on", [1]),
        ("Set do3;\nPulseDO do3;", "off", [1, 1, 0]),
    ],
)
def test_the_value_of_an_output_after_a_pulse_is_assumed_where_it_is_not_certain(
    body: str, state: str, values: list[int]
) -> None:
    executed = run_main(body)
    assert [item.value for item in executed.body if isinstance(item, Output)] == values
    (assumption,) = executed.assumed
    assert assumption.what == f"do3 is assumed to be {state} after PulseDO"
    other = run_main(body, do3=float(state == "off"))
    assert [item.value for item in other.body if isinstance(item, Output)][-1] != values[-1]


def test_an_output_in_a_corner_is_dangerous() -> None:
    executed = run_main(
        "MoveL p1,v100,z10,tG;\nSetDO do1,1;\nMoveL p0,v100,z10,tG;\nWaitTime 1;\nSetDO do1,0;"
    )
    assert [(finding.level, finding.line) for finding in executed.findings] == [("dangerous", 14)]


def test_a_wait_for_an_unknown_value_ends_at_once_with_an_assumption() -> None:
    executed = run_main("WaitDI di1,1;\nWaitUntil n=5;\nWaitTime\\InPos,0;\nWaitTime 2;")
    assert wait_seconds(executed) == [2]
    assert [assumption.what for assumption in executed.assumed] == [
        "di1: the wait for 1 is over at once",
        "a condition: the wait for it is over at once",
    ]


# Values -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("7 DIV 2", 3),
        ("7 MOD 2", 1),
        ("2+3*4", 14),
        ("(2+3)*4", 20),
        ("10-4-3", 3),
        ("Abs(-3)", 3),
        ("Pow(2,3)", 8),
        ("Sqrt(9)", 3),
        ("Sin(30)", 0.5),
        ("ATan2(1,1)", 45),
        ("Round(2.567\\Dec:=1)", 2.6),
        ("Round(2.5)", 3),
        ("Trunc(2.9)", 2),
        ("a{2}", 20),
        ("Dim(a,1)", 3),
        ("p1.trans.x", 100),
        ("Distance(p0.trans,p1.trans)", 100),
        ("VectMagn([3,4,0])", 5),
        ("DotProd([1,2,3],[1,1,1])", 6),
        ('StrLen("abc")', 3),
        ('StrFind("abc",1,"c")', 3),
        ('StrMatch("abcabc",2,"ab")', 4),
        ("BitAnd(6,3)", 2),
        ("BitNeg(5)", 250),
        ("BitLShDnum(3,8)", 768),
        ("BitRShDnum(768,8)", 3),
        ("EulerZYX(\\X,OrientZYX(10,20,30))", 30),
        ("EulerZYX(\\Z,OrientZYX(10,20,30))", 10),
        ('StrFind("aab",1,"a"\\NotInSet)', 3),
        ("ATan(1)", 45),
        ("-(7 DIV -2)", 3),
        ("StrLen(NumToStr(12345,1\\Exp))", 7),
    ],
)
def test_an_expression_has_the_value_of_the_manual(expression: str, value: float) -> None:
    assert compute_num(expression) == pytest.approx(value)


@pytest.mark.parametrize(
    "condition",
    [
        "1<2",
        "2>=2",
        "1<>2",
        "TRUE OR b",
        "NOT b",
        "TRUE XOR b",
        "NOT b AND NOT b",
        '"a"+"b"="ab"',
        'StrPart("abcd",2,2)="bc"',
        'NumToStr(1.26,1)="1.3"',
        'ValToStr([1,2])="[1,2]"',
        "p1.trans=[100,0,0]",
        'StrToVal("7.5",n) AND n=7.5',
        'NOT StrToVal("x",n)',
        "PoseMult([[1,0,0],[1,0,0,0]],[[2,0,0],[1,0,0,0]])=[[3,0,0],[1,0,0,0]]",
        "p1.trans+[0,0,1]=[100,0,1]",
        "[1,0,0]*[0,1,0]=[0,0,1]",
        'StrMap("abc","ab","xy")="xyc"',
    ],
)
def test_a_condition_holds(condition: str) -> None:
    assert wait_seconds(run_main(f"IF {condition} WaitTime 1;")) == [1]


@pytest.mark.parametrize(
    ("origin", "position"),
    [("", (0, 0, 0)), ("\\Origin:=2", (100, 0, 0)), ("\\Origin:=3", (30, 0, 0))],
)
def test_defframe_makes_a_frame_of_three_points(
    origin: str, position: tuple[float, float, float]
) -> None:
    body = (
        f"VAR pose f;\nf:=DefFrame(p0,p1,Offs(p0,30,40,0){origin});\n"
        f"MoveL [f.trans,f.rot,p1.robconf,p1.extax],{TAIL}"
    )
    assert positions(run_without_assumptions(body)) == [position]


def test_elements_and_components_are_assigned() -> None:
    assert compute_num("a{3}", "a{3}:=a{1}+1;") == 11
    body = f"p:=p1;\np.trans.z:=9;\np.trans:=p.trans+[0,1,0];\nMoveL p,{TAIL}"
    assert positions(run_without_assumptions(body)) == [(100, 1, 9)]
    assert compute_num("n", "Incr n;\nAdd n,4;\nDecr n;") == 4


def test_records_and_aliases_of_a_module_are_used() -> None:
    module = f"""MODULE m
RECORD part
  num height;
  robtarget at;
ENDRECORD
ALIAS num level;
PERS part one:=[5,[[1,2,3],[1,0,0,0],[0,0,0,0],{E9}]];
VAR part all{{2}};
VAR level high:=2;
PROC main()
  all{{2}}:=one;
  all{{2}}.at.trans.z:=all{{2}}.height*high;
  MoveL all{{2}}.at,v100,fine,tool0;
ENDPROC
ENDMODULE
"""
    assert positions(run({"m.mod": module}, RunRequest())) == [(1, 2, 10)]


# Control ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("body", "seconds"),
    [
        ("FOR i FROM 1 TO 3 DO\nWaitTime i;\nENDFOR", [1, 2, 3]),
        ("FOR i FROM 3 TO 1 DO\nWaitTime i;\nENDFOR", [3, 2, 1]),
        ("FOR i FROM 1 TO 2 STEP 0.5 DO\nWaitTime i;\nENDFOR", [1, 1.5, 2]),
        ("FOR i FROM 1 TO 2 STEP -1 DO\nWaitTime i;\nENDFOR", []),
        ("WHILE n<3 DO\nIncr n;\nWaitTime n;\nENDWHILE", [1, 2, 3]),
        (
            (
                "n:=2;\nTEST n\nCASE 1:\nWaitTime 1;\nCASE 2,3:\nWaitTime 2;\nDEFAULT:\n"
                "WaitTime 9;\nENDTEST"
            ),
            [2],
        ),
        ('TEST s\nCASE "x":\nWaitTime 1;\nDEFAULT:\nWaitTime 9;\nENDTEST', [9]),
        ("IF n=1 THEN\nWaitTime 1;\nELSEIF n=0 THEN\nWaitTime 2;\nELSE\nWaitTime 3;\nENDIF", [2]),
        ("again:\nIncr n;\nWaitTime n;\nIF n<3 GOTO again;", [1, 2, 3]),
        ("IF TRUE GOTO out;\nWaitTime 1;\nout:\nWaitTime 2;", [2]),
        ("WaitTime 1;\nEXIT;\nWaitTime 2;", [1]),
        ("WaitTime 1;\nRETURN;\nWaitTime 2;", [1]),
        ("sub 2;\nWaitTime n;", [2, 4]),
        ("WaitTime twice(3);", [6]),
        ('%"s"+"ub"% 2;', [2]),
        ('CallByVar "path",1;', [7]),
        ("change n;\nWaitTime n;", [5]),
        ("keep a{1};\nWaitTime a{1};", [10]),
        ("change a{1};\nWaitTime a{1};", [5]),
        ("opt;\nopt\\x:=2;\nopt\\y;\nouter\\x:=3;\nouter;", [0, 2, 1, 3, 0]),
    ],
)
def test_control_flow_runs_the_statements_in_order(body: str, seconds: list[float]) -> None:
    more = """PROC sub(num k)
WaitTime k;
n:=2*k;
ENDPROC
FUNC num twice(num k)
RETURN 2*k;
ENDFUNC
PROC path1()
WaitTime 7;
ENDPROC
PROC change(INOUT num k)
k:=5;
ENDPROC
PROC keep(num k)
k:=5;
ENDPROC
PROC opt(\\num x | switch y)
IF Present(x) THEN
WaitTime x;
ELSEIF Present(y) THEN
WaitTime 1;
ELSE
WaitTime 0;
ENDIF
ENDPROC
PROC outer(\\num x)
opt\\x?x;
ENDPROC"""
    executed = run_main(body, more)
    assert wait_seconds(executed) == seconds
    assert (executed.findings, executed.assumed, executed.stopped) == ((), (), None)


def test_an_error_that_is_raised_is_handled() -> None:
    more = "PROC sub()\nIF n<2 RAISE 7;\nWaitTime n;\nERROR\nRAISE;\nENDPROC"
    body = "sub;\nWaitTime 9;\nERROR\nIncr n;\nRETRY;"
    assert wait_seconds(run_main(body, more)) == [2, 9]
    assert wait_seconds(run_main(body.replace("RETRY", "TRYNEXT"), more)) == [9]
    assert wait_seconds(run_main(body.replace("RETRY", "RETURN"), more)) == []
    assert run_main("RAISE 7;").stopped == (13, "an error is raised that no handler takes")


def test_a_loop_without_end_is_shown_once() -> None:
    for body in (
        f"WHILE TRUE DO\nMoveL p1,{TAIL}\nENDWHILE\nWaitTime 9;",
        f"x:\nMoveL p1,{TAIL}\nGOTO x;",
        f"MoveL p1,{TAIL}\nmain;",
        f"WHILE TRUE DO\nMoveL p1,{TAIL}\nIF b RETURN;\nENDWHILE",
    ):
        executed = run_main(body)
        assert positions(executed) == [(100, 0, 0)]
        assert wait_seconds(executed) == []
        assert "shown once" in executed.assumed[0].what
        assert executed.stopped is None


@pytest.mark.parametrize(
    "loop",
    [
        "WHILE TRUE DO\nWaitTime 1;\nIF di1=1 RETURN;\nENDWHILE",
        "again:\nWaitTime 1;\nIF di1=1 GOTO out;\nGOTO again;\nout:",
    ],
)
def test_a_loop_is_left_at_the_statement_that_an_input_could_take(loop: str) -> None:
    """The run does not continue after ENDWHILE, which the program never reaches."""
    executed = run_main("sub;\nWaitTime 9;", f"PROC sub()\n{loop}\nENDPROC")
    assert (wait_seconds(executed), executed.stopped) == ([1, 9], None)
    assert "a loop repeats: it is shown once" in [item.what for item in executed.assumed]


@pytest.mark.parametrize(
    ("body", "seconds"),
    [
        # TRYNEXT passes the whole IF whose condition raises the error.
        ("IF f()=1 THEN\nWaitTime 1;\nENDIF\nWaitTime 2;\nERROR\nTRYNEXT;", [2]),
        # A GOTO out of two FORs, and out of the handler, ends them.
        ("FOR i FROM 1 TO 3 DO\nFOR n FROM 5 TO 6 DO\nGOTO x;\nENDFOR\nENDFOR\nx:\nSub n;", [0]),
        ("FOR n FROM 5 TO 6 DO\nRAISE 7;\nENDFOR\nx:\nWaitTime n;\nERROR\nGOTO x;", [0]),
        # A label in an inner block, and one of a handler, are not those of the block around it.
        ("GOTO x;\nIF TRUE THEN\nx:\nENDIF\nx:\nWaitTime 1;", [1]),
        ("TEST n\nCASE 0:\nCASE 1:\nWaitTime 1;\nENDTEST\nWaitTime 2;", [2]),
        ("n:=3;\nFOR i FROM 1 TO 2 STEP 0 DO\nWaitTime 1;\nENDFOR\nWaitTime n;", [3]),
        # An assignment to the variable of a FOR does not change its iterations.
        ("FOR i FROM 1 TO 3 DO\nWaitTime i;\ni:=7;\nENDFOR", [1, 2, 3]),
        # A handler runs once for an error, however deep the blocks are.
        ("IF TRUE THEN\nIF TRUE THEN\nRAISE 7;\nENDIF\nENDIF\nERROR\nWaitTime 1;\nRETURN;", [1]),
    ],
)
def test_jumps_and_handlers_leave_their_blocks(body: str, seconds: list[float]) -> None:
    more = "FUNC num f()\nRAISE 8;\nENDFUNC\nPROC sub(num k)\nWaitTime k;\nENDPROC"
    executed = run_main(body, more)
    assert wait_seconds(executed) == seconds
    assert (executed.findings, executed.assumed, executed.stopped) == ((), (), None)


def test_a_loop_that_alternates_between_two_values_ends() -> None:
    executed = run_main("WHILE n<5 DO\nn:=1-n;\nENDWHILE\nWaitTime 9;")
    assert wait_seconds(executed) == [9]
    assert executed.stopped is None
    assert [item.what for item in executed.assumed] == [
        "a loop waits for what nothing in it changes: it ends at once"
    ]


def test_a_loop_that_waits_for_an_external_change_ends() -> None:
    executed = run_main(
        "WHILE b=FALSE DO\nWaitTime 0;\nENDWHILE\nWHILE di1=0 DO\nWaitTime 0.1;\nENDWHILE\n"
        "WaitTime 9;"
    )
    assert wait_seconds(executed) == [0, 9]
    assert [(assumption.key, assumption.value) for assumption in executed.assumed] == [
        ("", 0),
        ("di1", 1),
    ]


def test_a_run_stops_at_the_limit_of_steps_and_of_nested_calls() -> None:
    executed = run_main("WHILE n>=0 DO\nn:=n+1;\nENDWHILE")
    assert executed.stopped is not None
    assert "limits.rapid_steps" in executed.stopped[1]
    assert run_main("sub;", "PROC sub()\nsub;\nENDPROC").stopped == (
        16,
        "routines call each other more than 70 deep",
    )


# Unknown values -----------------------------------------------------------------------------------

BRANCH = f"IF di1=1 THEN\nMoveL p1,{TAIL}\nELSE\nMoveL p2,{TAIL}\nENDIF"


@pytest.mark.parametrize(
    ("assume", "position"),
    [({}, (100, 0, 0)), ({"di1": 1.0}, (100, 0, 0)), ({"di1": 0.0}, (100, 50, 0))],
)
def test_an_input_is_assumed_unless_the_user_gives_it(
    assume: Mapping[str, float], position: tuple[float, float, float]
) -> None:
    executed = run_main(BRANCH, **assume)
    assert positions(executed) == [position]
    assumptions = [(entry.line, entry.key, entry.value) for entry in executed.assumed]
    assert assumptions == ([] if assume else [(13, "di1", 1.0)])


@pytest.mark.parametrize(
    "branch",
    [
        f"IF TestDI(diFault) THEN\nMoveL p2,{TAIL}\nStop;\nENDIF\nMoveL p1,{TAIL}",
        f"IF diFault=1 RETURN;\nMoveL p1,{TAIL}",
        f'IF diOk=0 THEN\nTPWrite "no";\nEXIT;\nELSE\nMoveL p1,{TAIL}\nENDIF',
        f'TEST giPart\nCASE 0:\nTPWrite "no";\nCASE 4:\nMoveL p1,{TAIL}\nDEFAULT:\nStop;\nENDTEST',
        (
            f'TPReadFK n,"?","a","b",stEmpty,stEmpty,stEmpty;\nIF n=1 THEN\nMoveL p1,{TAIL}\n'
            "ELSE\nStop;\nENDIF"
        ),
    ],
)
def test_an_unknown_condition_takes_the_branch_that_continues(branch: str) -> None:
    executed = run_main(branch)
    assert positions(executed) == [(100, 0, 0)]
    assert executed.assumed


def test_the_answer_of_the_operator_is_the_value_that_the_user_gives() -> None:
    body = 'TPReadNum n,"how many";\nFOR i FROM 1 TO n DO\nWaitTime i;\nENDFOR'
    assert wait_seconds(run_main(body, n=2)) == [1, 2]
    assert wait_seconds(run_main(body)) == [1]


def test_a_variable_is_unknown_after_it_is_passed_to_an_unknown_routine() -> None:
    """The routine may change it. A pose of the zeros from before the call would be refused."""
    data = "VAR robtarget pIn;\nVAR num nIn:=1;\nCONST num nFixed:=2;\n"
    executed = run_main(
        f"{data}GetItem pIn,nIn,nFixed,zOwn;\nMoveL RelTool(pIn,0,0,10),{TAIL}\n"
        "WaitTime nFixed;\nMoveL p1,v100,fine,tool0;"
    )
    assert executed.findings == ()
    assert "a target is not known (what getitem gives to pIn): motions there are left out" in [
        assumption.what for assumption in executed.assumed
    ]
    assert positions(executed) == [(100, 0, 0)]
    assert wait_seconds(executed) == [2.0]


def test_a_loop_that_the_operator_ends_is_run_until_the_other_answer() -> None:
    loop = "WHILE n>=0 DO\nMoveL Offs(p1,n,0,0),v100,fine,tool0;\nTPReadFK a,{texts};\n"
    loop += "IF a=1 THEN\nn:=n+1;\nELSEIF a=2 THEN\nn:=-1;\nENDIF\nENDWHILE"
    texts = ",".join(['"again?"', '"yes"', '"no"', *["stEmpty"] * 3])
    executed = run_main("VAR num n:=0;\nVAR num a;\n" + loop.replace("{texts}", texts))
    assert executed.stopped is None
    assert positions(executed) == [(100, 0, 0), (101, 0, 0)]


def test_names_of_files_that_are_missing_are_listed() -> None:
    executed = run_main(
        f"gripOpen 5;\nMoveL pThere,{TAIL}\nMoveL p1,vOwn,zOwn,tOwn\\WObj:=wOwn;\nWaitTime f(1);"
    )
    assert positions(executed) == [(100, 0, 0)]
    assumptions = [assumption.what for assumption in executed.assumed]
    assert assumptions[0] == "gripopen is in none of the files: it is left out"
    assert assumptions[1] == "a target is not known (pThere): motions there are left out"
    assert {
        "the tool tOwn is in none of the files: its frame is not known",
        "f is in none of the files: what it gives is not known",
    } <= set(assumptions)
    assert executed.frames[-1].flange_from_tool is None
    assert executed.findings == ()


def test_modules_share_their_global_names() -> None:
    other = (
        f"MODULE o\nLOCAL CONST num k:=3;\nPROC sub()\nWaitTime k;\nMoveL p1,{TAIL}\nENDPROC\n"
        "ENDMODULE\n"
    )
    executed = run({"m.mod": make_module("sub;"), "o.mod": other}, RunRequest())
    assert (wait_seconds(executed), positions(executed), executed.assumed) == (
        [3],
        [(100, 0, 0)],
        (),
    )
    assert executed.lines == (20, 21)


def test_the_entry_is_main_or_the_routine_without_parameters_or_the_one_of_the_user() -> None:
    more = "PROC other()\nWaitTime 3;\nENDPROC"
    assert wait_seconds(
        run({"m.mod": make_module("WaitTime 1;", more)}, RunRequest(entry="Other"))
    ) == [3]
    without_main = make_module("", more).replace(
        "PROC main()\n\nENDPROC\n", "PROC help(num k)\nENDPROC\n"
    )
    executed = run({"m.mod": without_main}, RunRequest())
    assert (wait_seconds(executed), dict(executed.facts)["entry"]) == (
        [3],
        "other, as there is no main",
    )
    assert dict(run({"m.mod": "MODULE d\nENDMODULE\n"}, RunRequest()).facts)["entry"].startswith(
        "none"
    )


# Refusals of a controller -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("body", "what"),
    [
        ("n:=1/0;", "a division by 0"),
        ("n:=a{4};", "element 4 of a, which has 3"),
        ('n:=1+"a";', "a num + a string: there is no such operation"),
        ("p0:=p1;", "p0 is a constant"),
        ("n:=p1.trans.q;", "pos has no component q"),
        ("IF n RETURN;", "the condition of IF is not a bool"),
        ("MoveL p1,v100,tG;", "movel has 4 arguments, not 3"),
        (f"MoveL a,{TAIL}", "a robtarget is needed"),
        (f"MoveL p,{TAIL}", "an invalid orientation (the sum of its squares is 0)"),
        ("MoveL p1,p1,fine,tG;", "a num is needed in a speeddata"),
        ("MoveL p1,n,fine,tG;", "a speeddata is needed"),
        ("MoveL p1,v10,[FALSE,1],tG;", "zonedata has 7 components, not 2"),
        ("GOTO nowhere;", "GOTO nowhere: there is no such label where it could go to"),
        ("g 5;", "g has 0 arguments, not 1"),
        ("SetDO do1,7;", "do1 is set to 7; a digital output is 0 or 1"),
        ("WaitTime -1;", "a wait must not be negative"),
        ("f;", "f is a FUNC, no statement"),
        ("RETRY;", "RETRY outside of an error handler"),
        (
            f"MoveL p0,{TAIL}\nMoveC p1,Offs(p1,9,0,0),{TAIL}",
            "the points of an arc are on one line",
        ),
        (f"MoveL p0,{TAIL}\nFCPressL p1,v10,5,fine,tG;", "fcpressl without FCPress1LStart"),
        ("<SMT>", "<SMT>: a place that is not filled in; the controller stops there"),
    ],
)
def test_a_statement_that_a_controller_refuses_is_refused(body: str, what: str) -> None:
    executed = run_main(body, "FUNC num f()\nRETURN 1;\nENDFUNC\nPROC g()\nENDPROC")
    assert [(finding.level, finding.what) for finding in executed.findings] == [("refused", what)]


#: A target, without its configuration.
TARGET = "[[500,0,500],[0,0,1,0],[{}],[9E9,9E9,9E9,9E9,9E9,9E9]]"


@pytest.mark.parametrize(
    ("before", "switch", "move", "after", "is_found"),
    [
        # Shoulder, elbow or wrist changes.
        ("0,0,0,0", "", "MoveL", "0,0,0,1", True),
        # Axis 6 moves from the quadrant -180 to -90 deg to the quadrant 90 to 180 deg.
        ("0,0,-2,0", "", "MoveL", "0,0,1,0", True),
        ("0,0,-2,0", "ConfL\\On;", "MoveL", "0,0,1,0", True),
        ("0,0,-2,0", "ConfL\\Off;", "MoveL", "0,0,1,0", False),
        # A joint motion may change it, and a line may cross into the next quadrant.
        ("0,0,-2,0", "", "MoveJ", "0,0,1,1", False),
        ("0,0,0,0", "", "MoveL", "-1,0,1,0", False),
    ],
)
def test_a_line_that_changes_the_configuration_is_dangerous(
    before: str, switch: str, move: str, after: str, is_found: bool
) -> None:
    """Reference manual, ConfL: when it is on, the program stops if the configuration changes."""
    body = f"{switch}\nMoveJ {TARGET.format(before)},v10,fine,tG;\n"
    executed = run_main(body + f"{move} {TARGET.format(after)},v10,fine,tG;")
    old, new = f"[{before}]", f"[{after}]"
    what = f"the configuration of the axes changes from {old} to {new} on the way: "
    expected = [("dangerous", what + "with ConfL the controller stops there")]
    listed = [(finding.level, finding.what) for finding in executed.findings]
    assert listed == expected * is_found


def test_a_value_is_unknown_after_its_assignment_was_refused() -> None:
    """The controller stops there and does not reach the lines that use the value."""
    findings = run_main("n:=0;\nn:=1/n;\nn:=1/n;\nn:=a{n};").findings
    assert [finding.what for finding in findings] == ["a division by 0"]


@pytest.mark.parametrize(
    ("module", "what"),
    [
        ("VAR num k;\nVAR num K;", "K is declared twice, first in line 2"),
        (f"VAR num {'k' * 33};", f"{'k' * 33} is longer than 32 characters"),
        ("PROC q(num k)\nVAR num k;\nENDPROC", "k is declared twice in q"),
    ],
)
def test_a_name_that_a_controller_refuses_is_found(module: str, what: str) -> None:
    (finding,) = run({"m.mod": f"MODULE m\n{module}\nENDMODULE\n"}, RunRequest()).findings
    assert finding.what == what


def test_a_tool_must_be_a_persistent() -> None:
    executed = run_main("VAR tooldata t2;\nt2:=tG;\nMoveL p1,v100,fine,t2;")
    assert [finding.what for finding in executed.findings] == [
        "t2 is VAR: the tooldata of a motion must be a persistent (PERS)"
    ]


def test_a_burning_arc_at_the_end_is_dangerous() -> None:
    executed = run_main("ArcLStart p1,v100,sm,wd,fine,tG;")
    assert [(finding.level, finding.what) for finding in executed.findings] == [
        ("dangerous", "the arc still burns at the end: ArcLEnd is missing")
    ]


def test_an_output_in_a_corner_that_keeps_its_value_is_not_dangerous() -> None:
    executed = run_main(
        "SetDO do1,0;\nMoveL p1,v100,z10,tG;\nReset do1;\nMoveL p0,v100,z0,tG;\nSet do1;\n"
        "MoveL p1,v100,z5,tG;\nSetGO go1,3;"
    )
    assert [(finding.level, finding.line) for finding in executed.findings] == [("unusual", 19)]


@pytest.mark.parametrize(
    ("condition", "assume"),
    [
        ("bReady", {"bready": 1.0}),
        ("NOT bReady", {"bready": 0.0}),
        ("bReady AND TRUE", {"bready": 1.0}),
        ("bReady=TRUE", {"bready": 1.0}),
        ("giPart>5", {"gipart": 6.0}),
        ("5>=giPart", {"gipart": 4.0}),
        ("GInput(giPart)=7", {"gipart": 7.0}),
        ("f2()=3", {"f2": 3.0}),
    ],
)
def test_an_assumed_value_can_be_given_by_its_key(
    condition: str, assume: Mapping[str, float]
) -> None:
    body = f"IF {condition} THEN\nMoveL p1,{TAIL}\nELSE\nStop;\nENDIF"
    executed = run_main(body)
    decisions = [entry for entry in executed.assumed if " depends on " in entry.what]
    assert [(entry.key, entry.value) for entry in decisions] == list(assume.items())
    given = run_main(body, **assume)
    assert (positions(given), given.assumed[1:], given.findings) == ([(100, 0, 0)], (), ())


def test_outputs_that_stay_on_are_a_fact() -> None:
    assert dict(run_main("Set do1;\nSet do2;\nReset DO1;").facts)["on at the end"] == "do2"


def test_an_error_that_is_raised_to_the_user_is_handled() -> None:
    handler = (
        "PROC two()\nRaiseToUser \\Continue \\ErrorNumber:=7;\nERROR\nWaitTime 3;\nTRYNEXT;\n"
        "ENDPROC"
    )
    executed = run_main("two;\nWaitTime 1;", handler)
    assert wait_seconds(executed) == [3.0, 1.0]
    assert executed.lost == ()


def test_instructions_of_newer_controllers_give_unknown_values() -> None:
    executed = run_main(
        "GetJointData 1\\Position:=n;\nSocketReceiveFrom s1\\Str:=s;\nStepBwdPath 30,1;"
    )
    assert not executed.findings
    assert [what for _, what in executed.lost] == [
        "stepbwdpath moves the arm on a path that is not in the text: it is not shown"
    ]


def test_a_handler_distinguishes_errors_by_errno() -> None:
    more = (
        "PROC sub(num k)\nIF k=1 RAISE mine;\nIF k=2 RAISE ERR_DIVZERO;\nRAISE ERR_OTHER;\n"
        "ERROR\nRAISE;\nENDPROC"
    )
    handler = (
        "ERROR\nIF ERRNO=mine THEN\nWaitTime 7;\nTRYNEXT;\nELSEIF "
        "ERRNO=ERR_DIVZERO THEN\nWaitTime 8;\nTRYNEXT;\nENDIF"
    )
    module = make_module(
        f"VAR errnum mine;\nBookErrNo mine;\nsub 1;\nsub 2;\nWaitTime 9;\nsub 3;\n{handler}", more
    )
    module = module.replace("PROC main()\nVAR errnum mine;", "VAR errnum mine;\nPROC main()")
    executed = run({"m.mod": module}, RunRequest())
    assert wait_seconds(executed) == [7, 8, 9]
    assert executed.assumed == ()
    line = module.split("\n").index("RAISE ERR_OTHER;") + 1
    assert executed.stopped == (line, "an error is raised that no handler takes")


def test_a_motion_without_a_target_in_the_text_is_an_assumption() -> None:
    executed = run_main(
        f"MoveL p1,{TAIL}\nEGMRunPose id,EGM_STOP_HOLD\\X;\nMoveL Offs(CRobT(),0,0,9),{TAIL}"
    )
    assert positions(executed) == [(100, 0, 0), (0, 0, 9)]
    assert executed.frames[executed.frame[1]].base_from_work is None
    assert (
        executed.assumed[0].what
        == "egmrunpose moves the arm on a path that is not in the text: it is not shown"
    )


def test_a_main_that_does_nothing_is_not_the_entry() -> None:
    executed = run_main(
        "! nothing yet",
        "PROC Path_10()\nWaitTime 3;\nENDPROC\nPROC other()\nPath_10;\nWaitTime 4;\nENDPROC",
    )
    assert wait_seconds(executed) == [3, 4]
    assert dict(executed.facts) == {"entry": "other, as main does nothing", "not run": "main"}


@pytest.mark.parametrize(
    ("body", "what"),
    [
        ("MoveL p1,v37,fine,tG;", "v37 is not a predefined speed or zone, and no file defines it"),
        ("MoveL p1,v100,z3,tG;", "z3 is not a predefined speed or zone, and no file defines it"),
        ("MoveL p1,[0,500,5000,1000],fine,tG;", "a speed of 0 mm/s: the arm hardly moves"),
        (
            "MoveL [[0,0,0],[0,0.98,0,0],p1.robconf,p1.extax],v10,fine,tG;",
            "an orientation that is not normalised (the sum of its squares is off by 0.04)",
        ),
        (
            f"MoveL p1,{TAIL}\nMoveL RelTool(p1,0,0,9\\Rx:=180),{TAIL}",
            "the tool turns by 180 deg in one straight motion; its sense is open",
        ),
        (
            "tG.tload.mass:=0;\nMoveL p1,v10,fine,tG;",
            "the mass of the tool tG is 0 kg; the manual asks for more than 0",
        ),
        (";", "an empty statement, which the kernel manual does not have"),
    ],
)
def test_a_statement_that_is_probably_a_mistake_is_unusual(body: str, what: str) -> None:
    (finding,) = run_main(body).findings
    assert (finding.level, finding.what) == ("unusual", what)


def test_effects_that_are_simplified_are_facts_or_losses() -> None:
    executed = run_main(
        "SetDO\\SDelay:=0.5,do1,0;\nMoveL\\Conc,p1,v100,fine,tG\\Corr;\n"
        "MoveExtJ [p1.extax,p1.extax],v9,fine;"
    )
    facts = dict(executed.facts)
    assert facts["delays"] == "SetDO with SDelay is shown without it"
    lost = [what for _, what in executed.lost if "\\corr" in what]
    assert lost == ["movel \\corr: a sensor corrects the path; teach the corrected path"]
    effect = "the next instruction runs during the motion; here it waits for the motion"
    assert [what for _, what in executed.omitted] == [f"movel \\conc: {effect}"]
    assert facts["external axes"] == "move on their own and are not shown"


#: A loop polls `place`, which no statement sets; the division fails while `place` is 0.
POLLING_LOOP = (
    "WHILE n<3 DO\nIF place>0 THEN\nfound:=place;\nENDIF\nn:=n+1;\nENDWHILE\nn:=100/found;"
)
DATA = "PERS num place:=0;\nVAR num found;\n"


def make_polling_module(body: str, more: str = "") -> str:
    return make_module(body, more).replace("PROC main", f"{DATA}PROC main")


def run_polled(body: str, more: str = "", **assume: float) -> Executed:
    return run({"m.mod": make_polling_module(body, more)}, RunRequest(assume=assume))


def test_data_that_a_loop_polls_and_no_statement_sets_are_set_outside_of_the_program() -> None:
    executed = run_polled(POLLING_LOOP)
    assert [finding.what for finding in executed.findings] == ["a division by 0"]
    assert executed.assumed == ()
    assert ("set outside", "place: the run has the values of the text") in executed.facts
    (choice,) = executed.choices
    other = run({"m.mod": make_polling_module(POLLING_LOOP)}, RunRequest(shifts={choice.line: 1}))
    assert other.findings == ()
    assert other.assumed[0].what.startswith(
        "an IF depends on place, which is set outside of this program"
    )
    assert (other.assumed[0].key, choice.options) == ("place", 2)
    # A value of the user counts in each run, and no choice is left.
    given = run_polled(POLLING_LOOP, place=5.0)
    assert (given.findings, given.choices) == ((), ())


def test_the_fault_of_a_value_that_is_set_outside_is_possible() -> None:
    files = {"m.mod": make_polling_module(POLLING_LOOP)}
    (finding,) = run_alternatives(LANGUAGE, files, RunRequest()).executed.findings
    assert finding.level == "possible"
    assert finding.what.startswith(
        "a division by 0; it depends on place, set outside of this program"
    )


def test_a_motion_that_the_values_of_the_text_skip_is_not_run() -> None:
    """A translated program has the motions that result from the values of the text."""
    body = "WHILE n<3 DO\nIF place>0 THEN\nMoveJ p2,v100,fine,tG;\nENDIF\nn:=n+1;\nENDWHILE"
    assert positions(run_polled(f"MoveJ p1,v100,fine,tG;\n{body}")) == [(100.0, 0.0, 0.0)]


@pytest.mark.parametrize(
    ("body", "more"),
    [
        # Read once, outside of a loop.
        ("IF place>0 THEN\nfound:=place;\nENDIF\nn:=100/found;", ""),
        # Another routine sets it.
        (POLLING_LOOP, "PROC other()\nplace:=1;\nENDPROC"),
        # An instruction may set it.
        (POLLING_LOOP, "PROC other()\nIncr place;\nENDPROC"),
    ],
)
def test_other_data_have_the_value_of_the_text(body: str, more: str) -> None:
    executed = run_polled(body, more)
    assert [finding.what for finding in executed.findings] == ["a division by 0"]


def test_a_variable_is_not_set_outside_of_its_program() -> None:
    program = make_polling_module(POLLING_LOOP).replace("PERS num", "VAR num")
    executed = run({"m.mod": program}, RunRequest())
    assert [finding.what for finding in executed.findings] == ["a division by 0"]


@pytest.mark.parametrize(
    ("statement", "kind"),
    [
        ("MoveL pSeen,v100,fine,tG;", "robtarget"),
        ("MoveAbsJ pSeen,v100,fine,tG;", "jointtarget"),
        (
            "MoveL [[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],pSeen,fine,tG;",
            "speeddata",
        ),
    ],
)
def test_a_number_that_the_user_gives_for_a_record_is_refused(statement: str, kind: str) -> None:
    executed = run_main(statement, pseen=5.0)
    assert [finding.what for finding in executed.findings] == [f"a {kind} is needed"]
    assert len(executed.body) == 0
