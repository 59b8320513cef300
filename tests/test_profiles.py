"""Examples of a property: few in CI, many at night by the command in docs/architecture.md."""

import ast
import re
from pathlib import Path

from hypothesis import settings

from tests.conftest import FEW, MANY

ROOT = Path(__file__).parents[1]


def test_the_documented_command_tries_many_examples() -> None:
    text = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")
    (name,) = re.findall(r"pytest --hypothesis-profile=(\w+)", text)
    assert settings.get_profile(name).max_examples == MANY == 500
    assert f"tries {FEW} examples" in text
    assert f"tries {MANY} new ones" in text


def test_ci_tries_the_same_few_examples_each_time() -> None:
    ci = settings.get_profile("ci")
    assert (ci.max_examples, ci.derandomize) == (FEW, True)


def test_no_property_asks_for_more_examples_by_itself() -> None:
    """A number above that of CI would hold at night too, where it would be too few."""
    numbers: list[tuple[str, int]] = []
    for file in sorted((ROOT / "tests").rglob("test_*.py")):
        source = file.read_text(encoding="utf-8")
        if "max_examples" not in source:
            continue
        for node in ast.walk(ast.parse(source)):
            match node:
                case ast.keyword(arg="max_examples", value=ast.Constant(value=int(examples))):
                    numbers.append((f"{file.name}:{node.lineno}", examples))
    assert numbers, "no test has its own number"
    assert [place for place, examples in numbers if examples >= FEW] == []
