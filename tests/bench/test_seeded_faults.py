"""The faults that benches seed in jobs and programs of mills, and their judges, which can fail."""

from __future__ import annotations

import random
from copy import deepcopy

import pytest

from bench.check import mill_faults, set_up_faults
from bench.support.gcode_text import read_moves
from bench.support.runner import PARTS, ROOT


def read_golden(case: str) -> str:
    """The program of a golden job for LinuxCNC."""
    return (ROOT / "fixtures" / "cases" / case / "expected" / "part.ngc").read_text()


@pytest.mark.parametrize("kind", set_up_faults.JOB_FAULTS)
def test_a_fault_of_a_job_changes_the_job(kind: str) -> None:
    is_changed = []
    for case in set_up_faults.CASES:
        _, job = set_up_faults.load(case)
        faulty = deepcopy(job)
        is_changed.append(set_up_faults.JOB_FAULTS[kind](faulty, random.Random(case)))
        assert is_changed[-1] == (faulty != job)
    assert any(is_changed)


@pytest.mark.parametrize("kind", set_up_faults.TEXT_FAULTS)
def test_a_fault_of_a_text_changes_one_line(kind: str) -> None:
    counts = []
    for case in set_up_faults.CASES:
        lines = read_golden(case).split("\n")
        _, job = set_up_faults.load(case)
        changed = set_up_faults.TEXT_FAULTS[kind](lines, job, random.Random(case))
        if changed is not None:
            counts.append(sum(old != new for old, new in zip(lines, changed, strict=True)))
    assert set(counts) == {1}


def test_a_fault_of_a_text_matters_if_it_cuts_otherwise_or_exceeds_a_limit() -> None:
    _, job = set_up_faults.load("bracket-bore")
    text = read_golden("bracket-bore")
    deep = text.replace("Z-", "Z-9")
    assert not set_up_faults.is_cut_otherwise(job, text, job, text)
    assert set_up_faults.is_cut_otherwise(job, text, job, deep)
    assert not set_up_faults.exceeds(job, text)
    assert set_up_faults.exceeds(job, deep)


@pytest.mark.parametrize("kind", mill_faults.SEEDS)
def test_a_fault_of_a_mill_matters(kind: str) -> None:
    job, text = mill_faults.load("bracket-tabs"), read_golden("bracket-tabs")
    sound = mill_faults.Sound(PARTS / "bracket.dxf", job, text, list(read_moves(text)))
    assert not mill_faults.is_holder_in_stock(sound.moves, job)
    assert mill_faults.count_loose(mill_faults.find_through(sound.moves, job)) == 0
    fault = mill_faults.SEEDS[kind](sound, random.Random(1))
    assert fault is not None
    assert fault.matters
    assert (fault.text == text) == (kind == "holder in the material")
