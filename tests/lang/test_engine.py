"""Only the engine has a log, a budget, code and flow: no language defines its own."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import pytest

from camgen.lang.flow import Flow
from tests.support.syntax import list_nodes

ENGINE = Path(__file__).parents[2] / "camgen" / "lang"
LANGUAGES = ("gcode", "pacscript", "rapid", "vplus")
#: Modules of the engine, whose classes no language defines.
MODULES = ("log", "run")
FLOW_MODULES = ("code", "flow", "values")
#: Entries of a log, which only the log makes.
ENTRIES = {"Finding", "Assumption"}
#: The classes of `run` that a language may import. `Flow` watches the loops.
ENDS = {"Budget", "Ended", "LimitReached", "Stopped"}
#: Methods for the depth of calls, the choice of branches and the watch of loops.
METHODS = {"check_depth", "_choose_branch", "_choose_case", "_repeat", "_is_repeated"}


@cache
def parse(path: Path) -> list[ast.AST]:
    """The nodes of a module."""
    return list_nodes(ast.parse(path.read_text(encoding="utf-8")))


def list_definitions(path: Path, *kinds: type[ast.ClassDef | ast.FunctionDef]) -> set[str]:
    """The names of classes or functions of a module."""
    return {node.name for node in parse(path) if isinstance(node, kinds)}


def list_calls(path: Path) -> set[str]:
    """The plain names that a module calls."""
    calls = [node.func for node in parse(path) if isinstance(node, ast.Call)]
    return {call.id for call in calls if isinstance(call, ast.Name)}


def list_imports(path: Path, module: str) -> set[str]:
    """The names that a module imports from another one."""
    names: set[str] = set()
    for node in parse(path):
        if isinstance(node, ast.ImportFrom) and node.module == module:
            names |= {alias.name for alias in node.names}
    return names


def list_engine(*modules: str) -> set[str]:
    """The names of the classes of modules of the engine."""
    names: set[str] = set()
    for module in modules:
        names |= list_definitions(ENGINE / f"{module}.py", ast.ClassDef)
    return names


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_language_defines_nothing_of_the_engine(language: str) -> None:
    engine = list_engine(*MODULES)
    assert {"Log", "Budget", "LoopRounds", "Ended", "Stopped"} <= engine
    for path in sorted((ENGINE / language).glob("*.py")):
        assert not list_definitions(path, ast.ClassDef) & engine, path
        assert not list_calls(path) & ENTRIES, path


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_language_has_exactly_one_flow_and_it_is_that_of_the_engine(language: str) -> None:
    engine = list_engine(*MODULES, *FLOW_MODULES)
    assert {"Step", "Compiler", "Flow", "CallFrame", "Counter", "Raised", "Unknown"} <= engine
    assert set(vars(Flow)) >= METHODS
    flows = 0
    for path in sorted((ENGINE / language).glob("*.py")):
        assert not list_definitions(path, ast.ClassDef) & engine, path
        assert not list_definitions(path, ast.FunctionDef) & METHODS, path
        assert list_imports(path, "camgen.lang.run") <= ENDS, path
        assert not list_calls(path) & {"LoopRounds", "CallFrame"}, path
        flows += "Flow" in list_calls(path)
    assert flows == 1
