"""The counts of `docs.make.style` for a text that was counted by hand."""

from pathlib import Path

import pytest

from docs.make import style

TEXT = '''"""A module."""

import os


class _Row:
    """A row that one function uses."""


def first(a, b, c, d, e, f, g, *rest):
    # A comment.
    name = a or "none"
    is_known = a == 1 and not b
    return _Row(), [x for x in (lambda: rest)()], name if is_known else None


def second():
    """Text."""
    return map(str, {y for y in ()}) if (0 or 1) else os
'''


def test_each_count_is_that_of_a_text_counted_by_hand(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "module.py"
    file.write_text(TEXT + f"# {'x' * 99}\n", encoding="utf-8")
    counts = style.count(file)
    # Lines of code: import, class, def, three in `first`, def, one in `second`.
    assert counts["code"] == 8
    assert (counts["line"], counts["wide"]) == (20, 1)
    # Three docstrings, the import, the class, two functions, and their four statements.
    assert counts["statement"] == 11
    assert counts["comprehension"] == 2
    assert counts["conditional"] == 2
    assert counts["functional"] == 2
    # `a or "none"` is a value, `a == 1 and not b` and the test of a conditional are conditions.
    assert counts["value"] == 1
    assert (counts["parameters"], counts["star"], counts["lone class"]) == (1, 1, 1)
    assert style.main([str(tmp_path)]) == 0
    row = capsys.readouterr().out.splitlines()[-1]
    assert row == f"| {tmp_path} | 11 | 5.0 | 250 | 250 | 250 | 125 | 1 | 1 | 1 |"
