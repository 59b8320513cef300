"""A table of how dense code is: wide lines, nested and conditional expressions, long signatures.

    python -m docs.make.style FOLDER ...

Each folder has a row, of camgen or of another project. A line of code has a token other than a
comment or a docstring. Comprehensions, conditional expressions, functional expressions
(lambda, map, filter, reduce) and values by `and` or `or` are counted per 1,000 of these lines.
"""

from __future__ import annotations

import ast
import io
import sys
import tokenize
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

#: Characters of a line, and parameters of a function, that are not counted.
MOST_CHARACTERS, MOST_PARAMETERS = 100, 6
COLUMNS = (
    "folder",
    "statements",
    "wide lines, %",
    "comprehensions",
    "conditional expressions",
    "lambda, map, filter",
    "and, or as values",
    f"over {MOST_PARAMETERS} parameters",
    "*args, **kwargs",
    "classes of one function",
)
_COMPREHENSIONS = (ast.ListComp, ast.SetComp, ast.DictComp, ast.GeneratorExp)
_FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)
_FUNCTIONAL = {"map", "filter", "reduce"}
_NO_CODE = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENCODING,
    tokenize.ENDMARKER,
}


def main(folders: list[str]) -> int:
    """Print a table with a row for each folder."""
    if not folders:
        sys.exit(__doc__)
    print(f"| {' | '.join(COLUMNS)} |")
    print(f"|{'---|' * len(COLUMNS)}")
    for folder in folders:
        counts = sum((count(file) for file in list_files(Path(folder))), Counter[str]())
        print(f"| {' | '.join([folder, *format_row(counts)])} |")
    return 0


def list_files(folder: Path) -> list[Path]:
    """The Python files of a folder, or the file itself, in order of name."""
    return [folder] if folder.is_file() else sorted(folder.rglob("*.py"))


def format_row(counts: Counter[str]) -> list[str]:
    """The cells of a folder after its name. counts: sums of `count`."""
    thousands = max(counts["code"], 1) / 1000
    dense = ("comprehension", "conditional", "functional", "value")
    rates = [f"{counts[kind] / thousands:.0f}" for kind in dense]
    wide = f"{100 * counts['wide'] / max(counts['line'], 1):.1f}"
    numbers = [str(counts[kind]) for kind in ("parameters", "star", "lone class")]
    return [f"{counts['statement']:,}", wide, *rates, *numbers]


def count(file: Path) -> Counter[str]:
    """Numbers of a file by kind: lines, lines of code, statements, and what the columns show."""
    source = file.read_text(encoding="utf-8")
    tree = ast.parse(source)
    counts: Counter[str] = Counter()
    lines = source.splitlines()
    counts["line"] = len(lines)
    counts["wide"] = sum(len(line) > MOST_CHARACTERS for line in lines)
    counts["code"] = len(find_code_lines(source, tree))
    counts["lone class"] = len(list_lone_classes(tree))
    for node in ast.walk(tree):
        counts.update(name_kinds(node))
    return counts


def find_code_lines(source: str, tree: ast.Module) -> set[int]:
    """The numbers of the lines with code."""
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in _NO_CODE:
            lines.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            lines.difference_update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return lines


def name_kinds(node: ast.AST) -> Iterator[str]:
    """The kinds as which a node counts."""
    if isinstance(node, ast.stmt):
        yield "statement"
    if isinstance(node, _COMPREHENSIONS):
        yield "comprehension"
    elif isinstance(node, ast.IfExp):
        yield "conditional"
    elif isinstance(node, ast.Lambda):
        yield "functional"
    elif isinstance(node, ast.Call):
        if isinstance(node.func, ast.Name) and node.func.id in _FUNCTIONAL:
            yield "functional"
    elif isinstance(node, _FUNCTIONS):
        yield from _name_signature(node.args)
    # A test consists of conditions; elsewhere `and` and `or` choose a value.
    for value in _list_values(node):
        if isinstance(value, ast.BoolOp) and not all(map(_is_condition, value.values)):
            yield "value"


def _name_signature(arguments: ast.arguments) -> Iterator[str]:
    named = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
    count_named = sum(argument.arg not in ("self", "cls") for argument in named)
    if count_named > MOST_PARAMETERS:
        yield "parameters"
    if arguments.vararg or arguments.kwarg:
        yield "star"


def _list_values(node: ast.AST) -> list[ast.expr]:
    """The expressions in a node whose value is kept or passed on."""
    if isinstance(node, ast.Assign | ast.AnnAssign | ast.AugAssign | ast.Return | ast.keyword):
        return [node.value] if node.value is not None else []
    return [*node.args] if isinstance(node, ast.Call) else []


def _is_condition(value: ast.expr) -> bool:
    """Whether an operand of `and` or `or` is true or false, not another value."""
    if isinstance(value, ast.BoolOp):
        return all(map(_is_condition, value.values))
    is_not = isinstance(value, ast.UnaryOp) and isinstance(value.op, ast.Not)
    return is_not or isinstance(value, ast.Compare | ast.Call)


def list_lone_classes(tree: ast.Module) -> list[str]:
    """The private classes of a module that one function alone uses."""
    owners: dict[str, set[str]] = {
        node.name: set() for node in tree.body if isinstance(node, ast.ClassDef)
    }
    for outer in tree.body:
        bodies = outer.body if isinstance(outer, ast.ClassDef) else [outer]
        for number, part in enumerate(bodies):
            for node in ast.walk(part):
                if isinstance(node, ast.Name) and node.id in owners:
                    name = getattr(part, "name", str(number))
                    owners[node.id].add(f"{getattr(outer, 'name', '')} {name}")
    return [name for name, users in owners.items() if name.startswith("_") and len(users) == 1]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
