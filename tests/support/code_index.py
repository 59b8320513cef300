"""The names that the Python files of the repository bind: modules, classes and their members.

The code is parsed, not imported, so a missing optional package changes nothing.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from tests.support.syntax import list_children, list_nodes

ROOT = Path(__file__).parents[2]
#: Folders of Python files, relative to the root of the repository.
TOPS = ("camgen", "postprocessors", "bench", "docs", "fixtures", "tests")
#: Names by which an installed package is imported, and its folder.
PACKAGES = {"camgen_posts": "postprocessors"}

_SNAKE_CASE = re.compile(r"[a-z0-9_]+_[a-z0-9_]+")

_DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


class Class(NamedTuple):
    """A class. members: names that its body and its methods bind; bases: names of its bases."""

    members: frozenset[str]
    bases: tuple[str, ...]


class Module(NamedTuple):
    """A Python file.

    names: the names that its statements bind outside of functions, imported names included.
    classes: its classes by name.
    imported: the file of each name that it imports from the repository.
    foreign: the names that it imports from elsewhere.
    hints: names of classes in the annotations of its parameters and variables, by their names.
    words: the words with an underscore in its code and in its strings, docstrings excluded.
    docstrings: line and text of each.
    """

    names: frozenset[str]
    classes: dict[str, Class]
    imported: dict[str, Path]
    foreign: set[str]
    hints: dict[str, set[str]]
    words: set[str]
    docstrings: list[tuple[int, str]]


@cache
def read_module(file: Path) -> Module:
    """The names of a Python file."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    module = Module(frozenset(_names_of(tree.body)), {}, {}, set(), {}, set(), [])
    quiet: set[ast.AST] = set()
    for node in list_nodes(tree):
        if isinstance(node, _DOCUMENTED) and ast.get_docstring(node, clean=False):
            quiet.add(node.body[0].value)
            module.docstrings.append((node.body[0].lineno, node.body[0].value.value))
        match node:
            case ast.ClassDef():
                bases = tuple(ast.unparse(base).split("[")[0] for base in node.bases)
                module.classes[node.name] = Class(frozenset(_members(node)), bases)
            case ast.Import() | ast.ImportFrom():
                files = dict(_imported_files(node))
                module.imported.update(files)
                module.foreign.update(set(_imported_names(node)) - files.keys())
            case ast.arg(arg=name, annotation=ast.expr() as hint):
                module.hints.setdefault(name, set()).update(_classes_of(hint))
            case ast.AnnAssign(target=ast.Name(id=name), annotation=hint):
                module.hints.setdefault(name, set()).update(_classes_of(hint))
        if node not in quiet:
            module.words.update(_words(node))
    return module


def _names_of(body: list[ast.stmt]) -> Iterator[str]:
    """The names that statements bind outside of functions."""
    stack: list[ast.AST] = [*body]
    while stack:
        node = stack.pop()
        match node:
            case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
                yield name
            case ast.ClassDef(name=name):
                yield name
            case ast.Import() | ast.ImportFrom():
                yield from _imported_names(node)
            case ast.Name(id=name, ctx=ast.Store()):
                yield name
            case ast.stmt() | ast.ExceptHandler() | ast.Tuple() | ast.List():
                stack += list_children(node)


def _members(node: ast.ClassDef) -> Iterator[str]:
    """The names that the body of a class binds, and the attributes that its methods set."""
    yield from _names_of(node.body)
    for inner in list_nodes(node):
        if isinstance(inner, ast.Attribute) and isinstance(inner.ctx, ast.Store):
            yield inner.attr


def _imported_names(node: ast.Import | ast.ImportFrom) -> Iterator[str]:
    for alias in node.names:
        yield alias.asname or alias.name.split(".")[0]


def _imported_files(node: ast.Import | ast.ImportFrom) -> Iterator[tuple[str, Path]]:
    if isinstance(node, ast.Import):
        return
    parts = (node.module or "").split(".")
    for alias in node.names:
        source = file_of([*parts, alias.name]) or file_of(parts)
        if source is not None:
            yield alias.asname or alias.name, source


def _classes_of(hint: ast.expr) -> Iterator[str]:
    for node in list_nodes(hint):
        if isinstance(node, ast.Name):
            yield node.id


def _words(node: ast.AST) -> list[str]:
    """The words with an underscore of one node."""
    match node:
        case ast.Constant(value=str(text)):
            return _SNAKE_CASE.findall(text)
        case ast.Name(id=name) | ast.Attribute(attr=name) | ast.arg(arg=name):
            return [name]
        case ast.FunctionDef(name=name) | ast.keyword(arg=str(name)):
            return [name]
        case ast.alias(name=name):
            return name.split(".")
    return []


def file_of(parts: list[str], base: Path = ROOT) -> Path | None:
    """The file of a module or of a package below a folder, None if there is no such module."""
    path = base.joinpath(PACKAGES.get(parts[0], parts[0]), *parts[1:])
    for file in (path.parent / f"{path.name}.py", path / "__init__.py"):
        if file.is_file():
            return file
    return None


@cache
def list_modules() -> dict[str, list[Path]]:
    """The Python files of each name. The name of a package is that of its folder."""
    modules: dict[str, list[Path]] = {}
    for top in TOPS:
        for file in sorted((ROOT / top).rglob("*.py")):
            name = file.parent.name if file.name == "__init__.py" else file.stem
            modules.setdefault(name, []).append(file)
    return modules


@cache
def list_classes() -> dict[str, list[Path]]:
    """The files that define a class of each name."""
    classes: dict[str, list[Path]] = {}
    for files in list_modules().values():
        for file in files:
            for name in read_module(file).classes:
                classes.setdefault(name, []).append(file)
    return classes


@cache
def list_words() -> frozenset[str]:
    """The words with an underscore outside of the tests, and the names of all files."""
    words = set(list_modules())
    for files in list_modules().values():
        for file in files:
            if not file.is_relative_to(ROOT / "tests"):
                words |= read_module(file).words
    return frozenset(words)


def has_member(module: Path, parts: list[str]) -> bool:
    """Whether a module has a member, a member of a class, or a module below it."""
    if not parts:
        return True
    if module.name == "__init__.py":
        below = file_of([parts[0]], module.parent)
        if below is not None and has_member(below, parts[1:]):
            return True
        if below is None and (module.parent / parts[0]).is_dir():
            return True
    if not module.is_file() or parts[0] not in read_module(module).names:
        return False
    return len(parts) == 1 or class_has(module, parts[0], parts[1])


def class_has(module: Path, name: str, member: str) -> bool:
    """Whether a class that a module defines or imports has a member, its own or of a base."""
    known = read_module(module)
    if name in known.imported and name not in known.classes:
        return class_has(known.imported[name], name, member)
    if name not in known.classes:
        return False
    if member in known.classes[name].members:
        return True
    return any(class_has(module, base, member) for base in known.classes[name].bases)


def any_class_has(name: str, member: str) -> bool:
    """Whether a class of this name has a member, wherever it is defined."""
    return any(class_has(module, name, member) for module in list_classes().get(name, ()))
