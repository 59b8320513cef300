"""The nodes and the comments of Python files, faster than by `ast.walk` and `tokenize`."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator
from typing import NamedTuple


class Comment(NamedTuple):
    """A comment.

    line: the number of its line, from 1.
    text: the characters from its hash to the end of the line.
    """

    line: int
    text: str


#: Half of all nodes, with nothing below them but marks of loading and storing.
_LEAVES = frozenset((ast.Name, ast.Constant, ast.alias, ast.Pass))


def list_children(node: ast.AST) -> list[ast.AST]:
    """The nodes directly below a node, without the marks of loading and storing."""
    children: list[ast.AST] = []
    for value in vars(node).values():
        if isinstance(value, list):
            children += [item for item in value if isinstance(item, ast.AST)]
        elif isinstance(value, ast.AST) and not isinstance(value, ast.expr_context):
            children.append(value)
    return children


def list_nodes(tree: ast.AST) -> list[ast.AST]:
    """A node and all nodes below it, each before those below it."""
    nodes = [tree]
    for node in nodes:
        if type(node) not in _LEAVES:
            nodes += list_children(node)
    return nodes


def list_comments(source: str, nodes: Iterable[ast.AST]) -> Iterator[Comment]:
    """The comments of a file, in order of line. nodes: all nodes of its tree.

    The first hash of a line that is not within a string begins its comment.
    """
    lines = source.encode().split(b"\n")
    marked = {number for number, line in enumerate(lines, 1) if b"#" in line}
    strings: dict[int, list[tuple[int, int]]] = {}
    for node in nodes:
        if isinstance(node, ast.JoinedStr) or _is_string(node):
            for line in marked.intersection(range(node.lineno, node.end_lineno + 1)):
                first = node.col_offset if line == node.lineno else 0
                last = node.end_col_offset if line == node.end_lineno else len(lines[line - 1])
                strings.setdefault(line, []).append((first, last))
    for number in sorted(marked):
        line = lines[number - 1]
        start = line.find(b"#")
        while any(first <= start < last for first, last in strings.get(number, ())):
            start = line.find(b"#", start + 1)
        if start >= 0:
            yield Comment(number, line[start:].decode().rstrip())


def _is_string(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str | bytes)
