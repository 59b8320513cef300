"""The read-back and the interpreter of the language say the same of the programs of the post."""

from pathlib import Path

import pytest
from camgen_posts.readback.pacscript import read

from camgen.model.program import Output
from camgen.post import Reading
from camgen.read.pacscript.language import LANGUAGE
from camgen.read.programs import Ask
from tests.support.pacscript_ways import said
from tests.support.steps import count_calls

GOLDEN = sorted((Path(__file__).parents[2] / "fixtures").rglob("*.pcs"))


@pytest.mark.parametrize("path", GOLDEN, ids=lambda path: str(path.parent.name))
def test_goldens_are_run_as_they_are_read_back(path: Path) -> None:
    text = path.read_text("ascii").replace("\r\n", "\n")
    options = {"signals": {}, "rated": 1000.0, "mps": "mm/s"}
    reading = read({path.name: text}, options)
    found = LANGUAGE.run({path.name: text}, Ask())
    signals = [
        Output(item.signal.removeprefix("IO[").removesuffix("]"), item.value)
        if isinstance(item, Output)
        else item
        for item in reading.body
    ]
    assert found.stopped is None
    assert not found.findings
    assert rounded(found.body, found.lines) == rounded(signals, reading.lines)


def rounded(body: object, lines: tuple[int, ...]) -> list[str]:
    """A body as text, speeds to nine digits: the interpreter has them by way of a percentage."""
    rows = said(Reading(body, lines, ()))[0]  # type: ignore[arg-type]
    assert isinstance(rows, list)
    return [
        " ".join(_round(part) for part in row) if isinstance(row, tuple) else row for row in rows
    ]


def _round(part: object) -> str:
    if isinstance(part, str) and part.startswith("("):
        return " ".join(f"{number:.9g}" for number in _flat(eval(part)))
    return str(part)


def _flat(value: object) -> list[float]:
    return (
        [one for part in value for one in _flat(part)]
        if isinstance(value, tuple)
        else [float(value)]
    )  # type: ignore[arg-type]


def test_procedures_that_call_each_other_twice_end_at_once() -> None:
    def execute() -> None:
        reading = read({"part.pcs": "Sub Main\nCall Main\nCall Main\nEnd Sub\n"}, {})
        faults = [(fault.line, fault.what) for fault in reading.faults]
        assert faults == [(2, "procedures that call each other without end")]

    # Each call run twice would take a million calls at a depth of twenty.
    assert count_calls(execute) < 100_000
