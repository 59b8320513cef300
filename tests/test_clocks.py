"""Tests do not read clocks: on a busy machine a duration may be longer than any limit.

A test counts calls instead (`tests/support/steps.py`). Only an answer of another process has a
deadline, `LONG` of `tests/support/waiting.py`.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.steps import assert_linear

TESTS = Path(__file__).parent
FILES = sorted(TESTS.rglob("*.py"))
CLOCKS = {"perf_counter", "process_time", "monotonic", "thread_time"}
CLOCKS |= {f"{name}_ns" for name in CLOCKS}


def list_clock_comparisons(source: str) -> list[int]:
    """Lines of comparisons in which a clock is read, or a variable that was set by one.

    A variable that is set by a clock and `LONG` is a deadline; comparisons with it do not count.
    """
    if not any(clock in source for clock in CLOCKS):
        return []
    tree = ast.parse(source)
    durations, deadlines = set(), set()
    for names, value in _assignments(tree):
        if not _reads(value, durations):
            continue
        if "LONG" in _names(value):
            deadlines |= names
        else:
            durations |= names
    lines = []
    for node in ast.walk(tree):
        if not isinstance(node, ast.Compare):
            continue
        if _reads(node, durations) and not deadlines & _names(node):
            lines.append(node.lineno)
    return sorted(lines)


def _assignments(tree: ast.Module) -> Iterator[tuple[set[str], ast.expr]]:
    """The names that are set and the value, for each assignment; pairs of a tuple one by one."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign):
            target, value = node.targets[0], node.value
        elif isinstance(node, ast.NamedExpr):
            target, value = node.target, node.value
        else:
            continue
        if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
            for part, item in zip(target.elts, value.elts, strict=False):
                yield _names(part), item
        else:
            yield _names(target), value


def _reads(node: ast.AST, durations: set[str]) -> bool:
    return bool((CLOCKS | durations) & _names(node))


def _names(node: ast.AST) -> set[str]:
    names = set()
    for part in ast.walk(node):
        if isinstance(part, ast.Name):
            names.add(part.id)
        elif isinstance(part, ast.Attribute):
            names.add(part.attr)
    return names


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.relative_to(TESTS).as_posix())
def test_no_comparison_reads_a_clock(file: Path) -> None:
    assert list_clock_comparisons(file.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    "source",
    [
        "assert time.perf_counter() - begin < 10",
        "begin = process_time()\nassert work() - begin < 5",
        "spent = time.monotonic() - begin\nassert spent < limit",
        "while (now := monotonic_ns()) < end:\n    pass",
        "end = time.monotonic() + 60\nassert time.monotonic() < end",
    ],
)
def test_a_clock_is_found(source: str) -> None:
    assert list_clock_comparisons(source) != []


def test_a_deadline_of_another_process_is_allowed() -> None:
    source = "end = time.monotonic() + LONG\nassert time.monotonic() < end"
    assert list_clock_comparisons(source) == []


def test_work_that_grows_with_the_square_is_found() -> None:
    def compare_all(count: int) -> None:
        for k in range(count):
            for other in range(count):
                abs(k - other)

    assert_linear(lambda count: [abs(k) for k in range(count)], 100)
    with pytest.raises(AssertionError, match="not linear"):
        assert_linear(compare_all, 100)
