"""TRAPs of RAPID: a TRAP that the user assumes is run; the others are listed with their effects."""

import pytest

from camgen.lang.programs import Executed
from camgen.model.program import MoveL, Output, Stop, Wait
from tests.lang.rapid.test_run import TAIL, positions, run_main

HEAD = "VAR intnum i1;\nCONNECT i1 WITH T_stop;\n"
TRAP = "TRAP t_stop\n{}\nENDTRAP"


def run_with_trap(body: str, trap: str = "SetDO do1,1;", **assume: float) -> Executed:
    return run_main(HEAD + body, TRAP.format(trap), **assume)


def list_kinds(executed: Executed) -> list[object]:
    return [item.value if isinstance(item, Output) else type(item) for item in executed.body]


def test_an_interrupt_is_not_run_and_is_listed() -> None:
    executed = run_with_trap(
        f"ISignalDI di1,1,i1;\nMoveL p1,{TAIL}",
        "SetDO do1,1;\nWaitTime 1;\nStop;\nMoveL p0,v10,fine,tG;",
    )
    assert list_kinds(executed) == [MoveL]
    assert [(entry.line, entry.what, entry.key, entry.value) for entry in executed.assumed] == [
        (14, "the interrupt T_stop does not come", "t_stop", 0.0)
    ]
    assert (
        dict(executed.facts)["interrupts"]
        == "t_stop (line 18): sets do1 to 1, stops, waits, 1 motion"
    )
    assert not executed.findings


@pytest.mark.parametrize(
    "arm",
    [
        "ISignalDI di1,1,i1;",
        "ITimer\\Single,2,i1;",
        "IPers n,i1;",
        "ISignalDO\\Single,do2,1,i1;",
        "IError 1,2,i1;",
    ],
)
def test_an_interrupt_that_the_user_assumes_runs_once_at_its_first_chance(arm: str) -> None:
    executed = run_with_trap(f"MoveL p0,{TAIL}\n{arm}\nMoveL p1,{TAIL}\nMoveL p2,{TAIL}", t_stop=1)
    assert list_kinds(executed) == [MoveL, 1.0, MoveL, MoveL]
    assert executed.assumed[0].what == "the interrupt T_stop comes once, where it first may"
    assert "interrupts" not in dict(executed.facts)


def test_an_interrupt_that_is_asleep_deleted_or_disabled_does_not_run() -> None:
    armed = f"ISignalDI di1,1,i1;\nMoveL p1,{TAIL}"
    assert list_kinds(run_with_trap(f"ISleep i1;\n{armed}", t_stop=1)) == [MoveL]
    assert list_kinds(run_with_trap(f"IDelete i1;\n{armed}", t_stop=1)) == [MoveL]
    disabled = f"IDisable;\n{armed}\nIEnable;\nMoveL p2,{TAIL}"
    assert list_kinds(run_with_trap(disabled, t_stop=1)) == [MoveL, 1.0, MoveL]
    sleeping = f"ISleep i1;\n{armed}\nIWatch i1;\nMoveL p2,{TAIL}"
    assert list_kinds(run_with_trap(sleeping, t_stop=1)) == [MoveL, 1.0, MoveL]


def test_an_interrupt_runs_at_its_distance_along_a_motion() -> None:
    body = (
        f"VAR triggdata tr;\n{HEAD}TriggInt tr,25\\Start,i1;\nMoveL p0,{TAIL}\n"
        "TriggL p1,v100,tr,fine,tG;"
    )
    executed = run_main(body, TRAP.format("SetDO do1,1;"), t_stop=1)
    assert list_kinds(executed) == [MoveL, MoveL, 1.0, MoveL]
    assert positions(executed) == [(0, 0, 0), (25, 0, 0), (100, 0, 0)]
    with_motion = run_main(body, TRAP.format(f"MoveL p2,{TAIL}"), t_stop=1)
    assert positions(with_motion) == [(0, 0, 0), (25, 0, 0), (100, 0, 0), (100, 50, 0)]


def test_an_output_in_a_corner_is_dangerous_in_the_program_and_not_in_a_trap() -> None:
    body = "MoveL p1,v100,z50,tG;\nISignalDI di1,1,i1;\nSetDO do2,1;\nMoveL p2,v100,fine,tG;"
    (finding,) = run_with_trap(body, t_stop=1).findings
    assert (finding.level, finding.line) == ("dangerous", 17)


def test_a_fault_in_a_trap_is_unusual_at_its_line() -> None:
    executed = run_with_trap(
        f"ISignalDI di1,1,i1;\nMoveL p1,{TAIL}", "SetDO do1,1;\nn:=1/0;\nWaitTime -1;"
    )
    assert [(finding.level, finding.line, finding.what) for finding in executed.findings] == [
        ("unusual", 20, "in the TRAP t_stop, where it comes: a division by 0"),
        ("unusual", 21, "in the TRAP t_stop, where it comes: a wait must not be negative"),
    ]


def test_a_fault_of_unknown_data_in_a_trap_is_not_found() -> None:
    assert not run_with_trap(f"ITimer 1,i1;\nMoveL p1,{TAIL}", "a{n}:=1;").findings


def test_a_trap_that_does_not_run_leaves_motions_and_frames_unchanged() -> None:
    trap = (
        "SetDO do1,1;\nMoveL p2,v100,z50,tG\\WObj:=wT;\nFCPress1LStart "
        "p2,v10\\Fz:=9,50,z5,tG;\nWHILE TRUE DO\nENDWHILE"
    )
    executed, without_trap = run_with_trap(f"MoveL p1,{TAIL}", trap), run_main(f"MoveL p1,{TAIL}")
    assert positions(executed) == positions(without_trap)
    assert (len(executed.body), len(executed.frames)) == (1, 1)
    assert not executed.findings
    assert [assumption.what for assumption in executed.assumed] == [
        "the interrupt T_stop does not come"
    ]


def test_a_trap_has_losses_only_if_it_runs() -> None:
    assert run_with_trap(f"ITimer 1,i1;\nMoveL p1,{TAIL}", "elsewhere;").lost == ()
    assert run_with_trap(f"ITimer 1,i1;\nMoveL p1,{TAIL}", "elsewhere;", t_stop=1).lost != ()


def test_a_trap_that_runs_may_stop_and_wait() -> None:
    executed = run_with_trap(f"ITimer 1,i1;\nMoveL p1,{TAIL}", "Stop;\nWaitTime 2;", t_stop=1)
    assert list_kinds(executed) == [Stop, Wait, MoveL]


def test_a_trap_that_is_in_none_of_the_files_is_an_assumption() -> None:
    executed = run_main("VAR intnum i1;\nCONNECT i1 WITH t_gone;")
    assert [assumption.what for assumption in executed.assumed] == [
        "the TRAP t_gone is in none of the files: it is left out"
    ]
