"""Mutation operators for numeric code: small changes of a syntax tree, like typing errors.

`OPERATORS` is the committed list. An operator takes a node and gives its replacements. Annotations,
decorators, imports, docstrings and the guards of type checkers are never changed, because no build
runs them.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from copy import copy, deepcopy
from typing import NamedTuple

#: Fields of nodes, and nodes, that are never changed.
_SKIPPED_FIELDS = frozenset({"annotation", "returns", "decorator_list"})
_SKIPPED_NODES = (ast.Import, ast.ImportFrom, ast.Global, ast.Nonlocal)

_COMPARISONS: dict[type, tuple[type, ...]] = {
    ast.Lt: (ast.LtE, ast.Gt),
    ast.LtE: (ast.Lt, ast.GtE),
    ast.Gt: (ast.GtE, ast.Lt),
    ast.GtE: (ast.Gt, ast.LtE),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
_ARITHMETIC: dict[type, type] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.FloorDiv,
    ast.Pow: ast.Mult,
    ast.MatMult: ast.Mult,
}
_LOGIC: dict[type, type] = {
    ast.And: ast.Or,
    ast.Or: ast.And,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
}
#: Functions of which one is written for the other.
_TWINS = {
    "min": "max",
    "max": "min",
    "minimum": "maximum",
    "maximum": "minimum",
    "argmin": "argmax",
    "argmax": "argmin",
    "any": "all",
    "all": "any",
    "floor": "ceil",
    "ceil": "floor",
    "sin": "cos",
    "cos": "sin",
    "degrees": "radians",
    "radians": "degrees",
}
#: Functions whose arguments are exchanged, and which two of them.
_EXCHANGED = {
    "where": (1, 2),
    "clip": (1, 2),
    "atan2": (0, 1),
    "arctan2": (0, 1),
    "cross": (0, 1),
    "subtract": (0, 1),
}


Replacements = Iterator[ast.AST]


def _copy(node: ast.AST, **fields: object) -> ast.AST:
    """A copy of a node with other values of some fields. Further nodes below it are shared."""
    mutant = copy(node)
    for name, value in fields.items():
        setattr(mutant, name, value)
    return mutant


def _replace(items: list[ast.AST], index: int, *new: ast.AST) -> list[ast.AST]:
    """Items with others for the one at an index."""
    return [*items[:index], *new, *items[index + 1 :]]


def _flip_comparison(node: ast.AST) -> Replacements:
    for index, operator in enumerate(node.ops if isinstance(node, ast.Compare) else ()):
        for other in _COMPARISONS[type(operator)]:
            yield _copy(node, ops=_replace(node.ops, index, other()))


def _change_arithmetic(node: ast.AST) -> Replacements:
    if isinstance(node, ast.BinOp | ast.AugAssign) and type(node.op) in _ARITHMETIC:
        yield _copy(node, op=_ARITHMETIC[type(node.op)]())


def _drop_sign(node: ast.AST) -> Replacements:
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        yield node.operand


def _change_arguments(node: ast.AST) -> Replacements:
    if not isinstance(node, ast.Call):
        return
    name = _name_of(node.func)
    if name in _TWINS:
        field = "id" if isinstance(node.func, ast.Name) else "attr"
        yield _copy(node, func=_copy(node.func, **{field: _TWINS[name]}))
    first, second = _EXCHANGED.get(name, (0, 0))
    if first != second and len(node.args) > second:
        exchanged = list(node.args)
        exchanged[first], exchanged[second] = exchanged[second], exchanged[first]
        yield _copy(node, args=exchanged)


def _name_of(function: ast.expr) -> str:
    match function:
        case ast.Name(id=name) | ast.Attribute(attr=name):
            return name
    return ""


def _shift_index(node: ast.AST) -> Replacements:
    """Changes whole numbers in an index, or at an end of a slice, by one."""
    for number, _ in enumerate(_indices(node) if isinstance(node, ast.Subscript) else ()):
        for step in (-1, 1):
            mutant = deepcopy(node)
            index = _indices(mutant)[number]
            index.value = index.value + step
            yield mutant


def _indices(node: ast.Subscript) -> list[ast.Constant]:
    """The whole numbers that are an index by themselves, with or without a sign, or end a slice."""
    parts = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
    bounds: list[ast.expr | None] = []
    for part in parts:
        bounds += [part.lower, part.upper] if isinstance(part, ast.Slice) else [part]
    bare = [bound.operand if isinstance(bound, ast.UnaryOp) else bound for bound in bounds]
    return [bound for bound in bare if _is_number(bound) and isinstance(bound.value, int)]


def _is_number(node: ast.AST | None) -> bool:
    return isinstance(node, ast.Constant) and type(node.value) in (int, float)


def _change_constant(node: ast.AST) -> Replacements:
    """Replaces a number by 0, its double and its negative."""
    if _is_number(node):
        values = [value for value in (0, node.value * 2, -node.value) if value != node.value]
        yield from map(ast.Constant, dict.fromkeys(values))


def _drop_statement(node: ast.AST) -> Replacements:
    kinds = (ast.Assign, ast.AugAssign, ast.Expr, ast.Return, ast.Raise, ast.If, ast.For)
    is_text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    if isinstance(node, (*kinds, ast.While, ast.Continue, ast.Break)) and not is_text:
        yield ast.Pass()


def _negate_condition(node: ast.AST) -> Replacements:
    if isinstance(node, ast.If | ast.While | ast.IfExp):
        yield _copy(node, test=ast.UnaryOp(ast.Not(), node.test))
    for index, test in enumerate(node.ifs if isinstance(node, ast.comprehension) else ()):
        yield _copy(node, ifs=_replace(node.ifs, index, ast.UnaryOp(ast.Not(), test)))


def _skip_call(node: ast.AST) -> Replacements:
    if isinstance(node, ast.Call) and node.args and not isinstance(node.args[0], ast.Starred):
        yield node.args[0]


def _change_logic(node: ast.AST) -> Replacements:
    if isinstance(node, ast.BoolOp | ast.BinOp | ast.AugAssign) and type(node.op) in _LOGIC:
        yield _copy(node, op=_LOGIC[type(node.op)]())
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.Invert):
        yield node.operand
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
        yield ast.Constant(not node.value)


def _drop_element(node: ast.AST) -> Replacements:
    is_sequence = isinstance(node, ast.Tuple | ast.List) and isinstance(node.ctx, ast.Load)
    if is_sequence and len(node.elts) > 1:
        for index in range(len(node.elts)):
            yield _copy(node, elts=_replace(node.elts, index))


class Operator(NamedTuple):
    """A kind of change.

    name: its key in the tables.
    meaning: an example.
    replace: gives the replacements of a node, none if the operator does not apply to it.
    """

    name: str
    meaning: str
    replace: Callable[[ast.AST], Replacements]


OPERATORS = (
    Operator("comparison", "a < b -> a <= b, a > b; == -> !=; in -> not in", _flip_comparison),
    Operator("arithmetic", "a + b -> a - b; a * b -> a / b; a % b -> a // b", _change_arithmetic),
    Operator("sign", "-a -> a", _drop_sign),
    Operator("arguments", "where(m, a, b) -> where(m, b, a); min -> max", _change_arguments),
    Operator("index", "a[1:] -> a[0:], a[2:]; a[-1] -> a[-2], a[0]", _shift_index),
    Operator("constant", "2.0 -> 0, 4.0, -2.0", _change_constant),
    Operator("statement", "a = b -> pass; return a -> pass", _drop_statement),
    Operator("condition", "if a: -> if not a:", _negate_condition),
    Operator("call", "f(a, b) -> a", _skip_call),
    Operator("logic", "a and b -> a or b; not a -> a; True -> False", _change_logic),
    Operator("element", "(a, b, c) -> (a, c)", _drop_element),
)
_BY_NAME = {operator.name: operator for operator in OPERATORS}


class Site(NamedTuple):
    """A change at a place of a module.

    slot: index of the node in the order in which `_list_slots` visits them.
    operator: name of an operator.
    variant: index of the replacement among those of the operator.
    line: line of the node in the source, from 1.
    """

    slot: int
    operator: str
    variant: int
    line: int


class _Slot(NamedTuple):
    """A node and the field of its parent that holds it. index: -1 if the field is not a list."""

    parent: ast.AST
    field: str
    index: int
    node: ast.AST


def _list_slots(tree: ast.AST) -> list[_Slot]:
    """All nodes below `tree` that may be changed, parents first."""
    slots = []
    for field, value in ast.iter_fields(tree):
        if field in _SKIPPED_FIELDS:
            continue
        children = value if isinstance(value, list) else [value]
        for index, child in enumerate(children):
            if not isinstance(child, ast.AST) or _is_skipped(child):
                continue
            slots.append(_Slot(tree, field, index if isinstance(value, list) else -1, child))
            slots += _list_slots(child)
    return slots


def _is_skipped(node: ast.AST) -> bool:
    if isinstance(node, _SKIPPED_NODES):
        return True
    return isinstance(node, ast.If) and _name_of(node.test) == "TYPE_CHECKING"


def find_sites(source: str) -> list[Site]:
    """All changes that the operators make in a module, in the order of its tree."""
    sites = []
    for number, slot in enumerate(_list_slots(ast.parse(source))):
        line = getattr(slot.node, "lineno", getattr(slot.parent, "lineno", 0))
        for operator in OPERATORS:
            for variant, _ in enumerate(operator.replace(slot.node)):
                sites.append(Site(number, operator.name, variant, line))
    return sites


def mutate(source: str, site: Site) -> ast.Module:
    """The tree of a module with one change."""
    tree = ast.parse(source)
    slot, replacement = _find_change(tree, site)
    ast.copy_location(replacement, slot.node)
    if slot.index < 0:
        setattr(slot.parent, slot.field, replacement)
    else:
        getattr(slot.parent, slot.field)[slot.index] = replacement
    return ast.fix_missing_locations(tree)


def describe(source: str, site: Site) -> tuple[str, str]:
    """The changed node before and after, on one line each, for a table."""
    slot, replacement = _find_change(ast.parse(source), site)
    return _spell(slot.node), _spell(replacement)


def _find_change(tree: ast.AST, site: Site) -> tuple[_Slot, ast.AST]:
    """The slot of a change, and its new node."""
    slot = _list_slots(tree)[site.slot]
    return slot, list(_BY_NAME[site.operator].replace(slot.node))[site.variant]


def _spell(node: ast.AST) -> str:
    text = " ".join(ast.unparse(node).split())
    return text if len(text) <= _LONGEST_SPELLING else text[: _LONGEST_SPELLING - 3] + "..."


#: Characters of a node in a table.
_LONGEST_SPELLING = 90
