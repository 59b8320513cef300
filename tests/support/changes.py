"""Rows of the tables of changed programs: one change of a text, and the finding that follows."""

from typing import NamedTuple

from camgen.post import Fault, Remark
from tests.support.samples import Sample


class Change(NamedTuple):
    """One change of a program, and the finding of the read-back.

    program: name of the program in the table of its language.
    before: replaced part of the text, at its first place.
    after: replacement.
    words: words of the finding; empty if nothing may be found.
    kind: Fault if the controller refuses the text, Remark if it takes a text that no post writes.
    line: line of the finding minus the line of the change; None is not compared.
    times: number of findings with these words.
    others: whether findings with other words follow from the change, too.
    """

    program: str
    before: str
    after: str
    words: str
    kind: type[Fault]
    line: int | None = None
    times: int = 1
    others: bool = False


def fault(
    program: str, before: str, after: str, words: str, line: int | None = None, **more: int
) -> Change:
    """A change that the controller refuses, or that is certainly not intended."""
    return Change(program, before, after, words, Fault, line, **more)


def remark(
    program: str, before: str, after: str, words: str, line: int | None = None, **more: int
) -> Change:
    """A change that the controller takes, and that no program of the post has."""
    return Change(program, before, after, words, Remark, line, **more)


def taken(program: str, before: str, after: str) -> Change:
    """A change that means the same, so that nothing is found."""
    return Change(program, before, after, "", Remark, times=0)


def check_change(sample: Sample, change: Change) -> None:
    """Raises AssertionError if the findings of the changed text are not those of the row."""
    changed_text = sample.change(change.before, change.after)
    assert changed_text != sample.text
    findings = sample.list_faults(changed_text)
    matches = [finding for finding in findings if finding.what == change.words]
    assert [type(match) for match in matches] == [change.kind] * change.times, findings
    assert (len(findings) > len(matches)) == change.others, findings
    if change.line is not None:
        changed_line = sample.text.count("\n", 0, sample.text.index(change.before)) + 1
        assert [match.line - changed_line for match in matches] == [change.line]
