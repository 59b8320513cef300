"""Counts wide lines, nested expressions, long signatures and vague prose of files.

    python -m tests.support.texture            each place of the repository
    python -m tests.support.texture FILE ...   each place of these files

The rules of the prose are in `tests/texture/rules.tsv`. A pattern is searched in running text, in
which a space also matches a line end. A pattern of the scope `identifier` matches a whole name.
`tests/texture/exempt.tsv` lists the places that stay, with their reason.
"""

from __future__ import annotations

import ast
import csv
import re
import sys
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from tests.support.syntax import list_comments, list_nodes

ROOT = Path(__file__).parents[2]
RULES = ROOT / "tests" / "texture" / "rules.tsv"
EXEMPT = ROOT / "tests" / "texture" / "exempt.tsv"
#: Folders and files that are examined, relative to the root of the repository.
EXAMINED = ("camgen", "postprocessors", "fixtures", "bench", "tests", "docs", "README.md")
#: Pages that are made from the code, whose texts are examined there.
GENERATED = ("api.md", "messages.md")
#: Characters of a line, and parameters of a function, that are allowed.
MOST_CHARACTERS, MOST_PARAMETERS = 100, 6

_COMPREHENSIONS = (ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)
_TWO_WORDS = re.compile(r"[A-Za-z]{2,}[,;:]? [A-Za-z{]")
_LIKE_A_PATTERN = re.compile(r"\\[bswdS]|\(\?|\[\^")


class Rule(NamedTuple):
    """A row of the rules: its name, the scopes in which it holds, and what it forbids."""

    name: str
    scopes: frozenset[str]
    pattern: re.Pattern[str]


class Exemption(NamedTuple):
    """Places that stay as they are.

    file: its name relative to the root of the repository.
    """

    file: str
    kind: str
    text: str


class Place(NamedTuple):
    """A place in a file that is hard to read.

    kind: "wide", "nested", "conditional", "parameters" or "prose".
    line: number of the line, from 1.
    text: the rule with the words that it forbids, or a description.
    """

    kind: str
    line: int
    text: str


@cache
def read_rules() -> tuple[Rule, ...]:
    """The rules of the prose."""
    rules = []
    with RULES.open(encoding="utf-8", newline="") as stream:
        for row in csv.DictReader(stream, delimiter="\t", quoting=csv.QUOTE_NONE):
            pattern = re.compile(row["pattern"].replace(" ", r"[ \n]"))
            rules.append(Rule(row["rule"], frozenset(row["scopes"].split()), pattern))
    return tuple(rules)


@cache
def rules_of(scope: str) -> tuple[Rule, ...]:
    """The rules that hold in `scope`."""
    return tuple(rule for rule in read_rules() if scope in rule.scopes)


@cache
def list_files() -> tuple[Path, ...]:
    """The files that are examined, in order of name. Generated pages are left out."""
    files: list[Path] = []
    for name in EXAMINED:
        path = ROOT / name
        files += [path] if path.is_file() else path.rglob("*.py")
        files += [] if path.is_file() else path.rglob("*.md")
    return tuple(sorted(file for file in files if file.name not in GENERATED))


def list_places(file: Path) -> list[Place]:
    """The places of a Python file or a Markdown page, in order of line."""
    source = file.read_text(encoding="utf-8")
    if file.suffix == ".md":
        places = []
        for line, text in _paragraphs(source):
            places += _search("docs", line, text)
    else:
        nodes = list_nodes(ast.parse(source))
        places = [*_wide(source), *_tangled(nodes), *_names(nodes)]
        for scope, line, text in (*_strings(nodes), *_comments(source, nodes)):
            places += _search(scope, line, text)
    return sorted(places, key=lambda place: place.line)


def read_exemptions() -> dict[Exemption, str]:
    """The reason of each exemption. It holds for each place of its file with its kind and text."""
    with EXEMPT.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream, delimiter="\t", quoting=csv.QUOTE_NONE))
    return {Exemption(row["file"], row["kind"], row["text"]): row["reason"] for row in rows}


# Python


def _wide(source: str) -> Iterator[Place]:
    for number, line in enumerate(source.splitlines(), 1):
        if len(line) > MOST_CHARACTERS:
            yield Place("wide", number, f"{len(line)} characters")


def _tangled(nodes: list[ast.AST]) -> Iterator[Place]:
    """Comprehensions and conditional expressions within others, and long signatures."""
    inner: set[ast.AST] = set()
    for node in nodes:
        if isinstance(node, _COMPREHENSIONS):
            if node in inner or len(node.generators) > 1:
                yield Place("nested", node.lineno, "comprehension within another")
            inner.update(_below(node, _COMPREHENSIONS))
        elif isinstance(node, ast.IfExp):
            if node in inner:
                yield Place("conditional", node.lineno, "conditional expression within another")
            inner.update(_below(node, (ast.IfExp,)))
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield from _long_signature(node)


def _below(node: ast.AST, kinds: tuple[type[ast.AST], ...]) -> Iterator[ast.AST]:
    return (below for below in list_nodes(node)[1:] if isinstance(below, kinds))


def _long_signature(node: ast.FunctionDef | ast.AsyncFunctionDef) -> Iterator[Place]:
    """A function with too many parameters; `*args` and `**kwargs` count one each."""
    arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    count = sum(argument.arg not in ("self", "cls") for argument in arguments)
    count += (node.args.vararg is not None) + (node.args.kwarg is not None)
    if count > MOST_PARAMETERS:
        yield Place("parameters", node.lineno, f"{node.name}: {count} parameters")


def _names(nodes: list[ast.AST]) -> Iterator[Place]:
    """Names that a file binds and a rule forbids."""
    for node in nodes:
        name = _bound_name(node)
        for rule in rules_of("identifier") if name else ():
            if rule.pattern.fullmatch(name):
                yield Place("prose", getattr(node, "lineno", 1), f"{rule.name}: {name}")


def _bound_name(node: ast.AST) -> str:
    match node:
        case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
            return name
        case ast.arg(arg=name) | ast.Name(id=name, ctx=ast.Store()):
            return name
        case ast.Attribute(attr=name, ctx=ast.Store()):
            return name
        case ast.ExceptHandler(name=str(name)) | ast.alias(asname=str(name)):
            return name
    return ""


def _strings(nodes: list[ast.AST]) -> Iterator[tuple[str, int, str]]:
    """Scope, line and text of docstrings and of messages of two words or more."""
    alone: set[int] = set()
    for node in nodes:
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            alone.add(id(node.value))
        elif isinstance(node, ast.JoinedStr):
            alone.update(id(part) for part in list_nodes(node) if isinstance(part, ast.Constant))
    for node in nodes:
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            text = ast.get_docstring(node, clean=True)
            if text:
                yield "docstring", node.body[0].lineno, text
        text = _message(node, alone)
        if _TWO_WORDS.search(text) and not _LIKE_A_PATTERN.search(text):
            yield "message", getattr(node, "lineno", 1), text


def _message(node: ast.AST, alone: set[int]) -> str:
    if isinstance(node, ast.JoinedStr):
        parts = [part.value if isinstance(part, ast.Constant) else "{}" for part in node.values]
        return "".join(map(str, parts))
    if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in alone:
        return node.value
    return ""


def _comments(source: str, nodes: list[ast.AST]) -> Iterator[tuple[str, int, str]]:
    """Scope, line and text of comments; whole lines directly below each other are one text."""
    block: list[str] = []
    first = last = 0
    for line, comment in list_comments(source, nodes):
        if comment.startswith(("# noqa", "# type:", "# fmt:")):
            continue
        if block and line != last + 1:
            yield "comment", first, "\n".join(block)
            block = []
        first = first if block else line
        block.append(comment.lstrip("#: "))
        last = line
    if block:
        yield "comment", first, "\n".join(block)


def _search(scope: str, line: int, text: str) -> Iterator[Place]:
    for rule in rules_of(scope):
        for match in rule.pattern.finditer(text):
            at = line + text.count("\n", 0, match.start())
            yield Place("prose", at, f"{rule.name}: {' '.join(match.group().split())}")


# Markdown


def _paragraphs(source: str) -> Iterator[tuple[int, str]]:
    """Line and text of paragraphs, rows and items, without code."""
    block: list[str] = []
    first, code = 1, False
    for number, row in enumerate([*source.splitlines(), ""], 1):
        fence = row.lstrip().startswith("```")
        code ^= fence
        line = "" if fence else row
        begins = not line.strip() or re.match(r"\s*(?:[-*|#]|\d+\.\s)", line)
        if begins and block:
            yield first, "\n".join(block)
            block = []
        if line.strip() and not code and not line.startswith("    "):
            first = first if block else number
            block.append(re.sub(r"`[^`]*`", "`code`", line))


# The command


def main(arguments: Iterable[str]) -> None:
    """Runs the command that the docstring of this module describes."""
    for file in list(map(Path, arguments)) or list_files():
        for place in list_places(file):
            print(f"{file}:{place.line}: {place.kind}: {place.text}")


if __name__ == "__main__":
    main(sys.argv[1:])
