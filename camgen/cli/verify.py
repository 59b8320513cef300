"""``camgen verify``: reads a program back, says what it does, lists its faults, and compares it with a plan."""

from __future__ import annotations

import itertools
from argparse import Namespace
from collections.abc import Mapping, Sequence
from pathlib import Path

from camgen.check.report import Motions, sum_up
from camgen.cli.motion_file import load as load_plan
from camgen.cli.say import Voice, length, table
from camgen.lower.steps import split_tools
from camgen.model.errors import InputError
from camgen.model.program import Columns, Program
from camgen.model.text import counted, duration, grouped, short
from camgen.post import Fault, Post, Remark
from camgen.post.plugins import fill_tables, find_post, find_readback, make_post
from camgen.post.verify import compare
from camgen.read.files import Files, reason
from camgen.read.job_file import beside, load

_NAMES = {
    "MoveJ": "joint motion",
    "MoveL": "straight motion",
    "MoveC": "arc",
    "Output": "output",
    "Wait": "wait",
    "Force": "force change",
    "ToolChange": "tool change",
    "Stop": "stop",
}


def run(arguments: Namespace, says: Voice) -> int:
    """Prints the sums and the faults of a program; InputError when it has faults, VerifyError when it deviates,
    NoSafeProgram when it cuts what must stay of the part that ``--part`` names.

    A remark is a fault only where the program is compared with a plan: our own leave nothing open.
    """
    paths = [Path(name) for name in arguments.programs]
    files = Files()
    plan = load_plan(Path(arguments.plan), files) if arguments.plan else None
    drawing = Path(arguments.part) if arguments.part else None
    named = beside(arguments.job, None if plan else paths[0])
    job = load(named or beside(None, drawing), arguments.sets, files)
    options = (plan.options if plan else {}) | job.post
    post = make_post(find_post(arguments.post), options)
    says.stage("reading")
    texts = _texts(paths, files)
    reading = find_readback(arguments.post)(texts, fill_tables(type(post), options))
    says.clear()
    motions = sum_up(Columns(reading.body))
    rows = _rows(motions, sum(text.count("\n") for text in texts.values()))
    told = _faults(reading.faults, texts)

    def say(more: Sequence[tuple[str, str]] = (), also: str = "") -> None:
        if arguments.json:
            found = [_as_data(fault, texts) for fault in reading.faults]
            says.data({"sums": motions, "told": dict([*rows, *more]), "faults": found})
        else:
            says.out(table([*rows, *more]) + told + also)

    serious = [fault for fault in reading.faults if plan or not isinstance(fault, Remark)]
    if serious:
        say()
        first = serious[0]
        what = f"{counted(len(serious), 'fault')}, first: {first.what}"
        raise InputError(str(paths[0]), what, _place(first.line, texts), "mend the program")
    if not reading.body:
        raise InputError(str(paths[0]), f"holds no instruction of {post.name}", remedy="name its own post with --post")
    if plan:
        says.stage("comparing")
        prepared = post.prepare(_planned(plan.program, post, paths[0]), plan.chord)
        found = compare(prepared, reading, post.tolerance(), post.list_verified(), str(paths[0]))
        says.clear()
        rows.append(("plan", f"{counted(found.instructions, 'instruction')} equal"))
        rows.append(("deviation", f"{found.max_mm:.6f} mm"))
    if drawing is None:
        say()
        return 0
    from camgen.cli.stock import judge  # noqa: PLC0415 (shapely, only for what needs it)

    says.stage("proving")
    stock = judge(str(paths[0]), drawing, job, reading, files, lambda line: _place(line, texts))
    says.clear()
    say(stock.rows, stock.told)
    if stock.error is not None:
        raise stock.error
    return 0


def _planned(program: Program, post: Post, path: Path) -> Program:
    """What the program in ``path`` was planned to do: of several, a tool each, the one of its name."""
    parts = (program,) if post.changes_tools else split_tools(program)
    if len(parts) == 1:
        return parts[0]
    found = next((part for part in parts if part.name == path.stem), None)
    if found is None:
        names = ", ".join(part.name for part in parts)
        raise InputError(str(path), "the plan holds a program for each tool", names, "give one by its own name")
    return found


def _texts(paths: Sequence[Path], files: Files) -> Mapping[str, str]:
    """The texts by file name, in order, with LF line ends."""
    texts: dict[str, str] = {}
    for path in paths:
        try:
            data = files.open(path).data
        except (OSError, ValueError) as error:
            raise InputError(str(path), f"cannot be read: {reason(error)}") from error
        if not data.strip() or b"\0" in data:
            raise InputError(str(path), "is empty" if not data.strip() else "is not a text", remedy="give a program")
        if path.name in texts:
            raise InputError(str(path), "another file has this name", remedy="the files of a program differ in name")
        # Comments of other programs may hold any byte; nothing else in a program does, so each byte is a character.
        texts[path.name] = data.decode("latin-1").replace("\r\n", "\n").replace("\r", "\n")
    return texts


def _rows(motions: Motions, lines: int) -> list[tuple[str, str]]:
    kinds = [counted(n, _NAMES[kind]) for kind, n in motions.counts.items() if n]
    rows = [("program", f"{counted(lines, 'line')}: {', '.join(kinds) or 'no instruction'}")]
    rows.append(("straight", length(motions.straight)))
    rows.append(("arcs", length(motions.arc)))
    rows.append(("joint", f"{length(motions.joint)} between the ends"))
    rows.append(("time", f"about {duration(motions.seconds)}"))
    rows.append(("speed", " to ".join(dict.fromkeys(short(v, 3) for v in motions.speeds)) + " mm/s"))
    if motions.extents:
        pairs = zip("xyz", *motions.extents, strict=True)
        rows.append(("extents", ", ".join(f"{axis} {short(a, 3)} to {short(b, 3)}" for axis, a, b in pairs) + " mm"))
    for name, values in motions.outputs.items():
        rows.append(("output", f"{name}: {', '.join(short(v, 3) for v in values)}"))
    if motions.force:
        rows.append(("force", f"up to {short(motions.force, 3)} N"))
    return rows


def _faults(faults: Sequence[Fault], files: Mapping[str, str]) -> str:
    kinds = ("remark: " if isinstance(fault, Remark) else "" for fault in faults)
    return "".join(
        f"{_place(fault.line, files)}: {kind}{fault.what}\n" for fault, kind in zip(faults, kinds, strict=True)
    )


def _as_data(fault: Fault, files: Mapping[str, str]) -> dict[str, object]:
    """A fault with its place; a remark is one only against a plan."""
    return {"place": _place(fault.line, files), "what": fault.what, "remark": isinstance(fault, Remark)}


def _place(line: int, files: Mapping[str, str]) -> str:
    """File and line of a line counted through all files."""
    counts = [len(text.splitlines()) for text in files.values()]
    for name, count, before in zip(files, counts, itertools.accumulate(counts, initial=0), strict=False):
        if line <= before + count:
            return f"{name} line {grouped(line - before)}"
    return f"line {line}"
