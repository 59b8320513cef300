"""docs/make/reading.py: the drawn modules, and the table of the answers about them."""

from __future__ import annotations

import subprocess
from collections import Counter
from itertools import product

import pytest

from docs.make.reading import (
    BASE,
    DRAWN,
    FOLDERS,
    ROOT,
    TIMES,
    VERDICTS,
    Answer,
    draw_modules,
    format_results,
    read_answers,
    read_questions,
)


def _has_base() -> bool:
    command = ["git", "-C", str(ROOT), "cat-file", "-e", f"{BASE}^{{commit}}"]
    return subprocess.run(command, check=False, capture_output=True).returncode == 0


def _read_table(table: str) -> dict[str, list[int]]:
    """The numbers of each row by its name."""
    rows = {}
    for line in table.splitlines()[2:]:
        name, *numbers = line.strip("| ").split(" | ")
        rows[name] = [int(number) for number in numbers]
    return rows


@pytest.mark.skipif(not _has_base(), reason="a source archive has no history to draw from")
def test_three_modules_of_each_folder_are_drawn() -> None:
    drawn = draw_modules()
    assert Counter(path.split("/")[1] for path in drawn) == dict.fromkeys(FOLDERS, DRAWN)
    assert len(set(drawn)) == len(drawn)
    assert drawn == draw_modules()
    assert [module.path for module in read_questions()] == drawn


def test_each_module_has_ten_questions_with_an_answer() -> None:
    modules = read_questions()
    assert len(modules) == DRAWN * len(FOLDERS) == 24
    for module in modules:
        assert len(module.questions) == 10, module.path
        assert all(question.text and question.answer for question in module.questions), module.path


def test_the_table_counts_each_verdict_once() -> None:
    answers = [
        Answer("a.py", 1, "before", "mm", "wrong"),
        Answer("a.py", 1, "after", "mm", "right"),
        Answer("b.py", 1, "after", "unknown", "partly"),
        Answer("b.py", 2, "after", "rad", "right"),
    ]
    assert _read_table(format_results(["a.py", "b.py"], answers)) == {
        "a.py": [0, 0, 1, 1, 0, 0],
        "b.py": [0, 0, 0, 1, 1, 0],
        "all": [0, 0, 1, 2, 1, 0],
    }


def test_the_table_of_the_data_has_all_its_verdicts() -> None:
    answers = read_answers()
    sums = _read_table(format_results([module.path for module in read_questions()], answers))["all"]
    counts = Counter((row.when, row.verdict) for row in answers)
    assert sums == [counts[when, verdict] for when, verdict in product(TIMES, VERDICTS)]


def test_each_question_has_at_most_one_answer_before_and_one_after() -> None:
    answers = read_answers()
    keys = [(row.module, row.question, row.when) for row in answers]
    assert len(set(keys)) == len(keys)
    assert {row.when for row in answers} <= set(TIMES)
    assert {row.verdict for row in answers} <= set(VERDICTS)
    assert all(1 <= row.question <= 10 and row.answer.strip() for row in answers)
