"""docs/api.md: the Python interface, from its docstrings."""

from __future__ import annotations

import ast
import copy
import importlib
import inspect
import re

Outlined = ast.ClassDef | ast.FunctionDef

#: Heading, module and its names on the page; "Name.method" is a method of a class.
SECTIONS: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    ("Build", "camgen.pipeline", ("build", "Result", "Result.report", "Result.text")),
    (
        "Stage by stage",
        "camgen.pipeline.stages",
        (
            "job", "read", "part", "cell", "plan", "order", "lower", "check", "post", "read_back",
            "verify", "preview",
        ),
    ),
    ("What is read", "camgen.model.part", ("Part", "Contour", "Solid", "Edge", "Note")),
    ("What is planned", "camgen.plan", ("Plan", "Operation", "read_options")),
    ("Tool paths and tours", "camgen.model.path", ("ToolPath", "Tour")),
    ("The program", "camgen.model.program", ("Program",)),
    (
        "Its instructions",
        "camgen.model.instructions",
        ("Origin", "MoveJ", "MoveL", "MoveC", "Output", "Wait", "Force", "Comment", "Joints"),
    ),
    (
        "Poses",
        "camgen.model.pose",
        ("Pose", "pose_from_values", "rotation_vector", "rotation_from_vector"),
    ),
    ("Cells", "camgen.robots.workcell", ("Workcell",)),
    ("Checks", "camgen.check", ("Checks",)),
    ("Readers", "camgen.read", ("Reader", "find_reader")),
    ("Posts", "camgen.post", ("Post", "OutputFile", "Tolerance")),
    (
        "Languages",
        "camgen.lang.programs",
        ("Language", "RunRequest", "Executed", "Frames", "Finding", "Assumption"),
    ),
    ("Machines", "camgen.model.cell", ("Cell", "Dynamics")),
    (
        "Plug-ins",
        "camgen.post.plugins",
        ("list_installed", "find_post", "find_readback", "make_post", "Installed"),
    ),
    ("Comparison", "camgen.post.verify", ("compare", "Deviation")),
    ("Conformance kit", "camgen.post.kit", ("cases", "check_case", "conformance")),
    (
        "Errors",
        "camgen.model.errors",
        ("CamgenError", "InputError", "JobError", "NoSafeProgram", "Refused", "VerifyError"),
    ),
)  # fmt: skip
#: Sections with whole docstrings. The other sections have the first paragraph of each docstring.
WHOLE = frozenset({"Build", "Stage by stage", "Its instructions", "Errors"})
_INTRODUCTION = """\
# Python interface

```python
import camgen

result = camgen.build("part.dxf", post="rapid", job={"tool": {"diameter": 8.0}})
print(result.text)
print(result.report["time_s"], result.deviation.max_mm)
```

`build` writes and prints nothing. All values are frozen, and typed (`py.typed`). Lengths are mm,
angles rad, times s, forces N; settings have the units of [the job file](job.md).

Errors are `CamgenError`s, with the exit code that the command line would return:

```python
from camgen import CamgenError

try:
    result = camgen.build("part.dxf", post="rapid")
except CamgenError as error:
    print(error, error.exit_code)
```

[Python, by example](python.md) shows the stages, [writing a post](writing-a-post.md) posts and
languages. Names that are not on this page may change without a line in the changelog.
`help(camgen.Part)`, for example, prints what each field holds.
"""


def api_page() -> str:
    """The text of docs/api.md."""
    parts = [_INTRODUCTION]
    for heading, module, names in SECTIONS:
        parts.append(f"\n## {heading}: `{module}`\n")
        parts += [_entry(module, name, is_whole=heading in WHOLE) for name in names]
    return "\n".join(parts).rstrip("\n") + "\n"


def _entry(module: str, name: str, *, is_whole: bool) -> str:
    """Heading, outline and docstring of a name, or the first paragraph of the docstring."""
    member: object = importlib.import_module(module)
    for part in name.split("."):
        member = inspect.getattr_static(member, part)
    text = re.sub(r"``([^`]+)``", r"`\1`", inspect.getdoc(member) or "")
    if not is_whole:
        text = text.partition("\n\n")[0]
    return f"### `{name}`\n\n```python\n{_outline(module, name)}\n```\n\n{text}\n"


def _outline(module: str, name: str) -> str:
    """The head of a function, or the head and the fields of a class."""
    node = _find_node(module, name)
    if isinstance(node, ast.ClassDef):
        bases = ", ".join(ast.unparse(base) for base in node.bases if ast.unparse(base) != "Struct")
        title, fields = (
            f"class {node.name}({bases})" if bases else f"class {node.name}",
            _fields(node),
        )
        return "\n".join([f"{title}:", *fields]) if fields else f"{title}: ..."
    head = copy.copy(node)
    head.body, head.decorator_list = [ast.Expr(ast.Constant(...))], node.decorator_list
    line = ast.unparse(head).replace(":\n    ...", ": ...")
    return line if len(line) <= 100 else _split_head(line)


def _fields(node: ast.ClassDef) -> list[str]:
    """The public fields of a class with type and default. Metadata of `field` is left out."""
    rows = []
    for item in node.body:
        if isinstance(item, ast.AnnAssign) and not ast.unparse(item.target).startswith("_"):
            row = f"    {ast.unparse(item.target)}: {ast.unparse(item.annotation)}"
            value = item.value
            if isinstance(value, ast.Call) and ast.unparse(value.func) == "field":
                value = next(
                    (word.value for word in value.keywords if word.arg == "default"),
                    ast.Constant(...),
                )
            rows.append(row + (f" = {ast.unparse(value)}" if value else ""))
        elif isinstance(item, ast.Assign) and not ast.unparse(item).startswith("_"):
            rows.append(f"    {ast.unparse(item)}")
    return rows


def _find_node(module: str, name: str) -> Outlined:
    """The definition of a name, which may be in another module than `module`."""
    first, _, method = name.partition(".")
    home = getattr(importlib.import_module(module), first).__module__
    tree: ast.Module | ast.ClassDef = ast.parse(inspect.getsource(importlib.import_module(home)))
    for part in (first, method) if method else (first,):
        tree = next(n for n in tree.body if isinstance(n, Outlined) and n.name == part)
    return tree


def _split_head(line: str) -> str:
    """A long head with one argument per line."""
    call = ast.parse(line).body[0]
    assert isinstance(call, ast.FunctionDef)
    head, back = line.partition("(")[0], line.rpartition(" -> ")[2]
    rows = _arguments(call.args)
    return f"{head}(\n" + "".join(f"    {row},\n" for row in rows) + f") -> {back}"


def _arguments(args: ast.arguments) -> list[str]:
    plain = [None] * (len(args.args) - len(args.defaults)) + list(args.defaults)
    rows = [_argument(argument, value) for argument, value in zip(args.args, plain, strict=True)]
    if args.kwonlyargs:
        rows.append("*")
    return rows + [
        _argument(argument, value)
        for argument, value in zip(args.kwonlyargs, args.kw_defaults, strict=True)
    ]


def _argument(argument: ast.arg, value: ast.expr | None) -> str:
    kind = f": {ast.unparse(argument.annotation)}" if argument.annotation else ""
    return f"{argument.arg}{kind}" + (f" = {ast.unparse(value)}" if value else "")
