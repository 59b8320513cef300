"""docs/make/reading.py: the drawn texts, and the table of the answers about them."""

from __future__ import annotations

import subprocess
from collections import Counter
from itertools import product

import pytest

from docs.make.reading import DATA, DRAWS, ROOT, TIMES, VERDICTS, Answer, Draw, format_results

#: The draws with a file of questions.
WITH_QUESTIONS = tuple(draw for draw in DRAWS if (DATA / f"{draw.name}.toml").exists())


def _has_bases() -> bool:
    names = [f"{draw.base}^{{commit}}" for draw in DRAWS]
    commands = [["git", "-C", str(ROOT), "cat-file", "-e", name] for name in names]
    runs = [subprocess.run(command, check=False, capture_output=True) for command in commands]
    return all(run.returncode == 0 for run in runs)


def _read_table(table: str) -> dict[str, list[int]]:
    """The numbers of each row by its name."""
    rows = {}
    for line in table.splitlines()[2:]:
        name, *numbers = line.strip("| ").split(" | ")
        rows[name] = [int(number) for number in numbers]
    return rows


@pytest.mark.skipif(not _has_bases(), reason="a source archive has no history to draw from")
@pytest.mark.parametrize("draw", DRAWS, ids=lambda draw: draw.name)
def test_the_number_of_texts_is_drawn_from_each_folder(draw: Draw) -> None:
    drawn = draw.list_texts()
    assert len(set(drawn)) == len(drawn) == draw.number * len(draw.folders)
    for folder in draw.folders:
        assert sum(path.startswith(f"{folder}/") for path in drawn) == draw.number
    assert drawn == draw.list_texts()
    if draw in WITH_QUESTIONS:
        assert [module.path for module in draw.read_questions()] == drawn


def test_modules_and_pages_are_drawn_in_the_numbers_of_the_page() -> None:
    assert [draw.number * len(draw.folders) for draw in DRAWS] == [24, 24, 12]


@pytest.mark.parametrize("draw", WITH_QUESTIONS, ids=lambda draw: draw.name)
def test_each_text_has_ten_questions_with_an_answer(draw: Draw) -> None:
    for module in draw.read_questions():
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


@pytest.mark.parametrize("draw", WITH_QUESTIONS, ids=lambda draw: draw.name)
def test_the_table_of_the_data_has_all_its_verdicts(draw: Draw) -> None:
    answers = draw.read_answers()
    table = format_results([module.path for module in draw.read_questions()], answers)
    sums = _read_table(table)["all"]
    counts = Counter((row.when, row.verdict) for row in answers)
    assert sums == [counts[when, verdict] for when, verdict in product(TIMES, VERDICTS)]


@pytest.mark.parametrize("draw", WITH_QUESTIONS, ids=lambda draw: draw.name)
def test_each_question_has_at_most_one_answer_before_and_one_after(draw: Draw) -> None:
    answers = draw.read_answers()
    keys = [(row.module, row.question, row.when) for row in answers]
    assert len(set(keys)) == len(keys)
    assert {row.when for row in answers} <= set(TIMES)
    assert {row.verdict for row in answers} <= set(VERDICTS)
    assert all(1 <= row.question <= 10 and row.answer.strip() for row in answers)
