"""The bench of combinations: drawn values are allowed, and the verdict finds each kind of miss."""

import random
import signal
from collections.abc import Mapping
from typing import Any

import pytest

from bench.reliability.combinations import Ending, find_miss
from bench.reliability.drawn_jobs import Case, draw_case, draw_value, list_settings

CASE = Case(0, "gcode", ("build", "fixtures/parts/bracket.dxf", "--post", "gcode"))
GOOD = Ending(0, 0, (), "input     bracket.dxf\n", ("bracket.ngc",))


def refuse(*fields: str, code: int = 2, messages: str = "camgen: error: x\n") -> Ending:
    return Ending(code, 0, fields, messages, ())


@pytest.mark.parametrize(
    ("ending", "miss"),
    [
        (GOOD, ""),
        (GOOD._replace(left=()), "exit 0 without a program"),
        (GOOD._replace(messages="x.py:1: RuntimeWarning: overflow\n"), "warning of a library"),
        (GOOD._replace(code=1, messages="camgen: fault: KeyError: 1\n"), "exit 1"),
        (GOOD._replace(code=4), "exit 4"),
        (GOOD._replace(code=None, signal=int(signal.SIGSEGV)), "ended by signal 11"),
        (GOOD._replace(code=None, signal=int(signal.SIGXCPU)), "no end within"),
        (refuse("bracket.dxf", "is empty", "", "save it again", code=3), ""),
        (refuse("b.dxf", "x", "", code=3, messages="Traceback (most\n"), "traceback"),
        (refuse("b.dxf", "x", "", "", code=3, messages=2 * "camgen: error: x\n"), "2 lines"),
        (refuse("b.dxf", "x", code=3, messages=""), "0 lines of error"),
        (refuse(code=3)._replace(left=("a.ngc",)), "files left after a failure: a.ngc"),
        # Exit code 2: the setting or the input, and a remedy.
        (refuse("job", "has two values", "tool.angles", "give three"), ""),
        (refuse("job", "stepover must be 0.1 to 1, not 2", "[operation]", ""), ""),
        (refuse("[post] decimals", "is too much", "", "give less"), ""),
        (refuse("job", "operations are too many", "--post", "give rapid"), ""),
        (refuse("bracket.dxf", "is empty", "", "save it again"), ""),
        (refuse("job", "has two values", "tool.angles", ""), "exit 2 without a remedy"),
        (refuse("job", "tool changed", "", "change it"), "exit 2 without a setting"),
        (refuse("job", "list index out of range", "", "change it"), "exit 2 without a setting"),
        (refuse("other.dxf", "is empty", "", "save it again"), "exit 2 without a setting"),
        (refuse(), "exit 2 without an error of the build"),
    ],
)
def test_the_verdict_names_each_kind_of_miss(ending: Ending, miss: str) -> None:
    text = find_miss(CASE, ending)
    assert text.startswith(miss)
    assert bool(text) == bool(miss)


def test_cases_are_drawn_repeatably_and_differ() -> None:
    cases = [draw_case(0, number) for number in range(30)]
    assert cases == [draw_case(0, number) for number in range(30)]
    assert len({case.words for case in cases}) == 30
    assert draw_case(1, 0).words != cases[0].words
    assert {case.post for case in cases} == {"rapid", "pacscript", "vplus", "gcode", "grbl"}


def breaks_schema(schema: Mapping[str, Any], value: Any) -> bool:
    """Whether a number, a text, a switch or a list is not of the type, range or choice."""
    if "anyOf" in schema:
        return all(breaks_schema(choice, value) for choice in schema["anyOf"])
    if "enum" in schema:
        return value not in schema["enum"]
    if schema["type"] == "array":
        return not isinstance(value, list) or any(
            breaks_schema(schema["items"], item) for item in value
        )
    kinds = {"string": str, "boolean": bool, "object": dict, "integer": int, "number": (int, float)}
    if not isinstance(value, kinds[schema["type"]]):
        return True
    return isinstance(value, (int, float)) and (
        value < schema.get("minimum", value)
        or value > schema.get("maximum", value)
        or value <= schema.get("exclusiveMinimum", value - 1)
        or value >= schema.get("exclusiveMaximum", value + 1)
    )


@pytest.mark.parametrize("post", ["rapid", "grbl"])
def test_values_are_those_that_the_schema_allows(post: str) -> None:
    chance = random.Random(7)
    settings = list_settings(post)
    assert {setting.table for setting in settings} >= {"operation", "cell", "post", "limits"}
    for setting in settings:
        for _ in range(20):
            value = draw_value(setting, chance)
            assert not breaks_schema(setting.schema, value), (setting.name, value)
