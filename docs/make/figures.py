"""Figures of the code: python -m docs.make.figures [FOLDER]

FOLDER is the root of another checkout. The Python files of camgen/ and postprocessors/ are counted.
"""

from __future__ import annotations

import ast
import re
import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from itertools import chain
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent
#: Patterns of lines that repeat a formula of camgen/geometry, by the idea of the formula. Arcs are
#: given by points in space.
SIGNS = {
    "arc formulas": (
        r"4 \* np\.arctan2\(",  # the sweep, of height and chord
        r"\bpi - (math|np)?\.?a\w*tan2?|turn = np\.pi - ",  # the sweep, of the angle at via
        r"np\.arccos\(np\.clip\(chord",  # the sweep, of chord and half-chord
        # the sweep about an axis
        r"arctan2\(.*\) % \(2 \* np\.pi\)|atan2\(.*\) % \(2 \* math\.pi\)",
        r"/ \(-?2 \* (square|area2?)\b",  # the centre of three points
        # radius, centre, bulge
        r"\b2 \* \w*[hH]eight / |- a \* a\) / \(2 \* h\)|\+ (h|sagitta)\*\*2\) / \(2 \* ",
        r"chord / \(2 \* sine\)",  # the radius, of the angle at via
        r"= 2 \* .*\[:, None\] \* \w+ - \w+",  # a tangent mirrors the chord
        r"to_via / np\.einsum",  # a tangent by inversion
        r"\(1 - cosine\) / \(1 \+ cosine\)\)",  # the height, of chord and tangent
    ),
    "angles of rotations": (r"tan2\(.*([Tt]race|nii->n)|math\.atan2\(math\.sqrt\(x \* x",),
    "Rodrigues": (
        r"\((cross|skew|matrix) @ (cross|skew|matrix)\)",
        r"(cross\(ax\w+, \w+\)) \* (np\.)?sin|\+ s \* (np\.)?_?(cross\(|across\[0)",
        r"np\.cos\(angles\), np\.sin\(angles\)\], axis=1",
    ),
    "ragged ramps": (
        r"np\.arange\(.*\) - np\.repeat\(",
        r"np\.arange\(.*\) - (\w+\.)*(first|firsts|begin|begins|base|start|before)\[",
        r"np\.arange\(.*\) - \(np\.cumsum\(",
        r"np\.arange\(.*\) - before\b",
    ),
}

Modules = Mapping[str, tuple[Path, ast.Module]]


def read_tree(root: Path) -> Modules:
    """The path and the syntax tree of each module below `root`, by its name."""
    modules_by_name = {}
    for top in ("camgen", "postprocessors"):
        for path in sorted((root / top).rglob("*.py")):
            parts = path.relative_to(root).with_suffix("").parts
            name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
            modules_by_name[name] = (path, ast.parse(path.read_text()))
    return modules_by_name


def list_imports(modules: Modules, name: str) -> set[str]:
    """The modules that a module imports, also within functions."""
    path, syntax = modules[name]
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    imported_names = set()
    for node in ast.walk(syntax):
        if isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                above = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*above, base] if base else above)
            imported_names |= {
                f"{base}.{alias.name}" if f"{base}.{alias.name}" in modules else base
                for alias in node.names
            }
        elif isinstance(node, ast.Import):
            imported_names |= {alias.name for alias in node.names}
    return (imported_names & modules.keys()) - {name}


def count_cycles(graph: Mapping[str, set[str]]) -> int:
    """The number of imports that have to be removed, one after another, to break all cycles."""
    cut = {name: set(others) for name, others in graph.items()}
    for count in range(sum(map(len, cut.values()))):
        try:
            TopologicalSorter(cut).prepare()
        except CycleError as error:
            before, after, *_ = error.args[1]
            cut[after].discard(before)
            continue
        return count
    return 0


def list_private_numbers(syntax: ast.Module) -> Iterator[str]:
    """The private constants of a module whose values are numbers or arithmetic of numbers."""
    for node in syntax.body:
        if isinstance(node, ast.Assign):
            yield from _find_named(node.targets[0], node.value)
        elif isinstance(node, ast.AnnAssign) and node.value is not None:
            yield from _find_named(node.target, node.value)


def _find_named(target: ast.expr, value: ast.expr) -> Iterator[str]:
    if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
        for element, its in zip(target.elts, value.elts, strict=False):
            yield from _find_named(element, its)
    elif (
        isinstance(target, ast.Name)
        and re.fullmatch(r"_[A-Z][A-Z0-9_]*", target.id)
        and _is_number(value)
    ):
        yield target.id


def _is_number(value: ast.expr) -> bool:
    match value:
        case ast.Constant():
            return isinstance(value.value, (int, float)) and not isinstance(value.value, bool)
        case ast.UnaryOp():
            return _is_number(value.operand)
        case ast.BinOp():
            return _is_number(value.left) and _is_number(value.right)
        case ast.Call():
            return (
                bool(value.args) and all(map(_is_number, value.args)) and _is_function(value.func)
            )
        case ast.Name():
            return re.fullmatch(r"_?[A-Z][A-Z0-9_]*", value.id) is not None
        case ast.Attribute():
            return value.attr in ("pi", "tau", "inf", "nan")
    return False


def _is_function(called: ast.expr) -> bool:
    """Whether a function of math or numpy is called, such as math.radians."""
    return (
        isinstance(called, ast.Attribute)
        and isinstance(called.value, ast.Name)
        and called.value.id in ("math", "np")
    )


def list_figures(root: Path) -> list[tuple[str, object]]:
    """Name and value of each figure."""
    modules = read_tree(root)
    graph = {name: list_imports(modules, name) - {"camgen"} for name in modules}
    importers = Counter(chain.from_iterable(graph.values()))
    texts = {name: path.read_text() for name, (path, _) in modules.items()}
    classes: Counter[str] = Counter()
    numbers: Counter[str] = Counter()
    for _, syntax in modules.values():
        classes.update(node.name for node in ast.walk(syntax) if isinstance(node, ast.ClassDef))
        numbers.update(list_private_numbers(syntax))
    rows: list[tuple[str, object]] = [
        ("files", len(modules)),
        ("lines", sum(text.count("\n") for text in texts.values())),
        ("modules with one importer", sum(count == 1 for count in importers.values())),
        (
            "circles",
            count_cycles({name: others for name, others in graph.items() if name != "camgen"}),
        ),
        ("class names used twice or more", sum(count > 1 for count in classes.values())),
        ("private numeric constants", numbers.total()),
        ("names of them used twice or more", sum(count > 1 for count in numbers.values())),
        (
            "the names used most",
            ", ".join(f"{name} {count}" for name, count in numbers.most_common(6)),
        ),
    ]
    for idea, signs in SIGNS.items():
        sign_of_idea = re.compile("|".join(f"(?:{sign})" for sign in signs))
        counts: Counter[str] = Counter()
        for name, text in texts.items():
            lines = [line for line in text.splitlines() if sign_of_idea.search(line)]
            if lines:
                counts[name] = len(lines)
        rows.append(
            (
                f"lines with {idea}",
                f"{counts.total()} in {len(counts)} modules: {', '.join(sorted(counts))}",
            )
        )
    return rows


def main() -> None:
    """Prints the figures."""
    root = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT
    for name, value in list_figures(root):
        print(f"{name:36} {value}")


if __name__ == "__main__":
    main()
