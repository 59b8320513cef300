"""Rows of the tables of changed programs: one change of a text, and the finding that follows."""

import re
from typing import Literal, NamedTuple

import pytest

from camgen.model.errors import VerifyError
from tests.support.samples import Sample


class Change(NamedTuple):
    """One change of a program, and the finding that follows.

    kind: "fault" if the controller refuses the text, "remark" if it takes a text that no post
        writes, "deviation" if the text is another program, "taken" if it is the same program.
    program: name of the program in the table of its language.
    before: replaced part of the text, at its first place.
    after: replacement.
    words: words of the finding; of a deviation a part of its words.
    line: line of the finding minus the line of the change; None is not compared.
    times: number of findings with these words.
    others: whether findings with other words follow from the change, too.
    """

    kind: Literal["fault", "remark", "deviation", "taken"]
    program: str
    before: str
    after: str
    words: str = ""
    line: int | None = None
    times: int = 1
    others: bool = False


def fault(*values: str | int, **more: int) -> Change:
    """A change that the controller refuses, or that is certainly not intended."""
    return Change("fault", *values, **more)


def remark(*values: str | int, **more: int) -> Change:
    """A change that the controller takes, and that no program of the post has."""
    return Change("remark", *values, **more)


def deviation(*values: str) -> Change:
    """A change to a text that the read-back takes, and that is not the planned program."""
    return Change("deviation", *values)


def taken(*values: str) -> Change:
    """A change that means the same."""
    return Change("taken", *values)


def check_change(sample: Sample, change: Change) -> None:
    """Fails if the findings of the changed text are not those of the row.

    Raises AssertionError, VerifyError if the row states the same program, or pytest's Failed if it
    states another program.
    """
    text = sample.change(change.before, change.after)
    assert text != sample.text
    findings = sample.list_faults(text)
    if change.kind == "taken":
        sample.verify(text)
    elif change.kind == "deviation":
        assert findings == ()
        with pytest.raises(VerifyError, match=re.escape(change.words)):
            sample.verify(text)
    else:
        level = "refused" if change.kind == "fault" else "unusual"
        matches = [finding for finding in findings if finding.what == change.words]
        assert [match.level for match in matches] == [level] * change.times, findings
        assert (len(findings) > len(matches)) == change.others, findings
        if change.line is not None:
            changed_line = sample.text.count("\n", 0, sample.text.index(change.before)) + 1
            assert [match.line - changed_line for match in matches] == [change.line]
