"""Figures of the house: python -m docs.make.figures, or with the folder of another tree behind it.

Counted is what is installed: the Python files of camgen/ and postprocessors/.
"""

from __future__ import annotations

import ast
import re
import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent
#: Signs that a line writes down an idea that has a room of its own. The arcs are those given by points in space.
SIGNS = {
    "arc formulas": (
        r"4 \* np\.arctan2\(",  # the sweep, of height and chord
        r"\bpi - (math|np)?\.?a\w*tan2?|turn = np\.pi - ",  # the sweep, of the angle at via
        r"np\.arccos\(np\.clip\(chord",  # the sweep, of chord and half-chord
        r"arctan2\(.*\) % \(2 \* np\.pi\)|atan2\(.*\) % \(2 \* math\.pi\)",  # the sweep about an axis
        r"/ \(-?2 \* (square|area2?)\b",  # the centre of three points
        r"\b2 \* \w*[hH]eight / |- a \* a\) / \(2 \* h\)|\+ (h|sagitta)\*\*2\) / \(2 \* ",  # radius, centre, bulge
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

Tree = Mapping[str, tuple[Path, ast.Module]]


def tree(root: Path) -> Tree:
    """The modules below ``root`` by name: path and syntax."""
    found = {}
    for top in ("camgen", "postprocessors"):
        for path in sorted((root / top).rglob("*.py")):
            parts = path.relative_to(root).with_suffix("").parts
            name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
            found[name] = (path, ast.parse(path.read_text()))
    return found


def imported(modules: Tree, name: str) -> set[str]:
    """The modules that ``name`` imports, those within functions included."""
    path, syntax = modules[name]
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    found = set()
    for node in ast.walk(syntax):
        if isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                above = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*above, base] if base else above)
            found |= {
                f"{base}.{alias.name}" if f"{base}.{alias.name}" in modules else base
                for alias in node.names
            }
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return (found & modules.keys()) - {name}


def circles(graph: Mapping[str, set[str]]) -> int:
    """How many circles of imports have to be cut, one after the other, until there is none."""
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


def private_numbers(syntax: ast.Module) -> Iterator[str]:
    """The private constants at the top of a module whose value is a number, made of nothing but numbers."""
    for node in syntax.body:
        if isinstance(node, ast.Assign):
            yield from _named(node.targets[0], node.value)
        elif isinstance(node, ast.AnnAssign) and node.value is not None:
            yield from _named(node.target, node.value)


def _named(target: ast.expr, value: ast.expr) -> Iterator[str]:
    if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
        for one, its in zip(target.elts, value.elts, strict=False):
            yield from _named(one, its)
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
    """math.radians, np.cos and the like, which make a number of numbers."""
    return (
        isinstance(called, ast.Attribute)
        and isinstance(called.value, ast.Name)
        and called.value.id in ("math", "np")
    )


def figures(root: Path) -> list[tuple[str, object]]:
    """What is counted, and how many."""
    modules = tree(root)
    graph = {name: imported(modules, name) - {"camgen"} for name in modules}
    importers = Counter(other for others in graph.values() for other in others)
    texts = {name: path.read_text() for name, (path, _) in modules.items()}
    classes = Counter(
        node.name
        for _, syntax in modules.values()
        for node in ast.walk(syntax)
        if isinstance(node, ast.ClassDef)
    )
    numbers = Counter(
        number for _, syntax in modules.values() for number in private_numbers(syntax)
    )
    rows: list[tuple[str, object]] = [
        ("files", len(modules)),
        ("lines", sum(text.count("\n") for text in texts.values())),
        ("modules with one importer", sum(count == 1 for count in importers.values())),
        ("circles", circles({name: others for name, others in graph.items() if name != "camgen"})),
        ("class names used twice or more", sum(count > 1 for count in classes.values())),
        ("private numeric constants", numbers.total()),
        ("names of them used twice or more", sum(count > 1 for count in numbers.values())),
        (
            "the names used most",
            ", ".join(f"{name} {count}" for name, count in numbers.most_common(6)),
        ),
    ]
    for idea, signs in SIGNS.items():
        shown = re.compile("|".join(f"(?:{sign})" for sign in signs))
        places = Counter(
            name for name, text in texts.items() for line in text.splitlines() if shown.search(line)
        )
        rows.append(
            (
                f"lines with {idea}",
                f"{places.total()} in {len(places)} modules: {', '.join(sorted(places))}",
            )
        )
    return rows


def main() -> None:
    root = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT
    for what, value in figures(root):
        print(f"{what:36} {value}")


if __name__ == "__main__":
    main()
