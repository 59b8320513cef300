"""The log of a run holds each entry once, with its first line."""

from __future__ import annotations

import pytest

from camgen.lang import log as log_module
from camgen.lang.log import Log
from camgen.lang.programs import Assumption, Finding


class Lines:
    """A run of which the test sets the line."""

    def __init__(self) -> None:
        self.line = 1
        self.log = Log(lambda: self.line)


def test_a_finding_is_noted_once_per_line() -> None:
    run = Lines()
    for line in (3, 3, 2):
        run.line = line
        run.log.find("unusual", "two tools")
    run.log.find("refused", "two tools")
    run.log.find("refused", "no tool")
    assert run.log.list_findings() == (
        Finding("refused", 2, "no tool"),
        Finding("unusual", 2, "two tools"),
        Finding("unusual", 3, "two tools"),
    )


def test_a_kind_of_finding_is_noted_once_per_program() -> None:
    run = Lines()
    run.log.find("unusual", "an arc in G19", once="plane")
    run.line = 2
    run.log.find("unusual", "an arc in G18", once="plane")
    assert run.log.list_findings() == (Finding("unusual", 1, "an arc in G19"),)


def test_a_refusal_in_a_chosen_branch_is_possible() -> None:
    run = Lines()
    run.log.find("refused", "no tool")
    run.line = 2
    run.log.choose("x is not known: the branch is run", "x", 1.0)
    run.line = 3
    run.log.find("refused", "no speed")
    run.log.find("dangerous", "force at the end")
    run.log.find("refused", "no label 7", line=9)
    assert run.log.list_findings() == (
        Finding("refused", 1, "no tool"),
        Finding("dangerous", 3, "force at the end"),
        Finding("possible", 3, "no speed, if the program comes here like this"),
        Finding("refused", 9, "no label 7"),
    )
    assert run.log.list_assumed() == (Assumption(2, "x is not known: the branch is run", "x", 1.0),)


def test_losses_and_omissions_have_their_first_line() -> None:
    run = Lines()
    for line in (4, 5):
        run.line = line
        run.log.omit("Accel 50: accelerations")
        run.log.lose_axes("a positioner turns")
        run.log.leave_out("Grip is in no file")
    assert run.log.list_omitted() == ((4, "Accel 50: accelerations"),)
    assert run.log.list_lost() == (
        (4, "external axes: a positioner turns"),
        (4, "Grip is in no file"),
    )
    assert run.log.list_assumed() == (Assumption(4, "Grip is in no file"),)


def test_facts_beyond_the_limit_are_counted() -> None:
    log = Log()
    for name in ("a", "b", "b", "c", "d"):
        log.fact("programs not run", name)
    assert log.list_facts(", ", 4) == (("programs not run", "a, b, c, d"),)
    assert log.list_facts("; ", 2) == (("programs not run", "a; b; and 2 more"),)


def test_a_text_is_one_short_line() -> None:
    log = Log()
    log.find("refused", "a\nname " + 1000 * "x")
    (finding,) = log.list_findings()
    assert finding.what.startswith("a name xxx")
    assert len(finding.what) == 400


def test_entries_of_a_copy_are_not_in_the_log() -> None:
    log = Log()
    log.fact("tools", "T1")
    copied = log.copy()
    copied.fact("tools", "T2")
    copied.find("refused", "no tool")
    copied.lose("a motion")
    assert log.list_facts(", ", 9) == (("tools", "T1"),)
    assert not log.list_findings()
    assert not log.list_lost()
    assert copied.has(Finding("unusual", 1, "no tool"))
    assert not log.has(Finding("unusual", 1, "no tool"))


def test_entries_beyond_a_limit_are_a_refusal_or_a_loss(monkeypatch: pytest.MonkeyPatch) -> None:
    """Further findings become a refusal, and further assumptions become a loss."""
    monkeypatch.setattr(log_module, "_FINDING_LIMIT", 3)
    monkeypatch.setattr(log_module, "_ENTRY_LIMIT", 3)
    log = Log()
    for number in range(9):
        log.find("unusual", f"name {number}")
        log.assume(f"x{number} is 0", f"x{number}")
    refused = Finding("refused", 1, "more than 3 findings: the others are not listed")
    assert [item for item in log.list_findings() if item.level == "refused"] == [refused]
    assert log.list_lost() == ((1, "more than 3 assumptions: the others are not listed"),)
