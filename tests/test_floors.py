"""A module imports its own folder and lower ones, and nothing goes round in a circle (docs/architecture.md)."""

import ast
import tomllib
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from tests.support.syntax import list_nodes

ROOT = Path(__file__).parent.parent
#: Low to high; folders on one line do not import each other.
FLOORS = [
    {"model"}, {"geometry"}, {"vision"}, {"read"}, {"lang"}, {"robots"}, {"collision"}, {"motion"},
    {"plan"}, {"order"}, {"lower"}, {"check"}, {"post"}, {"preview", "localize"}, {"pipeline"}, {"batch"},
    {"workbench"}, {"cli"}, {"__main__"},
]  # fmt: skip
FLOOR = {folder: k for k, folders in enumerate(FLOORS) for folder in folders}
#: What a post may import: it is independent of planners, and of the language that judges its text.
POST_MAY_IMPORT = ("camgen.model", "camgen.post", "camgen.geometry")


def name_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


FILES = {
    name_of(path): path
    for top in ("camgen", "postprocessors")
    for path in sorted((ROOT / top).rglob("*.py"))
}


@cache
def imported(name: str) -> set[str]:
    """The modules of the house that ``name`` imports, those within functions included."""
    package = name if FILES[name].name == "__init__.py" else name.rpartition(".")[0]
    found = set()
    for node in list_nodes(ast.parse(FILES[name].read_text())):
        if isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                above = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*above, base] if base else above)
            found |= {
                f"{base}.{alias.name}" if f"{base}.{alias.name}" in FILES else base
                for alias in node.names
            }
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return (found & FILES.keys()) - {name}


@pytest.mark.parametrize("name", [name for name in FILES if name.startswith("camgen.")])
def test_imports_go_down(name: str) -> None:
    folder = name.split(".")[1]
    others = {other.split(".")[1] for other in imported(name) if other != "camgen"} - {folder}
    assert not {other for other in others if FLOOR[other] >= FLOOR[folder]}


@pytest.mark.parametrize("name", [name for name in FILES if name.startswith("postprocessors.")])
def test_a_post_knows_little(name: str) -> None:
    for other in imported(name):
        assert other.startswith((*POST_MAY_IMPORT, "postprocessors"))


def test_a_strict_profile_is_reached_through_its_language_alone() -> None:
    for name in FILES:
        for other in imported(name):
            if ".strict" in other:
                assert other.split(".")[:3] == name.split(".")[:3]


def test_there_is_no_circle() -> None:
    # The door opens upwards; nothing below it goes through it (test_imports_go_down would say so: it has no floor).
    graph = {name: imported(name) - {"camgen"} for name in FILES if name != "camgen"}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


def test_every_folder_is_packed() -> None:
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
    folders = [name for name, path in FILES.items() if path.name == "__init__.py"]
    assert sorted(listed) == sorted(
        name.replace("postprocessors", "camgen_posts") for name in folders
    )


def test_only_the_walk_imports_the_planner_of_edges() -> None:
    # camgen.plan itself is among the modules outside, so that it re-exports nothing of the planner.
    outside = set()
    for name in FILES:
        if name.startswith("camgen.plan."):
            continue
        if any(other.startswith("camgen.plan.edges") for other in imported(name)):
            outside.add(name)
    assert outside == {"camgen.pipeline", "camgen.pipeline.place"}
