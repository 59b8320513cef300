"""A function takes six parameters or fewer; the exceptions are listed here with their reason."""

import ast
from collections.abc import Iterator
from pathlib import Path

from tests.support.syntax import list_nodes
from tests.support.texture import MOST_PARAMETERS, ROOT

#: File, name and reason of each function that takes more.
EXCEPTIONS = {
    ("camgen/pipeline/__init__.py", "build"): "the public call, whose keywords users write",
}


def list_long_signatures(source: str) -> Iterator[str]:
    """Names of the functions with more parameters; `*args` and `**kwargs` count one each."""
    for node in list_nodes(ast.parse(source)):
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        arguments = node.args
        names = [argument.arg for argument in (*arguments.posonlyargs, *arguments.args)]
        names += [argument.arg for argument in arguments.kwonlyargs]
        names += [extra.arg for extra in (arguments.vararg, arguments.kwarg) if extra]
        if len([name for name in names if name not in ("self", "cls")]) > MOST_PARAMETERS:
            yield node.name


def list_files() -> list[Path]:
    return [*(ROOT / "camgen").rglob("*.py"), *(ROOT / "postprocessors").rglob("*.py")]


def test_only_the_exceptions_take_more_than_six_parameters() -> None:
    longer = []
    for file in list_files():
        name = file.relative_to(ROOT).as_posix()
        source = file.read_text(encoding="utf-8")
        longer += [(name, function) for function in list_long_signatures(source)]
    assert sorted(longer) == sorted(EXCEPTIONS)


def test_each_kind_of_parameter_counts() -> None:
    source = """
def seven(a, /, b, c, *rest, d, e, **more): ...
class Value:
    def six(self, a, b, c, d, e, f): ...
    def longer(self, a, b, c, d, e, f, g): ...
"""
    assert list(list_long_signatures(source)) == ["seven", "longer"]
