"""The command `init`: a job file with all settings, and the page of documents on them."""

from __future__ import annotations

import dataclasses
import textwrap
import tomllib
from argparse import Namespace
from collections.abc import Mapping, Sequence
from pathlib import Path

from msgspec import Struct
from msgspec.structs import replace

from camgen.batch.writing import check_targets, write_all
from camgen.cli.proposal import WHY_LEFT, describe, list_proposed, tabulate
from camgen.cli.say import Terminal, label_rows
from camgen.model.errors import (
    AmbiguousInput,
    CamgenError,
    InputError,
    JobError,
    NoSafeProgram,
    Refused,
)
from camgen.model.job import Job, OperationTable
from camgen.model.job_tables import (
    Setting,
    list_row_settings,
    list_row_tables,
    list_settings,
    list_tables,
)
from camgen.model.part import Part
from camgen.model.text import counted, name_first
from camgen.model.toml import format_toml
from camgen.plan.propose import Proposal
from camgen.post import Post
from camgen.post.job_schema import read_default
from camgen.post.plugins import find_post, list_installed
from camgen.read import find_reader
from camgen.read.files import Files, identity
from camgen.read.job_file import load_job, parse_assignment


def run(arguments: Namespace, terminal: Terminal) -> None:
    """Write the job file into the current folder, never over an existing one.

    With `--operations` the job is built once, so that it makes a checked program.
    """
    files = Files()
    source = files.read(arguments.input)
    target = Path(source.name).with_suffix(".toml")
    if target.exists():
        raise JobError(str(target), "exists", remedy="rename it, or delete it to get a new one")
    check_targets([target], [source.path])
    terminal.stage("reading")
    reader = find_reader(source)
    sets = _with_material(arguments.sets, arguments.material)
    job = load_job(None, sets, files)
    # The proposal does not depend on [operation].
    reading = replace(job, operation=OperationTable())
    part = reader.read(source, reading, files) if reader.makes == "drawing" else None
    units = "" if part is None else part.units
    option = "--material" if arguments.material else ""
    if arguments.operations:
        option = "--operations"
    proposal = _propose(part, job, source.name, option, terminal)
    chosen = Chosen(
        values={(table, key): value for table, key, value in map(parse_assignment, sets)},
        proposal=proposal,
        active=arguments.operations,
    )
    text = write_template(source.name, units, chosen)
    if arguments.operations and part is not None:
        error = _try_program(part, text, terminal)
        with_tabs = proposal is not None and _has_tabs(proposal)
        is_refused = error is not None and isinstance(error.__cause__, Refused)
        if isinstance(error, NoSafeProgram) and with_tabs and not is_refused:
            # Other cuts may cut off the tabs beside narrow regions.
            proposal = _propose(part, job, source.name, option, terminal, with_tabs=False)
            chosen = replace(chosen, proposal=proposal)
            text = write_template(source.name, units, chosen)
            terminal.rows([("held", f"by a skin, not by tabs: {error.what}", "look")])
            error = _try_program(part, text, terminal)
        if error is not None:
            raise InputError(
                part.source,
                f"the proposed operations make no program: {error}",
                "--operations",
                "without it they are written as comments",
            ) from error
    write_all([(target, text.encode())], files.opened)
    in_file = f"; {source.name}: {units}" if units else ""
    terminal.rows([("job", f"{target}: every setting with its default{in_file}", "plain")])
    if proposal is not None:
        about, tone = "as comments; --operations uses it", "plain"
        if arguments.operations:
            values = "depths" if proposal.material else "depths and speeds"
            about, tone = f"{values} are placeholders", "look"
        terminal.rows([("proposed", f"{describe(proposal)}: {about}", tone)])
        terminal.rows(label_rows("operation", tabulate(proposal)))
        if proposal.left:
            what = f"{counted(len(proposal.left), 'contour')} in no operation"
            terminal.rows([("left", f"{what}: {name_first(proposal.left)} ({WHY_LEFT})", "look")])
    if identity(source.path.parent) != identity(target.parent):
        command = f"camgen build {source.path} --job {target}"
        terminal.rows([("use", f"{command}: the job file is not beside the input", "look")])


def _with_material(sets: Sequence[str], name: str | None) -> list[str]:
    """The settings with that of the material. Raises JobError for an unknown name."""
    if name is None:
        return list(sets)
    from camgen.model.materials import MATERIALS  # noqa: PLC0415 (only with --material)

    if name not in MATERIALS:
        raise JobError(
            f"--material {name}",
            "there are no charts for this material",
            remedy=f"one of {', '.join(MATERIALS)}",
        )
    return [*sets, f'stock.material="{name}"']


def _propose(
    part: Part | None,
    job: Job,
    source: str,
    option: str,
    terminal: Terminal,
    *,
    with_tabs: bool = True,
) -> Proposal | None:
    """The operations for the drawing `part`, None without any.

    job: job with the stock and with the tools of a library.
    source: name of the drawing.
    option: option that requests operations, "" for none. With it, a drawing without operations
        raises InputError.
    with_tabs: whether tabs hold parts and slugs; otherwise a skin does.
    """
    if part is None or part.raster is not None or part.solid is not None or part.curves:
        if option:
            raise InputError(source, "is not a flat drawing", option, "leave it out")
        return None
    terminal.stage("proposing")
    from camgen.plan.propose import propose  # noqa: PLC0415 (shapely, only for drawings)

    try:
        proposal = propose(part, job.stock, job.tools, with_tabs=with_tabs)
    except AmbiguousInput as error:
        if option:
            raise
        terminal.rows([("proposed", f"no operations: {error}", "look")])
        return None
    if proposal is None and option:
        raise InputError(
            source,
            "has no closed contour that a drill or a mill could make",
            option,
            "camgen inspect shows its contours; or leave it out",
        )
    return proposal


def _has_tabs(proposal: Proposal) -> bool:
    return any("tabs" in operation.row for operation in proposal.operations)


def _try_program(part: Part, text: str, terminal: Terminal) -> CamgenError | None:
    """The error of a build of `part` with the job `text`, None if it makes a checked program."""
    from camgen.pipeline import build  # noqa: PLC0415 (all of camgen, only with --operations)

    terminal.stage("building")
    try:
        build(part, post="gcode", job=tomllib.loads(text))
    except CamgenError as error:
        return error
    return None


class Chosen(Struct, frozen=True, eq=False):
    """The lines of a job file that differ from the defaults.

    values: values by table and key, as `--set` has them.
    proposal: tools and operations, None without any.
    active: whether the proposal is used; otherwise it is written as comments.
    """

    values: Mapping[tuple[str, str], object] = {}
    proposal: Proposal | None = None
    active: bool = False

    def assign(self, table: str, key: str) -> list[str]:
        """The line of a key with another value than its default, empty for any other key."""
        if (table, key) in self.values:
            return [f"{key} = {format_toml(self.values[table, key])}"]
        if self.proposal and self.active and (table, key) == ("stock", "thickness"):
            return [f"{key} = {format_toml(self.proposal.thickness)}  # measure it"]
        if self.proposal and self.active and (table, key) == ("stock", "margin"):
            return [f"{key} = {format_toml(self.proposal.margin)}  # frame beside the widest cut"]
        return []


def write_template(source: str, units: str, chosen: Chosen | None = None) -> str:
    """A job file with all settings, their defaults and their descriptions."""
    chosen = chosen or Chosen()
    lines = [
        f"# camgen job for {_comment(source)}",
        "# Lengths mm, angles deg, speeds mm/s, forces N, times s. "
        "Every line holds its default: delete what you keep.",
    ]
    for table, about in list_tables().items():
        if table == "post":
            lines += _row_lines()
            if chosen.proposal:
                lines += list_proposed(chosen.proposal, chosen.active)
        lines += ["", f"[{table}]  # {about}"]
        for setting in list_settings():
            if setting.table == table:
                meaning = setting.about.removesuffix(".") + "."
                if units and setting.key == "units":
                    meaning += f" This file: {_comment(units)}."
                lines += textwrap.wrap(meaning, 116, initial_indent="# ", subsequent_indent="# ")
                lines += chosen.assign(table, setting.key) or _assignment(
                    setting.key, setting.default, setting.allowed
                )
    for (table, key), value in chosen.values.items():
        if table == "post":
            lines.append(f"{key} = {format_toml(value)}")
    return "\n".join([*lines, *_post_lines()]) + "\n"


def _row_lines() -> list[str]:
    """The keys of `[[tools]]` and `[[operations]]` as comments, since rows have no defaults."""
    lines: list[str] = []
    for table, about in list_row_tables().items():
        lines += [
            "",
            *textwrap.wrap(about, 118, initial_indent="# ", subsequent_indent="# "),
            f"# [[{table}]]",
        ]
        lines += [f"# {s.key} =  # {s.about}" for s in _list_own(table)]
    return lines


def _list_own(table: str) -> list[Setting]:
    """The settings of a table of rows that no table of the job has."""
    shared = [s.key for s in list_settings() if s.table in _SHARED]
    return [s for s in list_row_settings() if s.table == table and s.key not in shared]


def _assignment(key: str, default: object, allowed: str) -> list[str]:
    if default is None:
        return [f"# {key} =  # {allowed}; not set"]
    line = f"{key} = {format_toml(default)}"
    return [f"# {allowed}", line] if allowed.startswith("one of") else [line]


def _post_lines() -> list[str]:
    """The options of all posts as comments, since they depend on the chosen post."""
    shared = dataclasses.fields(Post)
    common = {option.name for option in shared}
    lines = ["# every post:", *map(_option, shared)]
    for post in list_installed():
        if post.broken:
            continue
        kind = find_post(post.name)
        lines.append(f"# {kind.name}:")
        for option in dataclasses.fields(kind):
            if option.init and option.name not in common:
                lines.append(_option(option))
    return lines


def _option(option: dataclasses.Field[object]) -> str:
    about = option.metadata.get("help", "")
    line = f"# {option.name} = {format_toml(read_default(option))}"
    return f"{line}  # {about}" if about else line


def _comment(text: str) -> str:
    """`text` without characters that would end a comment."""
    return "".join(c if c.isprintable() else " " for c in text)


def write_reference() -> str:
    """The tables of a job file as Markdown.

    `python -m camgen.cli.init > docs/job.md` writes the page.
    """
    lines = [_INTRODUCTION]
    for table, about in list_tables().items():
        lines += [f"\n## `[{table}]`\n", about[0].upper() + about[1:]]
        if table in _TEXTS:
            lines.append(_TEXTS[table])
            continue
        lines += _keys([s for s in list_settings() if s.table == table])
    for table, about in list_row_tables().items():
        lines += [f"\n## `[[{table}]]`\n", about[0].upper() + about[1:]]
        lines += _keys(_list_own(table))
    return "\n".join(lines) + "\n"


#: Tables whose keys a row may have too.
_SHARED = ("tool", "operation", "process")


def _keys(settings: Sequence[Setting]) -> list[str]:
    """A table of settings in Markdown."""
    lines = ["\n| key | default, and allowed values | meaning |", "|---|---|---|"]
    for s in settings:
        default = "not set" if s.default is None else f"`{format_toml(s.default)}`"
        lines.append(f"| `{s.key}` | {default}{_shorten(s)} | {_cell(s.about)} |")
    return lines


def _shorten(setting: Setting) -> str:
    """The possible values of a setting, as they follow its default on the page.

    Returns "" if the default shows their type.
    """
    if setting.allowed in _SHOWN and setting.default is not None:
        return ""
    text = setting.allowed.replace(' or a text with its unit, "1200 mm/min"', ' or "1200 mm/min"')
    if text.startswith("one of "):
        others = text.removeprefix("one of ").replace(f"{format_toml(setting.default)}, ", "", 1)
        return f" or {_cell(others)}"
    for words, short in (("a number >", ">"), ("a whole number", "whole number")):
        text = text.replace(words, short)
    return ", " + _cell(text.replace("a list of", "list of").replace("a text", "text"))


#: Types that a default shows.
_SHOWN = ("a text", "true or false", "a table", "a list of texts")


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


_INTRODUCTION = """\
# The job file

A job file is TOML: tables of keys. All keys have a default, so a file holds only what differs.
`camgen init part.dxf` writes `part.toml` with everything in it. `camgen build part.dxf` uses
`part.toml` beside the drawing if it is there, and says so; `--job FILE` names another one.
`--set table.key=value` sets one key and wins over the file. The value is read as TOML, else as
text, so `--set operation.kind=trace` needs no quotes.

Lengths are mm, angles deg, speeds mm/s, forces N, times s. A bound alone stands for a number with
this bound. An unknown table or key is an error that names the nearest known one.

This page is generated from the settings; a test keeps it current."""

_POST = """
They depend on the post: see its page. `camgen init` writes them all into the job file, as comments.
An option that the chosen post does not have is an error."""

_LIMITS = """
[The limits with their values](reliability.md#limits) are one table for jobs and commands."""


#: Tables of which the page has no rows.
_TEXTS = {"post": _POST, "limits": _LIMITS}


if __name__ == "__main__":
    print(write_reference(), end="")
