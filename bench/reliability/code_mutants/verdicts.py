"""The verdict on a text that a mutant wrote: right, wrong with the first place, or open."""

from __future__ import annotations

from typing import NamedTuple

from bench.reliability.code_mutants.cases import FILE_MARK, Case
from bench.reliability.code_mutants.contours import check_job
from bench.reliability.code_mutants.judge import Wrong
from bench.reliability.code_mutants.traces import (
    Motion,
    Statement,
    Unreadable,
    read_events,
    read_steps,
)
from bench.reliability.modal.machine import is_same

SAME_MOTION, RIGHT, WRONG, UNKNOWN = "same motion", "right", "wrong", "open"


class Verdict(NamedTuple):
    """A verdict on a text.

    kind: `SAME_MOTION`, `RIGHT`, `WRONG` or `UNKNOWN`.
    reason: the first place that is wrong, or the statement that nothing here interprets.
    """

    kind: str
    reason: str = ""


def find_verdict(case: Case, text: str, original: str) -> Verdict:
    """The verdict on a text. original: the program of the unchanged code."""
    if FILE_MARK in text:
        return Verdict(UNKNOWN, "a program of several files")
    if is_same(read_events(case.post, text), read_events(case.post, original)):
        return Verdict(SAME_MOTION)
    fault = find_fault(case, text)
    if fault:
        return Verdict(WRONG, fault)
    words, original_words = _list_words(case, text), _list_words(case, original)
    different = sorted(words ^ original_words)
    if different:
        return Verdict(UNKNOWN, " | ".join(different)[:200])
    return Verdict(RIGHT)


def find_fault(case: Case, text: str) -> str:
    """The first place at which a program does not do what its job asks; empty without one."""
    try:
        check_job(case, read_steps(case.post, text))
    except (Wrong, Unreadable) as error:
        return str(error)
    return ""


def _list_words(case: Case, text: str) -> set[str]:
    """The statements and settings of a program that the judge does not interpret."""
    words: set[str] = set()
    for step in read_steps(case.post, text):
        if isinstance(step, Statement):
            words.add(step.words)
        elif isinstance(step, Motion):
            words.add(" ".join(step.setup))
    return words
