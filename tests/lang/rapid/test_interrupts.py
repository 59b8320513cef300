"""TRAPs of RAPID: what comes where the user says so, and what is told of one that does not."""

import pytest

from camgen.lang.programs import Executed
from camgen.model.program import MoveL, Output, Stop, Wait
from tests.lang.rapid.test_run import TAIL, done, places

HEAD = "VAR intnum i1;\nCONNECT i1 WITH T_stop;\n"
TRAP = "TRAP t_stop\n{}\nENDTRAP"


def traps(body: str, trap: str = "SetDO do1,1;", **assume: float) -> Executed:
    return done(HEAD + body, TRAP.format(trap), **assume)


def kinds(found: Executed) -> list[object]:
    return [item.value if isinstance(item, Output) else type(item) for item in found.body]


def test_an_interrupt_does_not_come_and_is_told() -> None:
    found = traps(
        f"ISignalDI di1,1,i1;\nMoveL p1,{TAIL}",
        "SetDO do1,1;\nWaitTime 1;\nStop;\nMoveL p0,v10,fine,tG;",
    )
    assert kinds(found) == [MoveL]
    assert [(one.line, one.what, one.key, one.value) for one in found.assumed] == [
        (14, "the interrupt T_stop does not come", "t_stop", 0.0)
    ]
    assert (
        dict(found.facts)["interrupts"] == "t_stop (line 18): sets do1 to 1, stops, waits, 1 motion"
    )
    assert not found.findings


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
def test_an_interrupt_comes_once_where_it_first_may(arm: str) -> None:
    found = traps(f"MoveL p0,{TAIL}\n{arm}\nMoveL p1,{TAIL}\nMoveL p2,{TAIL}", t_stop=1)
    assert kinds(found) == [MoveL, 1.0, MoveL, MoveL]
    assert found.assumed[0].what == "the interrupt T_stop comes once, where it first may"
    assert "interrupts" not in dict(found.facts)


def test_interrupts_that_are_off_or_held_do_not_come() -> None:
    assert kinds(traps(f"ISleep i1;\nISignalDI di1,1,i1;\nMoveL p1,{TAIL}", t_stop=1)) == [MoveL]
    assert kinds(traps(f"IDelete i1;\nISignalDI di1,1,i1;\nMoveL p1,{TAIL}", t_stop=1)) == [MoveL]
    held = f"IDisable;\nISignalDI di1,1,i1;\nMoveL p1,{TAIL}\nIEnable;\nMoveL p2,{TAIL}"
    assert kinds(traps(held, t_stop=1)) == [MoveL, 1.0, MoveL]
    watched = f"ISleep i1;\nISignalDI di1,1,i1;\nMoveL p1,{TAIL}\nIWatch i1;\nMoveL p2,{TAIL}"
    assert kinds(traps(watched, t_stop=1)) == [MoveL, 1.0, MoveL]


def test_an_interrupt_at_a_place_of_a_motion() -> None:
    body = f"VAR triggdata tr;\n{HEAD}TriggInt tr,25\\Start,i1;\nMoveL p0,{TAIL}\nTriggL p1,v100,tr,fine,tG;"
    found = done(body, TRAP.format("SetDO do1,1;"), t_stop=1)
    assert kinds(found) == [MoveL, MoveL, 1.0, MoveL]
    assert places(found) == [(0, 0, 0), (25, 0, 0), (100, 0, 0)]
    behind = done(body, TRAP.format(f"MoveL p2,{TAIL}"), t_stop=1)
    assert places(behind) == [(0, 0, 0), (25, 0, 0), (100, 0, 0), (100, 50, 0)]


def test_a_trap_switches_in_a_corner_without_harm_and_the_program_does_not() -> None:
    body = "MoveL p1,v100,z50,tG;\nISignalDI di1,1,i1;\nSetDO do2,1;\nMoveL p2,v100,fine,tG;"
    levels = [(one.level, one.line) for one in traps(body, t_stop=1).findings]
    assert levels == [("dangerous", 17)]


def test_what_is_wrong_in_a_trap_is_told_with_its_line() -> None:
    found = traps(f"ISignalDI di1,1,i1;\nMoveL p1,{TAIL}", "SetDO do1,1;\nn:=1/0;\nWaitTime -1;")
    assert [(one.level, one.line, one.what) for one in found.findings] == [
        ("unusual", 20, "in the TRAP t_stop, where it comes: a division by 0"),
        ("unusual", 21, "in the TRAP t_stop, where it comes: a wait must not be negative"),
    ]


#: Two targets between which axis 6 turns by more than a straight motion allows.
FLIP = (
    "MoveJ [[0,0,0],[1,0,0,0],[0,0,-2,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v10,fine,tG;\n"
    "MoveL [[9,0,0],[1,0,0,0],[0,0,1,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v10,fine,tG;"
)


def test_harm_in_a_trap_that_does_not_come_is_possible() -> None:
    found = traps(f"ITimer 1,i1;\nMoveL p1,{TAIL}", FLIP)
    (finding,) = found.findings
    assert (finding.level, finding.line) == ("possible", 20)
    assert finding.what.startswith("in the TRAP t_stop, where it comes: the configuration of ")


def test_settings_of_a_trap_that_does_not_come_end_with_it() -> None:
    body = f"VAR intnum i2;\n{HEAD}CONNECT i2 WITH T_next;\nMoveL p1,{TAIL}"
    both = TRAP.format("ConfL\\Off;") + f"\nTRAP T_next\n{FLIP}\nENDTRAP"
    assert [finding.level for finding in done(body, both).findings] == ["possible"]


def test_what_depends_on_data_that_are_not_there_is_no_fault_of_a_trap() -> None:
    assert not traps(f"ITimer 1,i1;\nMoveL p1,{TAIL}", "a{n}:=1;").findings


def test_nothing_that_a_trap_does_aside_is_kept() -> None:
    trap = (
        "SetDO do1,1;\nMoveL p2,v100,z50,tG\\WObj:=wT;\nFCPress1LStart "
        "p2,v10\\Fz:=9,50,z5,tG;\nWHILE TRUE DO\nENDWHILE"
    )
    found, alone = traps(f"MoveL p1,{TAIL}", trap), done(f"MoveL p1,{TAIL}")
    assert (places(found), len(found.body), len(found.frames)) == (places(alone), 1, 1)
    assert not found.findings
    assert [one.what for one in found.assumed] == ["the interrupt T_stop does not come"]


def test_what_a_trap_would_leave_out_is_not_lost() -> None:
    assert traps(f"ITimer 1,i1;\nMoveL p1,{TAIL}", "elsewhere;").lost == ()
    assert traps(f"ITimer 1,i1;\nMoveL p1,{TAIL}", "elsewhere;", t_stop=1).lost != ()


def test_a_stop_and_a_wait_are_told() -> None:
    found = traps(f"ITimer 1,i1;\nMoveL p1,{TAIL}", "Stop;\nWaitTime 2;", t_stop=1)
    assert kinds(found) == [Stop, Wait, MoveL]


def test_a_trap_that_is_in_no_file_is_named() -> None:
    found = done("VAR intnum i1;\nCONNECT i1 WITH nobody;")
    assert [one.what for one in found.assumed] == [
        "the TRAP nobody is in none of the files: it is left out"
    ]
