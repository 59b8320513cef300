"""The page of all messages, from the calls in the code that make them.

    python -m docs.make.pages        writes docs/messages.md

A message is an argument of one of the calls in `CALLS`. Its text is followed through the variables
of the function that makes it. An ellipsis stands for a value that only a run has.
"""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from itertools import islice, product
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
FOLDERS = ("camgen", "postprocessors")
#: Sign for a value that only a run has.
GAP = "…"
#: Entries of a rule of `check_rules`: whether it is broken, the fault, its place, the remedy.
_RULE = 4
#: Texts that one expression may have; the others are left out.
_MOST = 6


class Form(NamedTuple):
    """A call that makes a message, with the places of its positional arguments, -1 for none.

    section: its section of the page.
    text: place of the message.
    why: place of its cause.
    remedy: place of its remedy.
    kind: place of the argument that names a part of the section.
    """

    section: str
    text: int
    why: int = -1
    remedy: int = -1
    kind: int = -1


#: Calls by their name.
CALLS = {
    "InputError": Form("exit code 2: the input", 1, remedy=3),
    "AmbiguousInput": Form("exit code 2: the input", 1, remedy=3),
    "JobError": Form("exit code 2: the job or the command", 1, remedy=3),
    "check_suffix": Form("exit code 2: the job or the command", 2, remedy=3),
    "NoSafeProgram": Form("exit code 3: no safe program", 1, remedy=3),
    "Refused": Form("exit code 3: no safe program", 2, remedy=3),
    "Blocked": Form("exit code 3: no safe program", 1, remedy=3),
    "VerifyError": Form("exit code 4: text and plan differ", 1, remedy=3),
    "Note": Form("summary", 1, why=2, kind=0),
    "Finding": Form("finding", 2, kind=0),
    "find": Form("finding", 1, kind=0),
    "Unreadable": Form("finding: refused", 0),
    "Impossible": Form("finding: refused", 0),
    "LineError": Form("finding: refused", 0),
    "Wrong": Form("finding: refused", 1),
    "faults": Form("finding: refused", 0),
    "assume": Form("finding: assumed", 0),
    "choose": Form("finding: assumed", 0),
    "lose": Form("finding: left out", 0),
    "leave_out": Form("finding: left out", 0),
    "omit": Form("finding: left out", 0),
}
#: Calls of `CALLS` that mean a message in the languages alone.
_OF_LANGUAGES = {"find", "assume", "choose", "lose", "leave_out", "omit", "Finding"}


class Message(NamedTuple):
    """A message of the page.

    section: its section.
    why: its cause, or the consequence that a note has.
    """

    section: str
    text: str
    why: str
    remedy: str


def messages_page() -> str:
    """The text of docs/messages.md."""
    sections: dict[str, set[Message]] = defaultdict(set)
    for message in list_messages():
        sections[message.section].add(message)
    lines = [_HEAD]
    for section in sorted(sections):
        lines += ["", f"## {section[0].upper()}{section[1:]}", "", *_make_table(sections[section])]
    return "\n".join(lines) + "\n"


_HEAD = f"""# Messages

All messages of camgen, from its code. An error names the file and the place before the text, and
the remedy after it. {GAP} is a name or a number of the run. Search this page for the words between
two of them.

[Exit codes](command-line.md#exit-codes) says what an exit code means,
[verify](verify.md#what-is-found) what a level of a finding means."""


def _make_table(messages: set[Message]) -> Iterator[str]:
    """The rows of a section, with the columns that any of its messages has."""
    places = {"message": 1, "cause": 2, "remedy": 3}
    for name in ("cause", "remedy"):
        if not any(message[places[name]] for message in messages):
            del places[name]
    yield f"| {' | '.join(places)} |"
    yield "|---" * len(places) + "|"
    rows = set()
    for message in messages:
        cells = [_escape(message[place]) for place in places.values()]
        rows.add(f"| {' | '.join(cells)} |")
    yield from sorted(rows)


def _escape(text: str) -> str:
    for character in "&<>|*_[]`":
        text = text.replace(character, f"&#{ord(character)};")
    return text


@cache
def list_messages() -> tuple[Message, ...]:
    """The messages of all modules, each as often as the code makes it."""
    messages: list[Message] = []
    for folder in FOLDERS:
        for file in sorted((ROOT / folder).rglob("*.py")):
            name = file.relative_to(ROOT).as_posix()
            tree = ast.parse(file.read_text(encoding="utf-8"))
            is_language = "/lang/" in name or name.startswith("post")
            messages += _list_in(tree, is_language=is_language)
    return tuple(messages)


def _list_in(tree: ast.Module, *, is_language: bool) -> Iterator[Message]:
    """The messages of a module."""
    constants = _find_assigned(tree.body)
    for scope in _list_scopes(tree):
        nodes = list(_walk(scope))
        texts = constants | _find_assigned(nodes)
        for node in nodes:
            if not isinstance(node, ast.Call):
                continue
            name = getattr(node.func, "id", getattr(node.func, "attr", ""))
            form = CALLS.get(name)
            if form is not None and (is_language or name not in _OF_LANGUAGES):
                yield from _read_call(node, form, texts)
            if name == "check_rules":
                # The rows of its table hold what JobError is given.
                for row in ast.walk(node):
                    if isinstance(row, ast.Tuple) and len(row.elts) == _RULE:
                        error = ast.Call(node.func, row.elts, [])
                        yield from _read_call(error, CALLS["JobError"], texts)


def _list_scopes(tree: ast.Module) -> list[ast.AST]:
    functions = (ast.FunctionDef, ast.AsyncFunctionDef)
    return [node for node in ast.walk(tree) if isinstance(node, functions)] + [tree]


def _walk(scope: ast.AST) -> Iterator[ast.AST]:
    """The nodes of a function or a module without those of its inner functions."""
    waiting = [*ast.iter_child_nodes(scope)][::-1]
    while waiting:
        node = waiting.pop()
        yield node
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            waiting += [*ast.iter_child_nodes(node)][::-1]


#: Expressions that set a variable, and expressions that are added to it, in order.
_Texts = dict[str, tuple[list[ast.expr], list[ast.expr]]]


def _find_assigned(nodes: list[ast.AST] | list[ast.stmt]) -> _Texts:
    texts: _Texts = {}
    for node in nodes:
        match node:
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                texts.setdefault(name, ([], []))[0].append(value)
            case ast.Assign(targets=[ast.Tuple(elts=names)], value=ast.Tuple(elts=values)):
                for target, value in zip(names, values, strict=False):
                    if isinstance(target, ast.Name):
                        texts.setdefault(target.id, ([], []))[0].append(value)
            case ast.AugAssign(target=ast.Name(id=name), op=ast.Add(), value=value):
                texts.setdefault(name, ([], []))[1].append(value)
    return texts


def _read_call(call: ast.Call, form: Form, texts: _Texts) -> Iterator[Message]:
    """The messages of a call. A text without two words in a row is a gap or a name."""
    whys = _read_argument(call, form.why, "why", texts)
    remedies = _read_argument(call, form.remedy, "remedy", texts)
    kinds = _read_argument(call, form.kind, "kind", texts) if form.kind >= 0 else [""]
    for text in _read_argument(call, form.text, "what", texts):
        words = [word for word in text.split() if GAP not in word]
        if len(words) < 2:
            continue
        for kind, why, remedy in islice(product(kinds, whys, remedies), _MOST):
            section = f"{form.section}: {kind}" if kind and kind != GAP else form.section
            yield Message(section, text, why, remedy)


def _read_argument(call: ast.Call, place: int, keyword: str, texts: _Texts) -> list[str]:
    """The texts of an argument, an empty text if the call does not have it."""
    for given in call.keywords:
        if given.arg == keyword:
            return _read(given.value, texts)
    if 0 <= place < len(call.args):
        return _read(call.args[place], texts)
    return [""]


def _read(node: ast.expr, texts: _Texts, depth: int = 0) -> list[str]:
    """The texts that an expression may be, in order, each once."""
    match node:
        case ast.Constant(value=str(text)):
            options = [text]
        case ast.JoinedStr(values=parts):
            options = _join([_read(part, texts, depth + 1) for part in parts])
        case ast.FormattedValue(value=value):
            options = _read(value, texts, depth + 1)
        case ast.BinOp(left=left, op=ast.Add(), right=right):
            options = _join([_read(left, texts, depth + 1), _read(right, texts, depth + 1)])
        case ast.IfExp(body=body, orelse=other):
            options = [*_read(body, texts, depth + 1), *_read(other, texts, depth + 1)]
        case ast.Call(func=ast.Name(id="counted"), args=[_, ast.Constant(value=str(noun))]):
            options = [f"{GAP} {noun}s"]
        case ast.Call(func=ast.Name(id="counted"), args=[_, _, ast.Constant(value=str(plural))]):
            options = [f"{GAP} {plural}"]
        case ast.Name(id=name) if name in texts and depth < _MOST:
            options = _read_variable(texts[name], texts, depth + 1)
        case _:
            options = [GAP]
    return list(dict.fromkeys(_tidy(text) for text in options))[:_MOST]


def _read_variable(
    assigned: tuple[list[ast.expr], list[ast.expr]], texts: _Texts, depth: int
) -> list[str]:
    """The texts of a variable. Each addition may be left out."""
    options: list[str] = []
    for value in assigned[0]:
        options += _read(value, texts, depth)
    parts = [options or [GAP]]
    parts += [["", *_read(value, texts, depth)] for value in assigned[1]]
    return _join(parts)


def _join(parts: list[list[str]]) -> list[str]:
    return ["".join(texts) for texts in islice(product(*parts), _MOST)]


def _tidy(text: str) -> str:
    """A text in one line, with one ellipsis for several in a row."""
    text = " ".join(text.split("\n"))
    while GAP * 2 in text:
        text = text.replace(GAP * 2, GAP)
    return text
