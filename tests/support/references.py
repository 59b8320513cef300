"""Names in docstrings, comments and pages that point to code, and whether they lead to anything.

    python -m tests.support.references         each reference that leads nowhere

A reference is one of these:

- a path or a dotted name in backticks, such as `check/proof`, `verify.COMPARED`, `Part.contours`;
- an identifier in backticks with an underscore, such as `read_module`, in a Python file;
- a word in running text that ends in `.py`, or that begins with a top folder and a dot or slash.

A file of a user (`part.dxf`), a word in capitals (`WAIT.EVENT`) and a name of a package from
elsewhere (`msgspec.Struct`) are not references. A page also shows the languages of controllers and
the values of an example. A dotted name of a page is therefore a reference only if it begins with a
top folder or a class of the repository, or if its second part begins with a capital.
"""

from __future__ import annotations

import ast
import dataclasses
import re
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from camgen.model.job_tables import ROWS, list_keys, list_tables
from camgen.post.plugins import find_post
from docs.make.pages import POSTS
from tests.support.code_index import (
    PACKAGES,
    ROOT,
    TOPS,
    Module,
    any_class_has,
    file_of,
    has_member,
    list_classes,
    list_modules,
    list_words,
    read_module,
)
from tests.support.syntax import list_comments, list_nodes

#: Endings of files that are not Python files. Without a folder, such a name is a file of a user.
FILE_ENDINGS = frozenset(
    (
        "avi", "c", "csv", "dat", "dxf", "h", "html", "ini", "ir", "js", "json", "jsonl", "md",
        "mod", "ngc", "pcs", "ply", "png", "src", "stl", "svg", "toml", "tsv", "txt", "typed",
        "urdf", "v2", "yaml", "yml",
    )
)  # fmt: skip

_QUOTED = re.compile(r"(`{1,2})([^`\n]+)\1")
_NAME = re.compile(r"([A-Za-z_][\w-]*(?:[./][A-Za-z_][\w-]*)+)/?(?:\(\))?")
_IDENTIFIER = re.compile(r"([a-z][a-z0-9]*_[a-z0-9_]+)(?:\(\))?")
_PLAIN = re.compile(rf"(?<![\w./@*-])(?:(?:{'|'.join(TOPS)})[./][\w./-]*\w|\w[\w/]*\.py\b)")


class Reference(NamedTuple):
    """A name that a text points to. file: the file of the text."""

    file: Path
    line: int
    name: str

    def __str__(self) -> str:
        return f"{self.file.relative_to(ROOT).as_posix()}:{self.line}: {self.name}"


# The references


def list_files() -> list[Path]:
    """The Python files and pages that are examined. The changelog describes the past."""
    files = [*ROOT.glob("*.md")]
    for top in TOPS:
        files += (ROOT / top).rglob("*.py")
        files += (ROOT / top).rglob("*.md")
    return sorted(file for file in files if file.name != "changelog.md")


def list_references(file: Path) -> Iterator[Reference]:
    """The references of a file."""
    is_wanted = _is_reference_of_page if file.suffix == ".md" else _is_reference
    for first, text in _list_texts(file):
        for start, name in _find_names(text):
            if is_wanted(name):
                yield Reference(file, first + text.count("\n", 0, start), name)


def _list_texts(file: Path) -> Iterator[tuple[int, str]]:
    """Line and text of each docstring and comment, or of a page without code and links."""
    source = file.read_text(encoding="utf-8")
    if file.suffix == ".md":
        text = re.sub(r"^```.*?^```|^ {4}.*?$", _blank, source, flags=re.S | re.M)
        yield 1, re.sub(r"\]\([^()\s]+\)|\w+://\S+", _blank, text)
        return
    yield from read_module(file).docstrings
    if re.search(r"#.*(?:`|\.py)", source):
        yield from list_comments(source, list_nodes(ast.parse(source)))


def _blank(match: re.Match[str]) -> str:
    return re.sub(r"[^\n]", " ", match[0])


def _find_names(text: str) -> Iterator[tuple[int, str]]:
    """Offset and name of each word that may be a reference."""
    for quoted in _QUOTED.finditer(text):
        name = _NAME.fullmatch(quoted[2]) or _IDENTIFIER.fullmatch(quoted[2])
        if name:
            yield quoted.start(), name[1]
    for word in _PLAIN.finditer(_QUOTED.sub(_blank, text)):
        yield word.start(), word[0]


def _is_reference(name: str) -> bool:
    first, *rest = re.split(r"[./]", name)
    if name == name.upper() or first in sys.stdlib_module_names:
        return False
    if rest and rest[-1] in FILE_ENDINGS:
        return first in TOPS
    return True


def _is_reference_of_page(name: str) -> bool:
    first, *rest = re.split(r"[./]", name)
    if not rest or not _is_reference(name):
        return False
    if "/" in name or name.endswith(".py"):
        return True
    return first in TOPS or first in list_classes() or rest[0][0].isupper()


# Where they lead


@cache
def list_settings() -> frozenset[str]:
    """The settings of a job, the options of all posts, and the groups of entry points."""
    names: set[str] = set()
    for table in (*list_tables(), *ROWS):
        if table != "post":
            names |= {
                f"{table}.{key}" for key in list_keys(f"{table}.0" if table in ROWS else table)
            }
    for post in POSTS:
        names |= {f"post.{option.name}" for option in dataclasses.fields(find_post(post))}
    return frozenset(names | _project()["entry-points"].keys())


@cache
def list_packages() -> frozenset[str]:
    """The packages that camgen depends on."""
    return frozenset(re.match(r"[\w-]+", text)[0] for text in _project()["dependencies"])


def _project() -> dict[str, dict[str, object]]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def leads_somewhere(reference: Reference) -> bool:
    """Whether a reference is a path, a module, a member, a setting, or a word of the code."""
    file, name = reference.file, reference.name
    if "/" in name or name.endswith(".py"):
        return _is_path(file, name)
    first, *rest = name.split(".")
    if not rest:
        return name in list_words() or name in read_module(file).words
    if name in list_settings() or first in list_packages() or any_class_has(first, rest[0]):
        return True
    if any(has_member(module, rest) for module in _modules_named(first)):
        return True
    return file.suffix == ".py" and _is_known(read_module(file), first, rest[0])


def _is_known(module: Module, name: str, member: str) -> bool:
    """Whether a module imports a name, or annotates it, so that it may have the member."""
    if name in module.foreign:
        return True
    if name in module.imported and has_member(module.imported[name], [member]):
        return True
    return any(any_class_has(hint, member) for hint in module.hints.get(name, ()))


def _is_path(file: Path, name: str) -> bool:
    """Whether a folder above a file, or camgen, has a file, a folder, a module or its member.

    A page names files without their folder after the first. A word in capitals stands for any name.
    """
    if file.suffix == ".md" and "/" not in name and name.removesuffix(".py") in list_modules():
        return True
    pattern = "/".join("*" if part.isupper() else part for part in name.split("/"))
    if pattern != name:
        return any(True for _ in ROOT.glob(pattern))
    for base in (*file.parents, ROOT / "camgen"):
        if not base.is_relative_to(ROOT):
            continue
        path = base / name
        if path.exists():
            return True
        first, *rest = path.name.split(".")
        module = file_of([first], path.parent)
        if module is not None and has_member(module, rest):
            return True
    return False


def _modules_named(name: str) -> list[Path]:
    """The files that the first part of a dotted name may stand for."""
    if PACKAGES.get(name, name) in TOPS:
        return [ROOT / PACKAGES.get(name, name) / "__init__.py"]
    return list_modules().get(name, [])


def list_all() -> list[Reference]:
    """The references of all files."""
    references: list[Reference] = []
    for file in list_files():
        references += list_references(file)
    return references


def main() -> None:
    """Runs the command that the docstring of this module describes."""
    for reference in list_all():
        if not leads_somewhere(reference):
            print(reference)


if __name__ == "__main__":
    main()
