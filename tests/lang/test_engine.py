"""The engine has the only log, budget of steps and watch of loops: no language has its own."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from tests.support.syntax import list_nodes

ENGINE = Path(__file__).parents[2] / "camgen" / "lang"
LANGUAGES = ("gcode", "pacscript", "rapid", "vplus")
#: Modules of the engine. What they define, no language defines.
MODULES = ("log", "run")
#: What only the log makes.
ENTRIES = {"Finding", "Assumption"}


def list_definitions(path: Path) -> set[str]:
    """The names of classes of a module."""
    nodes = list_nodes(ast.parse(path.read_text(encoding="utf-8")))
    return {node.name for node in nodes if isinstance(node, ast.ClassDef)}


def list_calls(path: Path) -> set[str]:
    """The plain names that a module calls."""
    nodes = list_nodes(ast.parse(path.read_text(encoding="utf-8")))
    calls = [node.func for node in nodes if isinstance(node, ast.Call)]
    return {call.id for call in calls if isinstance(call, ast.Name)}


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_language_defines_nothing_of_the_engine(language: str) -> None:
    engine = set().union(*(list_definitions(ENGINE / f"{name}.py") for name in MODULES))
    assert {"Log", "Budget", "LoopRounds", "Ended", "Stopped"} <= engine
    for path in sorted((ENGINE / language).glob("*.py")):
        assert not list_definitions(path) & engine, path
        assert not list_calls(path) & ENTRIES, path
