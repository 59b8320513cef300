"""A module imports its own folder and lower ones, without cycles (docs/architecture.md)."""

import ast
import tomllib
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from tests.support.syntax import list_nodes

ROOT = Path(__file__).parent.parent
#: The floors from low to high. Folders on one floor do not import each other.
FLOORS = [
    {"model"}, {"geometry"}, {"vision"}, {"read"}, {"lang"}, {"robots"}, {"collision"}, {"motion"},
    {"plan"}, {"order"}, {"lower"}, {"check"}, {"post"}, {"preview", "localize"}, {"pipeline"},
    {"batch"}, {"workbench"}, {"cli"}, {"__main__"},
]  # fmt: skip
FLOOR: dict[str, int] = {}
for _floor, _folders in enumerate(FLOORS):
    FLOOR |= dict.fromkeys(_folders, _floor)
#: Folders that a post may import: it is independent of planners, and of the language that runs its
#: text.
POST_MAY_IMPORT = ("camgen.model", "camgen.post", "camgen.geometry")


def format_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


_PATHS = [
    *sorted((ROOT / "camgen").rglob("*.py")),
    *sorted((ROOT / "postprocessors").rglob("*.py")),
]
FILES = {format_name(path): path for path in _PATHS}


@cache
def list_imports(name: str) -> set[str]:
    """The modules of the repository that a module imports, also within functions."""
    package = name if FILES[name].name == "__init__.py" else name.rpartition(".")[0]
    modules = set()
    for node in list_nodes(ast.parse(FILES[name].read_text())):
        if isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                above = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*above, base] if base else above)
            modules |= {
                f"{base}.{alias.name}" if f"{base}.{alias.name}" in FILES else base
                for alias in node.names
            }
        elif isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
    return (modules & FILES.keys()) - {name}


@pytest.mark.parametrize("name", [name for name in FILES if name.startswith("camgen.")])
def test_a_module_imports_lower_floors_only(name: str) -> None:
    folder = name.split(".")[1]
    others = {other.split(".")[1] for other in list_imports(name) if other != "camgen"} - {folder}
    assert not {other for other in others if FLOOR[other] >= FLOOR[folder]}


@pytest.mark.parametrize("name", [name for name in FILES if name.startswith("postprocessors.")])
def test_a_post_imports_few_folders(name: str) -> None:
    for other in list_imports(name):
        assert other.startswith((*POST_MAY_IMPORT, "postprocessors"))


def test_only_its_language_imports_a_strict_profile() -> None:
    for name in FILES:
        for other in list_imports(name):
            if ".strict" in other:
                assert other.split(".")[:3] == name.split(".")[:3]


def test_imports_have_no_cycle() -> None:
    # The package itself imports upwards. No module imports the package, since it has no floor.
    graph = {name: list_imports(name) - {"camgen"} for name in FILES if name != "camgen"}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


def test_each_folder_is_packaged() -> None:
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
    folders = [name for name, path in FILES.items() if path.name == "__init__.py"]
    assert sorted(listed) == sorted(
        name.replace("postprocessors", "camgen_posts") for name in folders
    )


def test_only_the_walk_imports_the_planner_of_edges() -> None:
    # camgen.plan counts as a module outside, so that it cannot re-export the planner.
    outside = set()
    for name in FILES:
        if name.startswith("camgen.plan."):
            continue
        if any(other.startswith("camgen.plan.edges") for other in list_imports(name)):
            outside.add(name)
    assert outside == {"camgen.pipeline", "camgen.pipeline.place"}
