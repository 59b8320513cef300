"""PacScript: the read-back and the language run a program of the post the same."""

from pathlib import Path

import pytest
from msgspec.structs import replace

from camgen.lang.pacscript.language import LANGUAGE
from camgen.lang.pacscript.strict import read
from camgen.lang.programs import Executed, RunRequest
from camgen.model.program import Instruction, MoveC, MoveJ, MoveL, Output
from tests.support.fast_paths import list_values
from tests.support.steps import count_calls

GOLDEN = sorted((Path(__file__).parents[2] / "fixtures").rglob("*.pcs"))


@pytest.mark.parametrize("path", GOLDEN, ids=lambda path: str(path.parent.name))
def test_a_golden_program_is_run_as_it_is_read_back(path: Path) -> None:
    text = path.read_text("ascii").replace("\r\n", "\n")
    options = {"signals": {}, "rated": 1000.0, "mps": "mm/s"}
    reading = read({path.name: text}, options)
    executed = LANGUAGE.run({path.name: text}, RunRequest())
    assert executed.stopped is None
    assert not executed.findings
    run = Executed(executed.body, executed.lines)
    assert list_values(rounded(run), True) == list_values(rounded(reading), True)


def rounded(reading: Executed) -> Executed:
    """The body of a reading, with outputs by their numbers and speeds of nine digits.

    The run computes speeds by way of a percentage.
    """
    body: list[Instruction] = []
    for item in reading.body:
        if isinstance(item, Output):
            number = item.signal.removeprefix("IO[").removesuffix("]")
            body.append(Output(number, item.value))
        elif isinstance(item, MoveJ | MoveL | MoveC):
            body.append(replace(item, speed=float(f"{item.speed:.9g}")))
        else:
            body.append(item)
    return Executed(body, reading.lines)


def test_a_procedure_that_calls_itself_twice_is_a_fault_without_a_long_run() -> None:
    def execute() -> None:
        reading = read({"part.pcs": "Sub Main\nCall Main\nCall Main\nEnd Sub\n"}, {})
        faults = [(fault.line, fault.what) for fault in reading.findings]
        assert faults == [(2, "procedures that call each other without end")]

    # Each call run twice would take a million calls at a depth of twenty.
    assert count_calls(execute) < 100_000
